//! What a brick hands up to its parent: averages over its 2×2×2 cells, passed from one level to
//! the next through a file.

use super::spool::{Spool, Stream};
use crate::Result;
use crate::cache::{BrickShape, state};

/// One field's averages over an octant of the parent: (B/2)³ cells, x fastest.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Averages {
    /// 0 where nothing lies beneath, else EXISTS | REFINED and, where all is dropped, VOID.
    pub(super) states: Vec<u8>,
    /// Volume-weighted averages of the leaf cells beneath.
    pub(super) values: Vec<f64>,
    /// Part of each cell's volume that the average stands for; empty: all of every cell that
    /// exists.
    pub(super) weights: Vec<f64>,
}

/// A brick's averages for its parent.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Upward {
    /// The brick's coordinates at its own level.
    pub(super) coordinates: [u128; 3],
    /// Per field.
    pub(super) fields: Vec<Averages>,
}

impl Upward {
    /// The octant of the parent that the brick is.
    pub(super) fn octant(&self) -> u8 {
        octant(&self.coordinates)
    }

    /// The parent's coordinates.
    pub(super) fn parent(&self) -> [u128; 3] {
        self.coordinates.map(|c| c >> 1)
    }

    /// What [`UpwardLevel::push`] takes.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let numbers = self.fields.iter().map(|field| field.values.len() + field.weights.len());
        let mut bytes = Vec::with_capacity(48 + 9 * numbers.sum::<usize>());
        self.coordinates.iter().for_each(|c| bytes.extend_from_slice(&c.to_le_bytes()));
        for field in &self.fields {
            bytes.push(u8::from(!field.weights.is_empty()));
            bytes.extend_from_slice(&field.states);
            for numbers in [&field.values, &field.weights] {
                let start = bytes.len();
                bytes.resize(start + 8 * numbers.len(), 0);
                for (word, number) in bytes[start..].chunks_exact_mut(8).zip(numbers) {
                    word.copy_from_slice(&number.to_le_bytes());
                }
            }
        }
        bytes
    }
}

/// The octant of its parent that the brick at `coordinates` is.
pub(super) fn octant(coordinates: &[u128; 3]) -> u8 {
    let bit = |a: usize| u8::from(coordinates[a] & 1 == 1) << a;
    bit(0) | bit(1) | bit(2)
}

/// The averages of one level, in Morton order, on disk.
pub(super) struct UpwardLevel {
    spool: Spool,
    shape: BrickShape,
    fields: usize,
}

impl UpwardLevel {
    /// A level's file, of averages over bricks of `shape` with `fields` fields each.
    pub(super) fn new(spool: Spool, shape: BrickShape, fields: usize) -> Self {
        Self { spool, shape, fields }
    }

    /// Appends what [`Upward::to_bytes`] has made.
    pub(super) fn push(&mut self, upward: &[u8]) -> Result<()> {
        self.spool.append(upward).map(|_| ())
    }

    /// Makes everything pushed so far readable.
    ///
    /// # Errors
    /// Temporary data that cannot be written.
    pub(super) fn flush(&mut self) -> Result<()> {
        self.spool.flush()
    }

    /// A reader at the first brick of those pushed, which must have been flushed.
    ///
    /// # Errors
    /// Temporary data that cannot be read.
    pub(super) fn reader(&self) -> Result<UpwardReader<'_>> {
        let stream = self.spool.stream(0, self.spool.len(), 256 << 10);
        let cells = self.shape.cells() / 8;
        let mut reader = UpwardReader { stream, cells, fields: self.fields, next: None };
        reader.advance()?;
        Ok(reader)
    }
}

/// Reads a level's averages in order.
pub(super) struct UpwardReader<'s> {
    stream: Stream<'s>,
    cells: usize,
    fields: usize,
    next: Option<Upward>,
}

impl UpwardReader<'_> {
    /// The next brick's averages without taking them.
    pub(super) fn peek(&self) -> Option<&Upward> {
        self.next.as_ref()
    }

    /// Takes the next brick's averages.
    pub(super) fn next(&mut self) -> Result<Option<Upward>> {
        let taken = self.next.take();
        self.advance()?;
        Ok(taken)
    }

    fn advance(&mut self) -> Result<()> {
        let mut coordinates = [0; 3];
        let mut bytes = [0; 16];
        for coordinate in &mut coordinates {
            if !self.stream.read(&mut bytes)? {
                return Ok(());
            }
            *coordinate = u128::from_le_bytes(bytes);
        }
        let fields = (0..self.fields).map(|_| self.averages()).collect::<Result<_>>()?;
        self.next = Some(Upward { coordinates, fields });
        Ok(())
    }

    fn averages(&mut self) -> Result<Averages> {
        let mut weighted = [0];
        self.stream.read(&mut weighted)?;
        let mut states = vec![0; self.cells];
        self.stream.read(&mut states)?;
        let values = self.numbers(self.cells)?;
        let weights = self.numbers(if weighted[0] == 1 { self.cells } else { 0 })?;
        Ok(Averages { states, values, weights })
    }

    fn numbers(&mut self, count: usize) -> Result<Vec<f64>> {
        let mut bytes = vec![0; 8 * count];
        self.stream.read(&mut bytes)?;
        let words = bytes.chunks_exact(8);
        Ok(words.map(|word| word.try_into().map_or(0.0, f64::from_le_bytes)).collect())
    }
}

/// Averages over the 2×2×2 cells of a brick with `states`, `values` and `weights` (B³ cells
/// each; `weights` empty: 1 wherever a cell exists and is not dropped). `Err` with the first
/// cell (brick indices) of a parent's cell that exists only in part.
pub(super) fn average(
    edge: usize,
    states: &[u8],
    values: &[f64],
    weights: &[f64],
) -> std::result::Result<Averages, [usize; 3]> {
    let half = edge / 2;
    let mut averages = Averages {
        states: vec![0; half.pow(3)],
        values: vec![0.0; half.pow(3)],
        weights: Vec::new(),
    };
    let mut fractions = vec![1.0; half.pow(3)];
    for row in 0..half * half {
        let (y, z) = (2 * (row % half), 2 * (row / half));
        let starts = [(y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1)];
        let starts = starts.map(|(y, z)| (z * edge + y) * edge);
        let parents = row * half..(row + 1) * half;
        let of_row = &mut averages.values[parents.clone()];
        if weights.is_empty() && average_row(starts, edge, states, values, of_row) {
            averages.states[parents].fill(state::EXISTS | state::REFINED);
            continue;
        }
        for (x, parent) in (0..edge).step_by(2).zip(parents) {
            let octet: [usize; 8] = std::array::from_fn(|o| starts[o >> 1] + x + (o & 1));
            let (bits, value, weight) =
                average_octet(&octet, states, values, weights).ok_or([x, y, z])?;
            averages.states[parent] = bits;
            averages.values[parent] = value;
            fractions[parent] = weight;
        }
    }
    if fractions.iter().zip(&averages.states).any(|(&w, &bits)| bits != 0 && w != 1.0) {
        averages.weights = fractions;
    }
    Ok(averages)
}

/// Averages over a row of the parent's cells, from the four rows that begin at `starts`: as
/// [`average_octet`] does, where all cells exist and none is dropped or NaN; false elsewhere.
fn average_row(
    starts: [usize; 4],
    edge: usize,
    states: &[u8],
    values: &[f64],
    averages: &mut [f64],
) -> bool {
    let is_plain =
        |all: bool, bits: &u8| all & (bits & (state::EXISTS | state::VOID) == state::EXISTS);
    let states = starts.map(|start| &states[start..start + edge]);
    if !states.iter().all(|row| row.iter().fold(true, is_plain)) {
        return false;
    }
    let [a, b, c, d] = starts.map(|start| values[start..start + edge].as_chunks::<2>().0);
    let octets = a.iter().zip(b).zip(c.iter().zip(d));
    for (average, ((a, b), (c, d))) in averages.iter_mut().zip(octets) {
        let sum = 0.0 + a[0] + a[1] + b[0] + b[1] + c[0] + c[1] + d[0] + d[1];
        *average = sum / 8.0;
    }
    averages.iter().fold(true, |all, average| all & !average.is_nan())
}

/// State, average and weight of one parent's cell; `None` where its cells exist only in part.
fn average_octet(
    octet: &[usize; 8],
    states: &[u8],
    values: &[f64],
    weights: &[f64],
) -> Option<(u8, f64, f64)> {
    let (mut existing, mut inside, mut dropped, mut total, mut sum) = (0, 0, 0, 0.0, 0.0);
    for &cell in octet {
        let bits = states[cell];
        inside += u32::from(bits != state::OUTSIDE);
        if bits & state::EXISTS == 0 {
            continue;
        }
        existing += 1;
        dropped += u32::from(bits & state::VOID != 0);
        let present = bits & state::VOID == 0 && !values[cell].is_nan();
        let weight = if present { weights.get(cell).copied().unwrap_or(1.0) } else { 0.0 };
        if weight > 0.0 {
            total += weight;
            sum += weight * values[cell];
        }
    }
    if existing == 0 {
        return Some((0, 0.0, 1.0));
    }
    if existing < inside {
        return None;
    }
    let parent = state::EXISTS | state::REFINED;
    if dropped == existing {
        return Some((parent | state::VOID, 0.0, 0.0));
    }
    let value = if total > 0.0 { sum / total } else { f64::NAN };
    Some((parent, value, total / 8.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_of_rows_are_those_of_each_octet() {
        const EDGE: usize = 8;
        let values = |seed: usize| -> Vec<f64> {
            let value = |at: usize| ((at * 7 + seed) as f64 * 0.37).sin() * 1e3;
            (0..EDGE.pow(3)).map(value).collect()
        };
        let (plain, refined) = (state::EXISTS, state::EXISTS | state::REFINED);
        for seed in 0..6 {
            let mut states = vec![if seed % 2 == 0 { plain } else { refined }; EDGE.pow(3)];
            let mut values = values(seed);
            for at in (seed..EDGE.pow(3)).step_by(89).skip(2) {
                match seed {
                    2 => values[at] = f64::NAN,
                    3 => states[at] |= state::VOID,
                    4 => states[at] = state::OUTSIDE,
                    _ => {}
                }
            }
            let averages = average(EDGE, &states, &values, &[]).unwrap();
            let mut weights = Vec::new();
            for at in 0..(EDGE / 2).pow(3) {
                let first = [at % 4, at / 4 % 4, at / 16].map(|c| 2 * c);
                let octet = std::array::from_fn(|o| {
                    let [x, y, z] =
                        [first[0] + (o & 1), first[1] + (o >> 1 & 1), first[2] + (o >> 2)];
                    (z * EDGE + y) * EDGE + x
                });
                let (bits, value, weight) = average_octet(&octet, &states, &values, &[]).unwrap();
                assert_eq!((averages.states[at], averages.values[at]), (bits, value), "{seed}");
                weights.push(weight);
            }
            let even = weights.iter().all(|&weight| weight == 1.0);
            assert_eq!(averages.weights, if even { Vec::new() } else { weights }, "{seed}");
        }
        let mut states = vec![plain; EDGE.pow(3)];
        states[EDGE + 3] = 0;
        assert_eq!(average(EDGE, &states, &values(1), &[]), Err([2, 0, 0]));
    }
}
