//! Blocks of a remote object: how often they are fetched, and from where they come after a restart.

use super::*;
use futures_util::future::join_all;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// 1,000 bytes, the remainders of their positions by 251.
#[derive(Debug, Default)]
struct CountedObject {
    fetches: AtomicU64,
}

impl BlockObject for CountedObject {
    fn id(&self) -> u128 {
        7
    }

    fn length(&self) -> u64 {
        1000
    }

    fn fetch(&self, range: Range<u64>) -> BoxFuture<'_, Result<Bytes, ReadError>> {
        self.fetches.fetch_add(1, Ordering::Relaxed);
        assert!(range.start.is_multiple_of(64) && range.end <= 1000);
        Box::pin(async move {
            tokio::task::yield_now().await;
            Ok(range.map(|at| (at % 251) as u8).collect())
        })
    }
}

/// Waits for what another thread brings about.
async fn wait_until(condition: impl Fn() -> bool) {
    let poll = async {
        while !condition() {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(60), poll).await.expect("it does not come about");
}

type Events = Arc<Mutex<Vec<String>>>;

fn cache(folder: Option<&Path>, memory_bytes: u64) -> (Arc<BlockCache>, Events) {
    let folder = folder.map(Path::to_owned);
    let options = BlockCacheOptions { block_bytes: 64, memory_bytes, folder, folder_bytes: 100_000 };
    let events = Events::default();
    let log = events.clone();
    let cache = BlockCache::new(&options, move |event| log.lock().unwrap().push(format!("{event:?}"))).unwrap();
    (Arc::new(cache), events)
}

#[tokio::test]
async fn any_range_is_put_together_from_blocks() {
    let object = Arc::new(CountedObject::default());
    let source = cache(None, 1 << 20).0.source(object.clone());
    for range in [0..1, 0..64, 63..65, 100..900, 960..1000, 990..2000, 5..5, 1000..1000] {
        let expected: Vec<u8> = (range.start..range.end.min(1000)).map(|at| (at % 251) as u8).collect();
        let found = source.read(range.clone()).bytes().await.unwrap();
        assert_eq!(found, expected);
        assert!(found.is_empty() || found.is_unique(), "{range:?}: the bytes keep no block");
    }
    assert!(source.read(1001..1002).bytes().await.is_err());
    assert_eq!(object.fetches.load(Ordering::Relaxed), 16);
}

#[tokio::test]
async fn a_block_is_fetched_once_however_many_want_it() {
    let (cache, events) = cache(None, 1 << 20);
    let object = Arc::new(CountedObject::default());
    let source = cache.source(object.clone());
    let found = join_all((0..100).map(|at| source.read(at % 60..at % 60 + 2).bytes())).await;
    assert!(found.into_iter().all(|bytes| bytes.is_ok()));
    assert_eq!(object.fetches.load(Ordering::Relaxed), 1);
    let events = events.lock().unwrap();
    assert_eq!(events.iter().filter(|event| *event == "MemoryHit").count(), 99);
    assert_eq!(events.iter().filter(|event| *event == "Fetched").count(), 1);
}

#[tokio::test]
async fn blocks_outlive_the_process_until_they_are_invalidated() {
    let folder = tempfile::tempdir().unwrap();
    let object = Arc::new(CountedObject::default());
    let fetches = || object.fetches.load(Ordering::Relaxed);
    let source = cache(Some(folder.path()), 1 << 20).0.source(object.clone());
    source.read(0..64).bytes().await.unwrap();
    let path = folder.path().join(format!("{:032x}-0.block", 7));
    // The block is written after the response.
    wait_until(|| path.exists()).await;
    let (cache, events) = cache(Some(folder.path()), 0);
    let source = cache.source(object.clone());
    assert_eq!(source.read(3..5).bytes().await.unwrap(), &[3, 4][..]);
    assert_eq!((fetches(), events.lock().unwrap().pop().unwrap()), (1, "DiskHit".into()));
    source.invalidate(3..5).await;
    assert!(!path.exists());
    assert_eq!(source.read(3..5).bytes().await.unwrap(), &[3, 4][..]);
    assert_eq!(fetches(), 2);
}

#[tokio::test]
async fn a_folder_that_fails_is_reported_and_costs_fetches_only() {
    let folder = tempfile::tempdir().unwrap();
    let (cache, events) = cache(Some(folder.path()), 0);
    std::fs::remove_dir_all(folder.path()).unwrap();
    let source = cache.source(Arc::new(CountedObject::default()));
    for _ in 0..2 {
        assert_eq!(source.read(0..2).bytes().await.unwrap(), &[0, 1][..]);
    }
    wait_until(|| events.lock().unwrap().iter().any(|event| event.starts_with("DiskError"))).await;
}
