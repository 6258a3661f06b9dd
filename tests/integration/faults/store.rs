//! Stores that are slow, failing, unreachable, wrong or replaced.

use super::client::{Connection, is_intact, tile_paths};
use super::server::{self, ANY_PORT, metric};
use axum::body::Body;
use axum::http::Request;
use http_body_util::BodyExt;
use insula_protocol::Manifest;
use insula_server::config::ServeConfig;
use insula_server::http::{AppState, HttpService};
use insula_server::store::{CityStore, Store};
use insula_test_support::bucket::BucketCity;
use insula_test_support::faulty_host::FaultyHost;
use insula_test_support::programs::{ServerProcess, wait_until};
use insula_test_support::{bucket, small_city, tier};
use insula_tests::fixtures;
use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering::Relaxed;
use tower::ServiceExt;

/// Settings without caches: each request reads its tile from the store.
const COLD: [&str; 3] = ["cache.memory_bytes=0", "limits.tile_bytes=0", "cache.block_bytes=4096"];

/// How often [`failing`] and [`lying`] request all tiles.
fn rounds() -> usize {
    if tier::is_full() { 150 } else { 40 }
}

fn hosted_city() -> (tempfile::TempDir, FaultyHost) {
    let folder = small_city::temporary_city();
    let host = FaultyHost::start(folder.path());
    (folder, host)
}

/// Requests all tiles `rounds` times. Returns the numbers of intact tiles and of refusals; a damaged tile panics.
fn request_tiles(address: SocketAddr, rounds: usize) -> (usize, usize) {
    let mut connection = Connection::new(address);
    let (mut intact, mut refused) = (0, 0);
    for _ in 0..rounds {
        for (kind, path) in tile_paths(small_city::VERSION) {
            let response = connection.get(&path).unwrap();
            if response.status == 200 {
                assert!(is_intact(kind, &response.body), "wrong bytes at {path}");
                intact += 1;
            } else {
                refused += 1;
            }
        }
    }
    (intact, refused)
}

/// 30% of the store's responses fail.
pub(super) fn failing() {
    let (_folder, host) = hosted_city();
    host.faults.failing_percent.store(30, Relaxed);
    host.faults.delay_ms.store(2, Relaxed);
    let server = server::start(&host.url(), &COLD);
    assert_eq!(request_tiles(server.address, rounds()), (3 * rounds(), 0));
    let fetches = |outcome| metric(server.address, &format!("insula_store_fetches_total{{outcome=\"{outcome}\"}}"));
    let (failed, all) = (fetches("failed"), fetches("failed") + fetches("ok"));
    println!("{failed} of {all} fetches failed, all requests succeeded");
    assert!((0.15..0.45).contains(&(failed / all)), "{failed} of {all} fetches failed: the test tests something else");
}

/// The store closes all connections for some time.
pub(super) fn gone() {
    let (_folder, host) = hosted_city();
    let server = server::start(&host.url(), &[&COLD[..], &["cache.timeout_secs=1"]].concat());
    wait_until("all tiles are served", || request_tiles(server.address, 1) == (3, 0));
    host.faults.is_gone.store(true, Relaxed);
    assert_eq!(request_tiles(server.address, 1), (0, 3));
    let ready = Connection::new(server.address).get("/readyz").unwrap();
    assert_eq!(ready.status, 200, "other cities may be available");
    host.faults.is_gone.store(false, Relaxed);
    wait_until("all tiles are served again", || request_tiles(server.address, 1) == (3, 0));
}

/// The store alters a byte in 30%, then in all of its responses.
pub(super) fn lying() {
    let (_folder, host) = hosted_city();
    let server = server::start(&host.url(), &COLD);
    host.faults.lying_percent.store(30, Relaxed);
    let (intact, refused) = request_tiles(server.address, rounds());
    println!("{intact} tiles, {refused} refused");
    assert!(intact > 2 * rounds(), "a damaged tile is read once more");
    host.faults.lying_percent.store(100, Relaxed);
    assert!(request_tiles(server.address, 5).1 > 0, "no tile is refused: the test tests nothing");
    assert!(metric(server.address, "insula_tile_failures_total{kind=\"damaged\"}") > 0.0);
}

/// A thousand requests wait for the same block of a slow store.
pub(super) fn coalesced() {
    let (folder, host) = hosted_city();
    let (kind, path) = tile_paths(small_city::VERSION)[0].clone();
    let archive = fs::read(folder.path().join("blockmaps.pmtiles")).unwrap();
    let tile_at = archive.windows(4).position(|window| window == b"INSU").unwrap();
    assert!(tile_at >= 4096, "its block is read with the directories: the test tests nothing");
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(4).enable_all().build().unwrap();
    runtime.block_on(async {
        let mut config = ServeConfig::default();
        (config.cache.block_bytes, config.limits.tile_bytes) = (4096, 0);
        let store = Store::open_anywhere(&[host.url().into()], &config.cache).await.unwrap();
        let app = HttpService::new(AppState::new(store, &config));
        host.faults.delay_ms.store(300, Relaxed);
        let before = host.range_requests();
        let mut all = tokio::task::JoinSet::new();
        for _ in 0..1000 {
            let request = Request::get(&path).body(Body::empty()).unwrap();
            all.spawn(app.clone().oneshot(request));
        }
        let mut intact = 0;
        while let Some(response) = all.join_next().await {
            let body = response.unwrap().unwrap().into_body().collect().await.unwrap().to_bytes();
            intact += usize::from(is_intact(kind, &body));
        }
        assert_eq!((intact, host.range_requests() - before), (1000, 1), "intact tiles and fetches");
    });
}

/// The archive is replaced in place, then as a new version.
pub(super) fn replaced() {
    let (folder, host) = hosted_city();
    let server = server::start(&host.url(), &COLD);
    assert_eq!(request_tiles(server.address, 1), (3, 0));
    // Replaced in place, against the manual: the ETag changes, so tiles of the old version are refused.
    let path = folder.path().join("blockmaps.pmtiles");
    let (bytes, time) = (fs::read(&path).unwrap(), || fs::metadata(&path).unwrap().modified().unwrap());
    let before = time();
    wait_until("another time of modification", || {
        fs::write(&path, &bytes).unwrap();
        time() != before
    });
    assert_eq!(request_tiles(server.address, 1), (1, 2), "a replaced object is not served as the old one");
    // As the manual says: archives in a folder named after the version, and the manifest last.
    let below = folder.path().join("b");
    fs::create_dir(&below).unwrap();
    for name in ["blockmaps.pmtiles", "subtrees.pmtiles"] {
        fs::copy(folder.path().join(name), below.join(name)).unwrap();
    }
    let manifest = Manifest { version: "b".into(), ..small_city::manifest("two") };
    fs::write(folder.path().join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    server.signal("-HUP");
    wait_until("the new version", || Connection::new(server.address).serves_all("b"));
}

/// Serves every tile of a city from S3 (moto); of the city in `INSULA_FAULTS_CITY` if that is set.
pub(super) fn s3() {
    let folder = tempfile::tempdir().unwrap();
    let city = std::env::var_os("INSULA_FAULTS_CITY").map(PathBuf::from).unwrap_or_else(|| {
        small_city::write_city(&folder.path().join("two"), "two");
        folder.path().join("two")
    });
    assert_served(bucket::upload(&city).unwrap(), &city);
}

/// The same of a version that has few tiles of its own: the others are in another city of the bucket, which the server is not told of.
pub(super) fn version_on_s3() {
    let folder = tempfile::tempdir().unwrap();
    let [first, later] = fixtures::bake_versions(folder.path()).unwrap();
    let bytes = |city: &Path| fs::metadata(city.join("blockmaps.pmtiles")).unwrap().len();
    assert!(bytes(&later) < bytes(&first), "the version shares no tiles: the test tests nothing");
    let uploaded = bucket::upload_beside(&[&first, &later]).unwrap();
    assert_served(uploaded.into_iter().last().unwrap(), &later);
}

/// Asserts that a server gives all tiles of a city that was uploaded.
fn assert_served(uploaded: BucketCity, city: &Path) {
    let settings = ["cache.block_bytes=4096", "limits.tile_bytes=0"];
    let mut command = server::command();
    command.envs(uploaded.environment);
    let server = ServerProcess::start(&mut command, &uploaded.url, ANY_PORT, &settings).unwrap();
    let local = CityStore::open(city).unwrap();
    let manifest = local.manifest();
    let mut connection = Connection::new(server.address);
    for (kind, archive) in local.archives() {
        for (id, bytes) in archive.tiles() {
            let (name, version) = (&manifest.name, &manifest.version);
            let path = insula_protocol::route::archive_tile(name, version, kind, id, manifest.depth).unwrap();
            let response = connection.get(&path).unwrap();
            assert!(response.status == 200 && response.body == bytes.unwrap(), "{path}: {}", response.status);
        }
    }
}
