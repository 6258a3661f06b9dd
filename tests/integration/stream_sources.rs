//! A city without a server: from its folder, from plain hosts that are well and ill, from the disk when nobody answers.

#![allow(clippy::unwrap_used)]

use anyhow::{Result, ensure};
use insula_archive::disk_cache::DiskCache;
use insula_client::{
    args::GlobalArgs,
    commands::{connect::connect, headless},
    render::{Adapter, AdapterChoice},
    session::Session,
    stream::{
        BackgroundFetcher,
        fetch::Http,
        source::disk::{CachedCity, EXTENSION},
    },
};
use insula_shaders::cpu::raycast::Pixels;
use insula_tests::{
    host::{Host, Manner},
    synth::{City, Stand},
    viewer::{fetch_all, open},
};
use insula_viewer::{camera::Camera, frame::RenderSettings, scene::SceneTree, streamer::FrameRequest};
use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
    time::{Duration, Instant},
};
use tempfile::TempDir;

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

fn shot() -> FrameRequest {
    let view = Stand::Roof.camera();
    let camera = Camera::look_at(view.position.into(), view.target.into(), glam::DVec3::Z, 1.0).unwrap();
    FrameRequest { camera, heading: None, size_px: [320, 180], tau_px: 1.0 }
}

fn settle(session: &mut Session) -> Result<Pixels> {
    headless::settle(session, &shot(), Duration::from_secs(3))?;
    Ok(session.draw(&shot(), &RenderSettings::default())?)
}

fn global(timeout: u32) -> GlobalArgs {
    GlobalArgs {
        adapter: AdapterChoice::Cpu,
        no_meshes: false,
        cache_mib: 256,
        disk_cache_mib: None,
        city: None,
        tau: 1.0,
        timeout,
        follow_redirects: false,
    }
}

fn web(host: &Host) -> Result<Session> {
    Ok(headless::open_session(&format!("{}/town/", host.url), &global(3), None, None)?)
}

fn host(manner: Manner) -> Result<Host> {
    Host::start(city().parent().unwrap(), manner)
}

#[test]
fn a_folder_and_plain_hosts_give_the_same_picture() -> Result<()> {
    let from_folder = settle(&mut open(&city(), 256)?)?;
    ensure!(from_folder.hit.iter().collect::<std::collections::HashSet<_>>().len() > 10, "little is seen");
    for manner in [Manner::Well, Manner::Breaks] {
        let host = host(manner)?;
        let mut session = web(&host)?;
        ensure!(settle(&mut session)?.colour == from_folder.colour, "{manner:?}");
        // Two archives are opened once, and every tile is one request: directories are kept.
        let tiles = session.report(1.0).tiles;
        let asked = session.report(1.0).requests;
        ensure!(manner != Manner::Well || asked <= tiles.blockmaps * 2 + tiles.subtrees + 8, "{asked} for {tiles:?}");
    }
    Ok(())
}

#[test]
fn hosts_that_cannot_are_errors_in_words() -> Result<()> {
    for (manner, word) in [(Manner::Whole, "ranges"), (Manner::Replaces(8), "replaced"), (Manner::Beside, "range")] {
        let host = host(manner)?;
        let begin = Instant::now();
        let error = settle(&mut web(&host)?).expect_err("this host gives no city").to_string();
        ensure!(error.contains(word) && !error.contains('\n'), "{manner:?}: {error}");
        ensure!(host.requests() < 60, "{manner:?}: {} requests in {:?}", host.requests(), begin.elapsed());
    }
    let nothing = headless::open_session(&format!("{}/nowhere/", host(Manner::Well)?.url), &global(3), None, None);
    ensure!(nothing.err().is_some_and(|e| e.to_string().contains("no such city")));
    Ok(())
}

/// What was fetched once is there when nobody answers, and what is damaged on the disk is not shown.
#[test]
fn a_visited_city_needs_no_network() -> Result<()> {
    let kept = tempfile::tempdir()?;
    // `address` stands for the one that the tiles are kept under.
    let session_at = |url: &str, address: &str| -> Result<Session> {
        let http = Arc::new(Http::new(None)?);
        let found = connect(&http, url, &global(3))?;
        let cache = Arc::new(DiskCache::open(kept.path(), EXTENSION, 64 << 20)?);
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
    let good = host(Manner::Well)?;
    let town = format!("{}/town/", good.url);
    let first = settle(&mut session(&town)?)?;
    // What was asked for depends on what came when: on the disk shall be all that the view can ask for.
    fetch_all(&mut session(&town)?, &shot(), Duration::from_secs(20))?;
    let asked = good.requests();
    let mut again = session(&town)?;
    ensure!(settle(&mut again)?.colour == first.colour);
    ensure!(good.requests() == asked + 1, "only the manifest is asked for again: {}", good.requests() - asked);
    // A host that gives nothing but the manifest.
    let bare = tempfile::tempdir()?;
    std::fs::create_dir(bare.path().join("town"))?;
    std::fs::copy(city().join("city.json"), bare.path().join("town/city.json"))?;
    let dead = format!("{}/town/", Host::start(bare.path(), Manner::Well)?.url);
    ensure!(settle(&mut session_at(&dead, &town)?)?.colour == first.colour);
    ensure!(settle(&mut session(&dead)?).is_err(), "tiles of another host are shown");
    for entry in std::fs::read_dir(kept.path())?.flatten().take(5) {
        let mut bytes = std::fs::read(entry.path())?;
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(entry.path(), bytes)?;
    }
    let asked = good.requests();
    ensure!(settle(&mut session(&town)?)?.colour == first.colour);
    ensure!(good.requests() > asked + 1, "what is damaged is fetched again");
    Ok(())
}
