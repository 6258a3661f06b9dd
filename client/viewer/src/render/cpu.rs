//! The CPU ray-caster with its own copy of the atlas in main memory.

use crate::{
    cache::{Upload, slots_for},
    frame::FrameData,
};
use insula_shaders::{
    cpu::{
        instruction_set::InstructionSet,
        raycast::{Pixels, RayCounts, Sampling, SceneRef, count},
        render::{RenderedRows, render_with},
    },
    layout::{DrawNode, FrameUniform, PAGE_WORDS, SUMMARY_WORDS},
};

/// Atlas and summaries of the CPU ray-caster.
#[derive(Debug)]
pub struct CpuAdapter {
    atlas: Vec<u32>,
    summaries: Vec<u32>,
}

impl CpuAdapter {
    /// Memory for `pages` pages. The system commits it as pages are written.
    pub fn new(pages: u32) -> Self {
        Self {
            atlas: vec![0; pages as usize * PAGE_WORDS],
            summaries: vec![0; slots_for(pages) as usize * SUMMARY_WORDS],
        }
    }

    /// Draws a frame on all cores.
    pub fn draw(&self, data: &FrameData) -> Pixels {
        render_with(&self.scene_of(data), InstructionSet::best(), Sampling::Adaptive)
    }

    /// Draws the next `count` rows of a frame on all cores. Returns whether all rows are drawn.
    pub fn draw_rows(&self, data: &FrameData, rows: &mut RenderedRows, count: u32) -> bool {
        rows.render(&self.scene_of(data), count)
    }

    /// Counts the steps of a frame's rays, one ray per pixel.
    pub fn count(&self, data: &FrameData) -> RayCounts {
        count(&self.scene_of(data))
    }

    /// What the ray-caster reads for a frame.
    pub fn scene<'a>(&'a self, frame: &'a FrameUniform, grid: &'a [[u32; 2]], nodes: &'a [DrawNode]) -> SceneRef<'a> {
        SceneRef { frame, grid, nodes, summaries: &self.summaries, atlas: &self.atlas }
    }

    fn scene_of<'a>(&'a self, data: &'a FrameData) -> SceneRef<'a> {
        self.scene(&data.frame, &data.grid, &data.nodes)
    }
}

impl Upload for CpuAdapter {
    fn write_page(&mut self, page: u32, words: &[u32]) {
        let at = page as usize * PAGE_WORDS;
        if let Some(target) = self.atlas.get_mut(at..at + words.len()) {
            target.copy_from_slice(words);
        }
    }

    fn write_words(&mut self, at: u32, words: &[u32]) {
        let at = at as usize;
        if let Some(target) = self.atlas.get_mut(at..at + words.len()) {
            target.copy_from_slice(words);
        }
    }

    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        let at = slot as usize * SUMMARY_WORDS;
        if let Some(target) = self.summaries.get_mut(at..at + SUMMARY_WORDS) {
            target.copy_from_slice(words);
        }
    }
}
