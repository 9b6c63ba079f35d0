//! Loading bricks for the pool: reading, decoding, and mapping to the transfer function's x.

use super::scaled::ScaledBrick;
use super::steepness::Surveyor;
use crate::cache::{
    BrickEntry, BrickPlace, Cache, Decoder, FieldRecord, NodeRecord, PARTS, Precision, RawBrick,
};
use crate::paging::{FORMS, Loaded, Loader, Request};
use crate::render::transfer::pieces::PieceList;
use crate::render::transfer::shading::Shading;
use crate::{Error, Result};

const _: () = assert!(PARTS <= FORMS, "each number of digits is a form of its own");

/// A brick as the index describes it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BrickRequest {
    /// The node's index.
    pub node: u64,
    /// Where it lies.
    pub place: BrickPlace,
    /// What the index says of the node.
    pub record: NodeRecord,
    /// What the index says of the field in it.
    pub field: FieldRecord,
    /// The last tile of the picture that it may be seen in.
    pub last_tile: u64,
    /// How many digits of its values are read.
    pub precision: Precision,
}

impl Request for BrickRequest {
    fn brick(&self) -> u64 {
        self.node
    }

    fn form(&self) -> usize {
        self.precision.last_part()
    }

    fn level(&self) -> usize {
        self.place.tree_level
    }

    fn last_turn(&self) -> u64 {
        self.last_tile
    }
}

/// Loads bricks of one field under one mapping.
pub(crate) struct BrickLoader<'r> {
    /// Where they are read from.
    pub cache: &'r Cache,
    /// The field and its mapping.
    pub shading: &'r Shading,
    /// The transfer function by which rays keep accounts, if they do.
    pub(crate) accounts: Option<&'r PieceList>,
}

/// One thread's buffers for [`BrickLoader`].
pub(crate) struct BrickScratch {
    decoder: Decoder,
    raw: RawBrick,
    surveyor: Surveyor,
}

impl BrickScratch {
    /// Empty buffers.
    ///
    /// # Errors
    /// A codec that cannot be set up.
    pub(crate) fn new(cache: &Cache) -> Result<Self> {
        let decoder = Decoder::new()
            .map_err(|source| Error::io(cache.path(), "cannot set up decompression", source))?;
        Ok(Self { decoder, raw: RawBrick::default(), surveyor: Surveyor::default() })
    }

    /// Most bytes that one thread's buffers grow to.
    pub(crate) fn bytes(cache: &Cache) -> u64 {
        let header = cache.header();
        let blocks = usize::from(header.max_parent_blocks) + 1;
        cache.decoder_bytes()
            + header.shape.payload_bytes(blocks) as u64
            + Surveyor::bytes(header.shape.edge())
    }
}

impl Loader for BrickLoader<'_> {
    type Request = BrickRequest;
    type Brick = ScaledBrick;
    type Scratch = BrickScratch;

    fn new_brick(&self) -> ScaledBrick {
        ScaledBrick::new()
    }

    fn announce(&self, request: &BrickRequest) {
        self.cache.announce(&request.field, request.precision);
    }

    fn load(
        &self,
        request: &BrickRequest,
        scratch: &mut BrickScratch,
        brick: &mut ScaledBrick,
    ) -> Result<Loaded> {
        let BrickRequest { node, place, record, field, precision, .. } = request;
        let BrickScratch { decoder, raw, surveyor } = scratch;
        let volume = self.shading.field;
        let entry =
            BrickEntry { node: *node, field: volume, node_record: record, field_record: field };
        let reading = self.cache.read_brick(&entry, *precision, decoder, raw)?;
        self.cache.check_place(*node, volume, place, raw)?;
        let header = self.cache.header();
        let map = |stored: &[f32], x: &mut [f64]| self.shading.map_all(stored, x);
        brick.prepare(raw, place, header.shape, map, self.shading.interpolation)?;
        if let Some(pieces) = self.accounts {
            brick.survey(pieces, &self.shading.distance(record, field, *precision), surveyor);
        }
        let blocks = usize::from(field.parent_blocks) + 1;
        Ok(Loaded {
            read: field.stored_bytes(*precision),
            decompressed: field.decompressed(header.shape.cells_in_blocks(blocks), *precision),
            reading,
        })
    }
}
