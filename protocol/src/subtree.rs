//! Subtree tiles: which nodes exist, with their heights and errors, five levels at a time.
//!
//! A subtree tile lists its root and the nodes up to five levels below it. There is one for the city's root, and one
//! for each node of levels 5, 10, ... that has children. Such a node is in two tiles, as the root of one and at the
//! bottom of another, so that leaves need no tile of their own.

use crate::codec::byte_reader::ByteReader;
use crate::codec::varint;
use crate::error::{DecodeError, invalid_if};
use crate::mesh_tile::{MAX_LODS, MAX_TEXTURE_PX, MAX_TRIANGLES};
use crate::tile::{TileReader, TileWriter};
use crate::{TileId, TileKind};
use serde::{Deserialize, Serialize};

/// Levels below a subtree's root that it lists.
pub const LEVELS: u8 = 5;
/// Maximum number of nodes in one subtree: 1 + 4 + 16 + 64 + 256 + 1024.
pub const MAX_NODES: usize = 1365;

const TAG_NODES: u8 = 1;
const TAG_MESHES: u8 = 2;
const TAG_DEVIATIONS: u8 = 3;
const NODE_BYTES: usize = 21;
/// Four distances of a node in centimetres.
const DEVIATION_BYTES: usize = 8;
/// Maximum bytes of a node's meshes: a count, and for each level of detail an f32 and three varints.
const MESH_BYTES: usize = 1 + 19 * MAX_LODS as usize;

/// Metadata of a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeInfo {
    pub id: TileId,
    /// Bit q is set if the child in quadrant q exists.
    pub child_mask: u8,
    /// Lowest point in metres above the city's origin.
    pub z_min_m: f32,
    /// Highest point in metres above the city's origin.
    pub z_max_m: f32,
    /// How far what the node draws may lie from the source, and the source from it, in metres: half the diagonal of its voxel,
    /// or a larger one of the node's [`NodeDeviation`]. Never below any child's.
    pub error_m: f32,
    /// Radius in metres of the sphere around the centre of the node's box. It contains the children's spheres.
    pub radius_m: f32,
    /// Size of the node's V-BlockMap tile.
    pub blockmap_bytes: u32,
}

/// Measured distances between what a node draws and the source, in metres; 655.35 stands for that or more. A tower that is not drawn shows in the
/// distances from the source only, a wall that does not exist in those from what is drawn only.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct NodeDeviation {
    /// From what is drawn to the source, of 99.9% of the points.
    pub drawn_m: f32,
    /// From what is drawn to the source, the largest.
    pub drawn_max_m: f32,
    /// From the source to what is drawn, of 99.9% of the points.
    pub source_m: f32,
    /// From the source to what is drawn, the largest.
    pub source_max_m: f32,
}

impl NodeDeviation {
    fn values(&self) -> [f32; 4] {
        [self.drawn_m, self.drawn_max_m, self.source_m, self.source_max_m]
    }

    fn from_values([drawn_m, drawn_max_m, source_m, source_max_m]: [f32; 4]) -> Self {
        Self { drawn_m, drawn_max_m, source_m, source_max_m }
    }

    /// The larger one of each of the distances.
    pub fn max(&self, other: &Self) -> Self {
        let [a, b] = [self.values(), other.values()];
        Self::from_values(std::array::from_fn(|i| a[i].max(b[i])))
    }

    /// Rounded up to centimetres, as in tiles.
    pub fn rounded(&self) -> Self {
        Self::from_values(self.values().map(|metres| f32::from(centimetres(metres)) / 100.0))
    }
}

/// Rounds up. A value that was rounded stays as it is.
fn centimetres(metres: f32) -> u16 {
    (metres * 100.0 - 0.01).ceil().clamp(0.0, f32::from(u16::MAX)) as u16
}

/// Metadata of one level of detail of a leaf's mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeshLod {
    /// Largest distance from the source's surface in metres, never above that of the next coarser level of detail.
    pub error_m: f32,
    pub bytes: u32,
    /// Number of triangles, at least 1.
    pub triangles: u32,
    /// Number of pixels of its texture; 0 without one.
    pub texture_px: u32,
}

/// The mesh of a leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeMesh {
    pub id: TileId,
    /// 1 to [`MAX_LODS`] levels of detail, finest first.
    pub lods: Vec<MeshLod>,
}

/// A subtree of up to five levels below its root.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Subtree {
    /// Breadth first, children in quadrant order. The first node is the root.
    pub nodes: Vec<NodeInfo>,
    /// Meshes of leaves, in the order of their nodes.
    pub meshes: Vec<NodeMesh>,
    /// One for each node, or none if they were not measured.
    pub deviations: Vec<NodeDeviation>,
}

impl Subtree {
    /// Whether `id` is at a level where nodes with children are roots of subtree tiles.
    pub fn is_root(id: TileId) -> bool {
        id.level().is_multiple_of(LEVELS)
    }

    /// The root of the subtree tile that lists the children of `id`.
    pub fn root_of(id: TileId) -> TileId {
        id.ancestor(id.level() / LEVELS * LEVELS).unwrap_or(TileId::ROOT)
    }

    /// Encodes the tile. The nodes must be complete and in the order of [`Subtree::decode`]. Fails without nodes, and
    /// on meshes that are inconsistent or over the format's limits.
    pub fn encode(&self) -> Result<Vec<u8>, DecodeError> {
        let root = self.nodes.first().ok_or(DecodeError::Invalid("a subtree has no nodes"))?.id;
        let mut raw = Vec::with_capacity(self.nodes.len() * NODE_BYTES);
        for node in &self.nodes {
            raw.push(node.child_mask);
            for v in [node.z_min_m, node.z_max_m, node.error_m, node.radius_m] {
                raw.extend_from_slice(&v.to_le_bytes());
            }
            raw.extend_from_slice(&node.blockmap_bytes.to_le_bytes());
        }
        let mut writer = TileWriter::new(TileKind::Subtree, Some(root));
        writer.add_section(TAG_NODES, &raw)?;
        writer.add_section(TAG_MESHES, &self.encode_meshes()?)?;
        writer.add_section(TAG_DEVIATIONS, &self.encode_deviations()?)?;
        writer.finish()
    }

    /// Centimetres, rounded up, each kind of distance for all nodes. Empty without deviations.
    fn encode_deviations(&self) -> Result<Vec<u8>, DecodeError> {
        if self.deviations.is_empty() {
            return Ok(Vec::new());
        }
        invalid_if(self.deviations.len() != self.nodes.len(), "a subtree must have a deviation for each node or none")?;
        let kind = |i: usize| self.deviations.iter().map(move |deviation| centimetres(deviation.values()[i]));
        Ok((0..4).flat_map(kind).flat_map(u16::to_le_bytes).collect())
    }

    /// The counts of all nodes, then the errors, sizes, triangles and pixels of all levels of detail. Empty without
    /// meshes.
    fn encode_meshes(&self) -> Result<Vec<u8>, DecodeError> {
        if self.meshes.is_empty() {
            return Ok(Vec::new());
        }
        let mut meshes = self.meshes.iter().peekable();
        let mut raw = Vec::new();
        for node in &self.nodes {
            let mesh = meshes.next_if(|mesh| mesh.id == node.id);
            if let Some(mesh) = mesh {
                check_mesh(mesh, node)?;
            }
            raw.push(mesh.map_or(0, |mesh| mesh.lods.len() as u8));
        }
        invalid_if(meshes.next().is_some(), "a subtree's meshes are not in the order of its nodes")?;
        let lods = || self.meshes.iter().flat_map(|mesh| &mesh.lods);
        lods().for_each(|lod| raw.extend_from_slice(&lod.error_m.to_le_bytes()));
        for number in [|lod: &MeshLod| lod.bytes, |lod: &MeshLod| lod.triangles, |lod: &MeshLod| lod.texture_px] {
            lods().for_each(|lod| varint::push(&mut raw, number(lod)));
        }
        Ok(raw)
    }

    /// Decodes a tile. Ids follow from the child masks. Fails on any bytes that are not such a tile.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, TileKind::Subtree)?;
        let id = tile.id.ok_or(DecodeError::Invalid("a subtree tile has no id"))?;
        invalid_if(!Self::is_root(id), "the level of a subtree's root is not a multiple of five")?;
        let raw = tile.section(TAG_NODES, MAX_NODES * NODE_BYTES)?;
        let mut reader = ByteReader::new(&raw);
        let end = id.level() + LEVELS;
        let mut ids = vec![id];
        let mut nodes = Vec::with_capacity(raw.len() / NODE_BYTES);
        let mut next = 0;
        while let Some(&id) = ids.get(next) {
            next += 1;
            let node = read_node(&mut reader, id)?;
            if id.level() < end {
                ids.extend((0..4).filter(|q| node.child_mask >> q & 1 == 1).filter_map(|q| id.child(q)));
            }
            nodes.push(node);
        }
        reader.finish()?;
        let meshes = read_meshes(&tile.section(TAG_MESHES, nodes.len() * MESH_BYTES)?, &nodes)?;
        let deviations = read_deviations(&tile.section(TAG_DEVIATIONS, nodes.len() * DEVIATION_BYTES)?, nodes.len())?;
        Ok(Self { nodes, meshes, deviations })
    }
}

/// Reads the deviations section of `count` nodes.
fn read_deviations(raw: &[u8], count: usize) -> Result<Vec<NodeDeviation>, DecodeError> {
    if raw.is_empty() {
        return Ok(Vec::new());
    }
    invalid_if(raw.len() != count * DEVIATION_BYTES, "a subtree must have a deviation for each node or none")?;
    let metres = |i: usize| f32::from(u16::from_le_bytes([raw[2 * i], raw[2 * i + 1]])) / 100.0;
    let deviation = |node: usize| NodeDeviation::from_values(std::array::from_fn(|kind| metres(kind * count + node)));
    Ok((0..count).map(deviation).collect())
}

fn read_meshes(raw: &[u8], nodes: &[NodeInfo]) -> Result<Vec<NodeMesh>, DecodeError> {
    if raw.is_empty() {
        return Ok(Vec::new());
    }
    let mut reader = ByteReader::new(raw);
    let counts = reader.take(nodes.len())?;
    invalid_if(counts.iter().any(|count| *count > MAX_LODS), "a mesh has more than four levels of detail")?;
    let mut lods = Vec::new();
    for _ in 0..counts.iter().map(|count| u32::from(*count)).sum() {
        lods.push(MeshLod { error_m: reader.f32()?, bytes: 0, triangles: 0, texture_px: 0 });
    }
    let numbers: [fn(&mut MeshLod) -> &mut u32; 3] =
        [|lod| &mut lod.bytes, |lod| &mut lod.triangles, |lod| &mut lod.texture_px];
    for number in numbers {
        for lod in &mut lods {
            *number(lod) = reader.varint()?;
        }
    }
    reader.finish()?;
    let mut lods = lods.into_iter();
    let mut meshes = Vec::new();
    for (node, &count) in nodes.iter().zip(counts).filter(|(_, count)| **count > 0) {
        let mesh = NodeMesh { id: node.id, lods: lods.by_ref().take(usize::from(count)).collect() };
        check_mesh(&mesh, node)?;
        meshes.push(mesh);
    }
    Ok(meshes)
}

fn check_mesh(mesh: &NodeMesh, node: &NodeInfo) -> Result<(), DecodeError> {
    invalid_if(node.child_mask != 0, "a node with children has a mesh")?;
    let count = 1..=usize::from(MAX_LODS);
    let is_ascending = mesh.lods.is_sorted_by(|finer, coarser| finer.error_m <= coarser.error_m);
    let is_valid = mesh.lods.iter().all(|lod| (0.0..f32::INFINITY).contains(&lod.error_m));
    if !count.contains(&mesh.lods.len()) || !is_ascending || !is_valid {
        return Err(DecodeError::Invalid("a mesh must have one to four levels of detail of ascending errors"));
    }
    let is_in_range = |lod: &MeshLod| {
        (1..=MAX_TRIANGLES).contains(&(lod.triangles as usize)) && lod.texture_px <= MAX_TEXTURE_PX && lod.bytes > 0
    };
    invalid_if(!mesh.lods.iter().all(is_in_range), "a mesh's size, triangles or pixels are out of range")
}

fn read_node(reader: &mut ByteReader<'_>, id: TileId) -> Result<NodeInfo, DecodeError> {
    let node = NodeInfo {
        id,
        child_mask: reader.u8()?,
        z_min_m: reader.f32()?,
        z_max_m: reader.f32()?,
        error_m: reader.f32()?,
        radius_m: reader.f32()?,
        blockmap_bytes: reader.u32()?,
    };
    if node.child_mask > 15 || (node.child_mask != 0 && id.child(0).is_none()) {
        return Err(DecodeError::Invalid("a child mask names children that cannot exist"));
    }
    if node.z_min_m > node.z_max_m || node.error_m < 0.0 || node.radius_m < 0.0 {
        return Err(DecodeError::Invalid("a node's bounds are inverted, or its error or radius is negative"));
    }
    Ok(node)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Subtree {
        let node = |id: TileId, child_mask| NodeInfo {
            id,
            child_mask,
            z_min_m: -1.5,
            z_max_m: 40.0 + f32::from(id.level()),
            error_m: 16.0 / f32::from(1 + id.level()),
            radius_m: 100.0,
            blockmap_bytes: 1234,
        };
        let root = TileId::ROOT;
        let a = root.child(1).unwrap();
        let b = root.child(2).unwrap();
        let c = a.child(3).unwrap();
        let lod = |error_m, bytes| MeshLod { error_m, bytes, triangles: 12, texture_px: 64 * 32 };
        let meshes = vec![
            NodeMesh { id: b, lods: vec![lod(0.01, 4000), lod(0.25, 700)] },
            NodeMesh { id: c, lods: vec![lod(0.5, 100_000)] },
        ];
        let deviation = |k: u16| NodeDeviation {
            drawn_m: f32::from(k) / 100.0,
            drawn_max_m: 2.0,
            source_m: 0.5,
            source_max_m: f32::from(u16::MAX - k) / 100.0,
        };
        let nodes = vec![node(root, 0b0110), node(a, 0b1000), node(b, 0), node(c, 0)];
        Subtree { nodes, meshes, deviations: (0..4).map(|k| deviation(777 * k)).collect() }
    }

    #[test]
    fn nodes_and_meshes_round_trip() {
        let bytes = sample().encode().unwrap();
        assert_eq!(Subtree::decode(&bytes).unwrap(), sample());
    }

    #[test]
    fn truncated_flipped_and_extra_bytes_are_refused() {
        let bytes = sample().encode().unwrap();
        for len in 0..bytes.len() {
            assert!(Subtree::decode(&bytes[..len]).is_err(), "{len}");
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert_eq!(Subtree::decode(&longer), Err(DecodeError::TrailingBytes(1)));
        for at in 0..bytes.len() {
            let mut wrong = bytes.clone();
            wrong[at] ^= 0x10;
            assert!(Subtree::decode(&wrong).is_err(), "{at}");
        }
    }

    #[test]
    fn deviations_are_rounded_up_once_and_there_is_one_for_each_node() {
        for k in 0..=u16::MAX {
            assert_eq!(centimetres(f32::from(k) / 100.0), k);
        }
        assert_eq!([0.0, 0.001, 0.011, 654.321, 9e9, f32::NAN].map(centimetres), [0, 1, 2, 65433, 65535, 0]);
        let mut fewer = sample();
        fewer.deviations.pop();
        assert!(fewer.encode().is_err());
        let unmeasured = Subtree { deviations: Vec::new(), ..sample() };
        assert_eq!(Subtree::decode(&unmeasured.encode().unwrap()).unwrap(), unmeasured);
        assert!(read_deviations(&[0; 24], 4).is_err());
    }

    #[test]
    fn the_mesh_section_is_omitted_without_meshes() {
        let plain = Subtree { meshes: Vec::new(), ..sample() };
        let bytes = plain.encode().unwrap();
        assert_eq!(Subtree::decode(&bytes).unwrap(), plain);
        assert!(TileReader::new(&bytes, TileKind::Subtree).unwrap().section(TAG_MESHES, 1 << 20).unwrap().is_empty());
    }

    #[test]
    fn invalid_meshes_are_refused() {
        let wrong = |change: fn(&mut Subtree)| {
            let mut subtree = sample();
            change(&mut subtree);
            assert!(subtree.encode().is_err());
        };
        wrong(|s| s.meshes[0].lods.clear());
        wrong(|s| s.meshes[0].lods = vec![s.meshes[1].lods[0]; 7]);
        wrong(|s| s.meshes[0].lods[1].error_m = 0.001);
        wrong(|s| s.meshes[0].lods[0].error_m = f32::NAN);
        wrong(|s| s.meshes[0].lods[0].triangles = 0);
        wrong(|s| s.meshes[0].lods[0].texture_px = MAX_TEXTURE_PX + 1);
        wrong(|s| s.meshes[0].id = TileId::ROOT);
        wrong(|s| s.meshes.swap(0, 1));
        for counts in [vec![0, 0, 0, 5], vec![0, 0, 1], vec![0, 1, 0, 0], vec![0; 4]] {
            let raw = [counts, vec![0; 7]].concat();
            assert!(read_meshes(&raw, &sample().nodes).is_err());
        }
    }

    #[test]
    fn deviations_are_rounded_up_to_centimetres() {
        let rounded = NodeDeviation::from_values([0.0, 0.121, 1.239, 30.5]).rounded();
        assert_eq!(rounded.values(), [0.0, 0.13, 1.24, 30.5]);
        assert_eq!(rounded.rounded(), rounded);
    }

    #[test]
    fn root_of_gives_the_tile_that_lists_the_children() {
        let id = TileId::new(7, 100, 3).unwrap();
        let root = TileId::new(5, 25, 0).unwrap();
        assert_eq!([Subtree::root_of(id), Subtree::root_of(root)], [root; 2]);
        assert_eq!(Subtree::root_of(TileId::new(4, 15, 0).unwrap()), TileId::ROOT);
        assert!(Subtree::is_root(TileId::ROOT) && !Subtree::is_root(id));
    }
}
