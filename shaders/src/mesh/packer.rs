//! Writes a mesh, its hierarchy and its texture into words, as [`super`] says.

use super::bvh::{Bvh, BvhChild};
use super::landmarks::PackedLandmarks;
use super::texture::{self, MeshTexture};
use super::{
    HEAD_VEC4S, LANDMARK_COUNT_SHIFT, LANDMARK_VEC4S, MAX_TRIANGLES, PAGE_VEC4S, PackError, REFERENCE_COUNT_SHIFT,
};
use crate::layout::PAGE_WORDS;
use crate::pack::PackedObjects;
use insula_protocol::mesh::{AttributeKind, Mesh};
use insula_protocol::mesh_tile::{LandmarkObject, NO_OBJECT};
use std::ops::Range;

/// The head's word that holds the reference to the whole tree.
const ROOT_WORD: u32 = 4;
/// The head's word that holds the address of the texture's table.
pub(super) const TABLE_WORD: u32 = 7;
/// The head's word that holds the address of the palette.
pub(super) const PALETTE_WORD: u32 = 11;
/// Most objects of a palette: they lie in one page.
const MAX_OBJECTS: usize = PAGE_WORDS;

pub(super) struct MeshPacker {
    pub(super) words: Vec<u32>,
    /// Words that hold references.
    pub(super) references: Vec<u32>,
    /// Words that hold the addresses of texture tiles.
    pub(super) table: Range<u32>,
    corners: Vec<[[u32; 3]; 3]>,
    /// Values at each triangle's corners: texture coordinates or colours.
    carried: Vec<[u32; 3]>,
    /// Of each triangle 1 + the place of its object in the palette, or 0.
    places: Vec<u32>,
    pub(super) palette: Option<PackedObjects>,
    pub(super) landmarks: PackedLandmarks,
}

impl MeshPacker {
    /// Fails if the mesh is too large or incomplete.
    pub(super) fn new(
        mesh: &Mesh,
        textured: bool,
        objects: &[u32],
        landmarks: &[LandmarkObject],
    ) -> Result<Self, PackError> {
        if mesh.triangles.len() > MAX_TRIANGLES {
            return Err(PackError::TooManyTriangles(mesh.triangles.len()));
        }
        let mut carried = carried(mesh, textured)?;
        let mut corners = corners_of(mesh).ok_or(PackError::Incomplete("a corner without a position"))?;
        // A reference cannot express zero triangles.
        if corners.is_empty() {
            (corners, carried) = (vec![[[0; 3]; 3]], vec![[0; 3]]);
        }
        let (list, places) = number_objects(objects, corners.len());
        let palette = (!list.is_empty()).then_some(PackedObjects { list, palette: 0 });
        let landmarks = PackedLandmarks::new(mesh, objects, landmarks);
        Ok(Self {
            words: Vec::new(),
            references: Vec::new(),
            table: 0..0,
            corners,
            carried,
            places,
            palette,
            landmarks,
        })
    }

    fn has_landmarks(&self) -> bool {
        !self.landmarks.entries.is_empty()
    }

    /// Vec4s of the head and of the landmarks behind it.
    fn head_vec4s(&self) -> usize {
        HEAD_VEC4S as usize + self.landmarks.entries.len() * LANDMARK_VEC4S as usize
    }

    pub(super) fn triangles(&self) -> u32 {
        self.corners.len() as u32
    }

    /// Writes everything, in whole pages. Returns the lowest and the highest point in metres.
    pub(super) fn pack(&mut self, mesh: &Mesh, levels: &[MeshTexture]) -> [f32; 2] {
        let tiles: usize = levels.iter().map(MeshTexture::tiles).sum();
        let head = self.head_vec4s();
        self.take((head + tiles.div_ceil(4)).min(PAGE_VEC4S));
        let bvh = Bvh::of(&self.corners);
        let root = self.child(&bvh, &bvh.root);
        self.table = head as u32 * 4..(head * 4 + tiles) as u32;
        let objects = self.palette.as_ref().map_or(0, |objects| objects.list.len());
        let palette = if objects > 0 { self.take(objects.div_ceil(4)) * 4 } else { 0 };
        if let Some(objects) = &mut self.palette {
            objects.palette = palette;
        }
        self.head(mesh, &bvh, root, levels, palette);
        self.words.resize(self.words.len().next_multiple_of(PAGE_WORDS), 0);
        texture::place(levels, &mut self.words, self.table.start as usize);
        self.words.resize(self.words.len().next_multiple_of(PAGE_WORDS), 0);
        let z = |code: u32| (mesh.grid.min[2] + f64::from(code) * mesh.grid.step) as f32;
        bvh.root.bounds.map(|corner| z(corner[2]))
    }

    /// Address of `count` new vec4s, at most a page's. They lie in one page, because they are read together.
    fn take(&mut self, count: usize) -> u32 {
        let used = self.words.len() / 4 % PAGE_VEC4S;
        let at = self.words.len() / 4 + if used + count > PAGE_VEC4S { PAGE_VEC4S - used } else { 0 };
        self.words.resize((at + count) * 4, 0);
        at as u32
    }

    fn vec4_at(&mut self, at: u32) -> &mut [u32] {
        &mut self.words[at as usize * 4..][..4]
    }

    /// Writes the subtree below a child. Returns a reference to it.
    fn child(&mut self, bvh: &Bvh, child: &BvhChild) -> u32 {
        let Some(pair) = child.halves else { return self.leaf(bvh, child) };
        let at = self.take(2);
        for (k, half) in (0..2).zip(&bvh.pairs[pair as usize]) {
            let reference = self.child(bvh, half);
            let [x, y, z] = box_words(half);
            self.vec4_at(at + k).copy_from_slice(&[x, y, z, reference]);
            self.references.push((at + k) * 4 + 3);
        }
        at
    }

    fn leaf(&mut self, bvh: &Bvh, leaf: &BvhChild) -> u32 {
        let triangles = &bvh.order[leaf.triangles.start as usize..leaf.triangles.end as usize];
        let stride = if self.has_landmarks() { 3 } else { 2 };
        let at = self.take(stride * triangles.len());
        for (k, triangle) in (at..).step_by(stride).zip(triangles) {
            let p = self.corners[*triangle as usize].concat();
            let pair = |k: usize| p[k] | p.get(k + 1).copied().unwrap_or(0) << 16;
            let ([a, b, c], place) = (self.carried[*triangle as usize], self.places[*triangle as usize]);
            self.vec4_at(k).copy_from_slice(&[pair(0), pair(2), pair(4), pair(6)]);
            self.vec4_at(k + 1).copy_from_slice(&[p[8] | place << 16, a, b, c]);
            if let Some(words) = self.landmarks.of_triangle.get(*triangle as usize).copied() {
                self.vec4_at(k + 2).copy_from_slice(&words);
            }
        }
        at | (triangles.len() as u32) << REFERENCE_COUNT_SHIFT
    }

    fn head(&mut self, mesh: &Mesh, bvh: &Bvh, root: u32, levels: &[MeshTexture], palette: u32) {
        let metres = |v: f64| (v as f32).to_bits();
        let [x, y, z] = mesh.grid.min.map(metres);
        self.vec4_at(0).copy_from_slice(&[x, y, z, metres(mesh.grid.step)]);
        let size = levels.first().map_or(0, |finest| finest.width_px | finest.height_px << 16);
        let table = self.table.start;
        let landmarks = self.landmarks.entries.len() as u32;
        self.vec4_at(1).copy_from_slice(&[root, size, levels.len() as u32 | landmarks << LANDMARK_COUNT_SHIFT, table]);
        self.references.push(ROOT_WORD);
        let [x, y, z] = box_words(&bvh.root);
        self.vec4_at(2).copy_from_slice(&[x, y, z, palette]);
        for (at, entry) in (HEAD_VEC4S..).step_by(LANDMARK_VEC4S as usize).zip(self.landmarks.entries.clone()) {
            self.vec4_at(at).copy_from_slice(&entry);
        }
    }
}

/// The corners of all triangles; `None` if one has no position, or one that is too large.
fn corners_of(mesh: &Mesh) -> Option<Vec<[[u32; 3]; 3]>> {
    let position =
        |at: &u32| mesh.positions.get(*at as usize).filter(|p| p.iter().all(|v| *v <= u16::MAX.into())).copied();
    let corners = |[a, b, c]: &[u32; 3]| Some([position(a)?, position(b)?, position(c)?]);
    mesh.triangles.iter().map(corners).collect()
}

/// Numbers of a mesh's triangles in the order in which they are packed. Of several in one place, ray-casters show the first one.
/// `None` if a corner has no position, or one that is too large.
pub fn packed_order(mesh: &Mesh) -> Option<Vec<u32>> {
    corners_of(mesh).map(|corners| Bvh::of(&corners).order)
}

/// The different objects ascending, and of each triangle 1 + the place of its own, or 0. Of too many, the last are left out.
fn number_objects(objects: &[u32], triangles: usize) -> (Vec<u32>, Vec<u32>) {
    let mut list: Vec<u32> = objects.iter().copied().filter(|object| *object != NO_OBJECT).collect();
    list.sort_unstable();
    list.dedup();
    list.truncate(MAX_OBJECTS);
    let place =
        |t: usize| objects.get(t).and_then(|object| list.binary_search(object).ok()).map_or(0, |at| at as u32 + 1);
    let places = (0..triangles).map(place).collect();
    (list, places)
}

fn box_words(child: &BvhChild) -> [u32; 3] {
    let [low, high] = child.bounds;
    std::array::from_fn(|axis| low[axis] | high[axis] << 16)
}

/// Values at each triangle's corners, as the pages store them. Fails if a corner has none.
fn carried(mesh: &Mesh, textured: bool) -> Result<Vec<[u32; 3]>, PackError> {
    let kind = if textured { AttributeKind::TexCoord } else { AttributeKind::Colour };
    let attribute = mesh.attributes.iter().find(|attribute| attribute.kind == kind);
    let attribute = attribute.ok_or(PackError::Incomplete("neither a texture nor colours"))?;
    let most = (1u32 << attribute.bits.min(16)) - 1;
    let scaled = |v: u32, to: u32| (v.min(most) * to + most / 2) / most;
    let word = |value: &[u32; 4]| match kind {
        AttributeKind::TexCoord => {
            let [low, step] = attribute.range;
            let share = |v: u32| ((low + step * v as f32).clamp(0.0, 1.0) * 65535.0 + 0.5) as u32;
            share(value[0]) | share(value[1]) << 16
        }
        _ => scaled(value[0], 255) | scaled(value[1], 255) << 8 | scaled(value[2], 255) << 16,
    };
    let values: Vec<u32> = attribute.values.iter().map(word).collect();
    let corner = |at: &u32| values.get(*at as usize).copied();
    let of = |corners: &[u32; 3]| Some([corner(&corners[0])?, corner(&corners[1])?, corner(&corners[2])?]);
    let (triples, rest) = attribute.corners.as_chunks::<3>();
    let carried: Option<Vec<[u32; 3]>> = triples.iter().map(of).collect();
    match carried {
        Some(carried) if carried.len() == mesh.triangles.len() && rest.is_empty() => Ok(carried),
        _ => Err(PackError::Incomplete("a corner without texture coordinates or a colour")),
    }
}
