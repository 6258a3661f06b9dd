//! What columns fill: one solid, or two with a gap between them.

use super::mean;
use crate::geometry::NO_FEATURE;
use crate::source::SourceError;
use insula_protocol::BlockMap;
use insula_protocol::blockmap::{COLUMNS, ColumnObjects, MapColumn, NO_OBJECT};

/// A vertical interval of a column, with what it shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Solid {
    /// Sixteenths of a cell above the node's base, `low < high`.
    pub(super) low: u32,
    pub(super) high: u32,
    /// Seen from above, 8-bit sRGB.
    pub(super) roof: [u8; 3],
    /// Mean of the wall strip; `None` without one.
    pub(super) wall: Option<[u8; 3]>,
    /// Feature of the object.
    pub(super) feature: u32,
    /// Whether there is empty space below it.
    pub(super) is_floating: bool,
}

/// The solids of a node by column: the tops, and what lies below gaps.
pub(super) type Layers = [Vec<Option<Solid>>; 2];

/// The solids of all columns, with the objects of `objects`. A column of which a clip cuts away the middle of its cell counts as what lies beyond the clip.
pub(super) fn layers(
    map: &BlockMap,
    objects: Option<&ColumnObjects>,
    feature: &mut dyn FnMut(u32, usize) -> Result<Option<u32>, SourceError>,
) -> Result<Layers, SourceError> {
    let mut layers = [vec![None; COLUMNS], vec![None; COLUMNS]];
    for (i, column) in map.columns().iter().enumerate() {
        let Some(column) = column else { continue };
        let Some((column, part)) = at_middle(column) else { continue };
        let object = |part: Part| {
            objects.map_or(NO_OBJECT, |objects| match part {
                Part::Top => objects.roof[i],
                Part::Lower => objects.lower[i],
            })
        };
        let [top, below] = solids(map, &column);
        for (layer, solid, part) in [(0, top, part), (1, below, Part::Lower)] {
            let Some(solid) = solid else { continue };
            if let Some(feature) = feature(object(part), i)? {
                layers[layer][i] = Some(Solid { feature, ..solid });
            }
        }
    }
    Ok(layers)
}

/// Which part of a column, as [`ColumnObjects`] has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Top,
    /// Beyond the clip, or below the gap.
    Lower,
}

/// The part of a column in the middle of its cell; `None` if that is empty.
fn at_middle(column: &MapColumn) -> Option<(MapColumn, Part)> {
    let inner = MapColumn { clip: None, ..column.clone() };
    let Some(clip) = column.clip else { return Some((inner, Part::Top)) };
    if clip.fills_middle() {
        return Some((inner, Part::Top));
    }
    let outer = clip.outer?;
    Some((MapColumn { z_max: outer.z, roof: outer.roof, strip: None, gap: None, ..inner }, Part::Lower))
}

/// The solid at the top of a column without a clip, and the one below its gap.
fn solids(map: &BlockMap, column: &MapColumn) -> [Option<Solid>; 2] {
    let opaque = column.strip.iter().flat_map(|strip| &strip.texels).filter(|texel| !texel.is_open());
    let wall = mean(opaque.map(|texel| texel.rgb()));
    let solid = |low: u16, high: u16, is_floating: bool| {
        let [low, high] = [low, high].map(|code| u32::from(code) << map.z_shift);
        Some(Solid { low, high, roof: column.roof.rgb(), wall, feature: NO_FEATURE, is_floating })
    };
    match column.gap {
        Some([bottom, top]) => [solid(top, column.z_max, true), solid(column.z_min, bottom, column.suspended)],
        None => [solid(column.z_min, column.z_max, column.suspended), None],
    }
}
