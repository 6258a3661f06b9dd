//! The boxes of nodes as lines in a picture.

use glam::DVec2;
use insula_shaders::cpu::raycast::Pixels;

/// Colours of a line and of the line around it, which is readable over bright and dark scenes.
const LINE: u32 = 0xffff_ffff;
const AROUND: u32 = 0xff00_0000;

/// Paints lines, whose ends are shares of the picture's width and height from its upper left corner.
pub(crate) fn paint_lines(pixels: &mut Pixels, lines: &[[DVec2; 2]]) {
    let size = DVec2::new(f64::from(pixels.width_px), f64::from(pixels.height_px));
    for (color, half) in [(AROUND, 1), (LINE, 0)] {
        for ends in lines {
            paint_line(pixels, ends.map(|share| share * size), size, (color, half));
        }
    }
}

/// Paints a line that is `2 * half + 1` pixels wide.
fn paint_line(pixels: &mut Pixels, ends: [DVec2; 2], size: DVec2, (color, half): (u32, i64)) {
    let Some([a, b]) = within(ends, size) else { return };
    let steps = (b - a).abs().max_element().ceil().max(1.0) as u32;
    for step in 0..=steps {
        let at = a.lerp(b, f64::from(step) / f64::from(steps)).floor();
        for (dx, dy) in (-half..=half).flat_map(|dy| (-half..=half).map(move |dx| (dx, dy))) {
            let (x, y) = (at.x as i64 + dx, at.y as i64 + dy);
            if (0..i64::from(pixels.width_px)).contains(&x) && (0..i64::from(pixels.height_px)).contains(&y) {
                let place = y as usize * pixels.width_px as usize + x as usize;
                if let Some(pixel) = pixels.colour.get_mut(place) {
                    *pixel = color;
                }
            }
        }
    }
}

/// The part of a line within a picture (Liang and Barsky 1984): lines may end far outside.
fn within([a, b]: [DVec2; 2], size: DVec2) -> Option<[DVec2; 2]> {
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    let along = b - a;
    for (speed, room) in [(-along.x, a.x), (along.x, size.x - a.x), (-along.y, a.y), (along.y, size.y - a.y)] {
        let at = room / speed;
        if speed == 0.0 {
            if room < 0.0 {
                return None;
            }
        } else if speed < 0.0 {
            enter = enter.max(at);
        } else {
            leave = leave.min(at);
        }
    }
    (enter <= leave).then(|| [a + along * enter, a + along * leave])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_cut_at_the_picture() {
        let mut pixels = Pixels { width_px: 40, height_px: 20, colour: vec![7; 800], ..Pixels::default() };
        let line = |a: [f64; 2], b: [f64; 2]| [a.into(), b.into()];
        paint_lines(
            &mut pixels,
            &[
                line([-1e9, 0.525], [1e9, 0.525]),
                line([0.5, 2.0], [0.5, 3.0]),
                line([f64::NAN, 0.0], [1.0, f64::NAN]),
                line([0.0125, -1.0], [0.0125, 0.225]),
            ],
        );
        let at = |x: usize, y: usize| pixels.colour[y * 40 + x];
        assert!((1..40).all(|x| at(x, 10) == LINE && at(x, 9) == AROUND && at(x, 11) == AROUND && at(x, 13) == 7));
        assert!((0..5).all(|y| at(0, y) == LINE) && at(2, 2) == 7 && at(20, 19) == 7);
    }
}
