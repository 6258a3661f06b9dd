//! Paints pictures of the ground.

use crate::map_store::{MAX_COORDINATE_M, overlap};
use crate::paint::canvas::{BLOCK_TEXELS, Brush, Canvas, SampleWindow, TEXEL_SAMPLES};
use crate::paint::class::{AreaLayer, LineClass};
use crate::paint::error::PaintError;
use crate::paint::junctions::join_lines;
use crate::paint::material::PaintMaterial;
use crate::paint::palette::PaintStyle;
use crate::paint::pattern::{to_linear, to_srgb};
use crate::paint::prepare::{ReadyLine, ReadyShapes};
use crate::paint::resolve::Resolver;
use crate::paint::road_paint::{Grounds, is_visible, paint_carriageway, paint_kerb, paint_markings, paint_sidewalks};
use crate::paint::shape::PaintShape;
use crate::paint::stroke::{Stripe, band, stripe};
use rayon::prelude::*;
use std::borrow::Borrow;
use std::ops::RangeInclusive;

const TEXEL_RANGE_M: RangeInclusive<f64> = 0.01..=1000.0;
const MAX_SIDE: usize = 1 << 14;
const MAX_TEXELS: usize = 1 << 26;

/// Paints pictures of the ground with texels of one size.
#[derive(Debug, Clone)]
pub struct GroundPainter {
    texel_m: f64,
    style: PaintStyle,
}

/// A part of the map's grid of texels.
#[derive(Debug, Clone, Copy)]
struct TexelRegion {
    /// Number of the south-western texel: texel 0 begins at 0 m.
    first: [i64; 2],
    size: [usize; 2],
}

impl GroundPainter {
    /// A painter with the usual style. Fails if texels are not from 1 cm to 1 km large.
    pub fn new(texel_m: f64) -> Result<Self, PaintError> {
        Self::with_style(texel_m, PaintStyle::default())
    }

    /// A painter with a style. Fails as [`GroundPainter::new`].
    pub fn with_style(texel_m: f64, style: PaintStyle) -> Result<Self, PaintError> {
        if !TEXEL_RANGE_M.contains(&texel_m) {
            return Err(PaintError::TexelSize(texel_m));
        }
        Ok(Self { texel_m, style })
    }

    /// The corner of a texel that is nearest to a position: where a picture with this corner begins.
    #[must_use]
    #[cfg(test)]
    pub fn snap(&self, corner: [f64; 2]) -> [f64; 2] {
        corner.map(|v| (v / self.texel_m).round() * self.texel_m)
    }

    /// Paints a picture: 8-bit sRGB, and the painted share of each texel as alpha, not multiplied; `[0; 4]` where
    /// nothing was painted. Rows go from the south, as the points of a map's grid do.
    ///
    /// `shapes` are those that touch the picture (by their bounds), in any order; more do not matter. They are
    /// copied meanwhile. `corner` is the south-western one in metres, moved to that of the nearest texel.
    /// `size` is in texels, east and north. A texel is the same in all pictures that contain
    /// it. All cores are used.
    ///
    /// Fails if the corner is not a position, or the picture has more than 16384 texels along a side, or 2^26 texels.
    pub fn paint<S: Borrow<PaintShape> + Sync>(
        &self,
        shapes: &[S],
        corner: [f64; 2],
        size: [usize; 2],
    ) -> Result<Vec<[u8; 4]>, PaintError> {
        let part = self.part(corner, size)?;
        let mut texels = vec![[0; 4]; size[0] * size[1]];
        let blocks = part.blocks();
        let mut ready = ReadyShapes::new(shapes, self.bounds(part), self.texel_m);
        join_lines(&mut ready.lines);
        let grounds = Grounds::new();
        let start = || (Canvas::new(), Resolver::new(&self.style, self.texel_m));
        // Row by row, so that few blocks are in memory at once.
        for row in blocks.chunk_by(|a, b| a[1] == b[1]) {
            let painted: Vec<Option<Vec<[u8; 4]>>> = row
                .par_iter()
                .map_init(start, |(canvas, resolver), block| self.block(canvas, resolver, &ready, &grounds, *block))
                .collect();
            for (block, found) in row.iter().zip(painted) {
                if let Some(found) = found {
                    part.copy_block(*block, &found, &mut texels);
                }
            }
        }
        Ok(texels)
    }

    fn part(&self, corner: [f64; 2], size: [usize; 2]) -> Result<TexelRegion, PaintError> {
        if !corner.iter().all(|v| v.abs() <= MAX_COORDINATE_M) {
            return Err(PaintError::Corner);
        }
        if size.iter().any(|side| *side > MAX_SIDE) || size[0] * size[1] > MAX_TEXELS {
            return Err(PaintError::TooLarge(size[0], size[1]));
        }
        // At most 10^11, by the limits of positions and texels.
        Ok(TexelRegion { first: corner.map(|v| (v / self.texel_m).round() as i64), size })
    }

    fn bounds(&self, part: TexelRegion) -> [[f64; 2]; 2] {
        let at = |number: i64| number as f64 * self.texel_m;
        [part.first.map(at), [0, 1].map(|axis| at(part.first[axis] + part.size[axis] as i64))]
    }

    /// The texels of a block; `None` if nothing touches it.
    fn block(
        &self,
        canvas: &mut Canvas,
        resolver: &mut Resolver<'_>,
        shapes: &ReadyShapes,
        grounds: &Grounds,
        block: [i64; 2],
    ) -> Option<Vec<[u8; 4]>> {
        let first = block.map(|number| number * BLOCK_TEXELS as i64);
        let bounds = self.bounds(TexelRegion { first, size: [BLOCK_TEXELS; 2] });
        canvas.clear(SampleWindow { corner: bounds[0], samples_per_m: TEXEL_SAMPLES as f64 / self.texel_m });
        paint_block(canvas, shapes, bounds, &self.style, grounds).then(|| resolver.texels(canvas.samples(), first))
    }
}

impl TexelRegion {
    /// Numbers of the blocks that have a common texel with the part, row by row.
    fn blocks(self) -> Vec<[i64; 2]> {
        let side = BLOCK_TEXELS as i64;
        let range = |axis: usize| {
            let end = self.first[axis] + self.size[axis] as i64;
            self.first[axis].div_euclid(side)..(end + side - 1).div_euclid(side)
        };
        range(1).flat_map(|y| range(0).map(move |x| [x, y])).collect()
    }

    /// Copies what a block and the part have in common.
    fn copy_block(self, block: [i64; 2], found: &[[u8; 4]], texels: &mut [[u8; 4]]) {
        let side = BLOCK_TEXELS as i64;
        // The first common texel, and how many there are.
        let common = |axis: usize| {
            let (start, end) = (self.first[axis], self.first[axis] + self.size[axis] as i64);
            let from = start.max(block[axis] * side);
            let to = end.min(block[axis] * side + side);
            ((from - block[axis] * side) as usize, (from - start) as usize, (to - from).max(0) as usize)
        };
        let ((from_x, to_x, count), (from_y, to_y, rows)) = (common(0), common(1));
        for row in 0..rows {
            let source = &found[(from_y + row) * BLOCK_TEXELS + from_x..][..count];
            texels[(to_y + row) * self.size[0] + to_x..][..count].copy_from_slice(source);
        }
    }
}

/// A texel on a ground of a colour, mixed in linear light.
#[must_use]
pub fn over([r, g, b, alpha]: [u8; 4], ground: [u8; 3]) -> [u8; 3] {
    match alpha {
        0 => ground,
        u8::MAX => [r, g, b],
        _ => {
            let share = f32::from(alpha) / 255.0;
            let (top, below) = (to_linear([r, g, b]), to_linear(ground));
            to_srgb(std::array::from_fn(|i| below[i] + (top[i] - below[i]) * share))
        }
    }
}

/// Paints all shapes that touch a block. Returns whether there are any.
fn paint_block(
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

/// Width of a rail, which is that of its foot.
const RAIL_M: f64 = 0.15;
/// Distances of the rails' middles from that of the track: of standard gauge, and of narrow gauge.
const RAIL_OFFSETS_M: [f64; 2] = [0.75, 0.53];
/// Distance of neighbouring tracks.
const TRACK_DISTANCE_M: f64 = 4.0;
/// Width that a track needs.
const TRACK_M: f64 = 1.8;
/// Width of a sleeper, and from one to the next.
const SLEEPER_DASH_M: [f64; 2] = [0.25, 0.6];
/// Half lengths of sleepers: of standard gauge, and of narrow gauge.
const SLEEPER_HALF_M: [f64; 2] = [1.3, 0.85];
/// Treads of stairs, and from one to the next: twice as far as usual, so that texels show them.
const TREAD_DASH_M: [f64; 2] = [0.35, 0.7];
/// Patterns along a line whose period is shorter than this number of samples are left out.
const MIN_PERIOD_SAMPLES: f64 = 8.0;

/// Paints a waterway, a path, a platform or a pier.
fn paint_band(canvas: &mut Canvas, line: &ReadyLine) {
    band(line, line.half_m, &mut canvas.polygons(line.brush(), None));
    if line.class == LineClass::Steps && has_period(canvas, TREAD_DASH_M[1]) {
        let treads = Stripe { edges_m: [-line.half_m, line.half_m], dash_m: Some(TREAD_DASH_M), cuts_m: &[] };
        stripe(line, treads, &mut canvas.polygons(Brush::plain(PaintMaterial::Tread), None));
    }
}

/// Paints the bed of a railway and its sleepers.
fn paint_bed(canvas: &mut Canvas, line: &ReadyLine) {
    band(line, line.half_m, &mut canvas.polygons(line.brush(), None));
    if line.class == LineClass::Tram || !has_period(canvas, SLEEPER_DASH_M[1]) {
        return;
    }
    let half_m = SLEEPER_HALF_M[gauge(line)];
    for middle_m in track_middles_m(line) {
        let sleepers =
            Stripe { edges_m: [middle_m - half_m, middle_m + half_m], dash_m: Some(SLEEPER_DASH_M), cuts_m: &[] };
        stripe(line, sleepers, &mut canvas.polygons(Brush::plain(PaintMaterial::Sleeper), None));
    }
}

fn paint_rails(canvas: &mut Canvas, line: &ReadyLine) {
    if !is_visible(canvas, RAIL_M) {
        return;
    }
    let material = if line.class == LineClass::Tram { PaintMaterial::StreetRail } else { PaintMaterial::Rail };
    let offset_m = RAIL_OFFSETS_M[gauge(line)];
    for middle_m in track_middles_m(line).flat_map(|middle_m| [middle_m - offset_m, middle_m + offset_m]) {
        let rail = Stripe { edges_m: [middle_m - RAIL_M / 2.0, middle_m + RAIL_M / 2.0], dash_m: None, cuts_m: &[] };
        stripe(line, rail, &mut canvas.polygons(Brush::plain(material), None));
    }
}

fn gauge(line: &ReadyLine) -> usize {
    usize::from(line.class == LineClass::NarrowGauge)
}

/// As many tracks as are known and fit.
fn track_middles_m(line: &ReadyLine) -> impl Iterator<Item = f64> {
    let fitting = 1 + ((2.0 * line.half_m - TRACK_M).max(0.0) / TRACK_DISTANCE_M) as u8;
    let count = line.lanes.unwrap_or(1).min(fitting);
    let first_m = -TRACK_DISTANCE_M * (f64::from(count) - 1.0) / 2.0;
    (0..count).map(move |track| first_m + TRACK_DISTANCE_M * f64::from(track))
}

fn has_period(canvas: &Canvas, period_m: f64) -> bool {
    period_m * canvas.window().samples_per_m >= MIN_PERIOD_SAMPLES
}
