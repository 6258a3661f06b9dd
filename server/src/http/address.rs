//! The addresses of tiles, read without a copy.
//!
//! In: a path that anyone may have made. Out: [`TileAddress`], or why it is none. Next: `tile`.

use super::Problem;
use insula_protocol::{
    TileId,
    route::{CITIES, Layer},
};

/// `/v1/cities/{city}/{version}/{layer}/{level}/{x}/{y}`, or `.../meshes/{level}/{x}/{y}/{lod}`.
///
/// Nothing in it is percent-decoded: names and numbers need no encoding, so that each tile has one address and caches hold
/// it once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileAddress<'a> {
    /// As it stands in the address; it need not exist.
    pub city: &'a str,
    /// As it stands in the address; it need not exist.
    pub version: &'a str,
    /// `None`: a mesh.
    pub layer: Option<Layer>,
    /// Whose tile.
    pub id: TileId,
}

/// What is said of an address that looks like a tile's and cannot be one.
pub const NOT_A_TILE: Problem =
    Problem::bad_request("level, x and y must be plain decimal numbers, level at most 20, x and y below 2^level");

impl<'a> TileAddress<'a> {
    /// `None`: another address. An error: a tile that cannot be.
    pub fn parse(path: &'a str) -> Option<Result<Self, Problem>> {
        let mut parts = path.strip_prefix(CITIES)?.strip_prefix('/')?.split('/');
        let mut part = || parts.next();
        let (city, version, word) = (part()?, part()?, part()?);
        let layer = Layer::from_word(word);
        if layer.is_none() && word != "meshes" {
            return None;
        }
        let (level, x, y) = (part()?, part()?, part()?);
        let lod = if layer.is_none() { Some(part()?) } else { None };
        if part().is_some() {
            return None;
        }
        let id = tile_id(level, x, y).filter(|_| lod.is_none_or(|lod| number(lod).is_some_and(|lod| lod < 256)));
        Some(id.map(|id| Self { city, version, layer, id }).ok_or(NOT_A_TILE))
    }
}

fn tile_id(level: &str, x: &str, y: &str) -> Option<TileId> {
    TileId::new(u8::try_from(number(level)?).ok()?, number(x)?, number(y)?)
}

/// Decimal digits without sign or leading zeros.
fn number(text: &str) -> Option<u32> {
    let plain = text.bytes().all(|b| b.is_ascii_digit()) && (text == "0" || !text.starts_with('0'));
    if plain { text.parse().ok() } else { None }
}
