//! Stones as files and pages describe them: a preset, and what differs from it.

use super::definition::{BOTH_VEINS, BROAD_VEINS, FINE_VEINS, Stone, StoneError};
use super::presets::PRESETS;
use crate::srgb::linear_of_srgb;
use serde::{Deserialize, Serialize};

/// A stone by name, with other values where there are any. Ranges are those of [`Stone::check`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoneParameters {
    /// Name of a preset ([`PRESETS`]).
    pub preset: String,
    /// Size of the pattern's largest parts in metres, 0.001 to 100.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_m: Option<f32>,
    /// Colours as sRGB, `#rrggbb`; see the table of [`Stone`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vein: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grain: Option<String>,
    /// Strengths or shares of `vein` and `grain`, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blend: Option<[f32; 2]>,
    /// Reflectance from straight ahead as sRGB, `#rrggbb`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub f0: Option<String>,
    /// Ward's roughness along the grain and across it, 0.02 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness: Option<[f32; 2]>,
    /// Octaves of noise, 1 to 6.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub octaves: Option<u32>,
    /// Which vein functions a marble has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub veins: Option<Veins>,
    /// Half width of veins in units of the noise, 0.005 to 0.2: small values are sharp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vein_width: Option<f32>,
    /// How much the tone varies, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variation: Option<f32>,
    /// How far veins and grains are bent, in cells, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bend: Option<f32>,
    /// Index of refraction, 1.1 to 2.5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refraction: Option<f32>,
    /// Reduced scattering coefficients per millimetre for red, green and blue, 0.001 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scattering_per_mm: Option<[f32; 3]>,
    /// Absorption coefficients per millimetre, 0.00001 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub absorption_per_mm: Option<[f32; 3]>,
    /// Factor of the lengths that light goes in the stone, 0 to 100. 0: no light passes through.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scattering_scale: Option<f32>,
}

/// Vein functions of a marble.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Veins {
    /// Soft and wide.
    Broad,
    /// Sharp and thin.
    Fine,
    Both,
}

impl StoneParameters {
    /// The stone that they describe. Fails at an unknown preset, a colour that is none, and a value outside of its range.
    pub fn stone(&self) -> Result<Stone, StoneError> {
        let unknown = || {
            let known = PRESETS.map(|(name, _)| name).join(", ");
            StoneError::Preset { found: self.preset.clone(), known }
        };
        let mut stone = Stone::preset(&self.preset).ok_or_else(unknown)?;
        let colours = [
            ("base", &self.base, &mut stone.base),
            ("vein", &self.vein, &mut stone.vein),
            ("grain", &self.grain, &mut stone.grain),
            ("f0", &self.f0, &mut stone.f0),
        ];
        for (field, text, colour) in colours {
            if let Some(text) = text {
                *colour = linear_of_hex(text).ok_or_else(|| StoneError::Colour { field, found: text.clone() })?;
            }
        }
        stone.cells_per_m = self.scale_m.map_or(stone.cells_per_m, |scale| 1.0 / scale);
        stone.blend = self.blend.unwrap_or(stone.blend);
        stone.alpha = self.roughness.unwrap_or(stone.alpha);
        stone.octaves = self.octaves.unwrap_or(stone.octaves);
        stone.veins = self.veins.map_or(stone.veins, |veins| match veins {
            Veins::Broad => BROAD_VEINS,
            Veins::Fine => FINE_VEINS,
            Veins::Both => BOTH_VEINS,
        });
        stone.vein_width = self.vein_width.unwrap_or(stone.vein_width);
        stone.variation = self.variation.unwrap_or(stone.variation);
        stone.bend = self.bend.unwrap_or(stone.bend);
        stone.refraction = self.refraction.unwrap_or(stone.refraction);
        stone.scattering = self.scattering_per_mm.unwrap_or(stone.scattering);
        stone.absorption = self.absorption_per_mm.unwrap_or(stone.absorption);
        stone.scattering_scale = self.scattering_scale.unwrap_or(stone.scattering_scale);
        stone.check()?;
        Ok(stone)
    }
}

/// Linear RGB of `#rrggbb`.
fn linear_of_hex(text: &str) -> Option<[f32; 3]> {
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6)?;
    // `from_str_radix` also takes a sign.
    let rgb = digits.bytes().all(|digit| digit.is_ascii_hexdigit()).then(|| u32::from_str_radix(digits, 16).ok())??;
    // The fit of the transfer function ends a little above 1.
    Some([16, 8, 0].map(|shift| linear_of_srgb((rgb >> shift & 255) as f32 / 255.0).min(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stone(json: &str) -> Result<Stone, String> {
        serde_json::from_str::<StoneParameters>(json).map_err(|e| e.to_string())?.stone().map_err(|e| e.to_string())
    }

    #[test]
    fn presets_are_valid_and_their_names_are_found() {
        for (name, preset) in PRESETS {
            preset.check().unwrap();
            assert_eq!(stone(&format!(r#"{{"preset":"{name}"}}"#)), Ok(preset));
        }
        assert_eq!(Stone::preset("cheese"), None);
        assert!(stone(r#"{"preset":"cheese"}"#).unwrap_err().contains("carrara-marble, green-marble"));
    }

    #[test]
    fn values_replace_those_of_the_preset() {
        let found = stone(
            r##"{"preset":"limestone","scale_m":0.5,"base":"#ff8000","roughness":[0.1,0.3],"veins":"fine","octaves":2}"##,
        );
        let found = found.unwrap();
        let limestone = Stone::preset("limestone").unwrap();
        assert!((found.base[0] - 1.0).abs() < 1e-4 && (found.base[1] - 0.2158).abs() < 1e-3 && found.base[2] < 1e-6);
        let rest =
            Stone { cells_per_m: 2.0, base: found.base, alpha: [0.1, 0.3], veins: FINE_VEINS, octaves: 2, ..limestone };
        assert_eq!(found, rest);
    }

    #[test]
    fn values_outside_of_their_ranges_are_refused_by_name() {
        let refused = [
            (r#""scale_m":0"#, "scale_m"),
            (r#""scale_m":-1"#, "scale_m"),
            (r#""scale_m":1e9"#, "scale_m"),
            (r#""octaves":7"#, "octaves of a stone is 7, it can be 1 to 6"),
            (r#""octaves":0"#, "octaves"),
            (r#""octaves":4000000000"#, "octaves"),
            (r#""roughness":[0.01,0.5]"#, "roughness"),
            (r#""roughness":[0.5,1.5]"#, "roughness"),
            (r#""vein_width":0"#, "vein_width"),
            (r#""blend":[0,1.1]"#, "blend"),
            (r#""variation":2"#, "variation"),
            (r#""bend":-0.1"#, "bend"),
            (r#""refraction":1"#, "refraction"),
            (r#""scattering_per_mm":[0,1,1]"#, "scattering_per_mm"),
            (r#""absorption_per_mm":[1,1,0]"#, "absorption_per_mm"),
            (r#""scattering_scale":101"#, "scattering_scale"),
            (r##""base":"#12345""##, "base"),
            (r##""vein":"#+12345""##, "vein"),
            (r##""f0":"#é1234""##, "f0"),
            (r#""grain":"red""#, "grain of a stone is \"red\", not a colour"),
            (r#""colour":"red""#, "unknown field `colour`"),
            (r#""octaves":1.5"#, "expected u32"),
        ];
        for (value, message) in refused {
            let found = stone(&format!(r#"{{"preset":"bronze",{value}}}"#)).unwrap_err();
            assert!(found.contains(message), "{value}: {found}");
        }
        let not_finite = Stone { bend: f32::NAN, ..Stone::NONE };
        assert!(not_finite.check().is_err() && Stone { kind: 9, ..Stone::NONE }.check().is_err());
        assert!(Stone { cells_per_m: f32::INFINITY, ..Stone::NONE }.check().is_err() && Stone::NONE.check().is_ok());
    }
}
