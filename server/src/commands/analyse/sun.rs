//! Hours of sun by a rule: of a whole city, and at the points of a table.

use super::super::error::CommandError;
use super::super::output::{print_result, write};
use super::files::summary;
use super::proposal::AfterProposal;
use super::site_of;
use crate::analysis::answer::{Answer, Progress, notes_of};
use crate::analysis::evidence::{GROUND_M, credit, png};
use crate::args::{AnalyseArgs, Analysis};
use insula_analysis::buildings::PlaceValues;
use insula_analysis::evidence::Evidence;
use insula_analysis::points::{Point, PointHeight, PointSun, around, parse_points, sun_at_points, write_table};
use insula_analysis::rays::CityTriangles;
use insula_analysis::rule::Rule;
use insula_analysis::sun::Site;
use insula_analysis::surface::CitySurface;
use insula_archive::file::read_text;
use insula_bake::read::EarthPlace;
use insula_export::source::ExportSource;
use insula_export::table::ExportError;
use insula_protocol::text::{count, printable};
use serde_json::json;
use std::path::Path;

/// How far around points the ground is read with a proposal, which may remove buildings around the points.
const CLEARED_GROUND_M: f64 = 100.0;
const MAX_POINTS_BYTES: u64 = 256 << 20;
/// Most pictures of one run: each takes a second.
const MAX_PICTURES: usize = 1000;
const MAX_RULE_BYTES: u64 = 1 << 20;

pub(super) fn sun(
    args: &AnalyseArgs,
    surface: &mut CitySurface,
    site: &Site,
    progress: Progress<'_>,
) -> Result<Answer, CommandError> {
    Ok(Answer::of_sun(surface, site, rule(args)?, progress))
}

/// The rule of `--rule`. Fails if there is none of its name, and no such file.
pub(super) fn rule(args: &AnalyseArgs) -> Result<Rule, CommandError> {
    let names = || Rule::names().collect::<Vec<_>>().join(", ");
    let text = args
        .rule
        .as_deref()
        .ok_or_else(|| CommandError::Usage(format!("sun needs --rule: {}, or a TOML file", names())))?;
    let mut rule = match Rule::built_in(text) {
        Some(rule) => rule,
        None => read_rule(Path::new(text))
            .map_err(|reason| CommandError::Usage(format!("--rule {text}: {reason}; built in are {}", names())))?,
    };
    if !args.wall_heights.is_empty() {
        rule.wall_heights_m.clone_from(&args.wall_heights);
    }
    Ok(rule)
}

/// The points of a table. Fails with what is wrong with it.
pub(super) fn read_points(option: &str, path: &Path, place: Option<&EarthPlace>) -> Result<Vec<Point>, CommandError> {
    let wrong = |reason: String| CommandError::Usage(format!("{option} {}: {reason}", path.display()));
    let text = read_text(path, MAX_POINTS_BYTES).map_err(|error| wrong(error.to_string()))?;
    parse_points(&text, &|degrees| place?.on_map(degrees)).map_err(wrong)
}

/// The triangles of an area, and the ground around points if one of them needs it (a surface of the whole city takes long), in the city or in
/// that after a proposal.
pub(super) fn city_at(
    source: &dyn ExportSource,
    points: &[Point],
    area: [[f64; 2]; 2],
    after: Option<&AfterProposal<'_>>,
) -> Result<(CityTriangles, Option<CitySurface>), ExportError> {
    let city = CityTriangles::read(source, area)?;
    let needs_ground = points.iter().any(|point| matches!(point.height, PointHeight::AboveTop(_)));
    let ground_m = if after.is_some() { CLEARED_GROUND_M } else { GROUND_M };
    let ground = needs_ground.then(|| CitySurface::read(source, Some(around(points, ground_m)))).transpose()?;
    Ok(match after {
        Some(after) => (after.triangles(city), ground.map(|ground| after.ground(&ground))),
        None => (city, ground),
    })
}

/// Writes a picture of each point that has a place, and returns how many. Fails if one cannot be written.
fn write_pictures(
    evidence: &Evidence<'_>,
    points: &[Point],
    suns: &[Option<PointSun>],
    folder: &Path,
) -> Result<usize, CommandError> {
    std::fs::create_dir_all(folder).map_err(|error| CommandError::write(folder, error))?;
    let mut number = 0;
    for (i, (point, sun)) in points.iter().zip(suns).enumerate() {
        let Some(sun) = sun else { continue };
        let path = folder.join(picture_name(i + 1, &point.id));
        let bytes = png(&evidence.picture(point, sun)).map_err(|error| CommandError::write(&path, error))?;
        write(&path, &bytes)?;
        number += 1;
    }
    Ok(number)
}

/// Name of a picture by the number of its point, with what of its identifier is good in a name.
fn picture_name(number: usize, id: &str) -> String {
    let good = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
    let id: String = id.chars().map(good).take(40).collect();
    format!("{number:04}-{id}.png")
}

/// Hours of sun at the points of a table, in the city or in that after a proposal.
pub(super) fn sun_at(
    args: &AnalyseArgs,
    path: &Path,
    source: &dyn ExportSource,
    place: Option<&EarthPlace>,
    after: Option<&AfterProposal<'_>>,
) -> Result<(), CommandError> {
    let rule = rule(args)?;
    let points = read_points("--points", path, place)?;
    if args.evidence.is_some() && points.len() > MAX_PICTURES {
        let reason = format!("--evidence: {} points, of which {MAX_PICTURES} fit in one run", points.len());
        return Err(CommandError::Usage(reason));
    }
    let site = site_of(source)?;
    let found = city_at(source, &points, around(&points, args.reach), after);
    let (city, ground) = found.map_err(|error| CommandError::file(&args.city, error))?;
    let suns = sun_at_points(&city, ground.as_ref(), &points, &site, &rule);
    let mut bytes = Vec::new();
    write_table(&points, &suns, &rule, &mut bytes).map_err(|error| CommandError::write(&args.out, error))?;
    write(&args.out, &bytes)?;
    let mut lines = vec![format!("wrote {} ({})", args.out.display(), count(points.len() as u64, "point"))];
    if let Some(folder) = &args.evidence {
        let credit = credit(source);
        let note = after.map(|after| format!("planned state: {}", after.note()));
        let evidence = Evidence { city: &city, site: &site, rule: &rule, note, credit };
        let number = write_pictures(&evidence, &points, &suns, folder)?;
        lines.push(format!("wrote {} to {}", count(number as u64, "picture"), folder.display()));
    }
    let mut notes = notes_of(&rule);
    notes.extend(after.map(AfterProposal::note));
    lines.extend(notes.iter().cloned());
    let beyond = suns.iter().filter(|sun| sun.is_none()).count();
    if beyond > 0 {
        lines.push(format!(
            "{} without a surface to measure the height from: beyond the city?",
            count(beyond as u64, "point")
        ));
    }
    let mut values = PlaceValues::default();
    suns.iter().flatten().for_each(|sun| values.add(sun.value as f32, rule.asked));
    lines.extend(summary(Analysis::Sun, rule.measure.unit(), &values, rule.asked));
    let facts = json!({
        "out": args.out.display().to_string(),
        "points": points.len(),
        "points_without_value": beyond,
        "mean": values.mean(),
        "asked": rule.asked,
        "share_reaching": rule.asked.and_then(|_| values.share()),
        "notes": notes,
    });
    print_result(args.json, &facts, &lines.iter().map(|line| format!("{}\n", printable(line))).collect::<String>());
    Ok(())
}

fn read_rule(path: &Path) -> Result<Rule, String> {
    let text = read_text(path, MAX_RULE_BYTES).map_err(|error| error.to_string())?;
    Rule::parse(&text).map_err(|error| error.to_string())
}
