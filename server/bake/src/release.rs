//! A bake of a city as it is on another day: it shares tiles with the city of an earlier one.

use crate::error::BakeError;
use crate::scene::grid::CityGrid;
use insula_archive::city::read_manifest;
use insula_archive::places::{canonical, has_manifest};
use insula_protocol::release::{MAX_SHARED, SharedCity, is_date};
use insula_protocol::{Manifest, NODE_CELLS};
use std::path::{Path, PathBuf};

/// At most so many folders beside a city are looked at.
const MAX_FOLDERS: usize = 10_000;

/// The city with which a bake shares tiles.
#[derive(Debug, Clone)]
pub(crate) struct BaseCity {
    /// The folder in which the folders of both are.
    pub(crate) beside: PathBuf,
    pub(crate) manifest: Manifest,
}

impl BaseCity {
    /// The city in a folder, for a new one of this day in `out`; `None` without a folder. Fails if the date is none, or if the city cannot
    /// have tiles of the new one.
    pub(crate) fn of(folder: Option<&Path>, date: Option<&str>, out: &Path) -> Result<Option<Self>, BakeError> {
        if let Some(value) = date.filter(|date| !is_date(date)) {
            let advice = "give a day as in 2024-01-31".to_owned();
            return Err(BakeError::Option { option: "--date", value: value.to_owned(), advice });
        }
        let Some(folder) = folder else { return Ok(None) };
        let refuse = |advice: String| {
            Err(BakeError::Option { option: "--version-of", value: folder.display().to_string(), advice })
        };
        if date.is_none() {
            return refuse("give the day of the new version with --date".to_owned());
        }
        let manifest = match read_manifest(folder) {
            Ok(manifest) => manifest,
            Err(error) => return refuse(error.to_string()),
        };
        let (found, out) = (canonical(folder), canonical(out));
        if found == out {
            return refuse("it would be replaced; give another --out beside it".to_owned());
        }
        if found.file_name().is_none_or(|name| name != manifest.name.as_str()) {
            return refuse(format!("the name of its folder is not its own; rename the folder to {}", manifest.name));
        }
        let Some(beside) = found.parent().filter(|parent| out.parent() == Some(*parent)) else {
            return refuse("the new version finds its tiles beside it; give an --out in the same folder".to_owned());
        };
        if manifest.marks.is_none() {
            return refuse("it was baked by an earlier program; bake it again".to_owned());
        }
        if manifest.shared().len() >= MAX_SHARED {
            return refuse(format!("it shares tiles with {MAX_SHARED} others already; give an earlier version"));
        }
        Ok(Some(Self { beside: beside.to_owned(), manifest }))
    }

    /// The cities in which the tiles of a later version are.
    pub(crate) fn shared(&self) -> Vec<SharedCity> {
        let Manifest { name, version, .. } = &self.manifest;
        let nearest = SharedCity { name: name.clone(), version: version.clone() };
        std::iter::once(nearest).chain(self.manifest.shared().iter().cloned()).collect()
    }

    /// Place to which the coordinates of its bake were relative. Of a city without a date it follows from its bounds, as that
    /// of a new city does.
    pub(crate) fn origin(&self) -> [f64; 3] {
        let [low, high] = self.manifest.bounds;
        let middle = |axis: usize| ((low[axis] + high[axis]) / 2.0).floor();
        let known = self.manifest.release.as_ref().map(|release| release.bake_origin);
        known.unwrap_or_else(|| [middle(0), middle(1), low[2].floor()])
    }

    /// Its grid, for a scene with this origin and these bounds; `None` if it does not cover them.
    pub(crate) fn grid(&self, origin: [f64; 3], [min, max]: [[f64; 3]; 2]) -> Option<CityGrid> {
        let Manifest { origin: corner, depth, cell_m, .. } = self.manifest;
        let leaf_m = cell_m * NODE_CELLS as f64;
        // To the last bit as `CityGrid::covering` has it, because the fingerprints of blocks have these bits.
        let on_lattice = |value: f64, step: f64| (value / step).round() * step;
        let place = |axis: usize| on_lattice(corner[axis], leaf_m) - origin[axis];
        let corner = [place(0), place(1), on_lattice(corner[2] + cell_m, cell_m) - origin[2] - cell_m];
        let grid = CityGrid { corner, depth, cell_m };
        let side_m = grid.node_side_m(0);
        let is_covered = |axis: usize| corner[axis] <= min[axis] && max[axis] < corner[axis] + side_m;
        (is_covered(0) && is_covered(1) && corner[2] <= min[2]).then_some(grid)
    }
}

/// Fails if a city beside the folder has tiles in it, which it would lose with the city there.
pub(crate) fn check_not_shared(out: &Path) -> Result<(), BakeError> {
    let folder = canonical(out);
    if !has_manifest(&folder) {
        return Ok(());
    }
    let Some((beside, name)) = folder.parent().zip(folder.file_name()) else { return Ok(()) };
    let entries = std::fs::read_dir(beside).into_iter().flatten().take(MAX_FOLDERS).flatten();
    let has_tiles_here = |path: &PathBuf| {
        let manifest = if *path == folder { None } else { read_manifest(path).ok() };
        manifest.is_some_and(|manifest| manifest.shared().iter().any(|city| name == city.name.as_str()))
    };
    match entries.map(|entry| entry.path()).find(has_tiles_here) {
        None => Ok(()),
        Some(path) => {
            let advice = format!("{} shares tiles with the city there; choose another folder", path.display());
            Err(BakeError::Option { option: "--out", value: out.display().to_string(), advice })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_of_a_base_has_the_bits_of_the_grid_that_was_made_for_it() {
        for cell_m in [1.0, 0.3, 2.5, 0.07] {
            let origin = [85_123.0, 446_001.0, -3.0];
            let (min, max) = ([-700.3, -512.7, 0.4], [650.1, 480.9, 90.0]);
            let covering = CityGrid::covering(min, max, origin, cell_m).unwrap();
            let manifest = Manifest {
                origin: std::array::from_fn(|axis| origin[axis] + covering.corner[axis]),
                depth: covering.depth,
                cell_m,
                ..Manifest::default()
            };
            let base = BaseCity { beside: PathBuf::new(), manifest };
            assert_eq!(base.grid(origin, [min, max]), Some(covering), "{cell_m}");
            assert_eq!(base.grid(origin, [min, [5.0, 5.0, 700.0]]), Some(covering), "smaller and higher");
            assert_eq!(base.grid(origin, [min, [9e5, 5.0, 9.0]]), None, "wider");
            assert_eq!(base.grid(origin, [[0.0, 0.0, -90.0], max]), None, "deeper");
        }
    }
}
