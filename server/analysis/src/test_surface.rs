//! Surfaces that tests make.

use crate::surface::{CitySurface, TopKind};

/// A surface of cells of a metre from the place 1000, 2000, whose tops are 50 m above `top`; what is higher than 2.5 m is a building.
pub(crate) fn surface(width: u32, height: u32, top: impl Fn(usize, usize) -> f32) -> CitySurface {
    let cells = (0..height as usize).flat_map(|y| (0..width as usize).map(move |x| (x, y)));
    let tops: Vec<f32> = cells.map(|(x, y)| top(x, y)).collect();
    let kind = |top: &f32| match *top {
        t if t > 2.5 => TopKind::Roof(0),
        t if t.is_finite() => TopKind::Ground,
        _ => TopKind::Nothing,
    };
    let kinds: Vec<TopKind> = tops.iter().map(kind).collect();
    CitySurface::of_cells([width, height], [1000.0, 2000.0], 50.0, tops, &kinds)
}
