//! Which nodes to draw for a view, and which tiles to fetch for a better picture (design 4 and 8).
//!
//! In: [`View`], [`SceneTree`]. Out: [`Selection`]. Next: `stream::queue` asks, `render::frame` draws.
//!
//! Pure: knows neither wgpu nor HTTP nor the time. Three steps: **visit** from the root by falling error until everything
//! that is seen is good enough (or the cache's budget is spent: then tau has risen to the error of what was refused), **cut**
//! what can be drawn of it, **want** what is missing. What is hidden behind something else ([`sight`]) is good enough
//! [`OCCLUDED_TAU_FACTOR`] times earlier.
//!
//! The cut is a set of squares that covers what the root covers; each is drawn from its own tile, or from the nearest
//! resident ancestor's part of it. So there is never a hole, and rays can tell which square they hit before its tile is here.

pub mod cull;
pub mod error;
pub mod horizon_culling;
mod meshes;
pub mod occlusion_feedback;
pub mod priority;
pub mod shadow_casters;
#[cfg(test)]
pub(crate) mod tests;
pub mod transitions;

use crate::{
    camera::{FrustumPlane, NEAR_M, View},
    scene::{NodeIndex, SceneTree, TileKey, TreeNode},
};
use glam::DVec3;
use insula_protocol::{Subtree, TileId, subtree::LEVELS};
use occlusion_feedback::{OcclusionFeedback, Visibility};
use priority::TileRequest;
use std::{cmp::Ordering, collections::BinaryHeap, ops::Range};

/// What nobody can know to be seen is refined only while its error is over this many times tau. It costs a share of one over
/// its square, and what suddenly is seen is no coarser than that.
pub const UNKNOWN_TAU_FACTOR: f64 = 16.0;
/// The same for what is known to be hidden.
pub const OCCLUDED_TAU_FACTOR: f64 = 64.0;

/// A length, for an order by distance.
const NEAR_FIRST_M: f64 = 64.0;

/// A square that is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawTile {
    /// Which square.
    pub node: NodeIndex,
    /// Whose tile is drawn there: its own, or an ancestor's. Resident.
    pub source: NodeIndex,
    /// Which level of detail of the square's mesh is drawn in place of that tile, which tells how much sky is seen
    /// (`meshes::sky_source`). Resident, too.
    pub mesh_lod: Option<u8>,
}

/// What a frame draws and lacks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Selection {
    /// Squares to draw; none lies in another.
    pub draw_tiles: Vec<DrawTile>,
    /// Squares of the cut that are not known to be hidden.
    pub unoccluded: Vec<NodeIndex>,
    /// Leaves that are seen and shown by their meshes, or will be once those are here.
    pub mesh_leaves: Vec<NodeIndex>,
    /// Resident nodes that this view needs (what is drawn and its ancestors), coarsest first: not to be evicted.
    pub used_nodes: Vec<NodeIndex>,
    /// Resident meshes that this view needs: not to be evicted.
    pub used_meshes: Vec<TileKey>,
    /// Tiles to fetch, in order.
    pub requests: Vec<TileRequest>,
    /// The counts.
    pub stats: SelectionStats,
}

/// Counts of one selection.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SelectionStats {
    /// Nodes looked at.
    pub visited: u32,
    /// Children outside the frustum.
    pub culled: u32,
    /// Squares in the cut.
    pub drawn: u32,
    /// Visited nodes that are hidden, or too new to know.
    pub not_visible: u32,
    /// Refinements given up because a child is bad.
    pub blocked: u32,
    /// Pages of all nodes and meshes that the view asks for.
    pub pages: u32,
    /// Squares of the cut that are drawn as meshes.
    pub meshes: u32,
    /// Triangles of those.
    pub triangles: u64,
    /// The view's tau, or what it rose to because the budget was spent.
    pub tau_px: f64,
    /// Largest projected error that is drawn and not known to be hidden.
    pub worst_error_px: f64,
    /// Largest projected error that is drawn and known to be seen.
    pub visible_error_px: f64,
}

/// Memory that is used again from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct SelectionScratch {
    visits: Vec<Visit>,
    heap: BinaryHeap<Candidate>,
    stack: Vec<(u32, Cover)>,
}

/// Whose tile is drawn in a square, and how wrong that is.
type Cover = Option<(NodeIndex, f64)>;

#[derive(Debug, Clone)]
struct Visit {
    at: NodeIndex,
    error_px: f64,
    sighted: Visibility,
    /// Whether the view asks for its tile; else it is drawn from what there is.
    asked: bool,
    /// Whether it would be asked for even if it were hidden.
    coarse: bool,
    /// Children in view, as visits; `None` if not refined.
    children: Option<Range<u32>>,
    /// The level of detail of its mesh that the view asks for.
    mesh: Option<u8>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    error_px: f64,
    visit: u32,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error_px.total_cmp(&other.error_px).then(other.visit.cmp(&self.visit))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Selects for one frame, by what the last frames saw.
pub fn select(view: &View, tree: &SceneTree, sight: &OcclusionFeedback, scratch: &mut SelectionScratch) -> Selection {
    let mut selection = Selection::default();
    selection.stats.tau_px = view.tau_px;
    jump(view, tree, &mut selection);
    Visitor { view, tree, sight, planes: view.planes(), eye: view.camera.position, focal_px: view.focal_px() }
        .visit(scratch, &mut selection);
    cut(view, tree, scratch, &mut selection);
    want(view, tree, scratch, &mut selection);
    selection
}

/// The subtrees of the eye's own place, at all levels at once: far away from all that is known, one round trip brings what
/// exists there, and a second one the tiles, however deep the city is.
fn jump(view: &View, tree: &SceneTree, selection: &mut Selection) {
    let manifest = tree.manifest();
    let place = (view.camera.position - DVec3::from(manifest.origin)) / manifest.root_side_m;
    let inside = |v: f64| (0.0..1.0).contains(&v);
    if !inside(place.x) || !inside(place.y) {
        return;
    }
    let above_m = (view.camera.position.z - manifest.ground_z_m).max(NEAR_M);
    for level in (0..manifest.depth).step_by(usize::from(LEVELS)).skip(1) {
        let squares = f64::from(1u32 << level);
        let Some(id) = TileId::new(level, (place.x * squares) as u32, (place.y * squares) as u32) else { return };
        // Half a voxel's diagonal is the least that its nodes are wrong.
        let needed = 0.866 * manifest.cell_m_at(level) * view.focal_px() / above_m > view.tau_px;
        let above = id.parent().map(Subtree::root_of).is_some_and(|root| tree.subtree(root).is_resident());
        let exists = match tree.find(id) {
            Some(at) => tree.node(at).child_mask != 0,
            None => !above,
        };
        let state = tree.subtree(id);
        if needed && exists && !state.is_bad() && !state.is_resident() {
            let key = TileKey::subtree(id);
            selection.requests.push(TileRequest { key, group: priority::PriorityGroup::Urgent, weight: f64::INFINITY });
        }
    }
}

/// What became of a node that should be refined.
enum Children {
    /// It has none: as good as it gets.
    None,
    /// A subtree is missing, or a child is bad: it stays.
    Stays,
    /// The ones in view, and what is known of them.
    InView([Option<(NodeIndex, Visibility)>; 4]),
}

struct Visitor<'a> {
    view: &'a View,
    tree: &'a SceneTree,
    sight: &'a OcclusionFeedback,
    planes: [FrustumPlane; 5],
    eye: DVec3,
    focal_px: f64,
}

impl Visitor<'_> {
    fn error_px(&self, node: &TreeNode) -> f64 {
        error::error_px(node.error_m, node.centre, node.radius_m, self.eye, self.focal_px, NEAR_M)
    }

    fn visit(&self, scratch: &mut SelectionScratch, selection: &mut Selection) {
        scratch.visits.clear();
        scratch.heap.clear();
        let Some(root) = self.tree.root() else {
            // There is always a root: no need to be told of it first.
            let key = TileKey::block_map(TileId::ROOT);
            if self.tree.tile(key).is_some_and(|tile| !tile.is_resident() && !tile.is_bad()) {
                selection.requests.push(TileRequest {
                    key,
                    group: priority::PriorityGroup::Urgent,
                    weight: f64::INFINITY,
                });
            }
            self.want_subtree(TileId::ROOT, f64::INFINITY, selection);
            return;
        };
        let node = self.tree.node(root);
        if !cull::in_view(&self.planes, node.centre, node.half) {
            selection.stats.culled += 1;
            return;
        }
        self.push(root, (Visibility::Visible, true, true), scratch, selection);
        let stands = self.sight.is_camera_still(self.view);
        while let Some(Candidate { error_px, visit }) = scratch.heap.pop() {
            let Visit { at, sighted, coarse: was_coarse, .. } = scratch.visits[visit as usize];
            if error_px <= self.view.tau_px {
                self.stand_in(visit, scratch, selection);
                continue;
            }
            if !self.tree.node(at).lods.is_empty() {
                if sighted == Visibility::Visible && !self.ask_mesh(visit, scratch, selection) {
                    selection.stats.tau_px = error_px;
                    break;
                }
                continue;
            }
            // Nearly as wrong as what may never be seen: its children are asked for even if nobody sees them.
            let is_coarse = |sighted: Visibility| {
                let times = if sighted == Visibility::Occluded { OCCLUDED_TAU_FACTOR } else { UNKNOWN_TAU_FACTOR };
                error_px > self.view.tau_px * times
            };
            let coarse = is_coarse(sighted);
            let passed_over = self.is_skipped_level(self.tree.node(at));
            let is_split = match sighted {
                Visibility::Visible => true,
                Visibility::Unknown => coarse || passed_over || self.any_child_is_here(at),
                // Else it would become coarser, look over what hides it, be seen, become finer, be hidden again.
                Visibility::Occluded if stands => self.sight.was_visible(at) && knows_children(self.tree.node(at)),
                Visibility::Occluded => coarse,
            };
            if !is_split {
                continue;
            }
            let Children::InView(children) = self.children((at, sighted), error_px, selection) else { continue };
            let asked = |at: NodeIndex, sighted: Visibility| {
                sighted == Visibility::Visible
                    || !stands && is_coarse(sighted) && !self.skips_columns(self.tree.node(at))
            };
            let (nodes, pages) = self.cost(&children, asked);
            let counters = &selection.stats;
            if counters.pages + pages > self.view.budget_pages || counters.visited + nodes > self.view.budget_nodes {
                selection.stats.tau_px = error_px;
                break;
            }
            let first = scratch.visits.len() as u32;
            for (child, sighted) in children.into_iter().flatten() {
                self.push(child, (sighted, asked(child, sighted), is_coarse(sighted)), scratch, selection);
            }
            let end = scratch.visits.len() as u32;
            let refined = &mut scratch.visits[visit as usize];
            refined.children = Some(first..end);
            // On the way from four tau to one, the step between shows little for its bytes.
            let last_step = !was_coarse && error_px <= 2.0 * self.view.tau_px;
            if (last_step || passed_over) && refined.asked && !self.tree.node(at).tile.is_resident() {
                refined.asked = false;
                selection.stats.pages -= self.tree.node_pages(at);
            }
        }
    }

    /// Whether a node that is refined is not fetched for its own sake: those of every second level, from the leaves' parents up,
    /// are only steps on the way. From its parent's part, rays tell which of its children are seen. Not while nobody tells.
    fn is_skipped_level(&self, node: &TreeNode) -> bool {
        is_step(node, self.tree) && self.sight.has_feedback() && !meshes::is_under_way(node.tile)
    }

    /// Whether anything of a node can be drawn without its parent: from its own tile, or from its mesh or its children's.
    fn is_here(&self, at: NodeIndex) -> bool {
        let resident = |at: NodeIndex| meshes::is_here(self.tree.node(at));
        let node = self.tree.node(at);
        let in_view = |at: &NodeIndex| {
            let node = self.tree.node(*at);
            cull::in_view(&self.planes, node.centre, node.half)
        };
        let parts = || node.children.into_iter().flatten().filter(in_view).any(resident);
        resident(at) || knows_children(node) && parts()
    }

    fn any_child_is_here(&self, at: NodeIndex) -> bool {
        let mut children = self.tree.node(at).children.into_iter().flatten();
        children.any(|child| self.is_here(child))
    }

    /// A node that is good enough but not here is drawn from those of its children that are: the camera moves away.
    fn stand_in(&self, visit: u32, scratch: &mut SelectionScratch, selection: &mut Selection) {
        let Visit { at, sighted, .. } = scratch.visits[visit as usize];
        let node = self.tree.node(at);
        if meshes::is_here(node) || !self.is_here(at) {
            return;
        }
        let first = scratch.visits.len() as u32;
        for child in node.children.into_iter().flatten() {
            let known = self.tree.node(child);
            if cull::in_view(&self.planes, known.centre, known.half) {
                self.push(child, (sighted, false, false), scratch, selection);
            }
        }
        scratch.visits[visit as usize].children = Some(first..scratch.visits.len() as u32);
    }

    fn push(
        &self,
        at: NodeIndex,
        (sighted, asked, coarse): (Visibility, bool, bool),
        scratch: &mut SelectionScratch,
        selection: &mut Selection,
    ) {
        let error_px = self.error_px(self.tree.node(at));
        scratch.heap.push(Candidate { error_px, visit: scratch.visits.len() as u32 });
        scratch.visits.push(Visit { at, error_px, sighted, asked, coarse, children: None, mesh: None });
        selection.stats.visited += 1;
        selection.stats.not_visible += u32::from(sighted != Visibility::Visible);
        selection.stats.pages += if asked { self.tree.node_pages(at) } else { 0 };
    }

    fn cost(
        &self,
        children: &[Option<(NodeIndex, Visibility)>; 4],
        asked: impl Fn(NodeIndex, Visibility) -> bool,
    ) -> (u32, u32) {
        let pages = |(child, seen): &(NodeIndex, Visibility)| {
            if asked(*child, *seen) { self.tree.node_pages(*child) } else { 0 }
        };
        children.iter().flatten().fold((0, 0), |(nodes, sum), child| (nodes + 1, sum + pages(child)))
    }

    fn children(&self, (at, sighted): (NodeIndex, Visibility), error_px: f64, selection: &mut Selection) -> Children {
        let node = self.tree.node(at);
        if node.child_mask == 0 {
            return Children::None;
        }
        let mut in_view = [None; 4];
        let mut stays = false;
        for quadrant in (0..4).filter(|q| node.child_mask >> q & 1 == 1) {
            let Some(child) = node.children[quadrant] else {
                stays |= self.unknown_child(node, quadrant, error_px, selection);
                continue;
            };
            let known = self.tree.node(child);
            if !cull::in_view(&self.planes, known.centre, known.half) {
                selection.stats.culled += 1;
            } else {
                in_view[quadrant] = Some((child, self.sight.visibility(child, self.tree, self.view, sighted)));
                if known.tile.is_bad() {
                    selection.stats.blocked += 1;
                    stays = true;
                }
            }
        }
        if stays { Children::Stays } else { Children::InView(in_view) }
    }

    /// A child that exists but whose subtree is not here; returns whether it is in view.
    fn unknown_child(&self, node: &TreeNode, quadrant: usize, error_px: f64, selection: &mut Selection) -> bool {
        let Some(id) = node.id.child(quadrant) else { return false };
        let (corner, side_m) = self.tree.square(id);
        // Its heights are not known: within its parent's.
        let half = DVec3::new(side_m * 0.5, side_m * 0.5, node.half.z);
        let centre = DVec3::new(corner[0] + half.x, corner[1] + half.y, node.centre.z);
        if !cull::in_view(&self.planes, centre, half) {
            selection.stats.culled += 1;
            return false;
        }
        let root = Subtree::root_of(node.id);
        self.want_subtree(root, priority::weight(error_px, centre, self.view), selection);
        true
    }

    fn want_subtree(&self, id: TileId, weight: f64, selection: &mut Selection) {
        if !self.tree.subtree(id).is_bad() {
            // Nothing below can even be asked for without it: as urgent as its node is wrong.
            let drawn_error_px = weight.is_finite().then_some(weight);
            let group = priority::group(drawn_error_px, self.view.tau_px);
            let key = TileKey::subtree(id);
            if !selection.requests.iter().any(|wanted| wanted.key == key) {
                selection.requests.push(TileRequest { key, group, weight });
            }
        }
    }
}

/// The squares that were visited and not refined, each with what can be drawn there: its own tile, or its part of what it lies
/// in. No square waits for those beside it: what is here stays when, as the camera turns, something comes in that is not.
fn cut(view: &View, tree: &SceneTree, scratch: &mut SelectionScratch, selection: &mut Selection) {
    let SelectionScratch { visits, stack, .. } = scratch;
    // What is drawn only because it is here may go at any time: what it lies in is drawn then.
    let needed = |visit: &&Visit| visit.asked && tree.node(visit.at).tile.is_resident();
    selection.used_nodes.extend(visits.iter().filter(needed).map(|visit| visit.at));
    stack.clear();
    stack.extend((!visits.is_empty()).then_some((0, None)));
    while let Some((i, cover)) = stack.pop() {
        let visit = &visits[i as usize];
        let cover = own(visit, tree).or(cover);
        let Some(children) = &visit.children else {
            if let Some((from, error_px)) = cover {
                let mesh = meshes::drawn(visit, view, tree);
                let error_px = mesh.map_or(error_px, |(_, error_px)| error_px);
                let mesh = mesh.map(|(lod, _)| lod);
                let from = mesh.and_then(|_| meshes::sky_source(visit.at, tree)).unwrap_or(from);
                selection.draw_tiles.push(DrawTile { node: visit.at, source: from, mesh_lod: mesh });
                meshes::count(visit, mesh, tree, selection);
                selection.mesh_leaves.extend(visit.mesh.map(|_| visit.at));
                if visit.sighted != Visibility::Occluded {
                    selection.unoccluded.push(visit.at);
                    let counters = &mut selection.stats;
                    counters.worst_error_px = counters.worst_error_px.max(error_px);
                    if visit.sighted == Visibility::Visible {
                        counters.visible_error_px = counters.visible_error_px.max(error_px);
                    }
                }
            }
            continue;
        };
        stack.extend(children.clone().map(|c| (c, cover)));
    }
    selection.stats.drawn = selection.draw_tiles.len() as u32;
}

/// Whether a node has children, and the subtree that tells of them is here.
fn knows_children(node: &TreeNode) -> bool {
    node.child_mask != 0 && node.children.iter().flatten().count() as u32 == u32::from(node.child_mask).count_ones()
}

/// Whether a node is of a level that may be passed over.
fn is_step(node: &TreeNode, tree: &SceneTree) -> bool {
    node.parent.is_some() && (tree.manifest().depth ^ node.id.level()) & 1 == 1
}

/// What a node's own tile covers its square with.
fn own(visit: &Visit, tree: &SceneTree) -> Cover {
    tree.node(visit.at).tile.is_resident().then_some((visit.at, visit.error_px))
}

/// Every visited node that is asked for and not resident is wanted; how urgently depends on what is drawn in its place.
fn want(view: &View, tree: &SceneTree, scratch: &mut SelectionScratch, selection: &mut Selection) {
    let SelectionScratch { visits, stack, .. } = scratch;
    stack.clear();
    stack.extend((!visits.is_empty()).then_some((0, None)));
    while let Some((i, cover)) = stack.pop() {
        let visit = &visits[i as usize];
        let node = tree.node(visit.at);
        let resident = node.tile.is_resident();
        let cover = own(visit, tree).or(cover);
        if visit.asked && !resident && !node.tile.is_bad() {
            let group = priority::group(cover.map(|(_, error_px)| error_px), selection.stats.tau_px);
            let away_m = node.centre.distance(view.camera.position);
            let (group, error_px) = match visit.coarse {
                true => (group, visit.error_px),
                // What stands in front first, whatever its error: it may hide the rest.
                false => (priority::PriorityGroup::Normal, view.tau_px / (1.0 + away_m / NEAR_FIRST_M)),
            };
            let weight = priority::weight(error_px, node.centre, view);
            selection.requests.push(TileRequest { key: TileKey::block_map(node.id), group, weight });
        }
        selection.requests.extend(meshes::wanted(visit, cover, view, tree, selection.stats.tau_px));
        if let Some(children) = &visit.children {
            stack.extend(children.clone().map(|c| (c, cover)));
        }
    }
    // Nothing can be drawn without the root: on a thin link all else would only keep it waiting.
    let root_pending = tree.root().map(|root| tree.node(root)).filter(|root| {
        !root.tile.is_resident()
            && !root.tile.is_bad()
            && selection.requests.iter().any(|w| w.key == TileKey::block_map(root.id))
    });
    if let Some(root) = root_pending {
        let jumps =
            |wanted: &TileRequest| wanted.key == TileKey::subtree(wanted.key.id) && wanted.weight == f64::INFINITY;
        selection.requests.retain(|wanted| wanted.key == TileKey::block_map(root.id) || jumps(wanted));
    }
    priority::sort(&mut selection.requests);
}
