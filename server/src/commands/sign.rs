//! `sign`: prints a link that opens a private city for a time.

use super::error::CommandError;
use super::output::print_result;
use crate::args::SignArgs;
use crate::config::{PublicUrl, ServeConfig, environment};
use crate::share_link::{PARAMETER, ShareGrant, ShareKeys, ShareScope, area_mm};
use crate::store::CityStore;
use insula_archive::city::MANIFEST_FILE;
#[cfg(feature = "bake")]
use insula_bake::read::EarthPlace;
use insula_command_line::area::AreaArgs;
use insula_protocol::name::is_name;
use insula_protocol::text::printable;
use insula_protocol::{Manifest, route};
use serde_json::json;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// Where `serve` listens by default.
const LOCAL_ADDRESS: &str = "http://127.0.0.1:7700";

/// Runs `sign`. Fails if there is no key, if it is not known where an area lies, or if that is beyond the city.
pub(super) fn run(args: &SignArgs) -> Result<(), CommandError> {
    let config = ServeConfig::load(args.config.as_deref(), environment(), &[])?;
    let path = args.keys.clone().or(config.access.share_keys).ok_or_else(|| {
        CommandError::Usage("no key file: use --keys FILE, or set access.share_keys in --config".into())
    })?;
    let (keys, faults) = ShareKeys::read(&path);
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
    for fault in &faults {
        eprintln!("warning: part of the keys cannot be used: {}", printable(fault));
    }
    let url = args.url.as_ref().or(config.public_url.as_ref());
    let base = url.map_or(LOCAL_ADDRESS, PublicUrl::base);
    let address = format!("{base}{}?{PARAMETER}={link}", route::manifest(&grant.city));
    let facts = json!({ "url": address, "expires_secs": grant.expires_secs });
    print_result(args.json, &facts, &(address + "\n"));
    Ok(())
}

/// Name of the city, and the area that the link opens in millimetres of its coordinate system. Fails if a folder is needed and is none
/// of a city, if the city is not known to lie on Earth, or if the area is beyond it.
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
    let area = match manifest {
        Some(manifest) => area_in(&args.area, manifest),
        None => args.area.world_box(|_| None),
    };
    let area = area.map_err(CommandError::Usage)?;
    let name = manifest.map_or_else(|| args.city.clone(), |manifest| manifest.name.clone());
    Ok((name, area.map(area_mm)))
}

/// The area in world metres of a city.
fn area_in(area: &AreaArgs, manifest: &Manifest) -> Result<Option<[[f64; 2]; 2]>, String> {
    // Programs that do not bake have no coordinate systems.
    #[cfg(feature = "bake")]
    let place = manifest.crs.as_deref().and_then(EarthPlace::of);
    #[cfg(feature = "bake")]
    let (on_map, to_degrees) =
        (|degrees| place.as_ref()?.box_on_map(degrees), |at: [f64; 2]| place.as_ref()?.lon_lat(at));
    #[cfg(not(feature = "bake"))]
    let (on_map, to_degrees) = (|_: [f64; 4]| None, |_: [f64; 2]| None);
    area.box_in_city(manifest.bounds.map(|[x, y, _]| [x, y]), on_map, &to_degrees)
}
