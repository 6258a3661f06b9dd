//! The addresses of tiles, read without a copy.
//!
//! In: a path that anyone may have made. Out: [`TileAddress`], or why it is none. Next: `tile`.

use super::problem::Problem;
use insula_protocol::{
    TileId,
    mesh_tile::MAX_LODS,
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
    /// Which archive.
    pub layer: Layer,
    /// Whose tile.
    pub id: TileId,
    /// Which level of detail, below [`MAX_LODS`]; 0 but of meshes.
    pub lod: u8,
}

/// What is said of an address that looks like a tile's and cannot be one.
pub const NOT_A_TILE: Problem = Problem::bad_request(
    "level, x and y must be plain decimal numbers, level at most 20, x and y below 2^level, lod at most 3",
);

impl<'a> TileAddress<'a> {
    /// `None`: another address. An error: a tile that cannot be.
    pub fn parse(path: &'a str) -> Option<Result<Self, Problem>> {
        let mut parts = path.strip_prefix(CITIES)?.strip_prefix('/')?.split('/');
        let mut part = || parts.next();
        let (city, version, word) = (part()?, part()?, part()?);
        let layer = Layer::from_word(word)?;
        let (level, x, y) = (part()?, part()?, part()?);
        let lod = if layer == Layer::Meshes { part()? } else { "0" };
        if part().is_some() {
            return None;
        }
        let named = tile_id(level, x, y).zip(lod_of(lod));
        Some(named.map(|(id, lod)| Self { city, version, layer, id, lod }).ok_or(NOT_A_TILE))
    }
}

fn lod_of(text: &str) -> Option<u8> {
    u8::try_from(number(text)?).ok().filter(|lod| *lod < MAX_LODS)
}

fn tile_id(level: &str, x: &str, y: &str) -> Option<TileId> {
    TileId::new(u8::try_from(number(level)?).ok()?, number(x)?, number(y)?)
}

/// Decimal digits without sign or leading zeros.
fn number(text: &str) -> Option<u32> {
    let plain = text.bytes().all(|b| b.is_ascii_digit()) && (text == "0" || !text.starts_with('0'));
    if plain { text.parse().ok() } else { None }
}
