//! Cameras as options of commands give them, and what commands say of them.

use insula_protocol::Manifest;
use insula_protocol::earth::{grid_position, north_deg};
use std::path::{Path, PathBuf};

/// How a person types a camera, and how links have it.
const TYPED: &str = "LON,LAT,HEIGHT,HEADING,PITCH or LON,LAT,HEIGHT,HEADING,PITCH,FOV";
const OF_LINKS: &str = "camera=X,Y,Z,AZIMUTH,PITCH,FOV";
/// What a camera has that does not say it, as camera files have.
const DEFAULT_FOV_DEG: f64 = 60.0;
/// Largest absolute value of a coordinate.
const MAX_COORDINATE_M: f64 = 1e10;
/// A camera stands so far beyond the city's bounds, besides a diagonal of them.
const CAMERA_MARGIN_M: f64 = 10_000.0;

/// The value of an option of a camera.
#[derive(Debug, Clone, PartialEq)]
pub enum GivenCamera {
    /// As a person types it.
    OnEarth(EarthCamera),
    /// As links have it: see [`EarthCamera::in_city`].
    InCity([f64; 6]),
    /// The name of a camera file.
    File(PathBuf),
}

impl GivenCamera {
    /// What a value means. Fails with what to write if it is neither a camera nor the name of a file.
    pub fn parse(value: &Path) -> Result<Self, String> {
        let text = value.to_string_lossy();
        if let Some(camera) = of_link(&text) {
            return Ok(Self::InCity(camera));
        }
        let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        match numbers.filter(|numbers| numbers.len() > 1) {
            Some(numbers) => EarthCamera::of_numbers(&numbers).map(Self::OnEarth).ok_or_else(|| wrong(&text, &numbers)),
            None if text.contains(',') && !value.exists() => Err(wrong(&text, &[])),
            None => Ok(Self::File(value.to_owned())),
        }
    }
}

/// Why a text is no camera, and what to write.
fn wrong(text: &str, numbers: &[f64]) -> String {
    let metres = format!("metres of the city's system are written {OF_LINKS}, as links have them");
    match *numbers {
        [x, y, ..] if x.abs() > 180.0 || y.abs() > 90.0 => {
            format!("--camera {text}: {x},{y} is no place in degrees: write {TYPED}; {metres}")
        }
        _ => format!(
            "--camera {text}: write {TYPED}, in degrees but for the height, with a pitch of -90 to 90 and a field of view of 1 to 170, or name a camera file; {metres}"
        ),
    }
}

/// The numbers after `camera=` in a link, an address or a part of them, as [`EarthCamera::in_city`] has them; `None` without a valid camera.
#[must_use]
pub fn of_link(text: &str) -> Option<[f64; 6]> {
    let value = text.split_once("camera=")?.1.split(['&', '#']).next()?.replace("%2C", ",");
    let numbers: Vec<f64> = value.split(',').map(|number| number.trim().parse().ok()).collect::<Option<_>>()?;
    let [x, y, z, azimuth_deg, pitch_deg, fov_deg] = numbers[..] else { return None };
    let is_camera =
        [x, y, z].iter().all(|v| v.abs() < MAX_COORDINATE_M) && is_direction(azimuth_deg, pitch_deg, fov_deg);
    is_camera.then_some([x, y, z, azimuth_deg, pitch_deg, fov_deg])
}

fn is_direction(heading_deg: f64, pitch_deg: f64, fov_deg: f64) -> bool {
    heading_deg.is_finite() && (-90.0..=90.0).contains(&pitch_deg) && (1.0..=170.0).contains(&fov_deg)
}

/// A camera by its place on Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EarthCamera {
    /// Longitude and latitude.
    pub place_deg: [f64; 2],
    /// In the city's heights.
    pub height_m: f64,
    /// Clockwise from true north.
    pub heading_deg: f64,
    /// Above the horizon.
    pub pitch_deg: f64,
    /// Vertical field of view.
    pub fov_deg: f64,
}

impl EarthCamera {
    /// The camera of five or six numbers; `None` if they are none.
    #[must_use]
    pub fn of_numbers(numbers: &[f64]) -> Option<Self> {
        let (&[longitude, latitude, height_m, heading_deg, pitch_deg], rest) = numbers.split_first_chunk()?;
        let fov_deg = match *rest {
            [] => DEFAULT_FOV_DEG,
            [fov_deg] => fov_deg,
            _ => return None,
        };
        let is_place = (-180.0..=180.0).contains(&longitude) && (-90.0..=90.0).contains(&latitude);
        let is_camera = is_place && height_m.abs() < MAX_COORDINATE_M && is_direction(heading_deg, pitch_deg, fov_deg);
        is_camera.then_some(Self { place_deg: [longitude, latitude], height_m, heading_deg, pitch_deg, fov_deg })
    }

    /// The camera as `X,Y,Z,AZIMUTH,PITCH,FOV`: metres of the city's system, and degrees, the azimuth clockwise from the grid's north.
    /// Fails if it is not known where the city lies, and if the camera is far from it.
    pub fn in_city(&self, manifest: &Manifest) -> Result<[f64; 6], String> {
        let [low, high] = manifest.bounds;
        let margin_m = CAMERA_MARGIN_M + (high[0] - low[0]).hypot(high[1] - low[1]);
        let [x, y] = place_in_city(manifest, "--camera", self.place_deg, margin_m)?;
        let north_deg = north_deg(manifest, self.place_deg).unwrap_or_default();
        Ok([x, y, self.height_m, self.heading_deg + north_deg, self.pitch_deg, self.fov_deg])
    }
}

/// World x and y of a place in degrees that an option names. Fails if it is not known where the city lies, and if the place is further
/// from the city than a margin.
pub fn place_in_city(
    manifest: &Manifest,
    option: &str,
    [longitude, latitude]: [f64; 2],
    margin_m: f64,
) -> Result<[f64; 2], String> {
    let place = grid_position(manifest, [longitude, latitude]).ok_or_else(|| {
        format!(
            "{option}: it is not known where on Earth this city lies: use a camera file, or --camera {OF_LINKS} in metres of its system"
        )
    })?;
    let [low, high] = manifest.bounds;
    let [east_m, north_m] = [0, 1].map(|axis| (low[axis] - place[axis]).max(place[axis] - high[axis]).max(0.0));
    let off_m = east_m.hypot(north_m);
    if off_m <= margin_m {
        return Ok(place);
    }
    let middle = manifest.location.map_or(String::new(), |location| {
        format!(" around {:.4},{:.4}", location.longitude_deg, location.latitude_deg)
    });
    Err(format!(
        "{option} {longitude},{latitude}: {:.0} km from the city, which lies{middle}: write longitude first",
        off_m / 1000.0
    ))
}

/// Numbers so near to the place of a city, in degrees, are a place in it.
const NEAR_DEG: f64 = 1.0;
/// A camera that lies no further from a city, in metres, may be meant so.
const FAR_M: f64 = 10_000.0;

/// Says that the first two numbers of a camera file or of a link are degrees, in either order, where metres are meant; `None` if they are
/// not.
pub fn degrees_fault(manifest: &Manifest, [x, y]: [f64; 2]) -> Option<String> {
    let [low, high] = manifest.bounds;
    let is_far = (0..2).any(|k| !(low[k] - FAR_M..=high[k] + FAR_M).contains(&[x, y][k]));
    let place = manifest.location?;
    let is_near = |longitude: f64, latitude: f64| {
        (longitude - place.longitude_deg).abs() <= NEAR_DEG && (latitude - place.latitude_deg).abs() <= NEAR_DEG
    };
    let system = manifest.crs.as_deref().unwrap_or("the city");
    let [middle_x, middle_y] = [0, 1].map(|k| (low[k] + high[k]) / 2.0);
    (is_far && (is_near(x, y) || is_near(y, x))).then(|| {
        format!(
            "the camera at {x},{y} is in degrees: files and links have metres of {system}, the middle of the city is {middle_x:.0},{middle_y:.0}; degrees are written --camera {TYPED}"
        )
    })
}

/// Says that a camera is inside of a building or below the ground, and whether it stays there or is lifted by so many metres.
pub fn inside_note(is_kept: bool, up_m: f64) -> String {
    let inside = "the camera is inside of a building or below the ground";
    if is_kept { inside.to_owned() } else { format!("{inside}: lifted by {up_m:.1} m; --keep-camera keeps it") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::manifest::GeoLocation;

    fn delft() -> Manifest {
        let location = GeoLocation { longitude_deg: 4.3571, latitude_deg: 52.0116, north_deg: 0.81 };
        let (focus, bounds) =
            ([[84_000.0, 446_000.0], [86_000.0, 448_000.0]], [[84_000.0, 446_000.0, 0.0], [86_000.0, 448_000.0, 90.0]]);
        Manifest { location: Some(location), focus, bounds, ..Manifest::default() }
    }

    fn parse(text: &str) -> Result<GivenCamera, String> {
        GivenCamera::parse(Path::new(text))
    }

    #[test]
    fn people_type_degrees_and_links_have_metres() {
        let camera = EarthCamera {
            place_deg: [-70.5, -33.25],
            height_m: 30.0,
            heading_deg: 90.0,
            pitch_deg: -10.0,
            fov_deg: DEFAULT_FOV_DEG,
        };
        assert_eq!(parse("-70.5, -33.25,30,90,-10"), Ok(GivenCamera::OnEarth(camera)));
        let narrow = EarthCamera { fov_deg: 40.0, ..camera };
        assert_eq!(parse("-70.5,-33.25,30,90,-10,40"), Ok(GivenCamera::OnEarth(narrow)));
        let numbers = [84_500.0, 446_500.0, 80.0, 45.0, -10.0, 60.0];
        for link in [
            "camera=84500,446500,80,45,-10,60",
            "insula://h/v1/cities/a?camera=84500%2C446500%2C80%2C45%2C-10%2C60&time=2024-06-21T12:00",
            "http://h/cities/a#camera=84500,446500,80,45,-10,60&object=7",
        ] {
            assert_eq!(parse(link), Ok(GivenCamera::InCity(numbers)), "{link}");
        }
        assert_eq!(parse("camera.json"), Ok(GivenCamera::File("camera.json".into())));
    }

    #[test]
    fn what_is_no_camera_is_refused_with_what_to_write() {
        let metres = parse("84500,446500,80,45,-10,60").unwrap_err();
        assert!(metres.contains("84500,446500 is no place in degrees") && metres.contains(OF_LINKS), "{metres}");
        for text in ["4.36,52.01", "4.36,52.01,80,45,-100", "4.36,52.01,80,45,0,0", "4.36,52.01,80,45,0,60,7", "4.36,x"]
        {
            let error = parse(text).unwrap_err();
            assert!(error.contains(TYPED) && error.contains(text), "{error}");
        }
        for text in ["camera=1,2,3", "camera=1,2,3,0,91,60", "camera=1,2,inf,0,0,60", "nan,2,3,0,0"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn cameras_on_earth_become_those_of_a_city() {
        let typed = EarthCamera::of_numbers(&[4.3571, 52.0116, 30.0, 90.0, -10.0]).unwrap();
        let [x, y, z, azimuth, pitch, fov] = typed.in_city(&delft()).unwrap();
        assert_eq!([x, y, z, pitch, fov], [85_000.0, 447_000.0, 30.0, -10.0, 60.0]);
        // True north is clockwise of the grid's.
        assert!((azimuth - 90.81).abs() < 1e-6, "{azimuth}");
        // From beside the city.
        assert!(EarthCamera { place_deg: [4.25, 52.0116], ..typed }.in_city(&delft()).is_ok());
        let error = EarthCamera { place_deg: [52.0116, 4.3571], ..typed }.in_city(&delft()).unwrap_err();
        assert!(error.contains("km from the city") && error.contains("4.3571,52.0116"), "{error}");
        let error = typed.in_city(&Manifest { location: None, ..delft() }).unwrap_err();
        assert!(error.contains("use a camera file"), "{error}");
    }

    #[test]
    fn degrees_where_metres_are_meant_are_told() {
        let fault = |x, y| degrees_fault(&delft(), [x, y]);
        for [x, y] in [[4.36, 52.01], [52.01, 4.36]] {
            let text = fault(x, y).unwrap();
            assert!(text.contains(&format!("{x},{y}")) && text.contains("85000,447000"), "{text}");
        }
        // Another place, the city itself, one whose metres begin at zero, and one of an unknown place.
        assert_eq!((fault(14.36, 52.01), fault(84_500.0, 446_500.0)), (None, None));
        let local = Manifest { bounds: [[0.0; 3], [900.0, 900.0, 9.0]], ..delft() };
        assert_eq!(degrees_fault(&local, [4.36, 52.01]), None);
        assert_eq!(degrees_fault(&Manifest { location: None, ..delft() }, [4.36, 52.01]), None);
    }

    #[test]
    fn a_lift_is_told_in_metres() {
        assert!(inside_note(false, 4.72).ends_with("ground: lifted by 4.7 m; --keep-camera keeps it"));
        assert!(inside_note(true, 4.72).ends_with("below the ground"));
    }
}
