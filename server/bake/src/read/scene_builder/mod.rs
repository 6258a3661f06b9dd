//! Builds a city from objects: shares equal materials, chooses the origin and leaves out strays.

mod bases;
mod landmarks;
mod parts;
mod pending;
mod strays;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use glam::Vec3;
use insula_objects::FeatureKind;

use super::duplicates::{DuplicateOption, PAIRS_PER_PASS, PairMasks, SimilarPair, similar_pairs};
use super::report::{FAR, SourceReport};
pub(crate) use super::world_triangle::WorldTriangle;
use crate::error::BakeError;
use crate::scene::object_names::ObjectNames;
use crate::scene::object_records::{ObjectRecords, RecordPlace, SourceRecord};
use crate::scene::scratch_scene::{
    ObjectIdentity, ObjectPlacement, SceneExtent, ScratchScene, StoredMaterial, StoredObject,
};
use crate::scene::texture_store::TextureStore;
use crate::scene::triangle_store::TriangleStore;
use crate::scene::{Landmark, ObjectKind, SceneTriangle};
pub(crate) use bases::AnchoredBuilding;
pub(crate) use landmarks::PendingLandmark;
pub(crate) use parts::{BuilderParts, PartObjects};
use pending::PendingObject;
pub(crate) use pending::{ObjectRelation, OpenObject};
use strays::{PlaceHistogram, stray_distance_m};

/// No projected system has positions on Earth with larger coordinates.
pub(crate) const MAX_COORDINATE_M: f64 = 1e9;
/// An object that is longer is left out.
const MAX_OBJECT_M: f64 = 400_000.0;

/// An object that is smaller in all directions, in cells, may fall between the lines that sample it.
const MIN_CELLS: f32 = 0.25;

pub(crate) use crate::scene::scratch_scene::hash_of_id;

/// Collects the objects of a city.
pub(crate) struct SceneBuilder {
    pending: Vec<PendingObject>,
    triangles: TriangleStore,
    /// Objects without a shape of which others may be parts.
    parents: Vec<ObjectIdentity>,
    records: ObjectRecords,
    landmarks: Vec<PendingLandmark>,
    materials: Vec<StoredMaterial>,
    material_numbers: HashMap<StoredMaterial, u32>,
    cell_m: f64,
}

/// Whether a position is finite and within [`MAX_COORDINATE_M`].
pub(crate) fn is_valid_position(p: [f64; 3]) -> bool {
    p.iter().all(|c| c.abs() <= MAX_COORDINATE_M)
}

impl SceneBuilder {
    /// `cell_m` is the side of a leaf's column, by which an object is judged as too large.
    pub(crate) fn new(triangles: TriangleStore, cell_m: f64) -> Self {
        let records = ObjectRecords::for_triangles(&triangles);
        let (pending, parents, landmarks, materials) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let material_numbers = HashMap::new();
        Self { pending, triangles, parents, records, landmarks, materials, material_numbers, cell_m }
    }

    /// Number of a material. Equal ones have the same.
    pub(crate) fn material(&mut self, material: StoredMaterial) -> u32 {
        let next = self.materials.len() as u32;
        let index = *self.material_numbers.entry(material).or_insert(next);
        if index == next {
            self.materials.push(material);
        }
        index
    }

    /// Colour of a material.
    pub(crate) fn colour(&self, material: u32) -> [u8; 3] {
        self.materials[material as usize].rgb
    }

    /// Adds a whole object.
    #[cfg(test)]
    fn add(&mut self, source: usize, id: &str, kind: ObjectKind, faces: &[WorldTriangle], report: &mut SourceReport) {
        let mut open = OpenObject::new(kind);
        self.push(&mut open, faces);
        self.close(source, id, open, report);
    }

    /// Adds triangles to an object that is closed later. Every corner must be valid (see
    /// [`is_valid_position`]). Only one object may be open.
    pub(crate) fn push(&mut self, open: &mut OpenObject, faces: &[WorldTriangle]) {
        let Some(first) = faces.first() else { return };
        let anchor = *open.anchor.get_or_insert(first.corners[0]);
        let object = self.pending.len() as u32;
        for face in faces {
            let face = if open.kind == ObjectKind::Terrain { face.facing_up() } else { *face };
            let corners = face.corners.map(|corner| std::array::from_fn(|axis| (corner[axis] - anchor[axis]) as f32));
            for corner in &corners {
                for axis in 0..3 {
                    open.min[axis] = open.min[axis].min(corner[axis]);
                    open.max[axis] = open.max[axis].max(corner[axis]);
                }
            }
            let [a, b, c] = corners.map(Vec3::from_array);
            open.surface_m2 += f64::from((b - a).cross(c - a).length()) * 0.5;
            self.triangles.push(SceneTriangle { corners, uv: face.uv, material: face.material, object });
        }
        open.triangles += faces.len() as u64;
    }

    /// Ends an object and counts it in the report. One without triangles is not added, one that is too large for the
    /// cell size is left out.
    pub(crate) fn close(&mut self, source: usize, id: &str, open: OpenObject, report: &mut SourceReport) {
        let kind = if open.kind == ObjectKind::Terrain { FeatureKind::Relief } else { FeatureKind::Generic };
        let record = SourceRecord { identifier: id.to_owned(), kind, attributes: Vec::new() };
        let relation = ObjectRelation { record: Some(self.add_record(record)), ..ObjectRelation::default() };
        self.close_related(source, id, open, relation, report);
    }

    /// Keeps what a source says of an object, for its [`ObjectRelation`].
    pub(crate) fn add_record(&mut self, record: SourceRecord) -> RecordPlace {
        self.records.push(record)
    }

    /// Adds an object without a shape, of which others may be parts.
    pub(crate) fn add_parent(&mut self, source: usize, id: &str, relation: ObjectRelation) {
        let Some(record) = relation.record else { return };
        let parent_hash = relation.parent;
        self.parents.push(ObjectIdentity { record, source: source as u32, id_hash: hash_of_id(id), parent_hash });
    }

    /// As [`Self::close`], with what the source tells of the object's parent and level of detail.
    pub(crate) fn close_related(
        &mut self,
        source: usize,
        id: &str,
        open: OpenObject,
        relation: ObjectRelation,
        report: &mut SourceReport,
    ) {
        let Some(mut object) = open.into_pending(source, id) else { return };
        object.relation = relation;
        if let Some((reason, detail)) = object.size_fault(self.cell_m) {
            report.skip(reason, || format!("{id}: {detail}"));
            object.is_dropped = true;
        } else {
            if (0..3).all(|axis| object.extent_m(axis) < f64::from(MIN_CELLS) * self.cell_m) {
                report.problem("smaller than a quarter of a cell", || id.to_owned());
            }
            report.objects += 1;
            report.triangles += object.triangles;
            if object.kind == ObjectKind::Terrain {
                report.terrain_triangles += object.triangles;
            }
        }
        self.pending.push(object);
    }

    /// Ends an object that is left out although some of its triangles were added.
    pub(crate) fn abandon(&mut self, source: usize, id: &str, open: OpenObject) {
        let dropped = open.into_pending(source, id).map(|object| PendingObject { is_dropped: true, ..object });
        self.pending.extend(dropped);
    }

    /// Number of objects so far, for [`Self::abandon_since`].
    pub(crate) fn len(&self) -> usize {
        self.pending.len()
    }

    /// Leaves out all objects since there were `len`, and what was added of one that is not closed.
    pub(crate) fn abandon_since(&mut self, len: usize) {
        self.pending[len..].iter_mut().for_each(|object| object.is_dropped = true);
        // Triangles of an object that was never closed have this number.
        self.pending.push(PendingObject {
            id: Box::default(),
            id_hash: 0,
            kind: ObjectKind::Building,
            source: 0,
            is_dropped: true,
            relation: ObjectRelation::default(),
            surface_m2: 0.0,
            anchor: [0.0; 3],
            min: [0.0; 3],
            max: [0.0; 3],
            triangles: 0,
            has_own_base: false,
        });
    }

    /// Leaves out objects of which the city has another one already, and those that only outline their parts. Corrects the
    /// reports. Fails if the triangles cannot be read.
    pub(crate) fn drop_duplicates(
        &mut self,
        option: DuplicateOption,
        sources: &mut [SourceReport],
    ) -> Result<(), BakeError> {
        self.drop_outlines_of_parts(sources);
        if option == DuplicateOption::KeepAll {
            return Ok(());
        }
        let pending = &self.pending;
        let kept = (0..pending.len()).filter(|object| !pending[*object].is_dropped).map(|object| object as u32);
        let candidate = |object: u32| pending[object as usize].candidate(object as usize);
        let pairs = similar_pairs(kept.collect(), candidate, option);
        let mut same: Vec<SimilarPair> = pairs.iter().filter(|pair| pair.has_same_id).copied().collect();
        let by_shape: Vec<SimilarPair> = pairs.into_iter().filter(|pair| !pair.has_same_id).collect();
        for some in by_shape.chunks(PAIRS_PER_PASS) {
            same.extend(self.with_equal_footprints(some)?);
        }
        same.sort_by_key(|pair| (pair.first, pair.second));
        for SimilarPair { first, second, has_same_id, .. } in same {
            let lod = |i: usize| self.pending[i].relation.lod.unwrap_or(0.0);
            let is_better = option == DuplicateOption::KeepBestLevel && lod(second) > lod(first);
            let (kept, left_out) = if is_better { (second, first) } else { (first, second) };
            // Also if the other one is a duplicate itself: then both are the one that it equals. The best of all is
            // never left out.
            if !self.pending[left_out].is_dropped {
                self.drop_duplicate(left_out, kept, has_same_id, sources);
            }
        }
        Ok(())
    }

    fn drop_duplicate(&mut self, left_out: usize, kept: usize, has_same_id: bool, sources: &mut [SourceReport]) {
        let (object, other) = (&self.pending[left_out], &self.pending[kept]);
        let why = if has_same_id { "same identifier" } else { "same footprint and height" };
        let detail = format!("{}: {why} as {} of {}", object.id, other.id, sources[other.source].path);
        let report = &mut sources[object.source];
        subtract_from_report(object, report);
        report.duplicates.add(|| detail);
        self.pending[left_out].is_dropped = true;
    }

    /// Leaves out the objects that others name as their parent, where the source says that the parts show them.
    fn drop_outlines_of_parts(&mut self, sources: &mut [SourceReport]) {
        if !self.pending.iter().any(|object| object.relation.yields_to_parts) {
            return;
        }
        let kept = self.pending.iter().filter(|object| !object.is_dropped);
        let parents: std::collections::HashSet<u64> = kept.filter_map(|object| object.relation.parent).collect();
        for object in &mut self.pending {
            if !object.is_dropped && object.relation.yields_to_parts && parents.contains(&object.id_hash) {
                object.is_dropped = true;
                let report = &mut sources[object.source];
                subtract_from_report(object, report);
                report.coarser_left_out += 1;
            }
        }
    }

    /// Those of the pairs whose footprints are the same.
    fn with_equal_footprints(&mut self, pairs: &[SimilarPair]) -> Result<Vec<SimilarPair>, BakeError> {
        let mut masks: Vec<PairMasks> = pairs.iter().map(|pair| PairMasks::new(*pair)).collect();
        let mut pairs_of: HashMap<usize, Vec<usize>> = HashMap::new();
        for (i, pair) in pairs.iter().enumerate() {
            pairs_of.entry(pair.first).or_default().push(i);
            pairs_of.entry(pair.second).or_default().push(i);
        }
        self.triangles.finish()?;
        let pending = &self.pending;
        self.triangles.try_for_each(|triangle| {
            let object = triangle.object as usize;
            if let Some(of_object) = pairs_of.get(&object) {
                let anchor = pending[object].anchor;
                let on_map = |corner: [f32; 3]| [0, 1].map(|axis: usize| anchor[axis] + f64::from(corner[axis]));
                of_object.iter().for_each(|pair| masks[*pair].add(object, triangle.corners.map(on_map)));
            }
            Ok(())
        })?;
        Ok(pairs.iter().zip(&masks).filter(|(_, masks)| masks.are_equal()).map(|(pair, _)| *pair).collect())
    }

    /// Lowest and highest corner on the map of the objects that are kept; `None` without any.
    pub(crate) fn bounds_on_map(&self) -> Option<[[f64; 2]; 2]> {
        let too_far = self.find_too_far();
        let is_kept = |(object, far): &(&PendingObject, Option<f64>)| !object.is_dropped && far.is_none();
        let kept = self.pending.iter().zip(too_far).filter(is_kept).map(|(object, _)| object);
        kept.fold(None, |bounds, object| {
            let [low, high] = bounds.unwrap_or([[f64::MAX; 2], [f64::MIN; 2]]);
            Some([
                [0, 1].map(|axis| low[axis].min(object.low(axis))),
                [0, 1].map(|axis| high[axis].max(object.high(axis))),
            ])
        })
    }

    /// Leaves out the objects whose boxes lie outside of an area on the map, and counts them.
    pub(crate) fn drop_outside(&mut self, low: [f64; 2], high: [f64; 2], sources: &mut [SourceReport]) {
        for object in self.pending.iter_mut().filter(|object| !object.is_dropped) {
            if (0..2).any(|axis| object.high(axis) < low[axis] || object.low(axis) > high[axis]) {
                object.is_dropped = true;
                let report = &mut sources[object.source];
                subtract_from_report(object, report);
                report.outside_bbox += 1;
            }
        }
    }

    /// The city. Its origin is the centre of the bounds in x and y and their bottom in z, in whole metres, so that
    /// corners of a city of 16 km are exact to half a millimetre. Removes objects that are left out from the reports in
    /// `sources`.
    pub(crate) fn finish(self, textures: TextureStore, sources: &mut [SourceReport]) -> ScratchScene {
        let too_far = self.find_too_far();
        let is_kept = |(object, far): &(&PendingObject, &Option<f64>)| far.is_none() && !object.is_dropped;
        let kept = || self.pending.iter().zip(&too_far).filter(is_kept).map(|(object, _)| object);
        let low: [f64; 3] = std::array::from_fn(|axis| kept().map(|object| object.low(axis)).fold(f64::MAX, f64::min));
        let high: [f64; 3] =
            std::array::from_fn(|axis| kept().map(|object| object.high(axis)).fold(f64::MIN, f64::max));
        let mut city = ScratchScene {
            origin: [0.0; 3],
            crs: None,
            bounds: None,
            objects: Vec::with_capacity(self.pending.len()),
            numbers: Vec::new(),
            landmarks: Vec::new(),
            standing: Vec::new(),
            parents: self.parents,
            records: self.records,
            materials: self.materials,
            textures,
            triangles: 0,
            extent: SceneExtent::default(),
            names: ObjectNames::for_triangles(&self.triangles),
            placements: Vec::with_capacity(self.pending.len()),
            stored: self.triangles,
        };
        if low[0] > high[0] {
            return city;
        }
        city.origin = [((low[0] + high[0]) / 2.0).floor(), ((low[1] + high[1]) / 2.0).floor(), low[2].floor()];
        let (mut min, mut max) = ([f64::MAX; 3], [f64::MIN; 3]);
        for (object, far) in self.pending.into_iter().zip(too_far) {
            let offset_m: [f64; 3] = std::array::from_fn(|axis| object.anchor[axis] - city.origin[axis]);
            if far.is_some() || object.is_dropped {
                if let Some(distance_m) = far.filter(|_| !object.is_dropped) {
                    remove_from_report(&object, distance_m, &mut sources[object.source]);
                }
                city.placements.push(ObjectPlacement { offset_m, object: None });
                // An outline that its parts show is still their parent.
                city.parents.extend(object.identity().filter(|_| object.relation.yields_to_parts));
                continue;
            }
            // Rounded in the same way as the corners, so that the bounds are exact.
            let placed = |v: f32, axis: usize| (f64::from(v) + offset_m[axis]) as f32;
            for axis in 0..3 {
                min[axis] = min[axis].min(placed(object.min[axis], axis).into());
                max[axis] = max[axis].max(placed(object.max[axis], axis).into());
            }
            city.placements.push(ObjectPlacement { offset_m, object: Some(city.objects.len() as u32) });
            let bounds_m =
                [object.min, object.max].map(|corner| std::array::from_fn(|axis| placed(corner[axis], axis)));
            let (kind, identity) = (object.kind, object.identity());
            city.objects.push(StoredObject { kind, base_z_m: bounds_m[0][2], bounds_m, identity });
            city.triangles += object.triangles;
            city.extent.add(object.surface_m2, [0, 1].map(|axis| object.extent_m(axis)));
            city.names.push(object.id.into());
        }
        city.bounds = Some([min, max]);
        let landmark = |pending: PendingLandmark| {
            let ObjectPlacement { offset_m, object } = *city.placements.get(pending.object as usize)?;
            Some(Landmark { object: object?, stone: pending.stone, anchor_m: offset_m.map(|v| v as f32) })
        };
        let standing = self.landmarks.iter().filter(|pending| pending.is_on_ground);
        city.standing = standing.filter_map(|pending| city.placements.get(pending.object as usize)?.object).collect();
        city.landmarks = self.landmarks.into_iter().filter_map(landmark).collect();
        city
    }

    /// For each object its distance from the median object in metres, if it is a stray ([`strays`]).
    fn find_too_far(&self) -> Vec<Option<f64>> {
        let mut places = PlaceHistogram::default();
        for object in self.pending.iter().filter(|object| !object.is_dropped) {
            places.add(object.anchor);
        }
        let middle = places.median_m();
        self.pending.iter().map(|object| stray_distance_m(middle, object.place())).collect()
    }
}

fn subtract_from_report(object: &PendingObject, report: &mut SourceReport) {
    report.objects -= 1;
    report.triangles -= object.triangles;
    if object.kind == ObjectKind::Terrain {
        report.terrain_triangles -= object.triangles;
    }
}

fn remove_from_report(object: &PendingObject, distance_m: f64, report: &mut SourceReport) {
    subtract_from_report(object, report);
    report.skip(FAR, || format!("{}: {:.0} km away", object.id, distance_m / 1000.0));
}
