//! Analyses of more cells than fit into memory: tile by tile, each with what stands around it. Finished tiles are kept beside the output until
//! it is written, so that a run that was ended goes on, and so that several machines share the work.

use super::super::error::CommandError;
use super::super::output::{self, print_result};
use super::checks::is_geojson;
use super::files::{report, write_buildings, write_raster_of};
use super::progress::AnalysisProgress;
use super::tile_file::{FinishedTile, TILE_MARK, TileRows};
use super::{Files, Question, shadow, sun};
use crate::analysis::answer::{Answer, Progress, grown};
use crate::args::Analysis;
use insula_analysis::buildings::sum_up;
use insula_analysis::clock::Moment;
use insula_analysis::gathered::{GatheredValues, TileValues};
use insula_analysis::surface::{CitySurface, MAX_CELLS};
use insula_archive::new_file::{remove_empty_folder, remove_marked};
use insula_command_line::output::Outputs;
use insula_export::raster::{CellExtent, NODATA};
use insula_export::table::ExportError;
use insula_protocol::text::count;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Smaller tiles would be work for what stands around them.
const LEAST_SIDE: u32 = 32;
/// Walls at the border of a tile belong to the cells beside it.
const BORDER_CELLS: u32 = 2;
/// What values depend on besides their inputs: raised when an analysis gives others.
const ALGORITHM: u32 = 1;

/// A result in tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct TileGrid {
    extent: CellExtent,
    /// Columns and rows.
    number: [u32; 2],
}

impl TileGrid {
    /// The tiles of an analysis of an area in world metres, or of the whole city; `None` if all of its cells fit into memory at once. Fails if
    /// an option needs all of them, or if not even small tiles fit.
    pub(super) fn of(question: &Question, area: Option<[[f64; 2]; 2]>) -> Result<Option<Self>, CommandError> {
        let (args, manifest) = (question.args, question.source.manifest());
        let most = args.cells_at_once.min(MAX_CELLS);
        let read = CellExtent::of(manifest, area.map(|area| grown(area, args.reach)));
        let read = read.map_err(|error| CommandError::file(&args.city, error))?;
        let usage = |reason: String| Err(CommandError::Usage(reason));
        if read.len() <= most || args.what == Analysis::View {
            return match args.tiles {
                Some(_) => usage("--tiles has no use: all cells fit into memory at once".to_owned()),
                None => Ok(None),
            };
        }
        if args.pdf.is_some() || args.gardens.is_some() || is_geojson(&args.out) {
            return usage(format!(
                "--pdf, --gardens and GeoJSON need all cells in memory at once, and {} are more than {most}: choose a part with --bbox",
                read.len()
            ));
        }
        let around = ((args.reach / manifest.cell_m).ceil() as u32).max(BORDER_CELLS) + 1;
        let grid = Self::new(question.extent, around, most);
        let Some(grid) = grid else {
            return usage(format!(
                "{most} cells have no room for a tile with {around} cells around it: choose a smaller --reach, or a part with --bbox"
            ));
        };
        Ok(Some(grid))
    }

    /// As few tiles as can be, none of which has more than `most` cells with `around` cells on each side; `None` if they would be too small.
    fn new(extent: CellExtent, around: u32, most: u64) -> Option<Self> {
        let side = u32::try_from(most.isqrt()).unwrap_or(u32::MAX).saturating_sub(around.saturating_mul(2));
        (side >= LEAST_SIDE).then(|| Self { extent, number: extent.size.map(|size| size.div_ceil(side)) })
    }

    /// Row by row from the south-west. All have nearly the same size.
    fn tiles(self) -> impl Iterator<Item = CellExtent> {
        let border = move |k: usize, at: u32| {
            (u64::from(self.extent.size[k]) * u64::from(at) / u64::from(self.number[k])) as u32
        };
        let tile = move |x: u32, y: u32| {
            let [first, next] = [[x, y], [x + 1, y + 1]].map(|at| [0, 1].map(|k| border(k, at[k])));
            CellExtent { min: [0, 1].map(|k| self.extent.min[k] + first[k]), size: [0, 1].map(|k| next[k] - first[k]) }
        };
        (0..self.number[1]).flat_map(move |y| (0..self.number[0]).map(move |x| tile(x, y)))
    }
}

/// A tile, and the file that it is kept in.
struct KeptTile {
    extent: CellExtent,
    path: PathBuf,
}

/// Computes an analysis tile by tile, for shadows once for each of `times`, and writes what was asked for; with `--tiles`, it only keeps the
/// tiles of that share. Fails if the city cannot be read, or a file cannot be written: finished tiles stay.
pub(super) fn run(question: &Question, grid: TileGrid, times: &[(Moment, Files)]) -> Result<(), CommandError> {
    if question.args.what != Analysis::Shadow {
        return run_one(question, grid, &Files::of(question.args), None);
    }
    times.iter().try_for_each(|(moment, files)| run_one(question, grid, files, Some(moment)))
}

fn run_one(question: &Question, grid: TileGrid, files: &Files, moment: Option<&Moment>) -> Result<(), CommandError> {
    let folder = folder_of(&files.out);
    let mut outputs = Outputs::new(question.args.overwrite);
    outputs.folder(&folder, None, has_tiles_only).map_err(CommandError::Usage)?;
    std::fs::create_dir_all(&folder).map_err(|error| CommandError::write(&folder, error))?;
    let inputs = inputs(question, moment)?;
    let kept = |extent: CellExtent| {
        let hash = blake3::hash(format!("{inputs} {extent:?}").as_bytes());
        KeptTile { extent, path: folder.join(format!("{}.tile", &hash.to_hex()[..32])) }
    };
    let tiles: Vec<KeptTile> = grid.tiles().map(kept).collect();
    let share = question.args.tiles;
    let [number, of] = share.unwrap_or([1, 1]).map(|part| part as usize);
    let own: Vec<&KeptTile> = tiles.iter().skip(number - 1).step_by(of).collect();
    let is_open = |tile: &&KeptTile| FinishedTile::read(&tile.path, tile.extent).is_none();
    let open: Vec<&KeptTile> = own.iter().copied().filter(is_open).collect();
    let (all, before) = (count(own.len() as u64, "tile"), own.len() - open.len());
    if before > 0 {
        eprintln!("note: {before} of {all} are those of an earlier run");
    }
    compute(question, &open, before, moment)?;
    if share.is_some() {
        let folder = folder.display().to_string();
        let text = format!("kept {all} in {folder}: the same command without --tiles writes the result\n");
        print_result(question.args.json, &json!({ "tiles": own.len(), "folder": folder }), &text);
        return Ok(());
    }
    write(question, &tiles, files)?;
    remove(&folder);
    Ok(())
}

/// Removes all tiles of an output that is written, also those of an earlier run with other options. What cannot be removed is no fault of
/// the result, and its name says what it is.
fn remove(folder: &Path) {
    for entry in folder.read_dir().into_iter().flatten().flatten() {
        let _ = remove_marked(&entry.path(), TILE_MARK);
    }
    let _ = remove_empty_folder(folder);
}

/// Where the tiles of an output are kept.
fn folder_of(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".tiles");
    out.with_file_name(name)
}

/// Whether a folder has what an earlier run may have written there, or one that was ended meanwhile.
fn has_tiles_only(folder: &Path) -> bool {
    let is_tile = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| {
            entry.file_name().to_str().is_some_and(|name| name.ends_with(".tile") || name.ends_with(".tmp"))
        })
    };
    folder.read_dir().is_ok_and(|mut entries| entries.all(is_tile))
}

/// All that the values of a tile depend on, besides its place.
fn inputs(question: &Question, moment: Option<&Moment>) -> Result<String, CommandError> {
    let (args, manifest) = (question.args, question.source.manifest());
    let what = match args.what {
        Analysis::Sun => format!("sun {:?}", sun::rule(args)?),
        Analysis::Solar => format!("solar {:?} {:?}", question.weather, args.turbidity),
        Analysis::Shadow => format!("shadow {moment:?}"),
        Analysis::Sky | Analysis::View => "sky".to_owned(),
    };
    let (heights, reach) = (&args.wall_heights, args.reach);
    Ok(format!("{ALGORITHM} {} {} {what} {heights:?} {reach}", manifest.name, manifest.version))
}

/// Computes and keeps tiles, of which `before` others were kept before.
fn compute(
    question: &Question,
    tiles: &[&KeptTile],
    before: usize,
    moment: Option<&Moment>,
) -> Result<(), CommandError> {
    let all = (before + tiles.len()) as f64;
    let shown = AnalysisProgress::start_from(before as f64 / all);
    for (i, tile) in tiles.iter().enumerate() {
        let progress = |share: f64| {
            shown.at(((before + i) as f64 + share) / all);
            true
        };
        let finished = compute_tile(question, tile.extent, moment, &progress)?;
        output::write(&tile.path, &finished.encode())?;
        progress(1.0);
    }
    shown.clear();
    Ok(())
}

fn compute_tile(
    question: &Question,
    tile: CellExtent,
    moment: Option<&Moment>,
    progress: Progress<'_>,
) -> Result<FinishedTile, CommandError> {
    let (args, manifest) = (question.args, question.source.manifest());
    let corner = |cell: [u32; 2]| [0, 1].map(|k| manifest.origin[k] + f64::from(cell[k]) * manifest.cell_m);
    let area = [corner(tile.min), corner([0, 1].map(|k| tile.min[k] + tile.size[k]))];
    let around = args.reach.max(f64::from(BORDER_CELLS) * manifest.cell_m);
    let surface = CitySurface::read(question.source, Some(grown(area, around)));
    let mut surface = surface.map_err(|error| CommandError::file(&args.city, error))?;
    if !indices(surface.extent, tile).any(|index| surface.is_known(index)) {
        return Ok(FinishedTile::without_values(tile.len() as usize));
    }
    let answer = match moment {
        Some(moment) => shadow::at(&surface, &question.site()?, moment)?,
        None => question.answer(&mut surface, progress)?,
    };
    let answer = answer.within(&surface, tile);
    let values = TileValues::of(&sum_up(&surface, &answer.tops, &answer.points, &answer.walls, answer.asked));
    let Answer { title, column, asked, total, notes, .. } = &answer;
    Ok(FinishedTile {
        title: title.clone(),
        column: (*column).to_owned(),
        asked: *asked,
        total: total.map(str::to_owned),
        notes: notes.clone(),
        values,
        cells: indices(surface.extent, tile).map(|index| answer.tops[index]).collect(),
    })
}

/// Indices in `all` of the cells of a part of it, row by row from the south.
fn indices(all: CellExtent, part: CellExtent) -> impl Iterator<Item = usize> {
    let columns = part.min[0]..part.min[0] + part.size[0];
    let rows = part.min[1]..part.min[1] + part.size[1];
    rows.flat_map(move |y| columns.clone().map(move |x| all.index([x, y])))
}

/// Writes what was asked for from the tiles.
fn write(question: &Question, tiles: &[KeptTile], files: &Files) -> Result<(), CommandError> {
    let args = question.args;
    let mut gathered = GatheredValues::default();
    let mut answer = Answer::default();
    for tile in tiles {
        let lost = || CommandError::file(&tile.path, "it was changed or removed meanwhile; run the command again");
        let found = FinishedTile::read(&tile.path, tile.extent).ok_or_else(lost)?;
        if found.has_no_values() {
            continue;
        }
        let columns = found.columns().ok_or_else(lost)?;
        (answer.column, answer.total) = columns;
        (answer.title, answer.asked, answer.notes) = (found.title, found.asked, found.notes);
        gathered.add(found.values, args.buildings.is_some());
    }
    let places: Vec<(CellExtent, &Path)> = tiles.iter().map(|tile| (tile.extent, tile.path.as_path())).collect();
    let mut rows = TileRows::new(&places);
    let mut part = |part: CellExtent| {
        let values = rows.part(part).map_err(|(path, source)| ExportError::Write { path, source });
        values.map(|values| values.into_iter().map(|value| if value.is_nan() { NODATA } else { value }).collect())
    };
    let written = write_raster_of(question, &answer.title, &files.out, &mut part)?;
    let city = gathered.city();
    if let Some(path) = &args.buildings {
        write_buildings(question, &city, &answer, path)?;
    }
    report(question, &answer, Some(&city), &[], &written, files);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_result_and_fit_with_what_is_around_them() {
        let extent = CellExtent { min: [7, 9], size: [1000, 333] };
        let grid = TileGrid::new(extent, 30, 40_000).unwrap();
        let tiles: Vec<CellExtent> = grid.tiles().collect();
        assert_eq!((grid.number, tiles.len()), ([8, 3], 24));
        assert_eq!(tiles.iter().map(CellExtent::len).sum::<u64>(), extent.len());
        assert!(tiles.iter().all(|tile| tile.size.map(|side| u64::from(side) + 60).iter().product::<u64>() <= 40_000));
        assert_eq!((tiles[0].min, tiles[23].min[0] + tiles[23].size[0]), ([7, 9], 1007));
        assert!(TileGrid::new(extent, 90, 40_000).is_none() && TileGrid::new(extent, u32::MAX, 40_000).is_none());
    }
}
