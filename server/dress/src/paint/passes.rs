//! The order of the passes in which a block is painted. [`ReadyShapes`] has the order of areas and lines within a pass.

use crate::map_store::overlap;
use crate::paint::canvas::Canvas;
use crate::paint::class::{AreaLayer, LineClass};
use crate::paint::line_paint::{paint_band, paint_bed, paint_rails};
use crate::paint::palette::PaintStyle;
use crate::paint::prepare::{ReadyLine, ReadyShapes};
use crate::paint::road_paint::{Grounds, paint_carriageway, paint_kerb, paint_markings, paint_sidewalks};

/// Paints all shapes that touch a block. Returns whether there are any.
pub(super) fn paint_block(
    canvas: &mut Canvas,
    shapes: &ReadyShapes,
    block: [[f64; 2]; 2],
    style: &PaintStyle,
    grounds: &Grounds,
) -> bool {
    let lines: Vec<&ReadyLine> = shapes.lines.iter().filter(|line| overlap(line.bounds, block)).collect();
    let mut areas = shapes.areas.iter().filter(|area| overlap(area.bounds, block)).peekable();
    if lines.is_empty() && areas.peek().is_none() {
        return false;
    }
    let mut paint_areas = |canvas: &mut Canvas, layer: AreaLayer| {
        while let Some(area) = areas.next_if(|area| area.layer <= layer) {
            canvas.fill_rings(&area.rings, area.brush);
        }
    };
    let of = |wanted: fn(LineClass) -> bool| lines.iter().copied().filter(move |line| wanted(line.class));

    paint_areas(canvas, AreaLayer::Cover);
    of(|class| class == LineClass::Waterway).for_each(|line| paint_band(canvas, line));
    paint_areas(canvas, AreaLayer::Paved);
    of(|class| class != LineClass::Waterway && class <= LineClass::Platform).for_each(|line| paint_band(canvas, line));
    of(LineClass::is_rail).for_each(|line| paint_bed(canvas, line));
    of(LineClass::is_road).for_each(|line| paint_sidewalks(canvas, line, style, grounds));
    of(LineClass::is_path).for_each(|line| paint_band(canvas, line));
    of(LineClass::is_road).for_each(|line| paint_kerb(canvas, line, grounds));
    paint_areas(canvas, AreaLayer::Carriageway);
    of(LineClass::is_road).for_each(|line| paint_carriageway(canvas, line));
    if style.has_markings {
        of(|class| class.is_road() || class == LineClass::Zebra).for_each(|line| paint_markings(canvas, line, grounds));
    }
    of(LineClass::is_rail).for_each(|line| paint_rails(canvas, line));
    true
}
