//! Compares the mesh codec with Draco, meshoptimizer with zstd, and static Huffman codes: bytes, bits per vertex, time.
//!
//! `cargo run --release -p insula-measure --bin mesh_codec -- --scan skull.obj --city delft.city.jsonl`. Needs Draco's programs
//! (Debian package `draco`). For a city, bytes are those of its leaves with their headers; times are those of the whole city as
//! one mesh, because Draco prints whole milliseconds.

#![allow(clippy::unwrap_used, reason = "a bench may fail loudly")]

use anyhow::{Context, Result, ensure};
use clap::Parser;
use insula_bake::read::{self, ReadOptions};
use insula_protocol::codec::zstd;
use insula_protocol::mesh::Mesh;
use insula_protocol::mesh::half_edge::{HalfEdgeMesh, NONE, prev};
use insula_simplify::model::{ModelFormat, TriangleModel, quantise};
use insula_tests::leaves;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Compares the mesh codec with others
#[derive(Debug, Parser)]
struct Args {
    /// PLY, OFF, OBJ or STL files, whose attributes are left out
    #[arg(long)]
    scan: Vec<PathBuf>,
    /// City files, leaf by leaf
    #[arg(long)]
    city: Vec<PathBuf>,
    /// Side of a leaf in metres
    #[arg(long, default_value_t = 64.0)]
    side: f64,
    /// Number of measurements of each time
    #[arg(long, default_value_t = 15)]
    times: usize,
}

const BITS: u8 = 12;

fn main() -> Result<()> {
    let args = Args::parse();
    println!(
        "| mesh | coder | bytes | to Draco cl10 | connectivity | geometry | encode ms | decode ms | M triangles/s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let mut ratios = Vec::new();
    for path in &args.scan {
        let format = ModelFormat::of(path).context("the name must end in .ply, .off or .obj")?;
        let mut model = TriangleModel::read(&std::fs::read(path)?, format)?;
        model.weld();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut mesh = quantise::to_mesh(&model, BITS, BITS);
        // Draco is given positions only.
        mesh.attributes.clear();
        ratios.push(bench(&name, std::slice::from_ref(&mesh), &mesh, args.times)?);
    }
    if !ratios.is_empty() {
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        let largest = ratios.iter().copied().fold(0.0, f64::max);
        println!("{} scans: bytes to Draco, mean {mean:.4}, largest {largest:.4}", ratios.len());
    }
    for path in &args.city {
        let (scene, _) = read::read(std::slice::from_ref(path), &ReadOptions::default(), &|_| {})?;
        let leaves = leaves::leaves(&scene, args.side, BITS);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        bench(&format!("{name}, {} leaves", leaves.len()), &leaves, &leaves::whole_mesh(&scene, BITS), args.times)?;
    }
    Ok(())
}

/// Prints the sizes of all `meshes` and the times of `one`. Returns the bytes relative to Draco's.
fn bench(name: &str, meshes: &[Mesh], one: &Mesh, times: usize) -> Result<f64> {
    let folder = tempfile::tempdir()?;
    let (mut ours, mut connectivity, mut vertices) = (0, 0.0, 0);
    let mut draco = [0; 2];
    let (mut draco_connectivity, mut meshopt, mut huffman) = (0, 0, 0);
    for mesh in meshes {
        let encoded = mesh.encode()?;
        check(mesh, &encoded.bytes, &encoded.vertices, &encoded.corners)?;
        ours += encoded.bytes.len();
        connectivity += encoded.connectivity_bits;
        vertices += encoded.vertices.len();
        let (source, coded) = (folder.path().join("in.obj"), folder.path().join("out.drc"));
        std::fs::write(&source, obj(mesh, false))?;
        for (level, sum) in ["10", "7"].into_iter().zip(&mut draco) {
            draco_encode(&source, &coded, level)?;
            *sum += std::fs::metadata(&coded)?.len();
        }
        std::fs::write(&source, obj(mesh, true))?;
        draco_encode(&source, &coded, "10")?;
        draco_connectivity += std::fs::metadata(&coded)?.len();
        let decoded = Mesh::decode(&encoded.bytes)?;
        meshopt += with_meshopt(&decoded)?;
        huffman += with_huffman(&decoded);
    }
    // Alternating, so that other load affects all coders equally.
    let (source, coded, back) =
        (folder.path().join("one.obj"), folder.path().join("one.drc"), folder.path().join("one.ply"));
    std::fs::write(&source, obj(one, false))?;
    let bytes = one.encode()?.bytes;
    let mut taken: [[Vec<f64>; 2]; 3] = Default::default();
    for _ in 0..times {
        for (level, taken) in ["10", "7"].into_iter().zip(&mut taken) {
            taken[0].push(draco_encode(&source, &coded, level)?);
            taken[1].push(milliseconds("draco_decoder", &[&"-i", &coded.as_os_str(), &"-o", &back.as_os_str()])?);
        }
        let begin = Instant::now();
        one.encode()?;
        taken[2][0].push(begin.elapsed().as_secs_f64() * 1e3);
        let begin = Instant::now();
        Mesh::decode(&bytes)?;
        taken[2][1].push(begin.elapsed().as_secs_f64() * 1e3);
    }
    let [level_10, level_7, own] = taken.map(|taken| taken.map(median));
    let bits = |bits: f64| bits / vertices as f64;
    let row = |coder: &str, bytes: u64, connectivity: Option<f64>, times: Option<[f64; 2]>| {
        let all = bytes as f64 * 8.0;
        let split = connectivity.map_or(" | ".to_owned(), |c| format!("{:.2} | {:.2}", bits(c), bits(all - c)));
        let times = times.map_or(" | | ".to_owned(), |[encode, decode]| {
            format!("{encode:.1} | {decode:.1} | {:.1}", one.triangles.len() as f64 / decode / 1e3)
        });
        println!("| {name} | {coder} | {bytes} | {:.3} | {split} | {times} |", bytes as f64 / draco[0] as f64);
    };
    row("Insula", ours as u64, Some(connectivity), Some(own));
    row("Draco, cl 10", draco[0], Some(draco_connectivity as f64 * 8.0), Some(level_10));
    row("Draco, cl 7", draco[1], None, Some(level_7));
    row("meshoptimizer, zstd 19", meshopt as u64, None, None);
    row("static Huffman", huffman as u64, None, None);
    Ok(ours as f64 / draco[0] as f64)
}

/// Fails unless decoding gives the encoded mesh.
fn check(mesh: &Mesh, bytes: &[u8], vertices: &[u32], corners: &[u32]) -> Result<()> {
    let back = Mesh::decode(bytes)?;
    let positions = vertices.iter().map(|vertex| mesh.positions[*vertex as usize]);
    ensure!(back.positions.iter().copied().eq(positions), "positions differ");
    let given = mesh.triangles.as_flattened();
    let same =
        back.triangles.as_flattened().iter().zip(corners).all(|(v, c)| vertices[*v as usize] == given[*c as usize]);
    ensure!(same, "triangles differ");
    Ok(())
}

/// The mesh as OBJ, in steps of the grid, which Draco then finds again. With `flat`, all vertices but one are at the same grid
/// point, so that only connectivity takes bytes.
fn obj(mesh: &Mesh, flat: bool) -> String {
    let mut out = String::new();
    for (i, [x, y, z]) in mesh.positions.iter().enumerate() {
        let _ = match flat {
            false => writeln!(out, "v {x} {y} {z}"),
            true if i == 0 => writeln!(out, "v 1 0 0"),
            true => writeln!(out, "v {:e} 0 0", i as f64 * 1e-12),
        };
    }
    for [a, b, c] in &mesh.triangles {
        let _ = writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    out
}

fn draco_encode(source: &Path, coded: &Path, level: &str) -> Result<f64> {
    let bits = BITS.to_string();
    milliseconds(
        "draco_encoder",
        &[&"-i", &source.as_os_str(), &"-o", &coded.as_os_str(), &"-cl", &level, &"-qp", &bits],
    )
}

/// The time that a program of Draco prints, without reading and writing files.
fn milliseconds(program: &str, args: &[&dyn AsRef<std::ffi::OsStr>]) -> Result<f64> {
    let output = Command::new(program).args(args.iter().map(|arg| arg.as_ref())).output();
    let output = output.with_context(|| format!("{program} cannot be run: is the package draco installed?"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    ensure!(output.status.success(), "{program} failed: {text}");
    let before = text.split(" ms to ").next().and_then(|text| text.rsplit('(').next());
    before.and_then(|number| number.parse().ok()).with_context(|| format!("{program} says no time: {text}"))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Bytes of indices and 16-bit positions, both optimised and coded by meshoptimizer, then compressed.
fn with_meshopt(mesh: &Mesh) -> Result<usize> {
    let vertices: Vec<[u16; 4]> = mesh.positions.iter().map(|p| [p[0] as u16, p[1] as u16, p[2] as u16, 0]).collect();
    let mut indices = meshopt::optimize_vertex_cache(mesh.triangles.as_flattened(), vertices.len());
    let vertices = meshopt::optimize_vertex_fetch(&mut indices, &vertices);
    let coded = [meshopt::encode_index_buffer(&indices, vertices.len())?, meshopt::encode_vertex_buffer(&vertices)?];
    Ok(zstd::compress(&coded.concat())?.len())
}

/// Bytes of valences and single-parallelogram residuals in traversal order (Gasparello 2007).
fn with_huffman(mesh: &Mesh) -> usize {
    let pieces = HalfEdgeMesh::new(&mesh.triangles, mesh.positions.len() as u32);
    let mut degrees = vec![0i32; pieces.vertex.len()];
    pieces.origin.iter().for_each(|vertex| degrees[*vertex as usize] += 1);
    let mut met = vec![false; pieces.vertex.len()];
    let mut residuals = Vec::new();
    let place = |vertex: u32| mesh.positions[pieces.vertex[vertex as usize] as usize].map(|v| v as i32);
    let mut last = [2048; 3];
    for h in 0..pieces.origin.len() as u32 {
        let vertex = pieces.origin[h as usize];
        if std::mem::replace(&mut met[vertex as usize], true) {
            continue;
        }
        let here = place(vertex);
        // The third corner of a triangle is predicted across its first edge.
        let beyond = if h % 3 == 2 { pieces.twin[h as usize - 2] } else { NONE };
        let apex = (beyond != NONE).then(|| pieces.origin[prev(beyond) as usize]).filter(|apex| met[*apex as usize]);
        let expected = match apex {
            Some(apex) => {
                let [a, b, x] = [pieces.origin[h as usize - 2], pieces.origin[h as usize - 1], apex].map(place);
                std::array::from_fn(|k| a[k] + b[k] - x[k])
            }
            None => last,
        };
        residuals.extend((0..3).map(|k| here[k] - expected[k]));
        last = here;
    }
    huffman_bytes(&degrees) + huffman_bytes(&residuals)
}

/// Bytes of a static Huffman code, with its table: two bytes and a length per symbol.
fn huffman_bytes(symbols: &[i32]) -> usize {
    let mut counts: BTreeMap<i32, u64> = BTreeMap::new();
    symbols.iter().for_each(|symbol| *counts.entry(*symbol).or_default() += 1);
    let mut heap: BinaryHeap<Reverse<u64>> = counts.values().map(|count| Reverse(*count)).collect();
    // Joining two branches lengthens the codes of all symbols below by one bit.
    let mut bits = 0;
    while let (Some(Reverse(a)), Some(Reverse(b))) = (heap.pop(), heap.pop()) {
        bits += a + b;
        if heap.is_empty() {
            break;
        }
        heap.push(Reverse(a + b));
    }
    bits.div_ceil(8) as usize + 3 * counts.len()
}
