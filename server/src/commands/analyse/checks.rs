//! Which options of `analyse` go together.

use super::super::error::CommandError;
use super::Files;
use crate::args::{AnalyseArgs, Analysis};
use insula_command_line::output::{FileKind, Outputs};
use std::path::{Path, PathBuf};

/// Fails on options of another analysis.
pub(super) fn check_options(args: &AnalyseArgs) -> Result<(), CommandError> {
    use Analysis::{Shadow, Sky, Solar, Sun, View};
    let of = |is_given: bool, option: &str, analyses: &[Analysis]| {
        if !is_given || analyses.contains(&args.what) {
            return Ok(());
        }
        let names = analyses.iter().map(|analysis| name(*analysis)).collect::<Vec<_>>().join(" and ");
        Err(CommandError::Usage(format!("{option} is an option of {names}, not of {}", name(args.what))))
    };
    of(args.rule.is_some(), "--rule", &[Sun])?;
    if args.vista.is_none() {
        of(args.buildings.is_some(), "--buildings", &[Sun, Sky, Solar])?;
    }
    of(args.gardens.is_some(), "--gardens", &[Sun, Sky, Solar, Shadow])?;
    of(!args.wall_heights.is_empty(), "--wall-heights", &[Sun, Sky, Solar])?;
    of(args.turbidity.is_some(), "--turbidity", &[Solar])?;
    of(args.weather.is_some(), "--weather", &[Solar])?;
    of(args.points.is_some(), "--points", &[Sun])?;
    of(!args.time.is_empty(), "--time", &[Shadow])?;
    of(args.times.is_some(), "--times", &[Shadow])?;
    of(args.time_zone.is_some(), "--time-zone", &[Shadow])?;
    of(args.from.is_some(), "--from", &[View])?;
    of(args.of.is_some(), "--of", &[View])?;
    of(args.vista.is_some(), "--vista", &[View])?;
    of(!args.between.is_empty(), "--between", &[View])?;
    of(args.target_height.is_some(), "--target-height", &[View])?;
    of(is_geojson(&args.out), "a GeoJSON file", &[Shadow, View])?;
    check_name(args)?;
    let area = args.area.bbox.is_some() || args.area.bbox_metres.is_some();
    let beside_points = [
        ("--buildings", args.buildings.is_some()),
        ("--pdf", args.pdf.is_some()),
        ("--gardens", args.gardens.is_some()),
        ("--wall-heights", !args.wall_heights.is_empty()),
        ("--bbox", area),
    ];
    if args.vista.is_some() && area {
        return Err(CommandError::Usage("--bbox has no use with --vista: corridors are whole".to_owned()));
    }
    if args.vista.is_some() && args.buildings.as_deref().is_some_and(is_flatgeobuf) {
        return Err(CommandError::Usage("--buildings of --vista is a .csv".to_owned()));
    }
    let at_points = if args.points.is_some() { "--points" } else { "--between" };
    match beside_points.into_iter().find(|(_, is_given)| *is_given && has_points(args)) {
        Some((option, _)) => {
            Err(CommandError::Usage(format!("{option} has no use with {at_points}: leave one of them out")))
        }
        None => Ok(()),
    }
}

/// Whether points are asked about, and not the city's cells.
fn has_points(args: &AnalyseArgs) -> bool {
    args.points.is_some() || !args.between.is_empty()
}

/// Fails on an output whose name says something else than its content.
fn check_name(args: &AnalyseArgs) -> Result<(), CommandError> {
    let ends = |known: &[&str]| known.iter().any(|end| has_extension(&args.out, end));
    let (is_right, what) = match has_points(args) {
        true => (ends(&["csv"]), "the table of --points or --between is a .csv"),
        false => {
            (ends(&["tif", "tiff", "geojson"]), "a raster is a .tif; tables need --buildings, --points or --between")
        }
    };
    if is_right { Ok(()) } else { Err(CommandError::Usage(format!("--out {}: {what}", args.out.display()))) }
}

fn has_extension(path: &Path, end: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(end))
}

/// Whether an output is to be polygons.
pub(super) fn is_geojson(path: &Path) -> bool {
    has_extension(path, "geojson")
}

/// Whether a table is to have footprints.
pub(super) fn is_flatgeobuf(path: &Path) -> bool {
    has_extension(path, "fgb")
}

fn name(analysis: Analysis) -> &'static str {
    match analysis {
        Analysis::Sun => "sun",
        Analysis::Sky => "sky",
        Analysis::Solar => "solar",
        Analysis::Shadow => "shadow",
        Analysis::View => "view",
    }
}

/// Fails on an output that may not be written. `times` are the files of shadows, `read` those that a proposal names.
pub(super) fn check_outputs(args: &AnalyseArgs, mut times: Vec<Files>, read: Vec<PathBuf>) -> Result<(), CommandError> {
    let rule = args.rule.as_ref().map(PathBuf::from).filter(|path| path.is_file());
    let inputs = [Some(&args.city), rule.as_ref(), args.points.as_ref(), args.of.as_ref(), args.vista.as_ref()];
    let inputs = inputs.into_iter().chain([args.proposal.as_ref(), args.weather.as_ref(), args.gardens.as_ref()]);
    let inputs = inputs.flatten().chain(&args.between).chain(&read);
    let mut outputs = Outputs::new(args.overwrite).reading(inputs);
    let kind = match () {
        () if has_points(args) => FileKind::ANALYSIS_TABLE,
        () if is_geojson(&args.out) => FileKind::GEOJSON,
        () => FileKind::TIFF,
    };
    if times.is_empty() {
        times.push(Files::of(args));
    }
    if times.len() > 1 {
        args.pdf.iter().try_for_each(|path| outputs.file(path, FileKind::PDF)).map_err(CommandError::Usage)?;
    }
    for Files { out, pdf } in &times {
        outputs.file(out, kind).map_err(CommandError::Usage)?;
        pdf.iter().try_for_each(|path| outputs.file(path, FileKind::PDF)).map_err(CommandError::Usage)?;
    }
    if let Some(folder) = &args.evidence {
        outputs.folder(folder, None, has_pictures_only).map_err(CommandError::Usage)?;
    }
    let Some(path) = &args.buildings else { return Ok(()) };
    let kind = if is_flatgeobuf(path) { FileKind::FLATGEOBUF } else { FileKind::ANALYSIS_TABLE };
    outputs.file(path, kind).map_err(CommandError::Usage)
}

/// Whether a folder has what an earlier run may have written there: files such as `0001-bench.png`.
fn has_pictures_only(folder: &Path) -> bool {
    let is_name = |name: &str| {
        let number = name.split_once('-').map(|(number, _)| number).unwrap_or_default();
        number.len() >= 4 && number.bytes().all(|byte| byte.is_ascii_digit()) && name.ends_with(".png")
    };
    let is_picture = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| {
            entry.file_type().is_ok_and(|kind| kind.is_file()) && entry.file_name().to_str().is_some_and(is_name)
        })
    };
    folder.read_dir().is_ok_and(|mut entries| entries.all(is_picture))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_other_pictures_is_none_of_evidence() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str| std::fs::write(folder.path().join(name), "").unwrap();
        assert!(has_pictures_only(folder.path()));
        ["0001-bench.png", "12345-a-b.png"].into_iter().for_each(write);
        assert!(has_pictures_only(folder.path()));
        for name in ["IMG_1234.png", "1-a.png", "0001-a.jpg", "notes.txt"] {
            write(name);
            assert!(!has_pictures_only(folder.path()), "{name}");
            std::fs::remove_file(folder.path().join(name)).unwrap();
        }
    }
}
