//! Colours of materials: plausible albedos of weathered surfaces, as 8-bit sRGB, and how they vary.
//!
//! In linear light asphalt reflects a seventh, slabs and gravel a third, lawns a twelfth, woods a twentieth.

use crate::read::paint::material::PaintMaterial;
use crate::read::paint::pattern::{OCTAVES, Pattern};
use PaintMaterial as M;

/// How pictures of the ground look.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PaintStyle {
    patterns: [Pattern; PaintMaterial::ALL.len()],
    /// How strongly soil and plants vary: 0 not at all, 1 as usual.
    pub(crate) variation: f32,
    /// Lane lines and zebra crossings.
    pub(crate) has_markings: bool,
    /// Whether roads without a tag for pavements get the usual ones.
    pub(crate) has_usual_sidewalks: bool,
}

/// Materials that vary: two tones, and the shares of noise with cells of 97, 23, 6 and 1.7 m.
type Varied = (PaintMaterial, [u8; 3], [u8; 3], [f32; OCTAVES]);

const PLANTS: [f32; OCTAVES] = [0.5, 0.3, 0.25, 0.15];
const CROWNS: [f32; OCTAVES] = [0.25, 0.2, 0.5, 0.35];
/// Fields differ from each other more than within.
const FIELDS: [f32; OCTAVES] = [0.12, 0.1, 0.06, 0.05];
const SOIL: [f32; OCTAVES] = [0.4, 0.3, 0.2, 0.1];

const VARIED: &[Varied] = &[
    (M::ResidentialGround, [129, 131, 113], [137, 134, 121], SOIL),
    (M::CommercialGround, [136, 134, 127], [142, 139, 132], SOIL),
    (M::IndustrialGround, [132, 129, 121], [141, 137, 128], SOIL),
    (M::RailwayGround, [112, 108, 97], [126, 119, 107], SOIL),
    (M::Farmland, [106, 109, 69], [138, 126, 93], FIELDS),
    (M::Meadow, [98, 110, 66], [112, 117, 77], PLANTS),
    (M::Park, [86, 103, 62], [99, 110, 72], PLANTS),
    (M::Grass, [82, 100, 58], [94, 108, 68], PLANTS),
    (M::Graveyard, [86, 99, 65], [102, 106, 80], PLANTS),
    (M::Scrub, [76, 88, 54], [98, 103, 69], CROWNS),
    (M::Forest, [54, 68, 39], [76, 88, 52], CROWNS),
    (M::Wetland, [78, 90, 64], [104, 106, 76], CROWNS),
    (M::Sand, [178, 164, 134], [190, 177, 148], SOIL),
    (M::Rock, [126, 122, 116], [141, 136, 129], CROWNS),
    (M::Earth, [128, 117, 99], [141, 130, 111], SOIL),
    (M::Gravel, [150, 141, 122], [158, 149, 131], SOIL),
    (M::Turf, [83, 101, 63], [88, 105, 68], PLANTS),
    (M::Ballast, [106, 99, 91], [116, 108, 99], SOIL),
];

/// Materials of one tone.
const PLAIN: &[(PaintMaterial, [u8; 3])] = &[
    (M::Water, [52, 78, 84]),
    (M::Pavement, [150, 148, 143]),
    (M::Paving, [149, 144, 136]),
    (M::Setts, [126, 122, 116]),
    (M::Concrete, [162, 159, 152]),
    (M::Wood, [138, 121, 101]),
    (M::Clay, [148, 109, 90]),
    (M::Tread, [149, 146, 140]),
    (M::Kerb, [170, 168, 163]),
    (M::Carriageway, [104, 104, 105]),
    (M::Asphalt, [104, 104, 105]),
    (M::SideAsphalt, [112, 111, 110]),
    (M::Cycleway, [118, 112, 108]),
    (M::Marking, [192, 190, 184]),
    (M::Sleeper, [121, 115, 107]),
    (M::Rail, [86, 78, 72]),
    (M::StreetRail, [80, 79, 78]),
];

impl Default for PaintStyle {
    fn default() -> Self {
        let mut patterns = [Pattern::plain([0; 3]); PaintMaterial::ALL.len()];
        for (material, one, other, shares) in VARIED {
            patterns[material.index()] = Pattern::varied([*one, *other], *shares);
        }
        for (material, rgb) in PLAIN {
            patterns[material.index()] = Pattern::plain(*rgb);
        }
        Self { patterns, variation: 1.0, has_markings: true, has_usual_sidewalks: true }
    }
}

impl PaintStyle {
    /// Gives a material another colour, in 8-bit sRGB. Its tones keep their distances from it.
    #[cfg(test)]
    pub(crate) fn set_colour(&mut self, material: PaintMaterial, rgb: [u8; 3]) {
        self.patterns[material.index()].recolour(rgb);
    }

    pub(crate) fn pattern(&self, material: PaintMaterial) -> &Pattern {
        &self.patterns[material.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_material_has_one_colour() {
        let listed = VARIED.iter().map(|row| row.0).chain(PLAIN.iter().map(|row| row.0));
        let mut listed: Vec<PaintMaterial> = listed.collect();
        listed.sort_unstable();
        assert_eq!(listed, PaintMaterial::ALL);
    }

    #[test]
    fn albedos_are_those_of_materials() {
        let style = PaintStyle::default();
        let luminance = |material: PaintMaterial| {
            let [r, g, b] = style.pattern(material).mean();
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for (material, range) in [
            (M::Asphalt, 0.10..0.15),
            (M::Concrete, 0.30..0.40),
            (M::Grass, 0.09..0.14),
            (M::Forest, 0.03..0.09),
            (M::Water, 0.04..0.09),
            (M::Pavement, 0.25..0.35),
        ] {
            assert!(range.contains(&luminance(material)), "{material:?} {}", luminance(material));
        }
        assert!(
            PaintMaterial::ALL.iter().all(|material| (0.03..0.55).contains(&luminance(*material))),
            "nothing is garish"
        );
    }

    #[test]
    fn a_material_gets_another_colour() {
        let mut style = PaintStyle::default();
        style.set_colour(M::Water, [10, 20, 30]);
        style.set_colour(M::Grass, [100, 120, 80]);
        assert_eq!(style.pattern(M::Water).mean(), Pattern::plain([10, 20, 30]).mean());
        let (found, wanted) = (style.pattern(M::Grass).mean(), Pattern::plain([100, 120, 80]).mean());
        assert!((0..3).all(|i| (found[i] - wanted[i]).abs() < 0.004), "{found:?} {wanted:?}");
    }
}
