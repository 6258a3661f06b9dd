//! Streaming over a slow link: an early complete frame, steady refinement, cancelled requests.

use anyhow::{Result, ensure};
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::NO_NODE;
use insula_tests::programs::{ServerProcess, wait_until};
use insula_tests::proxy::Proxy;
use insula_tests::trials::Trials;
use insula_tests::viewer::{Viewer, overlook};
use insula_tests::{fixtures, tests};

/// Bytes of responses that suffice to connect.
const CONNECT_BYTES: usize = 1 << 20;
/// Bytes of responses that may arrive before each frame: before the first one that shows anything, and later.
const FIRST_BYTES: usize = 2 << 10;
const FRAME_BYTES: usize = 16 << 10;
/// Most pixels of a frame that may be holes: coarse levels lack thin things such as poles. A missing node has thousands of
/// pixels.
const MAX_HOLES: usize = 640 * 360 / 5000;
/// Largest part of all bytes that may arrive before the first frame.
const MAX_FIRST_SHARE: f64 = 0.05;
/// Most bytes that may arrive for cancelled requests, and as headers of others.
const MAX_WASTE: u64 = 64 << 10;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![an_early_complete_frame_is_refined_steadily, turning_away_cancels_requests]);
}

fn an_early_complete_frame_is_refined_steadily() -> Result<()> {
    let server = ServerProcess::serve(&fixtures::baked_chiba()?, "127.0.0.1:0")?;
    let proxy = Proxy::start(server.address, CONNECT_BYTES)?;
    let url = format!("http://{}", proxy.address);
    let mut viewer = Viewer::connect(&url, |manifest| overlook(manifest, false))?;
    let mut first_bytes = None;
    let mut frames: Vec<(f64, Pixels)> = Vec::new();
    viewer.step_until("everything is there", |viewer| {
        let counters = viewer.session.selection().stats;
        if counters.drawn > 0 {
            first_bytes.get_or_insert(proxy.bytes());
            // Draws whenever the frame may have changed.
            if frames.last().is_none_or(|(worst_px, _)| counters.worst_error_px != *worst_px) {
                frames.push((counters.worst_error_px, viewer.draw()?));
            }
        }
        proxy.allow(if frames.is_empty() { FIRST_BYTES } else { FRAME_BYTES });
        Ok(viewer.session.is_settled())
    })?;
    let last = viewer.draw()?;
    let (first_bytes, all_bytes) = (first_bytes.unwrap_or(u64::MAX), proxy.bytes());
    println!("first frame after {first_bytes} bytes of {all_bytes}, {} stages", frames.len());
    ensure!(
        first_bytes as f64 <= MAX_FIRST_SHARE * all_bytes as f64,
        "first frame after {first_bytes} of {all_bytes} bytes"
    );
    ensure!(frames.len() > 2, "only {} stages: the link is not slow", frames.len());
    let mut best_similarity = 0.0;
    for (stage, (worst_px, frame)) in frames.iter().enumerate() {
        let holes = holes(frame, &last, *worst_px);
        ensure!(holes <= MAX_HOLES, "stage {stage}: {holes} pixels are holes at {worst_px} px");
        let now = similarity(frame, &last);
        ensure!(
            now >= best_similarity - 0.01,
            "stage {stage} is worse than the one before: {now:.4} after {best_similarity:.4}"
        );
        best_similarity = now;
    }
    ensure!(check_detects_holes(&last), "the check does not find a missing node");
    // Not in each step: a node that becomes visible beside refined buildings is coarse at first.
    ensure!(frames.last().is_some_and(|(worst_px, _)| *worst_px < frames[0].0), "the worst error has not fallen");
    ensure!(similarity(&frames[0].1, &last) < best_similarity, "the first frame was as good as the last");
    Ok(())
}

/// The check finds a hole: the last frame without the node that covers most of it.
fn check_detects_holes(last: &Pixels) -> bool {
    let mut counts = std::collections::BTreeMap::<u32, usize>::new();
    last.hit.iter().filter(|node| **node != NO_NODE).for_each(|node| *counts.entry(*node).or_default() += 1);
    let largest = counts.into_iter().max_by_key(|(_, pixels)| *pixels).map(|(node, _)| node);
    let mut without = last.clone();
    for i in (0..without.hit.len()).filter(|i| Some(last.hit[*i]) == largest) {
        without.distance[i] = f32::INFINITY;
    }
    holes(&without, last, 1.0) > MAX_HOLES
}

/// Sky pixels in places where the last frame shows the city all around, beyond the tolerated error.
fn holes(frame: &Pixels, last: &Pixels, worst_px: f64) -> usize {
    let reach = worst_px.ceil() as i64 + 1;
    let (width, height) = (i64::from(last.width_px), i64::from(last.height_px));
    let inside = |x: i64, y: i64| {
        let mut around = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (x + dx, y + dy)));
        around.all(|(x, y)| {
            let seen = x >= 0 && y >= 0 && x < width && y < height;
            seen && last.distance[(y * width + x) as usize].is_finite()
        })
    };
    let sky = (0..width * height).filter(|i| frame.distance[*i as usize].is_infinite());
    sky.filter(|i| inside(i % width, i / width)).count()
}

/// 1 for equal frames, less for larger differences of colours.
fn similarity(a: &Pixels, b: &Pixels) -> f64 {
    let difference: u64 = a
        .colour
        .iter()
        .zip(&b.colour)
        .flat_map(|(a, b)| a.to_le_bytes().into_iter().zip(b.to_le_bytes()))
        .map(|(a, b)| u64::from(a.abs_diff(b)))
        .sum();
    1.0 - difference as f64 / (a.colour.len() as f64 * 3.0 * 255.0)
}

fn turning_away_cancels_requests() -> Result<()> {
    let server = ServerProcess::serve(&fixtures::baked_chiba()?, "127.0.0.1:0")?;
    let proxy = Proxy::start(server.address, CONNECT_BYTES)?;
    let url = format!("http://{}", proxy.address);
    let mut viewer = Viewer::connect(&url, |manifest| overlook(manifest, false))?;
    let away = overlook(viewer.session.tree().manifest(), true);
    viewer.step_until("eight tiles are in flight", |viewer| {
        proxy.allow(FIRST_BYTES);
        Ok(viewer.loading().len() >= 8)
    })?;
    // Nothing arrives while the view turns.
    proxy.allow(0);
    let (before, closed) = (viewer.loading(), proxy.closed());
    viewer.set_camera(&away)?;
    viewer.step()?;
    let still: Vec<_> = viewer.loading().into_iter().filter(|id| before.contains(id)).collect();
    let selected = &viewer.session.selection().requests;
    let stale = still.iter().filter(|id| !selected.iter().any(|request| request.key.id == **id)).count();
    ensure!(stale == 0, "{stale} of {} requests continue, although the view does not need them", before.len());
    ensure!(still.len() < before.len(), "the other view needs the same {} tiles", before.len());
    wait_until("the connections of cancelled requests are closed", || proxy.closed() > closed);
    let taken = |viewer: &Viewer| viewer.session.report(1.0).bytes_fetched;
    let (sent_before, taken_before) = (proxy.bytes(), taken(&viewer));
    viewer.step_until("the other view is there", |viewer| {
        proxy.allow(FIRST_BYTES);
        Ok(viewer.session.is_settled())
    })?;
    let waste = (proxy.bytes() - sent_before).saturating_sub(taken(&viewer) - taken_before);
    ensure!(waste < MAX_WASTE, "{waste} bytes arrived for the old view");
    // Turns back: nothing is lost permanently.
    proxy.open();
    let back = overlook(viewer.session.tree().manifest(), false);
    viewer.set_camera(&back)?;
    viewer.step_until("everything is there", |viewer| Ok(viewer.session.is_settled()))
}
