//! `compress`, `decompress` and `simplify`: operations on single mesh files.

use super::error::CommandError;
use super::output::{check_output, print_result, write};
use crate::args::{CompressArgs, DecompressArgs, SimplifyArgs};
use indicatif::ProgressBar;
use insula_command_line::output::FileKind;
use insula_protocol::mesh::half_edge::RepairReport;
use insula_protocol::mesh::{AttributeKind, Mesh};
use insula_protocol::text::human_bytes;
use insula_simplify::model::{CornerLayer, ModelFormat, TriangleModel, quantise};
use insula_simplify::simplify::{self, Goal};
use insula_simplify::surface::Surface;
use serde_json::json;
use std::io::Read;
use std::path::Path;
use std::time::{Duration, Instant};

/// First bytes of a compressed mesh file. The encoded mesh follows, then its CRC-32 (little-endian).
const MAGIC: &[u8; 4] = b"INSM";

fn format_of(path: &Path) -> Result<ModelFormat, CommandError> {
    let unknown =
        || CommandError::Usage(format!("{}: the file name must end in .ply, .off, .obj or .stl", path.display()));
    ModelFormat::of(path).ok_or_else(unknown)
}

/// What a file of a format has.
fn kind_of(format: ModelFormat) -> FileKind {
    match format {
        ModelFormat::Ply => FileKind::PLY,
        ModelFormat::Off => FileKind::OFF,
        ModelFormat::Obj => FileKind::OBJ,
        ModelFormat::Stl => FileKind::STL,
    }
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, CommandError> {
    // A device or a pipe may have no end.
    let mut bytes = Vec::new();
    let file = insula_archive::file::open_regular(path);
    file.and_then(|mut file| file.read_to_end(&mut bytes)).map_err(|error| CommandError::file(path, error))?;
    Ok(bytes)
}

/// Reads a mesh and welds vertices at the same position.
pub(super) fn read_model(path: &Path) -> Result<TriangleModel, CommandError> {
    let format = format_of(path)?;
    let mut model = TriangleModel::read(&read_bytes(path)?, format).map_err(|error| CommandError::file(path, error))?;
    model.weld();
    Ok(model)
}

/// Runs `work` behind a spinner, which is shown if standard error is a terminal.
pub(super) fn with_spinner<T>(name: &'static str, work: impl FnOnce() -> T) -> T {
    let bar = ProgressBar::new_spinner().with_message(name);
    bar.enable_steady_tick(Duration::from_millis(200));
    let out = work();
    bar.finish_and_clear();
    out
}

/// The repairs as text; empty without any.
fn describe_repairs(report: &RepairReport) -> String {
    let parts = [
        (report.degenerate, "degenerate triangles removed"),
        (report.duplicate, "duplicate triangles removed"),
        (report.turned, "triangles flipped"),
        (report.cut_edges, "edges cut"),
        (report.cut_vertices, "vertices cut"),
        (report.unused, "unused vertices removed"),
    ];
    let parts = parts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("; {count} {what}"));
    parts.collect()
}

/// The corners without a value of a layer that others have, as text; empty without any.
fn describe_missing(model: &TriangleModel) -> String {
    let describe = |layer: &CornerLayer| {
        let what = match layer.kind {
            AttributeKind::Normal => "normal",
            AttributeKind::Colour => "colour",
            AttributeKind::TexCoord => "texture coordinate",
            AttributeKind::Other => "value",
        };
        format!("; {} of {} corners have no {what}", layer.missing(), layer.corners.len())
    };
    model.layers.iter().filter(|layer| layer.missing() > 0).map(describe).collect()
}

/// Runs `compress`. Fails if the input is not a mesh or a file cannot be read or written.
pub(super) fn compress(args: &CompressArgs) -> Result<(), CommandError> {
    check_output(&args.output, FileKind::COMPRESSED_MESH, [&args.input], args.overwrite)?;
    let model = with_spinner("read", || read_model(&args.input))?;
    let start = Instant::now();
    let encoded = with_spinner("compress", || quantise::to_mesh(&model, args.bits, args.texcoord_bits).encode());
    let encoded = encoded.map_err(|error| CommandError::file(&args.input, error))?;
    let seconds = start.elapsed().as_secs_f64();
    let mut file = MAGIC.to_vec();
    file.extend(&encoded.bytes);
    file.extend(insula_protocol::codec::checksum(&encoded.bytes).to_le_bytes());
    write(&args.output, &file)?;
    let (vertices, triangles) = (encoded.vertices.len(), encoded.corners.len() / 3);
    let bits = file.len() as f64 * 8.0;
    let text = format!(
        "{}: {triangles} triangles, {vertices} vertices, {}, {:.2} bits per vertex, {seconds:.2} s{}{}\n",
        args.output.display(),
        human_bytes(file.len() as u64),
        bits / vertices.max(1) as f64,
        describe_repairs(&encoded.report),
        describe_missing(&model)
    );
    let facts = json!({ "triangles": triangles, "vertices": vertices, "bytes": file.len(), "seconds": seconds });
    print_result(args.json, &facts, &text);
    Ok(())
}

/// Runs `decompress`. Fails if the input is damaged or not from `compress`, or a file cannot be read or written.
pub(super) fn decompress(args: &DecompressArgs) -> Result<(), CommandError> {
    let format = format_of(&args.output)?;
    check_output(&args.output, kind_of(format), [&args.input], args.overwrite)?;
    let file = read_bytes(&args.input)?;
    let coded = file.strip_prefix(MAGIC).and_then(|rest| rest.split_last_chunk::<4>());
    let (coded, sum) =
        coded.ok_or_else(|| CommandError::file(&args.input, "not a file of `insula-server compress`"))?;
    if insula_protocol::codec::checksum(coded) != u32::from_le_bytes(*sum) {
        return Err(CommandError::file(&args.input, "the file is damaged: its checksum differs"));
    }
    let mesh =
        with_spinner("decompress", || Mesh::decode(coded)).map_err(|error| CommandError::file(&args.input, error))?;
    let model = quantise::to_model(&mesh);
    write(&args.output, &model.write(format))?;
    let (triangles, vertices) = (mesh.triangles.len(), mesh.positions.len());
    let missing = describe_missing(&model);
    let text = format!("{}: {triangles} triangles, {vertices} vertices{missing}\n", args.output.display());
    print_result(args.json, &json!({ "triangles": triangles, "vertices": vertices }), &text);
    Ok(())
}

/// The surface of a model. Fails if it has none, or if coordinates are too large to measure distances.
pub(super) fn surface_of(path: &Path, model: &TriangleModel) -> Result<Surface, CommandError> {
    Surface::of_model(model).ok_or_else(|| CommandError::file(path, "it has no triangles, or coordinates beyond 10^15"))
}

/// Runs `simplify`, and measures how far the result lies from the input. Fails if the input is not a mesh or a file cannot be
/// read or written.
pub(super) fn simplify(args: &SimplifyArgs) -> Result<(), CommandError> {
    let format = format_of(&args.output)?;
    check_output(&args.output, kind_of(format), [&args.input], args.overwrite)?;
    let model = with_spinner("read", || read_model(&args.input))?;
    let before = model.triangles.len();
    let start = Instant::now();
    let source = surface_of(&args.input, &model)?;
    let out = with_spinner("simplify", || match (args.error, args.ratio) {
        (Some(limit), _) => simplify::simplify_within(&model, &source, limit),
        (None, ratio) => {
            let of_ratio = ratio.map_or(0, |ratio| (before as f64 * ratio).round() as usize);
            let triangles = args.triangles.unwrap_or(of_ratio);
            let mut out = simplify::simplify(&model, Goal { triangles, error: f64::INFINITY }, |_| false);
            out.error = simplify::largest_distance(&source, &out.model);
            out
        }
    });
    let seconds = start.elapsed().as_secs_f64();
    write(&args.output, &out.model.write(format))?;
    let text = format!(
        "{}: {} of {before} triangles, largest distance {:.6} ({:.4}% of the diagonal), {} components removed, {seconds:.2} s{}{}\n",
        args.output.display(),
        out.model.triangles.len(),
        out.error,
        out.error / source.diagonal().max(f64::MIN_POSITIVE) * 100.0,
        out.removed_parts,
        describe_repairs(&out.repairs),
        describe_missing(&out.model)
    );
    let facts = json!({
        "triangles": out.model.triangles.len(),
        "triangles_before": before,
        "largest_distance": out.error,
        "removed_components": out.removed_parts,
        "seconds": seconds,
    });
    print_result(args.json, &facts, &text);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pyramid with four different sides.
    const OFF: &str =
        "OFF\n5 6 0\n0 0 0\n10 0 0\n10 8 0\n0 8 0\n4 3 7\n4 3 2 1 0\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n";

    fn pack(folder: &Path, input: &str, output: &str, bits: u8) -> Result<(), CommandError> {
        let [input, output] = [input, output].map(|name| folder.join(name));
        let (json, overwrite) = Default::default();
        compress(&CompressArgs { input, output, bits, texcoord_bits: 12, json, overwrite })
    }

    fn unpack(folder: &Path, input: &str, output: &str) -> Result<(), CommandError> {
        let [input, output] = [input, output].map(|name| folder.join(name));
        let (json, overwrite) = Default::default();
        decompress(&DecompressArgs { input, output, json, overwrite })
    }

    #[test]
    fn mesh_survives_compress_decompress_and_simplify() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("a.off"), OFF).unwrap();
        pack(folder.path(), "a.off", "a.insm", 14).unwrap();
        for name in ["b.ply", "b.obj", "b.off", "b.stl"] {
            unpack(folder.path(), "a.insm", name).unwrap();
            let read = read_model(&path(name)).unwrap();
            assert_eq!((read.positions.len(), read.triangles.len()), (5, 6));
            let top = read.positions.iter().map(|p| p[2]).fold(0.0, f64::max);
            assert!((top - 7.0).abs() < 0.001, "{name}: {top}");
        }
        let (input, output) = (path("b.ply"), path("c.obj"));
        let (ratio, error, json, overwrite) = Default::default();
        simplify(&SimplifyArgs { input, output, triangles: Some(4), ratio, error, json, overwrite }).unwrap();
        assert_eq!(read_model(&path("c.obj")).unwrap().triangles.len(), 4);
    }

    #[test]
    fn errors_name_file_and_cause() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("a.off"), OFF).unwrap();
        let to = |input: &str, output: &str| pack(folder.path(), input, output, 12).unwrap_err().to_string();
        assert!(to("none.off", "x").contains("none.off"));
        assert!(to("a.dae", "x").contains(".ply, .off, .obj or .stl"));
        std::fs::write(path("bad.off"), "OFF\n3 1 0\n0 0 zero\n").unwrap();
        assert!(to("bad.off", "x").contains("line 3"));
        pack(folder.path(), "a.off", "a.insm", 12).unwrap();
        let mut file = std::fs::read(path("a.insm")).unwrap();
        file[9] ^= 1;
        std::fs::write(path("a.insm"), file).unwrap();
        let from = |input: &str| unpack(folder.path(), input, "b.off").unwrap_err().to_string();
        assert!(from("a.insm").contains("checksum"));
        assert!(from("a.off").contains("compress"));
    }
}
