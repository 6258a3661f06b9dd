//! Bounds and geometric errors of all nodes, and the subtree tiles that describe them to clients.
//!
//! Spheres and errors nest: a node's sphere contains its children's, and its error is at least theirs. A node's error is half the
//! diagonal of its voxel, which also bounds the size of what it colours, or what was measured, if that is more.

use super::tile_pack::{PackId, StoredMesh, StoredTile};
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::scene::grid::CityGrid;
use insula_protocol::blockmap::{self, MIN_NORMAL_Z, flag, voxel_error_m};
use insula_protocol::subtree::{LEVELS, NodeInfo, NodeMesh};
use insula_protocol::{BlockMap, Subtree, TileId, octahedral};
use std::collections::HashSet;

/// The packed tiles of all nodes, the root's level first, each level in the order of its ids.
#[derive(Debug, Default)]
pub(crate) struct TileTree {
    levels: Vec<Vec<StoredTile>>,
    /// In the order of leaf and level of detail.
    meshes: Vec<StoredMesh>,
}

impl TileTree {
    /// An empty tree with levels `0..=depth`.
    pub(crate) fn new(depth: u8) -> Self {
        Self { levels: vec![Vec::new(); usize::from(depth) + 1], meshes: Vec::new() }
    }

    pub(crate) fn set(&mut self, level: u8, mut tiles: Vec<StoredTile>) {
        tiles.sort_unstable_by_key(|tile| tile.id);
        self.levels[usize::from(level)] = tiles;
    }

    pub(crate) fn set_meshes(&mut self, mut meshes: Vec<StoredMesh>) {
        meshes.sort_unstable_by_key(|mesh| (mesh.id, mesh.lod));
        self.meshes = meshes;
    }

    /// All meshes in the order of leaf and level of detail.
    pub(crate) fn meshes(&self) -> &[StoredMesh] {
        &self.meshes
    }

    /// The levels of detail of a leaf, the finest first; empty if it has no mesh.
    pub(crate) fn mesh(&self, leaf: TileId) -> &[StoredMesh] {
        let from = self.meshes.partition_point(|mesh| mesh.id < leaf);
        let count = self.meshes[from..].iter().take_while(|mesh| mesh.id == leaf).count();
        &self.meshes[from..from + count]
    }

    pub(crate) fn level(&self, level: u8) -> &[StoredTile] {
        self.levels.get(usize::from(level)).map_or(&[], Vec::as_slice)
    }

    /// The tiles of all levels, the root's first.
    pub(crate) fn levels(&self) -> &[Vec<StoredTile>] {
        &self.levels
    }

    /// The tile of a node, if the node exists.
    pub(crate) fn get(&self, id: TileId) -> Option<&StoredTile> {
        find_by_id(self.level(id.level()), id, |tile| tile.id)
    }

    /// Removes the nodes that their parent shows as well, and that have no children left, from the finest level up; and their meshes, and
    /// the fingerprints of their blocks: an update bakes these again. The root keeps its children. Returns the removed leaves, in ascending
    /// order.
    pub(crate) fn merge_plain_nodes(&mut self, fingerprints: &mut Vec<((u32, u32), ShortHash)>) -> Vec<TileId> {
        let depth = self.levels.len().saturating_sub(1);
        let mut leaves = Vec::new();
        for level in (1..depth).rev() {
            let shown: Vec<TileId> =
                self.levels[level].iter().filter(|tile| tile.shows_children).map(|tile| tile.id).collect();
            let (level, grandchildren) = (level as u8, level as u8 + 2);
            let is_childless = |id: TileId| !id.children().any(|child| self.get(child).is_some());
            let merged: Vec<TileId> = match usize::from(grandchildren) <= depth {
                true => shown.into_iter().filter(|id| id.children().all(is_childless)).collect(),
                false => shown,
            };
            let is_merged = |id: TileId| id.parent().is_some_and(|parent| merged.binary_search(&parent).is_ok());
            let children = &mut self.levels[usize::from(level) + 1];
            if usize::from(level) + 1 == depth {
                leaves = children.iter().map(|tile| tile.id).filter(|id| is_merged(*id)).collect();
            }
            children.retain(|tile| !is_merged(tile.id));
        }
        self.meshes.retain(|mesh| leaves.binary_search(&mesh.id).is_err());
        let blocks: HashSet<(u32, u32)> =
            leaves.iter().map(|id| PackId::of(*id)).map(|pack| (pack.x, pack.y)).collect();
        fingerprints.retain(|(place, _)| !blocks.contains(place));
        leaves
    }

    /// The parents of the nodes of `level`, in the order of their ids.
    pub(crate) fn parents_of(&self, level: u8) -> Vec<TileId> {
        let mut parents: Vec<TileId> = self.level(level).iter().filter_map(|tile| tile.id.parent()).collect();
        parents.sort_unstable();
        parents.dedup();
        parents
    }
}

fn find_by_id<T>(sorted: &[T], id: TileId, id_of: impl Fn(&T) -> TileId) -> Option<&T> {
    sorted.binary_search_by_key(&id, id_of).ok().map(|i| &sorted[i])
}

/// Lowest and highest point of a map's columns in metres above the city's origin; `None` without columns.
///
/// An inclined top is a plane through the cell's centre, so one of its corners is higher than the column. It is cut off
/// at the column's bottom, so it is never lower.
pub(crate) fn z_bounds(map: &BlockMap) -> Option<[f64; 2]> {
    let step = f64::from(map.z_step_m());
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for i in (0..blockmap::COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
        low = low.min(f64::from(map.z_min[i]) * step);
        let mut top = f64::from(map.z_max[i]) * step;
        if map.flags[i] & flag::INCLINED != 0 {
            let n = octahedral::decode(map.roof_normal[i]);
            let slope = (n[0].abs() + n[1].abs()) / n[2].max(MIN_NORMAL_Z);
            top += f64::from(slope * map.cell_m / 2.0);
        }
        high = high.max(top);
    }
    (low <= high).then(|| [low, high].map(|z| map.z_base_m() + z))
}

/// Rounds bounds to f32, outwards.
pub(crate) fn round_outward([low, high]: [f64; 2]) -> [f32; 2] {
    let (l, h) = (low as f32, high as f32);
    let l = if f64::from(l) > low { l.next_down() } else { l };
    [l, if f64::from(h) < high { h.next_up() } else { h }]
}

/// Describes every node; one list per level, in the order of `tree`.
pub(crate) fn describe(tree: &TileTree, grid: &CityGrid) -> Vec<Vec<NodeInfo>> {
    let mut described: Vec<Vec<NodeInfo>> = vec![Vec::new(); tree.levels().len()];
    for level in (0..tree.levels().len()).rev() {
        let below: &[NodeInfo] = described.get(level + 1).map_or(&[], Vec::as_slice);
        let nodes = tree.levels()[level].iter().map(|tile| describe_node(grid, tile, below)).collect();
        described[level] = nodes;
    }
    described
}

fn describe_node(grid: &CityGrid, tile: &StoredTile, below: &[NodeInfo]) -> NodeInfo {
    let side = grid.node_side_m(tile.id.level());
    let half_height = (f64::from(tile.z_max_m) - f64::from(tile.z_min_m)) / 2.0;
    let mut node = NodeInfo {
        id: tile.id,
        child_mask: 0,
        z_min_m: tile.z_min_m,
        z_max_m: tile.z_max_m,
        error_m: (voxel_error_m(grid.cell_m_at(tile.id.level())) as f32)
            .max(tile.deviation.drawn_m)
            .max(tile.deviation.source_m),
        radius_m: 0.0,
        blockmap_bytes: tile.bytes,
    };
    let mut radius = (side * side / 2.0 + half_height * half_height).sqrt();
    let centre = centre_m(grid, &node);
    for child in tile.id.children().filter_map(|id| find_by_id(below, id, |node| node.id)) {
        node.child_mask |= 1 << child.id.quadrant();
        node.error_m = node.error_m.max(child.error_m);
        let c = centre_m(grid, child);
        let distance = (0..3).map(|axis| (c[axis] - centre[axis]).powi(2)).sum::<f64>().sqrt();
        radius = radius.max(distance + f64::from(child.radius_m));
    }
    // Clients compute in f32: an additional millionth keeps the spheres nested there too.
    node.radius_m = ((radius * (1.0 + 1e-6)) as f32).next_up();
    node
}

/// Centre of a node's bounding box, in metres from the grid's corner.
fn centre_m(grid: &CityGrid, node: &NodeInfo) -> [f64; 3] {
    let side = grid.node_side_m(node.id.level());
    let [x, y] = [node.id.x(), node.id.y()].map(|v| (f64::from(v) + 0.5) * side);
    [x, y, (f64::from(node.z_min_m) + f64::from(node.z_max_m)) / 2.0]
}

/// Encodes the subtree tile rooted at `root`; `nodes` are those of [`describe`]. Fails if it exceeds the format's
/// limits.
pub(crate) fn encode_subtree(tree: &TileTree, nodes: &[Vec<NodeInfo>], root: TileId) -> Result<Vec<u8>, BakeError> {
    let mut found: Vec<NodeInfo> = Vec::new();
    let mut row = vec![root];
    for level in usize::from(root.level())..nodes.len().min(usize::from(root.level() + LEVELS) + 1) {
        let start = found.len();
        found.extend(row.iter().filter_map(|id| find_by_id(&nodes[level], *id, |node| node.id)));
        let children = |node: &NodeInfo| {
            let (id, mask) = (node.id, node.child_mask);
            (0..4).filter(move |q| mask >> q & 1 == 1).filter_map(move |q| id.child(q))
        };
        row = found[start..].iter().flat_map(children).collect();
    }
    let meshes = found.iter().filter_map(|node| {
        let lods: Vec<_> = tree.mesh(node.id).iter().map(|mesh| mesh.info).collect();
        (!lods.is_empty()).then_some(NodeMesh { id: node.id, lods })
    });
    let meshes = meshes.collect();
    let deviations =
        found.iter().map(|node| tree.get(node.id).map_or_else(Default::default, |tile| tile.deviation)).collect();
    Subtree { nodes: found, meshes, deviations }.encode().map_err(BakeError::tile(root, "encoded"))
}

/// Roots of all subtree tiles: the city's root, and the nodes of levels 5, 10, ... that have children.
pub(crate) fn subtree_roots(nodes: &[Vec<NodeInfo>]) -> Vec<TileId> {
    let roots = nodes.iter().step_by(usize::from(LEVELS)).flatten();
    roots.filter(|node| node.child_mask != 0 || node.id == TileId::ROOT).map(|node| node.id).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write::tile_pack::{self, EncodedPack, EncodedTile};
    use insula_protocol::Texel;
    use insula_protocol::blockmap::MapColumn;

    #[test]
    fn nodes_that_their_parent_shows_are_removed() {
        let folder = insula_test_support::folder::TestFolder::new("merge-plain");
        let mut tree = TileTree::new(3);
        let id = |level, x, y| TileId::new(level, x, y).unwrap();
        // One quarter of the city is plain, of another one only a part.
        let plain = [id(1, 0, 0), id(2, 0, 0), id(2, 1, 0), id(2, 0, 1), id(2, 1, 1), id(1, 1, 0), id(2, 2, 0)];
        for level in 0..=3_u8 {
            let side = 1 << level;
            let nodes = (0..side * side).map(|i| id(level, i % side, i / side)).filter(|id| id.y() < side.div_ceil(2));
            let tiles: Vec<EncodedTile> = nodes
                .map(|id| EncodedTile {
                    id,
                    z_min_m: 0.0,
                    z_max_m: 1.0,
                    deviation: Default::default(),
                    points: Vec::new(),
                    bytes: vec![0; 4],
                    shows_children: level == 0 || plain.contains(&id),
                })
                .collect();
            let groups = tile_pack::PackNodes::group(tiles.iter().map(|tile| tile.id).collect());
            let packs = groups.iter().flat_map(|group| {
                let of_pack: Vec<EncodedTile> =
                    tiles.iter().filter(|tile| group.nodes.contains(&tile.id)).cloned().collect();
                let content = EncodedPack { tiles: of_pack, meshes: Vec::new() };
                tile_pack::write(&folder.path, group.pack, [0; 16], &content).unwrap().tiles
            });
            tree.set(level, packs.collect());
        }
        let mut fingerprints: Vec<_> = (0..16).map(|i| ((i % 4, i / 4), [1; 16])).collect();
        let leaves = tree.merge_plain_nodes(&mut fingerprints);
        assert_eq!(fingerprints.len(), 16 - leaves.len() / 4);
        assert_eq!(leaves.len(), 16 + 4);
        assert!(leaves.is_sorted() && leaves.contains(&id(3, 3, 3)) && leaves.contains(&id(3, 5, 1)));
        let counts: Vec<usize> = tree.levels().iter().map(Vec::len).collect();
        assert_eq!(counts, [1, 2, 8 - 4, 32 - 16 - 4]);
        assert!(tree.get(id(2, 2, 0)).is_some() && tree.get(id(2, 1, 1)).is_none());
    }

    fn map(columns: &[(usize, MapColumn)]) -> BlockMap {
        let mut all = vec![None; blockmap::COLUMNS];
        for (i, column) in columns {
            all[*i] = Some(column.clone());
        }
        BlockMap::from_columns(TileId::ROOT, 2.0, 10, 0, &all).unwrap()
    }

    fn column(z_min: u16, z_max: u16, normal: Option<[f32; 3]>) -> MapColumn {
        MapColumn {
            z_min,
            z_max,
            inclined: normal.is_some(),
            roof: Texel::default(),
            roof_normal: octahedral::encode(normal.unwrap_or([0.0, 0.0, 1.0])),
            ..MapColumn::default()
        }
    }

    #[test]
    fn bounds_include_the_slope_of_inclined_tops() {
        assert_eq!(z_bounds(&map(&[])), None);
        let flat = map(&[(0, column(16, 32, None)), (99, column(8, 24, None))]);
        assert_eq!(z_bounds(&flat), Some([21.0, 24.0]));
        let at_45 = std::f32::consts::FRAC_1_SQRT_2;
        let [low, high] = z_bounds(&map(&[(5, column(16, 32, Some([at_45, 0.0, at_45])))])).unwrap();
        assert_eq!(low, 22.0);
        assert!((high - 25.0).abs() < 0.05, "{high}");
        let [_, upright] = z_bounds(&map(&[(5, column(16, 32, Some([1.0, 0.0, 0.0])))])).unwrap();
        assert!((upright - 34.0).abs() < 0.05, "{upright}");
    }

    #[test]
    fn rounding_outward_never_shrinks_bounds() {
        for z in [[0.1, 0.2], [-0.1, 1e7 + 0.3], [5.0, 5.0], [-123.456_789, 123.456_789]] {
            let [low, high] = round_outward(z);
            assert!(f64::from(low) <= z[0] && f64::from(high) >= z[1]);
        }
        assert_eq!(round_outward([0.5, 2.0]), [0.5, 2.0]);
    }
}
