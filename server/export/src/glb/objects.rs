//! The objects of a GLB: which are selected, their rows in the property table, and their records.

use crate::leaves::is_land;
use crate::selection::ObjectSelection;
use crate::source::{ExportSource, SourceError};
use insula_objects::{BLOCK_OBJECTS, FeatureKind, ObjectBlock, ObjectRecord};
use insula_protocol::blockmap::NO_OBJECT;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Most blocks that are kept.
const MAX_BLOCKS: usize = 64;

/// Reads objects of a city. Blocks that were read are kept, because the objects of a tile come from few.
pub(crate) struct ObjectReader<'a> {
    source: &'a dyn ExportSource,
    blocks: RefCell<BTreeMap<u32, Option<Rc<ObjectBlock>>>>,
}

impl<'a> ObjectReader<'a> {
    pub(crate) fn new(source: &'a dyn ExportSource) -> Self {
        Self { source, blocks: RefCell::default() }
    }

    /// The block with an object; `None` if the city does not have it.
    fn block_of(&self, id: u32) -> Result<Option<Rc<ObjectBlock>>, SourceError> {
        let number = id / BLOCK_OBJECTS as u32;
        if let Some(block) = self.blocks.borrow().get(&number) {
            return Ok(block.clone());
        }
        let block = self.source.objects(number)?.map(Rc::new);
        let mut blocks = self.blocks.borrow_mut();
        if blocks.len() == MAX_BLOCKS {
            blocks.clear();
        }
        blocks.insert(number, block.clone());
        Ok(block)
    }

    /// All that is stored of an object; `None` if the city does not have it.
    pub(crate) fn record(&self, id: u32) -> Result<Option<ObjectRecord>, SourceError> {
        Ok(self.block_of(id)?.and_then(|block| block.record(id)))
    }

    /// Whether an object is terrain. Surfaces without an object are.
    pub(crate) fn is_terrain(&self, id: u32) -> Result<bool, SourceError> {
        let kind = if id == NO_OBJECT { None } else { self.block_of(id)?.and_then(|block| block.kind(id)) };
        Ok(kind.is_none_or(|kind| kind == FeatureKind::Relief))
    }

    /// Whether an object extends over the land. Surfaces without an object do.
    pub(crate) fn is_land(&self, id: u32) -> Result<bool, SourceError> {
        let kind = if id == NO_OBJECT { None } else { self.block_of(id)?.and_then(|block| block.kind(id)) };
        Ok(kind.is_none_or(is_land))
    }

    /// The object's identifier in the source; `None` if it has none.
    pub(crate) fn identifier(&self, id: u32) -> Result<Option<String>, SourceError> {
        let block = self.block_of(id)?;
        Ok(block.and_then(|block| block.identifier(id).map(str::to_owned)).filter(|name| !name.is_empty()))
    }

    pub(crate) fn schema(&self) -> &'a insula_objects::Schema {
        self.source.schema()
    }
}

/// How the selected part of an object is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Choice {
    /// All of it, or nothing.
    Whole(bool),
    /// Triangles and columns in the selected area, as for land.
    ByPlace,
}

/// Decides which surfaces are selected.
pub(crate) struct Chooser<'a> {
    selection: &'a ObjectSelection,
    pub(crate) is_everything: bool,
    reader: &'a ObjectReader<'a>,
    origin: [f64; 3],
    known: RefCell<BTreeMap<u32, Choice>>,
}

impl<'a> Chooser<'a> {
    pub(crate) fn new(selection: &'a ObjectSelection, reader: &'a ObjectReader<'a>) -> Self {
        let origin = reader.source.manifest().origin;
        let is_everything = *selection == ObjectSelection::default();
        Self { selection, is_everything, reader, origin, known: RefCell::default() }
    }

    /// Whether a surface of `object` at a world position is selected. Objects are selected as a whole, by [`ObjectSelection::contains`];
    /// land and surfaces without an object by their place.
    pub(crate) fn has(&self, object: u32, place: [f64; 2]) -> Result<bool, SourceError> {
        if self.is_everything {
            return Ok(true);
        }
        if object == NO_OBJECT {
            return Ok(self.selection.objects.is_none() && self.selection.contains_point(place));
        }
        let known = self.known.borrow().get(&object).copied();
        let choice = match known {
            Some(choice) => choice,
            None => {
                let choice = self.choose(object)?;
                self.known.borrow_mut().insert(object, choice);
                choice
            }
        };
        Ok(match choice {
            Choice::Whole(has) => has,
            Choice::ByPlace => self.selection.contains_point(place),
        })
    }

    fn choose(&self, object: u32) -> Result<Choice, SourceError> {
        if !self.selection.contains_object(object) {
            return Ok(Choice::Whole(false));
        }
        let Some(block) = self.reader.block_of(object)? else { return Ok(Choice::ByPlace) };
        let is_land = block.kind(object).is_none_or(is_land);
        let bounds = block.bounds(object).filter(|_| !is_land);
        let corner = |corner: [i32; 3]| [0, 1].map(|k| self.origin[k] + f64::from(corner[k]) / 10.0);
        Ok(bounds.map_or(Choice::ByPlace, |bounds| {
            Choice::Whole(self.selection.contains(object, Some([corner(bounds.min), corner(bounds.max)])))
        }))
    }
}
