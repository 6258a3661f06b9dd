//! The surfaces of a node in a GLB: the triangles of a leaf's mesh, or boxes of columns.

use super::builder::GlbBuilder;
use super::geometry::{Geometry, linear};
use super::matrix::{numbers_of, stretched};
use super::metadata::Rows;
use super::objects::Chooser;
use super::stone::Stones;
use super::{ExportError, boxes};
use crate::column_surfaces;
use crate::land_surface::{LandSurface, has_one_colour, land_of_columns};
use crate::leaves::is_land;
use crate::selection::ObjectSelection;
use crate::table::city::City;
use glam::DAffine3;
use insula_protocol::mesh_tile::{MAX_LODS, NO_OBJECT};
use insula_protocol::{BlockMap, MeshTile, NODE_CELLS, TileId};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Puts parts of a city into GLBs.
pub(crate) struct ContentWriter<'a> {
    city: &'a City<'a>,
    chooser: Chooser<'a>,
    stones: Stones,
}

/// Numbers of vertices by position, attribute and object.
type VertexNumbers = HashMap<(u32, u32, u32), u32>;

/// What a node shows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Shown {
    pub(crate) triangles: usize,
    /// Whether it comes from a mesh, otherwise from columns.
    pub(crate) is_mesh: bool,
}

/// The columns of a node in a view.
pub(super) struct ViewColumns {
    /// Over the corners of cells, with rows of the property table; empty where land is among the boxes.
    pub(super) land: LandSurface,
    pub(super) boxes: Geometry,
    /// From the grid of the boxes to metres from the node's south-west corner at the city's height zero.
    pub(super) grid: DAffine3,
}

impl<'a> ContentWriter<'a> {
    pub(crate) fn new(city: &'a City<'a>, selection: &'a ObjectSelection) -> Self {
        Self { city, chooser: Chooser::new(city, selection), stones: Stones::new(city.manifest) }
    }

    /// Adds the finest that there is of a leaf: its mesh, else its columns. `place` maps metres from the leaf's south-west corner at
    /// the city's height zero to the coordinates of the scene.
    pub(crate) fn add_leaf(
        &self,
        glb: &mut GlbBuilder,
        rows: &mut Rows,
        leaf: TileId,
        place: DAffine3,
    ) -> Result<Shown, ExportError> {
        match (0..MAX_LODS).find_map(|lod| self.city.source.mesh(leaf, lod).transpose()).transpose()? {
            Some(tile) => self.add_mesh(glb, rows, leaf, (&tile, place), &|_| true),
            None => self.add_columns(glb, rows, leaf, place),
        }
    }

    /// Adds the triangles of a leaf's mesh whose objects `has` has.
    pub(super) fn add_mesh(
        &self,
        glb: &mut GlbBuilder,
        rows: &mut Rows,
        leaf: TileId,
        (tile, place): (&MeshTile, DAffine3),
        has: &dyn Fn(u32) -> bool,
    ) -> Result<Shown, ExportError> {
        let parts = self.mesh_geometry(tile, leaf, rows, has)?;
        let triangles = parts.values().map(|geometry| geometry.indices.len() / 3).sum();
        let matrix = numbers_of(place * mesh_matrix(tile));
        for (stone, geometry) in parts {
            let material = match (stone.and_then(|stone| self.stones.material(stone)), &tile.texture) {
                (Some(material), None) => glb.add_material(material),
                (_, Some(texture)) => glb.add_textured_material(texture)?,
                _ => glb.plain_material(),
            };
            let mesh = glb.add_mesh(&geometry, material)?;
            glb.add_node(Some(leaf.to_string()), matrix, mesh);
        }
        Ok(Shown { triangles, is_mesh: true })
    }

    /// The selected triangles of the objects that `has` has by their stone, with one vertex for each different combination of
    /// position, attribute and object.
    pub(super) fn mesh_geometry(
        &self,
        tile: &MeshTile,
        leaf: TileId,
        rows: &mut Rows,
        has: &dyn Fn(u32) -> bool,
    ) -> Result<BTreeMap<Option<u8>, Geometry>, ExportError> {
        let corner = self.city.manifest.node_corner(leaf);
        let positions: Vec<[f64; 3]> = tile.mesh.positions_m().collect();
        let values = tile.mesh.attributes.first().map_or(&[][..], |attribute| &attribute.corners);
        let mut parts: BTreeMap<Option<u8>, (Geometry, VertexNumbers)> = BTreeMap::new();
        for (t, triangle) in tile.mesh.triangles.iter().enumerate() {
            let object = tile.objects.get(t).copied().unwrap_or(NO_OBJECT);
            let middle = [0, 1]
                .map(|k| corner[k] + triangle.iter().map(|vertex| positions[*vertex as usize][k] / 3.0).sum::<f64>());
            if !has(object) || !self.chooser.has(object, middle)? {
                continue;
            }
            let feature = rows.row(object);
            // Textures replace stones.
            let stone = if tile.texture.is_none() { self.stones.of_object(tile, object) } else { None };
            let (geometry, vertices) = parts.entry(stone).or_default();
            for (k, vertex) in triangle.iter().enumerate() {
                let corner = 3 * t + k;
                let value = values.get(corner).copied().unwrap_or(0);
                let next = geometry.positions.len() as u32;
                let index = *vertices.entry((*vertex, value, feature)).or_insert(next);
                if index == next {
                    // The codec has at most 16 bits for a coordinate.
                    geometry.positions.push(tile.mesh.positions[*vertex as usize].map(|at| at as u16));
                    geometry.features.push(feature);
                    if tile.texture.is_some() {
                        let units = |share: f32| (share * f32::from(u16::MAX)).round() as u16;
                        geometry.uv.push(tile.uv(corner).map(units));
                    } else {
                        let colour = tile.rgb(corner).map(linear);
                        geometry.colours.push(self.stones.colour(tile, corner, positions[*vertex as usize], colour));
                    }
                }
                geometry.indices.push(index);
            }
        }
        let finished = |(stone, (mut geometry, _)): (Option<u8>, (Geometry, VertexNumbers))| {
            geometry.drop_empty_features();
            (stone, geometry)
        };
        Ok(parts.into_iter().map(finished).collect())
    }

    /// Adds boxes of a node's columns; nothing if it has none.
    pub(crate) fn add_columns(
        &self,
        glb: &mut GlbBuilder,
        rows: &mut Rows,
        node: TileId,
        place: DAffine3,
    ) -> Result<Shown, ExportError> {
        let Some(map) = self.city.source.columns(node)? else { return Ok(Shown::default()) };
        let grid = boxes::grid(&map);
        let geometry = self.box_geometry(map, node, rows)?;
        let triangles = Self::add_surfaces(glb, node, vec![(geometry, grid)], place)?;
        Ok(Shown { triangles, is_mesh: false })
    }

    /// Adds surfaces of a node. Returns the number of triangles.
    pub(super) fn add_surfaces(
        glb: &mut GlbBuilder,
        node: TileId,
        surfaces: Vec<(Geometry, DAffine3)>,
        place: DAffine3,
    ) -> Result<usize, ExportError> {
        let mut triangles = 0;
        for (geometry, matrix) in surfaces.into_iter().filter(|(geometry, _)| !geometry.indices.is_empty()) {
            triangles += geometry.indices.len() / 3;
            let material = glb.plain_material();
            let mesh = glb.add_mesh(&geometry, material)?;
            glb.add_node(Some(node.to_string()), numbers_of(place * matrix), mesh);
        }
        Ok(triangles)
    }

    /// A node's columns as a view shows them: land of one colour as a surface, all else as boxes. With a selection, everything is boxes.
    /// `None` without columns.
    pub(super) fn view_columns(&self, rows: &mut Rows, node: TileId) -> Result<Option<ViewColumns>, ExportError> {
        let Some(map) = self.city.source.columns(node)? else { return Ok(None) };
        let grid = boxes::grid(&map);
        let land = self.land_objects(&map)?;
        let is_land = |object: u32| land.contains(&object);
        let is_surface = map.ground.is_none() && self.chooser.is_everything && has_one_colour(&map, &is_land);
        if !is_surface {
            let boxes = self.box_geometry(map, node, rows)?;
            return Ok(Some(ViewColumns { land: LandSurface::default(), boxes, grid }));
        }
        let mut surface = land_of_columns(&map, &is_land);
        surface.objects.iter_mut().for_each(|object| *object = rows.row(*object));
        let mut boxes = boxes::boxes(map, &mut |object, _| Ok((!is_land(object)).then(|| rows.row(object))))?;
        boxes.drop_empty_features();
        Ok(Some(ViewColumns { land: surface, boxes, grid }))
    }

    fn land_objects(&self, map: &BlockMap) -> Result<BTreeSet<u32>, ExportError> {
        let mut land = BTreeSet::from([NO_OBJECT]);
        let objects: BTreeSet<u32> = map.objects.iter().flat_map(|objects| column_surfaces::objects(objects)).collect();
        for object in objects {
            if self.city.info(object)?.is_none_or(|info| is_land(info.kind)) {
                land.insert(object);
            }
        }
        Ok(land)
    }

    fn box_geometry(&self, map: BlockMap, node: TileId, rows: &mut Rows) -> Result<Geometry, ExportError> {
        let corner = self.city.manifest.node_corner(node);
        let cell = self.city.manifest.cell_m_at(node.level());
        let mut feature = |object: u32, column: usize| {
            let cells = [column % NODE_CELLS, column / NODE_CELLS];
            let middle = [0, 1].map(|k| corner[k] + (cells[k] as f64 + 0.5) * cell);
            Ok(self.chooser.has(object, middle)?.then(|| rows.row(object)))
        };
        let mut geometry = boxes::boxes(map, &mut feature)?;
        geometry.drop_empty_features();
        Ok(geometry)
    }
}

/// From the grid of a mesh to metres from its leaf's south-west corner at the city's height zero.
pub(super) fn mesh_matrix(tile: &MeshTile) -> DAffine3 {
    let grid = &tile.mesh.grid;
    stretched([grid.step; 3], grid.min)
}
