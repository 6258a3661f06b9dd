//! Cities in stores that are well, slow, failing, gone, lying, and replaced.

use crate::{
    bucket,
    client::{Connection, addresses, is_whole},
    common,
    origin::Origin,
    program::{Served, until},
};
use axum::{body::Body, http::Request};
use http_body_util::BodyExt;
use insula_server::{
    config::ServeConfig,
    http::{AppState, HttpService},
    store::Store,
};
use std::{
    fs,
    sync::atomic::Ordering::Relaxed,
    time::{Duration, Instant},
};
use tower::ServiceExt;

/// So that each tile is read from the store each time.
const COLD: [&str; 3] = ["cache.memory_bytes=0", "limits.tile_bytes=0", "cache.block_bytes=4096"];

fn origin() -> (tempfile::TempDir, Origin) {
    let folder = tempfile::tempdir().unwrap();
    common::write_city(folder.path(), "two");
    let origin = Origin::start(folder.path());
    (folder, origin)
}

/// Answers by status; a tile that is not whole is a failure at once.
fn ask(server: &Served, rounds: usize) -> (usize, usize) {
    let mut connection = Connection::new(server.address);
    let (mut good, mut bad) = (0, 0);
    for _ in 0..rounds {
        for (layer, path) in addresses(common::VERSION) {
            let answer = connection.get(&path).unwrap();
            if answer.status == 200 {
                assert!(is_whole(layer, &answer.body), "wrong bytes at {path}");
                good += 1;
            } else {
                bad += 1;
            }
        }
    }
    (good, bad)
}

pub(crate) fn failing() {
    let (_folder, origin) = origin();
    origin.faults.failing_percent.store(30, Relaxed);
    origin.faults.slow_millis.store(2, Relaxed);
    let server = Served::start(&origin.url(), &COLD);
    assert_eq!(ask(&server, 150), (450, 0));
    let failed = server.metric("insula_store_fetches_total{outcome=\"failed\"}");
    let all = failed + server.metric("insula_store_fetches_total{outcome=\"ok\"}");
    println!("{failed} of {all} fetches failed, no answer did");
    assert!((0.15..0.45).contains(&(failed / all)), "{failed} of {all}: the test tests something else");
}

pub(crate) fn gone() {
    let (_folder, origin) = origin();
    let settings = [&COLD[..], &["cache.timeout_secs=1"]].concat();
    let server = Served::start(&origin.url(), &settings);
    assert_eq!(ask(&server, 1), (3, 0));
    origin.faults.gone.store(true, Relaxed);
    let start = Instant::now();
    assert_eq!(ask(&server, 1), (0, 3));
    assert!(start.elapsed() < Duration::from_secs(6), "three answers took {:?}", start.elapsed());
    assert_eq!(Connection::new(server.address).get("/readyz").unwrap().status, 200, "other cities may be well");
    origin.faults.gone.store(false, Relaxed);
    assert_eq!(ask(&server, 5), (15, 0), "it is back at once");
}

pub(crate) fn lying() {
    let (_folder, origin) = origin();
    let server = Served::start(&origin.url(), &COLD);
    origin.faults.lying_percent.store(30, Relaxed);
    let (good, bad) = ask(&server, 150);
    println!("{good} tiles, {bad} refused");
    assert!(good > 300, "what is wrong is read once more");
    assert!(bad > 0 || good == 450);
    origin.faults.lying_percent.store(100, Relaxed);
    assert!(ask(&server, 5).1 > 0, "nothing but lies: the test tests nothing");
    assert!(server.metric("insula_tile_failures_total{kind=\"damaged\"}") > 0.0);
}

pub(crate) fn coalesced() {
    let (folder, origin) = origin();
    let (layer, path) = addresses(common::VERSION)[0].clone();
    let archive = fs::read(folder.path().join("blockmaps.pmtiles")).unwrap();
    let tile_at = archive.windows(4).position(|window| window == b"INSU").unwrap();
    assert!(tile_at >= 4096, "its block was read with the directories: the test tests nothing");
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(4).enable_all().build().unwrap();
    runtime.block_on(async {
        let mut config = ServeConfig::default();
        (config.cache.block_bytes, config.limits.tile_bytes) = (4096, 0);
        let store = Store::open_anywhere(&[origin.url().into()], &config.cache).await.unwrap();
        let app = HttpService::new(AppState::new(store, &config));
        origin.faults.slow_millis.store(300, Relaxed);
        let before = origin.fetches();
        let mut all = tokio::task::JoinSet::new();
        for _ in 0..1000 {
            let request = Request::get(&path).body(Body::empty()).unwrap();
            all.spawn(app.clone().oneshot(request));
        }
        let mut good = 0;
        while let Some(answer) = all.join_next().await {
            let body = answer.unwrap().unwrap().into_body().collect().await.unwrap().to_bytes();
            good += usize::from(is_whole(layer, &body));
        }
        println!("{good} tiles of one block, {} fetches", origin.fetches() - before);
        assert_eq!((good, origin.fetches() - before), (1000, 1));
    });
}

pub(crate) fn replaced() {
    let (folder, origin) = origin();
    let server = Served::start(&origin.url(), &COLD);
    assert_eq!(ask(&server, 1), (3, 0));
    // In place, which is how not to do it: the old version's bytes are gone, so that its tiles are refused.
    let path = folder.path().join("blockmaps.pmtiles");
    let bytes = fs::read(&path).unwrap();
    std::thread::sleep(Duration::from_millis(20));
    fs::write(&path, &bytes).unwrap();
    let (good, bad) = ask(&server, 1);
    assert_eq!((good, bad), (1, 2), "what is another object now is not served as the old one");
    // As the manual says: archives in a folder of the version's name, the manifest last.
    let below = folder.path().join("b");
    fs::create_dir(&below).unwrap();
    for name in ["blockmaps.pmtiles", "subtrees.pmtiles"] {
        fs::copy(folder.path().join(name), below.join(name)).unwrap();
    }
    let manifest = insula_protocol::Manifest { version: "b".into(), ..common::manifest("two") };
    fs::write(folder.path().join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    server.signal("-HUP");
    let mut connection = Connection::new(server.address);
    until("the new version", || {
        addresses("b").iter().all(|(layer, path)| {
            let answer = connection.get(path).unwrap();
            answer.status == 200 && is_whole(*layer, &answer.body)
        })
    });
}

pub(crate) fn s3() {
    let folder = tempfile::tempdir().unwrap();
    // A real city, if one is named, else a small one.
    let city = std::env::var_os("INSULA_FAULTS_CITY").map_or_else(
        || {
            let city = folder.path().join("two");
            fs::create_dir(&city).unwrap();
            common::write_city(&city, "two");
            city
        },
        Into::into,
    );
    let place = bucket::put(&city).unwrap();
    let settings = ["cache.block_bytes=4096", "limits.tile_bytes=0"];
    let server = Served::start_in(&place.environment, &place.url, &settings);
    let local = insula_server::store::CityStore::open(&city).unwrap();
    let mut connection = Connection::new(server.address);
    let mut tiles = 0;
    for (layer, archive) in local.archives() {
        for (id, bytes) in archive.tiles() {
            let manifest = local.manifest();
            let (name, version) = (&manifest.name, &manifest.version);
            let path = insula_protocol::route::archive_tile(name, version, layer, id, manifest.depth).unwrap();
            let answer = connection.get(&path).unwrap();
            assert!(answer.status == 200 && answer.body == bytes.unwrap(), "{path}: {}", answer.status);
            tiles += 1;
        }
    }
    println!("{tiles} tiles through S3");
}
