//! Frames from a server without faults.

use super::fixture_city::{GROUND_M, MESH_M, ORIGIN, ROOF_M, city, city_files, city_with_meshes};
use super::test_server::{Reply, TestServer};
use super::viewers::{CENTRE, SimulatedViewer, draw_until_settled, global_args, open_session, request, settle, street};
use glam::DVec3;
use insula_client::commands::connect;
use insula_client::session::Session;
use insula_client::stream::fetch::Http;
use insula_protocol::route;
use insula_shaders::layout::Shading;
use insula_viewer::camera::Camera;
use insula_viewer::frame::RenderSettings;
use insula_viewer::interaction::camera_control::{CameraControl, MoveDirection};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

/// The settled frame of [`street`].
pub(crate) static REFERENCE: LazyLock<Vec<u32>> =
    LazyLock::new(|| draw_until_settled(&mut open_session(&TestServer::start(city()), 64)));

/// Number of requests for single tiles. How many groups are asked for before the first refusal depends on the machine.
fn tile_requests(server: &TestServer) -> u32 {
    server.log().iter().filter(|(path, _)| !path.contains("/groups/")).map(|(_, count)| count).sum()
}

#[test]
fn converges_and_measures_distances_in_metres() {
    let server = TestServer::start(city());
    let mut session = open_session(&server, 64);
    // Straight down, 100 m above the middle (12, 12) of the roof of the building at (80, 80).
    let down = request([92.0, 92.0, ROOF_M + 100.0], [92.0, 92.0, 0.0]);
    settle(&mut session, &down, |_| {});
    let pixels = session.draw(&down, &RenderSettings::default()).unwrap();
    settle(&mut session, &down, |_| {});
    let centre = pixels.distance[CENTRE];
    assert!((centre - 100.0).abs() < 0.6, "{centre}");
    // The longest rays end on the ground between buildings at the frame's edge.
    let far = pixels.distance.iter().filter(|d| d.is_finite()).copied().fold(0.0f32, f32::max);
    assert!(f64::from(far) > 100.0 + ROOF_M - GROUND_M - 1.0, "{far}");
    let report = session.report(1.0);
    let times = [report.time_to_first_picture_secs, report.time_to_near_picture_secs];
    assert!(times[0].is_some() && times[0] == times[1], "{report:?}");
    assert!(report.time_to_converged_picture_secs.is_some(), "{report:?}");
    assert_eq!(report.requests, u64::from(server.requests()));
    assert_eq!((report.tiles.subtrees, report.tiles.bad), (1, 0));
}

#[test]
fn each_frame_is_finer_and_every_tile_is_fetched_once() {
    let server = TestServer::start(city());
    let mut session = open_session(&server, 64);
    let mut worst = f64::INFINITY;
    settle(&mut session, &street(), |session| {
        let counters = session.selection().stats;
        if counters.drawn > 0 {
            assert!(counters.worst_error_px <= worst);
            worst = counters.worst_error_px;
        }
    });
    let counters = session.selection().stats;
    assert!(counters.drawn > 10, "{counters:?}");
    let log = server.log();
    assert!(log.values().all(|count| *count == 1), "{log:?}");
}

#[test]
fn cross_fades_end_in_the_same_frame() {
    let [server, plain] = [(), ()].map(|()| TestServer::start(city()));
    let mut viewer = SimulatedViewer::new(&server, 64);
    viewer.streamer.set_transitions(true);
    let mut fading_frames = 0;
    viewer.draw_until(|streamer| {
        let areas = streamer.transitions().tiles();
        let fading = areas.iter().filter(|shown| shown.sources().1.is_some()).count();
        let nodes = streamer.frame_data(&street(), &RenderSettings::default()).nodes.len();
        assert!(nodes >= areas.len() + fading, "{nodes} nodes, {fading} areas that fade between two of them");
        fading_frames += usize::from(fading > 0);
        streamer.is_settled()
    });
    assert!(fading_frames > 0, "no frame showed two levels of an area");
    assert_eq!(viewer.streamer.transitions().fading_count(), 0);
    assert_eq!(viewer.draw_until_settled(), *REFERENCE);
    assert_eq!(SimulatedViewer::new(&plain, 64).draw_until_settled(), *REFERENCE);
    let (found, expected) = (tile_requests(&server), tile_requests(&plain));
    assert!(found < expected * 5 / 4 + 4, "{found} requests, {expected} without cross-fades");
}

#[test]
fn near_leaves_are_meshes_unless_the_mesh_is_bad() {
    let down = request([92.0, 92.0, MESH_M + 60.0], [92.0, 92.0, 0.0]);
    let centre = |session: &mut Session| {
        let settings = RenderSettings { shading: Shading::Albedo, ..RenderSettings::default() };
        let pixels = session.draw(&down, &settings).unwrap();
        (pixels.distance[CENTRE], pixels.colour[CENTRE])
    };
    let server = TestServer::start(city_with_meshes());
    let mut session = open_session(&server, 64);
    settle(&mut session, &down, |_| {});
    let (distance_m, colour) = centre(&mut session);
    assert!((distance_m - 60.0).abs() < 0.05, "{distance_m}");
    let difference = colour.to_le_bytes().iter().zip([200u8, 10, 20]).map(|(a, b)| a.abs_diff(b)).max().unwrap();
    assert!(difference <= 4, "{colour:08x}");
    let report = session.report(1.0);
    assert!(report.meshes_drawn > 0 && report.tiles.meshes >= u64::from(report.meshes_drawn), "{report:?}");
    assert_eq!(report.triangles_drawn, 12 * u64::from(report.meshes_drawn));
    for reply in [Reply::Damaged, Reply::Status(404)] {
        let policy = move |path: &str, _: u32| if path.contains("/meshes/") { reply } else { Reply::Intact };
        let server = TestServer::with_policy(city_with_meshes(), policy);
        let mut session = open_session(&server, 64);
        settle(&mut session, &down, |_| {});
        let (distance_m, _) = centre(&mut session);
        assert!((f64::from(distance_m) - (60.0 + MESH_M - ROOF_M)).abs() < 0.6, "{distance_m}");
        assert!(session.report(1.0).tiles.bad > 0 && session.selection().stats.meshes == 0);
    }
}

#[test]
fn resident_tiles_say_where_the_city_is_solid() {
    let street = request([31.0, 60.0, 5.0], [31.0, 200.0, 5.0]);
    let server = TestServer::start(city());
    let mut session = open_session(&server, 64);
    let origin = DVec3::from(ORIGIN);
    assert!(!session.solids().is_inside(origin + DVec3::new(10.0, 50.0, 5.0)), "nothing is resident");
    settle(&mut session, &street, |_| {});
    let solids = session.solids();
    let ground_m = solids.ground_below(street.camera.position).unwrap();
    assert!((ground_m - GROUND_M).abs() < 0.1 && !solids.is_inside(street.camera.position), "{ground_m}");
    let room = origin + DVec3::new(10.0, 90.0, 5.0);
    assert!(solids.is_inside(room) && (solids.free_height_above(room) - ROOF_M).abs() < 0.1);
    let wall = solids.hit_on_way(street.camera.position, origin + DVec3::new(10.0, 90.0, 5.0)).unwrap() - origin;
    assert!((wall.x - 24.0).abs() < 0.1 || (wall.y - 80.0).abs() < 0.1, "{wall}");
    // A mesh fills a leaf but for 2 m at its border.
    let server = TestServer::start(city_with_meshes());
    let mut session = open_session(&server, 64);
    settle(&mut session, &request([31.0, 60.0, 25.0], [31.0, 70.0, 19.0]), |_| {});
    let solids = session.solids();
    let roof_m = solids.free_height_above(origin + DVec3::new(31.0, 50.0, 5.0));
    assert!((roof_m - MESH_M).abs() < 0.02, "{roof_m}");
}

#[test]
fn one_of_several_cities_must_be_named() {
    let mut files = city_files("one");
    files.extend(city_files("two"));
    files.insert(route::CITIES.into(), br#"[{"name":"one"},{"name":"two"}]"#.to_vec());
    let server = TestServer::start(Arc::new(files));
    let http = Arc::new(Http::new(None).unwrap());
    let mut global = global_args();
    assert_eq!(connect(&http, &server.url, &global).unwrap_err().exit_code(), 2);
    global.city = Some("two".into());
    assert_eq!(connect(&http, &server.url, &global).unwrap().manifest.name, "two");
    let one = format!("{}/v1/cities/one", server.url);
    assert_eq!(connect(&http, &one, &global).unwrap_err().exit_code(), 2, "the address and --city disagree");
    global.city = None;
    assert_eq!(connect(&http, &one, &global).unwrap().manifest.name, "one");
    global.city = Some("three".into());
    assert_eq!(connect(&http, &server.url, &global).unwrap_err().exit_code(), 1);
}

#[test]
fn a_person_walks_on_the_ground_and_stops_at_walls() {
    let server = TestServer::start(city());
    let mut session = open_session(&server, 64);
    settle(&mut session, &street(), |_| {});
    let solids = session.solids();
    let at = |x: f64, y: f64, z: f64| DVec3::from(ORIGIN) + DVec3::new(x, y, z);
    // South of the building at (80, 80), facing north, ten metres up.
    let start = Camera::from_angles(at(92.0, 60.0, GROUND_M + 10.0), std::f64::consts::FRAC_PI_2, 0.0, 1.0);
    let mut control = CameraControl::new(&start, ORIGIN[2]);
    let mut now = Instant::now();
    let mut walk = |control: &mut CameraControl, frames: u32| {
        control.set_held(MoveDirection::Forward, true, now);
        for _ in 0..frames {
            now += Duration::from_millis(50);
            control.advance_to(now);
            control.keep_outside(&solids, ORIGIN[2]);
        }
        control.release_keys();
        control.camera().position - DVec3::from(ORIGIN)
    };
    // From orbit mode to fly mode: nothing stops the camera.
    control.toggle_mode();
    let inside = walk(&mut control, 60);
    assert!(inside.y > 80.0 && (inside.z - GROUND_M - 10.0).abs() < 0.1, "{inside}");
    assert!(control.lift_out(&solids) && !control.lift_out(&solids));
    assert!((control.camera().position.z - ORIGIN[2] - ROOF_M - 1.7).abs() < 0.2);
    control.set_camera(&start);
    control.toggle_mode();
    let stopped = walk(&mut control, 400);
    assert!((79.0..80.0).contains(&stopped.y), "{stopped}");
    assert!((stopped.z - GROUND_M - 1.7).abs() < 0.2, "{stopped}");
    control.toggle_collision();
    assert!(walk(&mut control, 40).y > 80.5, "collision is off");
}
