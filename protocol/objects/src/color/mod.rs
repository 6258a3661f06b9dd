//! Colours of objects by the value of one attribute, with a legend.
//!
//! Numbers and dates have a gradient over a range, texts and booleans have classes: their most frequent values.

mod palette;

use crate::block::ObjectBlock;
use crate::filter::{Source, similar_name};
use crate::kind::FeatureKind;
use crate::schema::{AttributeInfo, AttributeLabel, Schema, title_in};
use crate::suggest;
use crate::value::{Value, ValueRef, ValueType};
use colorous::Gradient;
use insula_protocol::text::fixed;
use palette::{ColorPalette, MAX_CLASSES};
use serde::Serialize;
use std::collections::BTreeMap;

/// Colour of objects without a value.
pub const NO_DATA_RGB: [u8; 3] = [211, 211, 211];
/// Colour of values that have no class of their own.
pub const OTHER_RGB: [u8; 3] = [128, 128, 128];
/// Maximum bytes of a text that [`ColorBy::parse`] reads.
const MAX_TEXT_BYTES: usize = 512;
/// Heights have no range in a schema: it is this one, in metres, until [`ColorBy::over_heights`] has seen some.
const HEIGHT_RANGE_M: [f64; 2] = [0.0, 100.0];
/// Number of colours of a legend's ramp, and of its labelled entries.
const RAMP_STOPS: usize = 32;
const RAMP_ENTRIES: usize = 5;

/// Why a text does not say by what to colour.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ColorError {
    #[error("objects have no attribute {name}: {hint}")]
    UnknownAttribute { name: String, hint: String },
    #[error("no palette has the name {name}: write one of {names}")]
    UnknownPalette { name: String, names: String },
    #[error("the text has more than {MAX_TEXT_BYTES} bytes: write ATTRIBUTE or ATTRIBUTE:PALETTE")]
    TooLong,
}

impl ColorError {
    /// The word of programs for it, which say it in words of their own, and the name that is unknown.
    #[must_use]
    pub fn code(&self) -> (&'static str, Option<&str>) {
        match self {
            Self::UnknownAttribute { name, .. } => ("attribute", Some(name.as_str())),
            Self::UnknownPalette { name, .. } => ("palette", Some(name.as_str())),
            Self::TooLong => ("long", None),
        }
    }
}

/// Colours of objects by an attribute, by `kind` or by `height`.
#[derive(Debug, Clone)]
pub struct ColorBy {
    source: Source,
    title: String,
    label: AttributeLabel,
    unit: Option<String>,
    value_type: ValueType,
    scale: Scale,
}

#[derive(Debug, Clone)]
enum Scale {
    /// The values of the gradient's ends.
    Range { gradient: Gradient, range: [f64; 2] },
    /// Values as texts, with their colours. The flag says whether there are others.
    Classes { classes: Vec<(String, [u8; 3])>, has_others: bool },
}

/// What colours mean.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Legend {
    /// What people read for the name of the attribute, or its name.
    pub title: String,
    /// The same by codes of languages.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub titles: BTreeMap<String, String>,
    pub unit: Option<String>,
    /// Classes, or values along the ramp in ascending order. The last entry is for objects without a value.
    pub entries: Vec<LegendEntry>,
    /// `None` for classes.
    pub ramp: Option<Ramp>,
}

/// The meaning of one colour.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LegendEntry {
    pub rgb: [u8; 3],
    pub label: String,
}

/// Colours of a range of numbers, or of dates as days since 1970-01-01.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ramp {
    /// Values of the first and the last colour. The first may be the larger one.
    pub range: [f64; 2],
    /// Colours at equal distances.
    pub stops: Vec<[u8; 3]>,
}

impl Legend {
    /// The legend with the title of a language, if there is one.
    #[must_use]
    pub fn in_language(mut self, language: &str) -> Self {
        if let Some(title) = title_in(&self.titles, language) {
            self.title = title.to_owned();
        }
        self
    }
}

impl ColorBy {
    /// Parses `ATTRIBUTE` or `ATTRIBUTE:PALETTE`. The attribute is one of the schema or one of `id`, `identifier`, `kind`, `height`.
    /// Fails if one of them is unknown.
    ///
    /// Palettes are those of [`ColorBy::palettes`]. Without one, numbers and dates have `viridis` over the range of the schema,
    /// other values `classes`. A gradient for texts colours their classes, `classes` for numbers the most frequent numbers.
    pub fn parse(text: &str, schema: &Schema) -> Result<Self, ColorError> {
        if text.len() > MAX_TEXT_BYTES {
            return Err(ColorError::TooLong);
        }
        // Names may have colons themselves.
        if let Some(source) = Source::of_name(text, schema) {
            return Ok(Self::new(source, text, None, schema));
        }
        let (name, palette) = text.rsplit_once(':').unwrap_or((text, ""));
        let Some(source) = Source::of_name(name, schema) else {
            let hint = match similar_name(name, schema) {
                Some(similar) => format!("did you mean {similar}?"),
                None => "see the schema for those that they have".to_owned(),
            };
            return Err(ColorError::UnknownAttribute { name: name.to_owned(), hint });
        };
        match ColorPalette::from_name(palette) {
            Some(palette) => Ok(Self::new(source, name, Some(palette), schema)),
            None => {
                let similar = suggest::nearest(palette, ColorPalette::names()).map(str::to_owned);
                let names = similar.unwrap_or_else(|| ColorPalette::names().collect::<Vec<_>>().join(", "));
                Err(ColorError::UnknownPalette { name: palette.to_owned(), names })
            }
        }
    }

    /// Names of all palettes.
    pub fn palettes() -> impl Iterator<Item = &'static str> {
        ColorPalette::names()
    }

    fn new(source: Source, title: &str, palette: Option<ColorPalette>, schema: &Schema) -> Self {
        let info = match source {
            Source::Attribute(attribute) => schema.attributes.get(attribute as usize),
            _ => None,
        };
        let (value_type, range) = match (source, info) {
            (Source::Height, _) => (ValueType::Float, HEIGHT_RANGE_M),
            (Source::Id, _) => (ValueType::Integer, [0.0, f64::from(schema.objects.saturating_sub(1))]),
            (_, Some(info)) => (info.value_type, [info.min.unwrap_or(0.0), info.max.unwrap_or(1.0)]),
            _ => (ValueType::Text, [0.0, 1.0]),
        };
        let unit =
            if source == Source::Height { Some("m".to_owned()) } else { info.and_then(|info| info.unit.clone()) };
        let has_range = value_type.is_number() || value_type == ValueType::Date;
        let scale = match palette.unwrap_or(if has_range { ColorPalette::DEFAULT } else { ColorPalette::Classes }) {
            ColorPalette::Gradient(gradient) if has_range => Scale::Range { gradient, range },
            palette => classes(source, info, palette),
        };
        let label = schema.labels.get(title).cloned().unwrap_or_default();
        let title = label.title.as_deref().unwrap_or(title).to_owned();
        Self { source, title, label, unit, value_type, scale }
    }

    /// Gives the legend the title of a language, if there is one.
    #[must_use]
    pub fn in_language(mut self, language: &str) -> Self {
        if let Some(title) = self.label.title_in(language) {
            self.title = title.to_owned();
        }
        self
    }

    /// Replaces the values of the gradient's ends, for skewed values. Values beyond them have the colour of the nearer end. The
    /// first may be the larger one. It has no effect on classes, or if a value is not finite.
    #[must_use]
    pub fn with_range(mut self, ends: [f64; 2]) -> Self {
        if let Scale::Range { range, .. } = &mut self.scale
            && ends.iter().all(|end| end.is_finite())
        {
            *range = ends;
        }
        self
    }

    /// The values of the gradient's ends. `None` for classes.
    pub fn range(&self) -> Option<[f64; 2]> {
        match &self.scale {
            Scale::Range { range, .. } => Some(*range),
            Scale::Classes { .. } => None,
        }
    }

    /// Index of the attribute in the schema. `None` for fields that every object has.
    pub fn attribute(&self) -> Option<u32> {
        match self.source {
            Source::Attribute(attribute) => Some(attribute),
            _ => None,
        }
    }

    /// The value of an object of the block by which it is coloured.
    pub fn value(&self, block: &ObjectBlock, id: u32) -> Option<Value> {
        self.source.value(block, id, block.row(id)?).map(ValueRef::to_value)
    }

    /// The colour of a value, in sRGB and opaque.
    pub fn rgba(&self, value: Option<&Value>) -> [u8; 4] {
        self.rgba_of(value.map(Value::borrowed))
    }

    /// The colour of an object of the block.
    pub fn object_rgba(&self, block: &ObjectBlock, id: u32) -> [u8; 4] {
        self.rgba_of(block.row(id).and_then(|row| self.source.value(block, id, row)))
    }

    fn rgba_of(&self, value: Option<ValueRef<'_>>) -> [u8; 4] {
        let [r, g, b] = value.and_then(|value| self.rgb(value)).unwrap_or(NO_DATA_RGB);
        [r, g, b, u8::MAX]
    }

    /// The colour of a value. `None` if a gradient has no place for it.
    fn rgb(&self, value: ValueRef<'_>) -> Option<[u8; 3]> {
        match &self.scale {
            Scale::Range { gradient, range } => {
                let value = value.as_f64().filter(|value| value.is_finite())?;
                Some(palette::sample(*gradient, position(value, *range)))
            }
            Scale::Classes { classes, .. } => {
                let is_value = |name: &str| match value {
                    ValueRef::Text(text) => text == name,
                    _ => value.to_string() == name,
                };
                Some(classes.iter().find(|(name, _)| is_value(name)).map_or(OTHER_RGB, |(_, rgb)| *rgb))
            }
        }
    }

    /// What the colours mean.
    pub fn legend(&self) -> Legend {
        let entry = |rgb: [u8; 3], label: &str| LegendEntry { rgb, label: label.to_owned() };
        let (mut entries, ramp): (Vec<LegendEntry>, _) = match &self.scale {
            Scale::Range { gradient, range } => {
                let at = |i: usize, count: usize| i as f64 / (count - 1) as f64;
                let stops = (0..RAMP_STOPS).map(|i| palette::sample(*gradient, at(i, RAMP_STOPS))).collect();
                let places: Vec<f64> = match range[0] == range[1] {
                    true => vec![SINGLE],
                    false => (0..RAMP_ENTRIES).map(|i| at(i, RAMP_ENTRIES)).collect(),
                };
                let sample = |at: f64| entry(palette::sample(*gradient, at), &self.label(at, *range));
                let mut entries: Vec<LegendEntry> = places.into_iter().map(sample).collect();
                if range[0] > range[1] {
                    entries.reverse();
                }
                entries.dedup_by(|next, entry| next.label == entry.label);
                (entries, Some(Ramp { range: *range, stops }))
            }
            Scale::Classes { classes, has_others } => {
                let others = has_others.then(|| entry(OTHER_RGB, "others"));
                (classes.iter().map(|(name, rgb)| entry(*rgb, name)).chain(others).collect(), None)
            }
        };
        entries.push(entry(NO_DATA_RGB, "no data"));
        Legend { title: self.title.clone(), titles: self.label.titles.clone(), unit: self.unit.clone(), entries, ramp }
    }

    /// The value at `at` between 0 and 1 of a range, with three significant digits of the range.
    fn label(&self, at: f64, [from, to]: [f64; 2]) -> String {
        // Both ends may be near the largest f64.
        let value = from * (1.0 - at) + to * at;
        match self.value_type {
            ValueType::Date => ValueRef::Date(value.round() as i32).to_string(),
            ValueType::Integer => fixed(value, 0),
            _ => {
                let decimals = 2.0 - (to - from).abs().max(1e-6).log10().floor();
                fixed(value, decimals.clamp(0.0, 6.0) as usize)
            }
        }
    }
}

/// The place of the only value of a range.
const SINGLE: f64 = 0.5;

/// The place of a value in a range: 0 and 1 are its ends.
fn position(value: f64, [from, to]: [f64; 2]) -> f64 {
    // Halves, because the difference of two f64 may be infinite.
    let position = (value / 2.0 - from / 2.0) / (to / 2.0 - from / 2.0);
    if position.is_nan() { SINGLE } else { position }
}

/// Classes of the most frequent values, of all kinds or of the two booleans.
fn classes(source: Source, info: Option<&AttributeInfo>, palette: ColorPalette) -> Scale {
    let frequent = info.map_or(&[][..], |info| info.top.as_slice());
    let names: Vec<&str> = match (source, info.map(|info| info.value_type)) {
        (Source::Kind, _) => FeatureKind::NAMES.iter().map(|(name, _)| *name).collect(),
        (_, Some(ValueType::Bool)) => vec!["true", "false"],
        _ => frequent.iter().map(|(name, _)| name.as_str()).take(MAX_CLASSES).collect(),
    };
    let is_complete = match info {
        Some(info) => info.value_type == ValueType::Bool || info.distinct == Some(names.len() as u32),
        None => source == Source::Kind,
    };
    let color = |(i, name): (usize, &&str)| ((*name).to_owned(), palette.class(i, names.len()));
    Scale::Classes { classes: names.iter().enumerate().map(color).collect(), has_others: !is_complete }
}

#[cfg(test)]
mod tests;

/// Blocks whose objects stand for all of a city.
const SAMPLED_BLOCKS: u32 = 64;
/// Share of the heights that lie below the end of the colours.
const SHARE_BELOW: f64 = 0.98;
/// Where colours may end, in metres: round heights, whose quarters are round, too.
const ENDS_M: [f64; 9] = [5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0, 200.0, 400.0];

/// Numbers of the blocks whose heights stand for those of a city with `count` blocks.
pub fn sampled_blocks(count: u32) -> impl Iterator<Item = u32> {
    let step = count.div_ceil(SAMPLED_BLOCKS).max(1);
    (0..count).step_by(step as usize)
}

impl ColorBy {
    /// Whether the colours are a gradient of heights: see [`Self::over_heights`].
    pub fn is_of_heights(&self) -> bool {
        self.source == Source::Height && self.range().is_some()
    }

    /// Lets a gradient of heights end at a round height that nearly all objects of some [blocks](sampled_blocks) stay below, so that low
    /// towns and high ones have all colours. Other colours stay as they are.
    #[must_use]
    pub fn over_heights<'a>(self, blocks: impl IntoIterator<Item = &'a ObjectBlock>) -> Self {
        if !self.is_of_heights() {
            return self;
        }
        let mut heights = Vec::new();
        for block in blocks {
            let values = block.ids().iter().filter_map(|id| self.value(block, *id)?.as_f64());
            heights.extend(values.filter(|height| *height > 0.0));
        }
        heights.sort_by(f64::total_cmp);
        let Some(last) = heights.len().checked_sub(1) else { return self };
        let high = heights[(last as f64 * SHARE_BELOW) as usize];
        let [.., highest] = ENDS_M;
        let end = ENDS_M.into_iter().find(|end| high <= *end).unwrap_or(highest);
        self.with_range([0.0, end])
    }
}
