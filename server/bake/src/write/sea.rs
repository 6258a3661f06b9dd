//! Where a city ends in the sea: by the objects that the sources call sea, as the nodes of a few levels show them.

use super::tile_bytes::TileContent;
use super::tile_tree::TileTree;
use crate::error::BakeError;
use crate::scene::grid::CityGrid;
use crate::scene::object_records::SourceRecord;
use insula_objects::FeatureKind;
use insula_objects::value::Value;
use insula_protocol::blockmap::ground::GROUND_COLOUR;
use insula_protocol::blockmap::{COLUMNS, NO_OBJECT, flag};
use insula_protocol::sea::SeaEnds;
use insula_protocol::{BlockMap, NODE_CELLS};
use insula_shaders::shore::{Cell, CellEnds};

/// Cells of so many levels below the root are looked at: 512 along a side. Those of the root are often wider than a harbour.
const LEVELS: u8 = 3;
/// Attributes by which maps tell the sea from other water: the coastline of OpenStreetMap, the ocean of Overture.
const OF_SEA: [(&str, &str); 3] = [("natural", "coastline"), ("subtype", "ocean"), ("class", "ocean")];

/// Level ground on which nothing is painted differs by so little from generated ground, in each channel: textures have losses.
const BARE_TOLERANCE: u8 = 10;

/// Numbers of a city's objects, in ascending order.
#[derive(Debug, Default)]
pub(crate) struct SeaAndLand {
    pub(crate) sea: Vec<u32>,
    /// Terrain.
    pub(crate) land: Vec<u32>,
}

/// Whether an object is a part of the sea.
pub(super) fn is_sea(record: &SourceRecord) -> bool {
    let says_so = |(name, value): &(String, Value)| matches!(value, Value::Text(text) if OF_SEA.iter().any(|(key, sea)| name == key && text == sea));
    record.kind == FeatureKind::Water && record.attributes.iter().any(says_so)
}

/// The ends of a city in the sea; `None` if it has none. `corner_m` is the south-west corner of the root in the world. Fails if a tile
/// cannot be read.
pub(super) fn ends(
    (tree, grid): (&TileTree, &CityGrid),
    corner_m: [f64; 2],
    known: &SeaAndLand,
    tiles: &mut dyn TileContent,
) -> Result<Option<SeaEnds>, BakeError> {
    if known.sea.is_empty() {
        return Ok(None);
    }
    let depth = grid.depth.min(LEVELS);
    let side = NODE_CELLS << depth;
    let (mut cells, mut colours) = (vec![Cell::Bare; side * side], Vec::new());
    // Finer nodes replace what coarser ones show of their area, which remains where they are left out.
    for tile in (0..=depth).flat_map(|level| tree.level(level)) {
        let map = BlockMap::decode(tile.id, &tiles.tile(tile)?).map_err(BakeError::tile(tile.id, "decoded"))?;
        let width = 1_usize << (depth - tile.id.level());
        let corner = [tile.id.x(), tile.id.y()].map(|place| place as usize * NODE_CELLS * width);
        for i in 0..COLUMNS {
            let cell = cell_of(&map, i, known);
            if cell == Cell::Water {
                colours.push(map.roof[i].rgb());
            }
            let [x, y] = [corner[0] + i % NODE_CELLS * width, corner[1] + i / NODE_CELLS * width];
            for row in y..y + width {
                cells[row * side + x..][..width].fill(cell);
            }
        }
    }
    let Some(found) = CellEnds::of_sea(&cells, side) else { return Ok(None) };
    let cell_m = grid.cell_m_at(depth);
    let [west, south, east, north] = found.ends.map(|end| end as f64 * cell_m);
    Ok(Some(SeaEnds {
        ends: [[west, south], [east, north]].map(|end| [0, 1].map(|axis| corner_m[axis] + end[axis])),
        step_m: found.step as f64 * cell_m,
        sides: SeaEnds::text_of(&found.sides),
        rgb: median(&mut colours),
    }))
}

/// What a column shows from above.
fn cell_of(map: &BlockMap, column: usize, known: &SeaAndLand) -> Cell {
    let is_there = map.flags[column] & flag::OCCUPIED != 0;
    // Generated ground is no object.
    let object = map.objects.as_ref().map_or(NO_OBJECT, |objects| objects.roof[column]);
    // Level ground reaches beyond the map, and beyond its sea.
    let is_bare = || is_bare(map.roof[column].rgb()) && known.land.binary_search(&object).is_ok();
    match is_there && object != NO_OBJECT {
        true if known.sea.binary_search(&object).is_ok() => Cell::Water,
        true if !is_bare() => Cell::Other,
        _ => Cell::Bare,
    }
}

fn is_bare(rgb: [u8; 3]) -> bool {
    rgb.iter().zip(GROUND_COLOUR).all(|(a, b)| a.abs_diff(b) <= BARE_TOLERANCE)
}

/// The median of each channel; black of none.
fn median(colours: &mut [[u8; 3]]) -> [u8; 3] {
    let middle = colours.len() / 2;
    [0, 1, 2].map(|channel| {
        if middle == colours.len() {
            return 0;
        }
        colours.select_nth_unstable_by_key(middle, |colour| colour[channel]).1[channel]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sea_is_water_that_is_called_so() {
        let record = |kind, name: &str, value: &str| SourceRecord {
            identifier: "1".to_owned(),
            kind,
            attributes: vec![(name.to_owned(), Value::Text(value.to_owned()))],
        };
        assert!(is_sea(&record(FeatureKind::Water, "natural", "coastline")));
        assert!(is_sea(&record(FeatureKind::Water, "subtype", "ocean")));
        assert!(!is_sea(&record(FeatureKind::Water, "natural", "water")));
        assert!(!is_sea(&record(FeatureKind::LandUse, "natural", "coastline")));
        assert!(!is_sea(&record(FeatureKind::Water, "name", "ocean")));
    }

    #[test]
    fn ground_without_paint_is_bare() {
        assert!(is_bare(GROUND_COLOUR) && is_bare(GROUND_COLOUR.map(|v| v - 1)) && is_bare([194; 3]));
        // A road.
        assert!(!is_bare([166, 168, 170]));
    }

    #[test]
    fn the_colour_of_the_sea_is_the_median() {
        assert_eq!(median(&mut [[9, 0, 3], [1, 5, 3], [2, 7, 200]]), [2, 5, 3]);
        assert_eq!(median(&mut []), [0; 3]);
    }
}
