//! `insula view`: a city in a window.

use super::{connect::connect, headless::INITIAL_REQUESTS};
use crate::{
    args::{GlobalArgs, ViewArgs},
    camera_files::read_path,
    error::Result,
    session::Session,
    stream::{BackgroundFetcher, Wake, fetch::Http},
    ui::{
        event_loop::{self, ConnectFn, ConnectedCity, ViewerEvent, WindowOptions},
        path_playback::PathPlayback,
        view_link::ViewLink,
    },
};
use insula_viewer::scene::SceneTree;
use std::{sync::Arc, time::Instant};

/// Longest attempt to connect, in seconds. The window shows the error and tries again.
const ATTEMPT_SECS: u32 = 3;

/// Runs the command until the window is closed. Fails if an argument is invalid, or if no window can be opened.
pub(super) fn run(args: &ViewArgs, global: &GlobalArgs) -> Result<()> {
    let started = Instant::now();
    let link = ViewLink::parse(&args.place)?;
    let path = args.path.as_deref().map(read_path).transpose()?;
    let event_loop = event_loop::event_loop()?;
    let http = Arc::new(Http::with_options(None, global.http_options())?);
    let options = WindowOptions {
        address: link.location.to_string(),
        camera: link.camera,
        sun: args.sun.or_time(link.time).into(),
        tau_px: (global.tau != GlobalArgs::DEFAULT_TAU_PX).then_some(global.tau),
        adapter: global.adapter,
        cache_bytes: u64::from(global.cache_mib) << 20,
        playback: path.map(|path| PathPlayback::new(path, args.seconds)),
    };
    let proxy = event_loop.create_proxy();
    // Sending fails only after the event loop has ended.
    let wake: Wake = Arc::new(move || {
        let _ = proxy.send_event(ViewerEvent::Arrived);
    });
    let global = GlobalArgs { timeout: global.timeout.min(ATTEMPT_SECS), ..global.clone() };
    let (has_meshes, has_transitions, place) = (!global.no_meshes, !args.no_fades, args.place.clone());
    let connect: ConnectFn = Arc::new(move || {
        let city = connect(&http, &place, &global)?;
        let (manifest, address) = (city.manifest.clone(), city.address.clone());
        let (http, wake) = (http.clone(), wake.clone());
        let open_session = move |adapter| {
            let downloads = BackgroundFetcher::downloads(http, city.source, INITIAL_REQUESTS, Some(wake));
            let tree = SceneTree::new(city.manifest).with_meshes(has_meshes);
            let mut session = Session::new(tree, downloads, adapter, started);
            session.set_transitions(has_transitions);
            session
        };
        Ok(ConnectedCity { manifest, address, open_session: Box::new(open_session) })
    });
    event_loop::run(event_loop, options, connect)
}
