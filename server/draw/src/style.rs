//! The stylesheet of a drawing.

use crate::error::DrawError;
use insula_objects::FeatureKind;
use insula_shaders::look::Look;
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;

/// A colour, red, green, blue.
pub type Rgb = [u8; 3];

/// How a drawing looks: a TOML file with any of these fields.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Stylesheet {
    /// What fills show.
    pub fill: FillMode,
    /// Colours by kind, such as `water = "#9cc3d5"`; `other` is that of all other kinds.
    pub colors: BTreeMap<String, String>,
    /// Share of what is behind that a kind hides, 0 to 1; 1 for kinds that are not named.
    pub opacity: BTreeMap<String, f64>,
    pub lines: LineWeights,
    /// Whose light fills have: the model's or the paper's.
    #[serde(deserialize_with = "deserialize_look")]
    pub look: Look,
    /// Smallest angle between the faces of a crease, in degrees.
    pub crease_deg: f64,
    /// Direction of the light: degrees clockwise from the map's north, and above the horizon.
    pub sun: [f64; 2],
    /// Whether the shadows of the sun are drawn.
    pub shadows: bool,
    /// Colour of shadows, and the share of what is below that they hide.
    pub shadow_color: String,
    pub shadow_opacity: f64,
    /// Hatching by kind.
    pub hatch: BTreeMap<String, Hatch>,
    /// Colour of the paper.
    pub paper: String,
    /// Colour of lines and texts.
    pub ink: String,
}

/// What the fills of shapes show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FillMode {
    None,
    /// One colour for each kind.
    Kind,
    /// The colour of the kind, lighter or darker by the light of the look.
    Light,
    /// The number of the object as a colour of 24 bits, to check pictures. Objects without a number are white.
    Object,
}

/// Widths of lines in millimetres; 0 for none.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LineWeights {
    /// Where a surface turns away from the eye.
    pub silhouette: f64,
    /// Between faces at an angle.
    pub crease: f64,
    /// Where a surface ends, or another object begins.
    pub border: f64,
    /// Where surfaces pass through each other.
    pub intersection: f64,
}

/// Parallel lines that fill a shape.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hatch {
    /// Millimetres between lines, 0.2 to 100.
    pub spacing: f64,
    /// Degrees from the horizontal.
    #[serde(default)]
    pub angle: f64,
    /// Millimetres, at most half of the spacing.
    pub width: f64,
}

impl Default for LineWeights {
    fn default() -> Self {
        Self { silhouette: 0.18, crease: 0.07, border: 0.13, intersection: 0.13 }
    }
}

impl Default for Stylesheet {
    fn default() -> Self {
        let colors = [
            ("building", "#f3ede2"),
            ("building-part", "#f3ede2"),
            ("bridge", "#e2dcd2"),
            ("road", "#e4e2de"),
            ("rail", "#d8d4ce"),
            ("water", "#b9d3de"),
            ("vegetation", "#c3d2ae"),
            ("land-use", "#dfe3cf"),
            ("relief", "#ecebe4"),
            ("other", "#e8e4da"),
        ];
        Self {
            fill: FillMode::Light,
            colors: colors.iter().map(|(kind, color)| ((*kind).to_owned(), (*color).to_owned())).collect(),
            opacity: BTreeMap::new(),
            lines: LineWeights::default(),
            look: Look::Model,
            crease_deg: 20.0,
            sun: [225.0, 45.0],
            shadows: false,
            shadow_color: "#2b3350".to_owned(),
            shadow_opacity: 0.35,
            hatch: BTreeMap::new(),
            paper: "#ffffff".to_owned(),
            ink: "#1c1c1c".to_owned(),
        }
    }
}

impl Stylesheet {
    /// Reads a stylesheet. Fails if a field is unknown or out of range.
    pub fn parse(text: &str) -> Result<Self, DrawError> {
        let sheet: Self = toml::from_str(text).map_err(|error| DrawError::Invalid(error.message().to_owned()))?;
        sheet.completed()
    }

    /// The sheet with the colours of kinds that it does not name. Fails if a value is out of range.
    pub(crate) fn completed(mut self) -> Result<Self, DrawError> {
        for (kind, color) in Self::default().colors {
            self.colors.entry(kind).or_insert(color);
        }
        self.check()?;
        Ok(self)
    }

    fn check(&self) -> Result<(), DrawError> {
        let invalid = |text: String| Err(DrawError::Invalid(text));
        let own = [&self.shadow_color, &self.paper, &self.ink];
        for color in self.colors.values().chain(own) {
            if parse_color(color).is_none() {
                return invalid(format!("{color}: not a colour such as #9cc3d5"));
            }
        }
        let is_kind = |name: &str| name == "other" || FeatureKind::NAMES.iter().any(|(kind, _)| *kind == name);
        let named = self.colors.keys().chain(self.opacity.keys()).chain(self.hatch.keys());
        if let Some(unknown) = named.into_iter().find(|name| !is_kind(name)) {
            return invalid(format!("{unknown}: not a kind of object"));
        }
        let LineWeights { silhouette, crease, border, intersection } = self.lines;
        let is_share = |v: &f64| (0.0..=1.0).contains(v);
        let is_valid = [silhouette, crease, border, intersection].iter().all(|width| (0.0..=10.0).contains(width))
            && (0.0..=180.0).contains(&self.crease_deg)
            && self.opacity.values().chain([&self.shadow_opacity]).all(is_share)
            && self.sun[0].abs() <= 360.0
            && (0.0..=90.0).contains(&self.sun[1])
            && self.hatch.values().all(Hatch::is_valid);
        if is_valid { Ok(()) } else { invalid("a number of the stylesheet is out of range".to_owned()) }
    }

    /// Colour of a kind.
    #[must_use]
    pub fn color(&self, kind: FeatureKind) -> Rgb {
        let color = self.colors.get(kind_name(kind)).or_else(|| self.colors.get("other"));
        color.and_then(|color| parse_color(color)).unwrap_or([230; 3])
    }

    /// Share of what is behind that a kind hides.
    #[must_use]
    pub fn opacity(&self, kind: FeatureKind) -> f64 {
        self.opacity.get(kind_name(kind)).copied().unwrap_or(1.0)
    }
}

impl Hatch {
    fn is_valid(&self) -> bool {
        (0.2..=100.0).contains(&self.spacing)
            && self.angle.abs() <= 360.0
            && (0.0..=0.5 * self.spacing).contains(&self.width)
    }
}

/// The name of a kind on the command line.
#[must_use]
pub fn kind_name(kind: FeatureKind) -> &'static str {
    FeatureKind::NAMES.iter().find(|(_, known)| *known == kind).map_or("other", |(name, _)| name)
}

/// The look with a word. Fails if drawings have no such look: light as it is measured needs the exposure of a picture.
pub fn parse_look(word: &str) -> Result<Look, String> {
    let look = Look::of_word(word).filter(|look| *look != Look::Physical);
    look.ok_or_else(|| "drawings have the looks model and paper".to_owned())
}

fn deserialize_look<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Look, D::Error> {
    parse_look(&String::deserialize(deserializer)?).map_err(D::Error::custom)
}

/// Reads `#rrggbb`.
#[must_use]
pub fn parse_color(text: &str) -> Option<Rgb> {
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii())?;
    let value = u32::from_str_radix(digits, 16).ok()?;
    Some([16, 8, 0].map(|shift| (value >> shift & 0xff) as u8))
}

/// A colour as `#rrggbb`.
#[must_use]
pub fn color_text([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stylesheet_changes_what_it_names() {
        let sheet = Stylesheet::parse("fill = \"kind\"\n[colors]\nwater = \"#0000ff\"\n[lines]\ncrease = 0").unwrap();
        assert_eq!((sheet.fill, sheet.lines.crease, sheet.lines.silhouette), (FillMode::Kind, 0.0, 0.18));
        assert_eq!(sheet.color(FeatureKind::Water), [0, 0, 255]);
        assert_eq!((sheet.look, Stylesheet::parse("look = \"paper\"").unwrap().look), (Look::Model, Look::Paper));
        assert_eq!(sheet.color(FeatureKind::Tunnel), sheet.color(FeatureKind::Furniture));
        for wrong in [
            "fil = 1", "[colors]\nwater = \"blue\"", "[colors]\nsea = \"#0000ff\"", "sun = [0, 91]",
            "crease_deg = nan", "look = \"physical\"",
        ] {
            assert!(Stylesheet::parse(wrong).is_err(), "{wrong}");
        }
    }
}
