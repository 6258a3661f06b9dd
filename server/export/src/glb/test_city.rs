//! A synthetic city for tests: four leaves of 64 m, houses as columns and as meshes, objects with attributes.

use crate::source::{ExportSource, SourceError};
use insula_objects::{
    BLOCK_OBJECTS, FeatureKind, ObjectBlock, ObjectBounds, ObjectRecord, Schema, SchemaBuilder, Value, block,
};
use insula_protocol::blockmap::{COLUMNS, ColumnObjects, MapColumn, NO_OBJECT, WallStrip, strip_rows};
use insula_protocol::manifest::{Attribution, FORMAT_VERSION};
use insula_protocol::mesh_tile::{TileTexture, cuboid};
use insula_protocol::subtree::{MeshLod, NodeInfo, NodeMesh};
use insula_protocol::{BlockMap, Manifest, MeshTile, NODE_CELLS, Subtree, Texel, TileId};
use std::collections::{BTreeMap, BTreeSet};

/// A city of `depth` levels below the root at an arbitrary place.
pub(crate) fn manifest(depth: u8, cell_m: f64) -> Manifest {
    let side = cell_m * NODE_CELLS as f64 * f64::from(1u32 << depth);
    let origin = [1000.0, 2000.0, 30.0];
    Manifest {
        format_version: FORMAT_VERSION,
        name: "town".into(),
        title: "Town".into(),
        version: "0123456789abcdef".into(),
        crs: Some("EPSG:28992".into()),
        origin,
        root_side_m: side,
        depth,
        node_cells: NODE_CELLS as u16,
        cell_m,
        bounds: [origin, [origin[0] + side, origin[1] + side, 60.0]],
        focus: [[origin[0], origin[1]], [origin[0] + side, origin[1] + side]],
        ground_z_m: 31.0,
        has_terrain: true,
        attribution: vec![Attribution { text: "Town Hall".into(), licence: Some("CC BY 4.0".into()), url: None }],
        tile_version: 4,
        ..Manifest::default()
    }
}

/// Object of the terrain. Houses are objects 1, 2, ...
pub(crate) const TERRAIN: u32 = 0;
const HOUSES: u32 = 5;

/// The city. Tests may remove or break parts of it.
pub(crate) struct TestCity {
    pub(crate) manifest: Manifest,
    pub(crate) schema: Schema,
    pub(crate) blocks: BTreeMap<u32, Vec<u8>>,
    pub(crate) subtrees: BTreeMap<TileId, Subtree>,
    pub(crate) columns: BTreeMap<TileId, BlockMap>,
    pub(crate) meshes: BTreeMap<TileId, MeshTile>,
    /// Tiles that cannot be read.
    pub(crate) broken: BTreeSet<TileId>,
}

impl ExportSource for TestCity {
    fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    fn schema(&self) -> &Schema {
        &self.schema
    }

    fn objects(&self, block: u32) -> Result<Option<ObjectBlock>, SourceError> {
        let decode = |bytes: &Vec<u8>| ObjectBlock::decode(block, bytes, &self.schema);
        let decoded = self.blocks.get(&block).map(decode).transpose();
        decoded.map_err(|error| SourceError { what: format!("objects {block}"), reason: error.to_string() })
    }

    fn subtree(&self, root: TileId) -> Result<Option<Subtree>, SourceError> {
        self.check(root)?;
        Ok(self.subtrees.get(&root).cloned())
    }

    fn columns(&self, node: TileId) -> Result<Option<BlockMap>, SourceError> {
        self.check(node)?;
        Ok(self.columns.get(&node).cloned())
    }

    fn mesh(&self, leaf: TileId, lod: u8) -> Result<Option<MeshTile>, SourceError> {
        self.check(leaf)?;
        Ok(self.meshes.get(&leaf).filter(|_| lod == 0).cloned())
    }
}

impl TestCity {
    fn check(&self, id: TileId) -> Result<(), SourceError> {
        let error = || SourceError { what: format!("tile {id}"), reason: "its checksum differs".into() };
        if self.broken.contains(&id) { Err(error()) } else { Ok(()) }
    }
}

/// A house: 12 x 12 columns from column 10 on of both axes, 15 m high, on flat ground 1 m above the origin.
fn node_columns(id: TileId, cell_m: f32, house: u32) -> BlockMap {
    let mut objects = ColumnObjects::default();
    let columns: Vec<Option<MapColumn>> = (0..COLUMNS)
        .map(|i| {
            let (x, y) = (i % NODE_CELLS, i / NODE_CELLS);
            let in_house = |at: usize| (10..22).contains(&at);
            if !in_house(x) || !in_house(y) {
                objects.roof[i] = TERRAIN;
                return Some(MapColumn { z_max: 16, roof: Texel::new([90, 110, 80], 63), ..MapColumn::default() });
            }
            objects.roof[i] = house;
            let is_wall = [x, y].iter().any(|at| [10, 21].contains(at));
            let texels = vec![Texel::new([200, 190, 180], 60); usize::from(strip_rows(8, 240, 0).1)];
            if is_wall {
                objects.wall[i] = house;
            }
            let strip = is_wall.then_some(WallStrip { texels, azimuth: 0 });
            Some(MapColumn { z_min: 8, z_max: 240, roof: Texel::new([150, 60, 40], 63), strip, ..MapColumn::default() })
        })
        .collect();
    let mut map = BlockMap::from_columns(id, cell_m, 0, 0, &columns).unwrap();
    map.objects = Some(Box::new(objects));
    map
}

/// A WebP file of 2 x 1 pixels.
pub(crate) fn webp() -> TileTexture {
    let image = image::RgbImage::from_fn(2, 1, |x, _| image::Rgb([255 * x as u8, 128, 0]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::WebP).unwrap();
    TileTexture { size_px: [2, 1], bytes: bytes.into_inner() }
}

/// House 1 stands in the columns of the root, house `2 + q` in the leaf in quadrant `q`.
fn house_bounds(house: u32) -> ObjectBounds {
    let Some(quadrant) = house.checked_sub(2).map(|quadrant| quadrant as i32) else {
        return ObjectBounds { min: [200, 200, 10], max: [440, 440, 300] };
    };
    let [x, y] = [640 * (quadrant & 1), 640 * (quadrant >> 1)];
    ObjectBounds { min: [x + 100, y + 100, 5], max: [x + 220, y + 220, 150] }
}

fn records() -> Vec<Option<ObjectRecord>> {
    let terrain = ObjectRecord {
        identifier: "terrain".into(),
        kind: FeatureKind::Relief,
        parent: None,
        bounds: Some(ObjectBounds { min: [0, 0, 0], max: [1280, 1280, 10] }),
        attributes: Vec::new(),
    };
    let house = |id: u32| ObjectRecord {
        identifier: format!("house-{id}"),
        kind: if id == HOUSES { FeatureKind::BuildingPart } else { FeatureKind::Building },
        parent: (id == HOUSES).then_some(1),
        bounds: Some(house_bounds(id)),
        attributes: vec![
            (0, Value::Text(format!("M\u{fc}hle {id}"))),
            (1, Value::Integer(i64::from(id) + 1)),
            (2, Value::Float(12.5)),
            (3, Value::Bool(id.is_multiple_of(2))),
        ],
    };
    let mut records: Vec<_> = std::iter::once(terrain).chain((1..=HOUSES).map(house)).map(Some).collect();
    // A house of which nothing but its number is known.
    records[2] = None;
    records
}

fn schema(records: &[Option<ObjectRecord>]) -> Schema {
    let names = ["name", "storeys above", "height", "listed"];
    let mut builder = SchemaBuilder::default();
    for (attribute, value) in records.iter().flatten().flat_map(|record| &record.attributes) {
        builder.add(names[*attribute as usize], value);
    }
    builder.set_unit("height", "m");
    builder.finish(records.len() as u32)
}

/// A city with four leaves. The first has a mesh with a texture, the second one with colours, the others only columns.
pub(crate) fn city() -> TestCity {
    let manifest = manifest(1, 1.0);
    let ids: Vec<TileId> = std::iter::once(TileId::ROOT).chain(TileId::ROOT.children()).collect();
    let columns: BTreeMap<TileId, BlockMap> = (1u32..)
        .zip(&ids)
        .map(|(house, id)| (*id, node_columns(*id, manifest.cell_m_at(id.level()) as f32, house)))
        .collect();
    let mut meshes = BTreeMap::new();
    for (i, texture) in [(1, Some(webp())), (2, None)] {
        let mut mesh = cuboid([10.0, 10.0, 0.5], [22.0, 22.0, 15.0], [150, 60, 40], texture);
        mesh.objects = (0..12).map(|t| if t < 10 { 1 + i } else { NO_OBJECT }).collect();
        meshes.insert(ids[i as usize], mesh);
    }
    let node = |id: &TileId| NodeInfo {
        id: *id,
        child_mask: if id.level() == 0 { 0b1111 } else { 0 },
        z_min_m: 0.0,
        z_max_m: 30.0,
        error_m: if id.level() == 0 { 1.74 } else { 0.87 },
        radius_m: 100.0,
        blockmap_bytes: 100,
    };
    let lod = MeshLod { error_m: 0.02, bytes: 1000, triangles: 12, texture_px: 0 };
    let subtree = Subtree {
        nodes: ids.iter().map(node).collect(),
        meshes: meshes.keys().map(|id| NodeMesh { id: *id, lods: vec![lod] }).collect(),
        deviations: Vec::new(),
    };
    let records = records();
    let schema = schema(&records);
    let mut slots = records;
    slots.resize(BLOCK_OBJECTS, None);
    let blocks = [(0, block::encode(0, &slots, &schema).unwrap())].into();
    let subtrees = [(TileId::ROOT, subtree)].into();
    TestCity { manifest, schema, blocks, subtrees, columns, meshes, broken: BTreeSet::new() }
}
