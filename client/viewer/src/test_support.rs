//! A minimal manifest, for tests of this crate and of the shells.

use insula_protocol::{Manifest, manifest::CityCounts};

/// A city of depth `depth` without a CRS: leaves of 64 m, columns of 1 m, origin at zero.
pub fn manifest(depth: u8) -> Manifest {
    let side_m = 64.0 * f64::from(1u32 << depth);
    Manifest {
        format_version: 1,
        name: "test".into(),
        title: "Test".into(),
        version: "0".into(),
        crs: None,
        origin: [0.0; 3],
        root_side_m: side_m,
        depth,
        node_cells: 64,
        cell_m: 1.0,
        bounds: [[0.0; 3], [side_m, side_m, 9.0]],
        ground_z_m: 0.0,
        focus: [[0.0; 2]; 2],
        has_terrain: false,
        generated_ground: false,
        location: None,
        generated_facades: false,
        heights: None,
        stones: Vec::new(),
        street_sets: false,
        counts: CityCounts::default(),
        attribution: Vec::new(),
        tile_version: 1,
        settings: String::new(),
    }
}
