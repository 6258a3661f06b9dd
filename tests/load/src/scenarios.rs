//! Simulated viewers (goose): they repeat the requests that `record.py` recorded from the real client.
//!
//! `TRACE=trace.json scenarios GOOSE-OPTIONS...`, for example `--host http://127.0.0.1:7700 --users 20 --run-time 10m`.
//! The checksums of every tile are checked; a damaged tile counts as a failed request.

use goose::prelude::*;
use insula_protocol::{TileKind, tile::TileReader};
use std::{
    collections::BTreeMap,
    sync::{
        OnceLock,
        atomic::{AtomicUsize, Ordering::Relaxed},
    },
    time::Duration,
};

static TRACES: OnceLock<BTreeMap<String, Vec<String>>> = OnceLock::new();
static NEXT_PART: AtomicUsize = AtomicUsize::new(0);
/// Requests that a viewer makes per transaction.
const PART_LENGTH: usize = 60;

/// The next part of a recorded trace.
fn next_part(name: &str) -> Vec<String> {
    let all = TRACES.get().and_then(|traces| traces.get(name)).map(Vec::as_slice).unwrap_or_default();
    let start = NEXT_PART.fetch_add(1, Relaxed) * 37 % all.len().max(1);
    all.iter().cycle().skip(start).take(PART_LENGTH.min(all.len())).cloned().collect()
}

/// Name of a path's route in goose's report.
fn route_name(path: &str) -> &'static str {
    match path {
        _ if path.contains("/blockmaps/") => "blockmaps",
        _ if path.contains("/subtrees/") => "subtrees",
        _ if path.contains("/meshes/") => "meshes",
        _ => "manifest",
    }
}

/// Sends one request, which must be answered with 304 if `tag` is given. Returns the ETag.
async fn get(user: &mut GooseUser, path: &str, tag: Option<&str>) -> Result<Option<String>, Box<TransactionError>> {
    let mut builder = user.get_request_builder(&GooseMethod::Get, path)?;
    if let Some(tag) = tag {
        builder = builder.header("if-none-match", tag);
    }
    let name = if tag.is_some() { "revisit" } else { route_name(path) };
    let request = GooseRequest::builder()
        .name(name)
        .path(path)
        .set_request_builder(builder)
        .expect_status_code(if tag.is_some() { 304 } else { 200 })
        .build();
    let mut sent = user.request(request).await?;
    let Ok(response) = sent.response else { return Ok(None) };
    let etag = response.headers().get("etag").and_then(|tag| tag.to_str().ok()).map(str::to_owned);
    let kind = match name {
        "blockmaps" => TileKind::BlockMap,
        "subtrees" => TileKind::Subtree,
        "meshes" => TileKind::Mesh,
        _ => return Ok(etag),
    };
    let is_intact = response.bytes().await.is_ok_and(|body| TileReader::new(&body, kind).is_ok());
    if !is_intact {
        user.set_failure("a tile fails its checksum", &mut sent.request, None, None)?;
    }
    Ok(etag)
}

async fn view(user: &mut GooseUser, name: &str, pause: Duration) -> TransactionResult {
    for path in next_part(name) {
        get(user, &path, None).await?;
        tokio::time::sleep(pause).await;
    }
    Ok(())
}

async fn fly(user: &mut GooseUser) -> TransactionResult {
    view(user, "fly", Duration::from_millis(5)).await
}

async fn walk(user: &mut GooseUser) -> TransactionResult {
    view(user, "walk", Duration::from_millis(20)).await
}

async fn jump(user: &mut GooseUser) -> TransactionResult {
    view(user, "jump", Duration::ZERO).await
}

async fn revisit(user: &mut GooseUser) -> TransactionResult {
    for path in next_part("fly").iter().take(20) {
        let tag = get(user, path, None).await?;
        get(user, path, tag.as_deref()).await?;
    }
    Ok(())
}

async fn arrive(user: &mut GooseUser) -> TransactionResult {
    for path in next_part("manifest") {
        get(user, &path, None).await?;
    }
    Ok(())
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let trace = std::env::var("TRACE")
        .map_err(|_| anyhow::anyhow!("TRACE is not set: it names the file that record.py wrote"))?;
    let traces: BTreeMap<String, Vec<String>> = serde_json::from_slice(&std::fs::read(trace)?)?;
    TRACES.get_or_init(|| traces);
    let attack = GooseAttack::initialize()?
        .register_scenario(
            scenario!("Fly")
                .set_weight(4)?
                .register_transaction(transaction!(arrive).set_on_start())
                .register_transaction(transaction!(fly)),
        )
        .register_scenario(
            scenario!("Walk")
                .set_weight(3)?
                .register_transaction(transaction!(arrive).set_on_start())
                .register_transaction(transaction!(walk)),
        )
        .register_scenario(
            scenario!("Jump")
                .set_weight(2)?
                .register_transaction(transaction!(arrive).set_on_start())
                .register_transaction(transaction!(jump)),
        )
        .register_scenario(scenario!("Revisit").set_weight(1)?.register_transaction(transaction!(revisit)));
    let metrics = attack.execute().await?;
    let failed: usize = metrics.requests.values().map(|request| request.fail_count).sum();
    anyhow::ensure!(failed == 0, "{failed} requests failed");
    Ok(())
}
