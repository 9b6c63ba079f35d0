//! Damage made by hand: caches that contradict themselves though every checksum is right.

// Each test program uses only a part of it.
#![allow(dead_code)]

pub(crate) mod allocator;
pub(crate) mod anatomy;
pub(crate) mod examine;
pub(crate) mod mutation;
pub(crate) mod noise;
pub(crate) mod payload;
