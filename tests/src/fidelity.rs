//! A city's twelve cameras, drawn from the baked city and from its source, and how they compare.

use crate::{
    baked::Baked,
    cameras::{self, Stand, Station},
    compare::{self, Score},
    cut::Cut,
    fixtures,
    gpu::Gpu,
    truth::Truth,
    view::Picture,
};
use anyhow::{Context, Result};
use insula_bake::{BakeOptions, Silent, scene::Scene};
use insula_protocol::TileId;
use insula_shaders::{cpu::raycast::Pixels, layout::Shading};
use std::path::{Path, PathBuf};

/// The pictures' size; one ray through the middle of each pixel.
pub const PICTURE: Picture = Picture { width_px: 640, height_px: 360, shading: Shading::Albedo, samples: 1 };

/// One picture and how it compares.
#[derive(Debug, Clone)]
pub struct View {
    /// The camera.
    pub station: Station,
    /// Tolerated error.
    pub tau_px: f64,
    /// Nodes drawn.
    pub nodes: usize,
    /// The figures.
    pub score: Score,
    /// What the source looks like.
    pub meant: Pixels,
    /// What the baked city looks like.
    pub drawn: Pixels,
}

/// Reads city files as the bake does.
pub fn read(inputs: &[PathBuf]) -> Result<Scene> {
    let options = insula_bake::read::ReadOptions::default();
    Ok(insula_bake::read::read(inputs, &options, &|_| ())?.0)
}

/// Bakes into `out`.
pub fn bake(inputs: &[PathBuf], out: &Path, cell_m: f64) -> Result<()> {
    let options = BakeOptions { inputs: inputs.to_vec(), out: out.to_owned(), cell_m, ..BakeOptions::default() };
    insula_bake::bake(&options, &Silent).context("bake")?;
    Ok(())
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

/// Draws all cameras at all taus; `with` is told each as soon as it is there.
pub fn measure(
    truth: &Truth,
    baked: &Baked,
    taus_px: &[f64],
    gpu: Option<&Gpu>,
    mut with: impl FnMut(usize, &View) -> Result<()>,
) -> Result<Vec<Summary>> {
    let mut summaries: Vec<Summary> =
        taus_px.iter().map(|tau_px| Summary { tau_px: *tau_px, views: vec![], cells: vec![] }).collect();
    let mut last: Option<(Vec<TileId>, Cut)> = None;
    for (number, station) in cameras::of(truth).into_iter().enumerate() {
        let camera = station.camera;
        let meant = truth.render(&camera, &PICTURE);
        for summary in &mut summaries {
            let ids = baked.select(&camera, &PICTURE, summary.tau_px);
            if last.as_ref().is_none_or(|(made, _)| *made != ids) {
                last = Some((ids.clone(), baked.cut(&ids)?));
            }
            let (_, cut) = last.as_ref().context("no cut")?;
            let scene = cut.scene(&camera, &PICTURE);
            let drawn = gpu.map_or_else(|| Ok(scene.render()), |gpu| gpu.render(&scene))?;
            let cell_m = baked.manifest().cell_m;
            let cells = compare::deviations(truth, &camera, &PICTURE, &drawn, cell_m);
            let score = compare::score(&meant, &drawn, &cells);
            summary.views.push((station.stand, score));
            summary.cells.extend(cells);
            let (tau_px, nodes, meant) = (summary.tau_px, ids.len(), meant.clone());
            with(number, &View { station, tau_px, nodes, score, meant, drawn })?;
        }
    }
    Ok(summaries)
}

/// All views at one tau.
#[derive(Debug, Clone)]
pub struct Summary {
    /// Tolerated error.
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

    /// Mean of the colours' PSNR.
    pub fn psnr_db(&self) -> f64 {
        self.views.iter().map(|v| v.1.psnr_db).sum::<f64>() / self.views.len().max(1) as f64
    }
}
