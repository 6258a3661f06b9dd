//! Roofs without walls: canopies, carports and shelters. They are slabs at their height, on posts.

use super::height::{BASE, BuildingHeight, HeightHints};
use super::lengths::named_lengths;
use insula_source::attributes::Attributes;
use insula_source::problems::GUESSED;

/// Thickness of a roof.
pub(super) const SLAB_M: f64 = 0.3;
/// Values of names of kinds and uses that mean a roof without walls, also in the languages of the larger publishers.
const ROOFS: &[&str] = &[
    "roof", "canopy", "überdachung", "ueberdachung", "overkapping", "auvent", "tettoia", "pensilina", "marquesina",
    "wiata",
];
const CARPORTS: &[&str] = &["carport", "carports", "überdachter stellplatz"];
/// Heights of those without one.
const ROOF_M: f64 = 4.0;
const LOW_ROOF_M: f64 = 2.6;
/// Names of what a building or its part is, in lower case; the first that has a value counts.
const KINDS: &[&str] = &[
    "building:part", "building", "fclass", "class", "type", "building_type", "usage", "function", "funktion",
    "gebaeudefunktion", "bgt_type", "bgt-type", "nature", "tipo",
];
/// Values that tell nothing.
const ANY: &[&str] = &["yes", "true", "building", "no"];
/// Shelters with walls.
const WALLED: &[&str] = &["basic_hut", "rock_shelter", "wildlife_hide", "weather_shelter_closed", "building", "igloo"];

/// A roof without walls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Canopy {
    /// Height if nothing tells it.
    usual_m: f64,
    /// Whether the attributes tell where it begins.
    has_base: bool,
}

impl Canopy {
    /// The canopy that attributes tell; `None` for what has walls.
    pub fn of(attributes: &Attributes) -> Option<Self> {
        let value = |name: &str| Some(attributes.named(name)?.as_str()?.trim().to_lowercase());
        let telling = |name: &&str| value(name).filter(|value| !ANY.contains(&value.as_str()));
        let kind = KINDS.iter().find_map(telling).unwrap_or_default();
        let is_shelter = (kind.is_empty() && value("amenity").is_some_and(|amenity| amenity == "shelter")
            || kind == "shelter")
            && !value("shelter_type").is_some_and(|shelter| WALLED.contains(&shelter.as_str()))
            && value("walls").is_none_or(|walls| walls != "yes");
        let usual_m = match kind.as_str() {
            kind if ROOFS.contains(&kind) => ROOF_M,
            kind if CARPORTS.contains(&kind) || is_shelter => LOW_ROOF_M,
            _ => return None,
        };
        let has_base = named_lengths(attributes, BASE, 1.0).next().is_some();
        Some(Self { usual_m, has_base })
    }

    /// As [`BuildingHeight::of`], of the whole canopy from the ground, or from where its attributes say that it begins.
    pub fn height(
        self,
        attributes: &Attributes,
        hints: HeightHints<'_>,
        mut note: impl FnMut(&str, &str),
    ) -> BuildingHeight {
        let mut is_guess = false;
        let mut height = BuildingHeight::of(attributes, hints, |kind, detail| match kind {
            GUESSED => is_guess = true,
            _ => note(kind, detail),
        });
        if is_guess {
            height.top_m = height.base_m + if self.has_base { SLAB_M } else { self.usual_m };
            note(GUESSED, &format!("{} m", height.top_m));
        }
        // Storeys below it do not make it thicker.
        if !self.has_base {
            height.base_m = 0.0;
        }
        height
    }

    /// Height at which a roof begins, whose eaves are at `eaves_m`.
    pub fn base_m(self, height: &BuildingHeight, eaves_m: f64) -> f64 {
        if self.has_base { height.base_m } else { (eaves_m - SLAB_M).max(0.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::attributes::AttributeValue;

    fn canopy(pairs: &[(&str, &str)]) -> Option<(f64, f64)> {
        let mut attributes = Attributes::default();
        pairs.iter().for_each(|(name, value)| attributes.push(name, AttributeValue::from_untyped(value)));
        let canopy = Canopy::of(&attributes)?;
        let height = canopy.height(&attributes, HeightHints::default(), |_, _| {});
        Some((canopy.base_m(&height, height.top_m), height.top_m))
    }

    #[test]
    fn roofs_carports_and_shelters_are_slabs_at_their_height() {
        for (pairs, base_m, top_m) in [
            (&[("building", "roof"), ("height", "5")][..], 4.7, 5.0),
            (&[("building", "roof"), ("building:levels", "1")], 2.7, 3.0),
            (&[("building", "roof"), ("building:min_level", "1"), ("building:levels", "2")], 5.7, 6.0),
            (&[("building", "roof")], 3.7, 4.0),
            (&[("building:part", "roof"), ("height", "12"), ("min_height", "10")], 10.0, 12.0),
            (&[("building", "roof"), ("min_height", "3")], 3.0, 3.3),
            (&[("building", "carport")], 2.3, 2.6),
            (&[("amenity", "shelter")], 2.3, 2.6),
            (&[("building", "yes"), ("amenity", "shelter"), ("height", "3")], 2.7, 3.0),
            (&[("FCLASS", "building"), ("TYPE", "roof"), ("height", "6")], 5.7, 6.0),
            (&[("building", "roof"), ("height", "0.2")], 0.0, 0.2),
            (&[("Funktion", "Überdachung"), ("HOEHE", "5")], 4.7, 5.0),
            (&[("bgt-type", "overkapping"), ("height", "5")], 4.7, 5.0),
            (&[("NATURE", "Auvent"), ("HAUTEUR", "5")], 4.7, 5.0),
        ] {
            let Some((base, top)) = canopy(pairs) else { panic!("{pairs:?}") };
            assert!((base - base_m).abs() < 1e-9 && (top - top_m).abs() < 1e-9, "{pairs:?}: {base} to {top}");
        }
        for pairs in [
            &[("building", "yes")][..],
            &[("building", "cabin"), ("amenity", "shelter")],
            &[("amenity", "shelter"), ("shelter_type", "basic_hut")],
            &[("building", "garage"), ("function", "roof")],
            &[("building:part", "column"), ("building", "roof")],
            &[("roof:shape", "flat"), ("height", "3")],
        ] {
            assert_eq!(canopy(pairs), None, "{pairs:?}");
        }
    }
}
