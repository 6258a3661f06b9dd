//! The terrain of a view: as many triangles as the view needs, by ROAM (`insula_roam`).
//!
//! A level of detail holds its error over its whole leaf, and its borders are as fine as those of its neighbours. ROAM makes one
//! surface of all leaves, which is finest near the eye. Land of distant nodes is a surface for each, and [`ViewLand`] joins all.

use super::ExportError;
use super::builder::GlbBuilder;
use super::geometry::{Geometry, NO_FEATURE, srgb};
use super::matrix::numbers_of;
use super::view::ExportView;
use super::view_land::{LandPart, ViewLand};
use crate::land_surface::{LandSurface, is_one_colour};
use glam::{DAffine3, DVec2, DVec3};
use insula_protocol::{Manifest, NODE_CELLS, TileId};
use insula_roam::{ROOT_STEPS, SampleGrid, SampledTerrain, TerrainFace};
use std::collections::{BTreeMap, BTreeSet};

/// Most samples. The grid has at least 65 rows, so its columns are fewer than 2^16.
const MAX_SAMPLES: f64 = 2e6;
/// Share of the tolerated error by which the grid may differ from the meshes, and the surface from the grid.
const ERROR_SHARE: f64 = 0.25;
/// Height of the strips that hang from borders of land beside boxes or meshes, in cells: nodes beside each other differ by less.
const SKIRT_CELLS: f64 = 2.0;
/// Least height of such a strip of the surface of leaves, in metres: leaves beside it may have their own meshes.
const MIN_SKIRT_M: f64 = 1.0;

/// The terrain of the leaves that a view shows as meshes, and the land of its other nodes.
#[derive(Debug, Default)]
pub(super) struct ViewTerrain {
    leaves: Vec<LeafTerrain>,
    land: ViewLand,
    /// Height of the strip of the leaves' surface, where nodes beside it are coarser.
    skirt_m: f64,
    /// Some leaves have terrain with pictures, which is written with the rest of their meshes.
    pub(super) has_pictures: bool,
}

#[derive(Debug)]
struct LeafTerrain {
    leaf: TileId,
    geometry: Geometry,
    /// From the grid of the geometry to metres from the origin of the scene, z up.
    matrix: DAffine3,
}

/// A surface in place of the terrain of some leaves.
struct Refined {
    surface: LandSurface,
    grid: LeafGrid,
    /// Whether it stands for the terrain of each leaf.
    leaves: Vec<bool>,
}

/// A grid over leaves.
struct LeafGrid {
    samples: SampleGrid,
    /// The leaf in its south-western corner.
    corner: TileId,
    /// Steps along the side of a leaf.
    leaf_steps: u32,
}

/// A triangle of terrain in metres from the origin of the scene.
struct Triangle {
    /// Index of its leaf.
    leaf: usize,
    corners: [DVec3; 3],
    normal: DVec3,
    colours: [[u8; 3]; 3],
    feature: u32,
}

impl ViewTerrain {
    /// Adds the terrain of a leaf. `matrix` maps the grid of `geometry` to metres from the origin of the scene, z up.
    pub(super) fn add(&mut self, leaf: TileId, geometry: Geometry, matrix: DAffine3) {
        if !geometry.indices.is_empty() {
            self.leaves.push(LeafTerrain { leaf, geometry, matrix });
        }
    }

    /// Adds the land of a node's columns, a surface over the corners of its cells.
    pub(super) fn add_columns(&mut self, manifest: &Manifest, node: TileId, surface: LandSurface) {
        let skirt_m = SKIRT_CELLS * manifest.cell_m_at(node.level());
        self.skirt_m = self.skirt_m.max(skirt_m);
        let steps = NODE_CELLS as u32;
        self.land.add(LandPart::new(manifest, (node, steps), surface, (node.to_string(), skirt_m)));
    }

    /// Writes the land of columns and the terrain of leaves, which meet. Returns the number of triangles. `origin` is that of the scene in
    /// world metres.
    pub(super) fn write(
        mut self,
        glb: &mut GlbBuilder,
        manifest: &Manifest,
        (view, origin): (&ExportView, [f64; 3]),
    ) -> Result<usize, ExportError> {
        let leaves = self.write_terrain(glb, manifest, (view, origin))?;
        Ok(leaves + self.land.write(glb, manifest, origin)?)
    }

    /// Makes the terrain of leaves one surface of the land for the view. Writes it as it is if that has no more triangles, if a grid cannot
    /// hold it, or if it has pictures or several colours. Where terrain overlaps, only its largest object becomes a surface; leaves that
    /// terrain does not cover keep their meshes. Returns the number of triangles that it has written.
    fn write_terrain(
        &mut self,
        glb: &mut GlbBuilder,
        manifest: &Manifest,
        (view, origin): (&ExportView, [f64; 3]),
    ) -> Result<usize, ExportError> {
        if self.has_pictures {
            // A surface would not meet them.
            return self.write_leaves(glb, &|_, _| true);
        }
        let triangles: Vec<Triangle> = (0..).zip(&self.leaves).flat_map(|(i, leaf)| leaf.triangles(i)).collect();
        for features in choices(&triangles) {
            let of_features: Vec<&Triangle> = triangles.iter().filter(|t| features.contains(&t.feature)).collect();
            let Some(Refined { grid, surface, leaves }) = self.refined(of_features, manifest, (view, origin)) else {
                continue;
            };
            let strip = ("terrain".to_owned(), self.skirt_m.max(MIN_SKIRT_M));
            self.land.add_truest(LandPart::new(manifest, (grid.corner, grid.leaf_steps), surface, strip));
            return self.write_leaves(glb, &|leaf, feature| !leaves[leaf] || !features.contains(&feature));
        }
        self.write_leaves(glb, &|_, _| true)
    }

    /// Writes the triangles of some leaves and features. Returns their number.
    fn write_leaves(&self, glb: &mut GlbBuilder, has: &dyn Fn(usize, u32) -> bool) -> Result<usize, ExportError> {
        let mut count = 0;
        for (i, LeafTerrain { leaf, geometry, matrix }) in self.leaves.iter().enumerate() {
            let of = |corner: u32| geometry.features.get(corner as usize).copied().unwrap_or(NO_FEATURE);
            let shown = geometry.indices.chunks_exact(3).filter(|corners| has(i, of(corners[0])));
            let geometry = Geometry { indices: shown.flatten().copied().collect(), ..geometry.clone() };
            if !geometry.indices.is_empty() {
                count += geometry.indices.len() / 3;
                let material = glb.plain_material();
                let mesh = glb.add_mesh(&geometry, material)?;
                glb.add_node(Some(leaf.to_string()), numbers_of(*matrix), mesh);
            }
        }
        Ok(count)
    }

    /// The surface of triangles, of leaves that they cover; `None` if it would not be better than they are.
    fn refined(
        &self,
        mut triangles: Vec<&Triangle>,
        manifest: &Manifest,
        (view, origin): (&ExportView, [f64; 3]),
    ) -> Option<Refined> {
        if !is_one_colour(triangles.iter().flat_map(|triangle| triangle.colours.map(|colour| colour.map(srgb)))) {
            return None;
        }
        let grid = self.grid(manifest, origin)?;
        let terrain = SampledTerrain::new(grid.samples, &faces(&triangles))?;
        let is_covered = |leaf: &LeafTerrain| {
            let [x, y] =
                [leaf.leaf.x() - grid.corner.x(), leaf.leaf.y() - grid.corner.y()].map(|at| at * grid.leaf_steps);
            let side = grid.leaf_steps;
            (y..=y + side).all(|y| (x..=x + side).all(|x| terrain.has([x, y])))
        };
        let leaves: Vec<bool> = self.leaves.iter().map(is_covered).collect();
        triangles.retain(|triangle| leaves[triangle.leaf]);
        let faces = faces(&triangles);
        let allowed = ((ERROR_SHARE * view.tau_px) as f32, triangles.len());
        let terrain = SampledTerrain::new(grid.samples, &faces)?;
        let mesh = terrain.for_view(&faces, &|bounds| view.pixels_of_metre(origin, bounds), allowed)?;
        let of = |face: &u32| triangles[*face as usize];
        let colour = |(face, point): (&u32, &DVec3)| of(face).colour_at(point.truncate());
        let surface = LandSurface {
            heights: mesh.points.iter().map(|point| point.z).collect(),
            colours: mesh.faces.iter().zip(&mesh.points).map(colour).collect(),
            objects: mesh.faces.iter().map(|face| of(face).feature).collect(),
            places: mesh.places,
            triangles: mesh.triangles,
        };
        (surface.triangles.len() < triangles.len()).then_some(Refined { surface, grid, leaves })
    }

    /// A grid with samples on the borders of all leaves. `None` without terrain, or if that needs too many samples.
    fn grid(&self, manifest: &Manifest, origin: [f64; 3]) -> Option<LeafGrid> {
        let level = self.leaves.first()?.leaf.level();
        // Land around the city is in larger nodes.
        if self.leaves.iter().any(|leaf| leaf.leaf.level() != level) {
            return None;
        }
        let places = |axis: fn(TileId) -> u32| {
            let places = || self.leaves.iter().map(|leaf| axis(leaf.leaf));
            Some((places().min()?, places().max()? + 1))
        };
        let (x, y) = (places(TileId::x)?, places(TileId::y)?);
        let side_m = manifest.node_side_m(level);
        let size =
            |leaf_steps: u32| [x, y].map(|(low, high)| ((high - low) * leaf_steps).next_multiple_of(ROOT_STEPS) + 1);
        let count = |leaf_steps: &u32| size(*leaf_steps).map(f64::from).iter().product::<f64>();
        let leaf_steps = [NODE_CELLS as u32, 32, 16].into_iter().find(|steps| count(steps) <= MAX_SAMPLES)?;
        let corner = TileId::new(level, x.0, y.0)?;
        let place = DVec3::from(manifest.node_corner(corner)) - DVec3::from(origin);
        let step = DVec2::splat(side_m / f64::from(leaf_steps));
        let samples = SampleGrid { origin: place.truncate(), step, size: size(leaf_steps) };
        Some(LeafGrid { samples, corner, leaf_steps })
    }
}

/// The features that may become a surface, in the order in which they are tried: all, then the one with the most triangles.
fn choices(triangles: &[Triangle]) -> Vec<BTreeSet<u32>> {
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    triangles.iter().for_each(|triangle| *counts.entry(triangle.feature).or_default() += 1);
    let largest = counts.iter().max_by_key(|(_, count)| **count).map(|(feature, _)| BTreeSet::from([*feature]));
    let all: BTreeSet<u32> = counts.keys().copied().collect();
    let is_several = all.len() > 1;
    std::iter::once(all).chain(largest.filter(|_| is_several)).collect()
}

fn faces<'a>(triangles: &[&'a Triangle]) -> Vec<TerrainFace<'a>> {
    triangles.iter().map(|triangle| TerrainFace { corners: &triangle.corners, normal: triangle.normal }).collect()
}

impl LeafTerrain {
    fn triangles(&self, leaf: usize) -> impl Iterator<Item = Triangle> {
        let geometry = &self.geometry;
        geometry.indices.chunks_exact(3).map(move |triangle| {
            let vertex = |k: usize| triangle[k] as usize;
            let place = |k: usize| DVec3::from(geometry.positions[vertex(k)].map(f64::from));
            let corner = |k: usize| self.matrix.transform_point3(place(k));
            let corners = [0, 1, 2].map(corner);
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            Triangle {
                leaf,
                corners,
                normal,
                colours: [0, 1, 2].map(|k| geometry.colours.get(vertex(k)).copied().unwrap_or([u8::MAX; 3])),
                feature: geometry.features.get(vertex(0)).copied().unwrap_or(NO_FEATURE),
            }
        })
    }
}

impl Triangle {
    /// The colour at a place of the map that is in the triangle.
    fn colour_at(&self, at: DVec2) -> [u8; 3] {
        let [a, b, c] = self.corners.map(|corner| corner.truncate());
        let area = (b - a).perp_dot(c - a);
        let share_b = ((at - a).perp_dot(c - a) / area).clamp(0.0, 1.0);
        let share_c = ((b - a).perp_dot(at - a) / area).clamp(0.0, 1.0 - share_b);
        let [of_a, of_b, of_c] = self.colours;
        [0, 1, 2].map(|k| {
            let mixed = f64::from(of_a[k])
                + share_b * (f64::from(of_b[k]) - f64::from(of_a[k]))
                + share_c * (f64::from(of_c[k]) - f64::from(of_a[k]));
            mixed.round() as u8
        })
    }
}
