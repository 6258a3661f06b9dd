//! Objects of what the rays of a packet hit. The scalar code is [`objects`](crate::cpu::objects).

use super::lanes::{M, U, Vec3s, gather_where, has, splat_u};
use crate::cpu::ray::SceneRef;
use crate::layout::{DrawNode, OBJECT_BITS, PAGE_WORDS, PALETTE_COLOURED, PALETTE_HIDDEN};
use crate::srgb::linear_colours;
use fearless_simd::prelude::*;

/// The objects that rays hit.
#[derive(Clone, Copy)]
pub(super) struct ObjectWords<S: Simd> {
    /// Addresses of their words in a palette; 0 where there is none, or if the frame does not need objects.
    pub(super) address: U<S>,
    word: U<S>,
}

/// Which of a column's surfaces rays hit; the top of the upper solid if neither.
#[derive(Clone, Copy)]
pub(super) struct ColumnFaces<S: Simd> {
    /// The part beyond the plane that clips the column.
    pub(super) outer: M<S>,
    pub(super) wall: M<S>,
}

impl<S: Simd> ObjectWords<S> {
    #[inline(always)]
    fn none(simd: S) -> Self {
        Self { address: splat_u(simd, 0), word: splat_u(simd, 0) }
    }

    /// Of the columns of these numbers in a node, for the rays in `lanes`.
    #[inline(always)]
    pub(super) fn of_columns(
        simd: S,
        scene: &SceneRef<'_>,
        node: &DrawNode,
        lanes: M<S>,
        number: U<S>,
        faces: ColumnFaces<S>,
    ) -> Self {
        if scene.frame.objects == 0 || node.palette == 0 {
            return Self::none(simd);
        }
        let page = node.object_page.wrapping_mul(PAGE_WORDS as u32);
        let word = gather_where(simd, scene.atlas, number + page, lanes);
        let mask = (1u32 << OBJECT_BITS) - 1;
        let (roof, wall, lower) = (word & mask, (word >> OBJECT_BITS) & mask, word >> (2 * OBJECT_BITS));
        let has_wall = faces.wall & wall.simd_ne(splat_u(simd, 0));
        Self::at(simd, scene, node.palette, faces.outer.select(lower, has_wall.select(wall, roof)))
    }

    /// Of triangles at these addresses, in vec4s, of a mesh whose palette begins at `palette`, for the rays in `lanes`.
    #[inline(always)]
    pub(super) fn of_triangles(simd: S, scene: &SceneRef<'_>, palette: u32, lanes: M<S>, triangle: U<S>) -> Self {
        if scene.frame.objects == 0 || palette == 0 {
            return Self::none(simd);
        }
        let word = gather_where(simd, scene.atlas, triangle * 4 + 4, lanes);
        Self::at(simd, scene, palette, word >> 16)
    }

    /// At places of a palette, from 1; 0 is no object.
    #[inline(always)]
    fn at(simd: S, scene: &SceneRef<'_>, palette: u32, place: U<S>) -> Self {
        let is_object = place.simd_ne(splat_u(simd, 0));
        let address = is_object.select(place + (palette - 1), splat_u(simd, 0));
        Self { address, word: gather_where(simd, scene.atlas, address, is_object) }
    }

    /// Rays pass through these.
    #[inline(always)]
    pub(super) fn hidden(&self, simd: S) -> M<S> {
        has(simd, self.word, PALETTE_HIDDEN)
    }

    /// The colours that objects have instead of `albedo`, linear RGB.
    #[inline(always)]
    pub(super) fn colours(&self, simd: S, albedo: Vec3s<S>) -> Vec3s<S> {
        let coloured = has(simd, self.word, PALETTE_COLOURED);
        if coloured.all_false() {
            return albedo;
        }
        Vec3s::select(coloured, linear_colours(simd, self.word), albedo)
    }

    /// Words with the colours that objects have instead of texels.
    #[inline(always)]
    pub(super) fn colour_words(&self, simd: S, texel: U<S>) -> U<S> {
        has(simd, self.word, PALETTE_COLOURED).select(self.word, texel)
    }
}
