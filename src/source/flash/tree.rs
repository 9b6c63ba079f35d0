//! The tree of blocks, from `gid`: exact at any depth, where the edges of bounding boxes no longer
//! tell one cell from the next.

use std::path::Path;

use super::boxes::Boxes;
use super::header::Header;
use crate::source::GridRecord;
use crate::source::hdf5::File;
use crate::space::MAX_OCTREE_LEVEL;
use crate::{Error, Result};

/// Blocks whose rows are read at a time.
const BATCH: u64 = 4096;
/// Numbers in a row of `gid`: six face neighbours, the parent, eight children (x fastest).
const ROW: usize = 15;
/// Where in a row the parent stands, and the children after it.
const PARENT: usize = 6;

/// The node type of leaves; of parents of leaves, and of the blocks above those, it is larger.
const LEAF: i64 = 1;

/// Whether a block of node type `kind` may have so many `children`.
fn check_kind(kind: i64, children: usize) -> Result<(), String> {
    let expected = if kind == LEAF { 0 } else { 8 };
    if kind >= LEAF && children == expected {
        return Ok(());
    }
    Err(format!(
        "its node type is {kind}, but it has {children} children by gid: leaves (1) have none, parents \
         (2 and above) 8"
    ))
}

/// A block's parent and which of its children it is; about a hundredth of what the file holds of
/// a block.
#[derive(Debug, Clone, Copy)]
struct Node {
    /// Number from 0; none for a block of refine level 1.
    parent: Option<u32>,
    /// Bit by axis, x the lowest: whether it is the parent's upper half there.
    octant: u8,
    is_leaf: bool,
}

/// All blocks.
pub(super) struct Tree {
    place: String,
    nodes: Vec<Node>,
    /// Refine level 1: blocks and where each lies, in such blocks.
    roots: Vec<(u32, [u32; 3])>,
    deepest: u32,
}

impl Tree {
    /// Reads the tree, and checks every block's refine level and bounding box against it.
    ///
    /// # Errors
    /// Missing or damaged lists, and such as contradict each other, naming the block.
    pub(super) fn read(file: &File, path: &Path, header: &Header) -> Result<Self> {
        let mut tree = Self {
            place: path.display().to_string(),
            nodes: Vec::new(),
            roots: Vec::new(),
            deepest: 0,
        };
        tree.check_lists(file, header.blocks)?;
        tree.link(file, header.blocks)?;
        let mut boxes = Boxes::new(file, path, header)?;
        tree.find_roots(&mut boxes)?;
        tree.check_blocks(file, header, &mut boxes)?;
        Ok(tree)
    }

    /// The deepest level of a leaf, 0 = refine level 1.
    pub(super) fn deepest(&self) -> u32 {
        self.deepest
    }

    /// Hands every leaf block to `visit`.
    ///
    /// # Errors
    /// What `visit` returns.
    pub(super) fn for_each_leaf(
        &self,
        header: &Header,
        visit: &mut dyn FnMut(GridRecord) -> Result<()>,
    ) -> Result<()> {
        for number in (0..self.nodes.len()).filter(|&number| self.nodes[number].is_leaf) {
            let (level, at) = self.locate(number)?;
            visit(GridRecord {
                id: number as u64 + 1,
                level,
                lo: std::array::from_fn(|a| at[a] * i128::from(header.block_size[a])),
                size: header.block_size,
                locator: number as u64,
            })?;
        }
        Ok(())
    }

    fn check_lists(&self, file: &File, blocks: u64) -> Result<()> {
        if blocks >= u64::from(u32::MAX) {
            let reason = format!("{blocks} blocks: fewer than 2^32 - 1 are supported");
            return Err(Error::not_supported(&self.place, reason));
        }
        for (name, shape) in [("/gid", vec![blocks, ROW as u64]), ("/refine level", vec![blocks])] {
            let found = file.dataset(name)?.shape;
            if found != shape {
                let reason = format!("its shape {found:?} should be {shape:?}");
                return Err(Error::invalid(format!("{}: {name}", self.place), reason));
            }
        }
        Ok(())
    }

    /// Reads who is whose parent: children name their parents, parents their children, and both
    /// must agree.
    fn link(&mut self, file: &File, blocks: u64) -> Result<()> {
        // A block whose parent does not name it keeps an octant that none has.
        let mut octants = vec![u8::MAX; blocks as usize];
        let mut claimed_by = vec![u32::MAX; blocks as usize];
        self.nodes.reserve_exact(blocks as usize);
        let (mut first, mut rows, mut types) = (0, Vec::new(), Vec::new());
        while first < blocks {
            let count = BATCH.min(blocks - first);
            rows.resize(ROW * count as usize, 0);
            types.resize(count as usize, 0);
            file.read_i64("/gid", &[first, 0], &[count, ROW as u64], &mut rows)?;
            file.read_i64("/node type", &[first], &[count], &mut types)?;
            for ((number, row), &kind) in (first as usize..).zip(rows.chunks_exact(ROW)).zip(&types)
            {
                let parent = self.number(number, row[PARENT], blocks)?;
                let mut children = 0;
                for (octant, &child) in (0..).zip(&row[PARENT + 1..]) {
                    let Some(child) = self.number(number, child, blocks)? else { continue };
                    let claimed = &mut claimed_by[child as usize];
                    if *claimed != u32::MAX {
                        let reason = format!("is a child of block {} and again", *claimed + 1);
                        return Err(
                            self.fault(child as usize, format!("{reason} of block {}", number + 1))
                        );
                    }
                    (*claimed, octants[child as usize]) = (number as u32, octant);
                    children += 1;
                }
                check_kind(kind, children).map_err(|reason| self.fault(number, reason))?;
                self.nodes.push(Node { parent, octant: 0, is_leaf: kind == LEAF });
            }
            first += count;
        }
        for (number, (octant, claimed)) in octants.into_iter().zip(claimed_by).enumerate() {
            let Some(parent) = self.nodes[number].parent else { continue };
            if claimed != parent {
                let reason = format!("its parent {} does not name it as a child", parent + 1);
                return Err(self.fault(number, reason));
            }
            self.nodes[number].octant = octant;
        }
        Ok(())
    }

    /// The number from 0 of a block that `gid` names; 0 and below name none.
    fn number(&self, of: usize, gid: i64, blocks: u64) -> Result<Option<u32>> {
        match u64::try_from(gid) {
            Ok(gid) if gid > blocks => {
                Err(self.fault(of, format!("refers to block {gid} of {blocks}: truncated file?")))
            }
            Ok(gid) if gid > 0 => Ok(Some((gid - 1) as u32)),
            _ => Ok(None),
        }
    }

    /// Places the blocks without a parent by their bounding boxes.
    fn find_roots(&mut self, boxes: &mut Boxes<'_>) -> Result<()> {
        let count = self.nodes.iter().filter(|node| node.parent.is_none()).count();
        self.roots.reserve_exact(count);
        for number in 0..self.nodes.len() {
            if self.nodes[number].parent.is_none() {
                let at = boxes.root_place(number).map_err(|e| e.into_error(self, number))?;
                self.roots.push((number as u32, at));
            }
        }
        Ok(())
    }

    /// Level (0 = refine level 1) and place of a block, in blocks of its level: by the way up to
    /// its root and down again.
    fn locate(&self, number: usize) -> Result<(u32, [i128; 3])> {
        let (mut at, mut offset, mut level) = (number, [0i128; 3], 0);
        while let Some(parent) = self.nodes[at].parent {
            for (axis, offset) in offset.iter_mut().enumerate() {
                *offset |= i128::from(self.nodes[at].octant >> axis & 1) << level;
            }
            level += 1;
            at = parent as usize;
            if level > MAX_OCTREE_LEVEL {
                let reason = format!(
                    "lies at more than {MAX_OCTREE_LEVEL} levels below the root grid, or gid runs \
                     in circles: not supported"
                );
                return Err(self.fault(number, reason));
            }
        }
        let root = self.roots.binary_search_by_key(&(at as u32), |root| root.0);
        let root = root.map_err(|_| self.fault(number, "descends from no root block"))?;
        let root = self.roots[root].1;
        Ok((level, std::array::from_fn(|a| (i128::from(root[a]) << level) + offset[a])))
    }

    /// Checks levels and boxes against the tree.
    fn check_blocks(&mut self, file: &File, header: &Header, boxes: &mut Boxes<'_>) -> Result<()> {
        let (mut first, mut levels) = (0, Vec::new());
        while first < header.blocks {
            let count = BATCH.min(header.blocks - first);
            levels.resize(count as usize, 0);
            file.read_i64("/refine level", &[first], &[count], &mut levels)?;
            for (number, &stated) in (first as usize..).zip(&levels) {
                let (level, at) = self.locate(number)?;
                if stated != i64::from(level) + 1 {
                    let reason =
                        format!("its refine level {stated} should be {} by gid", level + 1);
                    return Err(self.fault(number, reason));
                }
                boxes.check(number, level, at).map_err(|e| e.into_error(self, number))?;
                if self.nodes[number].is_leaf {
                    self.deepest = self.deepest.max(level);
                }
            }
            first += count;
        }
        Ok(())
    }

    /// What is wrong with block `number` (from 0).
    pub(super) fn fault(&self, number: usize, reason: impl Into<String>) -> Error {
        Error::invalid(format!("{}: block {}", self.place, number + 1), reason)
    }
}
