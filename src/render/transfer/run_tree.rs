//! What runs of neighbours do together, found in the logarithm of their number.

/// What is known of neighbours, and so of runs of them; of none the default.
pub(super) trait Run: Copy + Default {
    /// What is known of this run and of the next one together.
    fn and(self, other: Self) -> Self;
}

/// What is known of neighbours in a row, and of pairs of them, of pairs of pairs and so on: node n
/// joins nodes 2n and 2n + 1, and leaves are the last half.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct RunTree<R> {
    nodes: Vec<R>,
}

impl<R: Run> RunTree<R> {
    /// A tree over `leaves`.
    pub(super) fn new(leaves: impl ExactSizeIterator<Item = R>) -> Self {
        let count = leaves.len();
        let mut nodes = vec![R::default(); count];
        nodes.extend(leaves);
        for node in (1..count).rev() {
            nodes[node] = nodes[2 * node].and(nodes[2 * node + 1]);
        }
        Self { nodes }
    }

    /// All from `first` up to, not including, `end` together.
    pub(super) fn over(&self, first: usize, end: usize) -> R {
        let count = self.nodes.len() / 2;
        let (mut first, mut end) = (first + count, end + count);
        let mut run = R::default();
        while first < end {
            if first % 2 == 1 {
                run = run.and(self.nodes[first]);
                first += 1;
            }
            if end % 2 == 1 {
                end -= 1;
                run = run.and(self.nodes[end]);
            }
            (first, end) = (first / 2, end / 2);
        }
        run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::transfer::change::Change;
    use crate::render::transfer::span::Span;

    #[test]
    fn runs_are_what_their_members_are_together() {
        let leaf = |n: usize| {
            let change =
                |m: usize| Change { emission: (n * m % 7) as f64, extinction: (n * m % 5) as f64 };
            Span { slope: change(3), variation: change(2), jumps: change(4), most: change(11) }
        };
        for count in [1, 2, 3, 7, 258] {
            let tree = RunTree::new((0..count).map(leaf));
            for first in 0..=count {
                for end in first..=count.min(first + 40) {
                    let plain = (first..end).map(leaf).fold(Span::default(), Span::and);
                    assert_eq!(tree.over(first, end), plain, "{first} {end} of {count}");
                }
            }
        }
    }
}
