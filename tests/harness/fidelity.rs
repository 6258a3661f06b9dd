//! Twelve views of a city, drawn from the baked city and from its source, and how they differ.

use crate::baked::Baked;
use crate::cameras::{self, Station, StationKind};
use crate::compare::{self, Colour, Score};
use crate::draw_list::DrawList;
use crate::fixtures;
use crate::gpu::Gpu;
use crate::truth::Truth;
use crate::view::FrameSpec;
use anyhow::{Context, Result};
use insula_bake::scene::{ObjectKind, Scene};
use insula_bake::{BakeOptions, Silent};
use insula_protocol::TileId;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_viewer::frame::STILL_SAMPLES;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Which views are drawn, and how.
#[derive(Debug, Clone, Copy)]
pub struct MeasureOptions<'a> {
    pub taus_px: &'a [f64],
    /// Whether leaves are drawn as meshes where the client does.
    pub meshes: bool,
    pub kind: Option<StationKind>,
    /// Size of the frames; one ray through the centre of each pixel.
    pub spec: FrameSpec,
}

impl<'a> MeasureOptions<'a> {
    pub fn plain(taus_px: &'a [f64]) -> Self {
        Self { taus_px, meshes: false, kind: None, spec: FRAME }
    }
}

/// The default of [`MeasureOptions::spec`].
pub const FRAME: FrameSpec = FrameSpec { width_px: 640, height_px: 360, shading: Shading::Albedo, samples: 1 };
/// Rays along a pixel's side for the reference colours. Drawn colours have as many as `insula snapshot` uses.
const REFERENCE_SIDE: u32 = 4;
// With an odd number, one ray goes through the pixel's centre; its distance is compared.
const _: () = assert!(STILL_SAMPLES % 2 == 1);

#[derive(Debug, Clone)]
pub struct View {
    pub station: Station,
    pub tau_px: f64,
    pub nodes: usize,
    pub score: Score,
    /// The source: colours of 16 rays per pixel, distances of the ray through its centre.
    pub reference: Pixels,
    /// The baked city, as `insula snapshot` draws it.
    pub drawn: Pixels,
}

/// Reads city files with the options of the bake, without the search for duplicates: an OBJ that stands for another format does
/// not tell parts from their parents.
pub fn read(inputs: &[PathBuf]) -> Result<Scene> {
    let duplicates = insula_bake::read::DuplicateOption::KeepAll;
    let options = insula_bake::read::ReadOptions { duplicates, ..Default::default() };
    Ok(insula_bake::read::read(inputs, &options, &|_| ())?.0)
}

pub fn bake(inputs: &[PathBuf], out: &Path, cell_m: f64) -> Result<()> {
    let options = BakeOptions { inputs: inputs.to_vec(), out: out.to_owned(), cell_m, ..BakeOptions::default() };
    insula_bake::bake(&options, &Silent).context("bake")?;
    Ok(())
}

/// The bundled city, and two beside the workspace that may be absent.
pub const REAL_CITIES: [&str; 3] = ["chiba-textured", "delft-3dbag", "denhaag-cityjson"];

/// The files of one of [`REAL_CITIES`]; `None` if it is not on this machine.
pub fn real_city(name: &str) -> Option<Vec<PathBuf>> {
    let file = match name {
        "chiba-textured" => return fixtures::chiba().ok(),
        "delft-3dbag" => "delft.city.jsonl",
        "denhaag-cityjson" => "denhaag.city.json",
        _ => return None,
    };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(name).join(file);
    path.exists().then(|| vec![path])
}

/// One of [`REAL_CITIES`], baked at 1 m with meshes and shared by all tests. Fails if it is not on this machine.
pub fn baked(name: &str) -> Result<PathBuf> {
    if name == "chiba-textured" {
        return fixtures::baked_chiba();
    }
    let inputs = real_city(name).with_context(|| format!("{name} is not on this machine"))?;
    fixtures::baked(name, &BakeOptions { inputs, ..BakeOptions::default() })
}

/// Nodes with the level of detail of their meshes.
type Leaves = Vec<(TileId, Option<u8>)>;

/// Draws all cameras at all tolerances. Calls `with` after each view.
pub fn measure(
    truth: &Truth,
    baked: &Baked,
    options: &MeasureOptions<'_>,
    gpu: Option<&Gpu>,
    with: impl FnMut(usize, &View) -> Result<()>,
) -> Result<Vec<Summary>> {
    measure_coloured(truth, baked, options, |_| true, gpu, with)
}

/// As [`measure`], with colours only of the kinds of cameras that `is_coloured` accepts. They take most of the time.
pub fn measure_coloured(
    truth: &Truth,
    baked: &Baked,
    options: &MeasureOptions<'_>,
    is_coloured: fn(StationKind) -> bool,
    gpu: Option<&Gpu>,
    mut with: impl FnMut(usize, &View) -> Result<()>,
) -> Result<Vec<Summary>> {
    let mut summaries: Vec<Summary> =
        options.taus_px.iter().map(|tau_px| Summary { tau_px: *tau_px, views: vec![], cells: vec![] }).collect();
    let spec = options.spec;
    let mut last: Option<(Leaves, DrawList)> = None;
    for (number, station) in cameras::stations(truth).into_iter().enumerate() {
        if options.kind.is_some_and(|kind| kind != station.kind) {
            continue;
        }
        let camera = station.camera;
        let mut reference = truth.render(&camera, &spec);
        let is_coloured = is_coloured(station.kind);
        let mut textured = vec![false; reference.colour.len()];
        if is_coloured {
            (reference.colour, textured) = truth.albedo(&camera, &spec, REFERENCE_SIDE);
        }
        // Distances are those of the ray through a pixel's centre, with any number of samples.
        let samples = if is_coloured { STILL_SAMPLES } else { 1 };
        for summary in &mut summaries {
            let lod = |id| if options.meshes { baked.drawn_lod(id, &camera, &spec, summary.tau_px) } else { None };
            let ids = baked.select(&camera, &spec, summary.tau_px);
            let key: Leaves = ids.iter().map(|id| (*id, lod(*id))).collect();
            if last.as_ref().is_none_or(|(made, _)| *made != key) {
                last = Some((key, baked.draw_list_with_meshes(&ids, lod)?));
            }
            let (_, draw_list) = last.as_ref().context("no draw list")?;
            let scene = draw_list.scene(&camera, &FrameSpec { samples, ..spec });
            let drawn = gpu.map_or_else(|| Ok(scene.render()), |gpu| gpu.render(&scene))?;
            let cells = compare::deviations(truth, &camera, &spec, &drawn, baked.manifest().cell_m);
            let mut score = compare::score(&reference, &drawn, &textured, &cells)?;
            score.colour = score.colour.filter(|_| is_coloured);
            summary.views.push((station.kind, score));
            summary.cells.extend(cells);
            let (tau_px, nodes, reference) = (summary.tau_px, ids.len(), reference.clone());
            with(number, &View { station, tau_px, nodes, score, reference, drawn })?;
        }
    }
    Ok(summaries)
}

#[derive(Debug, Clone)]
pub struct Summary {
    pub tau_px: f64,
    pub views: Vec<(StationKind, Score)>,
    /// Ascending within each view, in cells.
    pub cells: Vec<f64>,
}

impl Summary {
    /// Lowest and mean silhouette IoU of the cameras of one kind, or of all.
    pub fn iou(&self, kind: Option<StationKind>) -> [f64; 2] {
        let of: Vec<f64> = self.views.iter().filter(|v| kind.is_none_or(|kind| v.0 == kind)).map(|v| v.1.iou).collect();
        let worst = of.iter().copied().fold(f64::INFINITY, f64::min);
        [worst, of.iter().sum::<f64>() / of.len().max(1) as f64]
    }

    /// Median and 95th percentile of the deviations of all views, in cells.
    pub fn deviation_cells(&self) -> [f64; 2] {
        let mut cells = self.cells.clone();
        cells.sort_by(f64::total_cmp);
        [compare::percentile(&cells, 0.5), compare::percentile(&cells, 0.95)]
    }

    /// Means over the cameras of one kind, or of all: over textured pixels, or over all pixels that show the city.
    pub fn colour(&self, kind: Option<StationKind>, textured: bool) -> Option<Colour> {
        let of: Vec<Colour> = self
            .views
            .iter()
            .filter(|view| kind.is_none_or(|kind| view.0 == kind))
            .filter_map(|view| if textured { view.1.textured } else { view.1.colour })
            .collect();
        let mean = |value: fn(&Colour) -> f64| of.iter().map(value).sum::<f64>() / of.len() as f64;
        let pixels = of.iter().map(|colour| colour.pixels).sum();
        (!of.is_empty()).then(|| Colour {
            pixels,
            psnr_db: mean(|c| c.psnr_db),
            ssim: mean(|c| c.ssim),
            gradient: mean(|c| c.gradient),
        })
    }
}

/// Sizes of a baked city in bytes of V-BlockMap tiles.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Size {
    pub leaves: usize,
    pub nodes: usize,
    pub bytes_per_leaf: f64,
    pub bytes_per_node: f64,
    /// All nodes, per building of the source.
    pub bytes_per_building: f64,
    /// All nodes, per square kilometre that leaves cover.
    pub bytes_per_km2: f64,
}

impl Size {
    /// Sizes of a city that was baked from `scene`.
    pub fn new(baked: &Baked, scene: &Scene) -> Self {
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
