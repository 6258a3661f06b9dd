//! Tables of the EPSG registry: axis order, areas of use, compound and vertical systems, names of datums. Definitions of horizontal
//! systems are in the crate `crs-definitions`. Besides, where there is land.

use super::Area;
use super::axes::Axes;
use std::collections::BTreeMap;
use std::sync::OnceLock;

static HORIZONTAL: &str = include_str!("data/horizontal.txt");
static VERTICAL: &str = include_str!("data/vertical.txt");
static COMPOUND: &str = include_str!("data/compound.txt");
static DATUMS: &str = include_str!("data/datums.txt");
static DEFINITIONS: &str = include_str!("data/definitions.txt");
static SHIFTS: &str = include_str!("data/shifts.txt");
static AREAS: &str = include_str!("data/areas.txt");
static LAND: &str = include_str!("data/land.txt");

/// What the registry knows of a horizontal system besides its definition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HorizontalEntry {
    pub(super) base: Base,
    pub(super) axes: Axes,
    /// Whether angles are in grads.
    pub(super) in_grads: bool,
    pub(super) is_deprecated: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Base {
    Geographic2d,
    Geographic3d,
    Geocentric,
    /// Projected, from the geographic system with this code.
    Projected(u32),
}

/// A vertical system.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VerticalEntry {
    /// Negative for depths.
    pub(super) unit_m: f64,
    /// Those of the registry and of Esri; never empty.
    pub(super) names: Vec<&'static str>,
    /// Geoid grids of it, best first.
    pub(super) grids: Vec<&'static str>,
    /// Typical and largest difference between EGM96 and the grid.
    pub(super) egm96_error_m: Option<[f64; 2]>,
}

/// How a datum is shifted to WGS84.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShiftEntry {
    /// Expected error; infinite if no shift is known.
    pub(super) error_m: f64,
    /// Parameters of PROJ for `+towgs84`, in place of those of the definition; empty to keep these.
    pub(super) towgs84: &'static str,
}

struct Range {
    first: u32,
    last: u32,
    entry: HorizontalEntry,
}

fn rows(table: &'static str) -> impl Iterator<Item = &'static str> {
    table.lines().filter(|line| !line.starts_with('#') && !line.is_empty())
}

fn range_ends(text: &str) -> Option<(u32, u32)> {
    match text.split_once('-') {
        Some((first, last)) => Some((first.parse().ok()?, last.parse().ok()?)),
        None => text.parse().ok().map(|code| (code, code)),
    }
}

fn horizontal_ranges() -> &'static [Range] {
    static RANGES: OnceLock<Vec<Range>> = OnceLock::new();
    RANGES.get_or_init(|| {
        let mut ranges: Vec<Range> = rows(HORIZONTAL).flat_map(ranges_of_row).collect();
        ranges.sort_by_key(|range| range.first);
        ranges
    })
}

fn ranges_of_row(row: &'static str) -> Vec<Range> {
    let mut fields = row.split('|');
    let (Some(base), Some(axes), Some(codes)) = (fields.next(), fields.next(), fields.next()) else {
        return Vec::new();
    };
    let base = match base {
        "2D" => Base::Geographic2d,
        "3D" => Base::Geographic3d,
        "XYZ" => Base::Geocentric,
        code => Base::Projected(code.parse().unwrap_or(0)),
    };
    let entry = HorizontalEntry {
        base,
        axes: Axes::from_letters(axes).unwrap_or(Axes::EAST_NORTH),
        in_grads: axes.contains('g'),
        is_deprecated: axes.contains('-'),
    };
    codes.split(' ').filter_map(range_ends).map(|(first, last)| Range { first, last, entry }).collect()
}

pub(super) fn horizontal(code: u32) -> Option<HorizontalEntry> {
    let ranges = horizontal_ranges();
    let after = ranges.partition_point(|range| range.first <= code);
    ranges.get(after.checked_sub(1)?).filter(|range| code <= range.last).map(|range| range.entry)
}

/// Area of use of a horizontal system; `None` for all of the Earth, or if it is not known.
pub(super) fn area(code: u32) -> Option<Area> {
    static RANGES: OnceLock<Vec<(u32, u32, Area)>> = OnceLock::new();
    let ranges = RANGES.get_or_init(|| {
        let of_row = |row: &'static str| {
            let (degrees, codes) = row.split_once('|')?;
            let area = area_of_row(degrees)?;
            Some(codes.split(' ').filter_map(range_ends).map(move |(first, last)| (first, last, area)))
        };
        let mut ranges: Vec<_> = rows(AREAS).filter_map(of_row).flatten().collect();
        ranges.sort_by_key(|(first, ..)| *first);
        ranges
    });
    let after = ranges.partition_point(|(first, ..)| *first <= code);
    ranges.get(after.checked_sub(1)?).filter(|(_, last, _)| code <= *last).map(|(.., area)| *area)
}

/// Whether a longitude and latitude is on land, or near it.
pub(super) fn is_near_land([lon, lat]: [f64; 2]) -> bool {
    const CELLS_PER_DEGREE: f64 = 2.0;
    /// Rows from the south pole, with the first cell of each run of land, and the cell behind it.
    type Runs = BTreeMap<u32, Vec<[u32; 2]>>;
    static ROWS: OnceLock<Runs> = OnceLock::new();
    let all = ROWS.get_or_init(|| {
        let of_row = |row: &'static str| {
            let numbers: Vec<u32> = row.split(' ').filter_map(|number| number.parse().ok()).collect();
            let (number, runs) = numbers.split_first()?;
            Some((*number, runs.as_chunks().0.iter().map(|[first, count]| [*first, first + count]).collect()))
        };
        rows(LAND).filter_map(of_row).collect()
    });
    let [column, row] =
        [(lon + 180.0).rem_euclid(360.0), lat + 90.0].map(|degrees| (degrees * CELLS_PER_DEGREE) as u32);
    all.get(&row).is_some_and(|runs| runs.iter().any(|[first, end]| (*first..*end).contains(&column)))
}

fn area_of_row(row: &'static str) -> Option<Area> {
    let degrees: Vec<f64> = row.split(' ').filter_map(|number| number.parse().ok()).collect();
    Some(Area::new(degrees.try_into().ok()?))
}

/// Codes of projected systems that are not deprecated, with their geographic systems.
pub(super) fn projected_codes() -> impl Iterator<Item = (u32, u32, Axes)> {
    horizontal_ranges().iter().flat_map(|range| {
        let base = match range.entry.base {
            Base::Projected(base) if !range.entry.is_deprecated => Some(base),
            _ => None,
        };
        let codes = range.first..=range.last;
        codes.filter_map(move |code| Some((code, base?, range.entry.axes)))
    })
}

/// Definition for PROJ of a horizontal system, as published: with its units, without axis order.
pub(super) fn definition(code: u32) -> Option<&'static str> {
    static OWN: OnceLock<BTreeMap<u32, &'static str>> = OnceLock::new();
    let own = OWN.get_or_init(|| {
        let pairs = rows(DEFINITIONS).filter_map(|row| row.split_once(' '));
        pairs.filter_map(|(code, text)| Some((code.parse().ok()?, text))).collect()
    });
    if let Some(text) = own.get(&code) {
        return Some(text);
    }
    let known = crs_definitions::from_code(u16::try_from(code).ok()?)?;
    known.proj4.starts_with("+proj=").then_some(known.proj4)
}

pub(super) fn vertical(code: u32) -> Option<&'static VerticalEntry> {
    static ENTRIES: OnceLock<BTreeMap<u32, VerticalEntry>> = OnceLock::new();
    ENTRIES.get_or_init(|| vertical_entries().collect()).get(&code)
}

fn vertical_entries() -> impl Iterator<Item = (u32, VerticalEntry)> {
    rows(VERTICAL).filter_map(|row| {
        let mut fields = row.split('|');
        let code = fields.next()?.parse().ok()?;
        let unit_m = fields.next()?.parse().ok()?;
        let names = fields.next()?.split(';').collect();
        let grids = fields.next()?.split(',').filter(|name| !name.is_empty()).collect();
        let error = fields.next().and_then(|text| text.split_once(' '));
        let egm96_error_m = error.and_then(|(typical, most)| Some([typical.parse().ok()?, most.parse().ok()?]));
        Some((code, VerticalEntry { unit_m, names, grids, egm96_error_m }))
    })
}

/// Code of the vertical system with a name, in any spelling.
pub(super) fn vertical_by_name(name: &str) -> Option<u32> {
    let wanted = vertical_key(name);
    let mut entries = vertical_entries().filter(|(_, entry)| entry.unit_m == 1.0);
    entries.find(|(_, entry)| entry.names.iter().any(|name| vertical_key(name) == wanted)).map(|(code, _)| code)
}

fn vertical_key(name: &str) -> String {
    let key = name_key(name);
    let key = key.strip_suffix("ftus").or_else(|| key.strip_suffix("ft")).unwrap_or(&key);
    key.strip_suffix("height").unwrap_or(key).to_owned()
}

/// Horizontal and vertical code of a compound system.
pub(super) fn compound(code: u32) -> Option<(u32, u32)> {
    static PARTS: OnceLock<BTreeMap<u32, (u32, u32)>> = OnceLock::new();
    let parts = PARTS.get_or_init(|| {
        let codes = |row: &str| -> Option<[u32; 3]> {
            let codes: Vec<u32> = row.split(' ').filter_map(|code| code.parse().ok()).collect();
            codes.try_into().ok()
        };
        rows(COMPOUND).filter_map(codes).map(|[code, horizontal, vertical]| (code, (horizontal, vertical))).collect()
    });
    parts.get(&code).copied()
}

/// A name without case, punctuation and Esri's prefixes.
pub(super) fn name_key(name: &str) -> String {
    let name = name.trim();
    let name = name.strip_prefix("D_").or_else(|| name.strip_prefix("GCS_")).unwrap_or(name);
    let name = name.strip_suffix(" ensemble").unwrap_or(name);
    name.chars().filter(|c| c.is_alphanumeric() || *c == '+').flat_map(char::to_lowercase).collect()
}

/// Codes of the geographic systems with a datum of this name.
pub(super) fn geographic_by_datum(name: &str) -> &'static [u32] {
    static CODES: OnceLock<BTreeMap<String, Vec<u32>>> = OnceLock::new();
    let codes = CODES.get_or_init(|| {
        let mut codes = BTreeMap::<String, Vec<u32>>::new();
        for row in rows(DATUMS) {
            let mut fields = row.split('|');
            let Some(code) = fields.next().and_then(|code| code.parse().ok()) else { continue };
            for name in fields {
                codes.entry(name_key(name)).or_default().push(code);
            }
        }
        codes
    });
    codes.get(&name_key(name)).map_or(&[], Vec::as_slice)
}

/// How the datum of a geographic system is shifted to WGS84, if its definition does not tell.
pub(super) fn shift(geographic_code: u32) -> Option<ShiftEntry> {
    static ENTRIES: OnceLock<BTreeMap<u32, ShiftEntry>> = OnceLock::new();
    let entries = ENTRIES.get_or_init(|| {
        let entry = |row: &'static str| {
            let mut fields = row.split(' ');
            let (code, error_m) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
            Some((code, ShiftEntry { error_m, towgs84: fields.next().unwrap_or_default() }))
        };
        rows(SHIFTS).filter_map(entry).collect()
    });
    entries.get(&geographic_code).copied()
}

pub(super) fn datum_name(geographic_code: u32) -> Option<&'static str> {
    let row =
        rows(DATUMS).find(|row| row.split('|').next().and_then(|code| code.parse().ok()) == Some(geographic_code))?;
    row.rsplit('|').next()
}
