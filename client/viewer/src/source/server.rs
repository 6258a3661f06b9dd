//! Tiles from an Insula server.

use super::{BoxFuture, ObjectSource, PendingGroup, PendingTile, TileSource, Transport};
use crate::scene::TileKey;
use crate::source::FetchError;
use bytes::Bytes;
use insula_archive::limits::max_tile_bytes;
use insula_objects::filter::FilteredObjects;
use insula_objects::search::SearchHit;
use insula_protocol::tile_group::{self, GroupMember};
use insula_protocol::{DecodeError, Manifest, TileGroup, TileKind, route};
use percent_encoding::{NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Largest response of a search.
const MAX_HITS_BYTES: usize = 1 << 20;
/// Largest result of a filter: a bit for each of 64 million objects, twice.
const MAX_FILTERED_BYTES: usize = 16 << 20;

/// One version of a city on a server.
#[derive(Debug)]
pub struct ServerSource {
    http: Arc<dyn Transport>,
    base: String,
    /// Appended to each address: a share link, or empty.
    query: String,
    name: String,
    version: String,
    /// The server does not know groups, or sent one that is none.
    lacks_groups: AtomicBool,
}

impl ServerSource {
    /// The city of `manifest` on the server at `base` (`http://host:port`). `query` is appended to the address of each tile.
    pub fn new(http: Arc<dyn Transport>, base: &str, query: &str, manifest: &Manifest) -> Self {
        let base = base.trim_end_matches('/').to_owned();
        let (name, version, lacks_groups) = (manifest.name.clone(), manifest.version.clone(), AtomicBool::new(false));
        Self { http, base, query: query.to_owned(), name, version, lacks_groups }
    }

    /// The address of `path` with the parameter `name`, further parameters and the share link.
    fn url_with_text(&self, path: &str, name: &str, text: &str, more: &str) -> String {
        let text = utf8_percent_encode(text, NON_ALPHANUMERIC);
        let share = self.query.strip_prefix('?').map(|share| format!("&{share}")).unwrap_or_default();
        format!("{}{path}?{name}={text}{more}{share}", self.base)
    }

    /// The response for a group that cannot be had: each tile is fetched by itself, from now on.
    fn without_groups(&self, keys: &[TileKey]) -> Vec<Option<Bytes>> {
        self.lacks_groups.store(true, Ordering::Relaxed);
        vec![None; keys.len()]
    }
}

impl TileSource for ServerSource {
    fn tile(&self, key: TileKey) -> PendingTile<'_> {
        let path = match key.kind() {
            TileKind::Mesh => route::mesh(&self.name, &self.version, key.id, key.lod),
            kind => route::tile(&self.name, &self.version, kind, key.id),
        };
        let url = format!("{}{path}{}", self.base, self.query);
        self.http.get(url, max_tile_bytes(key.kind()))
    }

    fn group<'a>(&'a self, group: TileGroup, keys: &'a [TileKey]) -> PendingGroup<'a> {
        Box::pin(async move {
            let url = format!("{}{}{}", self.base, route::group(&self.name, &self.version, group), self.query);
            let response = match self.http.get(url, tile_group::MAX_BYTES).await {
                // An older server. Or it lacks all of these tiles, which their own requests find out.
                Err(FetchError::Missing) => return Ok(self.without_groups(keys)),
                response => response?,
            };
            // Something on the way damages groups: tiles have checksums, and requests of their own.
            let Ok(members) = tile_group::decode(&response, group.node_count()) else {
                return Ok(self.without_groups(keys));
            };
            let tile = |key: &TileKey| match &members[group.position(key.id)?] {
                GroupMember::Tile(range) => Some(response.slice(range.clone())),
                GroupMember::Absent | GroupMember::LeftOut => None,
            };
            Ok(keys.iter().map(tile).collect())
        })
    }

    fn has_groups(&self) -> bool {
        !self.lacks_groups.load(Ordering::Relaxed)
    }

    fn location(&self) -> &str {
        &self.base
    }
}

impl ObjectSource for ServerSource {
    fn search<'a>(&'a self, query: &'a str, limit: usize) -> BoxFuture<'a, Result<Option<Vec<SearchHit>>, FetchError>> {
        let url = self.url_with_text(&route::search(&self.name, &self.version), "q", query, &format!("&limit={limit}"));
        Box::pin(async move {
            let bytes = match self.http.get(url, MAX_HITS_BYTES).await {
                Err(FetchError::Missing) => return Ok(None),
                response => response?,
            };
            let mut hits: Vec<SearchHit> = serde_json::from_slice(&bytes)
                .map_err(|_| FetchError::Damaged(DecodeError::Invalid("the hits of the search are not JSON")))?;
            hits.truncate(limit);
            Ok(Some(hits))
        })
    }

    fn filter<'a>(&'a self, text: &'a str) -> BoxFuture<'a, Result<Option<FilteredObjects>, FetchError>> {
        let url = self.url_with_text(&route::filter(&self.name, &self.version), "expr", text, "");
        Box::pin(async move {
            match self.http.get(url, MAX_FILTERED_BYTES).await {
                // An older server, or one that refuses the text.
                Err(FetchError::Missing) => Ok(None),
                response => FilteredObjects::decode(&response?).map(Some).map_err(FetchError::Damaged),
            }
        })
    }

    fn opens_objects(&self) -> bool {
        // `s1.KEY.CITY.VERSION.EXPIRY.SCOPE.MAC`, where a scope with an area has its corners.
        let link = percent_decode_str(&self.query).decode_utf8_lossy();
        link.rsplit('.').nth(1).is_none_or(|scope| !scope.contains('~'))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::RangeResponse;
    use futures_util::FutureExt as _;
    use insula_protocol::TileId;
    use insula_test_support::small_city::empty_manifest;
    use std::ops::Range;
    use std::pin::pin;
    use std::sync::Mutex;
    use std::task::{Context, Poll, Waker};

    /// Answers each request with `body`, and keeps its address.
    #[derive(Debug)]
    struct OneAnswer {
        body: Result<Bytes, FetchError>,
        asked: Mutex<String>,
    }

    impl Transport for OneAnswer {
        fn get(&self, url: String, _: usize) -> BoxFuture<'_, Result<Bytes, FetchError>> {
            *self.asked.lock().unwrap() = url;
            Box::pin(std::future::ready(self.body.clone()))
        }

        fn get_range(&self, _: String, _: Range<u64>) -> BoxFuture<'_, Result<RangeResponse, FetchError>> {
            Box::pin(std::future::ready(Err(FetchError::Missing)))
        }
    }

    fn search(body: Result<&'static str, FetchError>) -> (String, Result<Option<Vec<SearchHit>>, FetchError>) {
        let http = Arc::new(OneAnswer { body: body.map(Bytes::from), asked: Mutex::default() });
        let source = ServerSource::new(http.clone(), "http://h:1/", "?share=s", &empty_manifest(0));
        let mut future = pin!(source.search("Straße & 1", 3));
        let Poll::Ready(found) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) else {
            panic!("the answer is there at once");
        };
        let asked = http.asked.lock().unwrap().clone();
        (asked, found)
    }

    #[test]
    fn a_search_keeps_the_share_link_and_encodes_the_text() {
        let (asked, found) = search(Ok(r#"[{"text":"Straße 1","object":4,"typos":1}]"#));
        assert!(asked.ends_with("/search?q=Stra%C3%9Fe%20%26%201&limit=3&share=s"), "{asked}");
        assert_eq!(found.unwrap(), Some(vec![SearchHit { text: "Straße 1".into(), object: 4, typos: 1 }]));
    }

    #[test]
    fn a_link_for_an_area_opens_no_objects() {
        let opens_objects = |query: &str| {
            let http = Arc::new(OneAnswer { body: Err(FetchError::Missing), asked: Mutex::default() });
            ServerSource::new(http, "http://h:1", query, &empty_manifest(0)).opens_objects()
        };
        for (scope, is_whole) in [("a", true), ("r", true), ("r~0~0~5~5", false), ("a%7E-1%7E0%7E5%7E5", false)] {
            assert_eq!(opens_objects(&format!("?share=s1.k.delft.2026~.99.{scope}.00ff")), is_whole, "{scope}");
        }
        assert!(opens_objects("") && opens_objects("?share=s"));
    }

    fn fetch_group(body: Result<Bytes, FetchError>) -> (ServerSource, Result<Vec<Option<Bytes>>, FetchError>, String) {
        let http = Arc::new(OneAnswer { body, asked: Mutex::default() });
        let source = ServerSource::new(http.clone(), "http://h:1", "?share=s", &empty_manifest(0));
        let group = TileGroup::new(TileKind::BlockMap, TileId::new(1, 0, 0).unwrap(), 2, 0).unwrap();
        let keys: Vec<TileKey> = TileId::ROOT.children().skip(1).map(TileKey::block_map).collect();
        let tiles = source.group(group, &keys).now_or_never().unwrap();
        let asked = http.asked.lock().unwrap().clone();
        (source, tiles, asked)
    }

    #[test]
    fn a_group_gives_the_tiles_that_were_asked_for() {
        let members = [GroupMember::Tile(b"a"), GroupMember::Tile(b"b"), GroupMember::LeftOut, GroupMember::Absent];
        let body = Bytes::from(tile_group::encode(&members).unwrap());
        let (source, tiles, asked) = fetch_group(Ok(body));
        assert!(asked.ends_with("/groups/blockmaps/1/0/0/4/0?share=s"), "{asked}");
        assert_eq!(tiles.unwrap(), [Some(Bytes::from_static(b"b")), None, None]);
        assert!(source.has_groups());
    }

    #[test]
    fn single_tiles_are_fetched_where_groups_cannot_be_had() {
        for response in [Err(FetchError::Missing), Ok(Bytes::from_static(b"INSUx"))] {
            let (source, tiles, _) = fetch_group(response);
            assert_eq!(tiles.unwrap(), [None, None, None]);
            assert!(!source.has_groups());
        }
        let busy = FetchError::Busy { status: 503, retry_after: None };
        let (source, tiles, _) = fetch_group(Err(busy));
        assert!(tiles.is_err() && source.has_groups(), "for now");
    }

    #[test]
    fn a_city_without_a_search_has_no_hits_and_a_false_response_fails() {
        assert_eq!(search(Err(FetchError::Missing)).1.unwrap(), None);
        assert!(matches!(search(Ok("{}")).1, Err(FetchError::Damaged(_))));
    }
}
