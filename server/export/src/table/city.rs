//! A city as exports read it: blocks of objects through a small cache, and what is selected of them.

use super::ExportError;
use super::grid::{LeafOrder, MapGrid};
use crate::selection::ObjectSelection;
use crate::source::{ExportSource, SourceError};
use insula_objects::{BLOCK_OBJECTS, FeatureKind, ObjectBlock, ObjectBounds, ObjectRecord};
use insula_protocol::Manifest;
use roaring::RoaringBitmap;
use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

/// Blocks that are kept decoded. Objects that are near each other are in few blocks.
const CACHED_BLOCKS: usize = 64;
/// Longest chain of parents that is followed; a longer one is a loop.
const MAX_ANCESTORS: usize = 8;
/// Bounds are rounded to decimetres, and meshes are not exactly where their source is.
const BOUNDS_MARGIN_M: f64 = 1.0;

/// What exports need of a city.
pub(crate) struct City<'a> {
    pub(crate) source: &'a dyn ExportSource,
    pub(crate) manifest: &'a Manifest,
    pub(crate) grid: MapGrid,
    pub(crate) order: LeafOrder,
    /// Most recently used first.
    blocks: RefCell<Vec<(u32, Option<Rc<ObjectBlock>>)>>,
}

/// What is known of an object without its attributes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ObjectInfo {
    pub(crate) kind: FeatureKind,
    pub(crate) parent: Option<u32>,
    /// World metres.
    pub(crate) bounds: Option<[[f64; 2]; 2]>,
}

impl<'a> City<'a> {
    pub(crate) fn new(source: &'a dyn ExportSource) -> Self {
        let manifest = source.manifest();
        let (grid, order) = (MapGrid::of(manifest), LeafOrder::of(manifest));
        Self { source, manifest, grid, order, blocks: RefCell::default() }
    }

    /// The block of objects of a number. Fails if it cannot be read.
    fn block(&self, number: u32) -> Result<Option<Rc<ObjectBlock>>, SourceError> {
        let mut blocks = self.blocks.borrow_mut();
        if let Some(at) = blocks.iter().position(|(known, _)| *known == number) {
            blocks.get_mut(..=at).into_iter().for_each(|used| used.rotate_right(1));
        } else {
            blocks.truncate(CACHED_BLOCKS - 1);
            blocks.insert(0, (number, self.source.objects(number)?.map(Rc::new)));
        }
        Ok(blocks.first().and_then(|(_, block)| block.clone()))
    }

    fn block_of(&self, object: u32) -> Result<Option<Rc<ObjectBlock>>, SourceError> {
        if object >= self.source.schema().objects { Ok(None) } else { self.block(object / BLOCK_OBJECTS as u32) }
    }

    /// `None` if the city has no such object.
    pub(crate) fn info(&self, object: u32) -> Result<Option<ObjectInfo>, SourceError> {
        let block = self.block_of(object)?;
        Ok(block.and_then(|block| {
            let bounds = block.bounds(object).map(|bounds| self.area_of(&bounds));
            Some(ObjectInfo { kind: block.kind(object)?, parent: block.parent(object), bounds })
        }))
    }

    /// `None` if the city has no such object.
    pub(crate) fn record(&self, object: u32) -> Result<Option<ObjectRecord>, SourceError> {
        Ok(self.block_of(object)?.and_then(|block| block.record(object)))
    }

    /// The identifier of an object in its source; empty if it has none.
    pub(crate) fn identifier(&self, object: u32) -> Result<String, SourceError> {
        let block = self.block_of(object)?;
        Ok(block.and_then(|block| block.identifier(object).map(str::to_owned)).unwrap_or_default())
    }

    /// The parents of an object, the nearest first.
    pub(crate) fn ancestors(&self, object: u32) -> Result<Vec<u32>, SourceError> {
        let mut ancestors = Vec::new();
        let mut next = self.info(object)?.and_then(|info| info.parent);
        while let Some(parent) = next.filter(|parent| *parent != object && !ancestors.contains(parent)) {
            let Some(info) = self.info(parent)? else { break };
            ancestors.push(parent);
            next = info.parent.filter(|_| ancestors.len() < MAX_ANCESTORS);
        }
        Ok(ancestors)
    }

    /// The building, bridge or tunnel that an object is a part of, itself if it is none.
    pub(crate) fn whole_of(&self, object: u32) -> Result<u32, SourceError> {
        let Some(mut info) = self.info(object)?.filter(|info| info.parent.is_some()) else { return Ok(object) };
        let mut whole = object;
        for ancestor in self.ancestors(object)? {
            let Some(above) = self.info(ancestor)?.filter(|above| info.kind.is_part_of(above.kind)) else { break };
            (whole, info) = (ancestor, above);
        }
        Ok(whole)
    }

    fn area_of(&self, bounds: &ObjectBounds) -> [[f64; 2]; 2] {
        [bounds.min, bounds.max].map(|[x, y, _]| {
            [self.manifest.origin[0] + f64::from(x) / 10.0, self.manifest.origin[1] + f64::from(y) / 10.0]
        })
    }
}

/// What of a city is exported.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    /// Numbers of the selected objects.
    pub(crate) selected: RoaringBitmap,
    /// World metres around all selected objects, their parts and their parents; `None` if none has bounds.
    pub(crate) area: Option<[[f64; 2]; 2]>,
    /// Position of the last leaf of each object that has parts, with these.
    last_leaves: HashMap<u32, u64>,
    /// Objects with selected parts.
    pub(crate) parents: RoaringBitmap,
    /// Parts of selected objects that stand for these, too: see [`Plan::select_wholes`].
    parts: HashMap<u32, Vec<u32>>,
}

impl Plan {
    /// Reads all blocks of objects once. Fails if one cannot be read.
    pub(crate) fn of(city: &City<'_>, selection: &ObjectSelection) -> Result<Self, ExportError> {
        let mut plan = Self::default();
        for number in 0..city.source.schema().objects.div_ceil(BLOCK_OBJECTS as u32) {
            let Some(block) = city.block(number)? else { continue };
            for &object in block.ids() {
                plan.add(city, selection, object)?;
            }
        }
        Ok(plan)
    }

    fn add(&mut self, city: &City<'_>, selection: &ObjectSelection, object: u32) -> Result<(), ExportError> {
        let Some(info) = city.info(object)? else { return Ok(()) };
        let is_selected = selection.contains(object, info.bounds);
        let mut is_needed = is_selected;
        if is_selected {
            self.selected.insert(object);
        }
        if info.parent.is_some() {
            let last = info.bounds.map_or(0, |bounds| last_leaf(city, bounds));
            for ancestor in city.ancestors(object)? {
                let known = self.last_leaves.entry(ancestor).or_default();
                *known = last.max(*known);
                let bounds = city.info(ancestor)?.and_then(|info| info.bounds);
                // An object that has nothing but parts is where these are.
                let is_place_selected = bounds.is_none() && selection.contains_object(ancestor) && {
                    info.bounds
                        .is_some_and(|[min, max]| selection.contains_point([0, 1].map(|k| 0.5 * (min[k] + max[k]))))
                };
                if is_place_selected {
                    self.selected.insert(ancestor);
                }
                is_needed |= is_place_selected || selection.contains(ancestor, bounds);
                // Exports of surfaces have the parents of what is selected.
                if is_selected {
                    self.parents.insert(ancestor);
                }
                if let Some(bounds) = bounds.filter(|_| is_selected) {
                    self.cover(bounds);
                }
            }
        }
        if let Some(bounds) = info.bounds.filter(|_| is_needed) {
            self.cover(bounds);
        }
        Ok(())
    }

    /// Selects the buildings, bridges and tunnels of the selected parts in place of these. Reads all blocks of objects once more if there
    /// are any. Fails if one cannot be read.
    pub(crate) fn select_wholes(&mut self, city: &City<'_>) -> Result<(), ExportError> {
        if self.last_leaves.is_empty() {
            return Ok(());
        }
        let mut wholes = RoaringBitmap::new();
        for object in &self.selected {
            wholes.insert(city.whole_of(object)?);
        }
        self.selected = wholes;
        for number in 0..city.source.schema().objects.div_ceil(BLOCK_OBJECTS as u32) {
            let Some(block) = city.block(number)? else { continue };
            for &object in block.ids() {
                let whole = city.whole_of(object)?;
                if !self.selected.contains(whole) {
                    continue;
                }
                if whole != object {
                    self.parts.entry(whole).or_default().push(object);
                }
                // A selected part may have neighbours that are not.
                if let Some(bounds) = city.info(object)?.and_then(|info| info.bounds) {
                    self.cover(bounds);
                }
            }
        }
        Ok(())
    }

    /// The parts that have no rows of their own.
    pub(crate) fn parts_of(&self, object: u32) -> &[u32] {
        self.parts.get(&object).map_or(&[], Vec::as_slice)
    }

    fn cover(&mut self, bounds: [[f64; 2]; 2]) {
        let [min, max] = self.area.unwrap_or(bounds);
        self.area = Some([
            [0, 1].map(|k| min[k].min(bounds[0][k] - BOUNDS_MARGIN_M)),
            [0, 1].map(|k| max[k].max(bounds[1][k] + BOUNDS_MARGIN_M)),
        ]);
    }

    /// Position of the last leaf that an object and its parts touch; the largest number if that is not known.
    pub(crate) fn last_leaf(&self, city: &City<'_>, object: u32) -> Result<u64, ExportError> {
        let own = city.info(object)?.and_then(|info| info.bounds).map(|bounds| last_leaf(city, bounds));
        let of_parts = self.last_leaves.get(&object).copied();
        Ok(own.max(of_parts).unwrap_or(u64::MAX))
    }
}

fn last_leaf(city: &City<'_>, [min, max]: [[f64; 2]; 2]) -> u64 {
    let grown = [min.map(|v| v - BOUNDS_MARGIN_M), max.map(|v| v + BOUNDS_MARGIN_M)];
    city.order.last_in(city.manifest, grown)
}
