//! `compare`: how far two surfaces lie from each other, both ways.

use super::error::CommandError;
use super::mesh::{read_model, surface_of, with_spinner};
use super::output::{check_output, print_result, write};
use crate::args::CompareArgs;
use crate::store::{CityStore, StoredCity, StoredObjects};
use insula_bake::read::{self, PlacingOptions, ReadOptions, named_paths};
use insula_command_line::output::FileKind;
use insula_export::leaves::visit_leaf_meshes;
use insula_export::table::ExportError;
use insula_protocol::mesh::AttributeKind;
use insula_simplify::model::{CornerLayer, MAX_COUNT, ModelFormat, TriangleModel};
use insula_simplify::surface::{Surface, SurfaceDistance};
use serde_json::json;
use std::path::Path;

/// Colours of a heat map from no distance to the largest, with even steps between them (0 to 1).
const COLOURS: [[f32; 3]; 5] = [[0.1, 0.2, 0.8], [0.1, 0.7, 0.9], [0.2, 0.8, 0.3], [0.95, 0.85, 0.2], [0.85, 0.1, 0.1]];

/// Runs `compare`. Fails if an input cannot be read or has no triangles, or the heat map cannot be written.
pub(super) fn run(args: &CompareArgs) -> Result<(), CommandError> {
    if let Some(heatmap) = &args.heatmap {
        let inputs = [&args.a, &args.b].into_iter().flat_map(|input| named_paths(input));
        check_output(heatmap, FileKind::PLY, inputs, args.overwrite)?;
    }
    let (a, b) = with_spinner("read", || load_both(&args.a, &args.b))?;
    check_places([&args.a, &args.b], [&a, &b])?;
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
    let text = format!(
        "{}{}Hausdorff distance {:.6}; the diagonal of {} is {diagonal:.3}\n",
        line(&args.a, &args.b, &there),
        line(&args.b, &args.a, &back),
        there.max.max(back.max),
        args.a.display()
    );
    let facts = |distance: &SurfaceDistance| {
        let SurfaceDistance { mean, rms, max, farthest } = *distance;
        json!({ "mean": mean, "rms": rms, "largest": max, "farthest": farthest })
    };
    let facts = json!({
        "a_to_b": facts(&there),
        "b_to_a": facts(&back),
        "hausdorff": there.max.max(back.max),
        "diagonal": diagonal,
    });
    print_result(args.json, &facts, &text);
    match &args.heatmap {
        Some(path) => write(path, &heatmap(a, &second).write(ModelFormat::Ply)),
        None => Ok(()),
    }
}

/// Surfaces that lie farther apart than this, in diagonals of the larger one, are not compared.
const FAR: f64 = 10.0;

/// Both models in one coordinate system: that of a baked city, else that of the first city file. Fails if two baked cities have two.
fn load_both(a: &Path, b: &Path) -> Result<(TriangleModel, TriangleModel), CommandError> {
    let baked = |path: &Path| -> Result<Option<String>, CommandError> {
        Ok(if is_baked(path) { CityStore::open(path)?.manifest().crs.clone() } else { None })
    };
    let known = match (baked(a)?, baked(b)?) {
        (Some(first), Some(second)) if first != second => {
            let what =
                format!("it is in {second}, and {} in {first}: bake one in the system of the other", a.display());
            return Err(CommandError::file(b, what));
        }
        (first, second) => first.or(second),
    };
    let (first, found) = load(a, known)?;
    Ok((first, load(b, found)?.0))
}

fn is_baked(path: &Path) -> bool {
    path.join("city.json").is_file()
}

/// A mesh file, a baked city, or the triangles of a city file or folder, in a coordinate system if that is known.
/// Returns the system for the next one, too.
fn load(path: &Path, crs: Option<String>) -> Result<(TriangleModel, Option<String>), CommandError> {
    if is_baked(path) {
        return Ok((baked_model(path)?, crs));
    }
    if ModelFormat::of(path).is_some() {
        return Ok((read_model(path)?, crs));
    }
    let placing = PlacingOptions { is_crs_found: crs.is_some(), crs: crs.clone(), ..PlacingOptions::default() };
    let options = ReadOptions { placing, ..ReadOptions::default() };
    let (scene, report) =
        read::read(&[path.to_owned()], &options, &|_| ()).map_err(|error| CommandError::Bake(error.to_string()))?;
    let corners = scene.triangles.iter().flat_map(|triangle| triangle.corners);
    let positions = corners.map(|c| std::array::from_fn(|axis| scene.origin[axis] + f64::from(c[axis])));
    Ok((separate_triangles(path, positions.collect())?, crs.or(report.crs)))
}

/// Fails if two models are so far from each other that they are hardly of one place.
fn check_places(paths: [&Path; 2], models: [&TriangleModel; 2]) -> Result<(), CommandError> {
    let boxes = models.map(|model| {
        let nothing = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        model.positions.iter().fold(nothing, |[low, high], point| {
            [0, 1].map(|end| {
                [0, 1, 2].map(|axis| if end == 0 { low[axis].min(point[axis]) } else { high[axis].max(point[axis]) })
            })
        })
    });
    let length = |v: [f64; 3]| v.iter().map(|part| part * part).sum::<f64>().sqrt();
    let diagonals = boxes.map(|[low, high]| length([0, 1, 2].map(|axis| high[axis] - low[axis])));
    let [a, b] = boxes;
    let gap = length([0, 1, 2].map(|axis| (b[0][axis] - a[1][axis]).max(a[0][axis] - b[1][axis]).max(0.0)));
    if gap.is_finite() && gap > FAR * diagonals[0].max(diagonals[1]) {
        let place = |[low, _]: [[f64; 3]; 2]| low.map(|number| format!("{number:.0}")).join(", ");
        let [first, second] = [place(a), place(b)];
        let what = format!(
            "it begins at {second}, and {} at {first}, {gap:.0} away: give both in one place and coordinate system",
            paths[0].display()
        );
        return Err(CommandError::file(paths[1], what));
    }
    Ok(())
}

/// Every three positions are a triangle. Fails if there are more than a model may have.
fn separate_triangles(path: &Path, positions: Vec<[f64; 3]>) -> Result<TriangleModel, CommandError> {
    if positions.len() / 3 > MAX_COUNT {
        return Err(CommandError::file(path, format!("it has more than {MAX_COUNT} triangles: compare a part of it")));
    }
    let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Ok(TriangleModel { positions, triangles, layers: Vec::new() })
}

/// The finest level of detail of all leaves, and the columns of nodes without a mesh, in world coordinates.
fn baked_model(folder: &Path) -> Result<TriangleModel, CommandError> {
    let city = CityStore::open(folder)?;
    let objects = StoredObjects::open(&city)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::new(city.manifest(), objects.schema(), &read);
    // Not the land around it, of which no other surface has as much.
    let area = city.manifest().bounds.map(|[x, y, _]| [x, y]);
    let mut positions = Vec::new();
    let visited = visit_leaf_meshes(&source, area, 0.0, &mut |leaf| {
        let place = |vertex: &u32| leaf.positions[*vertex as usize];
        positions.extend(leaf.tile.mesh.triangles.iter().flatten().map(place));
        // `None` is not an error of the city.
        if positions.len() / 3 > MAX_COUNT { Err(None::<ExportError>) } else { Ok(()) }
    });
    match visited {
        Err(Some(error)) => Err(CommandError::file(folder, error)),
        Ok(()) | Err(None) => separate_triangles(folder, positions),
    }
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
    use insula_bake::BakeOptions;

    #[test]
    fn meshes_cities_and_heat_maps_are_compared_and_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let off = |z: f64| format!("OFF\n4 2 0\n0 0 {z}\n10 0 {z}\n10 10 {z}\n0 10 {z}\n3 0 1 2\n3 0 2 3\n");
        std::fs::write(path("a.off"), off(0.0)).unwrap();
        std::fs::write(path("b.off"), off(2.0)).unwrap();
        let compare = |a: &str, b: &str, samples: usize, heatmap: Option<&str>| {
            let ([a, b], heatmap) = ([a, b].map(path), heatmap.map(path));
            let (json, overwrite) = Default::default();
            run(&CompareArgs { a, b, samples, heatmap, json, overwrite })
        };
        compare("a.off", "b.off", 100, Some("heat.ply")).unwrap();
        let heat = read_model(&path("heat.ply")).unwrap();
        assert!(heat.layers[0].values.iter().all(|c| (c[0] - 0.85).abs() < 0.01 && c[2] < 0.11), "{:?}", heat.layers);
        std::fs::write(path("far.off"), off(2e6)).unwrap();
        let geojson = |name: &str, crs: &str, [x, y]: [f64; 2]| {
            let ring =
                format!("[[{x}, {y}], [{}, {y}], [{}, {}], [{x}, {}], [{x}, {y}]]", x + 9.0, x + 9.0, y + 9.0, y + 9.0);
            let text = format!(
                r#"{{"type": "FeatureCollection", "crs": {{"type": "name", "properties": {{"name": "{crs}"}}}}, "features": [{{"type": "Feature",
                "properties": {{"height": 9}}, "geometry": {{"type": "Polygon", "coordinates": [{ring}]}}}}]}}"#
            );
            std::fs::write(path(name), text).unwrap();
        };
        geojson("utm.geojson", "EPSG:25832", [691_000.0, 5_334_000.0]);
        geojson("gk.geojson", "EPSG:31468", [4_468_000.0, 5_334_000.0]);
        let error = compare("a.off", "far.off", 10, None).unwrap_err().to_string();
        assert!(error.contains("far.off") && error.contains("2000000 away"), "{error}");
        let models = load_both(&path("utm.geojson"), &path("gk.geojson")).unwrap();
        let [a, b] = [models.0, models.1].map(|model| model.positions[0]);
        assert!((a[0] - b[0]).abs() < 1000.0 && (a[1] - b[1]).abs() < 5000.0, "{a:?} {b:?}");
        assert!(compare("none", "b.off", 100, None).is_err());
    }

    #[test]
    fn a_city_without_meshes_has_the_surface_of_its_columns() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let house = "OFF\n8 6 0\n0 0 0\n12 0 0\n12 9 0\n0 9 0\n0 0 7\n12 0 7\n12 9 7\n0 9 7\n4 3 2 1 0\n4 4 5 6 7\n\
            4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";
        std::fs::write(path("house.off"), house).unwrap();
        let bake = |name: &str, meshes: bool| {
            let (inputs, out) = (vec![path("house.off")], path(name));
            let options = BakeOptions { inputs, out, cell_m: 1.0, meshes, ..BakeOptions::default() };
            insula_bake::bake(&options, &insula_bake::Silent).unwrap();
        };
        bake("meshes", true);
        bake("columns", false);
        let largest = |name: &str| {
            let (source, city) = load_both(&path("house.off"), &path(name)).unwrap();
            let [source, city] = [source, city].map(|model| Surface::of_model(&model).unwrap());
            [source.compare(&city, 1000).max, city.compare(&source, 1000).max]
        };
        let (meshes, columns) = (largest("meshes"), largest("columns"));
        // Walls of boxes stand on borders of cells, and have no floor. The generated ground is no surface of the source.
        assert!(meshes.iter().all(|distance| *distance < 0.02), "{meshes:?}");
        assert!(columns.iter().all(|distance| *distance < 6.0), "{columns:?}");
        assert!(columns[1] > 0.0 && columns[1] < 1.0, "{columns:?}");
    }
}
