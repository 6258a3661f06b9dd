//! Areas of an answer as polygons of GeoJSON.

use super::answer::Answer;
use super::colors::{Colors, ValueClass, class_of};
use super::samples::Samples;
use insula_analysis::outlines::{CellPolygon, outlines};
use insula_analysis::surface::CitySurface;
use insula_bake::read::EarthPlace;
use serde_json::{Value, json};

/// Coordinates of a MultiPolygon. `place` gives those of a corner, or `None` where there are none; then the result is `None`.
fn coordinates(
    polygons: &[CellPolygon],
    place: &dyn Fn([u32; 2]) -> Option<[f64; 2]>,
) -> Option<Vec<Vec<Vec<[f64; 2]>>>> {
    let ring = |ring: &Vec<[u32; 2]>| {
        let corners = ring.iter().chain(ring.first());
        corners.map(|corner| place(*corner)).collect::<Option<Vec<_>>>()
    };
    polygons.iter().map(|rings| rings.iter().map(ring).collect::<Option<Vec<_>>>()).collect()
}

/// Longitude and latitude of a place in world metres, with decimals of a degree that are below a centimetre.
pub(crate) fn lon_lat(place: &EarthPlace, at: [f64; 2]) -> Option<[f64; 2]> {
    place.lon_lat(at).map(|degrees| degrees.map(|degrees| (degrees * 1e7).round() / 1e7))
}

/// Features of the areas whose values are above the answer's border, and for changes of those as far below 0: none of an area that is empty.
/// `place` gives the coordinates of a place in world metres; `None` if they are not known.
pub(crate) fn areas(
    answer: &Answer,
    surface: &CitySurface,
    place: &dyn Fn([f64; 2]) -> Option<[f64; 2]>,
) -> Option<Vec<Value>> {
    let corner = |corner: [u32; 2]| place([0, 1].map(|k| surface.corner[k] + f64::from(corner[k]) * surface.cell_m));
    let signs: &[i8] = if answer.is_change { &[1, -1] } else { &[1] };
    let mut features = Vec::new();
    for sign in signs {
        let is_in = answer.tops.iter().map(|value| f32::from(*sign) * value > answer.area_from);
        let coordinates = coordinates(&outlines(&is_in.collect::<Vec<bool>>(), surface.size()[0]), &corner)?;
        if coordinates.is_empty() {
            continue;
        }
        let mut properties = json!({ "title": answer.title });
        if answer.is_change {
            properties["change"] = json!(sign);
        }
        features.push(json!({
            "type": "Feature",
            "properties": properties,
            "geometry": { "type": "MultiPolygon", "coordinates": coordinates },
        }));
    }
    Some(features)
}

/// A feature for each class of values, from low to high, with its area, which may be empty. `place` gives the coordinates of a place in
/// world metres; `None` if they are not known.
pub(crate) fn features(
    answer: &Answer,
    surface: &CitySurface,
    samples: &Samples,
    colors: &Colors,
    place: &dyn Fn([f64; 2]) -> Option<[f64; 2]>,
) -> Option<Vec<Value>> {
    let [width, height] = samples.size;
    let classes = colors.classes(answer.asked);
    let squares = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    let value = |square| answer.tops[surface.extent.index(samples.cell(square))];
    let found: Vec<Option<usize>> = squares.map(|square| class_of(&classes, value(square))).collect();
    let corner = |square: [u32; 2]| place(surface.corner_of(samples.corner(square)));
    let feature = |(number, class): (usize, &ValueClass)| {
        let is_in: Vec<bool> = found.iter().map(|found| *found == Some(number)).collect();
        let coordinates = coordinates(&outlines(&is_in, width as usize), &corner)?;
        let [from, to] = [class.from, class.to].map(|border| (border * 1e6).round() / 1e6);
        let [r, g, b] = class.rgb;
        Some(json!({
            "type": "Feature",
            "id": number,
            "properties": { "from": from, "to": to, "fill": format!("#{r:02x}{g:02x}{b:02x}") },
            "geometry": { "type": "MultiPolygon", "coordinates": coordinates },
        }))
    };
    classes.iter().enumerate().map(feature).collect()
}
