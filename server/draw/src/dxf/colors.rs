//! The numbered colours of DXF.

use crate::style::Rgb;

/// The nearest of the few colours that all programs have: black, or a grey.
pub(super) fn color_index([r, g, b]: Rgb) -> u8 {
    let grey = (u32::from(r) + u32::from(g) + u32::from(b)) / 3;
    match grey {
        0..=60 => 7,
        61..=140 => 8,
        141..=200 => 9,
        _ => 254,
    }
}

/// Lightness of the five pairs of colours that each hue has.
const LEVELS: [f64; 5] = [255.0, 165.0, 127.0, 76.0, 38.0];
/// The greys from 250 on.
const GREYS: [u8; 6] = [51, 91, 132, 173, 214, 255];

/// Red, green and blue of an index from 10 to 255: 24 hues with ten colours each, then greys.
fn index_color(index: u8) -> [f64; 3] {
    if index >= 250 {
        return [f64::from(GREYS[usize::from(index - 250)]); 3];
    }
    let (hue, shade) = (f64::from((index - 10) / 10) / 4.0, usize::from(index % 10));
    let level = LEVELS[shade / 2];
    // Odd ones are half as strong.
    let least = if shade % 2 == 1 { 0.5 } else { 0.0 };
    [0.0, 4.0, 2.0].map(|turn| {
        let away = ((hue + turn) % 6.0 - 3.0).abs() - 1.0;
        level * away.clamp(0.0, 1.0).max(least)
    })
}

pub(super) fn nearest_index(color: Rgb) -> u8 {
    let distance = |index: &u8| {
        let of_index = index_color(*index);
        (0..3).map(|k| (of_index[k] - f64::from(color[k])).powi(2)).sum::<f64>()
    };
    (10..=255).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(255)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_have_the_nearest_index() {
        let expected = [([255, 0, 0], 10), ([255, 255, 0], 50), ([0, 255, 0], 90), ([0, 255, 255], 130)];
        for (color, index) in expected.into_iter().chain([([0, 0, 255], 170), ([255, 0, 255], 210), ([0, 0, 127], 174)])
        {
            assert_eq!(nearest_index(color), index, "{color:?}");
        }
        assert_eq!([[255, 255, 255], [130, 131, 132], [50, 50, 50]].map(nearest_index), [255, 252, 250]);
    }
}
