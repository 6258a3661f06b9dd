//! One request for several tiles.

use super::{BoxFuture, TileSource};
use crate::scene::TileKey;
use crate::source::FetchError;
use bytes::Bytes;
use futures_util::FutureExt as _;
use futures_util::future::Shared;
use insula_protocol::TileGroup;
use std::sync::Arc;

type GroupResponse = Result<Arc<[Option<Bytes>]>, FetchError>;

/// A request for several tiles of a group, which all who want one of the tiles share. It ends when the last of them gives up.
#[derive(Clone)]
pub struct GroupRequest {
    source: Arc<dyn TileSource>,
    keys: Arc<[TileKey]>,
    response: Shared<BoxFuture<'static, GroupResponse>>,
}

impl GroupRequest {
    /// The request for the tiles `keys` of `group`. Starts when the first tile is waited for.
    pub fn new(source: Arc<dyn TileSource>, group: TileGroup, keys: Vec<TileKey>) -> Self {
        let (keys, asked): (Arc<[TileKey]>, _) = (keys.into(), source.clone());
        let wanted = keys.clone();
        let response: BoxFuture<'static, GroupResponse> =
            Box::pin(async move { Ok(asked.group(group, &wanted).await?.into()) });
        Self { source, keys, response: response.shared() }
    }

    /// The bytes of one of the tiles. A tile that the response lacks is fetched by itself.
    pub async fn tile(self, key: TileKey) -> Result<Bytes, FetchError> {
        let Self { source, keys, response } = self;
        let tiles = response.await?;
        let found = keys.iter().position(|other| *other == key).and_then(|at| tiles.get(at).cloned().flatten());
        match found {
            Some(bytes) => Ok(bytes),
            None => source.tile(key).await,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{PendingGroup, PendingTile};
    use insula_protocol::{TileId, TileKind};
    use std::sync::Mutex;

    /// Responds to groups with all tiles but the last one.
    #[derive(Default)]
    struct Counting(Mutex<(usize, Vec<TileKey>)>);

    impl TileSource for Counting {
        fn tile(&self, key: TileKey) -> PendingTile<'_> {
            self.0.lock().unwrap().1.push(key);
            Box::pin(async { Ok(Bytes::from_static(b"alone")) })
        }

        fn group<'a>(&'a self, _: TileGroup, keys: &'a [TileKey]) -> PendingGroup<'a> {
            self.0.lock().unwrap().0 += 1;
            let last = keys.len() - 1;
            Box::pin(async move {
                Ok((0..keys.len()).map(|at| (at < last).then(|| Bytes::from_static(b"together"))).collect())
            })
        }

        fn location(&self) -> &str {
            "here"
        }
    }

    #[test]
    fn tiles_share_one_request_and_those_left_out_are_fetched_alone() {
        let source = Arc::new(Counting::default());
        let group = TileGroup::new(TileKind::BlockMap, TileId::new(1, 0, 0).unwrap(), 2, 0).unwrap();
        let keys: Vec<TileKey> = group.nodes().map(TileKey::block_map).collect();
        let request = GroupRequest::new(source.clone(), group, keys.clone());
        assert_eq!(*source.0.lock().unwrap(), (0, vec![]));
        for (at, key) in keys.iter().enumerate() {
            let bytes = request.clone().tile(*key).now_or_never().unwrap().unwrap();
            assert_eq!(bytes, if at < 3 { "together" } else { "alone" });
        }
        assert_eq!(*source.0.lock().unwrap(), (1, vec![keys[3]]));
    }
}
