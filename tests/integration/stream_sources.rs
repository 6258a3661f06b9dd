//! A city without a server: from its folder, from plain web hosts with faults, and from the disk cache.

use anyhow::{Result, ensure};
use insula_archive::city::read_manifest;
use insula_archive::disk_cache::DiskCache;
use insula_bake::BakeOptions;
use insula_client::args::GlobalArgs;
use insula_client::commands::{connect, headless};
use insula_client::render::{Adapter, AdapterChoice};
use insula_client::session::Session;
use insula_client::stream::BackgroundFetcher;
use insula_client::stream::fetch::Http;
use insula_client::stream::source::disk::{CachedCity, EXTENSION};
use insula_server::config::ServeConfig;
use insula_server::http::HttpServer;
use insula_server::store::Store;
use insula_shaders::cpu::raycast::Pixels;
use insula_test_support::faulty_host::{FaultyHost, HostFaults};
use insula_test_support::programs::{program, run};
use insula_tests::fixtures::{raise_first_house, write_city_json};
use insula_tests::synth::{City, Viewpoint};
use insula_tests::tests;
use insula_tests::trials::Trials;
use insula_tests::viewer::{fetch_all, global, open};
use insula_viewer::camera::Camera;
use insula_viewer::frame::RenderSettings;
use insula_viewer::scene::SceneTree;
use insula_viewer::streamer::FrameRequest;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use tempfile::TempDir;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        a_folder_and_plain_hosts_give_the_same_frame,
        a_version_of_a_city_gives_the_frame_of_a_whole_bake,
        a_share_link_opens_a_private_city,
        unsuitable_hosts_are_errors_of_one_line,
        a_visited_city_needs_no_network
    ]);
}

/// A small city of many tiles.
fn city() -> PathBuf {
    static CITY: OnceLock<TempDir> = OnceLock::new();
    let folder = CITY.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        City::new(400, 1.0).unwrap().write(&folder.path().join("town"), None, &insula_bake::Silent).unwrap();
        folder
    });
    folder.path().join("town")
}

fn request() -> FrameRequest {
    let view = Viewpoint::Roof.camera();
    let camera = Camera::look_at(view.position.into(), view.target.into(), glam::DVec3::Z, 1.0).unwrap();
    FrameRequest { camera, heading: None, size_px: [320, 180], tau_px: 1.0, switching: None }
}

/// Longest time without a response, where one is expected. Only a hang takes as long.
const PATIENCE: Duration = Duration::from_secs(60);
/// The same where none is expected.
const IMPATIENCE: Duration = Duration::from_secs(2);

fn settle(session: &mut Session) -> Result<Pixels> {
    settle_within(session, PATIENCE)
}

fn settle_within(session: &mut Session, timeout: Duration) -> Result<Pixels> {
    headless::settle(session, &request(), timeout)?;
    Ok(session.draw(&request(), &RenderSettings::default())?)
}

fn options(timeout: Duration) -> GlobalArgs {
    GlobalArgs { timeout: timeout.as_secs() as u32, ..global(256) }
}

fn open_hosted(host: &FaultyHost) -> Result<Session> {
    Ok(headless::open_session(format!("{}/town/", host.url()), &options(PATIENCE), None, None, None)?)
}

fn start_host() -> FaultyHost {
    FaultyHost::start(city().parent().unwrap())
}

fn a_folder_and_plain_hosts_give_the_same_frame() -> Result<()> {
    let from_folder = settle(&mut open(&city(), 256)?)?;
    ensure!(from_folder.hit.iter().collect::<HashSet<_>>().len() > 10, "the frame shows few tiles");
    for truncates in [false, true] {
        let host = start_host();
        host.faults.truncates_every_third.store(truncates, Relaxed);
        let mut session = open_hosted(&host)?;
        ensure!(settle(&mut session)?.colour == from_folder.colour, "truncated responses: {truncates}");
        // Archives are opened once, and each tile is one request, because directories are kept.
        let report = session.report(1.0);
        let max_requests = report.tiles.blockmaps * 2 + report.tiles.subtrees + 8;
        ensure!(truncates || report.requests <= max_requests, "{} requests for {:?}", report.requests, report.tiles);
    }
    Ok(())
}

/// A version has one house of its own, and the other tiles in another folder, on this machine or on a plain host.
fn a_version_of_a_city_gives_the_frame_of_a_whole_bake() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name);
    let input = write_city_json(folder.path(), 6)?;
    let bake = |name: &str, version_of: Option<&str>| {
        let (date, version_of) = (Some("2024-01-31".to_owned()), version_of.map(path));
        let (inputs, out) = (vec![input.clone()], path(name));
        insula_bake::bake(
            &BakeOptions { inputs, out, date, version_of, ..BakeOptions::default() },
            &insula_bake::Silent,
        )
    };
    bake("first", None)?;
    raise_first_house(&input)?;
    bake("later", Some("first"))?;
    bake("whole", None)?;
    let camera = Camera::overview(&read_manifest(&path("whole"))?, 16.0 / 9.0);
    let request = FrameRequest { camera, heading: None, size_px: [320, 180], tau_px: 1.0, switching: None };
    let frame = |mut session: Session| -> Result<Vec<u32>> {
        headless::settle(&mut session, &request, PATIENCE)?;
        Ok(session.draw(&request, &RenderSettings::default())?.colour)
    };
    let whole = frame(open(&path("whole"), 256)?)?;
    ensure!(frame(open(&path("later"), 256)?)? == whole, "the frame from a folder differs");
    ensure!(frame(open(&path("first"), 256)?)? != whole, "the house is not in the frame");
    let host = FaultyHost::start(folder.path());
    let hosted = headless::open_session(format!("{}/later/", host.url()), &options(PATIENCE), None, None, None)?;
    ensure!(frame(hosted)? == whole, "the frame from a host differs");
    Ok(())
}

/// A server of the city, which is private, ends with its runtime. Returns the address of the manifest, and a link to it.
fn private_server(runtime: &tokio::runtime::Runtime, keys: &Path) -> Result<(String, String)> {
    std::fs::write(keys, "key 0123456789abcdef0123456789abcdef\n")?;
    let mut config = ServeConfig::default();
    config.access.share_keys = Some(keys.to_owned());
    let server = HttpServer::new(Store::open(&[city()])?, &config)?;
    let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0"))?;
    let url = format!("http://{}", listener.local_addr()?);
    runtime.spawn(server.run(listener, std::future::pending()));
    let mut sign = Command::new(program("insula-server")?);
    sign.args(["sign", "--city", "town", "--expires", "1h", "--url", &url, "--keys"]).arg(keys);
    let link = String::from_utf8(run(&mut sign)?.stdout)?;
    Ok((format!("{url}/v1/cities/town"), link.trim_end().to_owned()))
}

fn a_share_link_opens_a_private_city() -> Result<()> {
    let (runtime, folder) = (tokio::runtime::Runtime::new()?, tempfile::tempdir()?);
    let (address, link) = private_server(&runtime, &folder.path().join("keys"))?;
    ensure!(headless::open_session(&address, &options(IMPATIENCE), None, None, None).is_err(), "it is not private");
    let from_link = settle(&mut headless::open_session(&link, &options(PATIENCE), None, None, None)?)?;
    ensure!(from_link == settle(&mut open(&city(), 256)?)?, "the frames differ");
    let error =
        headless::open_session(format!("{link}0"), &options(IMPATIENCE), None, None, None).err().map(|e| e.to_string());
    ensure!(error.as_ref().is_some_and(|text| !text.contains("share")), "the link is in a message: {error:?}");
    Ok(())
}

type SetFault = fn(&HostFaults);

fn unsuitable_hosts_are_errors_of_one_line() -> Result<()> {
    let faults: [(&str, SetFault); 3] = [
        ("ranges", |faults| faults.ignores_ranges.store(true, Relaxed)),
        ("replaced", |faults| faults.replaced_after.store(8, Relaxed)),
        ("range", |faults| faults.shifts_ranges.store(true, Relaxed)),
    ];
    for (word, set_fault) in faults {
        let host = start_host();
        set_fault(&host.faults);
        let error =
            settle_within(&mut open_hosted(&host)?, IMPATIENCE).expect_err("the host is unsuitable").to_string();
        ensure!(error.contains(word) && !error.contains('\n'), "{word:?} is expected: {error}");
        ensure!(host.requests() < 60, "{word:?}: {} requests", host.requests());
    }
    let missing =
        headless::open_session(format!("{}/nowhere/", start_host().url()), &options(IMPATIENCE), None, None, None);
    ensure!(missing.err().is_some_and(|error| error.to_string().contains("no city here")));
    Ok(())
}

/// Tiles in the disk cache are not fetched again, unless they are damaged.
fn a_visited_city_needs_no_network() -> Result<()> {
    let cache_folder = tempfile::tempdir()?;
    // `address` stands for the one that the tiles are cached under.
    let session_at = |url: &str, address: &str| -> Result<Session> {
        let http = Arc::new(Http::new(None)?);
        let found = connect(&http, url, &options(PATIENCE))?;
        let cache = Arc::new(DiskCache::open(cache_folder.path(), EXTENSION, 64 << 20)?);
        let source = Arc::new(CachedCity::new(found.source, cache, address, &found.manifest));
        let adapter = Adapter::headless(AdapterChoice::Cpu, 256 << 20)?;
        Ok(Session::new(
            SceneTree::new(found.manifest),
            BackgroundFetcher::downloads(http, source, 12, None),
            adapter,
            Instant::now(),
        ))
    };
    let session = |url: &str| session_at(url, url);
    let host = start_host();
    let url = format!("{}/town/", host.url());
    let first = settle(&mut session(&url)?)?;
    // Which tiles are requested depends on the order of arrival, so cache all tiles that the view can request.
    fetch_all(&mut session(&url)?, &request(), PATIENCE)?;
    let before = host.requests();
    ensure!(settle(&mut session(&url)?)?.colour == first.colour);
    ensure!(host.requests() == before + 1, "{} requests, only the manifest is expected", host.requests() - before);
    let manifest_only = tempfile::tempdir()?;
    std::fs::create_dir(manifest_only.path().join("town"))?;
    std::fs::copy(city().join("city.json"), manifest_only.path().join("town/city.json"))?;
    let url_without_tiles = format!("{}/town/", FaultyHost::start(manifest_only.path()).url());
    ensure!(settle(&mut session_at(&url_without_tiles, &url)?)?.colour == first.colour);
    ensure!(settle_within(&mut session(&url_without_tiles)?, IMPATIENCE).is_err(), "tiles of another host are drawn");
    for entry in std::fs::read_dir(cache_folder.path())?.flatten().take(5) {
        let mut bytes = std::fs::read(entry.path())?;
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(entry.path(), bytes)?;
    }
    let before = host.requests();
    ensure!(settle(&mut session(&url)?)?.colour == first.colour);
    ensure!(host.requests() > before + 1, "damaged tiles are fetched again");
    Ok(())
}
