//! Damaged dumps: thousands of flipped, cut and spliced files.

use super::made::MadeDump;

/// Numbers that look random and are the same in every run (xorshift).
struct Noise(u64);

impl Noise {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit as u64) as usize
    }

    /// Flips, replaces, cuts or doubles a few bytes.
    fn damage(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        for _ in 0..=self.below(3) {
            let at = self.below(bytes.len().max(1)).min(bytes.len().saturating_sub(1));
            match self.below(8) {
                0 => bytes.truncate(at),
                1 => bytes.extend_from_within(at..),
                2 | 3 if at < bytes.len() => bytes[at] = b"0123456789-=.e \n\xff\0"[self.below(18)],
                _ if at < bytes.len() => bytes[at] ^= 1 << self.below(8),
                _ => {}
            }
        }
        bytes
    }
}

#[test]
fn damaged_dumps_are_read_or_refused_but_never_panic() {
    let dump = MadeDump::new();
    dump.write();
    dump.write_tables();
    let files = ["", "hierarchy", "hierarchy.hdf5", "cpu0000"].map(|suffix| {
        let path = dump.path().with_extension(suffix);
        (std::fs::read(&path).unwrap(), path)
    });
    let mut noise = Noise(0x9e37_79b9_7f4a_7c15);
    let (mut read, mut refused) = (0, 0);
    for round in 0..4000 {
        let (bytes, path) = &files[round % files.len()];
        if path == &files[1].1 {
            std::fs::remove_file(&files[2].1).unwrap();
        }
        std::fs::write(path, noise.damage(bytes)).unwrap();
        match dump.read() {
            Ok(_) => read += 1,
            Err(error) => {
                refused += 1;
                assert_eq!(error.to_string().lines().count(), 1, "{error}");
            }
        }
        std::fs::write(path, bytes).unwrap();
        std::fs::write(&files[2].1, &files[2].0).unwrap();
    }
    assert!(read > 100 && refused > 1000, "{read} read, {refused} refused");
}
