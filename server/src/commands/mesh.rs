//! `compress`, `decompress`, `simplify`: meshes of single files.
//!
//! In: what was typed. Out: a file, and a line that says what was done. Next: a person, or another program.

use super::error::CommandError;
use crate::args::{CompressArgs, DecompressArgs, SimplifyArgs};

/// Before the coded mesh; a CRC-32 of it comes after.
#[cfg(feature = "bake")]
const MAGIC: &[u8; 4] = b"INSM";

#[cfg(not(feature = "bake"))]
mod without_bake {
    use super::{CommandError, CompressArgs, DecompressArgs, SimplifyArgs};

    fn cannot() -> Result<(), CommandError> {
        Err(CommandError::Bake("this program only serves; take one that was built with the feature `bake`".into()))
    }

    pub(in crate::commands) fn compress(_: &CompressArgs) -> Result<(), CommandError> {
        cannot()
    }

    pub(in crate::commands) fn decompress(_: &DecompressArgs) -> Result<(), CommandError> {
        cannot()
    }

    pub(in crate::commands) fn simplify(_: &SimplifyArgs) -> Result<(), CommandError> {
        cannot()
    }
}

#[cfg(not(feature = "bake"))]
pub(super) use without_bake::{compress, decompress, simplify};

#[cfg(feature = "bake")]
pub(super) use with_bake::{compress, decompress, simplify};

#[cfg(feature = "bake")]
mod with_bake {
    use super::{CommandError, CompressArgs, DecompressArgs, MAGIC, SimplifyArgs};
    use crate::commands::output::{human_bytes, print, write};
    use indicatif::ProgressBar;
    use insula_bake::{
        model::{ModelFormat, TriangleModel, quantise},
        simplify::{self, Goal},
    };
    use insula_protocol::mesh::{Mesh, pieces::Census};
    use std::{
        path::Path,
        time::{Duration, Instant},
    };

    fn wrong(path: &Path, what: &dyn std::fmt::Display) -> CommandError {
        CommandError::Mesh { path: path.to_owned(), reason: what.to_string() }
    }

    fn format(path: &Path) -> Result<ModelFormat, CommandError> {
        let unknown =
            || CommandError::Usage(format!("{}: a name that ends in .ply, .off or .obj is wanted", path.display()));
        ModelFormat::of(path).ok_or_else(unknown)
    }

    fn bytes(path: &Path) -> Result<Vec<u8>, CommandError> {
        std::fs::read(path).map_err(|error| wrong(path, &error))
    }

    fn model(path: &Path) -> Result<TriangleModel, CommandError> {
        let format = format(path)?;
        let mut model = TriangleModel::read(&bytes(path)?, format).map_err(|error| wrong(path, &error))?;
        model.weld();
        Ok(model)
    }

    /// Says on a terminal what is going on, and gives what came of it.
    fn stage<T>(name: &'static str, work: impl FnOnce() -> T) -> T {
        // Nothing is drawn where standard error is no terminal.
        let bar = ProgressBar::new_spinner().with_message(name);
        bar.enable_steady_tick(Duration::from_millis(200));
        let out = work();
        bar.finish_and_clear();
        out
    }

    /// What was left out or mended, if anything.
    fn mended(census: &Census) -> String {
        let parts = [
            (census.degenerate, "degenerate triangles left out"),
            (census.duplicate, "triangles there twice left out"),
            (census.turned, "triangles turned around"),
            (census.cut_edges, "edges cut"),
            (census.cut_vertices, "vertices cut"),
            (census.unused, "unused vertices left out"),
        ];
        let parts = parts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("; {count} {what}"));
        parts.collect()
    }

    pub(in crate::commands) fn compress(args: &CompressArgs) -> Result<(), CommandError> {
        let model = stage("read", || model(&args.input))?;
        let begin = Instant::now();
        let encoded = stage("compress", || quantise::to_mesh(&model, args.bits, args.texcoord_bits).encode());
        let encoded = encoded.map_err(|error| wrong(&args.input, &error))?;
        let seconds = begin.elapsed().as_secs_f64();
        let mut file = MAGIC.to_vec();
        file.extend(&encoded.bytes);
        file.extend(insula_protocol::codec::checksum(&encoded.bytes).to_le_bytes());
        write(&args.output, &file)?;
        let (vertices, triangles) = (encoded.vertices.len(), encoded.corners.len() / 3);
        let bits = file.len() as f64 * 8.0;
        print(&format!(
            "{}: {triangles} triangles, {vertices} vertices, {}, {:.2} bits a vertex, {seconds:.2} s{}\n",
            args.output.display(),
            human_bytes(file.len() as u64),
            bits / vertices.max(1) as f64,
            mended(&encoded.census)
        ));
        Ok(())
    }

    pub(in crate::commands) fn decompress(args: &DecompressArgs) -> Result<(), CommandError> {
        let format = format(&args.output)?;
        let file = bytes(&args.input)?;
        let coded = file.strip_prefix(MAGIC).and_then(|rest| rest.split_last_chunk::<4>());
        let (coded, sum) = coded.ok_or_else(|| wrong(&args.input, &"no file of `insula-server compress`"))?;
        if insula_protocol::codec::checksum(coded) != u32::from_le_bytes(*sum) {
            return Err(wrong(&args.input, &"its checksum differs, the file is damaged"));
        }
        let mesh = stage("decompress", || Mesh::decode(coded)).map_err(|error| wrong(&args.input, &error))?;
        write(&args.output, &quantise::to_model(&mesh).write(format))?;
        let (triangles, vertices) = (mesh.triangles.len(), mesh.positions.len());
        print(&format!("{}: {triangles} triangles, {vertices} vertices\n", args.output.display()));
        Ok(())
    }

    pub(in crate::commands) fn simplify(args: &SimplifyArgs) -> Result<(), CommandError> {
        let format = format(&args.output)?;
        let model = stage("read", || model(&args.input))?;
        let before = model.triangles.len();
        let triangles = args.ratio.map_or(0, |ratio| (before as f64 * ratio).round() as usize);
        let goal = Goal { triangles, error: args.error.unwrap_or(f64::INFINITY) };
        let begin = Instant::now();
        let out = stage("simplify", || simplify::simplify(&model, goal, |_| false));
        let seconds = begin.elapsed().as_secs_f64();
        write(&args.output, &out.model.write(format))?;
        print(&format!(
            "{}: {} of {before} triangles, error {:.6} ({:.4}% of the diagonal), {} parts left out, {seconds:.2} s{}\n",
            args.output.display(),
            out.model.triangles.len(),
            out.error,
            out.error / model.diagonal().max(f64::MIN_POSITIVE) * 100.0,
            out.left,
            mended(&out.census)
        ));
        Ok(())
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        /// A pyramid whose sides are all different.
        const OFF: &str =
            "OFF\n5 6 0\n0 0 0\n10 0 0\n10 8 0\n0 8 0\n4 3 7\n4 3 2 1 0\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n";

        #[test]
        fn a_mesh_goes_through_all_tools() {
            let folder = tempfile::tempdir().unwrap();
            let path = |name: &str| folder.path().join(name);
            std::fs::write(path("a.off"), OFF).unwrap();
            compress(&CompressArgs { input: path("a.off"), output: path("a.insm"), bits: 14, texcoord_bits: 12 })
                .unwrap();
            for name in ["b.ply", "b.obj", "b.off"] {
                decompress(&DecompressArgs { input: path("a.insm"), output: path(name) }).unwrap();
                let read = model(&path(name)).unwrap();
                assert_eq!((read.positions.len(), read.triangles.len()), (5, 6));
                let top = read.positions.iter().map(|p| p[2]).fold(0.0, f64::max);
                assert!((top - 7.0).abs() < 0.001, "{name}: {top}");
            }
            let args = SimplifyArgs { input: path("b.ply"), output: path("c.obj"), ratio: Some(0.7), error: None };
            simplify(&args).unwrap();
            assert_eq!(model(&path("c.obj")).unwrap().triangles.len(), 4);
        }

        #[test]
        fn what_is_wrong_is_said() {
            let folder = tempfile::tempdir().unwrap();
            let path = |name: &str| folder.path().join(name);
            std::fs::write(path("a.off"), OFF).unwrap();
            let to = |input: &str, output: &str| {
                let args = CompressArgs { input: path(input), output: path(output), bits: 12, texcoord_bits: 12 };
                compress(&args).unwrap_err().to_string()
            };
            assert!(to("none.off", "x").contains("none.off"));
            assert!(to("a.stl", "x").contains(".ply, .off or .obj"));
            std::fs::write(path("bad.off"), "OFF\n3 1 0\n0 0 zero\n").unwrap();
            assert!(to("bad.off", "x").contains("line 3"));
            let args = CompressArgs { input: path("a.off"), output: path("a.insm"), bits: 12, texcoord_bits: 12 };
            compress(&args).unwrap();
            let mut file = std::fs::read(path("a.insm")).unwrap();
            file[9] ^= 1;
            std::fs::write(path("a.insm"), file).unwrap();
            let args = DecompressArgs { input: path("a.insm"), output: path("b.off") };
            assert!(decompress(&args).unwrap_err().to_string().contains("checksum"));
            let args = DecompressArgs { input: path("a.off"), output: path("b.off") };
            assert!(decompress(&args).unwrap_err().to_string().contains("compress"));
        }
    }
}
