//! A city's twelve cameras, drawn from the baked city and from its source, and how they compare.

use crate::{
    baked::Baked,
    cameras::{self, Stand, Station},
    compare::{self, Colour, Score},
    draw_list::DrawList,
    fixtures,
    gpu::Gpu,
    truth::Truth,
    view::FrameSpec,
};
use anyhow::{Context, Result};
use insula_bake::{
    BakeOptions, Silent,
    scene::{ObjectKind, Scene},
};
use insula_protocol::TileId;
use insula_shaders::{cpu::raycast::Pixels, layout::Shading};
use insula_viewer::frame::STILL_SAMPLES;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What is drawn, and how.
#[derive(Debug, Clone, Copy)]
pub struct MeasureOptions<'a> {
    pub taus_px: &'a [f64],
    /// Whether leaves' meshes are drawn.
    pub meshes: bool,
    pub stand: Option<Stand>,
    /// The frames' size; one ray through the middle of each pixel.
    pub spec: FrameSpec,
}

impl<'a> MeasureOptions<'a> {
    pub fn plain(taus_px: &'a [f64]) -> Self {
        Self { taus_px, meshes: false, stand: None, spec: FRAME }
    }
}

/// The frames' size unless another is given; one ray through the middle of each pixel.
pub const FRAME: FrameSpec = FrameSpec { width_px: 640, height_px: 360, shading: Shading::Albedo, samples: 1 };
/// Rays along a pixel's side for the colours that are meant; those that are drawn are as `insula snapshot` draws them.
const MEANT_SIDE: u32 = 4;
// Then distances are those of the rays through the pixels' middles.
const _: () = assert!(STILL_SAMPLES % 2 == 1);

/// One frame and how it compares.
#[derive(Debug, Clone)]
pub struct View {
    pub station: Station,
    pub tau_px: f64,
    pub nodes: usize,
    pub score: Score,
    /// What the source looks like: colours of 16 rays a pixel, distances of the one through its middle.
    pub reference: Pixels,
    /// What the baked city looks like: as `insula snapshot` draws it, distances of the rays through the pixels' middles.
    pub drawn: Pixels,
}

/// Reads city files as the bake does.
pub fn read(inputs: &[PathBuf]) -> Result<Scene> {
    let options = insula_bake::read::ReadOptions::default();
    Ok(insula_bake::read::read(inputs, &options, &|_| ())?.0)
}

pub fn bake(inputs: &[PathBuf], out: &Path, cell_m: f64) -> Result<()> {
    let options = BakeOptions { inputs: inputs.to_vec(), out: out.to_owned(), cell_m, ..BakeOptions::default() };
    insula_bake::bake(&options, &Silent).context("bake")?;
    Ok(())
}

/// A city baked at 1 m, shared by all tests.
pub fn baked(name: &str, inputs: &[PathBuf], meshes: bool) -> Result<PathBuf> {
    fixtures::baked(name, &BakeOptions { inputs: inputs.to_vec(), cell_m: 1.0, meshes, ..BakeOptions::default() })
}

/// The three real cities beside the workspace, by name; of those that are not there, only the bundled one is given.
pub fn real_cities() -> Vec<(&'static str, Vec<PathBuf>)> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let city = |name: &'static str, files: &[&str]| {
        let inputs: Vec<PathBuf> = files.iter().map(|file| data.join(name).join(file)).collect();
        inputs.iter().all(|path| path.exists()).then_some((name, inputs))
    };
    let bundled = || fixtures::chiba().ok().map(|inputs| ("chiba-textured", inputs));
    let all = [
        city("chiba-textured", &["chiba_64.obj", "chiba_68.obj", "chiba_70.obj"]).or_else(bundled),
        city("delft-3dbag", &["delft.city.jsonl"]),
        city("denhaag-cityjson", &["denhaag.city.json"]),
    ];
    all.into_iter().flatten().collect()
}

/// Nodes of a draw list, and at which levels of detail their meshes are drawn.
type Leaves = Vec<(TileId, Option<u8>)>;

/// Draws all cameras at all taus; `with` is told each as soon as it is there.
pub fn measure(
    truth: &Truth,
    baked: &Baked,
    options: &MeasureOptions<'_>,
    gpu: Option<&Gpu>,
    mut with: impl FnMut(usize, &View) -> Result<()>,
) -> Result<Vec<Summary>> {
    let mut summaries: Vec<Summary> =
        options.taus_px.iter().map(|tau_px| Summary { tau_px: *tau_px, views: vec![], cells: vec![] }).collect();
    let spec = options.spec;
    let mut last: Option<(Leaves, DrawList)> = None;
    for (number, station) in cameras::of(truth).into_iter().enumerate() {
        if options.stand.is_some_and(|stand| stand != station.stand) {
            continue;
        }
        let camera = station.camera;
        let mut reference = truth.render(&camera, &spec);
        let textured;
        (reference.colour, textured) = truth.albedo(&camera, &spec, MEANT_SIDE);
        for summary in &mut summaries {
            let lod = |id| if options.meshes { baked.drawn_lod(id, &camera, &spec, summary.tau_px) } else { None };
            let ids = baked.select(&camera, &spec, summary.tau_px);
            let key: Leaves = ids.iter().map(|id| (*id, lod(*id))).collect();
            if last.as_ref().is_none_or(|(made, _)| *made != key) {
                last = Some((key, baked.draw_list_with_meshes(&ids, lod)?));
            }
            let (_, draw_list) = last.as_ref().context("no draw list")?;
            let scene = draw_list.scene(&camera, &FrameSpec { samples: STILL_SAMPLES, ..spec });
            let drawn = gpu.map_or_else(|| Ok(scene.render()), |gpu| gpu.render(&scene))?;
            let cells = compare::deviations(truth, &camera, &spec, &drawn, baked.manifest().cell_m);
            let score = compare::score(&reference, &drawn, &textured, &cells)?;
            summary.views.push((station.stand, score));
            summary.cells.extend(cells);
            let (tau_px, nodes, reference) = (summary.tau_px, ids.len(), reference.clone());
            with(number, &View { station, tau_px, nodes, score, reference, drawn })?;
        }
    }
    Ok(summaries)
}

/// All views at one tau.
#[derive(Debug, Clone)]
pub struct Summary {
    pub tau_px: f64,
    /// Where the cameras stand, and their figures.
    pub views: Vec<(Stand, Score)>,
    /// Deviations of all views, in cells.
    pub cells: Vec<f64>,
}

impl Summary {
    /// Lowest and mean silhouette IoU, of cameras of one kind or of all.
    pub fn iou(&self, stand: Option<Stand>) -> [f64; 2] {
        let of: Vec<f64> =
            self.views.iter().filter(|v| stand.is_none_or(|stand| v.0 == stand)).map(|v| v.1.iou).collect();
        let worst = of.iter().copied().fold(f64::INFINITY, f64::min);
        [worst, of.iter().sum::<f64>() / of.len().max(1) as f64]
    }

    /// Median and 95th percentile of the deviations of all views together, in cells.
    pub fn deviation_cells(&self) -> [f64; 2] {
        let mut cells = self.cells.clone();
        cells.sort_by(f64::total_cmp);
        [compare::percentile(&cells, 0.5), compare::percentile(&cells, 0.95)]
    }

    /// Means over the cameras of one kind, or of all: of the colours of `textured` pixels or of all that show the city.
    pub fn colour(&self, stand: Option<Stand>, textured: bool) -> Option<Colour> {
        let of: Vec<Colour> = self
            .views
            .iter()
            .filter(|view| stand.is_none_or(|stand| view.0 == stand))
            .filter_map(|view| if textured { view.1.textured } else { view.1.colour })
            .collect();
        let mean = |value: fn(&Colour) -> f64| of.iter().map(value).sum::<f64>() / of.len() as f64;
        let pixels = of.iter().map(|colour| colour.pixels).sum();
        (!of.is_empty()).then(|| Colour { pixels, psnr_db: mean(|c| c.psnr_db), ssim: mean(|c| c.ssim) })
    }
}

/// What a baked city takes, in bytes of its V-BlockMap tiles.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Size {
    pub leaves: usize,
    pub nodes: usize,
    pub bytes_per_leaf: f64,
    pub bytes_per_node: f64,
    /// All nodes, over the source's buildings.
    pub bytes_per_building: f64,
    /// All nodes, over the square kilometres that leaves cover.
    pub bytes_per_km2: f64,
}

impl Size {
    /// Of a city that was baked from `scene`.
    pub fn of(baked: &Baked, scene: &Scene) -> Self {
        let levels = baked.levels();
        let (leaves, leaf_bytes) = levels.last_key_value().map_or((0, 0), |(_, level)| *level);
        let (nodes, bytes) = levels.values().fold((0, 0), |sum, level| (sum.0 + level.0, sum.1 + level.1));
        let buildings = scene.objects.iter().filter(|object| object.kind == ObjectKind::Building).count();
        let manifest = baked.manifest();
        let km2 = leaves as f64 * (manifest.node_side_m(manifest.depth) / 1000.0).powi(2);
        let per = |bytes: usize, count: f64| if count == 0.0 { 0.0 } else { bytes as f64 / count };
        Self {
            leaves,
            nodes,
            bytes_per_leaf: per(leaf_bytes, leaves as f64),
            bytes_per_node: per(bytes, nodes as f64),
            bytes_per_building: per(bytes, buildings as f64),
            bytes_per_km2: per(bytes, km2),
        }
    }
}
