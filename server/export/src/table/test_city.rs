//! A city for tests: houses on 4 x 4 leaves of 32 m.

use crate::source::{CitySource, SourceError};
use insula_objects::{
    BLOCK_OBJECTS, FeatureKind, ObjectBlock, ObjectBounds, ObjectRecord, Schema, SchemaBuilder, Value, block,
};
use insula_protocol::{
    BlockMap, Manifest, MeshTile, NODE_CELLS, Subtree, TileId,
    blockmap::{ColumnObjects, flag},
    manifest::{Attribution, CityCounts, HeightReference},
    mesh::{Mesh, PositionGrid},
    subtree::{MeshLod, NodeInfo, NodeMesh},
};
use std::collections::HashMap;

pub(crate) const ORIGIN: [f64; 3] = [84_000.0, 446_000.0, -5.0];
/// Numbers of the objects.
pub(crate) const HOUSE: u32 = 0;
pub(crate) const BUILDING: u32 = 1;
pub(crate) const PARTS: [u32; 2] = [2, 3];
pub(crate) const COURT: u32 = 4;
pub(crate) const GHOST: u32 = 5;
pub(crate) const BRIDGE: u32 = 6;
pub(crate) const HEDGE: u32 = 600;

/// Rectangles of the objects in metres from the city's corner, with lower and upper end above it.
const SHAPES: [(u32, [f64; 4], [f64; 2]); 9] = [
    (HOUSE, [4.0, 4.0, 14.0, 12.0], [5.0, 14.0]),
    (PARTS[0], [28.0, 4.0, 36.0, 12.0], [5.0, 11.0]),
    (PARTS[1], [36.0, 4.0, 44.0, 12.0], [5.0, 17.0]),
    (COURT, [50.0, 50.0, 78.0, 60.0], [5.0, 20.0]),
    (COURT, [50.0, 68.0, 78.0, 78.0], [5.0, 20.0]),
    (COURT, [50.0, 60.0, 60.0, 68.0], [5.0, 20.0]),
    (COURT, [68.0, 60.0, 78.0, 68.0], [5.0, 20.0]),
    (BRIDGE, [90.0, 90.0, 120.0, 94.0], [10.0, 11.0]),
    (HEDGE, [100.0, 10.0, 104.0, 14.0], [5.0, 7.0]),
];

/// A manifest of a city of leaves of 32 m at level `depth`.
pub(crate) fn manifest(depth: u8) -> Manifest {
    let side = 32.0 * f64::from(1u32 << depth);
    let [x, y, z] = ORIGIN;
    let source = Attribution {
        text: "Gemeente \"Ä\"".into(),
        licence: Some("CC BY 4.0".into()),
        url: Some("https://example.org".into()),
    };
    Manifest {
        format_version: insula_protocol::manifest::FORMAT_VERSION,
        name: "town".into(),
        title: "Town".into(),
        version: "0123456789abcdef".into(),
        crs: Some("EPSG:7415".into()),
        origin: ORIGIN,
        root_side_m: side,
        depth,
        node_cells: NODE_CELLS as u16,
        cell_m: 0.5,
        bounds: [[x, y, z], [x + side, y + side, z + 40.0]],
        focus: [[x, y], [x + side, y + side]],
        ground_z_m: 0.0,
        has_terrain: false,
        generated_ground: false,
        counts: CityCounts::default(),
        attribution: vec![source],
        tile_version: 1,
        settings: String::new(),
        location: None,
        generated_facades: false,
        heights: Some(HeightReference { datum: "EPSG:5709".into(), geoid: None }),
    }
}

/// A city in memory.
pub(crate) struct TestCity {
    pub(crate) manifest: Manifest,
    schema: Schema,
    blocks: HashMap<u32, Vec<u8>>,
    has_meshes: bool,
}

impl TestCity {
    /// With meshes, or with columns only.
    pub(crate) fn new(has_meshes: bool) -> Self {
        let records = records();
        let mut builder = SchemaBuilder::default();
        for (name, value) in records.iter().flat_map(|(_, _, attributes)| attributes) {
            builder.add(name, value);
        }
        builder.set_unit("eaves", "m");
        let schema = builder.finish(HEDGE + 1);
        let mut blocks: HashMap<u32, Vec<Option<ObjectRecord>>> = HashMap::new();
        for (object, mut record, attributes) in records {
            record.attributes = attributes
                .into_iter()
                .map(|(name, value)| (schema.index_of(name).unwrap(), value))
                .map(|(index, value)| (index as u32, schema.convert(index, &value)))
                .collect();
            record.attributes.sort_by_key(|(index, _)| *index);
            let rows = blocks.entry(object / BLOCK_OBJECTS as u32).or_default();
            rows.resize(object as usize % BLOCK_OBJECTS + 1, None);
            *rows.last_mut().unwrap() = Some(record);
        }
        let blocks =
            blocks.into_iter().map(|(number, rows)| (number, block::encode(number, &rows, &schema).unwrap())).collect();
        Self { manifest: manifest(2), schema, blocks, has_meshes }
    }
}

type Attributes = Vec<(&'static str, Value)>;

fn records() -> Vec<(u32, ObjectRecord, Attributes)> {
    let record = |object: u32, identifier: &str, kind: FeatureKind, parent: Option<u32>| ObjectRecord {
        identifier: identifier.into(),
        kind,
        parent,
        bounds: bounds(object),
        attributes: Vec::new(),
    };
    let text = |text: &str| Value::Text(text.into());
    let house = vec![
        ("year", Value::Integer(1894)),
        ("eaves", Value::Float(7.25)),
        ("name", text("Huis \"Ä\", oud\n东京")),
        ("listed", Value::Bool(true)),
        ("built", Value::Date(-27_576)),
    ];
    let ghost = ObjectRecord {
        bounds: Some(ObjectBounds { min: [1000, 1000, 0], max: [1010, 1010, 10] }),
        ..record(GHOST, "ghost", FeatureKind::Generic, None)
    };
    vec![
        (HOUSE, record(HOUSE, "b-a", FeatureKind::Building, None), house),
        (BUILDING, record(BUILDING, "b-b", FeatureKind::Building, None), vec![("year", Value::Integer(2001))]),
        (PARTS[0], record(PARTS[0], "b-b-1", FeatureKind::BuildingPart, Some(BUILDING)), Vec::new()),
        (
            PARTS[1],
            record(PARTS[1], "b-b-2", FeatureKind::BuildingPart, Some(BUILDING)),
            vec![("eaves", Value::Float(12.0))],
        ),
        (COURT, record(COURT, "", FeatureKind::Building, None), vec![("listed", Value::Bool(false))]),
        (GHOST, ghost, vec![("name", text("nowhere"))]),
        (BRIDGE, record(BRIDGE, "bridge", FeatureKind::Bridge, None), vec![("Height_M", Value::Integer(1))]),
        (HEDGE, record(HEDGE, "hedge", FeatureKind::Vegetation, None), Vec::new()),
    ]
}

fn bounds(object: u32) -> Option<ObjectBounds> {
    let shapes = SHAPES.iter().filter(|(other, ..)| *other == object);
    shapes.fold(None, |bounds: Option<ObjectBounds>, (_, [x0, y0, x1, y1], [z0, z1])| {
        let decimetres = |corner: [f64; 3]| corner.map(|v| (v * 10.0) as i32);
        let (min, max) = (decimetres([*x0, *y0, *z0]), decimetres([*x1, *y1, *z1]));
        let known = bounds.unwrap_or(ObjectBounds { min, max });
        Some(ObjectBounds {
            min: [0, 1, 2].map(|k| known.min[k].min(min[k])),
            max: [0, 1, 2].map(|k| known.max[k].max(max[k])),
        })
    })
}

/// The triangles of all boxes in a leaf, cut at its border, with their objects. Boxes have no floors.
fn mesh_of(leaf: TileId) -> Option<MeshTile> {
    let corner = [f64::from(leaf.x()) * 32.0, f64::from(leaf.y()) * 32.0];
    let (mut quads, mut objects) = (Vec::new(), Vec::new());
    for (object, [x0, y0, x1, y1], [z0, z1]) in SHAPES {
        let [a, b] =
            [x0, y0].map(|v| v).iter().zip(corner).map(|(v, c)| v.max(c)).collect::<Vec<_>>().try_into().unwrap();
        let [c, d] = [x1, y1].iter().zip(corner).map(|(v, c)| v.min(c + 32.0)).collect::<Vec<_>>().try_into().unwrap();
        if a >= c || b >= d {
            continue;
        }
        let (a, b, c, d): (f64, f64, f64, f64) = (a, b, c, d);
        let mut faces = vec![[[a, b, z1], [c, b, z1], [c, d, z1], [a, d, z1]]];
        let walls = [
            (b == y0, [a, b], [c, b]),
            (c == x1, [c, b], [c, d]),
            (d == y1, [c, d], [a, d]),
            (a == x0, [a, d], [a, b]),
        ];
        for (_, [px, py], [qx, qy]) in walls.into_iter().filter(|(is_wall, ..)| *is_wall) {
            faces.push([[px, py, z0], [qx, qy, z0], [qx, qy, z1], [px, py, z1]]);
        }
        for face in faces {
            quads.push(face.map(|[x, y, z]: [f64; 3]| [x - corner[0], y - corner[1], z]));
            objects.extend([object; 2]);
        }
    }
    let positions: Vec<[f64; 3]> = quads.into_iter().flatten().collect();
    if positions.is_empty() {
        return None;
    }
    let grid = PositionGrid::enclosing(&positions, 16);
    let triangles =
        (0..positions.len() as u32).step_by(4).flat_map(|i| [[i, i + 1, i + 2], [i, i + 2, i + 3]]).collect();
    let positions = positions.iter().map(|position| grid.nearest(*position)).collect();
    Some(MeshTile { mesh: Mesh { grid, positions, triangles, attributes: Vec::new() }, texture: None, objects })
}

/// The columns of a leaf: tops and objects of the boxes.
fn columns_of(leaf: TileId) -> BlockMap {
    let mut map = BlockMap::empty(leaf, 0.5, 0, 0);
    let mut objects = ColumnObjects::default();
    for cell in 0..NODE_CELLS * NODE_CELLS {
        let middle = |v: usize, corner: u32| (v as f64 + 0.5) * 0.5 + f64::from(corner) * 32.0;
        let (x, y) = (middle(cell % NODE_CELLS, leaf.x()), middle(cell / NODE_CELLS, leaf.y()));
        let shape = SHAPES.iter().find(|(_, [x0, y0, x1, y1], _)| *x0 < x && x < *x1 && *y0 < y && y < *y1);
        if let Some((object, _, [z0, z1])) = shape {
            map.flags[cell] = flag::OCCUPIED;
            // A code is a sixteenth of half a metre.
            (map.z_min[cell], map.z_max[cell]) = ((z0 * 32.0) as u16, (z1 * 32.0) as u16);
            objects.roof[cell] = *object;
        }
    }
    map.objects = Some(Box::new(objects));
    map
}

impl CitySource for TestCity {
    fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    fn schema(&self) -> &Schema {
        &self.schema
    }

    fn objects(&self, block: u32) -> Result<Option<ObjectBlock>, SourceError> {
        Ok(self.blocks.get(&block).map(|bytes| ObjectBlock::decode(block, bytes, &self.schema).unwrap()))
    }

    fn subtree(&self, root: TileId) -> Result<Option<Subtree>, SourceError> {
        let mut ids = vec![root];
        let mut subtree = Subtree::default();
        let mut next = 0;
        while let Some(&id) = ids.get(next) {
            next += 1;
            let child_mask = if id.level() < self.manifest.depth { 15 } else { 0 };
            ids.extend(id.children().filter(|_| child_mask > 0));
            let [z_min_m, z_max_m, error_m, radius_m] = [0.0, 40.0, 1.0, 100.0];
            subtree.nodes.push(NodeInfo { id, child_mask, z_min_m, z_max_m, error_m, radius_m, blockmap_bytes: 1 });
            if child_mask == 0 && self.has_meshes && mesh_of(id).is_some() {
                let lods = vec![MeshLod { error_m: 0.0, bytes: 1, triangles: 1, texture_px: 0 }];
                subtree.meshes.push(NodeMesh { id, lods });
            }
        }
        Ok(Some(subtree))
    }

    fn columns(&self, node: TileId) -> Result<Option<BlockMap>, SourceError> {
        Ok(Some(columns_of(node)))
    }

    fn mesh(&self, leaf: TileId, lod: u8) -> Result<Option<MeshTile>, SourceError> {
        Ok(mesh_of(leaf).filter(|_| lod == 0 && self.has_meshes))
    }
}
