//! Where a picture is taken: a camera file, a place in degrees, or the first view of the city.

use crate::args::{StreetPlace, Target, ViewpointArgs};
use crate::camera_files::read_camera;
use crate::error::{ClientError, Result};
use crate::session::Session;
use glam::DVec2;
use insula_protocol::Manifest;
use insula_viewer::camera::Camera;
use insula_viewer::collision::EYE_HEIGHT_M;
use insula_viewer::earth::grid_position;
use std::f64::consts::FRAC_PI_2;

/// Eyes on streets look a little up, to where houses are.
const STREET_PITCH_DEG: f64 = 5.0;
const STREET_FOV_DEG: f64 = 60.0;
/// Distance of a camera that looks at a place, and how high it stands above the horizon.
const TARGET_DISTANCE_M: f64 = 250.0;
const TARGET_ELEVATION_DEG: f64 = 30.0;
const TARGET_FOV_DEG: f64 = 40.0;
/// A place may lie so far beyond the city's bounds.
const MARGIN_M: f64 = 2000.0;

/// The camera of `--camera`, or else `linked` of a view link; `None` if the city has to be known. Fails if a file cannot be read.
pub fn given_camera(args: &ViewpointArgs, linked: Option<Camera>) -> Result<Option<Camera>> {
    match &args.camera {
        Some(given) => read_camera(given).map(Some),
        None if args.at_street.is_some() || args.lookat.is_some() => Ok(None),
        None => Ok(linked),
    }
}

/// The camera at the place of the options, or else the first view. Eyes on streets stand at height zero: see [`stand_on_ground`].
/// Fails if the place is not in the city.
pub fn camera_in(args: &ViewpointArgs, manifest: &Manifest, size_px: [u32; 2]) -> Result<Camera> {
    match (args.at_street, args.lookat) {
        (Some(street), _) => street_view(street, manifest),
        (None, Some(target)) => view_of(target, manifest),
        (None, None) => {
            let aspect = f64::from(size_px[0].max(1)) / f64::from(size_px[1].max(1));
            Ok(Camera::overview(manifest, aspect))
        }
    }
}

/// Puts an eye that stands on a street on the ground that the resident tiles have. Below a bridge it stays there; on a house it
/// stands on the roof.
pub fn stand_on_ground(camera: Camera, session: &Session) -> Camera {
    let manifest = session.tree().manifest();
    let below_all = camera.position.with_z(manifest.bounds[0][2].min(manifest.ground_z_m) - 1.0);
    let ground_m = session.solids().free_height_above(below_all).max(manifest.ground_z_m);
    Camera { position: camera.position.with_z(ground_m + EYE_HEIGHT_M), ..camera }
}

/// The camera above what it is inside of, or below; `None` if it is outside.
pub fn lifted_out(camera: Camera, session: &Session) -> Option<Camera> {
    let z = session.solids().lifted_eye_z(camera.position)?;
    Some(Camera { position: camera.position.with_z(z), ..camera })
}

fn street_view(street: StreetPlace, manifest: &Manifest) -> Result<Camera> {
    let place = place_in(manifest, "--at-street", street.place_deg)?;
    // Clockwise from true north, which is turned against the grid's.
    let north_deg = manifest.location.map_or(0.0, |location| location.north_deg);
    let yaw_rad = (90.0 - street.heading_deg - north_deg).to_radians();
    let position = place.extend(0.0);
    Ok(Camera::from_angles(position, yaw_rad, STREET_PITCH_DEG.to_radians(), STREET_FOV_DEG.to_radians()))
}

fn view_of(target: Target, manifest: &Manifest) -> Result<Camera> {
    let place = place_in(manifest, "--lookat", target.place_deg)?.extend(target.height_m);
    let yaw_rad = if target.place_deg[1] < 0.0 { -FRAC_PI_2 } else { FRAC_PI_2 };
    let fov_y_rad = TARGET_FOV_DEG.to_radians();
    let camera = Camera::from_angles(place, yaw_rad, -TARGET_ELEVATION_DEG.to_radians(), fov_y_rad);
    Ok(Camera { position: place - camera.forward * TARGET_DISTANCE_M, ..camera })
}

/// World x and y of a place in degrees. Fails if it is not in the city or near it.
fn place_in(manifest: &Manifest, option: &str, [lon, lat]: [f64; 2]) -> Result<DVec2> {
    let place = grid_position(manifest, [lon, lat]).ok_or_else(|| {
        ClientError::Usage(format!("{option}: it is not known where on Earth this city lies: use --camera"))
    })?;
    let [low, high] = manifest.bounds.map(|corner| DVec2::new(corner[0], corner[1]));
    let off_m = (low - place).max(place - high).max(DVec2::ZERO).length();
    if off_m <= MARGIN_M {
        return Ok(place);
    }
    let middle = manifest.location.map_or(String::new(), |location| {
        format!(" around {:.4},{:.4}", location.longitude_deg, location.latitude_deg)
    });
    Err(ClientError::Usage(format!(
        "{option} {lon},{lat}: {:.0} km from the city, which lies{middle}: write longitude first",
        off_m / 1000.0
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use insula_command_line::camera::degrees_fault;
    use insula_protocol::manifest::GeoLocation;
    use insula_test_support::small_city::empty_manifest;

    fn delft() -> Manifest {
        let location = GeoLocation { longitude_deg: 4.3571, latitude_deg: 52.0116, north_deg: 0.81 };
        let (focus, bounds) =
            ([[84_000.0, 446_000.0], [86_000.0, 448_000.0]], [[84_000.0, 446_000.0, 0.0], [86_000.0, 448_000.0, 90.0]]);
        Manifest { location: Some(location), focus, bounds, ..empty_manifest(0) }
    }

    fn camera(args: ViewpointArgs) -> Result<Camera> {
        match given_camera(&args, None)? {
            Some(camera) => Ok(camera),
            None => camera_in(&args, &delft(), [640, 360]),
        }
    }

    #[test]
    fn places_in_degrees_become_cameras() {
        let street = StreetPlace { place_deg: [4.3571, 52.0116], heading_deg: 90.0 };
        let east = camera(ViewpointArgs { at_street: Some(street), ..ViewpointArgs::default() }).unwrap();
        assert_eq!(east.position, DVec3::new(85_000.0, 447_000.0, 0.0));
        // True north is clockwise of the grid's, and so is true east.
        assert!((east.azimuth_deg() - 90.81).abs() < 1e-6, "{}", east.azimuth_deg());
        let target = Target { place_deg: [4.3571, 52.0116], height_m: 30.0 };
        let view = camera(ViewpointArgs { lookat: Some(target), ..ViewpointArgs::default() }).unwrap();
        let seen = view.position + view.forward * TARGET_DISTANCE_M;
        assert!(seen.distance(DVec3::new(85_000.0, 447_000.0, 30.0)) < 1e-6, "{seen}");
        assert!(view.position.z > 100.0 && view.azimuth_deg() < 1e-6);
    }

    #[test]
    fn other_places_and_unknown_cities_are_errors() {
        let swapped = StreetPlace { place_deg: [52.0116, 4.3571], heading_deg: 0.0 };
        let args = ViewpointArgs { at_street: Some(swapped), ..ViewpointArgs::default() };
        let error = camera(args.clone()).unwrap_err().to_string();
        assert!(error.contains("km from the city") && error.contains("4.3571,52.0116"), "{error}");
        let unknown = Manifest { location: None, ..delft() };
        let error = camera_in(&args, &unknown, [640, 360]).unwrap_err().to_string();
        assert!(error.contains("use --camera"), "{error}");
    }

    #[test]
    fn cameras_in_degrees_are_told() {
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
    fn a_text_is_a_camera_and_nothing_is_the_first_view() {
        let text = Some("84500,446500,80,45,-10,60".into());
        let typed = camera(ViewpointArgs { camera: text, ..ViewpointArgs::default() }).unwrap();
        assert_eq!(typed.position, DVec3::new(84_500.0, 446_500.0, 80.0));
        let first = camera(ViewpointArgs::default()).unwrap();
        assert_eq!(first, Camera::overview(&delft(), 640.0 / 360.0));
        assert_eq!(given_camera(&ViewpointArgs::default(), Some(typed)).unwrap(), Some(typed));
        // A place comes before the camera of a link.
        let target = Some(Target { place_deg: [4.3571, 52.0116], height_m: 30.0 });
        let args = ViewpointArgs { lookat: target, ..ViewpointArgs::default() };
        assert_eq!(given_camera(&args, Some(typed)).unwrap(), None);
    }
}
