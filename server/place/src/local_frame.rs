//! Where a mesh file stands that has no coordinate system: `--at`, or a file beside it.
//!
//! `statue.glb.place.json` places `statue.glb`: `{"lon": 11.575, "lat": 48.137, "height": 519, "heading": 30, "scale": 0.01}`. Programs for
//! photogrammetry write `metadata.xml`, with a coordinate system and the place of the origin of all meshes in it, or a shift for each.

use crate::crs::{System, resolve};
use crate::mesh_shift::MeshShift;
use insula_source::error::InputError;
use insula_source::object::CrsReference;
use insula_source::remote::is_address;
use insula_source::source::{CitySource, METADATA_FILE, PLACE_FILE, read_sibling};
use serde::Deserialize;
use std::io::ErrorKind;

/// Larger files are refused.
const MAX_FILE_BYTES: u64 = 64 << 10;
/// Folders above that of a mesh in which its `metadata.xml` is looked for.
const FOLDERS_ABOVE: usize = 3;

/// Turn and size of a mesh before it is placed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    /// East and north of the turned x axis, times the scale.
    cos: f64,
    sin: f64,
    scale: f64,
    /// Whether y points up in the file, and z south.
    is_y_up: bool,
    /// The place of the mesh's origin in its coordinate system.
    origin: [f64; 3],
}

impl LocalFrame {
    /// Positions as they are.
    pub const IDENTITY: Self = Self { cos: 1.0, sin: 0.0, scale: 1.0, is_y_up: false, origin: [0.0; 3] };

    /// The frame of a file in which y points up.
    pub fn with_y_up(self) -> Self {
        Self { is_y_up: true, ..self }
    }

    /// The position in the system that places the mesh: metres east, north and up of its origin, or coordinates of a map.
    pub fn apply(self, position: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = if self.is_y_up { [position[0], -position[2], position[1]] } else { position };
        let [east, north, up] = self.origin;
        [east + x * self.cos + y * self.sin, north + y * self.cos - x * self.sin, up + z * self.scale]
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaceFile {
    lon: f64,
    lat: f64,
    /// Above sea level, in metres.
    height: f64,
    /// Degrees by which the mesh is turned clockwise.
    #[serde(default)]
    heading: f64,
    #[serde(default = "one")]
    scale: f64,
}

fn one() -> f64 {
    1.0
}

/// The coordinate system and origin of meshes, from `metadata.xml` or files of shifts.
struct ModelMetadata {
    /// Name of the file.
    file: String,
    /// Name of a coordinate system; empty if the file does not tell it.
    system: String,
    /// Place of their origin in it.
    origin: [f64; 3],
}

impl ModelMetadata {
    /// Of the nearest file; `None` if there is none, or it is of something else.
    fn of(source: &CitySource<'_>) -> Option<Self> {
        let ends = source.name.rmatch_indices('/').map(|(end, _)| end + 1).chain([0]);
        let metadata = ends.take(1 + FOLDERS_ABOVE).find_map(|end| {
            let name = format!("{}{METADATA_FILE}", source.name.get(..end)?);
            let bytes = read_sibling(&*source.files, &name, MAX_FILE_BYTES).ok()?;
            Self::parse(&String::from_utf8_lossy(&bytes))
        });
        metadata.or_else(|| {
            let MeshShift { file, system, origin } = MeshShift::of(source)?;
            Some(Self { file, system, origin })
        })
    }

    fn parse(text: &str) -> Option<Self> {
        let inner = |tag: &str| {
            let (_, rest) = text.split_once(&format!("<{tag}>"))?;
            Some(rest.split_once(&format!("</{tag}>"))?.0.trim())
        };
        let system = inner("SRS")?.replace("&quot;", "\"").replace("&apos;", "'").replace("&amp;", "&");
        let numbers = inner("SRSOrigin")?.split(',').map(|number| number.trim().parse::<f64>().ok());
        let origin: [f64; 3] = numbers.collect::<Option<Vec<f64>>>()?.try_into().ok()?;
        origin.iter().all(|number| number.is_finite()).then(|| Self { file: METADATA_FILE.to_owned(), system, origin })
    }

    /// `None` if the system is not known, or neither that of a map nor a place: heights of others may be of any kind.
    fn place(self) -> Option<(CrsReference, LocalFrame)> {
        let frame = LocalFrame { origin: self.origin, ..LocalFrame::IDENTITY };
        if let Some(reference) = self.around_place() {
            return Some((reference, frame));
        }
        let is_map = matches!(resolve(&self.system).ok()?.horizontal.system, System::Projected(_));
        is_map.then(|| (CrsReference::east_first(self.system), frame))
    }

    /// Metres east, north and up of a place on the ellipsoid, which these programs write as `ENU:LAT,LON`.
    fn around_place(&self) -> Option<CrsReference> {
        let (word, place) = self.system.split_at_checked(4)?;
        let (lat, lon) = place.split_once(',')?;
        let lat: f64 = lat.trim().parse().ok()?;
        let lon: f64 = lon.trim().parse().ok()?;
        let is_place = word.eq_ignore_ascii_case("ENU:") && lat.abs() <= 90.0 && lon.abs() <= 180.0;
        is_place.then(|| CrsReference::east_first(format!("ENU:{lon},{lat},0,ellipsoid")))
    }
}

/// Warning about a mesh whose `metadata.xml` or shift gives its place in an unsupported coordinate system, or in none.
pub fn unread_place(source: &CitySource<'_>) -> Option<String> {
    let ModelMetadata { file, system, origin: [x, y, z] } = ModelMetadata::of(source)?;
    let system = if system.is_empty() { "a coordinate system that it does not tell" } else { system.as_str() };
    Some(format!("{file} places its origin at {x}, {y}, {z} of {system}, which is not read; give --at LON,LAT,H"))
}

/// Coordinate system and frame of a mesh file: those of the file beside it, else `at`, else those of photogrammetry, else none. Fails if the
/// file beside it is invalid.
pub fn find(source: &CitySource<'_>, at: Option<[f64; 3]>) -> Result<Option<(CrsReference, LocalFrame)>, InputError> {
    let name = format!("{}{PLACE_FILE}", source.name);
    let label = format!("{}{PLACE_FILE}", source.label);
    let bytes = match read_sibling(&*source.files, &name, MAX_FILE_BYTES) {
        Ok(bytes) => bytes,
        // A store that may not be listed forbids what does not exist. A file that is there and cannot be read is not ignored.
        Err(error)
            if error.kind() == ErrorKind::NotFound
                || error.kind() == ErrorKind::PermissionDenied && is_address(&source.label) =>
        {
            let at = at.map(|at| (reference(at), LocalFrame::IDENTITY));
            return Ok(at.or_else(|| ModelMetadata::of(source)?.place()));
        }
        Err(error) => return Err(InputError::io(&label, error)),
    };
    let place: PlaceFile = serde_json::from_slice(&bytes).map_err(|error| InputError::json(&label, &error))?;
    let PlaceFile { lon, lat, height, heading, scale } = place;
    let is_place = lon.abs() <= 180.0 && lat.abs() <= 90.0 && height.is_finite();
    let is_frame = heading.is_finite() && scale.is_finite() && scale > 0.0;
    if !(is_place && is_frame) {
        return Err(InputError::unsupported(&label, "its numbers are out of range"));
    }
    let (sin, cos) = libm::sincos(heading.to_radians());
    let frame = LocalFrame { cos: cos * scale, sin: sin * scale, scale, ..LocalFrame::IDENTITY };
    Ok(Some((reference([lon, lat, height]), frame)))
}

/// Coordinate system and frame of a mesh by longitude, latitude and height of its origin, and by how much it is turned clockwise.
pub fn at(origin: [f64; 3], heading_deg: f64) -> (CrsReference, LocalFrame) {
    let (sin, cos) = libm::sincos(heading_deg.to_radians());
    (reference(origin), LocalFrame { cos, sin, ..LocalFrame::IDENTITY })
}

fn reference([lon, lat, height_m]: [f64; 3]) -> CrsReference {
    CrsReference::east_first(format!("ENU:{lon},{lat},{height_m}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::source::embedded;

    #[test]
    fn a_file_beside_a_mesh_comes_before_the_option() {
        let place = br#"{"lon": 11.5, "lat": 48, "height": 500, "heading": 90, "scale": 2}"#;
        let files: [(&str, &[u8]); 3] = [("a.stl", b""), ("b.stl", b""), ("a.stl.place.json", place)];
        let sources = embedded(&files);
        assert_eq!(sources.len(), 2, "the file that places is no source");
        let (reference, frame) = find(&sources[0], Some([1.0, 2.0, 3.0])).unwrap().unwrap();
        assert_eq!(reference.name, "ENU:11.5,48,500");
        // What points north in the file points east.
        let east = frame.apply([0.0, 1.0, 1.0]);
        assert!((east[0] - 2.0).abs() < 1e-12 && east[1].abs() < 1e-12 && east[2] == 2.0, "{east:?}");
        assert_eq!(LocalFrame::IDENTITY.with_y_up().apply([1.0, 2.0, 3.0]), [1.0, -3.0, 2.0]);
        let (reference, frame) = find(&sources[1], Some([1.0, 2.0, 3.0])).unwrap().unwrap();
        assert_eq!((reference.name.as_str(), frame), ("ENU:1,2,3", LocalFrame::IDENTITY));
        assert_eq!(find(&sources[1], None).unwrap(), None);
    }

    #[test]
    fn metadata_of_photogrammetry_places_meshes() {
        let of = |srs: &str| {
            let origin = "<SRSOrigin>566000, 5932000,-1.5</SRSOrigin>";
            format!("<ModelMetadata version=\"1\">\n<SRS>{srs}</SRS>\n{origin}</ModelMetadata>")
        };
        let placed = |srs: &str, at: Option<[f64; 3]>| {
            let metadata = of(srs);
            let files: [(&str, &[u8]); 2] =
                [("out/Data/Tile_1/Tile_1.obj", b""), ("out/metadata.xml", metadata.as_bytes())];
            let sources = embedded(&files);
            let mesh = sources.iter().find(|source| source.name.ends_with(".obj")).unwrap();
            (find(mesh, at).unwrap(), unread_place(mesh))
        };
        let (found, _) = placed("EPSG:25832", None);
        let (reference, frame) = found.unwrap();
        assert_eq!(
            (reference.name.as_str(), frame.apply([1.0, 2.0, 3.0])),
            ("EPSG:25832", [566_001.0, 5_932_002.0, 1.5])
        );
        let (found, _) = placed("ENU:53.5, 9.9", None);
        let (reference, frame) = found.unwrap();
        assert_eq!((reference.name.as_str(), frame.origin[2]), ("ENU:9.9,53.5,0,ellipsoid", -1.5));
        let (found, unread) = placed("ENU:153.5,9.9", None);
        assert!(found.is_none() && unread.is_some_and(|text| text.contains("566000, 5932000, -1.5 of ENU:153.5,9.9")));
        let (found, _) = placed("EPSG:25832", Some([1.0, 2.0, 3.0]));
        assert_eq!(found.unwrap().0.name, "ENU:1,2,3");
        assert!(ModelMetadata::parse("<gmd:MD_Metadata/>").is_none());
    }

    #[test]
    fn shifts_of_photogrammetry_place_meshes() {
        let files: [(&str, &[u8]); 3] =
            [("m.obj", b""), ("m_offset.xyz", b"566000 5932000 12.5"), ("m.prj", b"EPSG:25832")];
        let (reference, frame) = find(&embedded(&files)[0], None).unwrap().unwrap();
        assert_eq!((reference.name.as_str(), frame.origin), ("EPSG:25832", [566_000.0, 5_932_000.0, 12.5]));
        let sources = embedded(&files[..2]);
        let without = &sources[0];
        assert_eq!(find(without, None).unwrap(), None);
        assert!(unread_place(without).is_some_and(|text| text.contains("m_offset.xyz") && text.contains("not tell")));
    }

    #[test]
    fn an_invalid_place_is_an_error() {
        for text in [r#"{"lon": 1, "lat": 2}"#, r#"{"lon": 1, "lat": 92, "height": 0}"#, "{", r#"{"x": 1}"#] {
            let files: [(&str, &[u8]); 2] = [("a.stl", b""), ("a.stl.place.json", text.as_bytes())];
            assert!(find(&embedded(&files)[0], None).is_err(), "{text}");
        }
    }
}
