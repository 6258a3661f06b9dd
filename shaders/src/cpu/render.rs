//! Draws frames on all cores: in packets where the machine has vector instructions, else ray by ray.

use super::instruction_set::InstructionSet;
use super::packet::{count_radiances, develop_pixels, render_rows};
use super::raycast::{Pixel, Pixels, Sampling, SceneRef, pixel};
use crate::compose::shades;
use crate::layout::{FrameUniform, Shading};
use crate::parallel::*;
use crate::tone::{DisplayTables, exposure_with, longer};

/// Renders the whole frame on all cores. Words that point outside of the arrays read as zero.
pub fn render(scene: &SceneRef<'_>) -> Pixels {
    render_with(scene, InstructionSet::best(), Sampling::Full)
}

/// The same with an instruction set, or ray by ray: the definition.
pub fn render_with(scene: &SceneRef<'_>, set: Option<InstructionSet>, sampling: Sampling) -> Pixels {
    let mut rows = RenderedRows { set, ..RenderedRows::new(sampling) };
    rows.render(scene, scene.frame.height_px);
    rows.develop(scene.frame)
}

/// Draws on all cores but one where there are more than two: a window that streams leaves a core to what fetches and decodes tiles. On
/// two cores the threads share them by turns, because one core alone would draw half as fast all the time.
#[cfg(not(target_arch = "wasm32"))]
pub fn with_spare_core<T: Send>(draw: impl FnOnce() -> T + Send) -> T {
    use rayon::{ThreadPool, ThreadPoolBuilder};
    static POOL: std::sync::OnceLock<Option<ThreadPool>> = std::sync::OnceLock::new();
    let pool = POOL.get_or_init(|| {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = ThreadPoolBuilder::new().num_threads(cores.saturating_sub(1));
        if cores > 2 { threads.build().ok() } else { None }
    });
    match pool {
        Some(pool) => pool.install(draw),
        None => draw(),
    }
}

/// Draws: a module in a browser has one thread.
#[cfg(target_arch = "wasm32")]
pub fn with_spare_core<T>(draw: impl FnOnce() -> T) -> T {
    draw()
}

/// Pixels that a thread develops at once.
const DEVELOPED_PIXELS: usize = 1 << 13;
/// Rows that a thread renders at once.
const BAND_ROWS: usize = 16;

/// The upper rows of a frame that is rendered in steps, so that a caller can do something else meanwhile.
#[derive(Debug)]
pub struct RenderedRows {
    set: Option<InstructionSet>,
    sampling: Sampling,
    /// Number of rendered rows.
    rows: u32,
    words: Vec<u32>,
    distance: Vec<f32>,
    hit: Vec<u32>,
}

impl Default for RenderedRows {
    /// As a viewer draws them.
    fn default() -> Self {
        Self::new(Sampling::Adaptive)
    }
}

impl RenderedRows {
    /// No rows yet.
    pub fn new(sampling: Sampling) -> Self {
        let set = InstructionSet::best();
        Self { set, sampling, rows: 0, words: Vec::new(), distance: Vec::new(), hit: Vec::new() }
    }

    /// Renders the next `count` rows on all cores. Returns whether all rows are rendered. The scene must be the same in each step.
    pub fn render(&mut self, scene: &SceneRef<'_>, count: u32) -> bool {
        let (width, height_px) = (scene.frame.width_px as usize, scene.frame.height_px);
        let end = self.rows.saturating_add(count).min(height_px);
        let mut pixels = vec![Pixel::NOTHING; width * (end - self.rows) as usize];
        let first = self.rows;
        pixels.par_chunks_mut((width * BAND_ROWS).max(1)).enumerate().for_each(|(band, pixels)| {
            render_band((self.set, self.sampling), scene, first + (band * BAND_ROWS) as u32, pixels);
        });
        self.words.extend(pixels.iter().map(|pixel| pixel.word));
        self.distance.extend(pixels.iter().map(|pixel| pixel.distance_m));
        self.hit.extend(pixels.iter().map(|pixel| pixel.hit));
        self.rows = end;
        end == height_px
    }

    /// Appends rows that were rendered elsewhere: the words, hits and distances that [`render_row`] gives. Returns whether all rows of
    /// `frame` are there.
    pub fn append(&mut self, frame: &FrameUniform, words: &[u32], hits: &[u32]) -> bool {
        let width = frame.width_px.max(1) as usize;
        self.words.extend_from_slice(words);
        for row in hits.chunks_exact(2 * width) {
            let (hit, distance) = row.split_at(width);
            self.hit.extend_from_slice(hit);
            self.distance.extend(distance.iter().map(|bits| f32::from_bits(*bits)));
        }
        self.rows = (self.words.len() / width) as u32;
        self.rows >= frame.height_px
    }

    /// Number of rendered rows.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// The pixels of `frame`, of which all rows were rendered.
    pub fn develop(self, frame: &FrameUniform) -> Pixels {
        let Self { set, words, distance, hit, .. } = self;
        let out = Pixels { width_px: frame.width_px, height_px: frame.height_px, distance, hit, ..Pixels::default() };
        with_words(out, frame, set, words)
    }
}

/// A frame of drawn pixels.
pub(super) fn developed(frame: &FrameUniform, set: Option<InstructionSet>, pixels: &[Pixel]) -> Pixels {
    let words = pixels.iter().map(|pixel| pixel.word).collect();
    let out = Pixels {
        width_px: frame.width_px,
        height_px: frame.height_px,
        distance: pixels.iter().map(|pixel| pixel.distance_m).collect(),
        hit: pixels.iter().map(|pixel| pixel.hit).collect(),
        ..Pixels::default()
    };
    with_words(out, frame, set, words)
}

fn with_words(mut out: Pixels, frame: &FrameUniform, set: Option<InstructionSet>, words: Vec<u32>) -> Pixels {
    match set.filter(|_| frame.shading == Shading::Lit as u32) {
        Some(set) => (out.colour, out.radiance) = (develop_in_packets(set, frame, &words, &out), words),
        None => out.set_words(frame, words),
    }
    out
}

/// [`develop`](crate::tone::develop) of a lit frame.
fn develop_in_packets(set: InstructionSet, frame: &FrameUniform, words: &[u32], drawn: &Pixels) -> Vec<u32> {
    let exposure = exposure_with(frame, words, &drawn.hit, |words| count_radiances(set, words));
    let shades = shades(frame, &drawn.distance);
    let graded = (frame.light.grade[0] > 0.0).then(|| longer(frame, exposure));
    let (tables, width) = ((DisplayTables::get(), graded), frame.width_px.max(1));
    let mut colours = vec![0; words.len()];
    let chunks = words.par_chunks(DEVELOPED_PIXELS).zip(colours.par_chunks_mut(DEVELOPED_PIXELS)).enumerate();
    chunks.for_each(|(chunk, (words, colours))| {
        let first = chunk * DEVELOPED_PIXELS;
        let shades = shades.as_ref().and_then(|shades| shades.get(first..));
        develop_pixels(set, (width, first), (exposure, tables), (words, shades), colours);
    });
    colours
}

/// Renders rows from row `first` on this thread: as many as `out` has pixels for.
pub(super) fn render_band(
    (set, sampling): (Option<InstructionSet>, Sampling),
    scene: &SceneRef<'_>,
    first: u32,
    out: &mut [Pixel],
) {
    if let Some(set) = set {
        return render_rows(set, scene, sampling, first, out);
    }
    let width = scene.frame.width_px;
    for (at, target) in (0u32..).zip(out) {
        *target = pixel(scene, [at % width, first + at / width]);
    }
}

/// Renders one row on this thread. Appends a word (radiance of a lit frame, else colour) for each pixel, and to `hits` the nodes that
/// were hit, followed by the bits of the distances.
pub fn render_row(scene: &SceneRef<'_>, y: u32, words: &mut Vec<u32>, hits: &mut Vec<u32>) {
    let mut row = vec![Pixel::NOTHING; scene.frame.width_px as usize];
    render_band((InstructionSet::best(), Sampling::Full), scene, y, &mut row);
    words.extend(row.iter().map(|pixel| pixel.word));
    hits.extend(row.iter().map(|pixel| pixel.hit));
    hits.extend(row.iter().map(|pixel| pixel.distance_m.to_bits()));
}
