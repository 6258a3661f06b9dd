//! Segments of the rays of a packet, and the surfaces that they hit.

use super::lanes::{F, M, U, Vec3s, splat, splat_u};
use crate::cpu::mesh::MeshHit;
use crate::cpu::ray::{NodeRay, Ray, RayCounts, RayHit, RaySegment, SceneRef};
use crate::layout::NO_NODE;
use fearless_simd::prelude::*;
use glam::Vec3;

/// [`RaySegment`] of each ray.
#[derive(Clone, Copy)]
pub(super) struct Segments<S: Simd> {
    pub(super) origin: Vec3s<S>,
    pub(super) dir: Vec3s<S>,
    pub(super) reach_m: f32,
    pub(super) eye_m: F<S>,
    pub(super) to_sun: bool,
    pub(super) threshold: U<S>,
}

/// [`RayHit`] of each ray. Levels are those of the nodes.
#[derive(Clone, Copy)]
pub(super) struct Hits<S: Simd> {
    pub(super) is_hit: M<S>,
    /// Words whose colours the surfaces have, until they are converted when all rays have ended; 0 where the albedo is known.
    pub(super) colour: U<S>,
    pub(super) albedo: Vec3s<S>,
    pub(super) ao: F<S>,
    pub(super) normal: Vec3s<S>,
    pub(super) flags: U<S>,
    pub(super) distance_m: F<S>,
    pub(super) node: U<S>,
    pub(super) object: U<S>,
    /// Not set in frames without shadows.
    pub(super) shadow_origin: Vec3s<S>,
    pub(super) stone: U<S>,
    pub(super) stone_point: Vec3s<S>,
}

/// The nearest triangles so far.
pub(super) struct MeshHits<S: Simd> {
    pub(super) t: F<S>,
    /// Addresses in the atlas, in vec4s; 0 if there is none.
    pub(super) triangle: U<S>,
    pub(super) u: F<S>,
    pub(super) v: F<S>,
    pub(super) is_front: M<S>,
}

impl<S: Simd> MeshHits<S> {
    /// The triangle of a lane, for the scalar code. No object is read.
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize) -> MeshHit {
        MeshHit {
            t: self.t[lane],
            triangle: self.triangle[lane],
            u: self.u[lane],
            v: self.v[lane],
            is_front: self.is_front.test(lane),
            object: 0,
        }
    }
}

/// Four words of the atlas, whose place is given in vec4s; 0 outside of it.
#[inline(always)]
pub(super) fn read_vec4(scene: &SceneRef<'_>, at: u32) -> [u32; 4] {
    scene.atlas.get(at as usize * 4..).and_then(|words| words.first_chunk()).copied().unwrap_or_default()
}

impl<S: Simd> Segments<S> {
    /// The ray of a lane, for the scalar code.
    #[inline(always)]
    pub(super) fn lane<'a>(&self, scene: &'a SceneRef<'a>, lane: usize) -> Ray<'a> {
        let segment = RaySegment {
            origin: self.origin.lane(lane),
            dir: self.dir.lane(lane),
            reach_m: self.reach_m,
            eye_m: self.eye_m[lane],
            to_sun: self.to_sun,
        };
        let (threshold, counts) = (self.threshold[lane], RayCounts::default());
        Ray { scene, segment, threshold, hit: RayHit::NOTHING, node: NodeRay::default(), counts }
    }
}

impl<S: Simd> Hits<S> {
    /// Before the rays have hit anything.
    #[inline(always)]
    pub(super) fn nothing(simd: S) -> Self {
        let (zero, zeros) = (splat(simd, 0.0), splat_u(simd, 0));
        let zero3 = Vec3s::splat(simd, Vec3::ZERO);
        Self {
            is_hit: M::<S>::splat(simd, false),
            colour: zeros,
            albedo: zero3,
            ao: zero,
            normal: zero3,
            flags: zeros,
            distance_m: splat(simd, f32::INFINITY),
            node: splat_u(simd, NO_NODE),
            object: zeros,
            shadow_origin: zero3,
            stone: zeros,
            stone_point: zero3,
        }
    }

    /// The hit of a lane, for the scalar code. Colours must have been converted.
    #[inline(always)]
    pub(super) fn lane(&self, scene: &SceneRef<'_>, lane: usize) -> RayHit {
        RayHit {
            is_hit: self.is_hit.test(lane),
            albedo: self.albedo.lane(lane),
            ao: self.ao[lane],
            normal: self.normal.lane(lane),
            flags: self.flags[lane],
            level: scene.nodes.get(self.node[lane] as usize).map_or(0, |node| node.level),
            distance_m: self.distance_m[lane],
            node: self.node[lane],
            object: self.object[lane],
            shadow_origin: self.shadow_origin.lane(lane),
            stone: self.stone[lane],
            stone_point: self.stone_point.lane(lane),
        }
    }

    /// Takes over what the scalar code has hit.
    #[inline(always)]
    pub(super) fn set_lane(&mut self, lane: usize, hit: &RayHit) {
        if !hit.is_hit {
            return;
        }
        self.is_hit.set(lane, true);
        self.colour[lane] = 0;
        self.albedo.set_lane(lane, hit.albedo);
        self.ao[lane] = hit.ao;
        self.normal.set_lane(lane, hit.normal);
        self.flags[lane] = hit.flags;
        self.distance_m[lane] = hit.distance_m;
        self.node[lane] = hit.node;
        self.object[lane] = hit.object;
        self.shadow_origin.set_lane(lane, hit.shadow_origin);
        self.stone[lane] = hit.stone;
        self.stone_point.set_lane(lane, hit.stone_point);
    }
}
