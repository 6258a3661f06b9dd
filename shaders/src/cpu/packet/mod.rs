//! The ray-caster for packets: neighbouring rays in the lanes of vector registers.
//!
//! Same pixels as [`raycast`](super::raycast), which defines them: each lane computes what the scalar code computes, in the same
//! order, so that the results are the same to the last bit. What needs no walk is the scalar code itself ([`lanes`](crate::lanes)). The
//! code is generic over the instruction set and its number of lanes (`fearless_simd`, which chooses one at run time). What is rare (gaps,
//! holes, hidden objects, studies) is left to the scalar code, lane by lane.

/// Calls a function for the instruction set of an `InstructionSet`; `$other` if that is none.
macro_rules! with_lanes {
    ($set:expr, |$simd:ident| $call:expr, $other:expr) => {
        // Some machines have one instruction set.
        #[allow(unreachable_patterns)]
        match $set.level() {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            fearless_simd::Level::Avx512($simd) => $call,
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            fearless_simd::Level::Avx2($simd) => $call,
            #[cfg(target_arch = "aarch64")]
            fearless_simd::Level::Neon($simd) => $call,
            #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
            fearless_simd::Level::WasmSimd128($simd) => $call,
            _ => $other,
        }
    };
}

mod column;
mod frame;
mod grid_walk;
mod hits;
mod lanes;
mod mesh;
mod mesh_surface;
mod node_rays;
mod node_walk;
mod objects;
mod pages;
mod ray_packet;
mod stone;
mod tone;
mod trace;

pub(super) use frame::{CentreRay, CentreRows, cast_centres, finish_rows, render_rows, rows_around, sketch_rows};
pub(super) use tone::{count_radiances, develop_pixels};
