//! Takes the objects of a source into the city, alike for all formats: kinds that are wanted, places in the city's
//! coordinate system, triangles, colours and textures.

mod footprints;
mod ground_shapes;
mod materials;
mod mesh_place;
mod mesh_shape;
mod outward;
mod painted;
mod plans;
mod plants;
mod standing;
mod surfaces;
mod texts;
mod told_heights;

use super::context::{ByteProgress, ReadContext};
use super::scene_builder::{ObjectRelation, OpenObject, PendingLandmark, WorldTriangle, hash_of_id, is_valid_position};
use insula_dress::facade::FacadeUse;
use insula_dress::footprint::{ENDED, HAZARD, HeightHints, has_ended, has_height, is_hazard, is_hidden, is_yes};
use insula_place::PlacingOptions;
use insula_place::crs::is_undefined;
use insula_place::local_frame::LocalFrame;
use insula_place::placement::{FirstShape, Placement};
use insula_protocol::text::human_bytes;
use insula_read_ground::HEIGHTS_M;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{
    CrsReference, Description, FeatureKind, ObjectSink, Shape, SourceMaterial, SourceObject, WholeBuilding,
};
use insula_source::problems::{EITHER_ORDER, MIRRORED, MISSING_GROUND, NO_CRS, ZERO_HEIGHTS};
use insula_source::report::{SourceFormat, SourceReport};
use insula_source::source::CitySource;
use insula_source::subject;
use materials::MaterialTable;
use mesh_place::UnplacedMesh;
use mesh_shape::MeshShape;
use outward::FacingCounts;
use plans::areas_without_heights;
use std::collections::HashSet;
use told_heights::ToldHeights;

/// Heights of surfaces in a known place: from the deepest mine to above all masts. Others are marks of missing heights, such as -9999.
const SURFACES_M: std::ops::RangeInclusive<f64> = -5000.0..=20_000.0;
/// Triangles that are collected before they are added to the city.
const FLUSH_TRIANGLES: usize = 1 << 14;
/// An object with more triangles is left out: instances of a large template can make any number of them.
const MAX_OBJECT_TRIANGLES: u64 = 32 << 20;

/// Reason for leaving out objects of a source of streets.
const NOT_PAINTED: &str = "no street, water or green to paint, or no ground to paint it on";

impl ReadContext<'_> {
    /// Whether the city takes more memory than the options allow.
    fn holds_too_much(&self) -> bool {
        self.builder.held_bytes() + self.textures.textures.held_bytes() > self.options.max_held_bytes
    }
}

/// The sink of one source.
pub(crate) struct SceneSink<'r, 'o, 's> {
    context: &'r mut ReadContext<'o>,
    source: &'s CitySource<'s>,
    report: SourceReport,
    materials: MaterialTable,
    placement: Placement,
    /// What [`ReadContext::wanted_area`] gives once the source is placed; `None` before.
    wanted: Option<Option<[[f64; 2]; 2]>>,
    /// Whether the system is guessed if the source names none before its first shape.
    is_place_sought: bool,
    /// Of a mesh without a place.
    unplaced_mesh: Option<UnplacedMesh>,
    /// Of a mesh whose format tells neither its unit nor which axis points up, or whose writers often err in it.
    mesh_shape: Option<MeshShape>,
    /// Of buildings, where the user gives no unit.
    told_heights: ToldHeights,
    facings: FacingCounts,
    /// Objects that have ended, whose parts have, too. See [`hash_of_id`].
    ended: HashSet<u64>,
    /// Before `placement`, for meshes without a coordinate system.
    frame: LocalFrame,
    faces: Vec<WorldTriangle>,
    tick: ByteProgress<'r>,
}

impl<'r, 'o, 's> SceneSink<'r, 'o, 's> {
    /// Fails if the file that places a mesh is invalid.
    pub(crate) fn new(
        context: &'r mut ReadContext<'o>,
        source: &'s CitySource<'s>,
        format: SourceFormat,
        tick: ByteProgress<'r>,
    ) -> Result<Self, InputError> {
        let report = SourceReport::new(&source.label, format, source.bytes);
        let is_plain = matches!(format, SourceFormat::Ply | SourceFormat::Stl | SourceFormat::Off | SourceFormat::Obj);
        let is_mesh = matches!(format, SourceFormat::Gltf | SourceFormat::Tiles3d) || is_plain;
        let (placement, frame) = match is_mesh {
            true => context.place_of_mesh(source)?,
            false => (Placement::Unknown, LocalFrame::IDENTITY),
        };
        let is_turned = is_plain && context.is_y_up();
        let frame = if is_turned { frame.with_y_up() } else { frame };
        let (materials, faces) = (MaterialTable::default(), Vec::new());
        let is_place_sought = !is_mesh;
        let is_unplaced = is_mesh && matches!(placement, Placement::Unknown);
        let unplaced_mesh = is_unplaced.then(UnplacedMesh::default);
        let mesh_shape = match format {
            SourceFormat::Gltf => Some(MeshShape::of_gltf()),
            _ => is_plain.then(MeshShape::default),
        };
        let told_heights = ToldHeights::default();
        Ok(Self {
            context,
            source,
            report,
            materials,
            placement,
            wanted: None,
            is_place_sought,
            unplaced_mesh,
            mesh_shape,
            told_heights,
            facings: FacingCounts::default(),
            ended: HashSet::new(),
            frame,
            faces,
            tick,
        })
    }

    /// The source as readers take it.
    pub(crate) fn input(&self) -> Input<'s>
    where
        'o: 's,
    {
        let options = self.context.options;
        let PlacingOptions { bbox_deg, bbox_m, .. } = options.placing;
        let bbox_deg = bbox_deg.or_else(|| self.context.world.degrees_around(bbox_m?));
        let height_field = options.height_field.as_deref();
        let max_line_bytes = options.max_line_bytes;
        Input { bbox_deg, height_field, max_line_bytes, ..self.source.input(options.max_source_bytes) }
    }

    /// Sets where the positions are that follow.
    pub(crate) fn set_placement(&mut self, placement: Placement) {
        (self.placement, self.frame, self.unplaced_mesh) = (placement, LocalFrame::IDENTITY, None);
        self.is_place_sought = false;
    }

    /// Adds an object as a landmark, whose triangles stay dense. Its number is set here. Fails if the whole bake must end.
    pub(crate) fn add_landmark(&mut self, object: SourceObject, landmark: PendingLandmark) -> Result<(), InputError> {
        let number = self.context.builder.len();
        self.add(object)?;
        if self.context.builder.len() > number {
            self.context.builder.add_landmark(PendingLandmark { object: number as u32, ..landmark });
        }
        Ok(())
    }

    /// Sets the format, of readers that tell it by the content.
    pub(crate) fn set_format(&mut self, format: SourceFormat) {
        self.report.format = format;
    }

    pub(crate) fn into_report(mut self) -> SourceReport {
        self.report_unplaced_mesh();
        if let Some(shape) = &self.mesh_shape {
            shape.note_in(self.context.is_y_up(), &mut self.report);
        }
        self.told_heights.note_in(&mut self.report);
        let assumed = self.placement.finding().filter(|(kind, _)| *kind == EITHER_ORDER);
        if let Some(text) = assumed.and_then(|(_, text)| self.facings.mirror_text(text)) {
            self.report.problem(MIRRORED, || text);
        }
        self.placement.note_in(&mut self.report);
        self.report
    }

    /// World position of a position of the source; `None` if it is invalid, or cannot be there in the source's system.
    fn place(&self, position: [f64; 3]) -> Option<[f64; 3]> {
        self.placement.position(self.frame.apply(position)).filter(|position| is_valid_position(*position))
    }

    /// World position of a corner of a surface, whose height is not a mark of a missing one if heights are those of a place.
    fn place_in_space(&self, position: [f64; 3]) -> Option<[f64; 3]> {
        let is_placed = matches!(self.placement, Placement::Known(_));
        self.place(position).filter(|[.., z]| !is_placed || SURFACES_M.contains(z))
    }

    /// World position on the map.
    fn place_on_map(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        self.place([x, y, 0.0]).map(|[x, y, _]| [x, y])
    }

    /// Guesses the system of a source that names none by its first shape.
    fn seek_place(&mut self, first: &FirstShape) -> Result<(), InputError> {
        if !std::mem::replace(&mut self.is_place_sought, false) {
            return Ok(());
        }
        let (reference, text) = self.context.world.guess(first);
        self.report.problem(NO_CRS, || text);
        match reference {
            Some(reference) => self.set_crs(&reference),
            None => Ok(()),
        }
    }

    /// World height of the ground at a position, where the source tells it, and not by a mark of a missing height.
    fn base_m(&mut self, object: &SourceObject, [x, y]: [f64; 2], ground: Option<f64>) -> Option<f64> {
        let z = ground?;
        let base_m = self.place([x, y, z])?[2];
        if !HEIGHTS_M.contains(&base_m) {
            self.report.problem(MISSING_GROUND, || format!("{}: {z}", object.id));
            return None;
        }
        Some(base_m)
    }

    /// What is known of the heights in attributes besides these.
    fn height_hints(&self) -> HeightHints<'o> {
        let options = self.context.options;
        HeightHints {
            field: options.height_field.as_deref(),
            unit: options.height_unit,
            is_map_in_feet: self.placement.is_in_feet(),
            ground_m: None,
        }
    }

    /// Begins the object: its kind is wanted, and it is counted.
    fn begin(&mut self, object: &SourceObject) -> bool {
        self.report.found += 1;
        self.report.count_type(&object.source_type);
        // Of a source of streets, only what can be painted.
        let has_form = matches!(object.shape, Shape::Footprints(_) | Shape::Strips(_));
        let is_of_source = !self.source.is_streets || has_form && painted::is_painted(object.kind);
        let is_wanted = is_of_source && self.context.options.kinds.contains(object.kind);
        if !is_wanted {
            self.report.left_out_by_kind += 1;
            return false;
        }
        self.report.count_attributes(&object.attributes);
        *self.report.objects_by_kind.entry(object.kind).or_default() += 1;
        if let Some(lod) = object.lod.filter(|_| object.shape != Shape::None) {
            *self.report.objects_by_level.entry(lod.to_string()).or_default() += 1;
        }
        true
    }

    /// Adds the collected triangles to the city. Returns whether the object may have more.
    fn flush(&mut self, open: &mut OpenObject, facade_use: FacadeUse) -> bool {
        self.context.push(open, &mut self.faces, facade_use);
        open.triangles <= MAX_OBJECT_TRIANGLES
    }

    /// Keeps what the source says of an object besides its shape.
    fn relation(&mut self, object: &SourceObject) -> ObjectRelation {
        let SourceObject { id, parent, kind, attributes, .. } = object;
        let record = self.context.record_of(id, *kind, attributes);
        let (parent, record) = (parent.as_deref().map(hash_of_id), Some(record));
        ObjectRelation { parent, record, ..ObjectRelation::default() }
    }

    fn close(&mut self, object: &SourceObject, open: OpenObject) {
        let SourceObject { id, lod, attributes, .. } = object;
        let relation = self.relation(object);
        self.note_mesh_extent(&open);
        let builder = &mut self.context.builder;
        if open.triangles > MAX_OBJECT_TRIANGLES {
            let detail = format!("{id}: more than the limit of {MAX_OBJECT_TRIANGLES}");
            self.report.skip("too many triangles in one object", || detail);
            builder.abandon(self.context.source, id, open);
            return;
        }
        // Overture's outline of a building whose parts are features of their own.
        let yields_to_parts = attributes.named("has_parts").is_some_and(is_yes);
        let relation = ObjectRelation { lod: *lod, yields_to_parts, ..relation };
        builder.close_related(self.context.source, id, open, relation, &mut self.report);
    }

    /// Whether an object, or what it is a part of, is not there or no longer valid.
    fn has_ended(&mut self, object: &SourceObject, whole: Option<WholeBuilding<'_>>) -> bool {
        let parent = object.parent.as_deref().filter(|_| !self.ended.is_empty());
        let is_part = parent.is_some_and(|parent| self.ended.contains(&hash_of_id(parent)));
        if !is_part && !has_ended(&object.attributes) && !whole.is_some_and(|whole| has_ended(whole.attributes)) {
            return false;
        }
        self.ended.insert(hash_of_id(&object.id));
        true
    }

    /// Adds an object, of a whole building if that is known.
    fn take(&mut self, mut object: SourceObject, whole: Option<WholeBuilding<'_>>) -> Result<(), InputError> {
        subject::set(format_args!("{}: object {}", self.report.path, object.id));
        if self.context.holds_too_much() {
            let limit = human_bytes(self.context.options.max_held_bytes);
            let what = format!("its triangles and pictures take more than {limit} of memory; give a part of it");
            return Err(InputError::unsupported(&self.source.label, what));
        }
        if !self.begin(&object) {
            return Ok(());
        }
        if self.has_ended(&object, whole) {
            self.report.skip(ENDED, || object.id);
            return Ok(());
        }
        if is_hazard(object.kind, &object.attributes) {
            self.report.skip(HAZARD, || object.id);
            return Ok(());
        }
        if let Some(shape) = &mut self.mesh_shape {
            shape.add(&object, |position| self.frame.apply(position));
        }
        self.seek_mesh_place(&object.shape)?;
        if (self.is_place_sought || self.context.ends_at_place || !self.placement.is_settled())
            && let Some(first) = first_shape(&object.shape)
        {
            self.seek_place(&first)?;
            self.context.settle(&mut self.placement, &self.source.label, first)?;
        }
        if let Some(areas) = areas_without_heights(&object) {
            object.shape = Shape::Footprints(areas);
            if matches!(self.placement, Placement::Known(_)) {
                self.report.problem(ZERO_HEIGHTS, || object.id.clone());
            }
        }
        match &object.shape {
            Shape::None => {
                *match object.lod {
                    Some(_) => &mut self.report.coarser_left_out,
                    None => &mut self.report.without_geometry,
                } += 1;
                let relation = self.relation(&object);
                self.context.builder.add_parent(self.context.source, &object.id, relation);
            }
            Shape::Surfaces { polygons, meshes } => match self.plans_of(&object) {
                Some(plans) => match is_hidden(object.kind, &object.attributes) {
                    Some(reason) => self.report.skip(reason, || object.id),
                    None => self.add_buildings(&object, &plans)?,
                },
                None => self.add_surfaces(&object, polygons, meshes, whole),
            },
            shape if self.paint(&object, shape)? => {}
            _ if self.source.is_streets => self.report.skip(NOT_PAINTED, || object.id),
            Shape::Footprints(footprints) => {
                if is_extruded(&object, self.height_hints()) {
                    self.add_buildings(&object, footprints)?;
                } else {
                    self.add_areas(&object, footprints)?;
                }
            }
            Shape::Strips(strips) => self.add_strips(&object, strips)?,
            Shape::Points(points) => self.add_points(&object, points)?,
        }
        Ok(())
    }
}

impl ObjectSink for SceneSink<'_, '_, '_> {
    fn set_crs(&mut self, crs: &CrsReference) -> Result<(), InputError> {
        if self.placement.is_of(crs) {
            return Ok(());
        }
        if !matches!(self.placement, Placement::Unknown) {
            self.placement.note_in(&mut self.report);
        }
        self.is_place_sought = is_undefined(&crs.name);
        self.placement = match self.is_place_sought {
            true => Placement::Unknown,
            false => self.context.world.place(&self.source.label, crs)?,
        };
        (self.frame, self.unplaced_mesh) = (LocalFrame::IDENTITY, None);
        Ok(())
    }

    fn add_material(&mut self, material: SourceMaterial) -> u32 {
        self.materials.add(material, self.context, self.source, &mut self.report)
    }

    fn add(&mut self, object: SourceObject) -> Result<(), InputError> {
        self.take(object, None)
    }

    fn add_part(&mut self, object: SourceObject, whole: WholeBuilding<'_>) -> Result<(), InputError> {
        self.take(object, Some(whole))
    }

    fn skip(&mut self, reason: &'static str, detail: String) {
        self.report.found += 1;
        self.report.skip(reason, || detail);
    }

    fn merge(&mut self, reason: &'static str, detail: String) {
        self.report.found += 1;
        self.report.merge(reason, || detail);
    }

    fn problem(&mut self, kind: &'static str, detail: String) {
        self.report.problem(kind, || detail);
    }

    fn describe(&mut self, what: Description, text: &str) {
        texts::add(&mut self.report, what, text);
    }

    fn tick(&mut self, bytes_done: u64) {
        (self.tick)(bytes_done);
    }
}

/// Whether areas become volumes. The area of a bridge without a height is its deck, not a block of guessed height, and that of anything
/// unknown is no block.
fn is_extruded(object: &SourceObject, hints: HeightHints<'_>) -> bool {
    match object.kind {
        FeatureKind::Building | FeatureKind::BuildingPart => true,
        FeatureKind::Bridge | FeatureKind::Tunnel | FeatureKind::Generic => has_height(&object.attributes, hints),
        _ => false,
    }
}

/// Where the geometry begins, in the source's coordinates.
fn first_shape(shape: &Shape) -> Option<FirstShape> {
    let on_map = |point: &[f64; 3]| [point[0], point[1]];
    match shape {
        Shape::None => None,
        Shape::Surfaces { polygons, meshes } => {
            let of_polygons = polygons.iter().flat_map(|surface| &surface.points);
            FirstShape::of(of_polygons.chain(meshes.iter().flat_map(|mesh| &mesh.positions)).map(on_map))
        }
        Shape::Footprints(footprints) => {
            FirstShape::of(footprints.iter().flat_map(|plan| &plan.rings).flatten().copied())
        }
        Shape::Strips(strips) => FirstShape::of(strips.iter().flat_map(|strip| &strip.points).copied()),
        Shape::Points(points) => FirstShape::of(points.iter().take(1).map(|point| point.place)),
    }
}
