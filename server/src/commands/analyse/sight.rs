//! Lines of sight between the points of two tables.

use super::super::error::CommandError;
use super::super::output::{print_result, write};
use super::proposal::AfterProposal;
use super::sun::{city_at, read_points};
use crate::args::AnalyseArgs;
use insula_analysis::points::{Point, around};
use insula_analysis::sight::{MAX_LINES, sights, write_table};
use insula_bake::read::EarthPlace;
use insula_export::source::ExportSource;
use insula_export::table::ExportError;
use insula_protocol::text::{count, printable};
use serde_json::json;
use std::path::PathBuf;

/// Writes the lines from each point of a table to each of another one, in the city or in that after a proposal. Fails if the city cannot be
/// read or the output not be written.
pub(super) fn between(
    args: &AnalyseArgs,
    tables: [&PathBuf; 2],
    source: &dyn ExportSource,
    place: Option<&EarthPlace>,
    after: Option<&AfterProposal<'_>>,
) -> Result<(), CommandError> {
    let [from, to] = tables.map(|path| read_points("--between", path, place));
    let (from, to) = (from?, to?);
    let number = from.len().saturating_mul(to.len());
    if number > MAX_LINES {
        let reason = format!("--between: {number} lines, of which {MAX_LINES} fit in one run; choose fewer points");
        return Err(CommandError::Usage(reason));
    }
    let failed = |error: ExportError| CommandError::file(&args.city, error);
    let all: Vec<Point> = from.iter().chain(&to).cloned().collect();
    let (city, ground) = city_at(source, &all, around(&all, 1.0), after).map_err(failed)?;
    let ends = |points| -> Vec<_> {
        let ends = |point| (point, Point::position(point, &city, ground.as_ref()));
        <[Point]>::iter(points).map(ends).collect()
    };
    let (from, to) = (ends(&from), ends(&to));
    let lines = sights(&city, ground.as_ref(), &from, &to);
    let mut bytes = Vec::new();
    let written = write_table(source, [&from, &to], &lines, &mut bytes).map_err(failed)?;
    written.map_err(|error| CommandError::write(&args.out, error))?;
    write(&args.out, &bytes)?;
    let free = lines.iter().flatten().filter(|line| line.obstacle.is_none()).count();
    let beyond = lines.iter().filter(|line| line.is_none()).count();
    let mut text = format!("wrote {} ({})\n", printable(&args.out.display().to_string()), count(number as u64, "line"));
    text += &format!("{free} of them are free\n");
    after.iter().for_each(|after| text += &format!("{}\n", printable(&after.note())));
    if beyond > 0 {
        let lines = count(beyond as u64, "line");
        text += &format!("{lines} with an end without a surface to measure its height from: beyond the city?\n");
    }
    let facts = json!({ "out": args.out.display().to_string(), "lines": number, "free": free, "without_end": beyond });
    print_result(args.json, &facts, &text);
    Ok(())
}
