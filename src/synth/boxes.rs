//! Arithmetic on boxes of cells that makes grids disjoint and aligned.

use crate::space::IndexBox;

/// The box that takes the same space in cells `factor` times as small.
pub(super) fn refined(cells: &IndexBox, factor: i128) -> IndexBox {
    IndexBox { lo: cells.lo.map(|i| i * factor), hi: cells.hi.map(|i| i * factor) }
}

/// The smallest box around `cells` that starts and ends on multiples of `factor`.
pub(super) fn aligned(cells: &IndexBox, factor: i128) -> IndexBox {
    IndexBox {
        lo: cells.lo.map(|i| i.div_euclid(factor) * factor),
        hi: cells.hi.map(|i| -((-i).div_euclid(factor)) * factor),
    }
}

/// Adds to `disjoint` what of `candidate` none of its boxes hold yet, as few disjoint boxes.
pub(super) fn add_remainder(disjoint: &mut Vec<IndexBox>, candidate: IndexBox) {
    let mut pieces = vec![candidate];
    for taken in disjoint.iter() {
        pieces = pieces.iter().flat_map(|piece| without(piece, taken)).collect();
    }
    disjoint.extend(pieces.into_iter().filter(|piece| !piece.is_empty()));
}

/// `cells` without `hole`, as at most six disjoint boxes.
fn without(cells: &IndexBox, hole: &IndexBox) -> Vec<IndexBox> {
    let hole = cells.intersection(hole);
    if hole.is_empty() {
        return vec![*cells];
    }
    let mut rest = *cells;
    let mut pieces = Vec::new();
    for axis in (0..3).rev() {
        let (mut below, mut above) = (rest, rest);
        below.hi[axis] = hole.lo[axis];
        above.lo[axis] = hole.hi[axis];
        pieces.extend([below, above].into_iter().filter(|piece| !piece.is_empty()));
        (rest.lo[axis], rest.hi[axis]) = (hole.lo[axis], hole.hi[axis]);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_remainder_covers_the_candidate_once() {
        let first = IndexBox::at([4, 4, 4], [4, 6, 8]);
        let second = IndexBox::at([0, 0, 0], [12, 12, 12]);
        let mut boxes = vec![first];
        add_remainder(&mut boxes, second);
        let cells: i128 = boxes.iter().map(|b| b.size().iter().product::<i128>()).sum();
        assert_eq!(cells, 12 * 12 * 12);
        for (i, a) in boxes.iter().enumerate() {
            assert!(boxes[i + 1..].iter().all(|b| a.intersection(b).is_empty()));
        }
    }

    #[test]
    fn alignment_rounds_outward_below_zero_too() {
        let cells = IndexBox { lo: [-3, 1, 4], hi: [-1, 3, 8] };
        assert_eq!(aligned(&cells, 4), IndexBox { lo: [-4, 0, 4], hi: [0, 4, 8] });
    }
}
