//! `insula view`: a served city in a window.
//!
//! In: a URL. Out: a window. Next: people.

use super::{connect::connect, snapshot::IN_FLIGHT};
use crate::{
    args::Global,
    camera::Camera,
    error::Result,
    scene::Tree,
    session::Session,
    stream::{Stream, Wake, fetch::Http},
    sun::{Daylight, SunArgs},
    ui::window::{self, Arrived, Start},
};
use glam::DVec3;
use std::{sync::Arc, time::Instant};

/// Runs the command.
pub fn run(url: &str, sun: &SunArgs, global: &Global) -> Result<()> {
    let started = Instant::now();
    let event_loop = window::event_loop()?;
    let http = Arc::new(Http::new(None)?);
    let city = connect(&http, url, global)?;
    let manifest = city.manifest.clone();
    let size_m = DVec3::from(manifest.bounds[1]).distance(manifest.bounds[0].into());
    let start = Start {
        title: manifest.title.clone(),
        camera: Camera::overlook(manifest.focus_bounds(), 16.0 / 9.0),
        size_m,
        ground_z_m: manifest.ground_z_m,
        tau_px: global.tau,
        daylight: Daylight::new(sun, &manifest),
        adapter: global.adapter,
        cache_bytes: u64::from(global.cache_mib) << 20,
    };
    let proxy = event_loop.create_proxy();
    // A closed loop needs no waking.
    let wake: Wake = Arc::new(move || {
        let _ = proxy.send_event(Arrived);
    });
    let make = move |adapter| {
        let stream = Stream::new(http, &city.base, IN_FLIGHT, Some(wake));
        Session::new(Tree::new(city.manifest), stream, adapter, started)
    };
    window::run(event_loop, start, Box::new(make))
}
