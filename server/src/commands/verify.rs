//! `verify`: every checksum, every tile, and that the parts of a city agree.
//!
//! In: a city's folder. Out: the faults, one a line. Next: exit code 0 or 1.

use super::{error::CommandError, output::print};
use crate::{args::VerifyArgs, store::CityStore};
use insula_protocol::{
    BlockMap, MeshTile, Subtree, TileId, mesh_tile,
    route::Layer,
    subtree::{MeshLod, NodeInfo},
    tile,
};
use std::{
    collections::{BTreeMap, BTreeSet},
    io::Cursor,
};

pub(super) fn run(args: &VerifyArgs) -> Result<(), CommandError> {
    let city = CityStore::open(&args.city)?;
    let faults = faults(&city);
    if faults.is_empty() {
        let tiles: u64 = city.archives().map(|(_, archive)| archive.len()).sum();
        print(&format!("{}: {tiles} tiles, all good\n", city.manifest().name));
        return Ok(());
    }
    print(&faults.iter().map(|fault| format!("{fault}\n")).collect::<String>());
    Err(CommandError::Faults { path: args.city.clone(), faults: faults.len() })
}

/// All that is wrong, one line each, tiles first.
pub(super) fn faults(city: &CityStore) -> Vec<String> {
    let mut faults = Vec::new();
    let lengths = blockmaps(city, &mut faults);
    let (nodes, lods) = subtrees(city, &mut faults);
    agreement(&lengths, &nodes, &mut faults);
    meshes(city, lods, &nodes, &mut faults);
    manifest(city, &lengths, &mut faults);
    faults
}

/// Every V-BlockMap's length, by its place.
fn blockmaps(city: &CityStore, faults: &mut Vec<String>) -> BTreeMap<TileId, u64> {
    let mut lengths = BTreeMap::new();
    for (id, bytes) in city.blockmaps().tiles() {
        let mut fault = |what: String| faults.push(format!("blockmaps/{id}: {what}"));
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(error) => {
                fault(error.to_string());
                continue;
            }
        };
        lengths.insert(id, bytes.len() as u64);
        match BlockMap::decode(id, &bytes) {
            Err(error) => fault(error.to_string()),
            Ok(map) => {
                let wanted_m = city.manifest().cell_m_at(id.level());
                if (f64::from(map.cell_m) / wanted_m - 1.0).abs() > 1e-5 {
                    fault(format!("its columns are {} m wide, those of its level {wanted_m} m", map.cell_m));
                }
            }
        }
    }
    lengths
}

type Nodes = BTreeMap<TileId, NodeInfo>;
/// Levels of detail by leaf and number.
type Lods = BTreeMap<(TileId, u8), MeshLod>;

/// Every node and every mesh that the subtrees list.
fn subtrees(city: &CityStore, faults: &mut Vec<String>) -> (Nodes, Lods) {
    let (mut nodes, mut lods) = (BTreeMap::new(), BTreeMap::new());
    let mut there = BTreeSet::new();
    let mut continued = BTreeSet::from([TileId::ROOT]);
    for (id, bytes) in city.subtrees().tiles() {
        there.insert(id);
        let decoded = bytes.map_err(|error| error.to_string());
        let subtree = match decoded.and_then(|bytes| Subtree::decode(&bytes).map_err(|error| error.to_string())) {
            Ok(subtree) => subtree,
            Err(error) => {
                faults.push(format!("subtrees/{id}: {error}"));
                continue;
            }
        };
        if let Some(root) = subtree.nodes.first().filter(|root| root.id != id) {
            faults.push(format!("subtrees/{id}: it says that it is {}", root.id));
            continue;
        }
        for mesh in &subtree.meshes {
            lods.extend((0..).zip(&mesh.lods).map(|(number, lod)| ((mesh.id, number), *lod)));
        }
        for node in subtree.nodes {
            if node.child_mask != 0 && Subtree::is_root(node.id) {
                continued.insert(node.id);
            }
            nodes.insert(node.id, node);
        }
    }
    for id in continued.difference(&there) {
        faults.push(format!("subtrees/{id}: missing, though its node has children"));
    }
    for id in there.difference(&continued) {
        faults.push(format!("subtrees/{id}: its node has no children, so nobody will ask for it"));
    }
    (nodes, lods)
}

/// Every mesh decodes, its picture has the size that it says, and meshes are those that the subtrees list.
fn meshes(city: &CityStore, mut lods: Lods, nodes: &Nodes, faults: &mut Vec<String>) {
    for (place, bytes) in city.archive(Layer::Meshes).into_iter().flat_map(|archive| archive.tiles()) {
        let Some((id, number)) = mesh_tile::at_place(place, city.manifest().depth) else {
            faults.push(format!("meshes/{place}: no leaf's mesh has its place there"));
            continue;
        };
        let mut fault = |what: String| faults.push(format!("meshes/{id}/{number}: {what}"));
        let Some(lod) = lods.remove(&(id, number)) else {
            fault("no subtree lists it, so nobody will ask for it".into());
            continue;
        };
        match bytes {
            Ok(bytes) => mesh((id, number), &bytes, &lod).unwrap_or_else(&mut fault),
            Err(error) => fault(error.to_string()),
        }
        if number == 0 && nodes.get(&id).is_some_and(|node| lod.error_m > node.error_m) {
            fault(format!("its error of {} m is larger than that of the leaf's V-BlockMap", lod.error_m));
        }
    }
    faults.extend(lods.keys().map(|(id, number)| format!("meshes/{id}/{number}: missing, though a subtree lists it")));
}

fn mesh((id, number): (TileId, u8), bytes: &[u8], lod: &MeshLod) -> Result<(), String> {
    let tile = MeshTile::decode(id, number, bytes).map_err(|error| error.to_string())?;
    let pixels = tile.texture.as_ref().map_or(0, |texture| texture.pixels());
    let found = (bytes.len() as u64, tile.mesh.triangles.len() as u64, pixels);
    let said = (u64::from(lod.bytes), u64::from(lod.triangles), lod.texture_px);
    if found != said {
        return Err(format!("{found:?} bytes, triangles and pixels, its subtree says {said:?}"));
    }
    let Some(texture) = tile.texture else { return Ok(()) };
    let reader = image::ImageReader::new(Cursor::new(&texture.bytes)).with_guessed_format();
    let size = reader.map_err(|error| error.to_string())?.into_dimensions().map_err(|error| error.to_string())?;
    if size != (texture.size_px[0].into(), texture.size_px[1].into()) {
        return Err(format!("its picture has {size:?} pixels, it says {:?}", texture.size_px));
    }
    image::load_from_memory(&texture.bytes).map(drop).map_err(|error| error.to_string())
}

/// Nodes and V-BlockMaps are the same set, of the lengths that the nodes say; errors shrink downwards.
fn agreement(lengths: &BTreeMap<TileId, u64>, nodes: &BTreeMap<TileId, NodeInfo>, faults: &mut Vec<String>) {
    for (id, node) in nodes {
        match lengths.get(id) {
            None => faults.push(format!("blockmaps/{id}: missing, though a subtree lists it")),
            Some(length) if *length != u64::from(node.blockmap_bytes) => {
                faults.push(format!("blockmaps/{id}: {length} bytes, its subtree says {}", node.blockmap_bytes));
            }
            Some(_) => {}
        }
        let parent = id.parent().and_then(|parent| nodes.get(&parent));
        if let Some(parent) = parent.filter(|parent| node.error_m > parent.error_m) {
            let (own, above) = (node.error_m, parent.error_m);
            faults.push(format!("subtrees/{id}: its error of {own} m is larger than its parent's {above} m"));
        }
    }
    for id in lengths.keys().filter(|id| !nodes.contains_key(id)) {
        faults.push(format!("blockmaps/{id}: no subtree lists it, so nobody will ask for it"));
    }
}

/// What the manifest counts is what is there.
fn manifest(city: &CityStore, lengths: &BTreeMap<TileId, u64>, faults: &mut Vec<String>) {
    let manifest = city.manifest();
    let mut fault = |what: String| faults.push(format!("city.json: {what}"));
    if manifest.tile_version != tile::VERSION {
        fault(format!("its tiles are of format {}, this program reads {}", manifest.tile_version, tile::VERSION));
    }
    let levels = usize::from(manifest.depth) + 1;
    let (mut nodes, mut bytes) = (vec![0u64; levels], vec![0u64; levels]);
    for (id, length) in lengths {
        let level = usize::from(id.level());
        nodes[level] += 1;
        bytes[level] += length;
    }
    for (what, said, found) in
        [("nodes", &manifest.counts.nodes_per_level, &nodes), ("bytes", &manifest.counts.bytes_per_level, &bytes)]
    {
        if said != found {
            fault(format!("it counts {said:?} {what} per level, the archive has {found:?}"));
        }
    }
}
