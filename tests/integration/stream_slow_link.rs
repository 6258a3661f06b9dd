//! Streaming over 0.6 Mbit/s and 80 ms: something whole at once, then better and better; what is out of sight is let go.

#![allow(clippy::unwrap_used)]

use anyhow::{Result, ensure};
use insula_shaders::{cpu::raycast::Pixels, layout::NO_NODE};
use insula_tests::{
    fixtures,
    programs::ServerProcess,
    proxy::{Link, Proxy},
    viewer::{Viewer, overlook},
};
use std::time::Duration;

const LINK: Link = Link { bits_per_sec: 6e5, round_trip: Duration::from_millis(80) };
/// Pixels a frame may lack though the city is all around them in the last one: a pole or two that coarse levels do not
/// keep. A single node that is not there is thousands.
const MOST_HOLES: usize = 640 * 360 / 5000;
/// Largest part of all bytes that may pass before there is a frame.
const FIRST_SHARE: f64 = 0.05;

#[test]
fn a_whole_picture_at_once_then_better_and_better() -> Result<()> {
    let server = ServerProcess::serve(&fixtures::baked_chiba()?, "127.0.0.1:0")?;
    let proxy = Proxy::start(server.address, LINK)?;
    let url = format!("http://{}", proxy.address);
    let mut viewer = Viewer::connect(&url, |manifest| overlook(manifest, false))?;
    let mut first_bytes = None;
    let mut frames: Vec<(f64, Pixels)> = Vec::new();
    viewer.until(Duration::from_secs(60), |viewer| {
        let counters = viewer.session.selection().stats;
        if counters.drawn > 0 {
            first_bytes.get_or_insert(proxy.bytes());
            // A frame whenever it may have changed.
            if frames.last().is_none_or(|(worst_px, _)| counters.worst_error_px != *worst_px) {
                frames.push((counters.worst_error_px, viewer.draw()?));
            }
        }
        Ok(viewer.session.is_settled())
    })?;
    let last = viewer.draw()?;
    let (first_bytes, all_bytes) = (first_bytes.unwrap_or(u64::MAX), proxy.bytes());
    println!("first frame after {first_bytes} bytes of {all_bytes}, {} stages", frames.len());
    ensure!(
        first_bytes as f64 <= FIRST_SHARE * all_bytes as f64,
        "first frame after {first_bytes} of {all_bytes} bytes"
    );
    // How many more there are depends on how long a frame takes.
    ensure!(frames.len() > 2, "only {} stages: the link is not slow", frames.len());
    let mut likeness = 0.0;
    for (stage, (worst_px, spec)) in frames.iter().enumerate() {
        let holes = holes(spec, &last, *worst_px);
        ensure!(holes <= MOST_HOLES, "stage {stage}: {holes} pixels are holes at {worst_px} px");
        let now = like(spec, &last);
        ensure!(now >= likeness - 0.01, "stage {stage} is worse than the one before: {now:.4} after {likeness:.4}");
        likeness = now;
    }
    ensure!(holes_would_be_seen(&last), "a missing node would go unseen");
    // Not at each step: what was hidden behind coarse buildings may be seen beside fine ones, and is coarse at first.
    ensure!(frames.last().is_some_and(|(worst_px, _)| *worst_px < frames[0].0), "the worst error has not fallen");
    ensure!(like(&frames[0].1, &last) < likeness, "the first frame was as good as the last");
    Ok(())
}

/// The check above can fail: the last frame without the node that most of it shows has holes.
fn holes_would_be_seen(last: &Pixels) -> bool {
    let mut counts = std::collections::BTreeMap::<u32, usize>::new();
    last.hit.iter().filter(|node| **node != NO_NODE).for_each(|node| *counts.entry(*node).or_default() += 1);
    let most = counts.into_iter().max_by_key(|(_, pixels)| *pixels).map(|(node, _)| node);
    let mut without = last.clone();
    for i in (0..without.hit.len()).filter(|i| Some(last.hit[*i]) == most) {
        without.distance[i] = f32::INFINITY;
    }
    holes(&without, last, 1.0) > MOST_HOLES
}

/// Pixels where the sky shows although in the last frame the city is all around, further than what is drawn may err.
fn holes(spec: &Pixels, last: &Pixels, worst_px: f64) -> usize {
    let reach = worst_px.ceil() as i64 + 1;
    let (width, height) = (i64::from(last.width_px), i64::from(last.height_px));
    let inside = |x: i64, y: i64| {
        let mut around = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (x + dx, y + dy)));
        around.all(|(x, y)| {
            let seen = x >= 0 && y >= 0 && x < width && y < height;
            seen && last.distance[(y * width + x) as usize].is_finite()
        })
    };
    let sky = (0..width * height).filter(|i| spec.distance[*i as usize].is_infinite());
    sky.filter(|i| inside(i % width, i / width)).count()
}

/// 1 where frames are the same, less the more their colours differ.
fn like(a: &Pixels, b: &Pixels) -> f64 {
    let difference: u64 = a
        .colour
        .iter()
        .zip(&b.colour)
        .flat_map(|(a, b)| a.to_le_bytes().into_iter().zip(b.to_le_bytes()))
        .map(|(a, b)| u64::from(a.abs_diff(b)))
        .sum();
    1.0 - difference as f64 / (a.colour.len() as f64 * 3.0 * 255.0)
}

#[test]
fn a_camera_turned_away_lets_go_of_what_it_wanted() -> Result<()> {
    let server = ServerProcess::serve(&fixtures::baked_chiba()?, "127.0.0.1:0")?;
    let proxy = Proxy::start(server.address, LINK)?;
    let url = format!("http://{}", proxy.address);
    let mut viewer = Viewer::connect(&url, |manifest| overlook(manifest, false))?;
    let away = overlook(viewer.session.tree().manifest(), true);
    viewer.until(Duration::from_secs(30), |viewer| Ok(viewer.loading().len() >= 8))?;
    let wanted = viewer.loading();
    viewer.look(&away)?;
    viewer.step()?;
    let still: Vec<_> = viewer.loading().into_iter().filter(|id| wanted.contains(id)).collect();
    let selected = &viewer.session.selection().requests;
    let unwanted = still.iter().filter(|id| !selected.iter().any(|w| w.key.id == **id)).count();
    ensure!(unwanted == 0, "{unwanted} of {} requests go on for tiles that nobody wants", wanted.len());
    ensure!(still.len() < wanted.len(), "the other view wants the same {} tiles", wanted.len());
    viewer.until(Duration::from_secs(30), |viewer| Ok(viewer.session.is_settled()))?;
    let begun = proxy.bytes();
    std::thread::sleep(Duration::from_millis(500));
    ensure!(proxy.bytes() - begun < 64 << 10, "bytes for the old view still arrive");
    // And back again: nothing was lost for good.
    let back = overlook(viewer.session.tree().manifest(), false);
    viewer.look(&back)?;
    viewer.until(Duration::from_secs(60), |viewer| Ok(viewer.session.is_settled()))
}
