//! Tests of whole tilesets.
