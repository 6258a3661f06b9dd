//! Colours of sources that no outdoor material has, brought to what a material of that hue reflects.

/// Colours whose channels are all at least this are plain white: exporters write it for "not known".
const WHITE: u8 = 250;
/// Least saturation, in percent of the largest channel, of a colour that stands for a kind of surface.
const SATURATED_PERCENT: i32 = 80;
/// Saturated colours with a smaller largest channel are nearly black, as asphalt is.
const DARK: i32 = 64;
/// Largest channel of a material in the weather: 0.8 in linear light.
const LIGHTEST: i32 = 231;

/// Materials by hue, in steps of 60 degrees from red: tiles, ochre, moss, verdigris, slate, heather.
const MATERIALS_BY_HUE: [[i32; 3]; 6] =
    [[196, 131, 106], [214, 196, 144], [152, 176, 134], [168, 192, 186], [146, 160, 182], [186, 150, 168]];

/// Whether a colour without a texture means that the source knows none.
pub(super) fn is_unknown(rgb: [u8; 3]) -> bool {
    rgb.iter().all(|v| *v >= WHITE)
}

/// The colour of a material with the hue of `rgb`; `None` if a material may have the colour itself.
pub(super) fn harmonise(rgb: [u8; 3]) -> Option<[u8; 3]> {
    let channels = rgb.map(i32::from);
    let [high, low] = [channels.into_iter().fold(0, i32::max), channels.into_iter().fold(255, i32::min)];
    if high >= DARK && (high - low) * 100 >= SATURATED_PERCENT * high {
        let material = material_of_hue(hue(channels, high, low));
        // A dark primary is a darker material, but less so: it is a symbol.
        return Some(material.map(|v| (v * (765 + high) / 1020) as u8));
    }
    (high > LIGHTEST).then(|| channels.map(|v| ((v * LIGHTEST + high / 2) / high) as u8))
}

/// Hue in 1/256 of 60 degrees, 0 to 1535.
fn hue([r, g, b]: [i32; 3], high: i32, low: i32) -> i32 {
    let (sector, difference) = if high == r {
        (0, g - b)
    } else if high == g {
        (2, b - r)
    } else {
        (4, r - g)
    };
    (sector * 256 + difference * 256 / (high - low)).rem_euclid(6 * 256)
}

fn material_of_hue(hue: i32) -> [i32; 3] {
    let (sector, share) = ((hue / 256) as usize % 6, hue % 256);
    let (from, to) = (MATERIALS_BY_HUE[sector], MATERIALS_BY_HUE[(sector + 1) % 6]);
    std::array::from_fn(|k| (from[k] * (256 - share) + to[k] * share) / 256)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn primaries_become_materials_and_materials_stay() {
        assert_eq!(harmonise([255, 0, 0]), Some([196, 131, 106]));
        assert_eq!(harmonise([0, 0, 255]), Some([146, 160, 182]));
        assert_eq!(harmonise([128, 0, 0]), Some([171, 114, 92]));
        for rgb in [[165, 42, 42], [128; 3], [60, 0, 0], [0; 3], [211; 3], [149, 97, 80]] {
            assert_eq!(harmonise(rgb), None, "{rgb:?}");
        }
        assert_eq!(harmonise([245; 3]), Some([231; 3]));
        assert!(is_unknown([250, 255, 251]) && !is_unknown([249, 255, 255]));
    }

    #[test]
    fn hue_is_kept() {
        let hue_of = |rgb: [u8; 3]| {
            let channels = rgb.map(i32::from);
            hue(channels, channels.into_iter().fold(0, i32::max), channels.into_iter().fold(255, i32::min))
        };
        for rgb in [[255, 10, 0], [240, 255, 0], [10, 255, 0], [0, 255, 100], [20, 0, 255], [255, 0, 90]] {
            let material = harmonise(rgb).unwrap();
            let apart = (hue_of(material) - hue_of(rgb)).rem_euclid(1536);
            assert!(apart.min(1536 - apart) < 140, "{rgb:?} {material:?}: {apart} of 1536");
            assert!(material.iter().all(|v| (90..220).contains(v)));
        }
    }
}
