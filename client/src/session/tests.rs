//! The flow over places that never answer.

use super::{
    flow::{Flow, Shot},
    *,
};
use crate::{
    scene::{Key, TileState},
    select::{
        priority::Wanted,
        tests::{load, tree, view},
    },
    stream::{
        fetch::{FetchError, Http},
        source::{Pending, Source},
    },
};
use insula_protocol::TileId;
use std::{future, sync::Arc};

/// Answers nothing, or with an error.
struct Nowhere {
    fails: bool,
}

impl Source for Nowhere {
    fn tile(&self, _: Key) -> Pending<'_> {
        match self.fails {
            true => Box::pin(future::ready(Err(FetchError::Network("gone".into())))),
            false => Box::pin(future::pending()),
        }
    }

    fn place(&self) -> &str {
        "nowhere"
    }
}

/// In a street, with the root's tile alone, after a picture in which all was seen.
fn looked(fails: bool) -> (Flow, Shot) {
    let mut tree = tree();
    load(&mut tree, Key::block_map(TileId::ROOT));
    let stream = Stream::new(Arc::new(Http::new(None).unwrap()), Arc::new(Nowhere { fails }), 12, None);
    let mut flow = Flow::new(tree, stream, 10_000);
    let camera = view([1030.0, -10.0, 2.0], [1030.0, 3000.0, 2.0]).camera;
    let shot = Shot { camera, heading: None, size_px: [640, 360], tau_px: 1.0 };
    flow.turn(&shot, Instant::now());
    let squares: Vec<_> = flow.selection.cut.iter().map(|item| item.square).collect();
    let pixels = vec![9; squares.len()];
    flow.feed(&Asked { squares, view: flow.view(&shot, camera), generation: 1 }, &pixels);
    (flow, shot)
}

/// Wanted, and not asked for.
fn waiting(flow: &Flow) -> Vec<Wanted> {
    let unknown = |w: &&Wanted| flow.tree.tile(w.key).is_some_and(|tile| tile.state() == TileState::Unknown);
    flow.selection.wanted.iter().filter(unknown).copied().collect()
}

#[test]
fn what_may_be_hidden_waits_unless_the_server_is_silent() {
    let (mut flow, shot) = looked(false);
    flow.turn(&shot, Instant::now());
    let (waits, wanted) = (waiting(&flow).len(), flow.selection.wanted.len());
    assert!(waits * 2 > wanted && waits < wanted, "{waits} of {wanted} wait");

    let (mut flow, shot) = looked(true);
    let begin = Instant::now();
    while flow.stream.failing_since().is_none() {
        assert!(begin.elapsed() < Duration::from_secs(20), "nothing fails");
        flow.turn(&shot, Instant::now());
        flow.stream.bell().wait(Duration::from_millis(10));
        assert!(flow.stream.arrival(&mut flow.tree, Instant::now()).is_none());
    }
    flow.turn(&shot, Instant::now());
    assert!(flow.selection.wanted.len() * 2 > wanted && waiting(&flow).is_empty());
}
