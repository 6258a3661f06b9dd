//! Viewers as goose plays them: what the real client asked for on recorded flights, walks and jumps (`record.py`), again.
//!
//! `TRACE=trace.json scenarios GOOSE-OPTIONS...`, for example `--host http://127.0.0.1:7700 --users 20 --run-time 10m`.
//! Every tile's checksums are checked; what is wrong is a failed request.

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
static TURN: AtomicUsize = AtomicUsize::new(0);
/// Tiles that one viewer asks for before it looks away.
const AT_ONCE: usize = 60;

/// A part of a recorded trace, another one each time.
fn part(name: &str) -> Vec<String> {
    let all = TRACES.get().and_then(|traces| traces.get(name)).map(Vec::as_slice).unwrap_or_default();
    let from = TURN.fetch_add(1, Relaxed) * 37 % all.len().max(1);
    all.iter().cycle().skip(from).take(AT_ONCE.min(all.len())).cloned().collect()
}

fn layer(path: &str) -> &'static str {
    match path {
        _ if path.contains("/blockmaps/") => "blockmaps",
        _ if path.contains("/subtrees/") => "subtrees",
        _ if path.contains("/meshes/") => "meshes",
        _ => "manifest",
    }
}

/// One request; gives the tile's ETag.
async fn ask(user: &mut GooseUser, path: &str, tag: Option<&str>) -> Result<Option<String>, Box<TransactionError>> {
    let mut builder = user.get_request_builder(&GooseMethod::Get, path)?;
    if let Some(tag) = tag {
        builder = builder.header("if-none-match", tag);
    }
    let name = if tag.is_some() { "revisit" } else { layer(path) };
    let request = GooseRequest::builder()
        .name(name)
        .path(path)
        .set_request_builder(builder)
        .expect_status_code(if tag.is_some() { 304 } else { 200 })
        .build();
    let mut asked = user.request(request).await?;
    let Ok(response) = asked.response else { return Ok(None) };
    let etag = response.headers().get("etag").and_then(|tag| tag.to_str().ok()).map(str::to_owned);
    let kind = match name {
        "blockmaps" => TileKind::BlockMap,
        "subtrees" => TileKind::Subtree,
        "meshes" => TileKind::Mesh,
        _ => return Ok(etag),
    };
    let whole = response.bytes().await.is_ok_and(|body| TileReader::new(&body, kind).is_ok());
    if !whole {
        user.set_failure("a tile fails its checksum", &mut asked.request, None, None)?;
    }
    Ok(etag)
}

async fn view(user: &mut GooseUser, name: &str, pause: Duration) -> TransactionResult {
    for path in part(name) {
        ask(user, &path, None).await?;
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
    for path in part("fly").iter().take(20) {
        let tag = ask(user, path, None).await?;
        ask(user, path, tag.as_deref()).await?;
    }
    Ok(())
}

async fn arrive(user: &mut GooseUser) -> TransactionResult {
    for path in part("manifest") {
        ask(user, &path, None).await?;
    }
    Ok(())
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let trace = std::env::var("TRACE").map_err(|_| anyhow::anyhow!("TRACE names the file that record.py wrote"))?;
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
