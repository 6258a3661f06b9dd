//! `insula view`: a city in a window.
//!
//! In: a place that has a city, or a link to a view. Out: a window. Next: people.

use super::{
    connect::{Place, connect},
    snapshot::IN_FLIGHT,
};
use crate::{
    args::{Global, SunArgs, View},
    camera_files::read_path,
    error::Result,
    session::Session,
    stream::{BackgroundFetcher, Wake, fetch::Http},
    ui::{
        link::Link,
        tour::Tour,
        window::{self, Connect, Event, Found, Start},
    },
};
use insula_viewer::scene::SceneTree;
use std::{sync::Arc, time::Instant};

/// Seconds that one attempt to connect takes at most; the window tries again and says why.
const ATTEMPT_SECS: u32 = 3;

/// Runs the command.
pub fn run(args: &View, global: &Global) -> Result<()> {
    let started = Instant::now();
    let link = Link::parse(&args.url)?;
    Place::parse(&link.address)?;
    let path = args.path.as_deref().map(read_path).transpose()?;
    let event_loop = window::event_loop()?;
    let http = Arc::new(Http::new(None)?);
    let told = args.sun.time.is_some() || args.sun.sun.is_some();
    let sun = if told { args.sun } else { SunArgs { time: link.time, ..args.sun } }.into();
    let start = Start {
        address: link.address.clone(),
        camera: link.camera,
        sun,
        tau_px: (global.tau != Global::TAU_PX).then_some(global.tau),
        adapter: global.adapter,
        cache_bytes: u64::from(global.cache_mib) << 20,
        tour: path.map(|path| Tour::new(path, args.seconds)),
    };
    let proxy = event_loop.create_proxy();
    // A closed loop needs no waking.
    let wake: Wake = Arc::new(move || {
        let _ = proxy.send_event(Event::Arrived);
    });
    let global = Global { timeout: global.timeout.min(ATTEMPT_SECS), ..global.clone() };
    let (meshes, fades) = (!global.no_meshes, !args.no_fades);
    let connect: Connect = Arc::new(move || {
        let city = connect(&http, &link.address, &global)?;
        let (manifest, address) = (city.manifest.clone(), city.address.clone());
        let (http, wake) = (http.clone(), wake.clone());
        let make = move |adapter| {
            let stream = BackgroundFetcher::downloads(http, city.source, IN_FLIGHT, Some(wake));
            let mut session = Session::new(SceneTree::new(city.manifest).with_meshes(meshes), stream, adapter, started);
            session.set_transitions(fades);
            session
        };
        Ok(Found { manifest, address, make: Box::new(make) })
    });
    window::run(event_loop, start, connect)
}
