//! Colours of objects by an attribute.

use crate::error::DrawError;
use crate::style::Rgb;
use insula_export::leaves::LeafObject;
use insula_export::source::{ExportSource, SourceError};
use insula_objects::color::sampled_blocks;
use insula_objects::family::of_largest_numbers;
use insula_objects::{BLOCK_OBJECTS, ColorBy, FeatureKind, ObjectBlock, Value};
use insula_protocol::mesh_tile::NO_OBJECT;
use std::collections::{BTreeMap, HashMap, HashSet};

/// Reads blocks of objects once each, if they are asked for in order.
struct Blocks<'a> {
    source: &'a dyn ExportSource,
    last: Option<(u32, Option<ObjectBlock>)>,
}

impl Blocks<'_> {
    fn of(&mut self, object: u32) -> Result<Option<&ObjectBlock>, DrawError> {
        let number = object / BLOCK_OBJECTS as u32;
        if self.last.as_ref().is_none_or(|(last, _)| *last != number) {
            self.last = Some((number, self.source.objects(number)?));
        }
        Ok(self.last.as_ref().and_then(|(_, block)| block.as_ref()))
    }
}

/// What is known of an object while the colours are made.
#[derive(Clone, Copy, Default)]
struct PaintFacts {
    rgb: Option<Rgb>,
    /// Number or day of its value.
    number: Option<f64>,
    parent: Option<u32>,
}

/// The colours, over the heights that the city has if they are of those. Fails if objects cannot be read.
pub fn over_heights(color_by: ColorBy, source: &dyn ExportSource) -> Result<ColorBy, SourceError> {
    if !color_by.is_of_heights() {
        return Ok(color_by);
    }
    let count = source.schema().objects.div_ceil(BLOCK_OBJECTS as u32);
    let blocks = sampled_blocks(count).map(|block| source.objects(block)).collect::<Result<Vec<_>, _>>()?;
    Ok(color_by.over_heights(blocks.iter().flatten()))
}

/// The colours of `objects`: of all kinds of which one has a value, itself, by its parent or by its parts, as viewers have them. Fails if
/// objects cannot be read.
pub(crate) fn attribute_colors(
    source: &dyn ExportSource,
    objects: &[LeafObject],
    color_by: &ColorBy,
) -> Result<Vec<Option<Rgb>>, DrawError> {
    let mut blocks = Blocks { source, last: None };
    let mut facts: BTreeMap<u32, PaintFacts> = BTreeMap::new();
    let numbers = objects.iter().map(|object| object.number).filter(|number| *number != NO_OBJECT);
    facts.extend(numbers.map(|number| (number, PaintFacts::default())));
    for (object, fact) in &mut facts {
        if let Some(block) = blocks.of(*object)? {
            let value = color_by.value(block, *object);
            let rgb = value.as_ref().map(|value| rgb_of(color_by, Some(value)));
            let number = value.as_ref().and_then(Value::as_f64);
            *fact = PaintFacts { rgb, number, parent: block.parent(*object) };
        }
    }
    let mut parents: BTreeMap<u32, Option<Rgb>> = BTreeMap::new();
    parents.extend(facts.values().filter(|own| own.rgb.is_none()).filter_map(|own| Some((own.parent?, None))));
    for (number, color) in &mut parents {
        if let Some(block) = blocks.of(*number)? {
            *color = color_by.value(block, *number).map(|value| rgb_of(color_by, Some(&value)));
        }
    }
    let of_parts = colors_of_parts(&facts, objects);
    let color_of = |number: u32, own: &PaintFacts| {
        let inherited = own.rgb.or_else(|| parents.get(&own.parent?).copied().flatten());
        inherited.or_else(|| of_parts.get(&number).copied())
    };
    let of_values: HashMap<u32, Rgb> =
        facts.iter().filter_map(|(number, own)| Some((*number, color_of(*number, own)?))).collect();
    let has_value = |object: &&LeafObject| of_values.contains_key(&object.number);
    let kinds: HashSet<FeatureKind> = objects.iter().filter(has_value).map(|object| object.kind).collect();
    let no_data = rgb_of(color_by, None);
    let color = |object: &LeafObject| {
        let is_colored = object.number != NO_OBJECT && kinds.contains(&object.kind);
        is_colored.then(|| of_values.get(&object.number).copied().unwrap_or(no_data))
    };
    Ok(objects.iter().map(color).collect())
}

/// The colours of wholes without a value, by the largest number of their drawn parts.
fn colors_of_parts(facts: &BTreeMap<u32, PaintFacts>, objects: &[LeafObject]) -> BTreeMap<u32, Rgb> {
    let kinds: HashMap<u32, FeatureKind> = objects.iter().map(|object| (object.number, object.kind)).collect();
    let numbers = facts.iter().filter_map(|(object, part)| {
        let (number, rgb, whole) = (part.number?, part.rgb?, part.parent?);
        let lacks_value = facts.get(&whole)?.rgb.is_none();
        let is_part = kinds.get(object)?.is_part_of(*kinds.get(&whole)?);
        (lacks_value && is_part).then_some((whole, number, rgb))
    });
    of_largest_numbers(numbers)
}

fn rgb_of(color_by: &ColorBy, value: Option<&Value>) -> Rgb {
    let [r, g, b, _] = color_by.rgba(value);
    [r, g, b]
}
