//! Makes objects of the tree of a top-level object: itself, its parts and its subdivisions.

use super::attributes::AttributeReader;
use super::convert::{Converter, Surfaces, UNREAD_CURVE};
use super::elements::Elements;
use super::gather::{Faults, LIBRARY, Piece, PieceGeometry, Scene, UNRESOLVED};
use super::kinds::{is_group, is_other_relief, kind_of};
use super::names::Class;
use super::plan::Plan;
use super::session::Session;
use super::shape::{Chosen, choose, remove_copies};
use super::tree::AttributeKind;
use insula_place::crs::is_geographic;
use insula_place::placement::FirstShape;
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::object::{CrsReference, FeatureKind, Shape, SourceObject};
use insula_source::problems::{INTERIOR, NO_CRS};

/// An object that is ready for the sink, or the reason why it is left out.
struct Finished {
    outcome: Result<SourceObject, (&'static str, String)>,
    srs: Option<String>,
}

/// What an object has to know about an object within it.
#[derive(Default)]
struct Within {
    level: Option<u8>,
    /// Its surfaces.
    pieces: Vec<Piece>,
}

impl Within {
    fn add(&mut self, mut other: Self) {
        self.level = self.level.max(other.level);
        self.pieces.append(&mut other.pieces);
    }
}

/// What an object inherits from the object that contains it.
struct ObjectContext<'p> {
    id: String,
    parent: Option<&'p str>,
    /// Coordinate system where the object does not tell its own.
    srs: Option<&'p str>,
    /// Whether its surfaces are left out.
    is_hidden: bool,
}

impl Session<'_, '_> {
    /// Passes a top-level object and the objects within it to the sink.
    pub(super) fn emit(&mut self, elements: Elements<'_>, id: String) -> Result<(), InputError> {
        let srs = self.model_srs.clone();
        let mut finished = Vec::new();
        let context = ObjectContext { id, parent: None, srs: srs.as_deref(), is_hidden: false };
        self.finish(elements, 0, context, &mut finished);
        for Finished { outcome, srs } in finished.into_iter().flatten() {
            match outcome {
                Ok(object) => {
                    self.set_crs(srs, &object)?;
                    self.sink.add(object)?;
                }
                Err((reason, detail)) => self.sink.skip(reason, detail),
            }
        }
        Ok(())
    }

    /// Tells the sink the system of an object. One that neither it nor what encloses it names is unknown: that of another object is none of
    /// its own.
    fn set_crs(&mut self, srs: Option<String>, object: &SourceObject) -> Result<(), InputError> {
        // A name that starts with `#` is of a system that the file defines itself, such as a local grid.
        let Some(name) = srs.filter(|name| !name.is_empty() && !name.starts_with('#')) else {
            return self.guess_crs(object);
        };
        if self.current_srs.as_ref() == Some(&name) {
            return Ok(());
        }
        self.sink.set_crs(&CrsReference::authority(name.clone()))?;
        self.current_srs = Some(name);
        Ok(())
    }

    /// Guesses the system of an object that names none, among others that do: that of the file so far if the coordinates can be of such a
    /// system. Else the sink guesses, as it does of a file that names none.
    fn guess_crs(&mut self, object: &SourceObject) -> Result<(), InputError> {
        let (Some(name), Some(first)) = (&self.current_srs, first_shape(&object.shape)) else { return Ok(()) };
        if first.looks_like_degrees() == is_geographic(name) {
            let id = &object.id;
            let detail = format!("{id}: no srsName for it or around it, taken in {name} as the objects before it");
            self.sink.problem(NO_CRS, detail);
            return Ok(());
        }
        self.sink.set_crs(&CrsReference::authority(""))?;
        self.current_srs = None;
        Ok(())
    }

    /// Makes the object at `node`. The object itself comes before the objects within it.
    fn finish(
        &mut self,
        elements: Elements<'_>,
        node: u32,
        context: ObjectContext<'_>,
        finished: &mut Vec<Option<Finished>>,
    ) -> Within {
        let Elements { tree, names } = elements;
        let plan = Plan::new(tree, names, node);
        let slot = finished.len();
        finished.push(None);
        let srs = envelope_srs(elements, node).or(context.srs);
        let within = |id, is_hidden| ObjectContext {
            id,
            parent: Some(&*context.id),
            srs,
            is_hidden: is_hidden || context.is_hidden,
        };

        let mut parts = Within::default();
        for (index, part) in plan.parts.iter().enumerate() {
            let id = id_within(elements, *part, &context.id, index);
            parts.add(self.finish(elements, *part, within(id, false), finished));
        }
        let (chosen, surfaces) = self.surfaces_of(elements, &plan, &parts, &context);
        let has_surfaces = !surfaces.is_empty() || parts.level.is_some();
        for (index, unit) in plan.subdivisions.iter().chain(&plan.members).enumerate() {
            let is_hidden = has_surfaces && index < plan.subdivisions.len();
            let id = id_within(elements, *unit, &context.id, index + plan.parts.len());
            self.finish(elements, *unit, within(id, is_hidden), finished);
        }
        let srs = chosen.srs.clone().or_else(|| srs.map(str::to_owned));
        let lod = chosen.level.filter(|_| !surfaces.is_empty());
        let has_others = finished.len() > slot + 1;
        if plan.has_rooms {
            self.sink.problem(INTERIOR, context.id.clone());
        }
        let outcome = match self.reason_to_skip(
            elements,
            node,
            &plan,
            &chosen.faults,
            &surfaces,
            has_others || context.is_hidden,
        ) {
            Some(reason) => Err((reason, context.id)),
            None => {
                let attributes = self.attributes_of(elements, node);
                self.report_faults(&context.id, chosen.faults, &surfaces.faults, chosen.has_lines && !has_surfaces);
                Ok(source_object(elements, node, context, lod, attributes, surfaces.into_shape()))
            }
        };
        finished[slot] = Some(Finished { outcome, srs });
        let is_face = |piece: &Piece| matches!(piece.geometry, PieceGeometry::Face(_));
        parts.add(Within { level: chosen.level, pieces: chosen.pieces.into_iter().filter(is_face).collect() });
        parts
    }

    /// The surfaces of an object, without those that its parts show better.
    fn surfaces_of(
        &mut self,
        elements: Elements<'_>,
        plan: &Plan,
        parts: &Within,
        context: &ObjectContext<'_>,
    ) -> (Chosen, Surfaces) {
        if context.is_hidden {
            return (Chosen::default(), Surfaces::default());
        }
        let Elements { tree, names } = elements;
        let mut excluded: Vec<_> =
            plan.parts.iter().chain(&plan.subdivisions).map(|node| tree.subtree(*node)).collect();
        excluded.sort_unstable_by_key(|range| range.start);
        let scene = Scene { tree, names, appearances: &self.appearances, store: &self.store };
        let mut chosen = choose(scene, plan, &excluded);
        if parts.level > chosen.level {
            chosen.pieces.clear();
        } else if !parts.pieces.is_empty() {
            remove_copies(tree, &mut chosen.pieces, &parts.pieces);
        }
        let surfaces = Converter::new(tree, &mut self.appearances, self.sink).convert(&chosen.pieces);
        (chosen, surfaces)
    }

    fn reason_to_skip(
        &self,
        elements: Elements<'_>,
        node: u32,
        plan: &Plan,
        faults: &Faults,
        surfaces: &Surfaces,
        has_others: bool,
    ) -> Option<&'static str> {
        let name = elements.names.get(elements.tree.node(node).name);
        if !surfaces.is_empty() || has_others || is_group(name) {
            return None;
        }
        let has_fault = |kind| faults.iter().any(|(known, _)| known == kind);
        if is_other_relief(name) || plan.has_other_relief {
            Some("relief without triangles")
        } else if !plan.has_geometry() || plan.has_lines {
            None
        } else if has_fault(LIBRARY) {
            Some(LIBRARY)
        } else if has_fault(UNRESOLVED) {
            Some(UNRESOLVED)
        } else if surfaces.faults.iter().any(|(known, _)| known == UNREAD_CURVE) {
            Some(UNREAD_CURVE)
        } else {
            Some("no usable surface")
        }
    }

    fn attributes_of(&mut self, elements: Elements<'_>, node: u32) -> Attributes {
        let Elements { tree, names } = elements;
        let codelists = &mut self.codelists;
        AttributeReader { tree, names, codelists, attributes: Attributes::default() }.read(node)
    }

    fn report_faults(&mut self, id: &str, faults: Faults, of_surfaces: &Faults, is_lines_only: bool) {
        let mut faults = faults;
        faults.add(of_surfaces.clone());
        if is_lines_only {
            faults.note("only lines or points");
        }
        for (kind, count) in faults.iter() {
            let detail = if count == 1 { id.to_owned() } else { format!("{id}: {count} times") };
            self.sink.problem(kind, detail);
        }
    }
}

fn source_object(
    elements: Elements<'_>,
    node: u32,
    context: ObjectContext<'_>,
    level: Option<u8>,
    attributes: Attributes,
    shape: Shape,
) -> SourceObject {
    let name = elements.names.get(elements.tree.node(node).name);
    let mut kind = kind_of(name);
    if shape == Shape::None && kind == FeatureKind::LandUse && &*name.local != "LandUse" {
        kind = FeatureKind::Generic;
    }
    SourceObject {
        id: context.id,
        parent: context.parent.map(str::to_owned),
        kind,
        source_type: name.local.to_string(),
        lod: level.map(f32::from),
        attributes,
        shape,
    }
}

/// Where the surfaces of an object begin.
fn first_shape(shape: &Shape) -> Option<FirstShape> {
    let Shape::Surfaces { polygons, meshes } = shape else { return None };
    let of_polygons = polygons.iter().flat_map(|surface| &surface.points);
    let positions = of_polygons.chain(meshes.iter().flat_map(|mesh| &mesh.positions));
    FirstShape::of(positions.map(|[x, y, _]| [*x, *y]))
}

/// The identifier of an object within another.
fn id_within(elements: Elements<'_>, node: u32, parent: &str, index: usize) -> String {
    let own = elements.tree.attribute(node, AttributeKind::Id).filter(|id| !id.is_empty());
    own.map_or_else(|| format!("{parent} part {}", index + 1), str::to_owned)
}

/// The coordinate system that the envelope of an object names.
pub(super) fn envelope_srs(elements: Elements<'_>, node: u32) -> Option<&str> {
    let Elements { tree, names } = elements;
    let bounded_by = tree.child_of_class(names, node, Class::BoundedBy)?;
    let envelope = tree.child_of_class(names, bounded_by, Class::Envelope)?;
    tree.attribute(envelope, AttributeKind::SrsName).filter(|name| !name.is_empty())
}
