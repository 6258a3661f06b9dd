//! `ao`: ambient occlusion of a mesh file.

use super::error::CommandError;
use super::mesh::{read_model, with_spinner};
use super::output::{check_output, print_result, write};
use crate::args::AoArgs;
use indicatif::{ProgressBar, ProgressStyle};
use insula_command_line::output::FileKind;
use insula_occlusion::{OccludedMesh, Occlusion, OcclusionError, OcclusionSettings};
use insula_protocol::mesh::AttributeKind;
use insula_simplify::model::{CornerLayer, ModelFormat, TriangleModel};
use serde_json::json;
use std::time::Instant;

/// Runs `ao`. Fails if the input is not a mesh, a GPU is asked for and there is none, or a file cannot be read or written.
pub(super) fn run(args: &AoArgs) -> Result<(), CommandError> {
    if ModelFormat::of(&args.out) != Some(ModelFormat::Ply) {
        let reason = "the file name must end in .ply, the only format with a value for each vertex";
        return Err(CommandError::Usage(format!("{}: {reason}", args.out.display())));
    }
    check_output(&args.out, FileKind::PLY, [&args.mesh], args.overwrite)?;
    let compute = implementation(args.gpu)?;
    let model = with_spinner("read", || read_model(&args.mesh))?;
    if model.triangles.is_empty() {
        return Err(CommandError::file(&args.mesh, "it has no triangles"));
    }
    let settings = OcclusionSettings { views: args.views, map_px: args.map, bent_normals: false };
    let mesh = OccludedMesh { positions: &model.positions, triangles: &model.triangles };
    let start = Instant::now();
    let bar = ProgressBar::new(args.views.into()).with_message("occlusion");
    // The template is constant. Without it, the bar has the default one.
    if let Ok(style) = ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} views, {eta} left") {
        bar.set_style(style);
    }
    let watch = |views: u32| {
        bar.set_position(views.min(args.views).into());
        true
    };
    let found = compute(mesh, &[], settings, &watch);
    bar.finish_and_clear();
    let found = found.map_err(|error| CommandError::file(&args.mesh, error))?;
    let seconds = start.elapsed().as_secs_f64();
    let (vertices, triangles) = (model.positions.len(), model.triangles.len());
    let least = found.share.iter().copied().fold(1.0, f32::min);
    let mean = found.share.iter().map(|share| f64::from(*share)).sum::<f64>() / vertices.max(1) as f64;
    write(&args.out, &with_occlusion(model, &found, args.stretch).write(ModelFormat::Ply))?;
    let text = format!(
        "{}: {triangles} triangles, {vertices} vertices, mean {mean:.3}, least {least:.3}, {seconds:.2} s\n",
        args.out.display()
    );
    let facts = json!({
        "triangles": triangles,
        "vertices": vertices,
        "mean": mean,
        "least": least,
        "seconds": seconds,
    });
    print_result(args.json, &facts, &text);
    Ok(())
}

type Compute = fn(
    OccludedMesh<'_>,
    &[[[f64; 3]; 3]],
    OcclusionSettings,
    &(dyn Fn(u32) -> bool + Sync),
) -> Result<Occlusion, OcclusionError>;

/// Fails if the program has no code for GPUs.
fn implementation(gpu: bool) -> Result<Compute, CommandError> {
    match gpu {
        false => Ok(insula_occlusion::cpu),
        #[cfg(feature = "gpu")]
        true => Ok(insula_occlusion::gpu),
        #[cfg(not(feature = "gpu"))]
        true => Err(CommandError::Bake("--gpu: this program was built without feature `gpu`".into())),
    }
}

/// Values of vertices stretched so that those of triangles are 0 to 1 (Mischitelli 2007, 3.4.2). If all are the same, they stay.
fn stretched(triangles: &[[u32; 3]], share: &[f32]) -> Vec<f32> {
    let used = triangles.as_flattened().iter().filter_map(|vertex| share.get(*vertex as usize));
    let [low, high] = used.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)]);
    let stretch = |v: &f32| if low < high { ((*v - low) / (high - low)).clamp(0.0, 1.0) } else { *v };
    share.iter().map(stretch).collect()
}

/// The model with occlusion as quality and as grey, instead of its colours.
fn with_occlusion(mut model: TriangleModel, found: &Occlusion, stretch: bool) -> TriangleModel {
    let corners = model.triangles.as_flattened().to_vec();
    model.layers.retain(|layer| layer.kind != AttributeKind::Colour);
    let greys = if stretch { stretched(&model.triangles, &found.share) } else { found.share.clone() };
    let grey = greys.iter().map(|grey| [*grey, *grey, *grey, 0.0]).collect();
    model.layers.push(CornerLayer { kind: AttributeKind::Colour, width: 3, values: grey, corners: corners.clone() });
    let values = found.share.iter().map(|share| [*share, 0.0, 0.0, 0.0]).collect();
    model.layers.push(CornerLayer { kind: AttributeKind::Other, width: 1, values, corners });
    model
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_command_line::output::OverwriteArgs;
    use std::path::Path;

    fn args(mesh: &Path, out: &Path) -> AoArgs {
        AoArgs {
            mesh: mesh.to_owned(),
            out: out.to_owned(),
            views: 128,
            map: 256,
            gpu: false,
            stretch: false,
            json: Default::default(),
            overwrite: OverwriteArgs::default(),
        }
    }

    #[test]
    fn occlusion_is_written_as_quality_and_grey() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        // A floor with a wall at the edge between vertices 0 and 1, which both have.
        let off = "OFF\n6 4 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n3 0 1 2\n3 0 2 3\n3 0 5 1\n3 0 4 5\n";
        std::fs::write(path("a.off"), off).unwrap();
        run(&args(&path("a.off"), &path("b.ply"))).unwrap();
        let bytes = std::fs::read(path("b.ply")).unwrap();
        let head = String::from_utf8_lossy(&bytes[..500.min(bytes.len())]).into_owned();
        for line in ["property uchar red", "property uchar blue", "property float quality", "element vertex 6"] {
            assert!(head.contains(&format!("{line}\n")), "{head}");
        }
        let read = read_model(&path("b.ply")).unwrap();
        let grey = |p: [f64; 3]| {
            let vertex = read.positions.iter().position(|other| *other == p).unwrap() as u32;
            let corner = read.triangles.as_flattened().iter().position(|other| *other == vertex).unwrap();
            read.layers[0].value(corner).unwrap()
        };
        let (edge, outer) = (grey([0.0, 0.0, 0.0]), grey([0.0, 1.0, 0.0]));
        assert!(edge[0] > 0.85 && edge[0] < 0.95 && edge[0] == edge[1] && edge[1] == edge[2], "{edge:?}");
        assert!(outer[0] > edge[0] && outer[0] < 1.0, "{outer:?}");
        run(&AoArgs { stretch: true, ..args(&path("a.off"), &path("c.ply")) }).unwrap();
        let greys: Vec<f32> = read_model(&path("c.ply")).unwrap().layers[0].values.iter().map(|grey| grey[0]).collect();
        assert!(greys.contains(&0.0) && greys.contains(&1.0), "{greys:?}");
        assert!(greys.iter().any(|grey| *grey > 0.0 && *grey < 1.0), "{greys:?}");
        // A vertex of no triangle has 1.
        assert_eq!(stretched(&[[0, 1, 2]], &[0.25, 0.5, 0.75, 1.0]), [0.0, 0.5, 1.0, 1.0]);
        assert_eq!(stretched(&[[0, 1, 0]], &[0.5, 0.5, 1.0]), [0.5, 0.5, 1.0], "nothing to stretch");
    }

    #[test]
    fn errors_name_file_and_cause() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("a.ply"), "ply\n").unwrap();
        std::fs::write(path("empty.off"), "OFF\n1 0 0\n0 0 0\n").unwrap();
        let error = |mesh: &str, out: &str| run(&args(&path(mesh), &path(out))).unwrap_err();
        assert!(error("a.ply", "b.obj").to_string().contains(".ply"));
        assert_eq!((error("a.ply", "b.obj").exit_code(), error("a.ply", "a.ply").exit_code()), (2, 2));
        assert!(error("none.off", "b.ply").to_string().contains("none.off"));
        assert!(error("empty.off", "b.ply").to_string().contains("no triangles"));
        #[cfg(not(feature = "gpu"))]
        {
            let on_gpu = AoArgs { gpu: true, ..args(&path("empty.off"), &path("b.ply")) };
            assert!(run(&on_gpu).unwrap_err().to_string().contains("feature `gpu`"));
        }
        assert!(!path("b.ply").exists());
    }
}
