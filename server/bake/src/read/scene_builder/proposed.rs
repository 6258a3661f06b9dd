//! Objects that a proposal removes and adds.

use super::pending::PendingObject;
use super::{SceneBuilder, hash_of_id, subtract_from_report};
use crate::error::BakeError;
use crate::read::proposal_options::RemovedObject;
use insula_source::problems::REMOVED;
use insula_source::report::SourceReport;
use std::collections::HashMap;

/// Sides of the boxes of one object in two cities are at most this far apart: a city has them in decimetres.
const SAME_BOX_M: f64 = 0.2;
/// A lower object has no height of its own.
const NO_HEIGHT_M: f64 = 1e-6;

impl SceneBuilder {
    /// Leaves out objects that are known by their identifiers and places. Returns how many, and corrects the reports. Fails if the objects
    /// cannot be read or written.
    pub(crate) fn drop_removed(
        &mut self,
        removed: &[RemovedObject],
        sources: &mut [SourceReport],
    ) -> Result<u64, BakeError> {
        let mut boxes: HashMap<u64, Vec<[[f64; 2]; 2]>> = HashMap::new();
        for object in removed {
            boxes.entry(hash_of_id(&object.identifier)).or_default().push(object.bounds_m);
        }
        let mut count = 0;
        self.pending.replace_each(|_, object| {
            let is_same = |[low, high]: &[[f64; 2]; 2]| {
                let is_near = |a: f64, b: f64| (a - b).abs() <= SAME_BOX_M;
                (0..2).all(|axis| is_near(object.low(axis), low[axis]) && is_near(object.high(axis), high[axis]))
            };
            if object.is_dropped || !boxes.get(&object.id_hash).is_some_and(|known| known.iter().any(is_same)) {
                return Ok::<_, BakeError>(None);
            }
            let report = &mut sources[object.source];
            subtract_from_report(object, report);
            report.skip(REMOVED, || object.id.to_string());
            count += 1;
            Ok(Some(PendingObject { is_dropped: true, ..object.clone() }))
        })?;
        Ok(count)
    }

    /// Lifts the objects since there were `first`, if they have no heights of their own: the lowest of them is at 0. Fails if the objects
    /// cannot be read or written.
    pub(crate) fn lift_from_zero(&mut self, first: usize, by_m: f64) -> Result<(), BakeError> {
        let mut lowest_m = f64::INFINITY;
        for number in first..self.pending.len() {
            let object = self.pending.get(number)?;
            lowest_m = if object.is_dropped { lowest_m } else { lowest_m.min(object.low(2)) };
        }
        if lowest_m.abs() > NO_HEIGHT_M {
            return Ok(());
        }
        for number in first..self.pending.len() {
            self.pending.update(number, |object| {
                object.anchor[2] += by_m;
                object.ground_m = object.ground_m.map(|ground_m| ground_m + by_m);
            })?;
        }
        Ok(())
    }
}
