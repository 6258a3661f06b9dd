//! The meshes of a city leaf by leaf, for programs that need its surfaces.

use crate::column_surfaces;
use crate::selection::ObjectSelection;
use crate::source::ExportSource;
use crate::table::city::City;
use crate::table::gather::LeafPositions;
use crate::table::grid::node_area;
use crate::table::{EndNode, ExportError, visit_end_nodes};
use insula_objects::FeatureKind;
use insula_protocol::mesh_tile::NO_OBJECT;
use insula_protocol::{MeshTile, TileId};
use insula_shaders::mesh::packed_order;
use std::collections::{BTreeSet, HashMap};

/// The mesh of a leaf or of another node without children.
#[derive(Debug)]
pub struct LeafSurfaces {
    pub leaf: TileId,
    /// Lower and upper corner of the leaf on the map, in world metres.
    pub area: [[f64; 2]; 2],
    /// World metres, one for each vertex of `tile`. Vertices at the leaf's border are exactly on it.
    pub positions: Vec<[f64; 3]>,
    /// Level of detail of `tile`; 0 is the finest. `None` if the node has no mesh and `tile` is made of its columns.
    pub lod: Option<u8>,
    pub tile: MeshTile,
}

impl LeafSurfaces {
    /// Numbers of the triangles: of several in one place, ray-casters show the first one.
    #[must_use]
    pub fn order(&self) -> Vec<u32> {
        packed_order(&self.tile.mesh).unwrap_or_else(|| (0..self.tile.mesh.triangles.len() as u32).collect())
    }
}

/// An object that a mesh shows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeafObject {
    /// [`NO_OBJECT`] for what belongs to none, such as terrain.
    pub number: u32,
    pub kind: FeatureKind,
    /// Of the source; empty if it has none.
    pub identifier: String,
    /// Whether it is selected wherever its triangles are. Of land without an object, only the selection's area is shown.
    pub is_selected: bool,
}

/// Reads objects of a city by number.
pub struct LeafObjects<'a> {
    city: City<'a>,
    selection: &'a ObjectSelection,
    known: HashMap<u32, LeafObject>,
}

impl<'a> LeafObjects<'a> {
    /// The objects of `source`, of which `selection` selects some.
    pub fn new(source: &'a dyn ExportSource, selection: &'a ObjectSelection) -> Self {
        Self { city: City::new(source), selection, known: HashMap::new() }
    }

    /// The object of a number. Fails if its block cannot be read.
    pub fn get(&mut self, number: u32) -> Result<&LeafObject, ExportError> {
        if !self.known.contains_key(&number) {
            let object = self.read(number)?;
            self.known.insert(number, object);
        }
        Ok(&self.known[&number])
    }

    /// The building, bridge or tunnel that an object is a part of, itself if it is none. Fails if its block cannot be read.
    pub fn whole(&self, number: u32) -> Result<u32, ExportError> {
        Ok(self.city.whole_of(number)?)
    }

    fn read(&self, number: u32) -> Result<LeafObject, ExportError> {
        let Some(info) = self.city.info(number)? else {
            let is_selected = self.selection.objects.is_none();
            return Ok(LeafObject { number, kind: FeatureKind::Relief, identifier: String::new(), is_selected });
        };
        // A part belongs where its building is, so that no building is cut.
        let root = self.city.ancestors(number)?.last().copied().unwrap_or(number);
        let bounds = self.city.info(root)?.and_then(|info| info.bounds).or(info.bounds);
        let is_land = is_land(info.kind);
        let is_selected = if is_land {
            self.selection.contains_object(number)
        } else {
            self.selection.contains_object(number) && (bounds.is_none() || self.selection.contains(number, bounds))
        };
        Ok(LeafObject { number, kind: info.kind, identifier: self.city.identifier(number)?, is_selected })
    }
}

/// Whether objects of a kind extend over the land, so that a part of the map shows a part of them.
#[must_use]
pub fn is_land(kind: FeatureKind) -> bool {
    use FeatureKind::{LandUse, Rail, Relief, Road, Water};
    matches!(kind, Relief | LandUse | Road | Rail | Water)
}

/// Passes the mesh of each leaf that `area` touches to `visit`, in the order of a Hilbert curve: the coarsest level of detail whose
/// error is at most `error_m`, or the finest one. Leaves and other end nodes without a mesh have those of their columns: land
/// as one surface, and all else as boxes. Fails if tiles cannot be read, and with the error of `visit`.
pub fn visit_leaf_meshes<E: From<ExportError>>(
    source: &dyn ExportSource,
    area: [[f64; 2]; 2],
    error_m: f64,
    visit: &mut dyn FnMut(LeafSurfaces) -> Result<(), E>,
) -> Result<(), E> {
    let city = City::new(source);
    let mut failure = None;
    let walked = visit_end_nodes(source, area, &mut |node: EndNode| {
        if failure.is_some() {
            return Ok(());
        }
        let finest_first = || node.lod_errors_m.iter();
        let lod = finest_first().rposition(|error| f64::from(*error) <= error_m).unwrap_or(0) as u8;
        let mesh = if node.has_mesh { source.mesh(node.id, lod)? } else { None };
        let tiles = match mesh {
            Some(mesh) => vec![(Some(lod), mesh)],
            None => meshes_of_columns(&city, node.id)?.into_iter().map(|mesh| (None, mesh)).collect(),
        };
        let area = node_area(city.manifest, node.id);
        for (lod, tile) in tiles.into_iter().filter(|(_, tile)| !tile.mesh.triangles.is_empty()) {
            let LeafPositions { world: positions, .. } = LeafPositions::of(&city, node.id, &tile);
            failure = visit(LeafSurfaces { leaf: node.id, area, positions, lod, tile }).err();
            if failure.is_some() {
                break;
            }
        }
        Ok(())
    });
    walked?;
    failure.map_or(Ok(()), Err)
}

/// The meshes of a node's columns: land and all else.
fn meshes_of_columns(city: &City<'_>, node: TileId) -> Result<Vec<MeshTile>, ExportError> {
    let Some(map) = city.source.columns(node)? else { return Ok(Vec::new()) };
    let mut land = BTreeSet::from([NO_OBJECT]);
    let objects: BTreeSet<u32> = map.objects.iter().flat_map(|objects| column_surfaces::objects(objects)).collect();
    for object in objects {
        if city.info(object)?.is_some_and(|info| is_land(info.kind)) {
            land.insert(object);
        }
    }
    Ok(column_surfaces::column_meshes(map, &|object| land.contains(&object))?.into())
}
