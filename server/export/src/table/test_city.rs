//! A city for tests: houses on 4 x 4 leaves of 32 m.

use crate::source::{ExportSource, SourceError};
use insula_objects::{
    BLOCK_OBJECTS, FeatureKind, ObjectBlock, ObjectBounds, ObjectRecord, Schema, SchemaBuilder, Value, block,
};
use insula_protocol::blockmap::{ColumnObjects, flag};
use insula_protocol::manifest::{Attribution, HeightReference};
use insula_protocol::mesh::{Mesh, PositionGrid};
use insula_protocol::subtree::{MeshLod, NodeInfo, NodeMesh};
use insula_protocol::{BlockMap, Manifest, MeshTile, NODE_CELLS, Subtree, TileId};
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
/// Of the city of a pond.
pub(crate) const POND: u32 = 0;

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
        attribution: vec![source],
        tile_version: 1,
        heights: Some(HeightReference { datum: "EPSG:5709".into(), geoid: None }),
        ..Manifest::default()
    }
}

/// A city in memory.
pub(crate) struct TestCity {
    pub(crate) manifest: Manifest,
    schema: Schema,
    blocks: HashMap<u32, Vec<u8>>,
    has_meshes: bool,
    /// Triangles in metres from the city's corner, in place of the boxes.
    triangles: Vec<(u32, [[f64; 3]; 3])>,
    /// A node without children whose columns all show [`POND`] at 5 m.
    plain: Option<TileId>,
}

impl TestCity {
    /// With meshes, or with columns only.
    pub(crate) fn new(has_meshes: bool) -> Self {
        Self { has_meshes, ..Self::of(records(), Vec::new()) }
    }

    /// Houses with gable roofs at any angle, some of them across the leaves' borders: 6 x 6, each 12 x 8 x 7 m. Their leaves are 32 m,
    /// and their meshes have the precision of 16 bits of the leaf.
    pub(crate) fn of_rotated_houses() -> Self {
        let (mut triangles, mut houses) = (Vec::new(), Vec::new());
        for house in 0..36u32 {
            let angle = f64::from(house) * 0.37;
            let middle = [12.0 + f64::from(house % 6) * 20.3, 12.0 + f64::from(house / 6) * 20.3];
            let at = |x: f64, y: f64, z: f64| {
                [middle[0] + x * angle.cos() - y * angle.sin(), middle[1] + x * angle.sin() + y * angle.cos(), z]
            };
            let [a, b, c, d] =
                [(-6.0, -4.0), (6.0, -4.0), (6.0, 4.0), (-6.0, 4.0)].map(|(x, y)| [at(x, y, 5.0), at(x, y, 9.0)]);
            let [e, f] = [at(-6.0, 0.0, 12.0), at(6.0, 0.0, 12.0)];
            let quads = [
                [a[1], b[1], f, e],
                [c[1], d[1], e, f],
                [a[0], b[0], b[1], a[1]],
                [b[0], c[0], c[1], b[1]],
                [c[0], d[0], d[1], c[1]],
                [d[0], a[0], a[1], d[1]],
                [a[0], d[0], c[0], b[0]],
            ];
            let of_quads = quads.iter().flat_map(|[p, q, r, s]| [[*p, *q, *r], [*p, *r, *s]]);
            let gables = [[b[1], c[1], f], [d[1], a[1], e]];
            triangles.extend(of_quads.chain(gables).map(|triangle| (house, triangle)));
            let decimetres = |v: f64| (v * 10.0) as i32;
            let bounds = ObjectBounds {
                min: [decimetres(middle[0] - 7.3), decimetres(middle[1] - 7.3), 50],
                max: [decimetres(middle[0] + 7.3), decimetres(middle[1] + 7.3), 120],
            };
            let record = ObjectRecord {
                identifier: format!("h{house}"),
                kind: FeatureKind::Building,
                parent: None,
                bounds: Some(bounds),
                attributes: Vec::new(),
            };
            houses.push((house, record, Vec::new()));
        }
        Self { has_meshes: true, ..Self::of(houses, triangles) }
    }

    /// A pond of 64 x 68 m, of which a plain node has all but a strip.
    pub(crate) fn of_a_pond() -> Self {
        let [a, b, c, d] = [[64.0, 60.0], [128.0, 60.0], [128.0, 64.0], [64.0, 64.0]].map(|[x, y]| [x, y, 5.0]);
        let bounds = ObjectBounds { min: [640, 600, 50], max: [1280, 1280, 50] };
        let (parent, attributes) = (None, Vec::new());
        let kind = FeatureKind::Water;
        let record = ObjectRecord { identifier: "pond".to_owned(), kind, parent, bounds: Some(bounds), attributes };
        let all = Self::of(vec![(POND, record, Vec::new())], vec![(POND, [a, b, c]), (POND, [a, c, d])]);
        Self { has_meshes: true, plain: TileId::new(1, 1, 1), ..all }
    }

    fn of(records: Vec<(u32, ObjectRecord, Attributes)>, triangles: Vec<(u32, [[f64; 3]; 3])>) -> Self {
        let mut builder = SchemaBuilder::default();
        for (name, value) in records.iter().flat_map(|(_, _, attributes)| attributes) {
            builder.add(name, value);
        }
        builder.set_unit("eaves", "m");
        let schema = builder.finish(records.last().map_or(0, |(object, ..)| object + 1));
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
        let encode = |(number, rows): (u32, Vec<_>)| (number, block::encode(number, &rows, &schema).unwrap());
        let blocks = blocks.into_iter().map(encode).collect();
        Self { manifest: manifest(2), schema, blocks, has_meshes: false, triangles, plain: None }
    }

    fn mesh_of(&self, leaf: TileId) -> Option<MeshTile> {
        if self.triangles.is_empty() {
            return mesh_of(leaf);
        }
        let corner = [f64::from(leaf.x()) * 32.0, f64::from(leaf.y()) * 32.0];
        let (mut positions, mut triangles, mut objects): (Vec<[f64; 3]>, _, _) = (Vec::new(), Vec::new(), Vec::new());
        for (object, triangle) in &self.triangles {
            let polygon = cut(triangle.map(|[x, y, z]| [x - corner[0], y - corner[1], z]).to_vec());
            for i in 2..polygon.len() {
                let number = |position: [f64; 3]| {
                    positions.push(position);
                    positions.len() as u32 - 1
                };
                triangles.push([polygon[0], polygon[i - 1], polygon[i]].map(number));
                objects.push(*object);
            }
        }
        if positions.is_empty() {
            return None;
        }
        let grid = PositionGrid::enclosing(&positions, 16);
        let positions = positions.iter().map(|position| grid.nearest(*position)).collect();
        Some(MeshTile {
            mesh: Mesh { grid, positions, triangles, attributes: Vec::new() },
            texture: None,
            objects,
            landmarks: Vec::new(),
        })
    }
}

/// The part of a polygon in a leaf: 0 to 32 m in x and y.
fn cut(mut polygon: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    for (axis, sign, border) in [(0, 1.0, 0.0), (0, -1.0, 32.0), (1, 1.0, 0.0), (1, -1.0, 32.0)] {
        let inside = |p: &[f64; 3]| sign * (p[axis] - border);
        let mut next = Vec::new();
        for (i, p) in polygon.iter().enumerate() {
            let q = polygon[(i + 1) % polygon.len()];
            let (u, v) = (inside(p), inside(&q));
            if u >= 0.0 {
                next.push(*p);
            }
            if (u > 0.0 && v < 0.0) || (u < 0.0 && v > 0.0) {
                next.push([0, 1, 2].map(|k| p[k] + u / (u - v) * (q[k] - p[k])));
            }
        }
        polygon = next;
    }
    polygon
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
        ("built", Value::Date(-27_577)),
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
        (
            BRIDGE,
            record(BRIDGE, "bridge", FeatureKind::Bridge, None),
            vec![
                ("eaves", Value::Float(-3.5)),
                ("name", text("=HYPERLINK(\"http://a\")")),
                ("Height_M", Value::Integer(1)),
            ],
        ),
        (HEDGE, record(HEDGE, "hedge", FeatureKind::Vegetation, None), vec![("name", text("-3.5"))]),
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
    Some(MeshTile {
        mesh: Mesh { grid, positions, triangles, attributes: Vec::new() },
        texture: None,
        objects,
        landmarks: Vec::new(),
    })
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

/// The columns of a plain node of 64 m.
fn pond(node: TileId) -> BlockMap {
    let mut map = BlockMap::empty(node, 1.0, 0, 0);
    map.flags.fill(flag::OCCUPIED);
    // A code is a sixteenth of a metre.
    map.z_max.fill(5 * 16);
    let mut objects = ColumnObjects::default();
    objects.roof.fill(POND);
    map.objects = Some(Box::new(objects));
    map
}

impl ExportSource for TestCity {
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
            let has_children = id.level() < self.manifest.depth && self.plain != Some(id);
            let child_mask = if has_children { 15 } else { 0 };
            ids.extend(id.children().filter(|_| child_mask > 0));
            let [z_min_m, z_max_m, error_m, radius_m] = [0.0, 40.0, 1.0, 100.0];
            subtree.nodes.push(NodeInfo { id, child_mask, z_min_m, z_max_m, error_m, radius_m, blockmap_bytes: 1 });
            if id.level() == self.manifest.depth && self.has_meshes && self.mesh_of(id).is_some() {
                let lods = vec![MeshLod { error_m: 0.0, bytes: 1, triangles: 1, texture_px: 0 }];
                subtree.meshes.push(NodeMesh { id, lods });
            }
        }
        Ok(Some(subtree))
    }

    fn columns(&self, node: TileId) -> Result<Option<BlockMap>, SourceError> {
        Ok(Some(if self.plain == Some(node) { pond(node) } else { columns_of(node) }))
    }

    fn mesh(&self, leaf: TileId, lod: u8) -> Result<Option<MeshTile>, SourceError> {
        Ok(self.mesh_of(leaf).filter(|_| lod == 0 && self.has_meshes))
    }
}
