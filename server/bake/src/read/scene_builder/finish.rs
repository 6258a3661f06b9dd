//! Makes the city of all objects.

use super::pending::PendingObject;
use super::strays::{Outskirts, PlaceHistogram, is_at_origin, stray_distance_m};
use super::{PendingLandmark, SceneBuilder, remove_from_report, subtract_from_report};
use crate::error::BakeError;
use crate::scene::Landmark;
use crate::scene::scratch_scene::{ObjectPlacement, ScratchScene, StoredObject};
use crate::scene::texture_store::TextureStore;
use insula_scratch::record_list::{RecordList, RecordScratch};
use insula_source::problems::WIDE;
use insula_source::report::SourceReport;

/// Where all objects are that are kept.
struct CityPlaces {
    /// Where most objects are ([`super::strays`]).
    middle_m: [f64; 3],
    /// Lowest and highest corner in world coordinates; the low one is higher without objects.
    bounds: [[f64; 3]; 2],
    /// Number of these objects.
    kept: u64,
    /// Few objects by which the city is much wider than without them.
    outskirts: Option<Outskirts>,
}

impl SceneBuilder {
    /// Lowest and highest corner on the map of the objects that are kept; `None` without any. Fails if the objects cannot be read.
    pub(crate) fn bounds_on_map(&self) -> Result<Option<[[f64; 2]; 2]>, BakeError> {
        let [low, high] = self.places()?.bounds;
        Ok((low[0] <= high[0]).then(|| [low, high].map(|[x, y, _]| [x, y])))
    }

    /// Leaves out the objects whose boxes lie outside of an area on the map, and counts them. Fails if the objects cannot be read.
    pub(crate) fn drop_outside(
        &mut self,
        low: [f64; 2],
        high: [f64; 2],
        sources: &mut [SourceReport],
    ) -> Result<(), BakeError> {
        self.pending.replace_each(|_, object| {
            let is_outside = (0..2).any(|axis| object.high(axis) < low[axis] || object.low(axis) > high[axis]);
            if object.is_dropped || !is_outside {
                return Ok(None);
            }
            let report = &mut sources[object.source];
            subtract_from_report(object, report);
            report.outside_bbox += 1;
            Ok(Some(PendingObject { is_dropped: true, ..object.clone() }))
        })
    }

    /// The city, whose origin follows from its bounds.
    #[cfg(test)]
    pub(crate) fn finish(
        self,
        textures: TextureStore,
        sources: &mut [SourceReport],
    ) -> Result<ScratchScene, BakeError> {
        self.finish_at(None, textures, sources)
    }

    /// The city. Without another `origin` it is the centre of the bounds in x and y and their bottom in z, in whole metres, so that
    /// corners of a city of 16 km are exact to half a millimetre. Removes objects that are left out from the reports in
    /// `sources`. Fails if the objects cannot be read.
    pub(crate) fn finish_at(
        self,
        origin: Option<[f64; 3]>,
        textures: TextureStore,
        sources: &mut [SourceReport],
    ) -> Result<ScratchScene, BakeError> {
        let CityPlaces { middle_m, bounds: [low, high], outskirts, .. } = self.places()?;
        let scratch = self.pending.scratch();
        let mut city = ScratchScene {
            origin: [0.0; 3],
            crs: None,
            bounds: None,
            objects: RecordList::new(&scratch),
            object_facts: RecordList::default(),
            landmarks: Vec::new(),
            standing: Vec::new(),
            parents: self.parents,
            records: self.records,
            materials: self.materials,
            textures,
            triangles: 0,
            names: RecordList::new(&scratch),
            placements: RecordList::new(&scratch),
            stored: self.triangles,
        };
        if low[0] > high[0] {
            return Ok(city);
        }
        let middle = |axis: usize| ((low[axis] + high[axis]) / 2.0).floor();
        city.origin = origin.unwrap_or_else(|| [middle(0), middle(1), low[2].floor()]);
        let (mut min, mut max) = ([f64::MAX; 3], [f64::MIN; 3]);
        self.pending.try_for_each(|_, object| {
            let offset_m: [f64; 3] = std::array::from_fn(|axis| object.anchor[axis] - city.origin[axis]);
            let far = stray_distance_m(middle_m, object.place());
            if far.is_some() || object.is_dropped {
                if let Some(distance_m) = far.filter(|_| !object.is_dropped) {
                    remove_from_report(object, distance_m, &mut sources[object.source]);
                }
                city.placements.push(ObjectPlacement { offset_m, object: None });
                // An outline that its parts show is still their parent.
                if let Some(identity) = object.identity().filter(|_| object.relation.yields_to_parts) {
                    city.parents.push(identity);
                }
                return Ok::<_, BakeError>(());
            }
            if let Some(distance_m) = outskirts.and_then(|outskirts| outskirts.distance_m(object.anchor)) {
                let detail = || format!("{}: {:.0} km from the others", object.id, distance_m / 1000.0);
                sources[object.source].problem(WIDE, detail);
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
            let ground_m = object.ground_m.map_or(f32::INFINITY, |ground_m| (ground_m - city.origin[2]) as f32);
            let base_z_m = bounds_m[0][2].min(ground_m);
            city.objects.push(StoredObject { kind, base_z_m, bounds_m, identity });
            city.triangles += object.triangles;
            city.names.push(object.id.clone().into());
            Ok(())
        })?;
        city.bounds = Some([min, max]);
        for PendingLandmark { object, stone, is_on_ground } in self.landmarks {
            let ObjectPlacement { offset_m, object } = city.placements.get(object as usize)?;
            let Some(object) = object else { continue };
            city.landmarks.push(Landmark { object, stone, anchor_m: offset_m.map(|v| v as f32) });
            city.standing.extend(is_on_ground.then_some(object));
        }
        Ok(city)
    }

    /// Where the objects are that are kept.
    fn places(&self) -> Result<CityPlaces, BakeError> {
        let (mut places, mut count, mut first) = (PlaceHistogram::default(), 0, None);
        self.pending.try_for_each(|_, object| {
            if !object.is_dropped {
                places.add(object.anchor);
                count += 1;
                first = first.or(Some(object.anchor).filter(|anchor| !is_at_origin(*anchor)));
            }
            Ok::<_, BakeError>(())
        })?;
        let places = self.places_around(places.median_m())?;
        if places.kept * 2 > count {
            return Ok(places);
        }
        // Of cities on two continents, the medians along the axes may be of different ones, where there is none. Of equal ones, that of
        // the first object counts, which may have chosen the coordinate system.
        let mut best = places;
        for anchor in self.nearest_anchor(best.middle_m)?.into_iter().chain(first) {
            let places = self.places_around(anchor)?;
            best = if places.kept >= best.kept { places } else { best };
        }
        Ok(best)
    }

    /// Where the objects are that are kept if the city is around a place.
    fn places_around(&self, middle_m: [f64; 3]) -> Result<CityPlaces, BakeError> {
        let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
        let (mut histogram, mut kept) = (PlaceHistogram::default(), 0_u64);
        self.pending.try_for_each(|_, object| {
            let place = object.place();
            if !object.is_dropped && stray_distance_m(middle_m, place).is_none() {
                low = std::array::from_fn(|axis| low[axis].min(place.low[axis]));
                high = std::array::from_fn(|axis| high[axis].max(place.high[axis]));
                histogram.add(object.anchor);
                kept += 1;
            }
            Ok::<_, BakeError>(())
        })?;
        Ok(CityPlaces { middle_m, bounds: [low, high], kept, outskirts: Outskirts::of(&histogram) })
    }

    /// The anchor of the first of the objects that are nearest to a place; `None` without objects.
    fn nearest_anchor(&self, place: [f64; 3]) -> Result<Option<[f64; 3]>, BakeError> {
        let mut nearest: Option<(f64, [f64; 3])> = None;
        self.pending.try_for_each(|_, object| {
            let along = |axis: usize| (object.anchor[axis] - place[axis]).abs();
            let distance_m = along(0).max(along(1)).max(along(2));
            if !object.is_dropped && nearest.is_none_or(|(least_m, _)| distance_m < least_m) {
                nearest = Some((distance_m, object.anchor));
            }
            Ok::<_, BakeError>(())
        })?;
        Ok(nearest.map(|(_, anchor)| anchor))
    }

    /// Keeps what is known of the objects in scratch files. There must be none yet.
    pub(crate) fn keep_in(&mut self, scratch: &RecordScratch) {
        (self.pending, self.parents) = (RecordList::new(scratch), RecordList::new(scratch));
    }
}
