//! Tests of the Enzo reader on small made-up dumps.
