//! Buildings that tests make.

use super::shapes::BuildingShapes;
use crate::table::grid::MapPoint;

/// Boxes on the ground by name: west, south, east and north, and height, in metres.
pub(super) fn city(boxes: &[(&str, [i32; 4], i32)]) -> BuildingShapes {
    let mut shapes = BuildingShapes::default();
    for (number, (name, bounds, height)) in (0u32..).zip(boxes) {
        let [west, south, east, north] = bounds.map(|metres| metres * 1000);
        let ring = [[west, south], [east, south], [east, north], [west, north]].map(|[x, y]| MapPoint::new(x, y));
        shapes.add(number, name, [0.0, f64::from(*height)], &[ring.to_vec()]);
    }
    shapes
}
