//! The same reads through every library.
