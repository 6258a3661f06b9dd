//! The surfaces of a node in a GLB: the triangles of a leaf's mesh, or boxes of columns.

use super::{
    ExportError, boxes,
    builder::GlbBuilder,
    geometry::{Geometry, NO_FEATURE, linear},
    matrix::Matrix,
    metadata::Rows,
    objects::{Chooser, ObjectReader},
    stone::Stones,
};
use crate::{selection::ObjectSelection, source::ExportSource};
use insula_protocol::{
    BlockMap, MeshTile, NODE_CELLS, TileId,
    mesh_tile::{MAX_LODS, NO_OBJECT},
};
use std::collections::{BTreeMap, HashMap};

/// Puts parts of a city into GLBs.
pub(crate) struct ContentWriter<'a> {
    source: &'a dyn ExportSource,
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

impl<'a> ContentWriter<'a> {
    pub(crate) fn new(
        source: &'a dyn ExportSource,
        selection: &'a ObjectSelection,
        reader: &'a ObjectReader<'a>,
    ) -> Self {
        Self { source, chooser: Chooser::new(selection, reader), stones: Stones::new(source.manifest()) }
    }

    /// Adds the finest that there is of a leaf: its mesh, else its columns. `place` maps metres from the leaf's south-west corner at
    /// the city's height zero to the coordinates of the scene.
    pub(crate) fn add_leaf(
        &self,
        glb: &mut GlbBuilder,
        rows: &mut Rows,
        leaf: TileId,
        place: &Matrix,
    ) -> Result<Shown, ExportError> {
        match (0..MAX_LODS).find_map(|lod| self.source.mesh(leaf, lod).transpose()).transpose()? {
            Some(tile) => self.add_mesh(glb, rows, leaf, (&tile, place)),
            None => self.add_columns(glb, rows, leaf, place),
        }
    }

    fn add_mesh(
        &self,
        glb: &mut GlbBuilder,
        rows: &mut Rows,
        leaf: TileId,
        (tile, place): (&MeshTile, &Matrix),
    ) -> Result<Shown, ExportError> {
        let parts = self.mesh_geometry(tile, leaf, rows)?;
        let triangles = parts.values().map(|geometry| geometry.indices.len() / 3).sum();
        let grid = &tile.mesh.grid;
        let matrix = Matrix::scale([grid.step; 3]).then(&Matrix::translation(grid.min)).then(place).to_array();
        for (stone, geometry) in parts {
            let material = match (stone.and_then(|stone| self.stones.material(stone)), &tile.texture) {
                (Some(material), None) => glb.add_material(material),
                (_, Some(texture)) => glb.add_textured_material(&texture.bytes),
                _ => glb.plain_material(),
            };
            let mesh = glb.add_mesh(&geometry, material)?;
            glb.add_node(Some(leaf.to_string()), matrix, mesh);
        }
        Ok(Shown { triangles, is_mesh: true })
    }

    /// The selected triangles by their stone, with one vertex for each different combination of position, attribute and object.
    fn mesh_geometry(
        &self,
        tile: &MeshTile,
        leaf: TileId,
        rows: &mut Rows,
    ) -> Result<BTreeMap<Option<u8>, Geometry>, ExportError> {
        let corner = self.source.manifest().node_corner(leaf);
        let positions: Vec<[f64; 3]> = tile.mesh.positions_m().collect();
        let values = tile.mesh.attributes.first().map_or(&[][..], |attribute| &attribute.corners);
        let mut parts: BTreeMap<Option<u8>, (Geometry, VertexNumbers)> = BTreeMap::new();
        for (t, triangle) in tile.mesh.triangles.iter().enumerate() {
            let object = tile.objects.get(t).copied().unwrap_or(NO_OBJECT);
            let middle = [0, 1]
                .map(|k| corner[k] + triangle.iter().map(|vertex| positions[*vertex as usize][k] / 3.0).sum::<f64>());
            if !self.chooser.has(object, middle)? {
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
        Ok(parts.into_iter().map(|(stone, (geometry, _))| (stone, without_empty_features(geometry))).collect())
    }

    /// Adds boxes of a node's columns; nothing if it has none.
    pub(crate) fn add_columns(
        &self,
        glb: &mut GlbBuilder,
        rows: &mut Rows,
        node: TileId,
        place: &Matrix,
    ) -> Result<Shown, ExportError> {
        let Some(map) = self.source.columns(node)? else { return Ok(Shown::default()) };
        let grid = boxes::grid(&map);
        let geometry = self.box_geometry(map, node, rows)?;
        let triangles = geometry.indices.len() / 3;
        if triangles > 0 {
            let material = glb.plain_material();
            let mesh = glb.add_mesh(&geometry, material)?;
            glb.add_node(Some(node.to_string()), grid.then(place).to_array(), mesh);
        }
        Ok(Shown { triangles, is_mesh: false })
    }

    fn box_geometry(&self, map: BlockMap, node: TileId, rows: &mut Rows) -> Result<Geometry, ExportError> {
        let corner = self.source.manifest().node_corner(node);
        let cell = self.source.manifest().cell_m_at(node.level());
        let mut feature = |object: u32, column: usize| {
            let cells = [column % NODE_CELLS, column / NODE_CELLS];
            let middle = [0, 1].map(|k| corner[k] + (cells[k] as f64 + 0.5) * cell);
            Ok(self.chooser.has(object, middle)?.then(|| rows.row(object)))
        };
        Ok(without_empty_features(boxes::boxes(map, &mut feature)?))
    }
}

/// Without feature ids if no vertex has an object.
fn without_empty_features(mut geometry: Geometry) -> Geometry {
    if geometry.features.iter().all(|feature| *feature == NO_FEATURE) {
        geometry.features.clear();
    }
    geometry
}
