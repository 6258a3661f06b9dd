//! The boxes of the nodes that a frame is drawn from, as lines in the frame (Gasparello 2007, 4.3.5).

use crate::camera::View;
use crate::projection::project_line;
use crate::scene::SceneTree;
use crate::select::Selection;
use glam::{DVec2, DVec3};

/// The ends of the boxes' edges in front of the camera, in shares of the frame's width and height from its upper left corner. Of nodes
/// that are hidden, as far as that is known, there are none.
#[cold]
pub fn box_edges(tree: &SceneTree, selection: &Selection, view: &View) -> Vec<[DVec2; 2]> {
    let nodes = selection.unoccluded.iter().map(|node| tree.node(*node));
    let edges = nodes.flat_map(|node| (0..12).map(|edge| edge_of(edge).map(|corner| node.centre + node.half * corner)));
    edges.filter_map(|ends| project_line(view, ends)).collect()
}

/// The ends of an edge, 0 to 11, of the cube from -1 to 1: four along each axis.
fn edge_of(edge: usize) -> [DVec3; 2] {
    let (axis, side) = (edge / 4, edge % 4);
    [-1.0, 1.0].map(|along| {
        let mut corner = DVec3::ZERO;
        corner[axis] = along;
        corner[(axis + 1) % 3] = f64::from(side as u8 & 1) * 2.0 - 1.0;
        corner[(axis + 2) % 3] = f64::from(side as u8 >> 1) * 2.0 - 1.0;
        corner
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_has_twelve_edges_between_its_corners() {
        let edges: Vec<[DVec3; 2]> = (0..12).map(edge_of).collect();
        for (i, [a, b]) in edges.iter().enumerate() {
            assert_eq!(a.abs(), DVec3::ONE);
            assert_eq!((*a - *b).abs().element_sum(), 2.0, "along one axis");
            assert!(edges[i + 1..].iter().all(|other| other != &[*a, *b] && other != &[*b, *a]));
        }
    }
}
