//! `compare`: how far two surfaces lie from each other, both ways.

use super::{
    error::CommandError,
    mesh::{mesh_error, read_model, surface_of, with_spinner},
    output::{check_output, print, write},
};
use crate::{args::CompareArgs, store::CityStore};
use insula_bake::read::{self, ReadOptions};
use insula_command_line::output::FileKind;
use insula_protocol::{MeshTile, Subtree, TileId, TileKind, error::DecodeError, mesh::AttributeKind, mesh_tile};
use insula_simplify::{
    model::{CornerLayer, MAX_COUNT, ModelFormat, TriangleModel},
    surface::{Surface, SurfaceDistance},
};
use std::path::Path;

/// Colours of a heat map from no distance to the largest, with even steps between them (0 to 1).
const COLOURS: [[f32; 3]; 5] = [[0.1, 0.2, 0.8], [0.1, 0.7, 0.9], [0.2, 0.8, 0.3], [0.95, 0.85, 0.2], [0.85, 0.1, 0.1]];

/// Runs `compare`. Fails if an input cannot be read or has no triangles, or the heat map cannot be written.
pub(super) fn run(args: &CompareArgs) -> Result<(), CommandError> {
    if let Some(heatmap) = &args.heatmap {
        check_output(heatmap, FileKind::PLY, [&args.a, &args.b], args.overwrite)?;
    }
    let [a, b] = [&args.a, &args.b].map(|path| with_spinner("read", || load(path)));
    let (a, b) = (a?, b?);
    let (first, second) = (surface_of(&args.a, &a)?, surface_of(&args.b, &b)?);
    let (there, back) =
        with_spinner("compare", || (first.compare(&second, args.samples), second.compare(&first, args.samples)));
    let diagonal = first.diagonal().max(f64::MIN_POSITIVE);
    let line = |from: &Path, to: &Path, distance: &SurfaceDistance| {
        let SurfaceDistance { mean, rms, max, farthest: [x, y, z] } = *distance;
        let share = |value: f64| format!("{value:.6} ({:.4}%)", value / diagonal * 100.0);
        format!(
            "{} to {}: mean {}, RMS {}, largest {} at {x:.3}, {y:.3}, {z:.3}\n",
            from.display(),
            to.display(),
            share(mean),
            share(rms),
            share(max)
        )
    };
    print(&format!(
        "{}{}Hausdorff distance {:.6}; the diagonal of {} is {diagonal:.3}\n",
        line(&args.a, &args.b, &there),
        line(&args.b, &args.a, &back),
        there.max.max(back.max),
        args.a.display()
    ));
    match &args.heatmap {
        Some(path) => write(path, &heatmap(a, &second).write(ModelFormat::Ply)),
        None => Ok(()),
    }
}

/// A mesh file, the finest meshes of a baked city, or the triangles of a city file or folder.
fn load(path: &Path) -> Result<TriangleModel, CommandError> {
    if path.join("city.json").is_file() {
        return baked_model(path);
    }
    if ModelFormat::of(path).is_some() {
        return read_model(path);
    }
    let (scene, _) = read::read(&[path.to_owned()], &ReadOptions::default(), &|_| ())
        .map_err(|error| CommandError::Bake(error.to_string()))?;
    let corners = scene.triangles.iter().flat_map(|triangle| triangle.corners);
    let positions = corners.map(|c| std::array::from_fn(|axis| scene.origin[axis] + f64::from(c[axis])));
    separate_triangles(path, positions.collect())
}

/// Every three positions are a triangle. Fails if there are more than a model may have.
fn separate_triangles(path: &Path, positions: Vec<[f64; 3]>) -> Result<TriangleModel, CommandError> {
    if positions.len() / 3 > MAX_COUNT {
        return Err(mesh_error(path, &format!("it has more than {MAX_COUNT} triangles: compare a part of it")));
    }
    let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Ok(TriangleModel { positions, triangles, layers: Vec::new() })
}

/// The finest level of detail of all leaves, in world coordinates.
fn baked_model(folder: &Path) -> Result<TriangleModel, CommandError> {
    let city = CityStore::open(folder)?;
    let manifest = city.manifest();
    let tile = |kind: TileKind, id: TileId| {
        let bytes = city.tile(kind, id).map_err(|error| mesh_error(folder, &error))?;
        bytes.ok_or_else(|| mesh_error(folder, &"a tile is missing: see `insula-server verify`"))
    };
    let decoded = |error: DecodeError| mesh_error(folder, &error);
    let (mut positions, mut roots) = (Vec::new(), vec![TileId::ROOT]);
    while let Some(root) = roots.pop() {
        let subtree = Subtree::decode(&tile(TileKind::Subtree, root)?).map_err(decoded)?;
        let is_root = |id: TileId, mask: u8| id != root && mask != 0 && Subtree::is_root(id);
        roots.extend(subtree.nodes.iter().filter(|node| is_root(node.id, node.child_mask)).map(|node| node.id));
        for leaf in subtree.meshes.iter().map(|mesh| mesh.id) {
            let Some(at) = mesh_tile::archive_id(leaf, 0) else { continue };
            let mesh = MeshTile::decode(leaf, 0, &tile(TileKind::Mesh, at)?).map_err(decoded)?.mesh;
            let side_m = manifest.root_side_m / f64::from(1u32 << leaf.level());
            let corner = [f64::from(leaf.x()) * side_m, f64::from(leaf.y()) * side_m, 0.0];
            let place = |vertex: u32| -> [f64; 3] {
                std::array::from_fn(|axis| {
                    let steps = f64::from(mesh.positions[vertex as usize][axis]);
                    manifest.origin[axis] + corner[axis] + mesh.grid.min[axis] + steps * mesh.grid.step
                })
            };
            positions.extend(mesh.triangles.iter().flatten().map(|vertex| place(*vertex)));
            if positions.len() / 3 > MAX_COUNT {
                return separate_triangles(folder, positions);
            }
        }
    }
    separate_triangles(folder, positions)
}

/// The model with its vertices coloured by their distance from `other`.
fn heatmap(mut model: TriangleModel, other: &Surface) -> TriangleModel {
    model.weld();
    let distances = other.distances(&model.positions);
    let most = distances.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let colour = |distance: &f64| {
        let at = (distance / most) as f32 * (COLOURS.len() - 1) as f32;
        let below = (at as usize).min(COLOURS.len() - 2);
        let share = at - below as f32;
        let [a, b] = [COLOURS[below], COLOURS[below + 1]];
        [0, 1, 2, 3].map(|i| if i < 3 { a[i] + (b[i] - a[i]) * share } else { 0.0 })
    };
    let values = distances.iter().map(colour).collect();
    let corners = model.triangles.as_flattened().to_vec();
    model.layers = vec![CornerLayer { kind: AttributeKind::Colour, width: 3, values, corners }];
    model
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_command_line::output::OverwriteArgs;

    #[test]
    fn meshes_cities_and_heat_maps_are_compared_and_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let off = |z: f64| format!("OFF\n4 2 0\n0 0 {z}\n10 0 {z}\n10 10 {z}\n0 10 {z}\n3 0 1 2\n3 0 2 3\n");
        std::fs::write(path("a.off"), off(0.0)).unwrap();
        std::fs::write(path("b.off"), off(2.0)).unwrap();
        let heatmap = Some(path("heat.ply"));
        run(&CompareArgs {
            a: path("a.off"),
            b: path("b.off"),
            samples: 100,
            heatmap,
            overwrite: OverwriteArgs::default(),
        })
        .unwrap();
        let heat = read_model(&path("heat.ply")).unwrap();
        assert!(heat.layers[0].values.iter().all(|c| (c[0] - 0.85).abs() < 0.01 && c[2] < 0.11), "{:?}", heat.layers);
        let other = CompareArgs {
            a: path("none"),
            b: path("b.off"),
            samples: 100,
            heatmap: None,
            overwrite: OverwriteArgs::default(),
        };
        assert!(run(&other).is_err());
    }
}
