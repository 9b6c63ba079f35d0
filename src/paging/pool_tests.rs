use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use super::super::{ReadAhead, run_reader};
use super::*;

#[derive(Clone, Copy)]
struct Key(u64);

impl Request for Key {
    fn brick(&self) -> u64 {
        self.0
    }

    fn form(&self) -> usize {
        usize::try_from(self.0 % 3).unwrap()
    }

    fn level(&self) -> usize {
        usize::try_from(self.0 % 2).unwrap()
    }

    fn last_turn(&self) -> u64 {
        self.0 / 2
    }
}

/// Bricks are their own key's square; keys from 1000 on are damaged while `broken`.
#[derive(Default)]
struct Squares {
    created: AtomicU64,
    loads: AtomicU64,
    announced: AtomicU64,
    pause: Duration,
    broken: AtomicBool,
}

impl Loader for &Squares {
    type Request = Key;
    type Brick = u64;
    type Scratch = ();

    fn new_brick(&self) -> u64 {
        self.created.fetch_add(1, Ordering::Relaxed);
        0
    }

    fn announce(&self, _: &Key) {
        self.announced.fetch_add(1, Ordering::Relaxed);
    }

    fn load(&self, request: &Key, _: &mut (), brick: &mut u64) -> Result<Loaded> {
        self.loads.fetch_add(1, Ordering::Relaxed);
        std::thread::sleep(self.pause);
        *brick = u64::MAX;
        if request.0 >= 1000 && self.broken.load(Ordering::Relaxed) {
            return Err(Error::invalid(format!("brick {}", request.0), "damaged"));
        }
        *brick = request.0 * request.0;
        Ok(Loaded { read: 1, decompressed: 2, reading: self.pause / 4 })
    }
}

fn value(pool: &Pool<'_, &Squares>, key: u64) -> u64 {
    *pool.get(&Key(key), &mut ()).unwrap()
}

#[test]
fn slots_are_created_once_and_reused() {
    let (loader, counters) = (Squares::default(), Counters::new(100, 2));
    let pool = Pool::new(3, &loader, &counters);
    for key in (0..20).chain(0..20) {
        assert_eq!(value(&pool, key), key * key);
        assert_eq!(value(&pool, key), key * key);
    }
    assert_eq!(loader.created.load(Ordering::Relaxed), 3);
    assert_eq!((counters.distinct(), counters.reloaded()), (20, 20));
    let loaded = Loaded { read: 40, decompressed: 80, reading: Duration::ZERO };
    assert_eq!(counters.loaded(), loaded);
}

#[test]
fn pinned_bricks_stay_and_a_pool_full_of_pins_is_an_error() {
    let (loader, counters) = (Squares::default(), Counters::new(100, 2));
    let pool = Pool::new(3, &loader, &counters);
    let pins: Vec<_> = (5..7).map(|key| pool.get(&Key(key), &mut ()).unwrap()).collect();
    for key in 20..40 {
        assert_eq!(value(&pool, key), key * key);
    }
    assert_eq!((*pins[0], *pins[1]), (25, 36));
    assert_eq!(value(&pool, 5), 25);
    assert_eq!(loader.loads.load(Ordering::Relaxed), 22, "pinned bricks are not loaded again");
    let last = pool.get(&Key(9), &mut ()).unwrap();
    let refused = pool.get(&Key(10), &mut ()).unwrap_err().to_string();
    assert!(refused.contains("raise --memory"), "{refused}");
    drop(last);
    assert_eq!(value(&pool, 10), 100);
}

#[test]
fn a_failed_load_reaches_everyone_who_asked_and_leaves_the_pool_whole() {
    let loader = Squares { pause: Duration::from_millis(20), ..Squares::default() };
    loader.broken.store(true, Ordering::Relaxed);
    let counters = Counters::new(100, 2);
    let pool = Pool::new(2, &loader, &counters);
    let together = Barrier::new(4);
    let failures: usize = std::thread::scope(|scope| {
        let ask = || {
            together.wait();
            usize::from(pool.get(&Key(1000), &mut ()).is_err())
        };
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(ask)).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).sum()
    });
    assert_eq!(failures, 4);
    assert!(pool.load_ahead(&Key(1001), &mut ()).is_err());
    assert!(!pool.holds(Key(1000).key()) && !pool.holds(Key(1001).key()));
    loader.broken.store(false, Ordering::Relaxed);
    assert_eq!((value(&pool, 1000), value(&pool, 7), value(&pool, 8)), (1_000_000, 49, 64));
    assert_eq!(loader.created.load(Ordering::Relaxed), 2);
}

#[test]
fn threads_that_ask_for_one_brick_load_it_once() {
    let loader = Squares { pause: Duration::from_millis(20), ..Squares::default() };
    let counters = Counters::new(100, 2);
    let pool = Pool::new(4, &loader, &counters);
    let together = Barrier::new(4);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                together.wait();
                assert_eq!(value(&pool, 9), 81);
            });
        }
    });
    assert_eq!(loader.loads.load(Ordering::Relaxed), 1);
    assert!(
        counters.waited() >= Duration::from_millis(45),
        "three waited for it, one for the file"
    );
    assert!(counters.worked() >= Duration::from_millis(15), "one prepared it");
}

#[test]
fn bricks_loaded_ahead_outlive_used_ones_and_do_not_push_each_other_out() {
    let (loader, counters) = (Squares::default(), Counters::new(100, 2));
    let pool = Pool::new(4, &loader, &counters);
    for key in [1, 2] {
        value(&pool, key);
    }
    for key in [3, 4, 5] {
        pool.load_ahead(&Key(key), &mut ()).unwrap();
    }
    assert!(pool.holds(Key(3).key()) && pool.holds(Key(4).key()));
    assert_eq!(value(&pool, 6), 36);
    assert!(pool.holds(Key(3).key()) && pool.holds(Key(4).key()), "a used brick went first");
}

#[test]
fn what_no_turn_to_come_needs_makes_room_before_new_slots_do() {
    let (loader, counters) = (Squares::default(), Counters::new(100, 2));
    let pool = Pool::new(50, &loader, &counters);
    let held = pool.get(&Key(1), &mut ()).unwrap();
    for key in (0..10).rev() {
        value(&pool, key);
    }
    let created = || loader.created.load(Ordering::Relaxed);
    // Turn 2 needs keys 4 and 5.
    pool.turns_are_over(2);
    for key in 20..23 {
        value(&pool, key);
    }
    assert_eq!((created(), *held), (10, 1), "0, 2 and 3 make room, 1 is held");
    value(&pool, 23);
    assert_eq!(created(), 11);
    assert!((4..10).chain(20..24).all(|key| pool.holds(Key(key).key())));
    // What begins anew may need anything.
    pool.begin_turns();
    value(&pool, 6);
    pool.turns_are_over(4);
    value(&pool, 24);
    value(&pool, 25);
    assert_eq!(created(), 12, "6 makes room, and no other");
    assert!((4..6).chain(7..10).chain(20..26).all(|key| pool.holds(Key(key).key())));
}

#[test]
fn what_is_asked_for_ahead_too_late_is_not_loaded() {
    let (loader, counters) = (Squares::default(), Counters::new(100, 2));
    let pool = Pool::new(4, &loader, &counters);
    pool.turns_are_over(2);
    for key in [3, 4] {
        pool.load_ahead(&Key(key), &mut ()).unwrap();
    }
    assert!(!pool.holds(Key(3).key()) && pool.holds(Key(4).key()));
    assert_eq!(value(&pool, 3), 9, "whoever needs it nevertheless gets it");
    pool.begin_turns();
    pool.load_ahead(&Key(2), &mut ()).unwrap();
    assert!(pool.holds(Key(2).key()));
}

#[test]
fn a_brick_that_is_needed_for_longer_than_was_said_first_stays() {
    let mut clock = Clock::new(4);
    let Claim { place, brick } = clock.claim(7, || ()).unwrap();
    clock.publish(place, brick, true, 0);
    assert!(matches!(clock.find(7, 5), Found::Ready(_)));
    clock.turns_are_over(1);
    clock.claim(8, || ()).unwrap();
    assert!(clock.holds(7));
    clock.turns_are_over(6);
    clock.claim(9, || ()).unwrap();
    assert!(!clock.holds(7));
}

#[test]
fn turns_are_noted_in_bounded_memory() {
    let mut clock = Clock::new(4);
    for n in 0..10_000_u64 {
        let Claim { place, brick } = clock.claim(n, || ()).unwrap();
        clock.publish(place, brick, true, n + 5);
        for turn in n..n + 3 {
            assert!(matches!(clock.find(n, turn), Found::Ready(_)));
        }
        assert!(clock.notes() <= 8);
    }
}

#[test]
fn a_crowd_of_threads_in_the_smallest_pool_sees_only_right_bricks() {
    let (loader, counters) = (Squares::default(), Counters::new(100, 2));
    // Each of 4 threads pins two bricks and fills one; the reader fills one.
    let pool = Pool::new(4 * 3 + 1, &loader, &counters);
    let (ahead, requests) = ReadAhead::new(4);
    std::thread::scope(|scope| {
        scope.spawn(|| run_reader(&pool, &requests, &mut ()));
        for thread in 0..4u64 {
            let (pool, ahead) = (&pool, ahead.clone());
            scope.spawn(move || {
                for step in 0..3000u64 {
                    let key = (step * (7 + thread)) % 60;
                    ahead.request(pool, Key((key + 7 + thread) % 60));
                    let first = pool.get(&Key(key), &mut ()).unwrap();
                    let second = pool.get(&Key((key * 3) % 60), &mut ()).unwrap();
                    assert_eq!(value(pool, (key + 1) % 60), ((key + 1) % 60).pow(2));
                    assert_eq!((*first, *second), (key * key, ((key * 3) % 60).pow(2)));
                }
            });
        }
        drop(ahead);
    });
    assert!(loader.created.load(Ordering::Relaxed) <= 13);
    assert_eq!(counters.distinct(), 60);
}
