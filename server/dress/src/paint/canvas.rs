//! A block of the picture while it is painted: samples that hold materials.

use crate::paint::clip::clip_ring;
use crate::paint::material::{MaterialSet, PaintMaterial};
use tiny_skia::{Color, FillRule, Mask, Paint, Path, PathBuilder, Pixmap, Shader, Transform};

/// Texels along the side of a block.
pub(super) const BLOCK_TEXELS: usize = 256;
/// Samples along the side of a texel.
pub(super) const TEXEL_SAMPLES: usize = 4;
/// Samples along the side of a block.
pub(super) const BLOCK_SAMPLES: usize = BLOCK_TEXELS * TEXEL_SAMPLES;
const _: () = assert!(BLOCK_SAMPLES > 0 && BLOCK_SAMPLES < 1 << 20, "Pixmap and Mask refuse such sides");
/// Shapes are cut this far outside of the block, in samples, so that the cuts are not seen.
const MARGIN: f64 = 8.0;
/// More corners of an area in one block are thinned out: areas whose edges all cross each other would take hours.
const MAX_CORNERS: usize = 8192;
/// Polygons that are filled in one pass. The number does not change the result.
const BATCH_POLYGONS: usize = 256;

/// What a sample gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Brush {
    pub material: PaintMaterial,
    /// Direction of rows, 256 for half a turn.
    pub direction: u8,
    /// How much lighter the whole shape is than the mean of its material, 128 for not at all.
    pub tone: u8,
}

impl Brush {
    pub(super) const NEUTRAL_TONE: u8 = 128;

    pub(super) fn plain(material: PaintMaterial) -> Self {
        Self { material, direction: 0, tone: Self::NEUTRAL_TONE }
    }
}

/// Where a block lies on the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct SampleWindow {
    /// South-western corner in metres.
    pub corner: [f64; 2],
    pub samples_per_m: f64,
}

impl SampleWindow {
    /// A position in samples from the south-western corner.
    pub(super) fn place(&self, position: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| (position[axis] - self.corner[axis]) * self.samples_per_m)
    }

    /// The block with so many samples around it, in samples.
    pub(super) fn around(reach: f64) -> [[f64; 2]; 2] {
        [[-MARGIN - reach; 2], [BLOCK_SAMPLES as f64 + MARGIN + reach; 2]]
    }
}

/// The samples of a block. Rows go from the south.
pub(super) struct Canvas {
    samples: Pixmap,
    mask: Mask,
    window: SampleWindow,
    corners: [Vec<[f64; 2]>; 2],
}

impl Canvas {
    pub(super) fn new() -> Self {
        let side = BLOCK_SAMPLES as u32;
        // Both refuse only sides of 0 and of 2^29 and more, which `BLOCK_SAMPLES` is not: it is asserted above.
        let samples = Pixmap::new(side, side).expect("a valid side");
        let mask = Mask::new(side, side).expect("a valid side");
        let window = SampleWindow { corner: [0.0; 2], samples_per_m: 1.0 };
        Self { samples, mask, window, corners: Default::default() }
    }

    /// Starts another block.
    pub(super) fn clear(&mut self, window: SampleWindow) {
        self.samples.data_mut().fill(0);
        self.window = window;
    }

    pub(super) fn window(&self) -> SampleWindow {
        self.window
    }

    /// The samples: material, direction, tone, and 0 where nothing was painted.
    pub(super) fn samples(&self) -> &[[u8; 4]] {
        self.samples.data().as_chunks().0
    }

    /// Fills what an odd number of rings contains. Rings are in metres.
    pub(super) fn fill_rings(&mut self, rings: &[Vec<[f64; 2]>], brush: Brush) {
        let mut builder = PathBuilder::new();
        let mut left = MAX_CORNERS;
        for ring in rings {
            let [points, spare] = &mut self.corners;
            points.clear();
            points.extend(ring.iter().map(|point| self.window.place(*point)));
            clip_ring(points, spare, SampleWindow::around(0.0));
            if points.len() < 3 {
                continue;
            }
            let step = points.len().div_ceil(left.max(3));
            let kept = points.iter().step_by(step);
            left = left.saturating_sub(kept.len());
            add_polygon(&mut builder, kept);
            if left == 0 {
                break;
            }
        }
        if let Some(path) = builder.finish() {
            self.samples.fill_path(&path, &paint(brush), FillRule::EvenOdd, Transform::identity(), None);
        }
    }

    /// Starts filling polygons. With `over`, only samples of these materials are replaced.
    pub(super) fn polygons<'c>(&'c mut self, brush: Brush, over: Option<&'c MaterialSet>) -> PolygonFill<'c> {
        PolygonFill { canvas: self, brush, over, builder: PathBuilder::new(), count: 0 }
    }

    fn fill(&mut self, path: &Path, brush: Brush, over: Option<&MaterialSet>) {
        let Some(over) = over else {
            self.samples.fill_path(path, &paint(brush), FillRule::Winding, Transform::identity(), None);
            return;
        };
        self.mask.fill_path(path, FillRule::Winding, false, Transform::identity());
        let bounds = path.bounds();
        let side = BLOCK_SAMPLES as f32;
        let [west, south, east, north] =
            [bounds.left() - 1.0, bounds.top() - 1.0, bounds.right() + 1.0, bounds.bottom() + 1.0]
                .map(|v| v.clamp(0.0, side) as usize);
        let sample = brush.sample();
        let (samples, _) = self.samples.data_mut().as_chunks_mut::<4>();
        let rows = samples.chunks_exact_mut(BLOCK_SAMPLES).zip(self.mask.data_mut().chunks_exact_mut(BLOCK_SAMPLES));
        for (samples, mask) in rows.take(north).skip(south) {
            for (old, covered) in samples[west..east].iter_mut().zip(&mut mask[west..east]) {
                if std::mem::take(covered) != 0 && over.contains(*old) {
                    *old = sample;
                }
            }
        }
    }
}

impl Brush {
    fn sample(self) -> [u8; 4] {
        [self.material as u8, self.direction, self.tone, u8::MAX]
    }
}

/// Convex polygons that are filled with one brush.
pub(super) struct PolygonFill<'c> {
    canvas: &'c mut Canvas,
    brush: Brush,
    over: Option<&'c MaterialSet>,
    builder: PathBuilder,
    count: usize,
}

impl PolygonFill<'_> {
    pub(super) fn window(&self) -> SampleWindow {
        self.canvas.window
    }

    /// Adds a polygon, in samples.
    pub(super) fn add(&mut self, polygon: &[[f64; 2]]) {
        // All are counter-clockwise, so that overlaps do not cancel.
        if is_clockwise(polygon) {
            add_polygon(&mut self.builder, polygon.iter().rev());
        } else {
            add_polygon(&mut self.builder, polygon.iter());
        }
        self.count += 1;
        if self.count == BATCH_POLYGONS {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let builder = std::mem::replace(&mut self.builder, PathBuilder::new());
        self.count = 0;
        if let Some(path) = builder.finish() {
            self.canvas.fill(&path, self.brush, self.over);
        }
    }
}

impl Drop for PolygonFill<'_> {
    /// Fills the last polygons.
    fn drop(&mut self) {
        self.flush();
    }
}

fn add_polygon<'p>(builder: &mut PathBuilder, points: impl Iterator<Item = &'p [f64; 2]>) {
    for (i, [x, y]) in points.enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if i == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    builder.close();
}

fn is_clockwise(polygon: &[[f64; 2]]) -> bool {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>() < 0.0
}

fn paint(brush: Brush) -> Paint<'static> {
    let [r, g, b, a] = brush.sample();
    Paint { shader: Shader::SolidColor(Color::from_rgba8(r, g, b, a)), anti_alias: false, ..Paint::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_keep_all_numbers() {
        let mut canvas = Canvas::new();
        canvas.clear(SampleWindow { corner: [100.0, 200.0], samples_per_m: 16.0 });
        for number in 0..=255u8 {
            let brush = Brush { material: PaintMaterial::Water, direction: number, tone: 255 - number };
            let low = f64::from(number);
            canvas.polygons(brush, None).add(&[[0.0, low], [8.0, low], [8.0, low + 1.0], [0.0, low + 1.0]]);
            assert_eq!(canvas.samples()[usize::from(number) * BLOCK_SAMPLES + 3], brush.sample());
        }
        assert_eq!(canvas.samples()[8], [0; 4]);
        canvas.clear(canvas.window());
        assert!(canvas.samples().iter().all(|sample| *sample == [0; 4]));
    }

    #[test]
    fn only_wanted_materials_are_replaced() {
        let mut canvas = Canvas::new();
        let square = |x: f64| [[x, 0.0], [x + 10.0, 0.0], [x + 10.0, 10.0], [x, 10.0]];
        canvas.polygons(Brush::plain(PaintMaterial::Grass), None).add(&square(0.0));
        canvas.polygons(Brush::plain(PaintMaterial::Water), None).add(&square(10.0));
        let over = MaterialSet::new(&[PaintMaterial::Grass], true);
        canvas.polygons(Brush::plain(PaintMaterial::Pavement), Some(&over)).add(&[
            [5.0, 2.0],
            [25.0, 2.0],
            [25.0, 4.0],
            [5.0, 4.0],
        ]);
        let row = &canvas.samples()[3 * BLOCK_SAMPLES..][..30];
        let expected = |x: usize| match x {
            0..5 => [PaintMaterial::Grass as u8, 255],
            10..20 => [PaintMaterial::Water as u8, 255],
            5..25 => [PaintMaterial::Pavement as u8, 255],
            _ => [0, 0],
        };
        for (x, sample) in row.iter().enumerate() {
            assert_eq!([sample[0], sample[3]], expected(x), "{x}");
        }
        // The mask is empty again.
        canvas.polygons(Brush::plain(PaintMaterial::Sand), Some(&over)).add(&square(100.0));
        assert_eq!(canvas.samples()[3 * BLOCK_SAMPLES + 2][0], PaintMaterial::Grass as u8);
    }
}
