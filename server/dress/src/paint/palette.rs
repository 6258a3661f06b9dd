//! Colours of materials of the ground, as 8-bit sRGB, and how they vary. They are those of a white model: lighter than weathered surfaces
//! (docs/decisions/0025-palette.md).
//!
//! In linear light asphalt reflects a third, slabs and gravel a half, lawns two fifths, woods a quarter.

use crate::paint::material::PaintMaterial;
use crate::paint::pattern::{OCTAVES, Pattern};
use PaintMaterial as M;

/// How pictures of the ground look.
#[derive(Debug, Clone, PartialEq)]
pub struct PaintStyle {
    patterns: [Pattern; PaintMaterial::ALL.len()],
    /// How strongly soil and plants vary: 0 not at all, 1 as usual.
    pub variation: f32,
    /// Lane lines and zebra crossings.
    pub has_markings: bool,
    /// Whether roads without a tag for pavements get the usual ones.
    pub has_usual_sidewalks: bool,
}

/// Materials that vary: two tones, and the shares of noise with cells of 97, 23, 6 and 1.7 m.
type Varied = (PaintMaterial, [u8; 3], [u8; 3], [f32; OCTAVES]);

const PLANTS: [f32; OCTAVES] = [0.5, 0.3, 0.25, 0.15];
const CROWNS: [f32; OCTAVES] = [0.25, 0.2, 0.5, 0.35];
/// Fields differ from each other more than within.
const FIELDS: [f32; OCTAVES] = [0.12, 0.1, 0.06, 0.05];
const SOIL: [f32; OCTAVES] = [0.4, 0.3, 0.2, 0.1];

const VARIED: &[Varied] = &[
    (M::ResidentialGround, [184, 185, 172], [190, 190, 180], SOIL),
    (M::CommercialGround, [188, 187, 182], [193, 191, 186], SOIL),
    (M::IndustrialGround, [185, 183, 177], [192, 190, 183], SOIL),
    (M::RailwayGround, [168, 165, 156], [178, 173, 163], SOIL),
    (M::Farmland, [176, 180, 136], [204, 194, 160], FIELDS),
    (M::Meadow, [168, 184, 134], [180, 188, 146], PLANTS),
    (M::Park, [160, 182, 132], [172, 188, 144], PLANTS),
    (M::Grass, [156, 178, 126], [168, 186, 140], PLANTS),
    (M::Graveyard, [160, 176, 138], [174, 180, 154], PLANTS),
    (M::Scrub, [146, 162, 118], [166, 174, 136], CROWNS),
    (M::Forest, [120, 144, 96], [142, 160, 114], CROWNS),
    (M::Wetland, [150, 168, 138], [172, 178, 148], CROWNS),
    (M::Sand, [226, 213, 180], [232, 221, 192], SOIL),
    (M::Rock, [172, 169, 163], [184, 180, 174], CROWNS),
    (M::Earth, [182, 172, 154], [192, 182, 166], SOIL),
    (M::Gravel, [196, 190, 174], [202, 196, 182], SOIL),
    (M::Turf, [156, 180, 132], [162, 184, 138], PLANTS),
    (M::Ballast, [164, 158, 150], [172, 166, 158], SOIL),
];

/// Materials of one tone.
const PLAIN: &[(PaintMaterial, [u8; 3])] = &[
    (M::Water, [74, 129, 152]),
    (M::Pavement, [200, 199, 195]),
    (M::Paving, [198, 194, 188]),
    (M::Setts, [176, 173, 168]),
    (M::Concrete, [204, 202, 196]),
    (M::Wood, [190, 174, 154]),
    (M::Clay, [196, 160, 140]),
    (M::Tread, [198, 196, 191]),
    (M::Kerb, [212, 211, 207]),
    (M::Carriageway, [160, 162, 164]),
    (M::Asphalt, [160, 162, 164]),
    (M::SideAsphalt, [170, 171, 171]),
    (M::Cycleway, [176, 168, 162]),
    (M::Marking, [232, 231, 227]),
    (M::Sleeper, [174, 168, 160]),
    (M::Rail, [130, 122, 116]),
    (M::StreetRail, [128, 127, 126]),
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
    pub fn set_colour(&mut self, material: PaintMaterial, rgb: [u8; 3]) {
        self.patterns[material.index()].recolour(rgb);
    }

    /// The pattern of a material.
    pub fn pattern(&self, material: PaintMaterial) -> &Pattern {
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
    fn materials_are_told_apart_by_their_lightness() {
        let style = PaintStyle::default();
        let luminance = |material: PaintMaterial| {
            let [r, g, b] = style.pattern(material).mean();
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for (material, range) in [
            (M::Asphalt, 0.30..0.40),
            (M::Concrete, 0.55..0.65),
            (M::Grass, 0.38..0.50),
            (M::Forest, 0.22..0.32),
            (M::Water, 0.15..0.25),
            (M::Pavement, 0.52..0.62),
        ] {
            assert!(range.contains(&luminance(material)), "{material:?} {}", luminance(material));
        }
        assert!(
            PaintMaterial::ALL.iter().all(|material| (0.15..0.85).contains(&luminance(*material))),
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
