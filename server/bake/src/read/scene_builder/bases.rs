//! Where buildings touch the ground.

use super::SceneBuilder;
use crate::error::BakeError;
use insula_dress::building_base::BuildingBase;
use std::collections::HashMap;

/// Surfaces that are at most this far above the lowest corner of a building belong to its base.
const BASE_M: f32 = 0.5;
/// A part that begins this far above the lowest one of its building stands on another part.
const UPPER_PART_M: f64 = 0.5;
/// Surfaces of less area on the map are upright.
const MIN_AREA_M2: f32 = 1e-4;
/// A base of more triangles is none: it is not the floor of one building.
const MAX_TRIANGLES: usize = 1 << 14;

/// A building with heights of its own.
pub(crate) struct AnchoredBuilding<'b> {
    pub(crate) id: &'b str,
    /// Number of its source's report.
    pub(crate) source: usize,
    pub(crate) base: BuildingBase,
}

/// Triangles of one object on the map, relative to its anchor.
#[derive(Default)]
struct BaseTriangles {
    low: Vec<[[f32; 2]; 3]>,
    others: Vec<[[f32; 2]; 3]>,
}

impl BaseTriangles {
    /// Adds a triangle of an object whose lowest corner has the height `lowest_m`.
    fn add(&mut self, corners: [[f32; 3]; 3], lowest_m: f32) {
        let [a, b, c] = corners.map(|corner| [corner[0], corner[1]]);
        let area_m2 = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs() / 2.0;
        if area_m2 < MIN_AREA_M2 {
            return;
        }
        let is_low = corners.iter().all(|corner| corner[2] <= lowest_m + BASE_M);
        let list = if is_low { &mut self.low } else { &mut self.others };
        if list.len() <= MAX_TRIANGLES {
            list.push([a, b, c]);
        }
    }

    /// The base, and an empty list for the next object. Buildings without a floor have that of their roof. `None` without
    /// any, or with too many.
    fn take(&mut self) -> Option<Vec<[[f32; 2]; 3]>> {
        let Self { low, others } = std::mem::take(self);
        let base = if low.is_empty() { others } else { low };
        (!base.is_empty() && base.len() <= MAX_TRIANGLES).then_some(base)
    }
}

impl SceneBuilder {
    /// Passes the buildings that have heights of their own to `visit`, without parts that stand on others. Fails if the
    /// stored triangles cannot be read, or with the first error of `visit`.
    pub(crate) fn for_each_base(
        &mut self,
        visit: &mut dyn FnMut(AnchoredBuilding<'_>) -> Result<(), BakeError>,
    ) -> Result<(), BakeError> {
        let mut lowest_m: HashMap<u64, f64> = HashMap::new();
        self.pending.try_for_each(|_, object| {
            if object.has_own_base && !object.is_dropped {
                let lowest = lowest_m.entry(object.group()).or_insert(f64::INFINITY);
                *lowest = lowest.min(object.low(2));
            }
            Ok::<_, BakeError>(())
        })?;
        if lowest_m.is_empty() {
            return Ok(());
        }
        self.triangles.flush()?;
        let (mut current, mut triangles) = (None, BaseTriangles::default());
        let (pending, mut objects) = (&self.pending, self.pending.cursor());
        let mut end = |number: Option<u32>, triangles: &mut BaseTriangles| {
            let Some(number) = number else { return Ok(()) };
            let object = pending.get(number as usize)?;
            let Some(triangles) = triangles.take() else { return Ok(()) };
            let base =
                BuildingBase { height_m: object.low(2), corner: [object.anchor[0], object.anchor[1]], triangles };
            visit(AnchoredBuilding { id: &object.id, source: object.source, base })
        };
        self.triangles.try_for_each(|triangle| {
            if current != Some(triangle.object) {
                end(current, &mut triangles)?;
                current = Some(triangle.object);
            }
            let object = objects.get(triangle.object as usize)?;
            if lowest_m.get(&object.group()).is_some_and(|lowest| object.low(2) <= lowest + UPPER_PART_M)
                && object.has_own_base
                && !object.is_dropped
            {
                triangles.add(triangle.corners, object.min[2]);
            }
            Ok(())
        })?;
        end(current, &mut triangles)
    }
}
