//! Rendering of adaptive-mesh-refinement (AMR) simulations of any depth, within a memory limit.
//!
//! Data flow one way and a module knows only those before it (`docs/ARCHITECTURE.md`):
//! [`space`] → [`source`] → [`derive`](mod@derive) → [`cache`] → [`ingest`] → `paging` → [`scene`] →
//! [`render`] → [`image`]. The binary's commands stand in [`cli`]; [`synth`] writes test data in the layouts
//! of simulation codes.

mod allocator;
pub mod atomic_file;
pub mod cache;
pub mod cli;
pub mod derive;
pub mod error;
pub mod image;
pub mod ingest;
mod lanes;
mod leftovers;
mod log10;
mod paging;
mod polynomial;
mod regular_file;
pub mod render;
pub mod scene;
pub mod source;
pub mod space;
mod spelling;
mod sum;
pub mod synth;
mod text_file;

pub use error::{Error, Result};
