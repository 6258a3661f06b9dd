//! Frames on their way to what draws them, in another worker or module.
//!
//! As words: the number of the draw list in two, the numbers of grid entries and nodes, the uniform, the grid, the nodes.

use bytemuck::{Pod, Zeroable};
use insula_shaders::layout::{DrawNode, FrameUniform};
use insula_viewer::frame::FrameData;

/// What [`frame_words`] wrote.
#[derive(Debug)]
pub struct ReceivedFrame {
    /// Number of its draw list.
    pub generation: u64,
    pub frame: FrameUniform,
    pub grid: Vec<[u32; 2]>,
    pub nodes: Vec<DrawNode>,
}

/// A frame for [`ReceivedFrame::parse`].
pub fn frame_words(data: &FrameData) -> Vec<u32> {
    words_of(data.query.generation, &data.frame, &data.grid, &data.nodes)
}

fn words_of(generation: u64, frame: &FrameUniform, grid: &[[u32; 2]], nodes: &[DrawNode]) -> Vec<u32> {
    let mut words = vec![generation as u32, (generation >> 32) as u32, grid.len() as u32, nodes.len() as u32];
    words.extend_from_slice(bytemuck::cast_slice(std::slice::from_ref(frame)));
    words.extend_from_slice(bytemuck::cast_slice(grid));
    words.extend_from_slice(bytemuck::cast_slice(nodes));
    words
}

impl ReceivedFrame {
    /// The frame; `None` if the words are none of this version.
    pub fn parse(words: &[u32]) -> Option<Self> {
        let &[low, high, grid, nodes, ref rest @ ..] = words else { return None };
        let (frame, rest) = split::<FrameUniform>(rest, 1)?;
        let (grid, rest) = split::<[u32; 2]>(rest, grid as usize)?;
        let (nodes, rest) = split::<DrawNode>(rest, nodes as usize)?;
        let generation = u64::from(high) << 32 | u64::from(low);
        rest.is_empty().then_some(Self { generation, frame: *frame.first()?, grid, nodes })
    }
}

/// The first `count` values of some words, and the rest.
fn split<T: Pod + Zeroable>(words: &[u32], count: usize) -> Option<(Vec<T>, &[u32])> {
    let (values, rest) = words.split_at_checked(count.checked_mul(size_of::<T>() / 4)?)?;
    let mut out = vec![T::zeroed(); count];
    bytemuck::cast_slice_mut(&mut out).copy_from_slice(bytemuck::cast_slice::<u32, u8>(values));
    Some((out, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_arrive_as_they_were_sent() {
        let frame = FrameUniform { width_px: 7, ..FrameUniform::zeroed() };
        let (grid, nodes) = ([[1, 2], [3, 4]], [DrawNode::zeroed(); 3]);
        let words = words_of(5 << 32 | 6, &frame, &grid, &nodes);
        let found = ReceivedFrame::parse(&words).unwrap();
        assert_eq!((found.generation, found.frame.width_px), (5 << 32 | 6, 7));
        assert_eq!((found.grid, found.nodes.len()), (grid.to_vec(), nodes.len()));
        assert!((0..words.len()).all(|end| ReceivedFrame::parse(&words[..end]).is_none()));
        assert!(ReceivedFrame::parse(&[&words[..], &[0]].concat()).is_none());
    }
}
