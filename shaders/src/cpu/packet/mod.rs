//! The ray-caster for packets: neighbouring rays in the lanes of vector registers.
//!
//! Same pixels as [`raycast`](super::raycast), which defines them: each lane computes what the scalar code computes, in the same
//! order, so that the results are the same to the last bit. The code is generic over the instruction set and its number of lanes
//! (`fearless_simd`, which chooses one at run time). What is rare (gaps, holes, hidden objects, studies) is left to the scalar code,
//! lane by lane.

mod column;
mod frame;
mod grid_walk;
mod hits;
mod lanes;
mod mesh;
mod mesh_surface;
mod node_rays;
mod node_walk;
mod noise;
mod objects;
mod pages;
mod ray_packet;
mod shade;
mod sky;
mod stone;
mod tone;
mod trace;

pub(super) use frame::{CentreRay, CentreRows, cast_centres, finish_rows, render_rows, rows_around, sketch_rows};
pub(super) use tone::{count_radiances, develop_pixels};
