//! Tests of whole layers.
