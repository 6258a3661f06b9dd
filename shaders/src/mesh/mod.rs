//! A mesh as the ray-caster reads it: pages of words.
//!
//! In: a decoded [`Mesh`] and its picture. Out: [`PackedMesh`]. Next: the client's cache gives it pages, `cpu::mesh` and
//! `mesh.wgsl` look for what a ray hits.
//!
//! Words are read in fours. Boxes and corners are points of the mesh's own grid, so nothing is rounded.
//!
//! | fours | what they hold |
//! |---|---|
//! | head, 3 | lowest corner of the grid, metres from the leaf's south-west corner and the city's height zero (3 f32); metres of a step (f32); a [`reference`] to the whole; texture: width, height << 16, 0 if there is none; levels of the texture; address of the table in words; lowest and highest corner: x low, x high << 16, y alike, z alike; 0 |
//! | table | a word a square of 64 x 64 texels: where in the atlas it begins. Row by row, level by level, the finest first |
//! | boxes, 2 | of two halves: x low, x high << 16; y alike; z alike; a [`reference`] |
//! | triangles, 2 each | corners' x0, y0, z0, x1, ... z2, 16 bits each; 16 bits of zero; what each corner carries: `u \| v << 16` in 65,535ths, or 8-bit sRGB without a texture |
//! | texels | squares of the texture, rows of as many as its level is wide, 64 at most |
//!
//! A reference is a place in fours, and in its two highest bits the number of triangles there, 1 to 3, or 0 for two boxes.

mod bvh;
mod texture;

use crate::{layout::PAGE_WORDS, pack::Page};
use bvh::{Child, Tree};
use insula_protocol::{
    TileId,
    mesh::{AttributeKind, Mesh},
};
pub use texture::Picture;

/// Most triangles of a leaf's mesh.
pub const MAX_TRIANGLES: usize = 1 << 18;
/// Most texels along a texture's side, and half of its square in all: what is larger is halved until it fits.
pub const MAX_TEXTURE_PX: u32 = 4096;
/// Places in a stack of halves that are still to be looked at.
pub const STACK: usize = 32;
/// Texels along a side of a square of a texture, which fills a page.
pub const TILE_PX: u32 = 64;
/// Places of a leaf along the side of a column of the tile that it lies in.
pub const PLACES: f32 = 1024.0;
/// Where in a reference the number of triangles is.
pub const COUNT_SHIFT: u32 = 30;
/// Fours of a page.
const PAGE_FOURS: usize = PAGE_WORDS / 4;
/// Fours of the head.
const HEAD: usize = 3;

/// Pages that a mesh of so many triangles and texels takes, about.
pub fn pages_guess(triangles: u32, texture_px: u32) -> u32 {
    // Two fours a triangle, two a pair of boxes, two triangles in a leaf; a texture's coarser levels are a third of it.
    let words = u64::from(triangles) * 12 + u64::from(texture_px) * 3 / 2;
    1 + words.div_ceil(PAGE_WORDS as u64).min(1 << 20) as u32
}

/// Where `leaf` lies in `tile`, itself or an ancestor, whose columns tell its mesh how much sky is seen: [`PLACES`] a column,
/// `x | y << 16`.
pub fn place_in(leaf: TileId, tile: TileId) -> u32 {
    let finer = leaf.level().saturating_sub(tile.level()).min(31);
    let place = |at: u32| ((u64::from(at & ((1 << finer) - 1)) << 16) >> finer) as u32;
    place(leaf.x()) | place(leaf.y()) << 16
}

/// Why a mesh cannot be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PackError {
    /// More than [`MAX_TRIANGLES`].
    #[error("a leaf's mesh has {0} triangles, {MAX_TRIANGLES} can be drawn")]
    Triangles(usize),
    /// It has neither a texture nor colours, or corners that point nowhere.
    #[error("a leaf's mesh has nothing to show: {0}")]
    Looks(&'static str),
}

/// A mesh in pages; references and the texture's table are still relative to its first page.
#[derive(Debug, Clone)]
pub struct PackedMesh {
    /// The head is in the first. Each of [`PAGE_WORDS`] words.
    pub pages: Vec<Page>,
    /// Triangles.
    pub triangles: u32,
    /// Words that hold references, and those that hold the texture's squares.
    references: Vec<u32>,
    table: std::ops::Range<u32>,
    /// Lowest and highest point, metres above the city's height zero.
    pub z_m: [f32; 2],
}

/// Takes fours one after the other, so that what is read together lies in one page.
#[derive(Debug, Default)]
struct Fours {
    words: Vec<u32>,
}

impl Fours {
    /// Place, in fours, of `count` new ones, at most a page's.
    fn take(&mut self, count: usize) -> u32 {
        let used = self.words.len() / 4 % PAGE_FOURS;
        let at = self.words.len() / 4 + if used + count > PAGE_FOURS { PAGE_FOURS - used } else { 0 };
        self.words.resize((at + count) * 4, 0);
        at as u32
    }

    fn at(&mut self, four: u32) -> &mut [u32] {
        &mut self.words[four as usize * 4..][..4]
    }
}

impl PackedMesh {
    /// Packs a decoded mesh; `texture` is what its texture coordinates point into.
    ///
    /// # Errors
    /// What cannot be drawn.
    pub fn new(mesh: &Mesh, texture: Option<&Picture>) -> Result<Self, PackError> {
        if mesh.triangles.len() > MAX_TRIANGLES {
            return Err(PackError::Triangles(mesh.triangles.len()));
        }
        let mut looks = looks(mesh, texture.is_some())?;
        let mut corners = Vec::with_capacity(mesh.triangles.len().max(1));
        for triangle in &mesh.triangles {
            let place = |at: u32| mesh.positions.get(at as usize).filter(|p| p.iter().all(|v| *v <= u16::MAX.into()));
            let [Some(a), Some(b), Some(c)] = triangle.map(place) else {
                return Err(PackError::Looks("a corner without a place"));
            };
            corners.push([*a, *b, *c]);
        }
        // A reference cannot say that there is none.
        if corners.is_empty() {
            (corners, looks) = (vec![[[0; 3]; 3]], vec![[0; 3]]);
        }
        let levels = texture.map(|texture| texture.levels(MAX_TEXTURE_PX)).unwrap_or_default();
        let squares: usize = levels.iter().map(Picture::squares).sum();
        let mut packing = Packing { fours: Fours::default(), references: Vec::new(), corners, looks };
        packing.fours.take((HEAD + squares.div_ceil(4)).min(PAGE_FOURS));
        let tree = Tree::of(&packing.corners);
        let root = packing.child(&tree, &tree.root);
        let table = HEAD as u32 * 4..(HEAD * 4 + squares) as u32;
        packing.head(mesh, &tree, root, &levels, table.start);
        let triangles = packing.corners.len() as u32;
        let Packing { mut fours, references, .. } = packing;
        fours.words.resize(fours.words.len().next_multiple_of(PAGE_WORDS), 0);
        texture::place(&levels, &mut fours.words, table.start as usize);
        fours.words.resize(fours.words.len().next_multiple_of(PAGE_WORDS), 0);
        let pages = fours.words.chunks_exact(PAGE_WORDS).map(Page::from).collect();
        let z = |code: u32| (mesh.grid.min[2] + f64::from(code) * mesh.grid.step) as f32;
        let z_m = [z(tree.root.bounds[0][2]), z(tree.root.bounds[1][2])];
        Ok(Self { pages, triangles, references, table, z_m })
    }

    /// Makes all addresses absolute, once the cache has said which atlas pages the mesh gets (one per entry of
    /// [`PackedMesh::pages`], in order).
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
            edit(*word, &|old| {
                let (count, at) = (old >> COUNT_SHIFT, old & ((1 << COUNT_SHIFT) - 1));
                count << COUNT_SHIFT | moved(at, PAGE_FOURS)
            });
        }
        for word in self.table.clone() {
            edit(word, &|old| moved(old, PAGE_WORDS));
        }
        if !self.table.is_empty() {
            edit(7, &|old| moved(old, PAGE_WORDS));
        }
    }
}

struct Packing {
    fours: Fours,
    references: Vec<u32>,
    corners: Vec<[[u32; 3]; 3]>,
    looks: Vec<[u32; 3]>,
}

impl Packing {
    /// Writes what is below a child; its reference.
    fn child(&mut self, tree: &Tree, child: &Child) -> u32 {
        match child.halves {
            Some(pair) => {
                let at = self.fours.take(2);
                for (k, half) in (0..2).zip(&tree.pairs[pair as usize]) {
                    let reference = self.child(tree, half);
                    let [low, high] = half.bounds;
                    let four = self.fours.at(at + k);
                    for axis in 0..3 {
                        four[axis] = low[axis] | high[axis] << 16;
                    }
                    four[3] = reference;
                    self.references.push((at + k) * 4 + 3);
                }
                at
            }
            None => {
                let triangles = &tree.order[child.triangles.start as usize..child.triangles.end as usize];
                let at = self.fours.take(2 * triangles.len());
                for (k, triangle) in (0..).zip(triangles) {
                    let p = self.corners[*triangle as usize].concat();
                    let pair = |k: usize| p[k] | p.get(k + 1).copied().unwrap_or(0) << 16;
                    self.fours.at(at + 2 * k).copy_from_slice(&[pair(0), pair(2), pair(4), pair(6)]);
                    let [a, b, c] = self.looks[*triangle as usize];
                    self.fours.at(at + 2 * k + 1).copy_from_slice(&[p[8], a, b, c]);
                }
                at | (triangles.len() as u32) << COUNT_SHIFT
            }
        }
    }

    fn head(&mut self, mesh: &Mesh, tree: &Tree, root: u32, levels: &[Picture], table: u32) {
        let metres = |v: f64| (v as f32).to_bits();
        let [x, y, z] = mesh.grid.min.map(metres);
        self.fours.at(0).copy_from_slice(&[x, y, z, metres(mesh.grid.step)]);
        let size = levels.first().map_or(0, |finest| finest.width_px | finest.height_px << 16);
        self.fours.at(1).copy_from_slice(&[root, size, levels.len() as u32, table]);
        self.references.push(4);
        let [low, high] = tree.root.bounds;
        let box_of = |axis: usize| low[axis] | high[axis] << 16;
        self.fours.at(2).copy_from_slice(&[box_of(0), box_of(1), box_of(2), 0]);
    }
}

/// What each triangle's corners carry, as the pages hold it.
fn looks(mesh: &Mesh, textured: bool) -> Result<Vec<[u32; 3]>, PackError> {
    let kind = if textured { AttributeKind::TexCoord } else { AttributeKind::Colour };
    let attribute = mesh.attributes.iter().find(|attribute| attribute.kind == kind);
    let attribute = attribute.ok_or(PackError::Looks("neither texture nor colours"))?;
    let most = (1u32 << attribute.bits.min(16)) - 1;
    let scaled = |v: u32, to: u32| (v.min(most) * to + most / 2) / most;
    let look = |value: &[u32; 4]| match kind {
        AttributeKind::TexCoord => {
            let [low, step] = attribute.range;
            let share = |v: u32| ((low + step * v as f32).clamp(0.0, 1.0) * 65535.0 + 0.5) as u32;
            share(value[0]) | share(value[1]) << 16
        }
        _ => scaled(value[0], 255) | scaled(value[1], 255) << 8 | scaled(value[2], 255) << 16,
    };
    let values: Vec<u32> = attribute.values.iter().map(look).collect();
    let corner = |at: &u32| values.get(*at as usize).copied();
    let of = |corners: &[u32; 3]| Some([corner(&corners[0])?, corner(&corners[1])?, corner(&corners[2])?]);
    let (triples, rest) = attribute.corners.as_chunks::<3>();
    let looks: Option<Vec<[u32; 3]>> = triples.iter().map(of).collect();
    match looks {
        Some(looks) if looks.len() == mesh.triangles.len() && rest.is_empty() => Ok(looks),
        _ => Err(PackError::Looks("corners without a colour")),
    }
}
