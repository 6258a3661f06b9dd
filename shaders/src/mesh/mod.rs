//! A mesh as the ray-caster reads it: pages of words. The client's cache assigns pages of the atlas.
//!
//! Words are read four at a time (a vec4). Boxes and corners are points of the mesh's own grid, so nothing is rounded.
//!
//! | vec4s | content |
//! |---|---|
//! | head, 3 | lowest corner of the grid, metres from the leaf's south-west corner and the city's height zero (3 f32); metres of a step (f32); a reference to the whole tree; the texture's `width \| height << 16`, 0 without one; its number of levels `\| landmarks << 8`; address of its table in words; lowest and highest corner of the mesh: `x_low \| x_high << 16`, y alike, z alike; first word of the palette of its objects, 0 without |
//! | landmarks | of each: 1 + number of its stone in the city, 0 without; origin of the stone's pattern, in metres from the leaf's south-west corner and the city's height zero (3 f32) |
//! | table | a word per texture tile of 64 x 64 texels: its address in the atlas. Row by row, level by level, the finest first |
//! | boxes, 2 | of two halves: `x_low \| x_high << 16`, y alike, z alike, a reference |
//! | triangles, 2 each, 3 in a mesh with landmarks | corners' x0, y0, z0, x1, ... z2, 16 bits each; its object (1 + place in the palette, 0 for none, 16 bits); what each corner carries: `u \| v << 16` in 65,535ths, or 8-bit sRGB without a texture. Then what each corner of a landmark carries: `octahedral normal in 2 x 12 bits \| occlusion << 24`; 1 + number of the landmark, 0 for none, and bit 31 if there is occlusion |
//! | palette | a word per object ([`crate::layout::PALETTE_COLOURED`]) |
//! | texels | texture tiles: rows as long as the level is wide, at most 64 texels |
//!
//! A reference is a place in vec4s, and in its two highest bits the number of triangles there, 1 to 3, or 0 for two
//! boxes.

mod bvh;
mod landmarks;
mod packer;
mod texture;

use crate::layout::PAGE_WORDS;
use crate::pack::{PackedObjects, Page};
use crate::words;
use glam::DVec3;
use insula_protocol::TileId;
use insula_protocol::mesh::Mesh;
use insula_protocol::mesh_tile::{LandmarkObject, MAX_TRIANGLES as MAX_TILE_TRIANGLES};
pub use landmarks::LandmarkBounds;
pub(crate) use landmarks::pack_normal;
use packer::MeshPacker;
pub use packer::packed_order;
use serde::{Deserialize, Serialize};
pub use texture::MeshTexture;

/// Most triangles of a leaf's mesh.
pub const MAX_TRIANGLES: usize = MAX_TILE_TRIANGLES;
/// Most texels along a texture's side; at most half of its square in all. A larger texture is halved until it fits.
pub const MAX_TEXTURE_PX: u32 = 4096;
/// Rays begin at multiples of this part of a metre, counted from the eye, which is a multiple itself. So places of leaves
/// relative to a ray are exact up to 4 km, and neighbouring leaves agree on which side of a shared edge it passes.
pub const ORIGINS_PER_M: f32 = 4096.0;
/// Most halves of the tree that a ray can postpone.
pub(crate) const TRAVERSAL_STACK: usize = 32;
/// Texels along a side of a texture tile, which fills a page.
pub(crate) const TEXTURE_TILE_PX: u32 = 64;
/// Steps of a [`leaf_offset`] in a column.
pub(crate) const LEAF_OFFSET_STEPS: f32 = 1024.0;
/// Where the number of triangles begins in a reference.
pub(crate) const REFERENCE_COUNT_SHIFT: u32 = 30;
pub(crate) const REFERENCE_MASK: u32 = (1 << REFERENCE_COUNT_SHIFT) - 1;
pub(crate) const HEAD_VEC4S: u32 = 3;
/// Vec4s of a landmark's entry behind the head.
pub(crate) const LANDMARK_VEC4S: u32 = 1;
/// Where the number of landmarks begins in the head's word that has the number of levels of the texture.
pub(crate) const LANDMARK_COUNT_SHIFT: u32 = 8;
/// The number of levels in that word.
pub(crate) const LEVELS_MASK: u32 = (1 << LANDMARK_COUNT_SHIFT) - 1;
/// Set in the last word of a landmark's triangle if its corners carry occlusion. The other bits are 1 + the number of the entry.
pub(crate) const LANDMARK_OCCLUSION_BIT: u32 = 1 << 31;
const PAGE_VEC4S: usize = PAGE_WORDS / 4;

/// Estimated number of pages of a mesh.
pub fn pages_guess(triangles: u32, texture_px: u32) -> u32 {
    // Two vec4s a triangle, two a pair of boxes, two triangles in a leaf. A texture's coarser levels add a third.
    let words = u64::from(triangles) * 12 + u64::from(texture_px) * 3 / 2;
    1 + words.div_ceil(PAGE_WORDS as u64).min(1 << 20) as u32
}

/// The nearest place from which a ray may begin ([`ORIGINS_PER_M`]).
pub fn ray_origin(p: DVec3) -> DVec3 {
    (p * f64::from(ORIGINS_PER_M)).round() / f64::from(ORIGINS_PER_M)
}

/// Offset of `leaf` in `tile` (the leaf itself or an ancestor), whose columns give its mesh ambient occlusion: `x | y
/// << 16` in 1024ths of a column.
pub fn leaf_offset(leaf: TileId, tile: TileId) -> u32 {
    let finer = leaf.level().saturating_sub(tile.level()).min(31);
    let offset = |at: u32| ((u64::from(at & ((1 << finer) - 1)) << 16) >> finer) as u32;
    offset(leaf.x()) | offset(leaf.y()) << 16
}

/// Why a mesh cannot be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PackError {
    /// More than [`MAX_TRIANGLES`].
    #[error("a leaf's mesh has {0} triangles, at most {MAX_TRIANGLES} can be drawn")]
    TooManyTriangles(usize),
    /// Corners without a position, texture coordinates or colours.
    #[error("a leaf's mesh is incomplete: {0}")]
    Incomplete(&'static str),
}

/// A mesh in pages. Until [`PackedMesh::relocate`], references and the texture's table are relative to its first page.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PackedMesh {
    /// Pages of [`PAGE_WORDS`] words. The head is at the beginning of the first.
    #[serde(with = "words::pages")]
    pub pages: Vec<Page>,
    pub triangles: u32,
    /// Words that hold references.
    references: Vec<u32>,
    /// Words that hold the addresses of texture tiles.
    table: std::ops::Range<u32>,
    /// Lowest and highest point, metres above the city's height zero.
    pub z_m: [f32; 2],
    /// The objects, if it has some.
    pub objects: Option<PackedObjects>,
    pub landmarks: Vec<LandmarkBounds>,
}

impl PackedMesh {
    /// Packs a decoded mesh and the texture that its texture coordinates refer to. `objects` are those of its triangles, or empty;
    /// `landmarks` those of the objects that are landmarks.
    ///
    /// Fails if the mesh is too large or incomplete.
    pub fn new(
        mesh: &Mesh,
        texture: Option<&MeshTexture>,
        objects: &[u32],
        landmarks: &[LandmarkObject],
    ) -> Result<Self, PackError> {
        let mut packer = MeshPacker::new(mesh, texture.is_some(), objects, landmarks)?;
        let levels = texture.map(|texture| texture.levels(MAX_TEXTURE_PX)).unwrap_or_default();
        let [low_m, high_m] = packer.pack(mesh, &levels);
        let triangles = packer.triangles();
        let MeshPacker { words, references, table, palette, landmarks, .. } = packer;
        let pages = words.chunks_exact(PAGE_WORDS).map(Page::from).collect();
        Ok(Self {
            pages,
            triangles,
            references,
            table,
            z_m: [low_m, high_m],
            objects: palette,
            landmarks: landmarks.bounds,
        })
    }

    /// Makes all addresses absolute. `atlas_pages` are the pages that the cache has assigned, one per entry of
    /// [`PackedMesh::pages`].
    pub fn relocate(&mut self, atlas_pages: &[u32]) {
        if atlas_pages.len() < self.pages.len() {
            return;
        }
        let mut edit = |word: u32, new: &dyn Fn(u32) -> u32| {
            let word = &mut self.pages[word as usize / PAGE_WORDS][word as usize % PAGE_WORDS];
            *word = new(*word);
        };
        let moved = |at: u32, page: usize| atlas_pages[at as usize / page] * page as u32 + at % page as u32;
        for word in &self.references {
            edit(*word, &|old| (old & !REFERENCE_MASK) | moved(old & REFERENCE_MASK, PAGE_VEC4S));
        }
        for word in self.table.clone() {
            edit(word, &|old| moved(old, PAGE_WORDS));
        }
        if !self.table.is_empty() {
            edit(packer::TABLE_WORD, &|old| moved(old, PAGE_WORDS));
        }
        if let Some(objects) = &mut self.objects {
            objects.palette = moved(objects.palette, PAGE_WORDS);
            edit(packer::PALETTE_WORD, &|old| moved(old, PAGE_WORDS));
        }
    }
}
