//! Systems that are described by parameters: finds the registry's code, or makes a definition.

use super::axes::Axes;
use super::definition::{Definition, Shift};
use super::method::{self, Parameters};
use super::{Crs, CrsError, Horizontal, System, Vertical, VerticalDatum, registry};

/// A horizontal system as well-known text or PROJJSON describes it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct HorizontalDescription {
    pub(super) code: Option<u32>,
    pub(super) datum: String,
    /// Equatorial radius in metres and inverse flattening (0 for a sphere).
    pub(super) ellipsoid: Option<[f64; 2]>,
    pub(super) prime_meridian_deg: f64,
    pub(super) shift: Option<Shift>,
    /// Name of the projection method; `None` for geographic and geocentric systems.
    pub(super) method: Option<String>,
    pub(super) parameters: Parameters,
    pub(super) is_geocentric: bool,
    /// Metres or degrees in a unit of its coordinates.
    pub(super) unit: f64,
    pub(super) axes: Option<Axes>,
    /// Metres in a unit of the third coordinate, a height above the ellipsoid.
    pub(super) height_unit_m: Option<f64>,
}

/// A vertical system as well-known text or PROJJSON describes it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct VerticalDescription {
    pub(super) code: Option<u32>,
    pub(super) name: String,
    /// Negative for depths.
    pub(super) unit_m: f64,
    pub(super) is_ellipsoidal: bool,
}

/// The system of a description. Fails if its projection is not supported.
pub(super) fn system(
    text_name: &str,
    code: Option<u32>,
    horizontal: &HorizontalDescription,
    vertical: Option<&VerticalDescription>,
) -> Result<Crs, CrsError> {
    if let Some(crs) = code.and_then(|code| super::from_codes(code, None).ok()) {
        return Ok(crs);
    }
    let mut crs = match horizontal.code.and_then(|code| super::from_codes(code, None).ok()) {
        Some(crs) => crs,
        None => {
            let found = horizontal_system(horizontal)?;
            let vertical =
                horizontal.height_unit_m.map_or(Vertical::Unknown, |unit_m| Vertical::Ellipsoidal { unit_m });
            Crs {
                name: found.code.map_or_else(|| text_name.to_owned(), |code| format!("EPSG:{code}")),
                horizontal: found,
                vertical,
            }
        }
    };
    if let Some(vertical) = vertical {
        crs.vertical = vertical_system(vertical);
        if let (Some(horizontal), Vertical::Orthometric(VerticalDatum { code: Some(code), .. })) =
            (crs.horizontal.code, &crs.vertical)
        {
            crs.name = format!("EPSG:{horizontal}+{code}");
        }
    }
    Ok(crs)
}

fn vertical_system(description: &VerticalDescription) -> Vertical {
    if description.is_ellipsoidal {
        return Vertical::Ellipsoidal { unit_m: description.unit_m };
    }
    let code = description.code.or_else(|| registry::vertical_by_name(&description.name));
    if code.is_some_and(super::is_ellipsoidal) {
        return Vertical::Ellipsoidal { unit_m: description.unit_m };
    }
    let mut datum = code.map_or_else(|| VerticalDatum::named(&description.name), VerticalDatum::from_code);
    datum.unit_m = description.unit_m;
    Vertical::Orthometric(datum)
}

fn horizontal_system(description: &HorizontalDescription) -> Result<Horizontal, CrsError> {
    let mut definition = Definition::parse(&definition_text(description)?).map_err(CrsError::Unsupported)?;
    let bases = registry::geographic_by_datum(&description.datum);
    if let Some(found) = registered(description, &definition, bases) {
        return Ok(found);
    }
    let base = bases.iter().find_map(|base| super::horizontal_from_code(*base).ok());
    let shift = description.shift.or_else(|| base.as_ref()?.definition()?.shift()).or(definition.shift());
    definition = definition.with_shift(shift);
    let shift_error_m = match (shift, base) {
        (Some(shift), _) if shift == [0.0; 7] => 0.0,
        (None, _) => f64::INFINITY,
        (Some(_), Some(base)) if description.shift.is_none() => base.shift_error_m,
        _ => super::DEFAULT_SHIFT_ERROR_M,
    };
    let axes = description.axes.unwrap_or(Axes::EAST_NORTH);
    let datum = description.datum.clone();
    let system = if description.is_geocentric {
        System::Geocentric(definition)
    } else if description.method.is_none() {
        System::Geographic { definition, unit_deg: description.unit }
    } else {
        System::Projected(definition)
    };
    Ok(Horizontal { code: None, system, axes, datum, shift_error_m })
}

fn definition_text(description: &HorizontalDescription) -> Result<String, CrsError> {
    let projection = match &description.method {
        Some(method) => method::projection(method, &description.parameters).map_err(CrsError::Unsupported)?,
        None if description.is_geocentric => "+proj=geocent".to_owned(),
        None => "+proj=longlat".to_owned(),
    };
    let ellipsoid = match description.ellipsoid {
        // Web Mercator takes the ellipsoid as a sphere.
        _ if projection.starts_with("+proj=webmerc") => {
            let rest = projection.trim_start_matches("+proj=webmerc");
            return Ok(format!("+proj=merc{rest} +a=6378137 +b=6378137 +nadgrids=@null"));
        }
        Some([a, 0.0]) => format!("+a={a} +b={a}"),
        Some([a, inverse_flattening]) => format!("+a={a} +rf={inverse_flattening}"),
        None => "+ellps=WGS84".to_owned(),
    };
    let mut text = format!("{projection} {ellipsoid}");
    if description.prime_meridian_deg != 0.0 {
        text.push_str(&format!(" +pm={}", description.prime_meridian_deg));
    }
    if description.method.is_some() {
        text.push_str(&format!(" +to_meter={}", description.unit));
    }
    Ok(text)
}

/// The registry's system with the same datum and projection.
fn registered(description: &HorizontalDescription, definition: &Definition, bases: &[u32]) -> Option<Horizontal> {
    if description.method.is_none() {
        let same = bases.iter().filter_map(|code| super::horizontal_from_code(*code).ok()).find(|known| {
            let unit_deg = match known.system {
                System::Geographic { unit_deg, .. } => unit_deg,
                _ => return false,
            };
            (unit_deg - description.unit).abs() < 1e-9
                && known.definition().is_some_and(|known| same_meridian(known, definition))
        });
        return same.filter(|_| !description.is_geocentric);
    }
    let is_web_mercator = definition.is_pseudo_mercator();
    let code = if is_web_mercator { Some(3857) } else { projected_code(definition, bases) };
    super::horizontal_from_code(code?).ok()
}

fn same_meridian(known: &Definition, definition: &Definition) -> bool {
    match (known.proj(), definition.proj()) {
        (Ok(known), Ok(other)) => (known.from_greenwich() - other.from_greenwich()).abs() < 1e-8,
        _ => false,
    }
}

/// Code of a projected system with one of these geographic systems and this projection. Several systems can be equal:
/// the first whose axes are east and north, zones of UTM before others.
pub(super) fn projected_code(definition: &Definition, bases: &[u32]) -> Option<u32> {
    let mut found: Vec<(bool, bool, u32)> = registry::projected_codes()
        .filter(|(_, base, _)| bases.contains(base))
        .filter(|(code, ..)| {
            let known = registry::definition(*code).and_then(|text| Definition::parse(text).ok());
            known.is_some_and(|known| known.unit_m_is(definition.unit_m) && known.is_same_projection(definition))
        })
        .map(|(code, _, axes)| (axes != Axes::EAST_NORTH, !is_utm_code(code), code))
        .collect();
    found.sort_unstable();
    found.first().map(|(.., code)| *code)
}

fn is_utm_code(code: u32) -> bool {
    matches!(code, 25828..=25838 | 32601..=32660 | 32701..=32760 | 26901..=26923 | 28348..=28358 | 7846..=7859)
}
