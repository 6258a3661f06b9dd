//! Visits the nodes of a city that have no children, in the order of leaves.

use super::ExportError;
use super::grid::{LeafOrder, node_area};
use crate::source::{ExportSource, SourceError};
use insula_protocol::mesh_tile::MAX_LODS;
use insula_protocol::subtree::NodeMesh;
use insula_protocol::{Manifest, Subtree, TileId};
use std::collections::HashMap;

/// A node without children: a leaf, or land around the city that is not divided further.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EndNode {
    pub(crate) id: TileId,
    pub(crate) has_mesh: bool,
    /// Errors of the levels of detail of its mesh in metres, finest first; infinite beyond the last one.
    pub(crate) lod_errors_m: [f32; MAX_LODS as usize],
}

type Visit<'a> = &'a mut dyn FnMut(EndNode) -> Result<(), ExportError>;

/// Visits all end nodes that touch `area`, in world metres. Fails if a subtree cannot be read, and with the error of `visit`.
pub(crate) fn visit_end_nodes(
    source: &dyn ExportSource,
    area: [[f64; 2]; 2],
    visit: Visit<'_>,
) -> Result<(), ExportError> {
    let manifest = source.manifest();
    let walk = Walk { source, manifest, order: LeafOrder::of(manifest), area };
    walk.enter(TileId::ROOT, visit)
}

struct Walk<'a> {
    source: &'a dyn ExportSource,
    manifest: &'a Manifest,
    order: LeafOrder,
    area: [[f64; 2]; 2],
}

struct Nodes {
    root: TileId,
    child_masks: HashMap<TileId, u8>,
    lod_errors: HashMap<TileId, [f32; MAX_LODS as usize]>,
}

impl Walk<'_> {
    fn enter(&self, root: TileId, visit: Visit<'_>) -> Result<(), ExportError> {
        let subtree = self.source.subtree(root)?.ok_or_else(|| SourceError {
            what: format!("subtrees {root}"),
            reason: "the city does not have it: bake it again".to_owned(),
        })?;
        self.descend(root, &Nodes::of(root, &subtree), visit)
    }

    fn descend(&self, node: TileId, nodes: &Nodes, visit: Visit<'_>) -> Result<(), ExportError> {
        let [min, max] = node_area(self.manifest, node);
        if (0..2).any(|k| max[k] < self.area[0][k] || self.area[1][k] < min[k]) {
            return Ok(());
        }
        let Some(&child_mask) = nodes.child_masks.get(&node) else { return Ok(()) };
        if child_mask == 0 {
            let errors = nodes.lod_errors.get(&node);
            let lod_errors_m = errors.copied().unwrap_or([f32::INFINITY; MAX_LODS as usize]);
            return visit(EndNode { id: node, has_mesh: errors.is_some(), lod_errors_m });
        }
        if Subtree::is_root(node) && node != nodes.root {
            return self.enter(node, visit);
        }
        for child in self.order.children(node) {
            if child_mask >> child.quadrant() & 1 == 1 {
                self.descend(child, nodes, visit)?;
            }
        }
        Ok(())
    }
}

fn lod_errors(mesh: &NodeMesh) -> (TileId, [f32; MAX_LODS as usize]) {
    let mut errors = [f32::INFINITY; MAX_LODS as usize];
    errors.iter_mut().zip(&mesh.lods).for_each(|(error, lod)| *error = lod.error_m);
    (mesh.id, errors)
}

impl Nodes {
    fn of(root: TileId, subtree: &Subtree) -> Self {
        Self {
            root,
            child_masks: subtree.nodes.iter().map(|node| (node.id, node.child_mask)).collect(),
            lod_errors: subtree.meshes.iter().filter(|mesh| !mesh.lods.is_empty()).map(lod_errors).collect(),
        }
    }
}
