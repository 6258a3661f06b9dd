//! `sign`: prints a link that opens a private city for a time.

use super::{error::CommandError, output::print_result};
use crate::{
    args::SignArgs,
    config::{PublicUrl, ServeConfig, environment},
    share_link::{PARAMETER, ShareGrant, ShareKeys, ShareScope, area_mm},
    store::CityStore,
};
use insula_archive::city::MANIFEST_FILE;
#[cfg(feature = "bake")]
use insula_bake::read::EarthPlace;
use insula_protocol::{manifest::is_name, route};
use serde_json::json;
use std::{
    path::Path,
    time::{SystemTime, UNIX_EPOCH},
};

/// Where `serve` listens by default.
const LOCAL_ADDRESS: &str = "http://127.0.0.1:7700";

/// Runs `sign`. Fails if there is no key, or if it is not known where an area lies.
pub(super) fn run(args: &SignArgs) -> Result<(), CommandError> {
    let config = ServeConfig::load(args.config.as_deref(), environment(), &[])?;
    let path = args.keys.clone().or(config.access.share_keys).ok_or_else(|| {
        CommandError::Usage("no key file: use --keys FILE, or set access.share_keys in --config".into())
    })?;
    let (keys, faults) = ShareKeys::read(&path);
    for fault in &faults {
        tracing::warn!(fault, "part of the keys cannot be used");
    }
    let (city, area_mm) = city_and_area(args)?;
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let grant = ShareGrant {
        city,
        version: args.version.clone(),
        expires_secs: (now + args.expires).as_secs(),
        scope: ShareScope { is_read_only: args.read_only, area_mm },
    };
    let link = keys.sign(&grant).ok_or_else(|| {
        CommandError::Keys(format!("cannot sign: {}; write a line \"ID SECRET\" to it", faults.join("; ")))
    })?;
    let url = args.url.as_ref().or(config.public_url.as_ref());
    let base = url.map_or(LOCAL_ADDRESS, PublicUrl::base);
    let address = format!("{base}{}?{PARAMETER}={link}", route::manifest(&grant.city));
    let facts = json!({ "url": address, "expires_secs": grant.expires_secs });
    print_result(args.json, &facts, &(address + "\n"));
    Ok(())
}

/// Name of the city, and the area that the link opens in millimetres of its coordinate system. Fails if a folder is needed and is none
/// of a city, or if the city is not known to lie on Earth.
fn city_and_area(args: &SignArgs) -> Result<(String, Option<[i64; 4]>), CommandError> {
    let folder = Path::new(&args.city);
    let is_name_enough = is_name(&args.city) && args.area.bbox.is_none();
    let city = match is_name_enough {
        true => None,
        false if folder.join(MANIFEST_FILE).is_file() => Some(CityStore::open(folder)?),
        false => {
            let reason = "is no folder of a city, which tells where degrees are on its map: give its folder as --city, or --bbox-metres";
            return Err(CommandError::Usage(format!("--bbox: {} {reason}", args.city)));
        }
    };
    let manifest = city.as_ref().map(|city| city.manifest());
    let crs = manifest.and_then(|manifest| manifest.crs.as_deref());
    let area = args.area.world_box(|degrees| on_map(crs, degrees)).map_err(CommandError::Usage)?;
    let name = manifest.map_or_else(|| args.city.clone(), |manifest| manifest.name.clone());
    Ok((name, area.map(area_mm)))
}

/// Corners on the map of an area in degrees; `None` if that is not known.
#[cfg(feature = "bake")]
fn on_map(crs: Option<&str>, degrees: [f64; 4]) -> Option<[[f64; 2]; 2]> {
    EarthPlace::of(crs?)?.box_on_map(degrees)
}

/// Programs that do not bake have no coordinate systems.
#[cfg(not(feature = "bake"))]
fn on_map(_: Option<&str>, _: [f64; 4]) -> Option<[[f64; 2]; 2]> {
    None
}
