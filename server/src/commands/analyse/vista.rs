//! Protected vistas of a GeoJSON file, and what breaks into them.

use super::super::error::CommandError;
use crate::analysis::answer::Answer;
use crate::area_file::bring_to_map;
use crate::proposal::Proposal;
use insula_analysis::surface::CitySurface;
use insula_analysis::vista::{Vista, breaches, write_table};
use insula_archive::file::read_text;
use insula_bake::read::EarthPlace;
use insula_protocol::text::count;
use serde_json::Value;
use std::path::Path;

/// Largest file of vistas.
const MAX_BYTES: u64 = 1 << 20;
const MAX_VISTAS: usize = 1000;
const MAX_NAME_BYTES: usize = 256;

/// What breaks into the vistas of a file: in a city, or in that after a proposal, which is given with the surface before it. Fails if the
/// file has none.
pub(super) fn vista(
    path: &Path,
    surface: &CitySurface,
    place: Option<&EarthPlace>,
    proposed: Option<(&Proposal, &CitySurface)>,
) -> Result<Answer, CommandError> {
    let wrong = |reason: &str| CommandError::Usage(format!("--vista {}: {reason}", path.display()));
    let text = read_text(path, MAX_BYTES).map_err(|error| wrong(&error.to_string()))?;
    let vistas = parse(&text, surface.bounds(), place).map_err(|reason| wrong(&reason))?;
    let found = breaches(surface, &vistas, proposed.map(|(_, before)| before));
    if found.tops.iter().all(|above| above.is_nan()) {
        return Err(wrong("no corridor lies in the area"));
    }
    let mut table = Vec::new();
    write_table(&found.buildings, &mut table).map_err(|error| wrong(&error.to_string()))?;
    let note = |vista: &Vista| {
        let own = || found.buildings.iter().filter(|breach| breach.vista == vista);
        let highest = own().map(|breach| format!(", by up to {:.2} m", breach.above_m)).next().unwrap_or_default();
        format!("{}: {} above the plane{highest}", vista.name, count(own().count() as u64, "building"))
    };
    let of_proposal = |proposal: &Proposal| {
        let above = match found.added_m {
            Some(above) => format!("above a plane by up to {above:.2} m"),
            None => "above no plane".to_owned(),
        };
        format!("{}: values are those after it; what it adds rises {above}", proposal.name())
    };
    let notes = vistas.iter().map(note).chain(proposed.map(|(proposal, _)| of_proposal(proposal))).collect();
    let title = "metres above the plane of the vista".to_owned();
    Ok(Answer { tops: found.tops, title, table: Some(table), area_from: 0.0, notes, ..Answer::default() })
}

/// The vistas of a feature or a collection of them, on the map of a city with these bounds.
fn parse(text: &str, city: [[f64; 2]; 2], place: Option<&EarthPlace>) -> Result<Vec<Vista>, String> {
    let json: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let features = match json.get("features").and_then(Value::as_array) {
        Some(features) => features.iter().collect(),
        None => vec![&json],
    };
    if features.is_empty() {
        return Err("no feature".to_owned());
    }
    if features.len() > MAX_VISTAS {
        return Err(format!("{} vistas, of which {MAX_VISTAS} fit in one run", features.len()));
    }
    let lines = features.iter().enumerate().map(|(i, feature)| line(feature).ok_or_else(|| wrong_feature(i)));
    let lines = lines.collect::<Result<Vec<_>, _>>()?;
    let mut places: Vec<[f64; 2]> = lines.iter().flatten().map(|[x, y, _]| [*x, *y]).collect();
    bring_to_map(&mut places.iter_mut().collect::<Vec<_>>(), city, place)?;
    let mut vistas = Vec::new();
    for (i, ((feature, line), ends)) in features.iter().zip(&lines).zip(places.chunks_exact(2)).enumerate() {
        let [viewpoint, target] = [0, 1].map(|end| [ends[end][0], ends[end][1], line[end][2]]);
        let length = (target[0] - viewpoint[0]).hypot(target[1] - viewpoint[1]);
        let width_m = width(feature, length).filter(|width| *width > 0.0 && *width <= 1e6 && length > 0.0);
        let width_m = width_m.ok_or_else(|| wrong_feature(i))?;
        let name = feature["properties"]["name"].as_str().filter(|name| name.len() <= MAX_NAME_BYTES);
        let name = name.map_or_else(|| format!("vista {}", i + 1), str::to_owned);
        vistas.push(Vista { name, viewpoint, target, width_m });
    }
    Ok(vistas)
}

fn wrong_feature(index: usize) -> String {
    format!(
        "feature {}: write a LineString of two points with heights above sea level, and width_m or angle_deg among its \
         properties",
        index + 1
    )
}

/// Viewpoint and target as the file has them.
fn line(feature: &Value) -> Option<[[f64; 3]; 2]> {
    let geometry = feature.get("geometry")?;
    let points = geometry.get("coordinates")?.as_array().filter(|_| geometry["type"] == "LineString")?;
    let point = |point: &Value| Some([0, 1, 2].map(|k| point.get(k).and_then(Value::as_f64))).and_then(all);
    let points: Option<Vec<[f64; 3]>> = points.iter().map(point).collect();
    points?.try_into().ok()
}

fn all([x, y, z]: [Option<f64>; 3]) -> Option<[f64; 3]> {
    Some([x?, y?, z?])
}

/// Width of the corridor at the target.
fn width(feature: &Value, length: f64) -> Option<f64> {
    let property = |name: &str| feature["properties"][name].as_f64();
    let of_angle = |degrees: f64| (degrees < 180.0).then(|| 2.0 * length * (0.5 * degrees).to_radians().tan());
    property("width_m").or_else(|| of_angle(property("angle_deg")?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vistas_are_lines_with_heights_and_a_width() {
        let city = [[1000.0, 2000.0], [1500.0, 2500.0]];
        let feature = |line: &str, properties: &str| {
            format!(
                r#"{{"type": "Feature", "properties": {properties}, "geometry": {{"type": "LineString", "coordinates": {line}}}}}"#
            )
        };
        let good = "[[1010, 2010, 30], [1110, 2010, 10]]";
        let found = parse(&feature(good, r#"{"name": "dome", "width_m": 40}"#), city, None).unwrap();
        let dome = Vista {
            name: "dome".into(),
            viewpoint: [1010.0, 2010.0, 30.0],
            target: [1110.0, 2010.0, 10.0],
            width_m: 40.0,
        };
        assert_eq!(found, [dome]);
        let angle = feature(good, r#"{"angle_deg": 90}"#);
        let both = format!(r#"{{"type": "FeatureCollection", "features": [{angle}, {angle}]}}"#);
        let found = parse(&both, city, None).unwrap();
        assert!(found.len() == 2 && (found[1].width_m - 200.0).abs() < 1e-9 && found[1].name == "vista 2");
        for (text, word) in [
            ("{}".to_owned(), "feature 1"),
            (r#"{"features": []}"#.to_owned(), "no feature"),
            (feature("[[1010, 2010], [1110, 2010]]", r#"{"width_m": 40}"#), "heights"),
            (feature("[[1010, 2010, 3]]", r#"{"width_m": 40}"#), "two points"),
            (feature("[[1010, 2010, 3], [1010, 2010, 9]]", r#"{"width_m": 40}"#), "two points"),
            (feature(good, "{}"), "width_m"),
            (feature(good, r#"{"width_m": -1}"#), "width_m"),
            (feature(good, r#"{"angle_deg": 180}"#), "angle_deg"),
            (feature("[[4.3, 52, 3], [4.4, 52, 9]]", r#"{"width_m": 40}"#), "not known where"),
        ] {
            let error = parse(&text, city, None).unwrap_err();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
