//! `sign`: prints a link that opens a private city for a time.

use super::{error::CommandError, output::print_result};
use crate::{
    args::SignArgs,
    config::{PublicUrl, ServeConfig, environment},
    share_link::{PARAMETER, ShareGrant, ShareKeys, ShareScope},
};
use insula_protocol::route;
use serde_json::json;
use std::time::{SystemTime, UNIX_EPOCH};

/// Where `serve` listens by default.
const LOCAL_ADDRESS: &str = "http://127.0.0.1:7700";

/// Runs `sign`. Fails if there is no key.
pub(super) fn run(args: &SignArgs) -> Result<(), CommandError> {
    let config = ServeConfig::load(args.config.as_deref(), environment(), &[])?;
    let path = args.keys.clone().or(config.access.share_keys).ok_or_else(|| {
        CommandError::Usage("no key file: use --keys FILE, or set access.share_keys in --config".into())
    })?;
    let (keys, faults) = ShareKeys::read(&path);
    for fault in &faults {
        tracing::warn!(fault, "part of the keys cannot be used");
    }
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let grant = ShareGrant {
        city: args.city.clone(),
        version: args.version.clone(),
        expires_secs: (now + args.expires).as_secs(),
        scope: ShareScope { is_read_only: args.read_only, area_mm: args.bbox_metres.map(|area| area.0) },
    };
    let link = keys.sign(&grant).ok_or_else(|| {
        CommandError::Keys(format!("cannot sign: {}; write a line \"ID SECRET\" to it", faults.join("; ")))
    })?;
    let url = args.url.as_ref().or(config.public_url.as_ref());
    let base = url.map_or(LOCAL_ADDRESS, PublicUrl::base);
    let address = format!("{base}{}?{PARAMETER}={link}", route::manifest(&args.city));
    let facts = json!({ "url": address, "expires_secs": grant.expires_secs });
    print_result(args.json, &facts, &(address + "\n"));
    Ok(())
}
