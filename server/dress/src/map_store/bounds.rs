//! Rectangles on the map.

/// Positions farther from the origin of the map, in metres, are none.
pub const MAX_COORDINATE_M: f64 = 1e9;

/// Lowest and highest position, in world metres.
pub type MapBounds = [[f64; 2]; 2];

/// Whether a position is one: finite, and on a map.
pub fn is_position(point: [f64; 2]) -> bool {
    point.iter().all(|v| v.abs() <= MAX_COORDINATE_M)
}

/// Lowest and highest of all positions that are some; `None` without.
pub fn bounds<'p>(points: impl IntoIterator<Item = &'p [f64; 2]>) -> Option<MapBounds> {
    let mut positions = points.into_iter().filter(|point| is_position(**point));
    let first = *positions.next()?;
    Some(positions.fold([first, first], |[low, high], point| {
        [[0, 1].map(|axis| low[axis].min(point[axis])), [0, 1].map(|axis| high[axis].max(point[axis]))]
    }))
}

/// Whether two rectangles have a common point.
pub fn overlap([low, high]: MapBounds, [other_low, other_high]: MapBounds) -> bool {
    (0..2).all(|axis| low[axis] <= other_high[axis] && other_low[axis] <= high[axis])
}
