//! What `analyse` writes, and what it says of it.

use super::super::error::CommandError;
use super::super::output::{self, print_result};
use super::checks::{is_flatgeobuf, is_geojson};
use super::{Files, Question, sheet};
use crate::analysis::answer::Answer;
use crate::analysis::regions::{areas, lon_lat};
use crate::args::Analysis;
use insula_analysis::buildings::{
    BuildingValues, CityValues, Columns, PlaceValues, added_values, ground_within, sum_up, write_table,
};
use insula_analysis::surface::CitySurface;
use insula_bake::read::EarthPlace;
use insula_export::file::export_values;
use insula_export::format::{Format, Projections};
use insula_export::raster::{CellExtent, NODATA, write_raster};
use insula_export::table::ExportError;
use insula_protocol::text::{count, fixed, human_bytes, printable};
use serde_json::json;
use std::path::Path;

/// Writes an answer and says what it is. Fails if a file cannot be written.
pub(super) fn write(
    question: &Question,
    surface: &CitySurface,
    answer: Answer,
    files: &Files,
) -> Result<(), CommandError> {
    let answer = answer.within(surface, question.extent);
    let out = &files.out;
    let written = match is_geojson(out) {
        true => write_polygons(question, &answer, surface, out)?,
        false => write_cells(question, &answer, surface, out)?,
    };
    if let Some(path) = &files.pdf {
        sheet::write(question, &answer, surface, path)?;
    }
    if let Some(table) = &answer.table {
        let path = question.args.buildings.as_ref();
        path.map_or(Ok(()), |path| output::write(path, table))?;
        report(question, &answer, None, &[], &written, files);
        return Ok(());
    }
    let values = sum_up(surface, &answer.tops, &answer.points, &answer.walls, answer.asked);
    if let Some(path) = &question.args.buildings {
        write_buildings(question, &values, &answer, path)?;
    }
    let of_garden = |garden| ground_within(surface, &answer.tops, garden, answer.asked);
    let gardens: Vec<PlaceValues> = question.gardens.iter().map(of_garden).collect();
    report(question, &answer, Some(&values), &gardens, &written, files);
    Ok(())
}

/// Says what was written and what it says: several times of shadow as a line of JSON each.
pub(super) fn report(
    question: &Question,
    answer: &Answer,
    values: Option<&CityValues<'_>>,
    gardens: &[PlaceValues],
    written: &Written,
    files: &Files,
) {
    let facts = json!({
        "out": files.out.display().to_string(),
        "bytes": written.bytes,
        "title": answer.title,
        "unit": answer.column,
        "asked": answer.asked,
        "notes": answer.notes,
        "roofs": values.map(|values| answer.numbers(&values.roofs)),
        "walls": values.map(|values| answer.numbers(&values.walls)),
        "ground": values.map(|values| answer.numbers(&values.ground)),
        "gardens": gardens.iter().map(|values| answer.numbers(values)).collect::<Vec<_>>(),
        "attribution": written.attribution,
    });
    print_result(question.args.json, &facts, &text(question, answer, (values, gardens), written, files));
}

/// Writes a table of buildings, as FlatGeobuf with their footprints if its name says so. Fails if it cannot be written.
pub(super) fn write_buildings(
    question: &Question,
    values: &CityValues<'_>,
    answer: &Answer,
    path: &Path,
) -> Result<(), CommandError> {
    let columns = Columns { what: answer.column, has_asked: answer.asked.is_some(), total: answer.total };
    if is_flatgeobuf(path) {
        let projections = Projections { epsg: question.place.and_then(EarthPlace::epsg), ..Projections::default() };
        let added = added_values(values, columns);
        return export_values(question.source, Format::FlatGeobuf, &added, &projections, path)
            .map(|report| report.warnings.iter().for_each(|warning| eprintln!("note: {}", printable(warning))))
            .map_err(|error| CommandError::file(path, error));
    }
    let mut bytes = Vec::new();
    write_table(values, columns, &mut bytes).map_err(|error| CommandError::write(path, error))?;
    output::write(path, &bytes)
}

/// Writes the values as a raster. Fails if it cannot be written.
fn write_cells(
    question: &Question,
    answer: &Answer,
    surface: &CitySurface,
    out: &Path,
) -> Result<Written, CommandError> {
    let mut part = |part: CellExtent| {
        let cells = (0..part.len() as usize).map(|i| {
            let [x, y] = [i % part.size[0] as usize, i / part.size[0] as usize].map(|v| v as u32);
            let value = answer.tops[surface.extent.index([part.min[0] + x, part.min[1] + y])];
            if value.is_nan() { NODATA } else { value }
        });
        Ok(cells.collect())
    };
    write_raster_of(question, &answer.title, out, &mut part)
}

/// Writes a raster of the result's cells. `part` gives the values of a part, row by row from the south. Fails with the error of `part`, and if
/// the file cannot be written.
pub(super) fn write_raster_of(
    question: &Question,
    title: &str,
    out: &Path,
    part: &mut dyn FnMut(CellExtent) -> Result<Vec<f32>, ExportError>,
) -> Result<Written, CommandError> {
    let source = question.source;
    let projections = Projections { epsg: question.place.and_then(EarthPlace::epsg), ..Projections::default() };
    let title = format!("{}: {title}", source.manifest().title);
    let report = write_raster(source, question.extent, &projections, None, &title, out, part)
        .map_err(|error| CommandError::file(out, error))?;
    report.warnings.iter().for_each(|warning| eprintln!("note: {}", printable(warning)));
    Ok(Written { bytes: report.bytes, attribution: report.attribution })
}

/// Writes the areas of an answer as polygons in degrees (RFC 7946). Fails if it is not known where the city lies, or if the file
/// cannot be written.
fn write_polygons(
    question: &Question,
    answer: &Answer,
    surface: &CitySurface,
    out: &Path,
) -> Result<Written, CommandError> {
    let unknown = "it is not known where on Earth this city lies: write a .tif";
    let place = question.place.ok_or_else(|| CommandError::Usage(unknown.to_owned()))?;
    let features = areas(answer, surface, &|at| lon_lat(place, at));
    let features = features.ok_or_else(|| CommandError::Usage(unknown.to_owned()))?;
    let attribution = insula_export::table::attribution(question.source.manifest());
    let collection = serde_json::json!({
        "type": "FeatureCollection",
        "attribution": attribution,
        "features": features,
    });
    let bytes = collection.to_string().into_bytes();
    output::write(out, &bytes)?;
    Ok(Written { bytes: bytes.len() as u64, attribution })
}

/// A file that was written.
pub(super) struct Written {
    bytes: u64,
    attribution: String,
}

/// What was written and what it says.
fn text(
    question: &Question,
    answer: &Answer,
    (values, gardens): (Option<&CityValues<'_>>, &[PlaceValues]),
    written: &Written,
    files: &Files,
) -> String {
    let (args, attribution) = (question.args, &written.attribution);
    let mut lines = vec![format!("wrote {} ({})", files.out.display(), human_bytes(written.bytes))];
    if let Some(path) = &args.buildings {
        let has_values = |row: &&BuildingValues| row.roof.count + row.walls.count > 0;
        let number = values.map(|values| values.buildings.iter().filter(has_values).count() as u64);
        let number = number.map(|number| format!(" ({})", count(number, "building"))).unwrap_or_default();
        lines.push(format!("wrote {}{number}", path.display()));
    }
    lines.extend(files.pdf.iter().map(|path| format!("wrote {}", path.display())));
    lines.extend(answer.notes.iter().map(|note| printable(note).to_string()));
    let parts = values.map(|city| [("roofs", &city.roofs), ("walls", &city.walls), ("ground", &city.ground)]);
    let parts = parts.into_iter().flatten().map(|(name, part)| (name.to_owned(), part));
    let gardens = (1..).zip(gardens).map(|(number, values)| (format!("garden {number}"), values));
    for (name, part) in parts.chain(gardens) {
        lines.extend(match answer.is_change {
            true => change_summary(args.what, answer.column, &name, part),
            false => summary(args.what, answer.column, part, answer.asked).map(|summary| format!("{name}: {summary}")),
        });
    }
    if !attribution.is_empty() {
        lines.push(format!("name the source wherever this is shown: {}", printable(attribution)));
    }
    lines.iter().map(|line| format!("{line}\n")).collect()
}

/// The values of one kind of place in words; `None` without a value.
pub(super) fn summary(what: Analysis, unit: &str, values: &PlaceValues, asked: Option<f64>) -> Option<String> {
    let mean = values.mean()?;
    let percent = |share: f64| fixed(share * 100.0, 1) + "%";
    let [low, high] = [values.least, values.most].map(f64::from);
    let range = |decimals| [mean, low, high].map(|value| fixed(value, decimals));
    Some(match what {
        Analysis::Sun => {
            let [sign, what] = if unit == "percent" { ["%", "probable sunlight"] } else { [" h", "sun"] };
            let [mean, low, high] = range(2);
            let text = format!("{mean}{sign} of {what} on average, {low} to {high}");
            let reaching = asked.zip(values.share());
            let reaching =
                reaching.map(|(asked, share)| format!("; {} reach the {asked}{sign} asked for", percent(share)));
            text + &reaching.unwrap_or_default()
        }
        Analysis::Sky => {
            let [mean, low, high] = range(3);
            format!("{mean} on average, {low} to {high}")
        }
        Analysis::Solar => {
            let [mean, low, high] = range(0);
            format!("{mean} kWh/m2 a year on average, {low} to {high}")
        }
        Analysis::Shadow => format!("{} in shadow", percent(mean)),
        Analysis::View => format!("{} seen", percent(mean)),
    })
}

/// The changes of one kind of place in words; `None` without a value.
fn change_summary(what: Analysis, unit: &str, name: &str, values: &PlaceValues) -> Option<String> {
    let what_is = match what {
        Analysis::Shadow => "in shadow",
        Analysis::View => "visible",
        _ => return summary(what, unit, values, None).map(|summary| format!("{name}: change {summary}")),
    };
    let percent = fixed(values.mean()?.abs() * 100.0, 1);
    Some(match values.mean()? {
        _ if percent == "0.0" => format!("as much of the {name} {what_is} as before"),
        mean if mean < 0.0 => format!("{percent}% less of the {name} {what_is}"),
        _ => format!("{percent}% more of the {name} {what_is}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_more_or_less() {
        let words = |what, changes: &[f32]| {
            let mut values = PlaceValues::default();
            changes.iter().for_each(|change| values.add(*change, None));
            change_summary(what, "h", "ground", &values)
        };
        let some = |text: &str| Some(text.to_owned());
        assert_eq!(words(Analysis::Shadow, &[-1.0, 0.0, 0.0, 0.0]), some("25.0% less of the ground in shadow"));
        assert_eq!(words(Analysis::View, &[1.0, 0.0]), some("50.0% more of the ground visible"));
        assert_eq!(words(Analysis::Shadow, &[1.0, -1.0]), some("as much of the ground in shadow as before"));
        assert_eq!(words(Analysis::View, &[]), None);
        let of_sun = some("ground: change -0.50 h of sun on average, -1.00 to 0.00");
        assert_eq!(words(Analysis::Sun, &[-1.0, 0.0]), of_sun);
    }
}
