//! Where a picture is taken: a camera, a place in degrees, or the first view of the city.

use crate::args::{StreetPlace, Target, ViewpointArgs};
use crate::camera_files::{PlacedCamera, given_camera};
use crate::error::{ClientError, Result};
use crate::session::Session;
use glam::DVec2;
use insula_command_line::camera::place_in_city;
use insula_protocol::Manifest;
use insula_protocol::earth::north_deg;
use insula_viewer::camera::Camera;
use insula_viewer::collision::EYE_HEIGHT_M;
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

/// The camera of `--camera`, or else `linked` of a view link; `None` if the options name a place instead. Fails if a file cannot be read.
pub fn chosen_camera(args: &ViewpointArgs, linked: Option<Camera>) -> Result<Option<PlacedCamera>> {
    match &args.camera {
        Some(given) => given_camera(given).map(Some),
        None if args.at_street.is_some() || args.lookat.is_some() => Ok(None),
        None => Ok(linked.map(PlacedCamera::from)),
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
    let north_deg = north_deg(manifest, street.place_deg).unwrap_or_default();
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
fn place_in(manifest: &Manifest, option: &str, place_deg: [f64; 2]) -> Result<DVec2> {
    place_in_city(manifest, option, place_deg, MARGIN_M).map(DVec2::from).map_err(ClientError::Usage)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use insula_protocol::manifest::GeoLocation;
    use insula_test_support::small_city::empty_manifest;

    fn delft() -> Manifest {
        let location = GeoLocation { longitude_deg: 4.3571, latitude_deg: 52.0116, north_deg: 0.81 };
        let (focus, bounds) =
            ([[84_000.0, 446_000.0], [86_000.0, 448_000.0]], [[84_000.0, 446_000.0, 0.0], [86_000.0, 448_000.0, 90.0]]);
        Manifest { location: Some(location), focus, bounds, ..empty_manifest(0) }
    }

    fn camera(args: ViewpointArgs) -> Result<Camera> {
        match chosen_camera(&args, None)? {
            Some(camera) => Ok(camera.in_city(&delft())?.1),
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
        assert!(error.contains("use a camera file"), "{error}");
    }

    #[test]
    fn a_text_is_a_camera_and_nothing_is_the_first_view() {
        let of = |text: &str| camera(ViewpointArgs { camera: Some(text.into()), ..ViewpointArgs::default() });
        let typed = of("4.3571,52.0116,80,45,-10").unwrap();
        assert_eq!(typed.position, DVec3::new(85_000.0, 447_000.0, 80.0));
        assert!((typed.azimuth_deg() - 45.81).abs() < 1e-6 && (typed.fov_y_rad.to_degrees() - 60.0).abs() < 1e-9);
        let linked = of("camera=84500,446500,80,45,-10,60").unwrap();
        assert_eq!(linked.position, DVec3::new(84_500.0, 446_500.0, 80.0));
        for (wrong, why) in
            [("84500,446500,80,45,-10,60", "camera=X,Y,Z"), ("camera=4.36,52.01,80,45,-10,60", "in degrees")]
        {
            let error = of(wrong).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        }
        let first = camera(ViewpointArgs::default()).unwrap();
        assert_eq!(first, Camera::overview(&delft(), 640.0 / 360.0));
        let of_link = chosen_camera(&ViewpointArgs::default(), Some(linked)).unwrap();
        assert_eq!(of_link.and_then(PlacedCamera::known), Some(linked));
        // A place comes before the camera of a link.
        let target = Some(Target { place_deg: [4.3571, 52.0116], height_m: 30.0 });
        let args = ViewpointArgs { lookat: target, ..ViewpointArgs::default() };
        assert_eq!(chosen_camera(&args, Some(linked)).unwrap(), None);
    }
}
