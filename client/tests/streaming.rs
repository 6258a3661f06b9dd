//! Whole sessions against a server that is well, ill, away and back; pictures by the CPU ray-caster.

#![allow(clippy::unwrap_used)]

mod common;

use common::{Answer, GROUND_M, MESH_M, Policy, ROOF_M, city, city_with_meshes, global, serve, session, shot, well};
use insula_client::{commands::connect::connect, session::Session, stream::fetch::Http};
use insula_protocol::{
    TileId,
    route::{self, Layer},
};
use insula_shaders::layout::Shading;
use insula_viewer::{frame::RenderSettings, streamer::FrameRequest};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    time::{Duration, Instant},
};

/// Steps until settled; panics after 20 s. `each` sees every frame.
fn settle(session: &mut Session, shot: &FrameRequest, mut each: impl FnMut(&Session)) -> u32 {
    let begin = Instant::now();
    let mut frames = 0;
    loop {
        session.update(shot);
        each(session);
        frames += 1;
        if session.is_settled() {
            return frames;
        }
        assert!(begin.elapsed() < Duration::from_secs(20), "{:?}", session.selection());
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn street() -> FrameRequest {
    shot([31.0, -20.0, 15.0], [31.0, 200.0, 5.0])
}

#[test]
fn converges_and_measures_distances_in_metres() {
    let server = serve(city("test"), well());
    let mut session = session(&server, 64);
    // Straight down, 100 m above a roof's middle (12, 12) of the house at (80, 80).
    let down = shot([92.0, 92.0, ROOF_M + 100.0], [92.0, 92.0, 0.0]);
    settle(&mut session, &down, |_| {});
    let pixels = session.draw(&down, &RenderSettings::default()).unwrap();
    settle(&mut session, &down, |_| {});
    let centre = pixels.distance[45 * 160 + 80];
    assert!((centre - 100.0).abs() < 0.6, "{centre}");
    // A ray at the picture's edge, between two houses, ends on the ground.
    let far = pixels.distance.iter().filter(|d| d.is_finite()).copied().fold(0.0f32, f32::max);
    assert!(f64::from(far) > 100.0 + ROOF_M - GROUND_M - 1.0, "{far}");
    let report = session.report(1.0);
    let times = [report.time_to_first_picture_secs, report.time_to_near_picture_secs];
    assert!(
        times[0].is_some() && times[0] == times[1] && report.time_to_converged_picture_secs.is_some(),
        "{report:?}"
    );
    assert_eq!(report.requests, u64::from(server.requests.load(Ordering::Relaxed)));
    assert_eq!((report.tiles.subtrees, report.tiles.bad), (1, 0));
}

#[test]
fn each_frame_is_finer_and_every_tile_is_fetched_once() {
    let server = serve(city("test"), well());
    let mut session = session(&server, 64);
    let mut worst = f64::INFINITY;
    settle(&mut session, &street(), |session| {
        let counters = session.selection().stats;
        if counters.drawn > 0 {
            assert!(counters.worst_error_px <= worst);
            worst = counters.worst_error_px;
        }
    });
    assert!(session.selection().draw_tiles.len() > 10, "{:?}", session.selection().stats);
    let log = server.log.lock().unwrap();
    assert!(log.values().all(|times| *times == 1), "{log:?}");
}

#[test]
fn an_ill_server_costs_time_but_no_tile() {
    let policy: Box<Policy> =
        Box::new(|path, times| match (path.len() * 7 + path.bytes().last().map_or(0, usize::from)) % 5 {
            _ if !path.contains("blockmaps") => Answer::Well,
            0 if times == 0 => Answer::Status(503),
            1 if times == 0 => Answer::Cut,
            2 if times < 2 => Answer::Damaged,
            _ => Answer::Well,
        });
    let server = serve(city("test"), policy);
    let mut ill = session(&server, 64);
    settle(&mut ill, &street(), |_| {});
    let mut fine = session(&serve(city("test"), well()), 64);
    settle(&mut fine, &street(), |_| {});
    let draw = |session: &mut Session| session.draw(&street(), &RenderSettings::default()).unwrap();
    assert_eq!(draw(&mut ill).colour, draw(&mut fine).colour);
    assert!(ill.report(1.0).requests > fine.report(1.0).requests);
}

/// Draws each frame; every pixel of the ground is covered from the first picture on. Returns the last picture's colours.
fn fly_whole(session: &mut Session, most: Duration) -> Vec<u32> {
    fly_watched(session, most, |_| {})
}

/// The same; `each` sees every frame that is drawn.
fn fly_watched(session: &mut Session, most: Duration, mut each: impl FnMut(&Session)) -> Vec<u32> {
    let (shot, begin) = (street(), Instant::now());
    loop {
        session.update(&shot);
        if session.has_frame() {
            each(session);
            let pixels = session.draw(&shot, &RenderSettings::default()).unwrap();
            for row in 60..90 {
                let ground = &pixels.distance[row * 160 + 20..row * 160 + 140];
                assert!(ground.iter().all(|d| d.is_finite()), "a hole in row {row}");
            }
        }
        session.update(&shot);
        if session.is_settled() && session.has_frame() {
            return session.draw(&shot, &RenderSettings::default()).unwrap().colour;
        }
        assert!(begin.elapsed() < most, "{:?}", session.selection().stats);
        session.wait(Duration::from_millis(5));
    }
}

/// What a client sees that nothing stands in the way of, and how many requests it takes.
fn undisturbed() -> (Vec<u32>, u32) {
    let server = serve(city("test"), well());
    let picture = fly_whole(&mut session(&server, 64), Duration::from_secs(60));
    (picture, server.requests.load(Ordering::Relaxed))
}

/// A number that looks random, the same for the same words.
fn chance(path: &str, times: u32) -> u32 {
    let hash = path.bytes().fold(2_166_136_261u32, |h, b| (h ^ u32::from(b)).wrapping_mul(16_777_619));
    (hash ^ times.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b) >> 16
}

#[test]
fn a_tenth_lost_and_a_twentieth_damaged_costs_no_pixel() {
    let lossy: Box<Policy> = Box::new(|path, times| match chance(path, times) % 20 {
        _ if !path.contains("/0123456789abcdef/") => Answer::Well,
        0 | 1 => Answer::Cut,
        2 => Answer::Damaged,
        _ => Answer::Well,
    });
    let server = serve(city("test"), lossy);
    let mut ill = session(&server, 64);
    let (picture, requests) = undisturbed();
    assert_eq!(fly_whole(&mut ill, Duration::from_secs(60)), picture);
    assert_eq!(ill.report(1.0).tiles.bad, 0);
    let asked = server.requests.load(Ordering::Relaxed);
    assert!(asked > requests && asked < requests * 3 / 2 + 10, "{asked} requests, {requests} undisturbed");
}

#[test]
fn levels_fade_into_each_other_and_end_in_the_same_picture() {
    let server = serve(city("test"), well());
    let mut fading = session(&server, 64);
    fading.set_transitions(true);
    let mut shared = 0;
    let picture = fly_watched(&mut fading, Duration::from_secs(60), |session| {
        let both = session.transitions().tiles().iter().filter(|shown| shown.sources().1.is_some()).count();
        let nodes = session.frame_data(&street(), &RenderSettings::default()).nodes.len();
        assert!(nodes >= session.transitions().tiles().len() + both, "{nodes} nodes, {both} squares with two of them");
        shared += usize::from(both > 0);
    });
    assert!(shared > 0, "no frame showed two levels in a square");
    assert_eq!(fading.transitions().fading_count(), 0);
    let (meant, requests) = undisturbed();
    assert_eq!(picture, meant);
    let asked = server.requests.load(Ordering::Relaxed);
    assert!(asked < requests * 5 / 4 + 4, "{asked} requests, {requests} without");
    // Turned away and back, all is there at once; a small cache is never exceeded for what fades.
    let mut small = session(&server, 2);
    small.set_transitions(true);
    for turn in 0..12 {
        let x = 40.0 * f64::from(turn);
        settle(&mut small, &shot([x, -20.0, 30.0], [x, 100.0, 0.0]), |session| {
            assert!(session.cache().used_bytes() <= 2 << 20);
            assert!(turn == 0 || !session.selection().draw_tiles.is_empty());
        });
    }
}

#[test]
fn a_server_that_asks_for_patience_gets_it() {
    for status in [429, 503] {
        let begin = Instant::now();
        let busy = Duration::from_millis(1500);
        let policy: Box<Policy> = Box::new(move |path, _| match path.contains("blockmaps") && begin.elapsed() < busy {
            true => Answer::Later(status, 1),
            false => Answer::Well,
        });
        let server = serve(city("test"), policy);
        let mut session = session(&server, 64);
        while begin.elapsed() < busy - Duration::from_millis(100) {
            session.update(&street());
            session.wait(Duration::from_millis(5));
        }
        let asked = server.requests.load(Ordering::Relaxed);
        // The list, the manifest, the subtree; the root's tile, and again after a second.
        assert!(asked <= 6, "{status}: {asked} requests while it was busy");
        let (picture, requests) = undisturbed();
        assert_eq!(fly_whole(&mut session, Duration::from_secs(60)), picture);
        assert!(server.requests.load(Ordering::Relaxed) <= requests + 8);
    }
}

#[test]
fn answers_that_trickle_hold_up_nobody_for_long() {
    let policy: Box<Policy> = Box::new(|path, times| {
        let first = times == 0 && path.contains("blockmaps");
        if first && chance(path, 0).is_multiple_of(4) { Answer::Trickle } else { Answer::Well }
    });
    let server = serve(city("test"), policy);
    let mut slow = session(&server, 64);
    let (picture, requests) = undisturbed();
    assert_eq!(fly_whole(&mut slow, Duration::from_secs(120)), picture);
    let asked = server.requests.load(Ordering::Relaxed);
    assert!(asked > requests && asked <= requests * 2, "{asked} requests, {requests} undisturbed");
}

#[test]
fn one_slow_answer_holds_up_no_other() {
    let (picture, requests) = undisturbed();
    // Whichever is held back until two more are asked for, they are: it may be the one that weighs most.
    for held in 5..requests.saturating_sub(8) {
        let (asked, in_vain) = (Arc::new(AtomicU32::new(0)), Arc::new(AtomicBool::new(false)));
        let (counter, flag) = (asked.clone(), in_vain.clone());
        let policy: Box<Policy> = Box::new(move |_, _| {
            if counter.fetch_add(1, Ordering::Relaxed) == held {
                let begin = Instant::now();
                while counter.load(Ordering::Relaxed) < held + 3 && !flag.load(Ordering::Relaxed) {
                    flag.store(begin.elapsed() > Duration::from_secs(4), Ordering::Relaxed);
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
            Answer::Well
        });
        let server = serve(city("test"), policy);
        assert_eq!(fly_whole(&mut session(&server, 64), Duration::from_secs(60)), picture);
        assert!(!in_vain.load(Ordering::Relaxed), "request {held} of {requests} held up the others");
    }
}

#[test]
fn what_stays_bad_leaves_its_parent_on_screen() {
    let damaged = route::tile("test", "0123456789abcdef", Layer::BlockMaps, TileId::new(3, 0, 0).unwrap());
    let missing = route::tile("test", "0123456789abcdef", Layer::BlockMaps, TileId::new(2, 0, 1).unwrap());
    let server = serve(
        city("test"),
        Box::new(move |path, _| match path {
            p if p == damaged => Answer::Damaged,
            p if p == missing => Answer::Status(404),
            _ => Answer::Well,
        }),
    );
    let mut session = session(&server, 64);
    settle(&mut session, &street(), |_| {});
    let cut: Vec<TileId> =
        session.selection().draw_tiles.iter().map(|item| session.tree().node(item.source).id).collect();
    assert_eq!(session.report(1.0).tiles.bad, 1 + u64::from(!cut.contains(&TileId::new(1, 0, 0).unwrap())));
    assert!(cut.contains(&TileId::new(1, 0, 0).unwrap()) || cut.contains(&TileId::new(2, 0, 0).unwrap()), "{cut:?}");
    // The picture has no hole: below the horizon, every ray hits.
    let pixels = session.draw(&street(), &RenderSettings::default()).unwrap();
    assert!(pixels.distance[80 * 160 + 20..80 * 160 + 140].iter().all(|d| d.is_finite()));
}

#[test]
fn what_the_server_itself_cannot_read_leaves_its_parent_on_screen() {
    let unread = route::tile("test", "0123456789abcdef", Layer::BlockMaps, TileId::new(3, 0, 0).unwrap());
    let policy: Box<Policy> = Box::new(move |path, _| if path == unread { Answer::Status(500) } else { Answer::Well });
    let mut session = session(&serve(city("test"), policy), 64);
    settle(&mut session, &street(), |_| {});
    assert_eq!(session.report(1.0).tiles.bad, 1);
}

#[test]
fn goes_on_drawing_while_the_server_is_away_and_resumes_by_itself() {
    let slow: Box<Policy> = Box::new(|_, _| {
        std::thread::sleep(Duration::from_millis(30));
        Answer::Well
    });
    let server = serve(city("test"), slow);
    let mut session = session(&server, 64);
    for _ in 0..10_000 {
        session.update(&street());
        if !session.selection().draw_tiles.is_empty() {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    server.down.store(true, Ordering::Relaxed);
    let before = server.requests.load(Ordering::Relaxed);
    let away = Instant::now();
    while away.elapsed() < Duration::from_millis(1500) {
        session.update(&street());
        assert!(!session.selection().draw_tiles.is_empty());
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(!session.is_settled() && session.downloads().failing_since().is_some());
    assert!(session.check(Duration::from_millis(500)).is_err() && session.check(Duration::from_secs(60)).is_ok());
    assert!(server.requests.load(Ordering::Relaxed) - before <= 12 * 4, "a hot loop");
    server.down.store(false, Ordering::Relaxed);
    settle(&mut session, &street(), |_| {});
    assert!(session.downloads().failing_since().is_none());
}

#[test]
fn a_cache_that_is_too_small_is_never_exceeded_and_never_thrashes() {
    let server = serve(city("test"), well());
    let mut small = session(&server, 2);
    settle(&mut small, &street(), |session| assert!(session.cache().used_bytes() <= 2 << 20));
    let counters = small.selection().stats;
    assert!(counters.tau_px > 1.0 && counters.drawn > 1, "{counters:?}");
    let requests = small.report(1.0).requests;
    for _ in 0..50 {
        small.update(&street());
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(small.report(1.0).requests, requests);
    // There and back, many times: what is shown is always whole.
    for turn in 0..12 {
        let x = 40.0 * f64::from(turn);
        settle(&mut small, &shot([x, -20.0, 30.0], [x, 100.0, 0.0]), |session| {
            assert!(session.cache().used_bytes() <= 2 << 20 && !session.selection().draw_tiles.is_empty());
        });
    }
}

#[test]
fn near_leaves_come_as_meshes_and_columns_stay_where_a_mesh_is_bad() {
    let down = shot([92.0, 92.0, MESH_M + 60.0], [92.0, 92.0, 0.0]);
    let centre = |session: &mut Session| {
        let look = RenderSettings { shading: Shading::Albedo, ..RenderSettings::default() };
        let pixels = session.draw(&down, &look).unwrap();
        (pixels.distance[45 * 160 + 80], pixels.colour[45 * 160 + 80])
    };
    let server = serve(city_with_meshes("test"), well());
    let mut drawn = session(&server, 64);
    settle(&mut drawn, &down, |_| {});
    let (distance_m, colour) = centre(&mut drawn);
    assert!((distance_m - 60.0).abs() < 0.05, "{distance_m}");
    let off = colour.to_le_bytes().iter().zip([200u8, 10, 20]).map(|(a, b)| a.abs_diff(b)).max().unwrap();
    assert!(off <= 4, "{colour:08x}");
    let report = drawn.report(1.0);
    assert!(report.meshes_drawn > 0 && report.tiles.meshes >= u64::from(report.meshes_drawn), "{report:?}");
    assert_eq!(report.triangles_drawn, 12 * u64::from(report.meshes_drawn));
    // A cache for little more than the columns: never exceeded, and it comes to rest.
    let mut small = session(&server, 2);
    for turn in 0..6 {
        let x = 60.0 * f64::from(turn);
        settle(&mut small, &shot([x, -20.0, 30.0], [x, 100.0, 0.0]), |session| {
            assert!(session.cache().used_bytes() <= 2 << 20);
            assert!(turn == 0 || !session.selection().draw_tiles.is_empty());
        });
    }
    // Meshes that are damaged, or not there.
    for answer in [Answer::Damaged, Answer::Status(404)] {
        let ill = move |path: &str, _: u32| if path.contains("/meshes/") { answer } else { Answer::Well };
        let server = serve(city_with_meshes("test"), Box::new(ill));
        let mut columns = session(&server, 64);
        settle(&mut columns, &down, |_| {});
        let (distance_m, _) = centre(&mut columns);
        assert!((f64::from(distance_m) - (60.0 + MESH_M - ROOF_M)).abs() < 0.6, "{distance_m}");
        assert!(columns.report(1.0).tiles.bad > 0 && columns.selection().stats.meshes == 0);
    }
}

#[test]
fn several_cities_must_be_named() {
    let mut files = city("one");
    files.extend(city("two"));
    files.insert(route::CITIES.into(), br#"[{"name":"one"},{"name":"two"}]"#.to_vec());
    let server = serve(files, well());
    let http = Arc::new(Http::new(None).unwrap());
    let mut global = global();
    assert_eq!(connect(&http, &server.url, &global).unwrap_err().exit_code(), 2);
    global.city = Some("two".into());
    assert_eq!(connect(&http, &server.url, &global).unwrap().manifest.name, "two");
    let named = format!("{}/v1/cities/one", server.url);
    global.city = None;
    assert_eq!(connect(&http, &named, &global).unwrap().manifest.name, "one");
    global.city = Some("three".into());
    assert_eq!(connect(&http, &server.url, &global).unwrap_err().exit_code(), 1);
}
