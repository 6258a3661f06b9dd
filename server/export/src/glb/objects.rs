//! Which surfaces of a city are selected.

use crate::leaves::is_land;
use crate::selection::ObjectSelection;
use crate::source::SourceError;
use crate::table::city::City;
use insula_protocol::blockmap::NO_OBJECT;
use std::cell::RefCell;
use std::collections::BTreeMap;

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
    city: &'a City<'a>,
    known: RefCell<BTreeMap<u32, Choice>>,
}

impl<'a> Chooser<'a> {
    pub(crate) fn new(city: &'a City<'a>, selection: &'a ObjectSelection) -> Self {
        let is_everything = *selection == ObjectSelection::default();
        Self { selection, is_everything, city, known: RefCell::default() }
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
        let bounds = self.city.info(object)?.filter(|info| !is_land(info.kind)).and_then(|info| info.bounds);
        let whole = |bounds| Choice::Whole(self.selection.contains(object, Some(bounds)));
        Ok(bounds.map_or(Choice::ByPlace, whole))
    }
}
