//! Colours of surfaces: the source's own where a material may have them, else by kind; and kinds of objects by type.

mod look;
mod tables;

use insula_source::error::{InputError, json_message};
use insula_source::object::ObjectKind;
use insula_source::report::ColourOrigin;
use insula_source::source::read_file;
pub use look::{BuildingLook, ObjectShape, WallKind, area_vector, normal_z};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use tables::{MATERIALS, OBJECTS, OTHER, Part, REFLECTIVE, REFLECTIVE_WORDS, SURFACES};

/// Larger palette files are refused.
const MAX_BYTES: u64 = 1 << 20;

/// What is done with the colours that sources have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PaletteMode {
    /// Colours that no material has become those of materials, plain white counts as unknown, and photo textures are
    /// brought to the level of lit materials.
    #[default]
    Harmonised,
    /// Colours and textures of sources stay as they are.
    Source,
}

/// Colours of surfaces that have none in the source, as 8-bit sRGB, and what is done with the others. The maps hold what
/// replaces the built-in colours.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Palette {
    pub mode: PaletteMode,
    /// By semantic surface such as `RoofSurface`. These take precedence over `objects`.
    pub surfaces: BTreeMap<String, [u8; 3]>,
    /// By object type such as `WaterBody`.
    pub objects: BTreeMap<String, [u8; 3]>,
    /// By name of a material without a colour, in lower case, such as `brick`.
    pub materials: BTreeMap<String, [u8; 3]>,
    /// For everything else.
    pub fallback: Option<[u8; 3]>,
}

/// What decides a surface's colour besides the source's own.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceFacts<'a> {
    pub semantic: Option<&'a str>,
    /// Type in CityJSON. Empty where a format has no types: it is then taken for a building.
    pub object_type: &'a str,
    pub material: Option<&'a str>,
    /// Absolute z of the unit normal.
    pub normal_z: f64,
}

impl SurfaceFacts<'_> {
    /// Whether the surface is water or glass: by a word in the material's name, else by semantics, else by the object's
    /// type.
    pub fn is_reflective(&self) -> bool {
        let semantic = self.semantic.filter(|name| part_of(SURFACES, name).is_some());
        self.material.is_some_and(|name| words(name).any(|word| REFLECTIVE_WORDS.contains(&word.as_str())))
            || REFLECTIVE.contains(&semantic.unwrap_or(self.object_type))
    }
}

/// The words of a name such as `Blue_glass.01` or `blueGlass`, in lower case.
fn words(name: &str) -> impl Iterator<Item = String> {
    let mut before = ' ';
    let mut spaced = String::with_capacity(name.len() + 4);
    for letter in name.chars() {
        if before.is_lowercase() && letter.is_uppercase() {
            spaced.push(' ');
        }
        spaced.extend(letter.to_lowercase());
        before = letter;
    }
    let words: Vec<String> = spaced.split(|c: char| !c.is_alphabetic()).map(str::to_owned).collect();
    words.into_iter()
}

/// A palette file. Its entries replace the built-in colours.
#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
struct PaletteFile {
    mode: PaletteMode,
    surfaces: BTreeMap<String, String>,
    objects: BTreeMap<String, String>,
    materials: BTreeMap<String, String>,
    default: Option<String>,
}

impl Palette {
    /// The palette that the value of a `--palette` option means: `harmonised`, `source`, or a palette file. Fails as
    /// [`Palette::read`] does.
    pub fn from_option(value: &Path) -> Result<Self, InputError> {
        match value.to_str() {
            Some("harmonised") => Ok(Self::default()),
            Some("source") => Ok(Self { mode: PaletteMode::Source, ..Self::default() }),
            _ => Self::read(value),
        }
    }

    /// Reads a palette file. Fails if it cannot be read, is not valid JSON, or has an unknown key or colour, which the
    /// message names.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let label = path.display().to_string();
        let bytes = read_file(path, MAX_BYTES)?;
        Self::from_json(&bytes).map_err(|what| InputError::Palette { path: label, what })
    }

    fn from_json(text: &[u8]) -> Result<Self, String> {
        let file: PaletteFile = serde_json::from_slice(text)
            .map_err(|error| format!("line {}, column {}: {}", error.line(), error.column(), json_message(&error)))?;
        let mut palette = Self { mode: file.mode, ..Self::default() };
        for (section, colours, known, into) in [
            ("surfaces", file.surfaces, SURFACES, &mut palette.surfaces),
            ("objects", file.objects, OBJECTS, &mut palette.objects),
        ] {
            for (name, colour) in colours {
                // Names of CityJSON extensions begin with a plus.
                if part_of(known, &name).is_none() && !name.starts_with('+') {
                    let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
                    return Err(format!("{section}.{name} is unknown; known are {}", names.join(", ")));
                }
                let rgb = parse_entry(&format!("{section}.{name}"), &colour)?;
                into.insert(name, rgb);
            }
        }
        for (name, colour) in file.materials {
            let rgb = parse_entry(&format!("materials.{name}"), &colour)?;
            palette.materials.insert(name.to_lowercase(), rgb);
        }
        palette.fallback = file.default.map(|colour| parse_entry("default", &colour)).transpose()?;
        Ok(palette)
    }

    /// The colour of a surface without a texture, and where it comes from. `source` is the colour in the source.
    pub fn resolve(
        &self,
        source: Option<[u8; 3]>,
        surface: &SurfaceFacts<'_>,
        look: &BuildingLook,
    ) -> ([u8; 3], ColourOrigin) {
        match (source, self.mode) {
            (Some(rgb), PaletteMode::Source) => (rgb, ColourOrigin::Source),
            (Some(rgb), PaletteMode::Harmonised) if !is_unknown(rgb) => match harmonise(rgb) {
                Some(material) => (look.shade(material), ColourOrigin::Harmonised),
                None => (rgb, ColourOrigin::Source),
            },
            _ => (self.colour(surface, look), ColourOrigin::Palette),
        }
    }

    /// Colour by the material's name, else by semantics, else by the object's type, else the fallback.
    fn colour(&self, surface: &SurfaceFacts<'_>, look: &BuildingLook) -> [u8; 3] {
        if let Some(rgb) = surface.material.and_then(|name| self.material(name)) {
            return rgb;
        }
        let part = surface.semantic.and_then(|name| find(&self.surfaces, SURFACES, name));
        let part = part.or_else(|| find(&self.objects, OBJECTS, surface.object_type));
        let other = if surface.object_type.is_empty() { Part::Shell } else { OTHER };
        match part.unwrap_or_else(|| self.fallback.map_or(other, Part::Fixed)) {
            Part::Fixed(rgb) => rgb,
            Part::Roof => look.roof(surface.normal_z),
            Part::Wall => look.wall(),
            Part::Shell => look.shell(surface.normal_z),
        }
    }

    /// Whether the palette has a colour for objects of this type.
    pub fn knows_object(&self, object_type: &str) -> bool {
        find(&self.objects, OBJECTS, object_type).is_some()
    }

    /// Colour of a material by name.
    pub fn material(&self, name: &str) -> Option<[u8; 3]> {
        let name = name.trim().to_lowercase();
        let built_in = || MATERIALS.iter().find(|(known, _)| *known == name).map(|(_, rgb)| *rgb);
        self.materials.get(&name).copied().or_else(built_in)
    }
}

/// The given colour, else what is built in.
fn find(given: &BTreeMap<String, [u8; 3]>, built_in: &[(&str, Part)], name: &str) -> Option<Part> {
    given.get(name).map(|rgb| Part::Fixed(*rgb)).or_else(|| part_of(built_in, name))
}

fn part_of(table: &[(&str, Part)], name: &str) -> Option<Part> {
    table.iter().find(|(known, _)| *known == name).map(|(_, part)| *part)
}

fn parse_entry(key: &str, colour: &str) -> Result<[u8; 3], String> {
    parse_colour(colour)
        .ok_or_else(|| format!("{key}: \"{colour}\" is not a colour; write it as \"#ab7462\" or \"brown\""))
}

/// Parses a CSS colour such as `#ab7462`, `brown` or `rgb(171, 116, 98)`.
pub fn parse_colour(text: &str) -> Option<[u8; 3]> {
    let [r, g, b, _] = csscolorparser::parse(text.trim()).ok()?.to_rgba8();
    Some([r, g, b])
}

/// Kind of an object by its CityJSON type. Relief is terrain, and so are flat types unless they are modelled as a
/// volume.
pub fn object_kind(object_type: &str, has_volume: bool) -> ObjectKind {
    match object_type {
        "TINRelief" => ObjectKind::Terrain,
        "LandUse" | "PlantCover" | "Railway" | "Road" | "TransportSquare" | "WaterBody" | "Waterway" if !has_volume => {
            ObjectKind::Terrain
        }
        _ => ObjectKind::Building,
    }
}

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
fn is_unknown(rgb: [u8; 3]) -> bool {
    rgb.iter().all(|v| *v >= WHITE)
}

/// The colour of a material with the hue of `rgb`; `None` if a material may have the colour itself.
fn harmonise(rgb: [u8; 3]) -> Option<[u8; 3]> {
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

    /// The colour of a surface without one, with the look of no building.
    fn colour(palette: &Palette, semantic: Option<&str>, object_type: &str, normal_z: f64) -> [u8; 3] {
        palette.colour(&SurfaceFacts { semantic, object_type, material: None, normal_z }, &BuildingLook::PLAIN)
    }

    #[test]
    fn surface_colour_takes_precedence_over_object_and_fallback() {
        let palette = Palette::default();
        let tiles = palette.material("roof_tiles").unwrap();
        assert_eq!(colour(&palette, Some("RoofSurface"), "Building", 0.7), tiles);
        assert_eq!(colour(&palette, Some("+Odd"), "WaterBody", 1.0), [74, 129, 152]);
        assert_eq!(colour(&palette, None, "", 0.7), tiles);
        assert_eq!(Part::Fixed(colour(&palette, None, "+Odd", 0.7)), OTHER);
        assert_eq!(palette.material(" Brick"), Some([190, 146, 126]));
    }

    #[test]
    fn source_colours_are_kept_harmonised_or_replaced() {
        let surface = SurfaceFacts { semantic: Some("WallSurface"), object_type: "", material: None, normal_z: 0.0 };
        let harmonised = Palette::default();
        let source = Palette::from_option(Path::new("source")).unwrap();
        assert_eq!(Palette::from_option(Path::new("harmonised")).unwrap(), harmonised);
        let wall = BuildingLook::PLAIN.wall();
        let cases = [
            (Some([120, 90, 80]), ([120, 90, 80], ColourOrigin::Source)),
            (Some([255, 0, 0]), ([196, 131, 106], ColourOrigin::Harmonised)),
            (Some([252, 255, 250]), (wall, ColourOrigin::Palette)),
            (None, (wall, ColourOrigin::Palette)),
        ];
        for (own, expected) in cases {
            assert_eq!(harmonised.resolve(own, &surface, &BuildingLook::PLAIN), expected);
            let kept = own.map_or((wall, ColourOrigin::Palette), |rgb| (rgb, ColourOrigin::Source));
            assert_eq!(source.resolve(own, &surface, &BuildingLook::PLAIN), kept);
        }
    }

    #[test]
    fn palette_file_replaces_only_the_colours_it_names() {
        let text = r##"{"surfaces": {"RoofSurface": "#102030", "+Balcony": "white"}, "objects": {"Road": "rgb(1, 2, 3)"},
            "materials": {"Ziegel": "brown"}, "default": "fff", "mode": "source"}"##;
        let palette = Palette::from_json(text.as_bytes()).unwrap();
        assert_eq!(palette.mode, PaletteMode::Source);
        assert_eq!(colour(&palette, Some("RoofSurface"), "Building", 1.0), [16, 32, 48]);
        assert_eq!(colour(&palette, Some("+Balcony"), "Building", 1.0), [255; 3]);
        assert_eq!(colour(&palette, None, "Road", 1.0), [1, 2, 3]);
        assert_eq!(palette.material("ziegel"), Some([165, 42, 42]));
        assert_eq!((colour(&palette, None, "?", 1.0), colour(&palette, None, "", 1.0)), ([255; 3], [255; 3]));
        assert_eq!(colour(&palette, Some("WallSurface"), "Building", 0.0), BuildingLook::PLAIN.wall());
        assert_eq!(Palette::from_json(b"{}").unwrap(), Palette::default());
    }

    #[test]
    fn errors_in_a_palette_file_name_the_key() {
        for (text, part) in [
            (r#"{"surfaces": {"Roof": "red"}}"#, "surfaces.Roof is unknown; known are "),
            (r#"{"objects": {"RoofSurface": "red"}}"#, "objects.RoofSurface is unknown"),
            (r#"{"objects": {"Road": "greyish"}}"#, "objects.Road: \"greyish\" is not a colour"),
            (r#"{"materials": {"brick": ""}}"#, "materials.brick: "),
            (r#"{"default": "12"}"#, "default: "),
            (r#"{"roofs": {}}"#, "unknown field `roofs`"),
            (r#"{"default": 7}"#, "line 1, column 13: invalid type"),
            ("", "line 1, column 0: EOF"),
        ] {
            let error = Palette::from_json(text.as_bytes()).unwrap_err();
            assert!(error.contains(part) && !error.contains('\n'), "{text}: {error}");
        }
    }

    #[test]
    fn water_and_glass_are_known_by_material_surface_and_object() {
        let is_reflective = |material, semantic, object_type| {
            SurfaceFacts { semantic, object_type, material, normal_z: 1.0 }.is_reflective()
        };
        for name in ["water", "Blue_Glass.01", "river Water", "glass2", "WindowGlass"] {
            assert!(is_reflective(Some(name), None, ""), "{name}");
        }
        for name in ["", "waterproof", "fibreglass", "Underwater", "GLASSES", "window"] {
            assert!(!is_reflective(Some(name), None, ""), "{name}");
        }
        assert!(is_reflective(None, None, "WaterBody") && is_reflective(None, Some("+Odd"), "Waterway"));
        assert!(
            is_reflective(None, Some("Window"), "Building") && is_reflective(None, Some("WaterSurface"), "WaterBody")
        );
        assert!(!is_reflective(None, Some("WaterGroundSurface"), "WaterBody"));
        assert!(!is_reflective(None, Some("WallSurface"), "Building") && !is_reflective(None, None, "Road"));
        let known = |name: &&&str| SURFACES.iter().chain(OBJECTS).any(|(of_table, _)| of_table == *name);
        assert_eq!(REFLECTIVE.iter().filter(known).count(), REFLECTIVE.len());
    }

    #[test]
    fn flat_types_without_volume_are_terrain() {
        assert_eq!(object_kind("TINRelief", true), ObjectKind::Terrain);
        assert_eq!(object_kind("Road", false), ObjectKind::Terrain);
        assert_eq!(object_kind("PlantCover", true), ObjectKind::Building);
        assert_eq!(object_kind("Building", false), ObjectKind::Building);
    }

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
