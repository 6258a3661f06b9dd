//! Systems from well-known text: WKT1 of OGC, GDAL and Esri, and WKT2.

use super::axes::{Axes, Direction};
use super::definition::Shift;
use super::describe::{self, HorizontalDescription, VerticalDescription};
use super::method::{Meaning, Parameters, meaning};
use super::wkt::{Item, Node};
use super::{Crs, CrsError};

const GEOGRAPHIC: [&str; 8] =
    ["GEOGCS", "GEOGCRS", "GEODCRS", "GEOGRAPHICCRS", "GEODETICCRS", "BASEGEOGCRS", "BASEGEODCRS", "GEOCCS"];
const PROJECTED: [&str; 4] = ["PROJCS", "PROJCRS", "PROJECTEDCRS", "BASEPROJCRS"];
const VERTICAL: [&str; 4] = ["VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"];
const COMPOUND: [&str; 2] = ["COMPD_CS", "COMPOUNDCRS"];
const DATUM: [&str; 4] = ["DATUM", "GEODETICDATUM", "TRF", "ENSEMBLE"];
const PSEUDO_MERCATOR: &str = "Popular Visualisation Pseudo Mercator";
/// Systems without a place on Earth.
const LOCAL: [&str; 3] = ["LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"];
const UNIT: [&str; 3] = ["UNIT", "LENGTHUNIT", "ANGLEUNIT"];

/// Whether a text starts like a system in well-known text.
pub(super) fn is_wkt(text: &str) -> bool {
    let keyword = keyword(text);
    let known = [&GEOGRAPHIC[..], &PROJECTED, &VERTICAL, &COMPOUND, &LOCAL, &["BOUNDCRS"]];
    known.iter().any(|keywords| keywords.contains(&&*keyword)) && text.contains(['[', '('])
}

/// Whether a text is well-known text of a system without a place on Earth.
pub(super) fn is_local(text: &str) -> bool {
    LOCAL.contains(&&*keyword(text))
}

/// The name of a system in well-known text: its first text.
pub(super) fn name(text: &str) -> String {
    text.split('"').nth(1).unwrap_or_default().trim().to_owned()
}

/// The word with which a text starts, in capitals.
fn keyword(text: &str) -> String {
    let keyword: String = text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    keyword.to_ascii_uppercase()
}

/// Parses a system. Fails if it has no place on Earth, or its projection is not supported.
pub(super) fn parse(text: &str) -> Result<Crs, CrsError> {
    let nodes = Node::parse_all(text).ok_or(CrsError::Unknown)?;
    let mut parts = Parts::default();
    for node in &nodes {
        parts.add(node, 0);
    }
    let horizontal = parts.horizontal.ok_or(CrsError::Unknown)?;
    let mut described = horizontal_description(horizontal).ok_or(CrsError::Unknown)?;
    described.shift = described.shift.or(parts.shift);
    let vertical = parts.vertical.map(vertical_description);
    let name = nodes.first().map_or("", Node::name);
    describe::system(name, parts.code, &described, vertical.as_ref())
}

/// The parts of a compound or bound system.
#[derive(Default)]
struct Parts<'n> {
    horizontal: Option<&'n Node>,
    vertical: Option<&'n Node>,
    /// Of the compound system.
    code: Option<u32>,
    shift: Option<Shift>,
}

impl<'n> Parts<'n> {
    fn add(&mut self, node: &'n Node, depth: usize) {
        let keyword = &*node.keyword;
        if GEOGRAPHIC.contains(&keyword) || PROJECTED.contains(&keyword) {
            self.horizontal.get_or_insert(node);
        } else if VERTICAL.contains(&keyword) {
            self.vertical.get_or_insert(node);
        } else if depth < 4 && COMPOUND.contains(&keyword) {
            self.code = self.code.or(node.epsg());
            node.nodes().for_each(|part| self.add(part, depth + 1));
        } else if depth < 4 && keyword == "BOUNDCRS" {
            self.shift = self.shift.or_else(|| node.node(&["ABRIDGEDTRANSFORMATION"]).and_then(abridged_shift));
            node.nodes().for_each(|part| self.add(part, depth + 1));
        } else if depth < 4 && keyword == "SOURCECRS" {
            node.nodes().for_each(|part| self.add(part, depth + 1));
        }
    }
}

/// The shift of a bound system. Coordinate frame rotations turn the other way.
fn abridged_shift(node: &Node) -> Option<Shift> {
    let mut shift = [0.0; 7];
    for parameter in node.nodes().filter(|node| node.keyword == "PARAMETER") {
        let names = [
            "X-axis translation", "Y-axis translation", "Z-axis translation", "X-axis rotation", "Y-axis rotation",
            "Z-axis rotation", "Scale difference",
        ];
        let index = names.iter().position(|name| name.eq_ignore_ascii_case(parameter.name()))?;
        shift[index] = parameter.number(1)?;
        if index == 6 && (shift[6] - 1.0).abs() < 0.1 {
            shift[6] = (shift[6] - 1.0) * 1e6;
        }
    }
    let method = node.node(&["METHOD"]).map_or("", Node::name);
    if method.to_ascii_lowercase().contains("coordinate frame") {
        shift[3..6].iter_mut().for_each(|rotation| *rotation = -*rotation);
    }
    Some(shift)
}

fn horizontal_description(node: &Node) -> Option<HorizontalDescription> {
    let is_projected = PROJECTED.contains(&&*node.keyword);
    let base = if is_projected { node.node(&GEOGRAPHIC)? } else { node };
    let datum = base.node(&DATUM)?;
    let ellipsoid = datum.node(&["SPHEROID", "ELLIPSOID"])?;
    let axes: Vec<&Node> = node.nodes().filter(|node| node.keyword == "AXIS").collect();
    let is_geocentric = !is_projected && (node.keyword == "GEOCCS" || is_cartesian(node));
    // The angular unit of the base also counts for the parameters of the projection in WKT1.
    let angle_deg = unit(base).map_or(1.0, f64::to_degrees);
    let length_m = unit(node).filter(|unit| *unit > 0.0).unwrap_or(1.0);
    let mut description = HorizontalDescription {
        code: node.epsg(),
        datum: datum.name().to_owned(),
        ellipsoid: Some([ellipsoid.number(1)? * unit(ellipsoid).unwrap_or(1.0), ellipsoid.number(2)?]),
        prime_meridian_deg: base.node(&["PRIMEM", "PRIMEMERIDIAN"]).map_or(0.0, |node| meridian_deg(node, angle_deg)),
        shift: datum.node(&["TOWGS84"]).and_then(shift),
        is_geocentric,
        unit: if is_projected || is_geocentric { length_m } else { angle_deg },
        axes: axes_of(&axes),
        height_unit_m: (axes.len() == 3 && !is_geocentric)
            .then(|| axes.get(2).and_then(|axis| unit(axis)).unwrap_or(1.0)),
        ..HorizontalDescription::default()
    };
    if is_projected {
        // WKT2 has the projection within CONVERSION.
        let conversion = node.node(&["CONVERSION"]).unwrap_or(node);
        let method = conversion.node(&["PROJECTION", "METHOD"])?.name();
        let method = if is_pseudo_mercator(node) { PSEUDO_MERCATOR } else { method };
        description.method = Some(method.to_owned());
        description.parameters = parameters(conversion, angle_deg, length_m);
    }
    Some(description)
}

/// GDAL has no method for Web Mercator in WKT1, but says with a string for PROJ that it is on a sphere.
fn is_pseudo_mercator(node: &Node) -> bool {
    let strings = node.nodes().filter(|node| node.keyword == "EXTENSION").flat_map(|node| &node.items);
    strings
        .filter_map(|item| if let Item::Text(text) = item { Some(text) } else { None })
        .any(|text| text.contains("+proj=merc") && text.contains("+a=6378137 ") && text.contains("+b=6378137 "))
}

fn is_cartesian(node: &Node) -> bool {
    let system = node.node(&["CS"]).and_then(|system| system.items.first());
    matches!(system, Some(Item::Word(word)) if word.eq_ignore_ascii_case("cartesian"))
}

fn parameters(node: &Node, angle_deg: f64, length_m: f64) -> Parameters {
    let mut found = Vec::new();
    for parameter in node.nodes().filter(|node| node.keyword == "PARAMETER") {
        let Some(value) = parameter.number(1) else { continue };
        let own = unit(parameter);
        match meaning(parameter.name()) {
            Meaning::Degrees(name) => found.push((name, value * own.map_or(angle_deg, f64::to_degrees))),
            Meaning::Metres(name) => found.push((name, value * own.unwrap_or(length_m))),
            Meaning::Ratio(name) => found.push((name, value)),
            Meaning::Other => {}
        }
    }
    found.iter_mut().for_each(|(_, value)| *value = whole(*value));
    Parameters(found)
}

/// Removes what the conversion of units adds behind the twelfth digit.
fn whole(value: f64) -> f64 {
    let rounded = value.round();
    if (value - rounded).abs() < 1e-11 * rounded.abs().max(1.0) { rounded } else { value }
}

/// Radians or metres in the unit of a node: its own, or that of its first axis.
fn unit(node: &Node) -> Option<f64> {
    let own = node.node(&UNIT).or_else(|| node.nodes().find(|node| node.keyword == "AXIS")?.node(&UNIT))?;
    own.number(1).filter(|unit| unit.is_finite() && *unit > 1e-9 && *unit < 1e6)
}

/// GDAL writes degrees whatever the unit is, so known meridians go by their values in degrees and in grads.
fn meridian_deg(node: &Node, angle_deg: f64) -> f64 {
    let Some(value) = node.number(1) else { return 0.0 };
    let paris_deg = 2.337_229_166_666_667;
    if (value - paris_deg).abs() < 1e-6 || (value - paris_deg / 0.9).abs() < 1e-6 {
        return paris_deg;
    }
    value * unit(node).map_or(angle_deg, f64::to_degrees)
}

fn shift(node: &Node) -> Option<Shift> {
    let mut shift = [0.0; 7];
    for (index, value) in shift.iter_mut().enumerate() {
        *value = node.number(index).or((index >= 3).then_some(0.0))?;
    }
    Some(shift)
}

fn axes_of(axes: &[&Node]) -> Option<Axes> {
    let mut directions = axes.iter().filter_map(|axis| {
        axis.items.iter().find_map(|item| match item {
            Item::Word(word) => direction(word),
            _ => None,
        })
    });
    Axes::new(directions.next()?, directions.next()?)
}

/// The direction with a name; `None` for up, down, and directions on polar maps.
pub(super) fn direction(name: &str) -> Option<Direction> {
    match &*name.to_ascii_lowercase() {
        "east" => Some(Direction::East),
        "north" => Some(Direction::North),
        "west" => Some(Direction::West),
        "south" => Some(Direction::South),
        _ => None,
    }
}

fn vertical_description(node: &Node) -> VerticalDescription {
    let is_down = node.nodes().any(|axis| {
        let is_down = |item: &Item| matches!(item, Item::Word(word) if word.eq_ignore_ascii_case("down"));
        axis.keyword == "AXIS" && axis.items.iter().any(is_down)
            || axis.keyword == "PARAMETER"
                && axis.name().eq_ignore_ascii_case("Direction")
                && axis.number(1) == Some(-1.0)
    });
    VerticalDescription {
        code: node.epsg(),
        name: node.name().to_owned(),
        unit_m: unit(node).unwrap_or(1.0) * if is_down { -1.0 } else { 1.0 },
        // Esri refers heights above an ellipsoid to its datum, others to a vertical one.
        is_ellipsoidal: node.node(&["DATUM"]).is_some_and(|datum| datum.node(&["SPHEROID"]).is_some()),
    }
}
