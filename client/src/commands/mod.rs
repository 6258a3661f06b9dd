//! The commands of `insula`, one module each, and what they share (`connect`, `headless`, `proposal`, `embedded`).

#[cfg(feature = "embedded")]
mod city_tiles;
#[cfg(feature = "embedded")]
mod demo;
#[cfg(feature = "embedded")]
mod draw;
#[cfg(feature = "embedded")]
mod embedded;
mod fly;
pub mod headless;
#[cfg(feature = "embedded")]
mod open;
mod proposal;
mod snapshot;
mod view;

use crate::args::{Cli, ClientCommand, GlobalArgs};
use crate::error::{ClientError, Result};
use crate::stream::city::{OpenOptions, OpenedCity, open_city};
use crate::stream::fetch::Http;
use crate::stream::source::disk::open_user_cache;
use crate::ui::connector::StartStatus;
use crate::ui::view_link::ViewLink;
use std::ffi::{OsStr, OsString};
use std::sync::Arc;
use std::time::Duration;

/// Runs the command of a command line. Fails as the command does.
pub fn run(cli: Cli) -> Result<()> {
    let Cli { command, global } = cli;
    match command {
        ClientCommand::View(args) => view::run(&args, &global),
        ClientCommand::Snapshot(args) => snapshot::run(&args, &global),
        ClientCommand::Fly(args) => fly::run(&args, &global),
        ClientCommand::Setup(setup) => setup.run::<Cli>().map_err(|(path, source)| ClientError::File { path, source }),
        #[cfg(feature = "embedded")]
        ClientCommand::Open(args) => open::run(&args, &global),
        #[cfg(feature = "embedded")]
        ClientCommand::Demo(args) => demo::run(&args, &global),
        #[cfg(feature = "embedded")]
        ClientCommand::Draw(args) => draw::run(&args, &global),
        #[cfg(not(feature = "embedded"))]
        ClientCommand::Open(_) | ClientCommand::Demo(_) | ClientCommand::Draw(_) => Err(ClientError::Usage(
            "this program was built without the embedded server: use insula-server, then insula view".into(),
        )),
    }
}

/// Finds the place of a city, and may bake and serve it before. Called on a separate thread, again after a failure.
type FindPlace = Box<dyn Fn(&StartStatus) -> Result<OsString> + Send + Sync>;

/// Opens the city at `place`: a URL, a view link or a path. Fails if it is none of them, or as [`open_city`] does.
pub fn connect(http: &Arc<Http>, place: impl AsRef<OsStr>, global: &GlobalArgs) -> Result<OpenedCity> {
    let location = ViewLink::parse(place)?.location;
    let disk_cache = global.disk_cache_mib.and_then(|mib| open_user_cache(u64::from(mib) << 20)).map(Arc::new);
    let timeout = Duration::from_secs(u64::from(global.timeout));
    let options = OpenOptions { city: global.city.clone(), disk_cache, timeout };
    open_city(http, location, &options)
}
