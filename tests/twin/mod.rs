//! A slow renderer that is right: it draws the same picture as the program, from the source's
//! grids, and shares no code with the program but the trait through which grids are read.
//!
//! Every cell lies in one hash table per level; positions are double-double (about 106 bits) over
//! the root grid's cells, set up from exact rationals; a ray is cut at every cell face it
//! crosses; in `linear` pictures the interpolant along the ray is worked out as a polynomial.
//! `reference` does the same in f64, from exactly reduced positions, fast enough for averages
//! over pixels.

// Each test program uses only a part of it.
#![allow(dead_code)]

pub(crate) mod camera;
pub(crate) mod cameras;
pub(crate) mod colormap;
pub(crate) mod dataset;
pub(crate) mod double_double;
pub(crate) mod exact;
pub(crate) mod flight;
pub(crate) mod interpolant;
pub(crate) mod march_cell;
pub(crate) mod march_linear;
pub(crate) mod memory;
pub(crate) mod picture;
pub(crate) mod polynomial;
pub(crate) mod reference;
pub(crate) mod scene;
pub(crate) mod scenes;
pub(crate) mod subject;
pub(crate) mod transfer;
pub(crate) mod walk;

/// Errors of the twin are for whoever reads a failed test: plain text.
pub(crate) type Result<T> = std::result::Result<T, String>;
