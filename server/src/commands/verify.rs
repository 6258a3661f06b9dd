//! `verify`: checks every checksum, decodes every tile, and compares the parts of a city with each other.

use super::error::CommandError;
use super::output::print_result;
use crate::args::VerifyArgs;
use crate::store::{CityStore, StoredObjects};
use insula_archive::city::content_version;
use insula_protocol::subtree::{MeshLod, NodeInfo};
use insula_protocol::text::{count, printable};
use insula_protocol::{BlockMap, MeshTile, Subtree, TileId, TileKind, VisibilityTile, mesh_tile, tile};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Faults that are kept and printed. Further ones are counted: a damaged city can have one per tile.
const MAX_FAULTS: usize = 1000;

/// The faults of a city, one line each: the first [`MAX_FAULTS`], and the number of all.
#[derive(Default)]
struct FaultList {
    first: Vec<String>,
    count: usize,
}

impl FaultList {
    fn push(&mut self, fault: String) {
        self.count += 1;
        if self.first.len() < MAX_FAULTS {
            self.first.push(fault);
        }
    }

    /// The lines that are printed.
    fn text(&self) -> String {
        let mut text: String = self.first.iter().map(|fault| printable(fault) + "\n").collect();
        match self.count - self.first.len() {
            0 => {}
            more => text += &format!("and {more} more\n"),
        }
        text
    }
}

/// Runs `verify` and prints the faults, one per line. Fails if the city cannot be opened or has faults.
pub(super) fn run(args: &VerifyArgs) -> Result<(), CommandError> {
    let city = CityStore::open(&args.city)?;
    let mut faults = find_faults(&city);
    check_version(&args.city, &city.manifest().version, &mut faults);
    if faults.count == 0 {
        let tiles: u64 = city.archives().map(|(_, archive)| archive.len()).sum();
        let text = format!("{}: {}, no faults\n", city.manifest().name, count(tiles, "tile"));
        let facts = json!({ "city": city.manifest().name, "tiles": tiles, "fault_count": 0, "faults": [] });
        print_result(args.json, &facts, &text);
        return Ok(());
    }
    let facts = json!({ "city": city.manifest().name, "fault_count": faults.count, "faults": faults.first });
    print_result(args.json, &facts, &faults.text());
    Err(CommandError::Faults { path: args.city.clone(), faults: faults.count })
}

/// Checks that the files are those of one bake: the version is a hash of all of them.
fn check_version(folder: &Path, stated: &str, faults: &mut FaultList) {
    match content_version(folder, stated) {
        Ok(found) if found == stated => {}
        Ok(found) => faults.push(format!(
            "city.json: its version is {stated}, the files have {found}: one of them is of another bake, or was changed"
        )),
        Err(error) => faults.push(format!("city.json: its version cannot be checked: {error}")),
    }
}

/// The faults of a city, those of tiles first.
fn find_faults(city: &CityStore) -> FaultList {
    let mut faults = FaultList::default();
    let lengths = check_blockmaps(city, &mut faults);
    let subtrees = read_subtrees(city, &mut faults);
    check_nodes(&lengths, &subtrees.nodes, &mut faults);
    check_meshes(city, subtrees, &mut faults);
    check_objects(city, &mut faults);
    check_visibility(city, &mut faults);
    check_search(city, &mut faults);
    check_manifest(city, &lengths, &mut faults);
    faults
}

/// Decodes every V-BlockMap. Returns their sizes in bytes.
fn check_blockmaps(city: &CityStore, faults: &mut FaultList) -> BTreeMap<TileId, u64> {
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
                let expected_m = city.manifest().cell_m_at(id.level());
                if (f64::from(map.cell_m) / expected_m - 1.0).abs() > 1e-5 {
                    fault(format!("its columns are {} m wide, its level has {expected_m} m", map.cell_m));
                }
            }
        }
    }
    lengths
}

/// The nodes and meshes that a city's subtrees list.
#[derive(Default)]
struct SubtreeContents {
    nodes: BTreeMap<TileId, NodeInfo>,
    /// By leaf and level of detail.
    meshes: BTreeMap<(TileId, u8), MeshLod>,
}

/// Decodes every subtree, and checks that exactly those exist that a node refers to.
fn read_subtrees(city: &CityStore, faults: &mut FaultList) -> SubtreeContents {
    let mut contents = SubtreeContents::default();
    let mut existing = BTreeSet::new();
    let mut referenced = BTreeSet::from([TileId::ROOT]);
    for (id, bytes) in city.subtrees().tiles() {
        existing.insert(id);
        let decoded = bytes.map_err(|error| error.to_string());
        let subtree = match decoded.and_then(|bytes| Subtree::decode(&bytes).map_err(|error| error.to_string())) {
            Ok(subtree) => subtree,
            Err(error) => {
                faults.push(format!("subtrees/{id}: {error}"));
                continue;
            }
        };
        if let Some(root) = subtree.nodes.first().filter(|root| root.id != id) {
            faults.push(format!("subtrees/{id}: its root node is {}", root.id));
            continue;
        }
        for mesh in &subtree.meshes {
            contents.meshes.extend((0..).zip(&mesh.lods).map(|(number, lod)| ((mesh.id, number), *lod)));
        }
        for node in subtree.nodes {
            if node.child_mask != 0 && Subtree::is_root(node.id) {
                referenced.insert(node.id);
            }
            contents.nodes.insert(node.id, node);
        }
    }
    for id in referenced.difference(&existing) {
        faults.push(format!("subtrees/{id}: missing, but its node has children"));
    }
    for id in existing.difference(&referenced) {
        faults.push(format!("subtrees/{id}: unused: its node has no children"));
    }
    contents
}

/// Decodes every mesh, and checks that exactly those exist that the subtrees list.
fn check_meshes(city: &CityStore, subtrees: SubtreeContents, faults: &mut FaultList) {
    let SubtreeContents { nodes, meshes: mut listed } = subtrees;
    for (place, bytes) in city.archive(TileKind::Mesh).into_iter().flat_map(|archive| archive.tiles()) {
        let Some((id, number)) = mesh_tile::from_archive_id(place, city.manifest().depth) else {
            faults.push(format!("meshes/{place}: not the place of a leaf's mesh"));
            continue;
        };
        let mut fault = |what: String| faults.push(format!("meshes/{id}/{number}: {what}"));
        let Some(lod) = listed.remove(&(id, number)) else {
            fault("unused: no subtree lists it".into());
            continue;
        };
        match bytes {
            Ok(bytes) => check_mesh(id, number, &bytes, &lod).unwrap_or_else(&mut fault),
            Err(error) => fault(error.to_string()),
        }
        if number == 0 && nodes.get(&id).is_some_and(|node| lod.error_m > node.error_m) {
            fault(format!("its error of {} m is larger than that of its leaf's V-BlockMap", lod.error_m));
        }
    }
    for (id, number) in listed.keys() {
        faults.push(format!("meshes/{id}/{number}: missing, but a subtree lists it"));
    }
}

/// Decodes every visibility tile.
fn check_visibility(city: &CityStore, faults: &mut FaultList) {
    let depth = city.manifest().depth;
    if city.manifest().street_sets != city.archive(TileKind::Visibility).is_some() {
        faults.push("city.json: street_sets does not say whether there are visibility tiles".to_owned());
    }
    for (id, bytes) in city.archive(TileKind::Visibility).into_iter().flat_map(|archive| archive.tiles()) {
        let decoded = bytes.map_err(|error| error.to_string());
        match decoded.and_then(|bytes| VisibilityTile::decode(id, &bytes).map_err(|error| error.to_string())) {
            Ok(tile) if tile.depth == depth => {}
            Ok(_) => faults.push(format!("visibility/{id}: of a city with another depth")),
            Err(error) => faults.push(format!("visibility/{id}: {error}")),
        }
    }
}

/// Decodes the schema of the objects and every block.
fn check_objects(city: &CityStore, faults: &mut FaultList) {
    if city.archive(TileKind::Objects).is_none() {
        return;
    }
    let objects = match StoredObjects::open(city) {
        Ok(objects) => objects,
        Err(error) => return faults.push(error.to_string()),
    };
    for block in 0..objects.block_count() {
        if let Err(error) = objects.block(block) {
            faults.push(error.to_string());
        }
    }
}

/// Opens the search index, if there is one: that checks its checksum and its dictionary.
fn check_search(city: &CityStore, faults: &mut FaultList) {
    if city.has_search()
        && let Err(error) = city.search_index()
    {
        faults.push(error.to_string());
    }
}

/// Decodes a mesh and its texture. Fails if sizes differ from those that its subtree lists.
fn check_mesh(id: TileId, number: u8, bytes: &[u8], listed: &MeshLod) -> Result<(), String> {
    let tile = MeshTile::decode(id, number, bytes).map_err(|error| error.to_string())?;
    let pixels = tile.texture.as_ref().map_or(0, |texture| texture.pixels());
    let found = (bytes.len() as u64, tile.mesh.triangles.len() as u64, pixels);
    let expected = (u64::from(listed.bytes), u64::from(listed.triangles), listed.texture_px);
    if found != expected {
        return Err(format!("{found:?} bytes, triangles and pixels, its subtree lists {expected:?}"));
    }
    tile.texture.map_or(Ok(()), |texture| texture.decode().map(drop).map_err(|error| error.to_string()))
}

/// Checks that nodes and V-BlockMaps are the same set with the same sizes, and that no node's error exceeds its parent's.
fn check_nodes(lengths: &BTreeMap<TileId, u64>, nodes: &BTreeMap<TileId, NodeInfo>, faults: &mut FaultList) {
    for (id, node) in nodes {
        match lengths.get(id) {
            None => faults.push(format!("blockmaps/{id}: missing, but a subtree lists it")),
            Some(length) if *length != u64::from(node.blockmap_bytes) => {
                faults.push(format!("blockmaps/{id}: {length} bytes, its subtree lists {}", node.blockmap_bytes));
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
        faults.push(format!("blockmaps/{id}: unused: no subtree lists it"));
    }
}

/// Checks the manifest's tile format and its counts of nodes and bytes.
fn check_manifest(city: &CityStore, lengths: &BTreeMap<TileId, u64>, faults: &mut FaultList) {
    let manifest = city.manifest();
    let mut fault = |what: String| faults.push(format!("city.json: {what}"));
    if manifest.tile_version != tile::VERSION {
        fault(format!("its tiles have format version {}, this program reads {}", manifest.tile_version, tile::VERSION));
    }
    let levels = usize::from(manifest.depth) + 1;
    let (mut nodes, mut bytes) = (vec![0u64; levels], vec![0u64; levels]);
    for (id, length) in lengths {
        let level = usize::from(id.level());
        nodes[level] += 1;
        bytes[level] += length;
    }
    for (what, expected, found) in
        [("nodes", &manifest.counts.nodes_per_level, &nodes), ("bytes", &manifest.counts.bytes_per_level, &bytes)]
    {
        if expected != found {
            fault(format!("it counts {expected:?} {what} per level, the archive has {found:?}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_past_the_limit_are_counted_only() {
        let mut faults = FaultList::default();
        let add = |faults: &mut FaultList, numbers: std::ops::Range<usize>| {
            numbers.for_each(|number| faults.push(format!("fault {number}\u{1b}[2J")));
        };
        add(&mut faults, 0..MAX_FAULTS);
        assert_eq!(faults.text().lines().count(), MAX_FAULTS);
        add(&mut faults, MAX_FAULTS..1_000_000);
        assert_eq!((faults.first.len(), faults.count), (MAX_FAULTS, 1_000_000));
        let text = faults.text();
        assert_eq!(text.lines().last(), Some("and 999000 more"));
        assert!(text.lines().count() == MAX_FAULTS + 1 && !text.contains('\u{1b}'));
    }
}
