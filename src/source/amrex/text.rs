//! Boxes and number lists as AMReX prints them.

use std::path::{Component, Path};

use crate::space::IndexBox;

/// A box of indices with the centring of its data along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PrintedBox {
    /// The indices.
    pub(super) cells: IndexBox,
    /// Along which axes data stand on cell faces.
    pub(super) nodal: [bool; 3],
}

impl PrintedBox {
    /// The box of `((0,0,0) (7,7,7) (0,0,0))`: first and last index, and centring.
    pub(super) fn parse(text: &str) -> Option<Self> {
        Self::from_numbers(&numbers(text)?)
    }

    /// The box of the nine numbers of a printed box.
    pub(super) fn from_numbers(numbers: &[i64]) -> Option<Self> {
        let &[x0, y0, z0, x1, y1, z1, x, y, z] = numbers else { return None };
        let cells = IndexBox {
            lo: [x0, y0, z0].map(i128::from),
            hi: [x1, y1, z1].map(|i| i128::from(i) + 1),
        };
        Some(Self { cells, nodal: [x, y, z].map(|centring| centring != 0) })
    }

    /// The cells along each axis, where there are any and data stand at their centres.
    ///
    /// # Errors
    /// The reason, where not.
    pub(super) fn size(&self) -> Result<[u32; 3], String> {
        if self.nodal.contains(&true) {
            return Err("its data stand on cell faces or corners (a nodal box): only \
                        cell-centred data can be read"
                .to_owned());
        }
        let size = self.cells.size().map(|n| u32::try_from(n).ok().filter(|&n| n > 0));
        match size {
            [Some(x), Some(y), Some(z)] => Ok([x, y, z]),
            _ => Err(format!(
                "its indices {:?} to {:?} make no box",
                self.cells.lo,
                self.cells.hi.map(|i| i - 1)
            )),
        }
    }
}

/// The whole numbers of a text of numbers, brackets, commas and blanks.
pub(super) fn numbers(text: &str) -> Option<Vec<i64>> {
    let words = text.split(|c: char| c.is_whitespace() || "(),".contains(c));
    words.filter(|word| !word.is_empty()).map(|word| word.parse().ok()).collect()
}

/// Whether `path` leads to something inside the plotfile.
pub(super) fn stays_inside(path: &str) -> bool {
    let inside = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    !path.is_empty() && Path::new(path).components().all(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_end_with_the_last_index() {
        let printed = PrintedBox::parse("((-2,0,4) (5,0,7) (0,0,0))").unwrap();
        assert_eq!(printed.cells, IndexBox { lo: [-2, 0, 4], hi: [6, 1, 8] });
        assert_eq!(printed.size(), Ok([8, 1, 4]));
        let nodal = PrintedBox::parse("((0,0,0) (7,7,7) (1,0,0))").unwrap();
        assert!(nodal.size().unwrap_err().contains("nodal"));
        let empty = PrintedBox::parse("((0,0,0) (7,-1,7) (0,0,0))").unwrap();
        assert!(empty.size().unwrap_err().contains("make no box"));
        let vast = format!("((0,0,{}) (7,7,{}) (0,0,0))", i64::MIN, i64::MAX);
        assert!(PrintedBox::parse(&vast).unwrap().size().is_err());
        for text in ["((0,0) (7,7) (0,0))", "((0,0,0) (7,7,x) (0,0,0))", ""] {
            assert_eq!(PrintedBox::parse(text), None);
        }
    }

    #[test]
    fn names_that_lead_out_of_the_plotfile_are_found() {
        assert!(stays_inside("Level_0/Cell") && stays_inside("./Cell_D_00000"));
        for path in ["", "/etc/passwd", "../Header", "Level_0/../../x"] {
            assert!(!stays_inside(path), "{path}");
        }
    }
}
