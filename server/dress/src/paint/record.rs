//! Shapes as bytes of the scratch file, little-endian.
//!
//! ```text
//! u8 kind (0 area, 1 line), u8 class, u8 surfacing (255: none)
//! line: u8 lanes (0: unknown), u8 one-way, u8 sidewalks, f64 width
//! u32 rings; each: u32 positions; each: f64 x, f64 y
//! ```

use crate::map_store::{MapBounds, MapRecord, bounds};
use crate::paint::class::{AreaClass, LineClass};
use crate::paint::shape::{PaintArea, PaintLine, PaintShape, Sidewalks};
use crate::paint::surfacing::Surfacing;

const AREA: u8 = 0;
const LINE: u8 = 1;
const NO_SURFACING: u8 = u8::MAX;
const POSITION_BYTES: usize = 16;

/// A shape touches a picture if its bounds do.
impl MapRecord for PaintShape {
    fn bounds(&self) -> Option<MapBounds> {
        match self {
            Self::Area(area) => bounds(area.rings.iter().flatten()),
            Self::Line(line) => {
                let [low, high] = bounds(&line.points)?;
                let reach_m = line.reach_m();
                Some([low.map(|v| v - reach_m), high.map(|v| v + reach_m)])
            }
        }
    }

    fn size_bytes(&self) -> u64 {
        let ring = |ring: &Vec<[f64; 2]>| 4 + (ring.len() * POSITION_BYTES) as u64;
        match self {
            Self::Area(area) => 3 + 4 + area.rings.iter().map(ring).sum::<u64>(),
            Self::Line(line) => 3 + 3 + 8 + 4 + ring(&line.points),
        }
    }

    fn encode(&self, bytes: &mut Vec<u8>) {
        let surfacing = |surfacing: Option<Surfacing>| surfacing.map_or(NO_SURFACING, |surfacing| surfacing as u8);
        match self {
            Self::Area(area) => {
                bytes.extend([AREA, area.class as u8, surfacing(area.surfacing)]);
                encode_rings(&area.rings, bytes);
            }
            Self::Line(line) => {
                bytes.extend([LINE, line.class as u8, surfacing(line.surfacing)]);
                bytes.extend([line.lanes.unwrap_or(0), u8::from(line.is_one_way), line.sidewalks as u8]);
                bytes.extend(line.width_m.to_le_bytes());
                encode_rings(std::slice::from_ref(&line.points), bytes);
            }
        }
    }

    fn decode(bytes: &[u8]) -> Option<Self> {
        decode(bytes)
    }
}

fn encode_rings(rings: &[Vec<[f64; 2]>], bytes: &mut Vec<u8>) {
    // Counts fit: the record is below 4 GiB.
    bytes.extend((rings.len() as u32).to_le_bytes());
    for ring in rings {
        bytes.extend((ring.len() as u32).to_le_bytes());
        bytes.extend(ring.iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
}

fn decode(mut bytes: &[u8]) -> Option<PaintShape> {
    let [kind, class, surfacing] = take(&mut bytes)?;
    let surfacing = match surfacing {
        NO_SURFACING => None,
        number => Some(*Surfacing::ALL.get(usize::from(number))?),
    };
    let shape = match kind {
        AREA => {
            let class = *AreaClass::ALL.get(usize::from(class))?;
            PaintShape::Area(PaintArea { rings: decode_rings(&mut bytes)?, class, surfacing })
        }
        LINE => {
            let class = *LineClass::ALL.get(usize::from(class))?;
            let [lanes, is_one_way, sidewalks] = take(&mut bytes)?;
            PaintShape::Line(PaintLine {
                class,
                surfacing,
                lanes: (lanes > 0).then_some(lanes),
                is_one_way: is_one_way != 0,
                sidewalks: *Sidewalks::ALL.get(usize::from(sidewalks))?,
                width_m: f64::from_le_bytes(take(&mut bytes)?),
                points: decode_rings(&mut bytes)?.pop()?,
            })
        }
        _ => return None,
    };
    bytes.is_empty().then_some(shape)
}

fn decode_rings(bytes: &mut &[u8]) -> Option<Vec<Vec<[f64; 2]>>> {
    let count = u32::from_le_bytes(take(bytes)?) as usize;
    // Each ring has at least its count.
    if count > bytes.len() / 4 {
        return None;
    }
    (0..count).map(|_| decode_ring(bytes)).collect()
}

fn decode_ring(bytes: &mut &[u8]) -> Option<Vec<[f64; 2]>> {
    let count = u32::from_le_bytes(take(bytes)?) as usize;
    let (positions, rest) = bytes.split_at_checked(count.checked_mul(POSITION_BYTES)?)?;
    *bytes = rest;
    let (positions, _) = positions.as_chunks::<POSITION_BYTES>();
    let position =
        |mut bytes: &[u8]| Some([f64::from_le_bytes(take(&mut bytes)?), f64::from_le_bytes(take(&mut bytes)?)]);
    positions.iter().map(|bytes| position(bytes)).collect()
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}
