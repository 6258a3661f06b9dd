//! The proposals of a city as its page reads them.

use super::{Proposal, ProposalError};
use insula_bake::read::EarthPlace;
use insula_export::source::ExportSource;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// Most triangles that the proposals of a city add together: their document is in a page's memory.
const MOST_TRIANGLES: usize = 1 << 18;

/// The proposals in a folder, `NAME.toml` each, as JSON; and why others are left out. There are none without a folder.
pub(crate) fn document(folder: Option<&Path>, source: &dyn ExportSource) -> (String, Vec<String>) {
    let found = folder.map_or(Ok(Vec::new()), |folder| {
        files_in(folder).map_err(|error| format!("{}: proposals cannot be read: {error}", folder.display()))
    });
    let (files, mut faults) = match found {
        Ok(files) => (files, Vec::new()),
        Err(fault) => (Vec::new(), vec![fault]),
    };
    let place = source.manifest().crs.as_deref().and_then(EarthPlace::of);
    let (mut all, mut left) = (Vec::new(), MOST_TRIANGLES);
    for file in files {
        match entry(&file, source, place.as_ref(), &mut left) {
            Ok(entry) => all.push(entry),
            Err(error) => faults.push(error.to_string()),
        }
    }
    (json!({ "proposals": all }).to_string(), faults)
}

fn files_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        files.extend(path.extension().is_some_and(|end| end == "toml").then_some(path));
    }
    files.sort();
    Ok(files)
}

/// A proposal: its title, the numbers of the objects that it hides, and the triangles that it adds, in centimetres from an origin in world
/// metres. Fails if it cannot be used in this city, or has more triangles than are left.
fn entry(
    file: &Path,
    source: &dyn ExportSource,
    place: Option<&EarthPlace>,
    left: &mut usize,
) -> Result<Value, ProposalError> {
    let proposal = Proposal::read(file)?;
    let objects = proposal.change(source, place)?.objects(&proposal, source)?;
    let triangles: usize = objects.added.iter().map(|object| object.triangles.len()).sum();
    *left = left.checked_sub(triangles).ok_or_else(|| {
        proposal.wrong(&format!("the city's proposals add more than {MOST_TRIANGLES} triangles: simplify their models"))
    })?;
    let added: Vec<Value> = objects.added.iter().map(|object| model(&object.name, &object.triangles)).collect();
    let name = file.file_stem().unwrap_or_default().to_string_lossy();
    Ok(json!({ "name": name, "title": proposal.name(), "hidden": objects.removed, "added": added }))
}

/// The name and the triangles of a model or a block.
fn model(name: &str, triangles: &[[[f64; 3]; 3]]) -> Value {
    let lowest = |axis: usize| triangles.iter().flatten().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
    let origin: [f64; 3] = std::array::from_fn(|axis| lowest(axis).floor());
    let centimetres = |corner: &[f64; 3]| -> [i64; 3] {
        std::array::from_fn(|axis| ((corner[axis] - origin[axis]) * 100.0).round() as i64)
    };
    let corners: Vec<i64> = triangles.iter().flatten().flat_map(centimetres).collect();
    json!({ "name": name, "origin": origin, "triangles_cm": corners })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_are_whole_numbers_from_an_origin() {
        let triangle = [[85_000.25, 447_000.5, -1.5], [85_001.25, 447_000.5, -1.5], [85_000.25, 447_002.5, 3.0]];
        let corners = [25, 50, 50, 125, 50, 50, 25, 250, 500];
        let expected = json!({ "name": "hut", "origin": [85_000.0, 447_000.0, -2.0], "triangles_cm": corners });
        assert_eq!(model("hut", &[triangle]), expected);
    }
}
