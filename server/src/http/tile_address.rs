//! Parses the URL paths of tiles, without allocation.

use super::problem::Problem;
use insula_protocol::{TileId, TileKind, mesh_tile::MAX_LODS, route::CITIES};

/// A parsed `/v1/cities/{city}/{version}/{layer}/{level}/{x}/{y}`, or `.../meshes/{level}/{x}/{y}/{lod}`.
///
/// Nothing is percent-decoded, because names and numbers need no escapes. So each tile has exactly one URL, and caches hold
/// it once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileAddress<'a> {
    /// Not checked: it may be unknown, or not even a valid name.
    pub city: &'a str,
    /// Not checked either.
    pub version: &'a str,
    pub layer: TileKind,
    pub id: TileId,
    /// Level of detail of a mesh, below [`MAX_LODS`]; 0 in other layers.
    pub lod: u8,
}

/// Response to a path that has the form of a tile's but numbers out of range.
pub const NOT_A_TILE: Problem = Problem::bad_request(
    "level, x and y must be plain decimal numbers, level at most 20, x and y below 2^level, lod at most 3",
);

impl<'a> TileAddress<'a> {
    /// `None` if the path is not a tile's. Fails with [`NOT_A_TILE`] if its numbers are invalid.
    pub fn parse(path: &'a str) -> Option<Result<Self, Problem>> {
        let mut parts = path.strip_prefix(CITIES)?.strip_prefix('/')?.split('/');
        let mut part = || parts.next();
        let (city, version, word) = (part()?, part()?, part()?);
        let layer = TileKind::from_path_segment(word)?;
        let (level, x, y) = (part()?, part()?, part()?);
        let lod = if layer == TileKind::Mesh { part()? } else { "0" };
        if part().is_some() {
            return None;
        }
        let numbers = parse_tile_id(level, x, y).zip(parse_lod(lod));
        Some(numbers.map(|(id, lod)| Self { city, version, layer, id, lod }).ok_or(NOT_A_TILE))
    }
}

fn parse_lod(text: &str) -> Option<u8> {
    u8::try_from(parse_number(text)?).ok().filter(|lod| *lod < MAX_LODS)
}

fn parse_tile_id(level: &str, x: &str, y: &str) -> Option<TileId> {
    TileId::new(u8::try_from(parse_number(level)?).ok()?, parse_number(x)?, parse_number(y)?)
}

/// Decimal digits without sign or leading zeros.
fn parse_number(text: &str) -> Option<u32> {
    let is_canonical = text.bytes().all(|b| b.is_ascii_digit()) && (text == "0" || !text.starts_with('0'));
    if is_canonical { text.parse().ok() } else { None }
}
