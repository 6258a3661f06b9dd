//! Opens the city that the command line names.

use crate::{
    args::GlobalArgs,
    error::Result,
    stream::{
        city::{OpenOptions, OpenedCity, open_city},
        fetch::Http,
        location::CityLocation,
        source::disk::open_user_cache,
    },
    ui::connector::StartStatus,
};
use std::{sync::Arc, time::Duration};

/// Finds the address of a city, and may bake and serve it before. Called on a separate thread, again after a failure.
pub(super) type FindAddress = Box<dyn Fn(&StartStatus) -> Result<String> + Send + Sync>;

/// Opens the city at `location`, a URL or a path. Fails as [`open_city`] does.
pub fn connect(http: &Arc<Http>, location: &str, global: &GlobalArgs) -> Result<OpenedCity> {
    let disk_cache = match global.disk_cache_mib {
        Some(mib) => Some(Arc::new(open_user_cache(u64::from(mib) << 20)?)),
        None => None,
    };
    let timeout = Duration::from_secs(u64::from(global.timeout));
    let options = OpenOptions { city: global.city.clone(), disk_cache, timeout };
    open_city(http, CityLocation::parse(location)?, &options)
}
