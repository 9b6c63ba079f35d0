//! Ways to damage a cache.

use super::anatomy::{Anatomy, Kind, Number, PAGE, word};
use super::noise::Noise;
use super::payload::{PARTS, Payload, compress};

/// What must come of a damaged cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Expected {
    /// `verify` tells, and what is drawn or looked up is an error or what it was before.
    Found,
    /// `verify` tells.
    Reported,
    /// It may be a cache of other data, as sound as any.
    Sound,
}

/// A damaged cache.
pub(crate) struct Damaged {
    /// What was done.
    pub(crate) what: String,
    /// Its bytes.
    pub(crate) bytes: Vec<u8>,
    /// What must come of it.
    pub(crate) expected: Expected,
}

/// Bytes and anatomy of a sound cache.
pub(crate) struct Sound {
    /// The whole file.
    pub(crate) bytes: Vec<u8>,
    /// Where everything lies in it.
    pub(crate) anatomy: Anatomy,
}

impl Sound {
    /// A copy with bytes flipped, cut, moved or doubled; no checksum is repaired.
    pub(crate) fn damaged(&self, noise: &mut Noise) -> Damaged {
        let bytes = noise.damage(&self.bytes);
        Damaged { what: "bytes".into(), bytes, expected: Expected::Found }
    }

    /// A copy that contradicts itself or means something else, with all checksums right.
    pub(crate) fn forged(&self, noise: &mut Noise, other: &Self) -> Damaged {
        match noise.below(16) {
            0..=2 => self.header_number(noise),
            3..=5 => self.node_number(noise),
            6..=7 => self.field_number(noise),
            8 => self.several_numbers(noise),
            9 => self.swapped_records(noise),
            10 => self.states(noise),
            11 => self.values(noise),
            12 => self.payload_shape(noise),
            13 => self.spliced_payload(noise, other),
            14 => self.level_table(noise),
            _ => self.sealed_noise(noise),
        }
    }

    fn set(&self, bytes: &mut [u8], number: &Number, noise: &mut Noise) {
        let count = number.kind.bytes();
        let old = word(bytes, number.at, count);
        let mut new = old;
        while new == old {
            new = another(number.kind, old, noise) & (u64::MAX >> (64 - 8 * count));
        }
        bytes[number.at..number.at + count].copy_from_slice(&new.to_le_bytes()[..count]);
    }

    fn header_number(&self, noise: &mut Noise) -> Damaged {
        let mut bytes = self.bytes.clone();
        let number = *noise.pick(&self.anatomy.header);
        self.set(&mut bytes, &number, noise);
        if number.name != "page table checksum" {
            self.anatomy.seal(&mut bytes);
        }
        self.anatomy.seal_header(&mut bytes);
        let grew = word(&bytes, number.at, number.kind.bytes())
            > word(&self.bytes, number.at, number.kind.bytes());
        // NaN says that there is none.
        let float = f64::from_bits(word(&bytes, number.at, number.kind.bytes()));
        let is_factor = float.is_nan() || float > 0.0 && float.is_finite();
        let expected = match number.name {
            "file bytes"
            | "index offset"
            | "index pages"
            | "page table checksum"
            | "brick edge"
            | "level count"
            | "level octree"
            | "level first node"
            | "level nodes" => Expected::Found,
            "level cells" | "level leaf cells" | "level simulation" | "root cells" => {
                Expected::Reported
            }
            "parent blocks" if !grew => Expected::Found,
            "field to cgs" | "field smallest positive" if !is_factor => Expected::Found,
            _ => Expected::Sound,
        };
        Damaged { what: format!("header: {}", number.name), bytes, expected }
    }

    fn node_number(&self, noise: &mut Noise) -> Damaged {
        let mut bytes = self.bytes.clone();
        let node = noise.below(self.anatomy.nodes);
        let number = *noise.pick(&self.anatomy.node_numbers(node));
        self.set(&mut bytes, &number, noise);
        self.anatomy.seal(&mut bytes);
        Damaged { what: format!("brick: {}", number.name), bytes, expected: Expected::Found }
    }

    fn field_number(&self, noise: &mut Noise) -> Damaged {
        let (node, field) = self.some_payload(noise);
        let mut bytes = self.bytes.clone();
        let number = *noise.pick(&self.anatomy.field_numbers(node, field));
        self.set(&mut bytes, &number, noise);
        self.anatomy.seal(&mut bytes);
        let float = |bytes: &[u8]| f32::from_bits(word(bytes, number.at, 4) as u32);
        let expected = match number.name {
            // What is said to hold less than it does may be left out of a picture.
            "own min" | "tree min" if float(&bytes) <= float(&self.bytes) => Expected::Sound,
            "own max" | "tree max" if float(&bytes) >= float(&self.bytes) => Expected::Sound,
            "own min" | "own max" | "tree min" | "tree max" => Expected::Reported,
            "residual" | "flags" => Expected::Sound,
            _ => Expected::Found,
        };
        Damaged { what: format!("brick's field: {}", number.name), bytes, expected }
    }

    fn several_numbers(&self, noise: &mut Noise) -> Damaged {
        let mut bytes = self.bytes.clone();
        for _ in 0..2 + noise.below(4) {
            let node = noise.below(self.anatomy.nodes);
            let numbers = match noise.below(4) {
                0 => self.anatomy.header.clone(),
                1 => self.anatomy.node_numbers(node),
                _ => self.anatomy.field_numbers(node, noise.below(self.anatomy.fields)),
            };
            let number = *noise.pick(&numbers);
            self.set(&mut bytes, &number, noise);
        }
        self.anatomy.seal(&mut bytes);
        Damaged { what: "several numbers".into(), bytes, expected: Expected::Sound }
    }

    fn swapped_records(&self, noise: &mut Noise) -> Damaged {
        let mut bytes = self.bytes.clone();
        let length = self.anatomy.record_bytes();
        let (mut one, mut two) = (0, 0);
        while bytes[one..one + length] == bytes[two..two + length] {
            one = self.anatomy.record(noise.below(self.anatomy.nodes));
            two = self.anatomy.record(noise.below(self.anatomy.nodes));
        }
        let copy = bytes[one..one + length].to_vec();
        bytes.copy_within(two..two + length, one);
        let doubled = noise.below(2) == 0;
        if !doubled {
            bytes[two..two + length].copy_from_slice(&copy);
        }
        self.anatomy.seal(&mut bytes);
        let what = if doubled { "record doubled" } else { "records swapped" };
        Damaged { what: what.into(), bytes, expected: Expected::Found }
    }

    /// A brick and field that have a payload.
    fn some_payload(&self, noise: &mut Noise) -> (usize, usize) {
        loop {
            let place = (noise.below(self.anatomy.nodes), noise.below(self.anatomy.fields));
            if !self.anatomy.stored(&self.bytes, place.0, place.1)[0].is_empty() {
                return place;
            }
        }
    }

    fn with_payload(&self, place: (usize, usize), payload: &Payload) -> Vec<u8> {
        let parts = payload.compressed();
        let parts = parts.each_ref().map(Vec::as_slice);
        self.anatomy.with_payload(&self.bytes, place, (parts, payload.rounding_errors()))
    }

    /// Cells in another state: all of those in the brick itself are counted in the index.
    fn states(&self, noise: &mut Noise) -> Damaged {
        let place = self.some_payload(noise);
        let mut payload = self.anatomy.payload(&self.bytes, place.0, place.1);
        let side = self.anatomy.edge + 2;
        let at = noise.below(side.pow(3));
        let inside = [at % side, at / side % side, at / side / side];
        let inside = inside.iter().all(|i| (1..side - 1).contains(i));
        let old = payload.states[at];
        while payload.states[at] == old {
            payload.states[at] = *noise.pick(&[0, 1, 2, 3, 4, 5, 7, 8, 9, 16, 255]);
        }
        let new = payload.states[at];
        let valid = [0, 1, 3, 5, 7, 8].contains(&new);
        let counted = inside && (new & 3 != old & 3 || (new == 8) != (old == 8));
        let moved = (new == 8) != (old == 8);
        let found = !valid || counted || moved;
        let expected = if found { Expected::Found } else { Expected::Sound };
        Damaged { what: "states".into(), bytes: self.with_payload(place, &payload), expected }
    }

    /// Other values in existing cells; those beyond the brick's range must be found.
    fn values(&self, noise: &mut Noise) -> Damaged {
        let place = self.some_payload(noise);
        let mut payload = self.anatomy.payload(&self.bytes, place.0, place.1);
        let cells = payload.states.len();
        let range = self.anatomy.field_numbers(place.0, place.1);
        let limit = |name: &str| {
            let number = range.iter().find(|number| number.name == name).unwrap();
            f32::from_bits(word(&self.bytes, number.at, 4) as u32)
        };
        let (least, most) = (limit("own min"), limit("own max"));
        let mut at = noise.below(cells);
        while payload.states[at] & 1 == 0 {
            at = (at + 1) % cells;
        }
        let value = *noise.pick(&[
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::MAX,
            0.0,
            -1.0,
            least,
            most,
        ]);
        payload.set(at, value);
        let inside = least <= value && value <= most;
        let expected = if inside { Expected::Sound } else { Expected::Found };
        Damaged { what: "values".into(), bytes: self.with_payload(place, &payload), expected }
    }

    /// Payloads that are too short, too long, vast, or no compressed bytes at all.
    fn payload_shape(&self, noise: &mut Noise) -> Damaged {
        let place = self.some_payload(noise);
        let raw = self.anatomy.payload(&self.bytes, place.0, place.1).parts();
        let mut parts = raw.each_ref().map(|raw| compress(raw));
        let part = noise.below(PARTS);
        let raw = &raw[part][..];
        parts[part] = match noise.below(6) {
            0 => compress(&raw[..noise.below(raw.len())]),
            1 => compress(&[raw, &raw[..1 + noise.below(raw.len() - 1)]].concat()),
            2 => compress(&vec![1; 64 << 20]),
            3 => vec![0x5a; 1 + noise.below(4000)],
            4 => compress(raw)[..4].to_vec(),
            _ => [compress(raw), compress(raw)].concat(),
        };
        let parts = parts.each_ref().map(Vec::as_slice);
        let bytes = self.anatomy.with_payload(&self.bytes, place, (parts, [1.0; PARTS - 1]));
        Damaged { what: "payload's shape".into(), bytes, expected: Expected::Found }
    }

    fn spliced_payload(&self, noise: &mut Noise, other: &Self) -> Damaged {
        let donor = if noise.below(2) == 0 { self } else { other };
        let (node, field) = donor.some_payload(noise);
        let mut parts = donor.anatomy.stored(&donor.bytes, node, field);
        let part = noise.below(PARTS + 1);
        let damaged;
        if part < PARTS && !parts[part].is_empty() {
            damaged = noise.damage(parts[part]);
            parts[part] = &damaged;
        }
        let place = self.some_payload(noise);
        let bytes = self.anatomy.with_payload(&self.bytes, place, (parts, [1.0; PARTS - 1]));
        Damaged { what: "payload spliced".into(), bytes, expected: Expected::Sound }
    }

    /// Levels left out, doubled or swapped.
    fn level_table(&self, noise: &mut Noise) -> Damaged {
        const ENTRY: usize = 48;
        let table = &self.bytes[self.anatomy.level_table.clone()];
        let mut levels: Vec<&[u8]> = table[4..].chunks(ENTRY).collect();
        let at = noise.below(levels.len());
        match noise.below(4) {
            0 => drop(levels.remove(at)),
            1 => levels.insert(at, levels[at]),
            2 => levels.truncate(at),
            _ => levels.extend([levels[at]; 80]),
        }
        let count = (levels.len() as u32).to_le_bytes();
        let table = [&count[..], &levels.concat()].concat();
        let bytes = self.anatomy.with_level_table(&self.bytes, &table);
        Damaged { what: "level table".into(), bytes, expected: Expected::Found }
    }

    /// Bits flipped anywhere in header or index, all checksums repaired.
    fn sealed_noise(&self, noise: &mut Noise) -> Damaged {
        let mut bytes = self.bytes.clone();
        for _ in 0..=noise.below(8) {
            let at = match noise.below(3) {
                0 => 24 + noise.below(self.anatomy.header_bytes - 24),
                _ => self.anatomy.index + noise.below(self.anatomy.pages * PAGE),
            };
            bytes[at] ^= 1 << noise.below(8);
        }
        self.anatomy.seal(&mut bytes);
        Damaged { what: "bits of header and index".into(), bytes, expected: Expected::Sound }
    }
}

/// Another number of that kind: near, far, a limit, or no number.
fn another(kind: Kind, old: u64, noise: &mut Noise) -> u64 {
    let float = |value: f64| match kind {
        Kind::F32 => u64::from((value as f32).to_bits()),
        _ => value.to_bits(),
    };
    match (noise.below(6), kind) {
        (0, _) => noise.next() >> noise.below(64),
        (1, _) => old ^ 1 << noise.below(8 * kind.bytes()),
        (_, Kind::F32 | Kind::F64) => float(*noise.pick(&[
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            0.0,
            -0.0,
            1.0,
            -1e30,
            1e-30,
            3e38,
            1e300,
            -1e-310,
        ])),
        (2, _) => old.wrapping_add(1),
        (3, _) => old.wrapping_sub(1),
        (4, _) => *noise.pick(&[0, 1, 2, 7, 255, 1 << 31, u64::MAX, 1 << 63, u64::MAX >> 1]),
        _ => old.wrapping_mul(2),
    }
}
