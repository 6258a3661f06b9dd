//! Colours of objects by an attribute.

use crate::{error::DrawError, style::Rgb};
use insula_export::{leaves::LeafObject, source::ExportSource};
use insula_objects::{BLOCK_OBJECTS, ColorBy, FeatureKind, ObjectBlock};
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

/// The colours of `objects`: of all kinds of which one has a value, itself or by its parent, as viewers have them. Fails if objects
/// cannot be read.
pub(crate) fn attribute_colors(
    source: &dyn ExportSource,
    objects: &[LeafObject],
    color_by: &ColorBy,
) -> Result<Vec<Option<Rgb>>, DrawError> {
    let mut blocks = Blocks { source, last: None };
    // Colour and parent by number.
    let mut facts: BTreeMap<u32, (Option<Rgb>, Option<u32>)> = BTreeMap::new();
    let numbers = objects.iter().map(|object| object.number).filter(|number| *number != NO_OBJECT);
    facts.extend(numbers.map(|number| (number, (None, None))));
    for (number, fact) in &mut facts {
        if let Some(block) = blocks.of(*number)? {
            *fact = (rgb(color_by, block, *number), block.parent(*number));
        }
    }
    let mut parents: BTreeMap<u32, Option<Rgb>> = BTreeMap::new();
    parents.extend(facts.values().filter(|(own, _)| own.is_none()).filter_map(|(_, parent)| Some(((*parent)?, None))));
    for (number, color) in &mut parents {
        if let Some(block) = blocks.of(*number)? {
            *color = rgb(color_by, block, *number);
        }
    }
    let of_values: HashMap<u32, Rgb> = facts
        .iter()
        .filter_map(|(number, (own, parent))| {
            Some((*number, own.or_else(|| parents.get(&(*parent)?).copied().flatten())?))
        })
        .collect();
    let has_value = |object: &&LeafObject| of_values.contains_key(&object.number);
    let kinds: HashSet<FeatureKind> = objects.iter().filter(has_value).map(|object| object.kind).collect();
    let [r, g, b, _] = color_by.rgba(None);
    let color = |object: &LeafObject| {
        let is_colored = object.number != NO_OBJECT && kinds.contains(&object.kind);
        is_colored.then(|| of_values.get(&object.number).copied().unwrap_or([r, g, b]))
    };
    Ok(objects.iter().map(color).collect())
}

fn rgb(color_by: &ColorBy, block: &ObjectBlock, object: u32) -> Option<Rgb> {
    let value = color_by.value(block, object)?;
    let [r, g, b, _] = color_by.rgba(Some(&value));
    Some([r, g, b])
}
