//! Compares ways to find the nodes that a view needs: box and sphere in the frustum, quadtree and octree, hits and depth buffer behind
//! occluders.
//!
//! `cargo run --release -p insula-measure --bin culling -- --city DIR [--camera FILE]`: DIR is a baked folder, for example of `synth`.
//! The depth buffer is that of the finished frame at full size, which is more than a client could know before it draws. A pyramid of
//! it (Greene, Kass and Miller 1993) finds at most as much to be occluded.

use anyhow::{Result, ensure};
use clap::Parser;
use glam::DVec3;
use insula_client::session::Session;
use insula_protocol::NODE_CELLS;
use insula_shaders::cpu::raycast::Pixels;
use insula_tests::synth::Viewpoint;
use insula_tests::viewer::{fetch_all, open};
use insula_viewer::camera::{Camera, FrustumPlane, View};
use insula_viewer::frame::RenderSettings;
use insula_viewer::scene::TreeNode;
use insula_viewer::select::cull::is_box_in_view;
use insula_viewer::streamer::FrameRequest;
use std::collections::HashSet;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

const TIMEOUT: Duration = Duration::from_secs(120);
const CACHE_MIB: u32 = 2048;
/// How often all nodes are tested for one time.
const REPEATS: u32 = 200;

/// Compares culling by box and sphere, and by hits and depth buffer
#[derive(Debug, Parser)]
struct Args {
    /// Folder of the baked city
    #[arg(long)]
    city: PathBuf,
    /// Camera file (default: the street of the synthetic cities)
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Width and height of the frame
    #[arg(long, num_args = 2, default_values_t = [1280, 720])]
    size: Vec<u32>,
    /// Tolerated error in pixels
    #[arg(long, default_value_t = 1.0)]
    tau: f64,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let camera = match &args.camera {
        Some(path) => insula_client::camera_files::read_camera(path)?,
        None => Viewpoint::Street.camera().to_viewer()?,
    };
    let size_px = [args.size[0], args.size[1]];
    let request = FrameRequest { camera, heading: None, size_px, tau_px: args.tau, switching: None };
    let mut session = open(&args.city, CACHE_MIB)?;
    fetch_all(&mut session, &request, TIMEOUT)?;
    let view = View { tau_px: args.tau, ..View::of(camera, size_px) };
    compare_frustum_tests(&session, &view.planes());
    compare_trees(&session, &view.planes());
    compare_occlusion(&mut session, &request, &view)
}

/// Whether a sphere may be in view.
fn is_sphere_in_view(planes: &[FrustumPlane; 5], centre: DVec3, radius_m: f64) -> bool {
    planes.iter().all(|plane| plane.normal.dot(centre) + plane.offset >= -radius_m)
}

/// All known nodes: which test culls how many, and how long that takes.
fn compare_frustum_tests(session: &Session, planes: &[FrustumPlane; 5]) {
    let nodes: Vec<&TreeNode> = session.tree().nodes().collect();
    // The smallest sphere around the box; that of a node also contains its children's and culls less.
    let by_sphere = |node: &TreeNode| is_sphere_in_view(planes, node.centre, node.half.length());
    let by_box = |node: &TreeNode| is_box_in_view(planes, node.centre, node.half);
    let by_both = |node: &TreeNode| by_sphere(node) && by_box(node);
    println!("{} nodes\n| test | culled | ns a node |\n|---|---|---|", nodes.len());
    print_test("sphere", &nodes, by_sphere);
    print_test("box", &nodes, by_box);
    print_test("sphere, then box", &nodes, by_both);
}

fn print_test(name: &str, nodes: &[&TreeNode], is_in_view: impl Fn(&TreeNode) -> bool) {
    let culled = nodes.iter().filter(|node| !is_in_view(node)).count();
    let mut best_secs = f64::INFINITY;
    for _ in 0..REPEATS {
        let begin = Instant::now();
        for node in nodes {
            black_box(is_in_view(black_box(node)));
        }
        best_secs = best_secs.min(begin.elapsed().as_secs_f64());
    }
    println!("| {name} | {culled} | {:.1} |", best_secs * 1e9 / nodes.len() as f64);
}

/// All known nodes as those of an octree: of each, the cubes with its side, from the city's lowest point, that its box touches. An octree
/// may have fewer where a node is empty at some height.
fn compare_trees(session: &Session, planes: &[FrustumPlane; 5]) {
    println!(
        "\n| level | side, m | nodes | of more than one cube | cubes | nodes in view | cubes in view |\n|---|---|---|---|---|---|---|"
    );
    let tree = session.tree();
    let base_m = tree.nodes().map(|node| node.centre.z - node.half.z).fold(f64::INFINITY, f64::min);
    let mut all = [0usize; 5];
    for level in 0..=tree.manifest().depth {
        let side_m = tree.manifest().cell_m_at(level) * NODE_CELLS as f64;
        let mut counts = [0usize; 5];
        for node in tree.nodes().filter(|node| node.id.level() == level) {
            let [low, high] = [node.centre.z - node.half.z, node.centre.z + node.half.z];
            let first = ((low - base_m) / side_m).floor();
            let count = (((high - base_m) / side_m).ceil() - first).max(1.0) as usize;
            let is_in_view = |k: &usize| {
                let [bottom, top] =
                    [0.0, 1.0].map(|end| (base_m + (first + *k as f64 + end) * side_m).clamp(low, high));
                let (centre, half) = (node.centre.with_z(0.5 * (bottom + top)), node.half.with_z(0.5 * (top - bottom)));
                is_box_in_view(planes, centre, half)
            };
            let is_node_in_view = usize::from(is_box_in_view(planes, node.centre, node.half));
            let in_view = (0..count).filter(is_in_view).count();
            let one = [1, usize::from(count > 1), count, is_node_in_view, in_view];
            (0..5).for_each(|k| counts[k] += one[k]);
        }
        (0..5).for_each(|k| all[k] += counts[k]);
        let [nodes, several, cubes, nodes_in_view, cubes_in_view] = counts;
        println!("| {level} | {side_m:.0} | {nodes} | {several} | {cubes} | {nodes_in_view} | {cubes_in_view} |");
    }
    let [nodes, several, cubes, nodes_in_view, cubes_in_view] = all;
    println!("| all | | {nodes} | {several} | {cubes} | {nodes_in_view} | {cubes_in_view} |");
}

/// The nodes that a client draws that culls by the frustum alone: which are seen, and which a depth buffer takes for visible.
fn compare_occlusion(session: &mut Session, request: &FrameRequest, view: &View) -> Result<()> {
    let data = session.frame_data(request, &RenderSettings::default());
    let draw_list = session.selection().draw_tiles.clone();
    let pixels = session.adapter_mut().draw(&data)?;
    let hits: HashSet<u32> = pixels.hit.iter().copied().collect();
    let (mut drawn, mut seen, mut passed) = ([0u64; 2], [0u64; 2], [0u64; 2]);
    for (i, item) in (0..).zip(&draw_list) {
        let node = session.tree().node(item.node);
        let one = [1, u64::from(node.bytes)];
        let add = |sum: &mut [u64; 2]| *sum = [sum[0] + one[0], sum[1] + one[1]];
        add(&mut drawn);
        let is_seen = hits.contains(&i);
        let passes = passes_depth(&pixels, view, node);
        ensure!(passes || !is_seen, "the depth buffer culls a node that is seen");
        if is_seen {
            add(&mut seen);
        }
        if passes {
            add(&mut passed);
        }
    }
    println!("\n| nodes in the frustum | number | KiB |\n|---|---|---|");
    for (name, [number, bytes]) in [("all", drawn), ("in front of the depth buffer", passed), ("hit by a ray", seen)] {
        println!("| {name} | {number} | {} |", bytes >> 10);
    }
    Ok(())
}

/// Whether the node's box is nearer than the depth buffer anywhere in the rectangle that it covers.
fn passes_depth(pixels: &Pixels, view: &View, node: &TreeNode) -> bool {
    let Camera { position, forward, right, up, .. } = view.camera;
    let nearest = position.clamp(node.centre - node.half, node.centre + node.half).distance(position);
    let focal = view.focal_px();
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in 0..8 {
        let sign = |bit: u32| f64::from(corner >> bit & 1) * 2.0 - 1.0;
        let p = node.centre + node.half * DVec3::new(sign(0), sign(1), sign(2)) - position;
        let depth = p.dot(forward);
        if depth <= 1e-3 {
            return true;
        }
        let at = [
            f64::from(pixels.width_px) / 2.0 + p.dot(right) / depth * focal,
            f64::from(pixels.height_px) / 2.0 - p.dot(up) / depth * focal,
        ];
        low = [low[0].min(at[0]), low[1].min(at[1])];
        high = [high[0].max(at[0]), high[1].max(at[1])];
    }
    let range = |axis: usize, size: u32| {
        let clamp = |v: f64| v.floor().clamp(0.0, f64::from(size) - 1.0) as u32;
        clamp(low[axis] - 1.0)..=clamp(high[axis] + 1.0)
    };
    let mut rows = range(1, pixels.height_px);
    rows.any(|y| {
        let mut columns = range(0, pixels.width_px);
        columns.any(|x| f64::from(pixels.distance[(y * pixels.width_px + x) as usize]) * (1.0 + 1e-5) >= nearest)
    })
}
