//! Boxes of small scenes.

use super::{boxes, grid};
use crate::geometry::Geometry;
use insula_protocol::blockmap::{COLUMNS, ColumnClip, MapColumn, OuterTop, WallStrip, strip_rows};
use insula_protocol::{BlockMap, NODE_CELLS, Texel, TileId};
use std::collections::BTreeSet;

fn map_of(column: impl Fn(usize, usize) -> Option<MapColumn>) -> BlockMap {
    let columns: Vec<_> = (0..COLUMNS).map(|i| column(i % NODE_CELLS, i / NODE_CELLS)).collect();
    BlockMap::from_columns(TileId::ROOT, 2.0, 3, 0, &columns).unwrap()
}

fn geometry(map: BlockMap) -> Geometry {
    boxes(map, &mut |object, _| Ok(Some(object))).unwrap()
}

fn plain(z_max: u16, grey: u8) -> Option<MapColumn> {
    Some(MapColumn { z_max, roof: Texel::new([grey; 3], 63), ..MapColumn::default() })
}

fn triangles(geometry: &Geometry) -> usize {
    geometry.indices.len() / 3
}

/// A column with a strip of one colour.
fn walled(z_min: u16, z_max: u16) -> MapColumn {
    let texels = vec![Texel::new([50, 60, 70], 63); usize::from(strip_rows(z_min, z_max, 0).1)];
    let strip = Some(WallStrip { texels, azimuth: 0 });
    MapColumn { z_min, z_max, roof: Texel::new([200; 3], 63), strip, ..MapColumn::default() }
}

#[test]
fn flat_land_is_one_box() {
    let flat = geometry(map_of(|_, _| plain(32, 100)));
    // A top and four sides at the node's border, where nothing is known beyond.
    assert_eq!((triangles(&flat), flat.positions.len()), (10, 4 + 8));
    assert!(flat.positions.iter().all(|[x, y, z]| [0, 64].contains(x) && [0, 64].contains(y) && [0, 8].contains(z)));
}

#[test]
fn small_steps_merge_and_large_ones_become_sides() {
    let half = geometry(map_of(|x, _| plain(if x < 32 { 28 } else { 36 }, 100)));
    assert_eq!(triangles(&half), 10);
    assert!(half.positions.iter().all(|[_, _, z]| [0, 8].contains(z)), "the middle of both");
    let step = geometry(map_of(|x, _| plain(if x < 32 { 28 } else { 64 }, 100)));
    // Two tops, three sides each at the border, and one between them.
    assert_eq!(triangles(&step), 2 * (2 + 3 + 3) + 2);
    let between: BTreeSet<u16> = step.positions.iter().filter(|p| p[0] == 32).map(|p| p[2]).collect();
    assert_eq!(between, [0, 7, 16].into());
}

#[test]
fn colours_and_objects_divide_boxes() {
    let colours = geometry(map_of(|x, _| plain(32, if x < 10 { 100 } else { 180 })));
    assert_eq!(colours.positions.iter().filter(|p| p[0] == 10 && p[2] == 8).count(), 2 * 2 + 2 * 2);
    let mut map = map_of(|_, _| plain(32, 100));
    let mut objects = insula_protocol::blockmap::ColumnObjects::default();
    (0..COLUMNS).for_each(|i| objects.roof[i] = u32::from(i >= COLUMNS / 2));
    map.objects = Some(Box::new(objects));
    let divided = geometry(map);
    assert_eq!(divided.features.iter().copied().collect::<BTreeSet<u32>>(), [0, 1].into());
    // Both tops and their sides at the border, nothing between them.
    assert_eq!(triangles(&divided), 2 * (2 + 6));
}

#[test]
fn a_house_on_land_has_its_walls_down_to_it() {
    let house = geometry(map_of(|x, y| {
        let is_house = (20..30).contains(&x) && (20..25).contains(&y);
        if is_house { Some(walled(8, 160)) } else { plain(32, 100) }
    }));
    let walls: Vec<usize> =
        (0..house.positions.len()).filter(|i| house.colours[*i][0] < house.colours[*i][2]).collect();
    assert_eq!(walls.len(), 8, "corners share vertices");
    assert!(walls.iter().all(|i| [8, 40].contains(&house.positions[*i][2])));
    assert!(
        walls.iter().all(|i| [20, 30].contains(&house.positions[*i][0]) && [20, 25].contains(&house.positions[*i][1]))
    );
}

#[test]
fn a_bridge_has_an_underside_and_land_below_it() {
    let bridge = geometry(map_of(|x, y| {
        let is_bridge = (20..24).contains(&y) && x > 0 && x < 63;
        let gap = Some([32, 100]);
        if is_bridge { Some(MapColumn { gap, ..walled(8, 112) }) } else { plain(32, 100) }
    }));
    assert!(bridge.features.iter().all(|feature| *feature == insula_protocol::blockmap::NO_OBJECT));
    let deck: BTreeSet<u16> = bridge.positions.iter().filter(|p| p[0] == 1 && p[1] == 20).map(|p| p[2]).collect();
    assert_eq!(deck, [8, 25, 28].into(), "land, underside, top");
    let downwards = bridge.indices.chunks(3).filter(|t| normal_z(&bridge, t) < 0.0).count();
    assert_eq!(downwards, 2);
}

fn normal_z(geometry: &Geometry, triangle: &[u32]) -> f64 {
    let [a, b, c] = [0, 1, 2].map(|k| geometry.positions[triangle[k] as usize].map(f64::from));
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[test]
fn the_middle_of_a_cell_decides_about_a_clipped_column() {
    let clipped = |offset: i8, outer: Option<OuterTop>| {
        let clip = Some(ColumnClip { offset, corner: None, outer });
        geometry(map_of(move |x, y| ((x, y) == (5, 5)).then(|| MapColumn { clip, ..walled(0, 64) })))
    };
    let outer = Some(OuterTop { z: 16, roof: Texel::new([9; 3], 63) });
    let top = |geometry: &Geometry| geometry.positions.iter().map(|p| p[2]).max();
    assert_eq!(top(&clipped(30, outer)), Some(16));
    assert_eq!(top(&clipped(-30, outer)), Some(4));
    assert_eq!(top(&clipped(-30, None)), None);
}

#[test]
fn what_is_not_selected_is_left_out_and_heights_are_metres() {
    let map = map_of(|x, y| (y == 0).then(|| plain(32, 100)).flatten().filter(|_| x < 2));
    let to_metres = grid(&map);
    let half = boxes(map, &mut |_, column| Ok((column == 0).then_some(3))).unwrap();
    assert_eq!((half.positions.iter().map(|p| p[0]).max(), half.features[0]), (Some(1), 3));
    // Cells are 2 m, the base is three cells above the origin, the top two cells above the base.
    assert_eq!(to_metres.transform_point3([1.0, 0.0, 8.0].into()).to_array(), [2.0, 0.0, 10.0]);
}
