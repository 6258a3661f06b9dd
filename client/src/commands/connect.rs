//! Opens the city that the command line names.

use crate::{
    args::GlobalArgs,
    error::Result,
    stream::{
        city::{OpenOptions, OpenedCity, open_city},
        fetch::Http,
        source::disk::open_user_cache,
    },
    ui::view_link::ViewLink,
};
use std::{ffi::OsStr, sync::Arc, time::Duration};

/// Opens the city at `place`: a URL, a view link or a path. Fails if it is none of them, or as [`open_city`] does.
pub fn connect(http: &Arc<Http>, place: impl AsRef<OsStr>, global: &GlobalArgs) -> Result<OpenedCity> {
    let location = ViewLink::parse(place)?.location;
    let disk_cache = global.disk_cache_mib.and_then(|mib| open_user_cache(u64::from(mib) << 20)).map(Arc::new);
    let timeout = Duration::from_secs(u64::from(global.timeout));
    let options = OpenOptions { city: global.city.clone(), disk_cache, timeout };
    open_city(http, location, &options)
}
