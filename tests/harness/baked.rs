//! A baked city read from its folder, without HTTP or cache: the tiles of a client that has fetched everything.

use crate::draw_list::{CityArea, DrawList};
use crate::view::{Camera, FrameSpec};
use anyhow::{Context, Result};
use glam::{DVec2, DVec3};
use insula_protocol::blockmap::NodeGround;
use insula_protocol::subtree::{MeshLod, NodeInfo};
use insula_protocol::{BlockMap, Manifest, Subtree, TileId, TileKind};
use insula_server::store::CityStore;
use insula_viewer::camera::{FrustumPlane, View};
use insula_viewer::select::cull::is_box_in_view;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Least distance in the projected error, as in the client.
const NEAR_M: f64 = 1.0;

pub fn planes(camera: &Camera, spec: &FrameSpec) -> [FrustumPlane; 5] {
    let axes = camera.axes(spec);
    let unit = |v: DVec3| v.normalize_or(DVec3::X);
    let client = insula_viewer::camera::Camera {
        position: camera.position.into(),
        forward: axes.forward,
        right: unit(axes.right),
        up: unit(axes.up),
        fov_y_rad: camera.fov_y_deg.to_radians(),
    };
    View::of(client, [spec.width_px, spec.height_px]).planes()
}

pub struct Baked {
    pub(crate) store: CityStore,
    pub(crate) nodes: HashMap<TileId, NodeInfo>,
    /// Meshes of leaves by level of detail, the finest first.
    pub(crate) meshes: HashMap<TileId, Vec<MeshLod>>,
}

impl Baked {
    /// Reads the manifest and every subtree.
    pub fn open(folder: &Path) -> Result<Self> {
        let store = CityStore::open(folder).with_context(|| folder.display().to_string())?;
        let (mut nodes, mut meshes) = (HashMap::new(), HashMap::new());
        for (id, bytes) in store.subtrees().tiles() {
            let subtree = Subtree::decode(&bytes?).with_context(|| format!("subtree {id}"))?;
            nodes.extend(subtree.nodes.iter().map(|node| (node.id, *node)));
            meshes.extend(subtree.meshes.into_iter().map(|mesh| (mesh.id, mesh.lods)));
        }
        Ok(Self { store, nodes, meshes })
    }

    pub fn manifest(&self) -> &Manifest {
        self.store.manifest()
    }

    /// Number of nodes and bytes of their tiles, by level.
    pub fn levels(&self) -> BTreeMap<u8, (usize, usize)> {
        let mut levels = BTreeMap::new();
        for (id, bytes) in self.store.blockmaps().lengths() {
            let level: &mut (usize, usize) = levels.entry(id.level()).or_default();
            level.0 += 1;
            level.1 += bytes.expect("its directory could be read when the city was opened") as usize;
        }
        levels
    }

    /// The stated error of a node.
    pub fn error_m(&self, id: TileId) -> Option<f64> {
        self.nodes.get(&id).map(|node| f64::from(node.error_m))
    }

    /// The nodes of a level in ascending order.
    pub fn ids(&self, level: u8) -> Vec<TileId> {
        let mut ids: Vec<TileId> = self.nodes.keys().copied().filter(|id| id.level() == level).collect();
        ids.sort();
        ids
    }

    pub fn maps(&self, level: u8) -> Result<Vec<BlockMap>> {
        let tiles = self.store.blockmaps().tiles().filter(|(id, _)| id.level() == level);
        tiles.map(|(id, bytes)| decode(id, &bytes?)).collect()
    }

    /// Position and target of views in the middle of the city: in a street, above the roofs, from the air, from afar.
    pub fn overviews(&self) -> [(&'static str, [DVec3; 2]); 4] {
        let manifest = self.manifest();
        let [low, high] = manifest.focus.map(DVec2::from);
        let (middle, ground) = ((low + high) / 2.0, manifest.ground_z_m);
        let reach = (high - low).min_element().min(1200.0);
        let at = |x: f64, y: f64, up: f64| (middle + DVec2::new(x, y)).extend(ground + up);
        [
            ("street", [at(-60.0, -60.0, 8.0), at(60.0, 60.0, 6.0)]),
            ("roof", [at(-100.0, -100.0, 60.0), at(100.0, 100.0, 20.0)]),
            ("air", [at(-0.2 * reach, -0.8 * reach, 0.5 * reach), at(0.0, 0.0, 0.0)]),
            ("far", [at(-0.5 * reach, -1.6 * reach, 0.35 * reach), at(0.0, 0.0, 0.0)]),
        ]
    }

    /// The nodes that a view needs at `tau_px`, in all directions (docs/selection.md).
    pub fn select(&self, camera: &Camera, spec: &FrameSpec, tau_px: f64) -> Vec<TileId> {
        let px_per_rad = f64::from(spec.height_px) / (2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan());
        let eye = DVec3::from(camera.position);
        let mut chosen = Vec::new();
        let mut open = vec![TileId::ROOT];
        while let Some(id) = open.pop() {
            let Some(node) = self.nodes.get(&id) else { continue };
            let half_m = self.manifest().node_side_m(id.level()) / 2.0;
            let centre_z = f64::from(node.z_min_m + node.z_max_m) / 2.0;
            let centre = DVec3::from(self.manifest().node_corner(id)) + DVec3::new(half_m, half_m, centre_z);
            let away_m = (eye.distance(centre) - f64::from(node.radius_m)).max(NEAR_M);
            if node.child_mask == 0 || f64::from(node.error_m) * px_per_rad / away_m <= tau_px {
                chosen.push(id);
            } else {
                open.extend((0..4).filter(|q| node.child_mask >> q & 1 == 1).filter_map(|q| id.child(q)));
            }
        }
        chosen.sort();
        chosen
    }

    /// Those of [`Baked::select`] that are in the view frustum.
    pub fn select_in_view(&self, camera: &Camera, spec: &FrameSpec, tau_px: f64) -> Vec<TileId> {
        let planes = planes(camera, spec);
        let mut chosen = self.select(camera, spec, tau_px);
        chosen.retain(|id| {
            let Some(node) = self.nodes.get(id) else { return false };
            let half_m = self.manifest().node_side_m(id.level()) / 2.0;
            let [low, high] = [node.z_min_m, node.z_max_m].map(f64::from);
            let corner = DVec3::from(self.manifest().node_corner(*id));
            let half = DVec3::new(half_m, half_m, (high - low) / 2.0);
            is_box_in_view(&planes, corner + half + DVec3::Z * low, half)
        });
        chosen
    }

    pub fn leaves(&self) -> Result<BTreeMap<TileId, BlockMap>> {
        let depth = self.manifest().depth;
        let leaves = self.store.blockmaps().tiles().filter(|(id, _)| id.level() == depth);
        leaves.map(|(id, bytes)| Ok((id, decode(id, &bytes?)?))).collect()
    }

    /// The generated ground of all leaves that have some, with the height of its zero above the city's origin in metres.
    pub fn grounds(&self) -> Result<BTreeMap<TileId, (f64, NodeGround)>> {
        let depth = self.manifest().depth;
        let leaves = self.store.blockmaps().tiles().filter(|(id, _)| id.level() == depth);
        let mut grounds = BTreeMap::new();
        for (id, bytes) in leaves {
            let map = BlockMap::decode(id, &bytes?).with_context(|| format!("tile {id}"))?;
            let base_m = map.z_base_m();
            grounds.extend(map.ground.map(|ground| (id, (base_m, *ground))));
        }
        Ok(grounds)
    }

    pub fn draw_list(&self, ids: &[TileId]) -> Result<DrawList> {
        let manifest = self.manifest();
        let mut draw_list = DrawList::new(CityArea { origin: manifest.origin, root_side_m: manifest.root_side_m });
        for id in ids {
            draw_list.add(&self.map(*id)?);
        }
        Ok(draw_list)
    }

    pub fn map(&self, id: TileId) -> Result<BlockMap> {
        let bytes = self.store.tile(TileKind::BlockMap, id)?.with_context(|| format!("no tile {id}"))?;
        decode(id, &bytes)
    }
}

/// A node with its ground, as a client draws it.
fn decode(id: TileId, bytes: &[u8]) -> Result<BlockMap> {
    Ok(BlockMap::decode(id, bytes).with_context(|| format!("tile {id}"))?.stand_on_ground())
}
