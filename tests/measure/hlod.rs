//! Compares the columns of nodes above the leaves with merged, simplified meshes of as many bytes (Gasparello 2007, section 6.2).
//!
//! `cargo run --release -p insula-measure --bin hlod -- CITY SOURCE...`. For each node, the finest meshes of the leaves below it are
//! merged, and simplified until they take no more bytes than its columns. The comparison favours the meshes: their bytes are positions
//! and triangles only, where those of columns are colours, occlusion and objects too, and their borders may move, so that neighbours
//! would not meet.

use anyhow::{Context, Result};
use clap::Parser;
use glam::DVec3;
use insula_bake::columns::column_field::ColumnField;
use insula_export::leaves::visit_leaf_meshes;
use insula_export::table::ExportError;
use insula_protocol::{BlockMap, TileId, TileKind};
use insula_server::store::{CityStore, StoredCity};
use insula_simplify::model::{TriangleModel, quantise};
use insula_simplify::simplify::{Goal, simplify};
use insula_simplify::surface::Surface;
use insula_tests::baked::Baked;
use insula_tests::compare::percentile;
use insula_tests::fidelity;
use insula_tests::node_error::{node_at, seen_points};
use insula_tests::truth::Truth;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// Share of the points that lies within the stated error of columns.
const SHARE: f64 = 0.999;
/// Nodes in which fewer points are seen are not judged by themselves.
const LEAST_POINTS: usize = 500;
/// Halvings of the number of triangles.
const STEPS: u32 = 12;
/// Steps of a mesh's grid in the error that the columns state.
const GRID_STEPS: f64 = 4.0;

/// Compares the columns of nodes above the leaves with meshes of as many bytes
#[derive(Debug, Parser)]
struct Args {
    /// A city that was baked from the source without generated ground
    city: PathBuf,
    /// City files
    #[arg(required = true)]
    source: Vec<PathBuf>,
    /// Levels above the leaves
    #[arg(long, default_value_t = 4)]
    levels: usize,
    /// Points of the source that are seen from outside
    #[arg(long, default_value_t = 400_000)]
    samples: usize,
    /// Larger distances count as this, in metres
    #[arg(long, default_value_t = 200.0)]
    most: f64,
}

/// Triangles in world metres.
type Triangles = Vec<[[f64; 3]; 3]>;

/// What is known of one level.
#[derive(Default)]
struct LevelFigures {
    /// Those of which a mesh takes as few bytes as the columns, and the others, of which nothing else is known.
    nodes: usize,
    without_mesh: usize,
    bytes: [usize; 2],
    triangles: [usize; 2],
    stated_m: Vec<f64>,
    /// Of points of the source from the columns, and from the meshes.
    columns_m: Vec<f64>,
    mesh_m: Vec<f64>,
    /// Of points of the meshes from the source.
    back_m: Vec<f64>,
    judged: usize,
    /// Nodes whose mesh is nearer than the columns say, and than they are.
    nearer: [usize; 2],
}

fn main() -> Result<()> {
    let args = Args::parse();
    let (truth, baked, store) =
        (Truth::new(fidelity::read(&args.source)?), Baked::open(&args.city)?, CityStore::open(&args.city)?);
    let leaves = leaf_triangles(&args.city)?;
    let seen = seen_points(&truth, args.samples)?;
    println!(
        "| cell | nodes | no mesh so small | bytes of columns | of meshes | triangles | of meshes | stated, median | columns, 99.9% | meshes, 99.9% | \
         back, 99.9% | meshes nearer than stated | than measured |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    for level in (0..baked.manifest().depth).rev().take(args.levels) {
        let figures = measure(&args, (&baked, &store), level, &leaves, &seen)?;
        print(baked.manifest().cell_m_at(level), figures);
    }
    Ok(())
}

/// The finest mesh of each leaf that has one.
fn leaf_triangles(folder: &Path) -> Result<BTreeMap<TileId, Triangles>> {
    let city = CityStore::open(folder)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::open(city.manifest(), &read)?;
    let area = city.manifest().bounds.map(|[x, y, _]| [x, y]);
    let mut leaves: BTreeMap<TileId, Triangles> = BTreeMap::new();
    visit_leaf_meshes(&source, area, 0.0, &mut |leaf| {
        if leaf.lod.is_some() {
            let place = |vertex: u32| leaf.positions[vertex as usize];
            let triangles = leaf.tile.mesh.triangles.iter().map(|corners| corners.map(place));
            leaves.entry(leaf.leaf).or_default().extend(triangles);
        }
        Ok::<(), ExportError>(())
    })?;
    Ok(leaves)
}

fn measure(
    args: &Args,
    (baked, store): (&Baked, &CityStore),
    level: u8,
    leaves: &BTreeMap<TileId, Triangles>,
    seen: &[DVec3],
) -> Result<LevelFigures> {
    let mut points: HashMap<TileId, Vec<DVec3>> = HashMap::new();
    for point in seen {
        if let Some(id) = node_at(baked, level, *point) {
            points.entry(id).or_default().push(*point);
        }
    }
    let mut below: BTreeMap<TileId, Triangles> = BTreeMap::new();
    for (leaf, triangles) in leaves {
        if let Some(id) = leaf.ancestor(level) {
            below.entry(id).or_default().extend_from_slice(triangles);
        }
    }
    let ids = baked.ids(level);
    let maps: Vec<BlockMap> = ids.iter().map(|id| baked.map(*id)).collect::<Result<_>>()?;
    let field = ColumnField::new(&maps).context("a level without nodes")?;
    let origin = DVec3::from(baked.manifest().origin);
    let mut figures = LevelFigures::default();
    for (id, triangles) in below {
        let (Some(points), Some(stated_m)) = (points.get(&id), baked.error_m(id)) else { continue };
        let bytes = store.tile(TileKind::BlockMap, id)?.context("a node without columns")?.len();
        let corner = DVec3::from(baked.manifest().node_corner(id));
        let bits =
            (baked.manifest().node_side_m(level) * GRID_STEPS / stated_m.max(1e-3)).log2().ceil().clamp(6.0, 16.0);
        let source = model_of(&triangles, corner);
        let Some((mesh, mesh_bytes)) = fitting(&source, bytes, bits as u8) else {
            figures.without_mesh += 1;
            continue;
        };
        let (Some(mesh_surface), Some(source_surface)) = (Surface::of_model(&mesh), Surface::of_model(&source)) else {
            continue;
        };
        let local: Vec<[f64; 3]> = points.iter().map(|point| (*point - corner).to_array()).collect();
        let sorted = |distances: Vec<f64>| {
            let mut distances: Vec<f64> = distances.into_iter().map(|m| m.min(args.most)).collect();
            distances.sort_by(f64::total_cmp);
            distances
        };
        let columns_m = sorted(points.iter().map(|point| field.distance_m(*point - origin, args.most)).collect());
        let mesh_m = sorted(mesh_surface.distances(&local));
        let back_m = sorted(source_surface.distances(&mesh_surface.even_points(points.len())));
        if points.len() >= LEAST_POINTS {
            let of_mesh = percentile(&mesh_m, SHARE).max(percentile(&back_m, SHARE));
            figures.judged += 1;
            figures.nearer[0] += usize::from(of_mesh < stated_m);
            figures.nearer[1] += usize::from(percentile(&mesh_m, SHARE) < percentile(&columns_m, SHARE));
        }
        figures.nodes += 1;
        figures.stated_m.push(stated_m);
        for (sum, more) in figures.bytes.iter_mut().zip([bytes, mesh_bytes]) {
            *sum += more;
        }
        for (sum, more) in figures.triangles.iter_mut().zip([source.triangles.len(), mesh.triangles.len()]) {
            *sum += more;
        }
        figures.columns_m.extend(columns_m);
        figures.mesh_m.extend(mesh_m);
        figures.back_m.extend(back_m);
    }
    Ok(figures)
}

/// Triangles in metres from a corner, with the vertices that they share.
fn model_of(triangles: &[[[f64; 3]; 3]], corner: DVec3) -> TriangleModel {
    let positions = triangles.iter().flatten().map(|p| (DVec3::from(*p) - corner).to_array()).collect();
    let corners = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let mut model = TriangleModel { positions, triangles: corners, layers: Vec::new() };
    model.weld();
    model
}

/// The mesh of about the most triangles that takes at most so many bytes, as it is decoded, with its bytes; `None` if none does.
fn fitting(model: &TriangleModel, bytes: usize, bits: u8) -> Option<(TriangleModel, usize)> {
    let made = |triangles: usize| {
        let simplified = simplify(model, Goal { triangles, error: f64::INFINITY }, |_| false).model;
        let mesh = quantise::to_mesh(&simplified, bits, bits);
        let taken = mesh.encode().ok()?.bytes.len();
        (taken <= bytes && !mesh.triangles.is_empty()).then(|| (quantise::to_model(&mesh), taken))
    };
    let whole = made(model.triangles.len());
    if whole.is_some() {
        return whole;
    }
    let (mut fits, mut beyond, mut best) = (0, model.triangles.len(), None);
    for _ in 0..STEPS {
        let middle = fits + (beyond - fits) / 2;
        match made(middle) {
            Some(found) => (best, fits) = (Some(found), middle),
            None => beyond = middle,
        }
    }
    best
}

fn print(cell_m: f64, mut figures: LevelFigures) {
    for distances in [&mut figures.stated_m, &mut figures.columns_m, &mut figures.mesh_m, &mut figures.back_m] {
        distances.sort_by(f64::total_cmp);
    }
    let LevelFigures { nodes, without_mesh, bytes, triangles, stated_m, columns_m, mesh_m, back_m, judged, nearer } =
        figures;
    let share = |count: usize| 100.0 * count as f64 / judged.max(1) as f64;
    println!(
        "| {cell_m} m | {nodes} | {without_mesh} | {} | {} | {} | {} | {:.2} m | {:.2} m | {:.2} m | {:.2} m | {:.0}% | {:.0}% |",
        bytes[0],
        bytes[1],
        triangles[0],
        triangles[1],
        percentile(&stated_m, 0.5),
        percentile(&columns_m, SHARE),
        percentile(&mesh_m, SHARE),
        percentile(&back_m, SHARE),
        share(nearer[0]),
        share(nearer[1])
    );
}
