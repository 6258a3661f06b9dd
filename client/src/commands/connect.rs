//! Opens the city that the command line names.

use crate::args::GlobalArgs;
use crate::error::Result;
use crate::stream::city::{OpenOptions, OpenedCity, open_city};
use crate::stream::fetch::Http;
use crate::stream::source::disk::open_user_cache;
use crate::ui::connector::StartStatus;
use crate::ui::view_link::ViewLink;
use std::ffi::{OsStr, OsString};
use std::sync::Arc;
use std::time::Duration;

/// Finds the place of a city, and may bake and serve it before. Called on a separate thread, again after a failure.
pub(super) type FindPlace = Box<dyn Fn(&StartStatus) -> Result<OsString> + Send + Sync>;

/// Opens the city at `place`: a URL, a view link or a path. Fails if it is none of them, or as [`open_city`] does.
pub fn connect(http: &Arc<Http>, place: impl AsRef<OsStr>, global: &GlobalArgs) -> Result<OpenedCity> {
    let location = ViewLink::parse(place)?.location;
    let disk_cache = global.disk_cache_mib.and_then(|mib| open_user_cache(u64::from(mib) << 20)).map(Arc::new);
    let timeout = Duration::from_secs(u64::from(global.timeout));
    let options = OpenOptions { city: global.city.clone(), disk_cache, timeout };
    open_city(http, location, &options)
}
