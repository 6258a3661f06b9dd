//! What draws frames in the browser, and a frame that is being drawn.

use insula_shaders::cpu::render::RenderedRows;
use insula_shaders::layout::{SUMMARY_WORDS, Shading};
use insula_viewer::cache::Upload;
use insula_viewer::camera::Camera;
use insula_viewer::frame::FrameData;
use insula_viewer::interaction::frame_pacing::FrameDetail;
use insula_viewer::sun::Daylight;
use insula_viewer::switching::SwitchDistances;
use insula_web_host::page_writes::PageWrites;
use std::time::Duration;

/// Writes that are kept for a GPU: 64 MiB. With more, the GPU gets its tiles again, from the browser's cache.
const MAX_PAST_WORDS: usize = 16 << 20;

/// Writes to the atlas of what draws, which is in other workers or in the module of the GPU.
#[derive(Debug)]
pub(crate) struct Renderer {
    /// Writes that it has not got.
    writes: PageWrites,
    /// All writes so far, for a GPU that may be opening. `None` if no GPU is expected, or if they exceed [`MAX_PAST_WORDS`].
    past: Option<Vec<u32>>,
    is_gpu: bool,
}

impl Renderer {
    /// The CPU, whose atlases are empty. `keeps_writes` if a GPU may be opening.
    pub(crate) fn cpu(keeps_writes: bool) -> Self {
        Self { writes: PageWrites::default(), past: keeps_writes.then(Vec::new), is_gpu: false }
    }

    /// A GPU, which has got what [`Renderer::past_writes`] returned, or nothing.
    pub(crate) fn gpu() -> Self {
        Self { writes: PageWrites::default(), past: None, is_gpu: true }
    }

    pub(crate) fn is_gpu(&self) -> bool {
        self.is_gpu
    }

    pub(super) fn has_writes(&self) -> bool {
        !self.writes.is_empty()
    }

    /// The waiting writes, which are forgotten except for a GPU that may be opening.
    pub(super) fn take_writes(&mut self) -> Vec<u32> {
        let words = self.writes.take();
        if let Some(all) = &mut self.past {
            all.extend_from_slice(&words);
        }
        self.past.take_if(|all| all.len() > MAX_PAST_WORDS);
        words
    }

    /// All writes since the start; `None` if they are not kept.
    pub(crate) fn past_writes(&mut self) -> Option<Vec<u32>> {
        self.take_writes();
        self.past.take()
    }

    pub(crate) fn forget_past_writes(&mut self) {
        self.past = None;
    }
}

impl Upload for Renderer {
    fn write_words(&mut self, at: u32, words: &[u32]) {
        self.writes.write_words(at, words);
    }

    fn write_summary(&mut self, slot: u32, words: &[u32; SUMMARY_WORDS]) {
        self.writes.write_summary(slot, words);
    }
}

/// What a frame depends on besides the tiles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DrawnView {
    pub(super) camera: Camera,
    pub(super) size_px: [u32; 2],
    pub(super) tau_px: f64,
    pub(super) switching: Option<SwitchDistances>,
    pub(super) daylight: Daylight,
    pub(super) shading: Shading,
    pub(super) style_changes: u64,
}

/// A frame that is being drawn on the CPU.
#[derive(Debug)]
pub(crate) struct FrameJob {
    pub(super) data: FrameData,
    pub(super) rows: RenderedRows,
    pub(super) detail: FrameDetail,
    pub(super) is_picture: bool,
    pub(super) duration: Duration,
    /// Whether the workers have the frame.
    pub(super) is_sent: bool,
}

impl FrameJob {
    pub(super) fn new(data: FrameData, detail: FrameDetail, is_picture: bool) -> Self {
        Self { data, rows: RenderedRows::default(), detail, is_picture, duration: Duration::ZERO, is_sent: false }
    }
}
