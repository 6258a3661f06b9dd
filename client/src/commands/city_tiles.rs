//! Tiles of a city one by one, for commands that read all of them.

use crate::stream::city::OpenedCity;
use crate::stream::fetch::Http;
use crate::stream::jitter::jitter;
use bytes::Bytes;
use insula_archive::ReadError;
use insula_protocol::{TileId, TileKind};
use insula_viewer::scene::TileKey;
use insula_viewer::scene::tile::retry_delay;
use insula_viewer::source::FetchError;

/// A tile of a city at an address is given up after so many failures.
const MAX_ATTEMPTS: u8 = 5;

/// Fetches a tile of a city at an address, and asks again where that may help; `None` if there is no such tile.
pub(super) fn fetch_tile(
    http: &Http,
    city: &OpenedCity,
    kind: TileKind,
    place: TileId,
) -> Result<Option<Bytes>, ReadError> {
    let Some(key) = TileKey::in_archive(kind, place, city.manifest.depth) else { return Ok(None) };
    for attempt in 1.. {
        let wait = match http.block_on(city.source.tile(key)) {
            Ok(bytes) => return Ok(Some(bytes)),
            Err(FetchError::Missing) => return Ok(None),
            Err(FetchError::Unusable(reason)) => return Err(ReadError::Unusable(reason)),
            Err(error) if attempt == MAX_ATTEMPTS => return Err(ReadError::Failed(error.to_string())),
            Err(error) => retry_delay(attempt, error.retry_after(), jitter()),
        };
        std::thread::sleep(wait);
    }
    Ok(None)
}
