//! The city's coordinate system.

use super::earth::Geodetic;
use super::first_shape::FirstShape;
use super::input::{Habit, SourceInput, WGS84, origin_without_geoid};
use super::likely::Region;
use super::order::{AxisOrders, FAR_DEG};
use super::transform::Transform;
use super::{Placed, Placement, national};
use crate::crs::geoid::{Geoid, GridFolder};
use crate::crs::{Crs, CrsError, Definition, LocalOrigin, System, Vertical, VerticalDatum};
use crate::earth_place::EarthPlace;
use crate::{PlacingOptions, crs};
use insula_source::error::InputError;
use insula_source::object::{AxisOrder, CrsReference};
use insula_source::units::HeightUnit;
use proj4rs::Proj;
use std::path::PathBuf;
use std::sync::Arc;

/// Latitudes for which UTM is defined.
const UTM_LATITUDES_DEG: std::ops::RangeInclusive<f64> = -80.0..=84.0;
/// Heights of EGM96, if the city has no other vertical datum.
const EGM96_CODE: u32 = 5773;
/// Error of heights by EGM96 in place of a national model of which nothing is known.
const EGM96_ERROR_M: f64 = 1.0;
/// Smaller errors of a datum's shift are not worth a warning.
const NOTED_SHIFT_ERROR_M: f64 = 0.1;
/// Of meshes around a place of which only longitude and latitude are told.
const UNTOLD_HEIGHT: &str = "the height of the origin is not told, taken as 0 above the ellipsoid; give --at LON,LAT,H if meshes lie too high or low";
/// Between its points, a side of a box of degrees leaves the box by less than this share of its length.
const CURVE_SHARE: f64 = 1e-3;

/// The coordinate system that all sources of a city share.
#[derive(Debug, Clone, Default)]
pub struct World {
    system: Option<WorldSystem>,
    /// The name given with `--crs`.
    target: Option<String>,
    vertical: Option<VerticalDatum>,
    folder: Option<GridFolder>,
    geoid: Option<Arc<Geoid>>,
    /// What the user says of the order of coordinates.
    orders: AxisOrders,
    /// Area that the user wants.
    wanted_deg: Option<[f64; 4]>,
    /// Unit of heights on maps in feet that do not tell it.
    height_unit: Option<HeightUnit>,
}

/// A projected system in metres.
#[derive(Debug, Clone)]
struct WorldSystem {
    /// `EPSG:28992`, or a string for PROJ.
    label: String,
    /// As the first source has it, such as `EPSG:7415`.
    name: String,
    code: Option<u32>,
    definition: Definition,
    proj: Arc<Proj>,
    datum: String,
    shift_error_m: f64,
}

impl World {
    /// `target` is the system of `--crs`, `grids` a folder with geoid grids. Fails if the target is not a known
    /// projected system in metres, or if the folder cannot be read.
    pub fn new(target: Option<&str>, grids: Option<PathBuf>) -> Result<Self, InputError> {
        let folder = grids.map(|path| GridFolder::open(&path)).transpose()?;
        let mut world = Self { folder, ..Self::default() };
        let Some(name) = target else { return Ok(world) };
        let label = "--crs";
        let crs = crs::resolve(name).map_err(|error| not_a_system(label, name, &error, "give an EPSG code"))?;
        if !world.adopt(&crs) {
            return Err(InputError::misplaced(
                label,
                format!(
                    "{} is not a projected system with true lengths; give that of a UTM zone or of your country",
                    crs.name
                ),
            ));
        }
        world.target = Some(name.to_owned());
        Ok(world)
    }

    /// Takes what else the user says of places, and the unit of heights that sources do not tell.
    pub fn with_options(mut self, placing: &PlacingOptions, height_unit: Option<HeightUnit>) -> Self {
        self.height_unit = height_unit;
        self.orders = placing.axis_orders.clone();
        self.wanted_deg = placing.bbox_deg;
        if placing.is_crs_found {
            self.target = None;
        }
        self
    }

    /// By what the order of a source's coordinates is decided on.
    pub(super) fn order_facts(&self) -> (&AxisOrders, Region) {
        let code = self.system.as_ref().and_then(|system| system.code);
        (&self.orders, Region { wanted_deg: self.wanted_deg, city: code.and_then(crs::area_of_use) })
    }

    /// The system of a source that names none, by its first shape, and what to tell: WGS 84 if coordinates look like degrees,
    /// else that of `--crs`. `None` if nothing is known: then they are metres of the city's system, or of an unknown place.
    pub fn guess(&self, first: &FirstShape) -> (Option<CrsReference>, String) {
        let [x, y] = first.position;
        if first.looks_like_degrees() {
            let (reference, order) = match first.is_latitude_first() {
                true => (CrsReference::authority("EPSG:4326"), "latitude"),
                false => {
                    let order = AxisOrder::MostlyEastFirst;
                    (CrsReference { order, ..CrsReference::east_first("OGC:CRS84") }, "longitude")
                }
            };
            let text = format!("coordinates such as {x}, {y} look like degrees and are taken as WGS 84, {order} first");
            return (Some(reference), text);
        }
        if let Some(target) = &self.target {
            return (Some(CrsReference::east_first(target)), format!("coordinates are taken in {target} (--crs)"));
        }
        let taken = match &self.system {
            Some(system) => format!("are taken in {}, that of the city", system.label),
            None => "are taken as metres of an unknown place".to_owned(),
        };
        (None, format!("coordinates such as {x}, {y} {taken}; give their system with --crs"))
    }

    /// How the positions of a source are placed. Its system becomes the world's, if the world has none yet and it is
    /// suitable. Fails if the system is not known or not supported, or if a geoid grid is damaged.
    pub fn place(&mut self, label: &str, reference: &CrsReference) -> Result<Placement, InputError> {
        let mut warnings = Vec::new();
        let crs = match crs::resolve(&reference.name) {
            Ok(crs) => crs,
            Err(CrsError::Unknown) if self.target.is_some() => return self.place_in_target(label, reference),
            Err(error) => return Err(not_a_system(label, &reference.name, &error, ADVICE)),
        };
        let mut input = SourceInput::new(&crs, reference.order)
            .map_err(|error| not_a_system(label, &reference.name, &error, ADVICE))?;
        if let (Vertical::Unknown, true, Some(unit)) = (&crs.vertical, input.is_in_feet(), self.height_unit) {
            input.height_unit_m = unit.metres();
        }
        if let Some(unit_m) = reference.height_unit_m {
            // The system tells whether depths count down.
            input.height_unit_m = unit_m.abs().copysign(input.height_unit_m);
        }
        if self.system.is_none() {
            self.adopt(&crs);
        }
        self.note_vertical(&crs, &mut warnings);
        if matches!(crs.horizontal.system, System::Local(LocalOrigin { is_ellipsoidal: true, .. })) {
            warnings.push(UNTOLD_HEIGHT.to_owned());
        }
        let transform = self.transform(label, &input, &mut warnings)?;
        let placed = Placed {
            reference: reference.clone(),
            source_crs: crs.name,
            warnings,
            finding: None,
            is_checked: false,
            input,
            transform,
        };
        Ok(Placement::Known(Arc::new(placed)))
    }

    /// A source whose system is not understood is taken to be in that of `--crs`.
    fn place_in_target(&mut self, label: &str, reference: &CrsReference) -> Result<Placement, InputError> {
        let target = self.target.clone().unwrap_or_default();
        let known = CrsReference::east_first(target.clone());
        let mut placement = self.place(label, &known)?;
        if let Placement::Known(placed) = &mut placement {
            let placed = Arc::make_mut(placed);
            placed.reference = reference.clone();
            let name = shortened(&reference.name);
            placed
                .warnings
                .push(format!("the coordinate system \"{name}\" is not known; taken to be {target} (--crs)"));
        }
        Ok(placement)
    }

    /// Whether the world has a system.
    pub fn is_settled(&self) -> bool {
        self.system.is_some()
    }

    /// The projected system: `EPSG:28992`, or a string for PROJ if the registry has no code for it.
    #[cfg(test)]
    pub fn horizontal(&self) -> Option<String> {
        self.system.as_ref().map(|system| system.label.clone())
    }

    /// The vertical datum: `EPSG:5709`, or a name; `None` if it is unknown.
    pub fn vertical(&self) -> Option<String> {
        self.vertical.as_ref().map(VerticalDatum::label)
    }

    /// The geoid model that heights were converted with: `EGM96` or the name of a file; `None` if none was needed.
    pub fn geoid(&self) -> Option<String> {
        self.geoid.as_ref().map(|geoid| geoid.name.clone())
    }

    /// The name of the whole system as the first source or `--crs` has it, such as `EPSG:7415`, or that of its
    /// projected part if something else was changed.
    pub fn crs_name(&self) -> Option<String> {
        self.system.as_ref().map(|system| system.name.clone())
    }

    /// Takes the system of another world, and nothing else that it knows.
    pub fn take_system(&mut self, other: Self) {
        self.system = other.system;
    }

    /// West, south, east and north in degrees around a box in metres; `None` if the world has no system, or if the box crosses the
    /// meridian of 180 degrees.
    pub fn degrees_around(&self, [west_m, south_m, east_m, north_m]: [f64; 4]) -> Option<[f64; 4]> {
        let place = EarthPlace::of(&self.system.as_ref()?.label)?;
        let [west, south, _, east, north, _] = place.extent([[west_m, south_m, 0.0], [east_m, north_m, 0.0]])?;
        // The extent has some points of the sides, which are curves.
        let more = CURVE_SHARE * (east - west).max(north - south);
        (west <= east).then_some([west - more, south - more, east + more, north + more])
    }

    /// A warning if the middle of a city lies far outside the area of use of its system. Lengths are wrong there. It happens where the
    /// first object, which decides the system, lies far from the others. `None` of other cities.
    pub fn far_text(&self, middle: [f64; 2]) -> Option<String> {
        let system = self.system.as_ref()?;
        let area = crs::area_of_use(system.code?)?;
        let found = EarthPlace::of(&system.label)?.lon_lat(middle);
        if found.is_some_and(|place| area.contains(place, FAR_DEG)) {
            return None;
        }
        let advice = "give the one of most objects with --crs, or remove the objects that are elsewhere";
        let place = found.map_or("beyond its projection".to_owned(), |[lon, lat]| {
            format!("at {lon:.4}, {lat:.4} (longitude, latitude), likely EPSG:{}", utm_code([lon, lat]))
        });
        Some(format!(
            "most of the city is far outside of {}, which follows from the first object: {place}; {advice}",
            system.label
        ))
    }

    /// Makes the system the world's if it is projected, with nearly true lengths. Returns whether it is.
    fn adopt(&mut self, crs: &Crs) -> bool {
        let Some((code, definition)) = crs.horizontal.in_metres().filter(|(_, definition)| definition.is_metric())
        else {
            return false;
        };
        let Ok(proj) = definition.proj() else { return false };
        let label = code.map_or_else(|| definition.text(), |code| format!("EPSG:{code}"));
        let is_unchanged = code == crs.horizontal.code
            && match &crs.vertical {
                Vertical::Unknown => true,
                Vertical::Orthometric(datum) => datum.unit_m == 1.0,
                Vertical::Ellipsoidal { .. } => false,
            };
        let name = if is_unchanged && code.is_some() { crs.name.clone() } else { label.clone() };
        let horizontal = &crs.horizontal;
        let (datum, shift_error_m) = (horizontal.datum.clone(), horizontal.shift_error_m);
        let system = WorldSystem { label, name, code, definition, proj: Arc::new(proj), datum, shift_error_m };
        self.system = Some(system);
        if let Vertical::Orthometric(datum) = &crs.vertical {
            self.vertical = Some(datum.in_metres());
        }
        true
    }

    /// Makes the zone of UTM on WGS84 of a longitude and latitude the world's system; nothing where UTM is not defined.
    pub(super) fn settle_utm(&mut self, [longitude_deg, latitude_deg]: [f64; 2]) {
        if !UTM_LATITUDES_DEG.contains(&latitude_deg) {
            return;
        }
        if let Ok(crs) = crs::resolve(&format!("EPSG:{}", utm_code([longitude_deg, latitude_deg]))) {
            self.adopt(&crs);
        }
    }

    /// The first known vertical datum becomes the world's. Heights of another one are not converted.
    fn note_vertical(&mut self, crs: &Crs, warnings: &mut Vec<String>) {
        let Vertical::Orthometric(datum) = &crs.vertical else { return };
        match &self.vertical {
            None => self.vertical = Some(datum.in_metres()),
            Some(known) if !is_same_datum(known, datum) => warnings.push(format!(
                "heights are above {} ({}), those of the city above {} ({}): they are not converted; expect a \
                 difference of some decimetres",
                datum.name,
                datum.label(),
                known.name,
                known.label()
            )),
            Some(_) => {}
        }
    }

    /// How positions go to the world; `None` if it has no system yet. Fails if a geoid grid is damaged.
    pub(super) fn transform(
        &mut self,
        label: &str,
        input: &SourceInput,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Transform>, InputError> {
        let Some(system) = self.system.clone() else { return Ok(None) };
        let unsupported = |what: String| InputError::misplaced(label, what);
        let source = match &input.horizontal.system {
            System::Projected(definition) | System::Geographic { definition, .. } => definition,
            System::Geocentric(_) | System::Local(_) => {
                self.warn_of_shift(input, &system, warnings);
                let geoid = self.geoid_model(warnings)?;
                let origin = local_origin(input, &geoid).map_err(unsupported)?;
                let wgs84 = Proj::from_proj_string(WGS84).map_err(|error| unsupported(error.to_string()))?;
                return Ok(Some(Transform::Space { world: system.proj, wgs84: Arc::new(wgs84), geoid, origin }));
            }
        };
        let is_same_map = source.is_same_projection(&system.definition) && source.has_same_shift(&system.definition);
        self.warn_of_shift(input, &system, warnings);
        if input.unit != 1.0
            && matches!(input.horizontal.system, System::Projected(_))
            && input.height_unit_m == input.unit
        {
            warnings.push(format!("coordinates and heights are converted from units of {} m to metres", input.unit));
        }
        let map = (!is_same_map).then_some(system.proj);
        if input.is_ellipsoidal {
            return Ok(Some(Transform::Heights { map, geoid: self.geoid_model(warnings)? }));
        }
        Ok(Some(match map {
            Some(world) => Transform::Map { world },
            None if is_plain(input) => Transform::Identity,
            None => Transform::Reorder,
        }))
    }

    /// Warns if the shift between the datums is not exact.
    fn warn_of_shift(&self, input: &SourceInput, system: &WorldSystem, warnings: &mut Vec<String>) {
        let source = &input.horizontal;
        if source.definition().is_some_and(|definition| definition.has_same_shift(&system.definition)) {
            // Then the whole city is away from its place, and nothing within it.
            if source.shift_error_m.is_infinite() {
                warnings.push(format!(
                    "the shift of the datum {} is not known: the city can be hundreds of metres away from its place on Earth; \
                     reproject the file with ogr2ogr -t_srs EPSG:..., to a system of WGS 84",
                    source.datum
                ));
            }
            return;
        }
        for (datum, error_m) in [(&source.datum, source.shift_error_m), (&system.datum, system.shift_error_m)] {
            if error_m.is_infinite() {
                warnings.push(format!(
                    "the shift of the datum {datum} is not known: positions can be off by hundreds of metres; \
                     reproject the file with ogr2ogr -t_srs {}",
                    system.label
                ));
            } else if error_m > NOTED_SHIFT_ERROR_M {
                warnings.push(format!(
                    "the datum {datum} is shifted without its grid: expect an error of up to {error_m} m; reproject \
                     the file with ogr2ogr -t_srs {} and the grids of PROJ if that is too much",
                    system.label
                ));
            }
        }
    }

    /// The geoid model of the world's vertical datum, chosen at the first call. Warns if it is not at hand.
    fn geoid_model(&mut self, warnings: &mut Vec<String>) -> Result<Arc<Geoid>, InputError> {
        if let Some(geoid) = &self.geoid {
            return Ok(Arc::clone(geoid));
        }
        if self.vertical.is_none() {
            let code = self.system.as_ref().and_then(|system| national::vertical_code(system.code?));
            self.vertical = Some(VerticalDatum::from_code(code.unwrap_or(EGM96_CODE)));
        }
        let datum = self.vertical.as_ref();
        let files = datum.map_or(&[][..], VerticalDatum::grids);
        let found = match &self.folder {
            Some(folder) => Geoid::from_folder(folder, files)?,
            None => None,
        };
        let is_egm96 = datum.is_some_and(|datum| datum.code == Some(EGM96_CODE));
        let geoid = match found {
            Some(geoid) if !is_egm96 => geoid,
            _ => Geoid::egm96(self.folder.as_ref())?,
        };
        if let Some(datum) = datum.filter(|_| geoid.name == "EGM96" && !is_egm96) {
            warnings.push(missing_grid(datum, files));
        }
        Ok(Arc::clone(self.geoid.insert(Arc::new(geoid))))
    }
}

/// What to do about a system that cannot be placed.
const ADVICE: &str = "reproject the file with ogr2ogr -t_srs EPSG:..., or give its system with --crs";

fn not_a_system(label: &str, name: &str, error: &CrsError, advice: &str) -> InputError {
    let name = shortened(name);
    InputError::misplaced(
        label,
        match error {
            CrsError::Unknown => format!("the coordinate system \"{name}\" is not known; {advice}"),
            CrsError::Unsupported(what) => {
                format!("the coordinate system \"{name}\" is not supported: {what}; {advice}")
            }
        },
    )
}

/// The start of a long name, such as well-known text.
fn shortened(name: &str) -> String {
    const MAX_CHARS: usize = 80;
    let name = name.trim();
    match name.char_indices().nth(MAX_CHARS) {
        Some((end, _)) => format!("{}...", &name[..end]),
        None => name.to_owned(),
    }
}

fn missing_grid(datum: &VerticalDatum, files: &[&str]) -> String {
    let [typical_m, most_m] = datum.egm96_error_m().unwrap_or([EGM96_ERROR_M, 2.0 * EGM96_ERROR_M]);
    let error = format!("expect an error of heights of about {typical_m} m (up to {most_m} m)");
    match files.first() {
        Some(file) => format!(
            "heights above the ellipsoid are converted with EGM96, because the geoid grid {file} of {} is not in the \
             folder of grids (--grids DIR): {error}",
            datum.name
        ),
        None => format!(
            "heights above the ellipsoid are converted with EGM96, because no geoid grid of {} is known: {error}",
            datum.name
        ),
    }
}

/// Whether heights count from the same zero. Feet and depths of a datum have codes of their own.
fn is_same_datum(a: &VerticalDatum, b: &VerticalDatum) -> bool {
    a.name.eq_ignore_ascii_case(&b.name) || a.code.is_some() && a.code == b.code
}

/// Whether coordinates are metres east, north and up already.
fn is_plain(input: &SourceInput) -> bool {
    input.axes == crs::Axes::EAST_NORTH && input.unit == 1.0 && input.height_unit_m == 1.0 && input.habit == Habit::None
}

/// The origin of a local system with its height above the ellipsoid; `None` for geocentric systems.
fn local_origin(input: &SourceInput, geoid: &Geoid) -> Result<Option<Geodetic>, String> {
    let System::Local(origin) = input.horizontal.system else { return Ok(None) };
    if origin.is_ellipsoidal {
        return Ok(Some(origin_without_geoid(origin)));
    }
    let undulation_m = geoid.undulation_m(origin.longitude_deg, origin.latitude_deg);
    let undulation_m = undulation_m.ok_or("the origin of its local system is not on Earth")?;
    let mut geodetic = origin_without_geoid(origin);
    geodetic.height_m += undulation_m;
    Ok(Some(geodetic))
}

/// EPSG code of the zone of UTM on WGS 84.
fn utm_code([longitude_deg, latitude_deg]: [f64; 2]) -> u32 {
    let hemisphere = if latitude_deg < 0.0 { 32_700 } else { 32_600 };
    hemisphere + utm_zone(longitude_deg, latitude_deg)
}

/// Zone of UTM with the exceptions of Norway and Svalbard.
fn utm_zone(longitude_deg: f64, latitude_deg: f64) -> u32 {
    let longitude_deg = if longitude_deg == 180.0 { 180.0 } else { (longitude_deg + 180.0).rem_euclid(360.0) - 180.0 };
    if (56.0..64.0).contains(&latitude_deg) && (3.0..12.0).contains(&longitude_deg) {
        return 32;
    }
    if latitude_deg >= 72.0 && (0.0..42.0).contains(&longitude_deg) {
        return match longitude_deg {
            ..9.0 => 31,
            ..21.0 => 33,
            ..33.0 => 35,
            _ => 37,
        };
    }
    ((longitude_deg + 180.0) / 6.0).floor().clamp(0.0, 59.0) as u32 + 1
}
