//! The ray-casters with the atlas that each reads: the CPU's in main memory, and with the feature `gpu` that of a device.
//!
//! They take pages by [`Upload`](crate::cache::Upload) and draw a [`FrameData`](crate::frame::FrameData).

#[cfg(feature = "gpu")]
mod gpu;
#[cfg(feature = "gpu")]
mod trial;

use crate::cache::{Upload, slots_for};
use crate::frame::FrameData;
use crate::translucency::MAP_PAGES;
#[cfg(feature = "gpu")]
pub use gpu::{GpuAdapter, GpuDevice};
use insula_shaders::cpu::instruction_set::InstructionSet;
use insula_shaders::cpu::raycast::{Pixels, RayCounts, Sampling, SceneRef, count};
use insula_shaders::cpu::render::{render_with, with_spare_core};
use insula_shaders::cpu::stepped::{FrameProgress, SteppedFrame};
use insula_shaders::cpu::translucency_map::make_map;
use insula_shaders::layout::{DrawNode, FrameUniform, PAGE_WORDS, SUMMARY_WORDS};
use insula_shaders::translucency::MAX_MAPS;
#[cfg(feature = "gpu")]
pub use trial::TrialCity;

/// Which translucency maps an atlas holds, by their keys.
#[derive(Debug, Default)]
struct MadeMaps {
    keys: [u32; MAX_MAPS],
}

impl MadeMaps {
    /// Numbers of the frame's maps that the atlas does not hold. To be made before the frame is drawn.
    fn begin(&mut self, frame: &FrameUniform) -> Vec<usize> {
        let is_outdated =
            |number: &usize| frame.map_keys[*number] != 0 && frame.map_keys[*number] != self.keys[*number];
        let outdated: Vec<usize> = (0..MAX_MAPS).filter(is_outdated).collect();
        outdated.iter().for_each(|number| self.keys[*number] = frame.map_keys[*number]);
        outdated
    }
}

/// Atlas and summaries of the CPU ray-caster.
#[derive(Debug)]
pub struct CpuAdapter {
    atlas: Vec<u32>,
    summaries: Vec<u32>,
    maps: MadeMaps,
    spares_core: bool,
}

impl CpuAdapter {
    /// Memory for `pages` pages. The system commits it as pages are written.
    pub fn new(pages: u32) -> Self {
        Self {
            atlas: vec![0; (pages + MAP_PAGES) as usize * PAGE_WORDS],
            summaries: vec![0; slots_for(pages) as usize * SUMMARY_WORDS],
            maps: MadeMaps::default(),
            spares_core: false,
        }
    }

    /// Whether frames leave a core to other work, where there are more than two. At first they do not.
    pub fn set_spares_core(&mut self, spares_core: bool) {
        self.spares_core = spares_core;
    }

    /// Draws a frame on all cores, or on all but one.
    pub fn draw(&mut self, data: &FrameData) -> Pixels {
        self.make_maps(&data.frame, &data.grid, &data.nodes);
        let scene = self.scene_of(data);
        let draw = || render_with(&scene, InstructionSet::best(), Sampling::Adaptive);
        if self.spares_core { with_spare_core(draw) } else { draw() }
    }

    /// Draws more of a frame on all cores until `is_due`: a resting view has nothing to fetch. See [`SteppedFrame::step`].
    pub fn draw_step(
        &mut self,
        data: &FrameData,
        frame: &mut SteppedFrame,
        is_due: impl Fn() -> bool + Sync,
    ) -> FrameProgress {
        self.make_maps(&data.frame, &data.grid, &data.nodes);
        frame.step(&self.scene_of(data), is_due)
    }

    /// Makes the frame's translucency maps that the atlas does not hold. To be called before the frame is drawn.
    pub fn make_maps(&mut self, frame: &FrameUniform, grid: &[[u32; 2]], nodes: &[DrawNode]) {
        for number in self.maps.begin(frame) {
            let words = make_map(&self.scene(frame, grid, nodes), number);
            self.write_words(frame.translucency[number].address, &words);
        }
    }

    /// Counts the steps of a frame's rays, one ray per pixel.
    pub fn count(&self, data: &FrameData) -> RayCounts {
        count(&self.scene_of(data))
    }

    /// What the ray-caster reads for a frame.
    pub fn scene<'a>(&'a self, frame: &'a FrameUniform, grid: &'a [[u32; 2]], nodes: &'a [DrawNode]) -> SceneRef<'a> {
        SceneRef { frame, grid, nodes, summaries: &self.summaries, atlas: &self.atlas }
    }

    /// What the ray-caster reads for a frame.
    pub fn scene_of<'a>(&'a self, data: &'a FrameData) -> SceneRef<'a> {
        self.scene(&data.frame, &data.grid, &data.nodes)
    }
}

impl Upload for CpuAdapter {
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

/// Name and backend of a ray-caster, and why it draws.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct AdapterInfo {
    pub name: String,
    /// `vulkan`, `gl`, `metal`, `dx12` or `cpu`.
    pub backend: String,
    /// Why this one draws, for people; empty if there was no choice.
    pub reason: String,
}

impl AdapterInfo {
    /// Description of the CPU ray-caster on a number of cores.
    pub fn cpu(cores: usize) -> Self {
        Self { name: format!("CPU ray-caster, {cores} cores"), backend: "cpu".into(), reason: String::new() }
    }
}
