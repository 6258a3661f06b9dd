//! One tile: a header, vertices, triangles. What follows, the vertices on its edges and extensions, is not needed.
//!
//! Own code: the crate `quantized-mesh` 0.3 does not check indices or heights, unpacks gzip without a limit, and takes
//! 32-bit indices for 65,536 vertices, where the format still has 16-bit ones.

use super::super::error::RasterError;
use flate2::read::GzDecoder;
use std::io::Read;

/// The coordinate of a tile's eastern or northern edge, and the highest height.
pub(super) const MAX_COORDINATE: f32 = 32767.0;
/// The heights in a header's bytes.
const HEIGHTS_OFFSET: usize = 24;
const HEADER_BYTES: usize = 88;
/// Heights beyond are damage: 100 km.
const MAX_HEIGHT_M: f32 = 1e5;
/// With more vertices, indices have 32 bits.
const MAX_SHORT_VERTICES: usize = 1 << 16;
/// A mesh without overlaps has two triangles a vertex; writers add some without an area.
const MAX_TRIANGLES_PER_VERTEX: usize = 8;
/// Triangles that cover a tile more often than this are damage. This and the next number bound the time to read a tile.
const MAX_COVERS: f64 = 4.0;
/// The lengths of triangles from south to north, in sides of a tile, are together at most this times the root of their
/// number. Usual meshes have less than 2; 16,000 triangles with a common corner have 64.
const MAX_SLENDERNESS: f64 = 64.0;

/// Three corners: from the west and from the south, both from 0 to [`MAX_COORDINATE`], and the height in metres.
pub(super) type Triangle = [[f32; 3]; 3];

/// The bytes of a tile after those that were read.
struct TileBytes<'a> {
    rest: &'a [u8],
    read: usize,
}

/// Reads the triangles of a tile that have an area, at least one. A packed tile is unpacked to at most `max_bytes`.
///
/// Fails if the tile ends early, refers to vertices that it does not have, or has absurd numbers.
pub(super) fn read_triangles(bytes: &[u8], max_bytes: u64) -> Result<Vec<Triangle>, RasterError> {
    if bytes.starts_with(&[0x1f, 0x8b, 8]) { triangles(&unpack(bytes, max_bytes)?) } else { triangles(bytes) }
}

/// Unpacks gzip. Fails if it is damaged, or if there are more bytes than `max_bytes`.
fn unpack(bytes: &[u8], max_bytes: u64) -> Result<Vec<u8>, RasterError> {
    let mut unpacked = Vec::new();
    GzDecoder::new(bytes).take(max_bytes.saturating_add(1)).read_to_end(&mut unpacked)?;
    match unpacked.len() as u64 > max_bytes {
        true => Err(RasterError::TooLarge { what: "the number of bytes of a tile", limit: max_bytes }),
        false => Ok(unpacked),
    }
}

/// The triangles of an unpacked tile.
fn triangles(bytes: &[u8]) -> Result<Vec<Triangle>, RasterError> {
    let mut bytes = TileBytes { rest: bytes, read: 0 };
    let heights_m = heights_of_header(bytes.take(HEADER_BYTES)?)?;
    let vertices = vertices(&mut bytes, heights_m)?;
    let index_bytes = if vertices.len() > MAX_SHORT_VERTICES { 4 } else { 2 };
    bytes.align(index_bytes)?;
    let count = bytes.count()?;
    if count > vertices.len().saturating_mul(MAX_TRIANGLES_PER_VERTEX) {
        return Err(RasterError::damaged("it has too many triangles for its vertices"));
    }
    let indices = bytes.take_items(count, 3 * index_bytes)?;
    match index_bytes {
        2 => connect(&vertices, indices.as_chunks().0.iter().map(|bytes| u16::from_le_bytes(*bytes).into())),
        _ => connect(&vertices, indices.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes))),
    }
}

/// The lowest and the highest height in metres.
fn heights_of_header(header: &[u8]) -> Result<[f32; 2], RasterError> {
    let at = |offset: usize| header.get(offset..)?.first_chunk().map(|bytes| f32::from_le_bytes(*bytes));
    let heights = [at(HEIGHTS_OFFSET), at(HEIGHTS_OFFSET + 4)].map(|height| height.unwrap_or(f32::NAN));
    // Comparisons with NaN are false.
    let is_valid = heights.iter().all(|height| height.abs() <= MAX_HEIGHT_M) && heights[0] <= heights[1];
    is_valid.then_some(heights).ok_or_else(|| RasterError::damaged("its lowest and highest height are invalid"))
}

/// Vertices with their heights in metres. All of one coordinate come before those of the next.
fn vertices(bytes: &mut TileBytes<'_>, heights_m: [f32; 2]) -> Result<Vec<[f32; 3]>, RasterError> {
    let count = bytes.count()?;
    let mut coordinates = || coordinates(bytes.take_items(count, 2)?);
    let (from_west, from_south, heights) = (coordinates()?, coordinates()?, coordinates()?);
    let [low, high] = heights_m.map(f64::from);
    let height_m = |height: f32| (low + (high - low) * f64::from(height) / f64::from(MAX_COORDINATE)) as f32;
    let places = from_west.into_iter().zip(from_south);
    Ok(places.zip(heights).map(|((x, y), height)| [x, y, height_m(height)]).collect())
}

/// Whole numbers that are written as steps from one to the next, whose sign is in the last bit.
fn coordinates(bytes: &[u8]) -> Result<Vec<f32>, RasterError> {
    let mut coordinate = 0;
    let steps = bytes.as_chunks().0.iter().map(|bytes| i32::from(u16::from_le_bytes(*bytes)));
    let coordinates = steps.map(|step| {
        coordinate += step >> 1 ^ -(step & 1);
        let number = i16::try_from(coordinate).ok().filter(|number| *number >= 0);
        number.map(f32::from).ok_or_else(|| RasterError::damaged("one of its vertices is outside of it"))
    });
    coordinates.collect()
}

/// Triangles by the codes of their vertices: each is the distance below the number of vertices that were used so far.
fn connect(vertices: &[[f32; 3]], codes: impl Iterator<Item = u32>) -> Result<Vec<Triangle>, RasterError> {
    let mut used: u32 = 0;
    let mut corners = codes.map(|code| {
        let index = used.checked_sub(code);
        used += u32::from(code == 0);
        let vertex = index.and_then(|index| vertices.get(usize::try_from(index).ok()?));
        vertex.copied().ok_or_else(|| RasterError::damaged("one of its triangles has a vertex that does not exist"))
    });
    let (mut triangles, mut area, mut length) = (Vec::new(), 0.0, 0.0);
    while let Some(first) = corners.next() {
        let (Some(second), Some(third)) = (corners.next(), corners.next()) else { break };
        let triangle = [first?, second?, third?];
        let doubled_area = doubled_area(&triangle).abs();
        if doubled_area > 0.0 {
            area += doubled_area / 2.0;
            length += length_to_north(&triangle);
            triangles.push(triangle);
        }
    }
    if triangles.is_empty() {
        return Err(RasterError::damaged("it has no triangles"));
    }
    if area > MAX_COVERS * f64::from(MAX_COORDINATE).powi(2) {
        return Err(RasterError::damaged("its triangles overlap"));
    }
    if length > MAX_SLENDERNESS * f64::from(MAX_COORDINATE) * (triangles.len() as f64).sqrt() {
        return Err(RasterError::damaged("its triangles are too long"));
    }
    Ok(triangles)
}

/// Twice a triangle's area, negative if it is clockwise.
fn doubled_area(triangle: &Triangle) -> f64 {
    let [a, b, c] = triangle.map(|corner| corner.map(f64::from));
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// From a triangle's southern end to its northern one.
fn length_to_north(triangle: &Triangle) -> f64 {
    let [a, b, c] = triangle.map(|corner| corner[1]);
    f64::from(a.max(b).max(c) - a.min(b).min(c))
}

impl<'a> TileBytes<'a> {
    /// The next bytes. Fails if there are fewer.
    fn take(&mut self, count: usize) -> Result<&'a [u8], RasterError> {
        let parts = self.rest.split_at_checked(count);
        let (taken, rest) = parts.ok_or_else(|| RasterError::damaged("it ends too early"))?;
        (self.rest, self.read) = (rest, self.read + count);
        Ok(taken)
    }

    /// Bytes of a number of items, each with the same number of bytes.
    fn take_items(&mut self, count: usize, item_bytes: usize) -> Result<&'a [u8], RasterError> {
        self.take(count.saturating_mul(item_bytes))
    }

    fn count(&mut self) -> Result<usize, RasterError> {
        let bytes = self.take(4)?.first_chunk().copied().unwrap_or_default();
        usize::try_from(u32::from_le_bytes(bytes)).map_err(|_| RasterError::damaged("it has too many items"))
    }

    /// Leaves out the bytes before the next multiple of a number.
    fn align(&mut self, multiple: usize) -> Result<(), RasterError> {
        self.take(self.read.next_multiple_of(multiple) - self.read).map(|_| ())
    }
}
