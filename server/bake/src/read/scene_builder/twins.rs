//! Leaves out objects that the city has twice.

use super::pending::PendingObject;
use super::{SceneBuilder, subtract_from_report};
use crate::error::BakeError;
use crate::read::duplicates::{DuplicateCandidate, DuplicateOption, PairMask, PlacedBox, SimilarPair, similar_pairs};
use insula_scratch::record_list::RecordScratch;
use insula_scratch::record_sorter::{RecordSorter, SortedRecords};
use insula_source::report::SourceReport;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

type PairSorter = RecordSorter<SimilarPair>;

/// Parts on the ground whose boxes have less of the area of their outline's are added to it, as a mast on a roof is.
const LEAST_COVER: f64 = 0.25;

/// One of both objects of a pair.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct PairMember {
    object: usize,
    pair: SimilarPair,
}

/// An identifier that an object has or names as its parent's.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct NamedOutline {
    id_hash: u64,
    /// The object; `None` if it is the parent of another one.
    object: Option<u64>,
    /// Of the object, or of the other one.
    bounds: PlacedBox,
}

/// Whether parts may stand for their outline, by their boxes.
fn may_cover(outline: &PlacedBox, parts: &[PlacedBox]) -> bool {
    let area = |bounds: &PlacedBox| (bounds.high[0] - bounds.low[0]) * (bounds.high[1] - bounds.low[1]);
    let middle_m = (outline.low[2] + outline.high[2]) / 2.0;
    let on_ground = parts.iter().filter(|part| part.low[2] < middle_m).map(area).sum::<f64>();
    on_ground >= LEAST_COVER * area(outline)
}

fn by_pair(a: &SimilarPair, b: &SimilarPair) -> Ordering {
    (a.first, a.second).cmp(&(b.first, b.second))
}

impl SceneBuilder {
    /// Leaves out objects of which the city has another one already, and those that only outline their parts. Corrects the
    /// reports. Fails if the triangles or the objects cannot be read.
    pub(crate) fn drop_duplicates(
        &mut self,
        option: DuplicateOption,
        sources: &mut [SourceReport],
    ) -> Result<(), BakeError> {
        self.drop_outlines_of_parts(sources)?;
        if option == DuplicateOption::KeepAll {
            return Ok(());
        }
        let scratch = self.pending.scratch();
        let mut candidates = RecordSorter::new(&scratch, |a: &DuplicateCandidate, b: &DuplicateCandidate| {
            a.bounds.low[0].total_cmp(&b.bounds.low[0])
        });
        self.pending.try_for_each(|number, object| {
            if object.is_dropped { Ok(()) } else { candidates.push(object.candidate(number)) }
        })?;
        let scratch = self.pair_scratch();
        let (mut same, mut by_shape) =
            (PairSorter::new(&scratch, SimilarPair::by_rank), PairSorter::new(&scratch, SimilarPair::by_rank));
        similar_pairs(candidates.finish()?, option, |pair| {
            let pushed = if pair.has_same_id || pair.is_copy { same.push(pair) } else { by_shape.push(pair) };
            pushed.map_err(BakeError::from)
        })?;
        self.with_equal_footprints(by_shape.finish()?, &scratch, &mut |pair| same.push(pair).map_err(BakeError::from))?;
        same.finish()?
            .try_for_each(|SimilarPair { first, second, has_same_id, is_chained, .. }| {
                let (kept, left_out) = (self.pending.get(first)?, self.pending.get(second)?);
                // What leaves out the first one came before. The best of all is never left out.
                if left_out.is_dropped || kept.is_dropped && !is_chained {
                    return Ok(());
                }
                count_duplicate(&left_out, &kept, has_same_id, sources);
                self.pending.update(second, |object| object.is_dropped = true)
            })
            .map_err(BakeError::from)
    }

    /// Where what is known of pairs is kept: there may be as many as objects, and each has two masks of half a kilobyte.
    fn pair_scratch(&self) -> RecordScratch {
        let folder = self.triangles.own_file().and_then(|file| file.path().parent());
        folder.map_or_else(|| self.pending.scratch(), RecordScratch::in_folder)
    }

    /// Leaves out the objects that others name as their parent, where the source says that the parts show them, and these are not
    /// too small for it.
    fn drop_outlines_of_parts(&mut self, sources: &mut [SourceReport]) -> Result<(), BakeError> {
        let mut has_outlines = false;
        self.pending.try_for_each(|_, object| {
            has_outlines |= object.relation.yields_to_parts;
            Ok::<_, BakeError>(())
        })?;
        if !has_outlines {
            return Ok(());
        }
        let scratch = self.pending.scratch();
        // Those that are named come before the objects.
        let mut named = RecordSorter::new(&scratch, |a: &NamedOutline, b: &NamedOutline| {
            (a.id_hash, a.object).cmp(&(b.id_hash, b.object))
        });
        self.pending.try_for_each(|number, object| {
            if object.is_dropped {
                return Ok::<_, BakeError>(());
            }
            if let Some(id_hash) = object.relation.parent {
                named.push(NamedOutline { id_hash, object: None, bounds: object.place() })?;
            }
            if object.relation.yields_to_parts {
                let (id_hash, bounds) = (object.id_hash, object.place());
                named.push(NamedOutline { id_hash, object: Some(number as u64), bounds })?;
            }
            Ok(())
        })?;
        let mut outlines = RecordSorter::new(&scratch, u64::cmp);
        let (mut parent, mut parts) = (None, Vec::new());
        named.finish()?.try_for_each(|NamedOutline { id_hash, object, bounds }| match object {
            None => {
                if parent.replace(id_hash) != Some(id_hash) {
                    parts.clear();
                }
                parts.push(bounds);
                Ok(())
            }
            Some(object) if parent == Some(id_hash) && may_cover(&bounds, &parts) => outlines.push(object),
            Some(_) => Ok(()),
        })?;
        outlines
            .finish()?
            .try_for_each(|number| {
                self.pending.update(number as usize, |object| {
                    object.is_dropped = true;
                    let report = &mut sources[object.source];
                    subtract_from_report(object, report);
                    report.coarser_left_out += 1;
                })
            })
            .map_err(BakeError::from)
    }

    /// Passes those of the pairs whose footprints are the same to `visit`.
    fn with_equal_footprints(
        &mut self,
        pairs: SortedRecords<SimilarPair>,
        scratch: &RecordScratch,
        visit: &mut dyn FnMut(SimilarPair) -> Result<(), BakeError>,
    ) -> Result<(), BakeError> {
        let mut members = RecordSorter::new(scratch, |a: &PairMember, b: &PairMember| a.object.cmp(&b.object));
        pairs.try_for_each(|pair| {
            members.push(PairMember { object: pair.first, pair })?;
            members.push(PairMember { object: pair.second, pair })
        })?;
        let mut members = members.finish()?;
        let mut next = members.read_next()?;
        if next.is_none() {
            return Ok(());
        }
        self.triangles.flush()?;
        let mut masks = RecordSorter::new(scratch, |a: &PairMask, b: &PairMask| by_pair(&a.pair, &b.pair));
        let (mut open, mut anchor): (Vec<PairMask>, _) = (Vec::new(), [0.0; 3]);
        let (mut current, mut pending) = (None, self.pending.cursor());
        // The triangles of an object follow one another, in the order of the objects.
        self.triangles.try_for_each(|triangle| {
            let object = triangle.object as usize;
            if current != Some(object) {
                current = Some(object);
                open.drain(..).try_for_each(|mask| masks.push(mask))?;
                while let Some(member) = next.filter(|member| member.object <= object) {
                    let is_own = member.object == object;
                    open.extend(is_own.then(|| PairMask::new(member.pair, object != member.pair.first)));
                    next = members.read_next()?;
                }
                if !open.is_empty() {
                    anchor = pending.get(object)?.anchor;
                }
            }
            if !open.is_empty() {
                let on_map = |corner: [f32; 3]| [0, 1].map(|axis: usize| anchor[axis] + f64::from(corner[axis]));
                open.iter_mut().for_each(|mask| mask.add(triangle.corners.map(on_map)));
            }
            Ok(())
        })?;
        open.into_iter().try_for_each(|mask| masks.push(mask))?;
        let mut last: Option<PairMask> = None;
        masks.finish()?.try_for_each(|mask| {
            if let Some(last) = last.take().filter(|last| by_pair(&last.pair, &mask.pair).is_eq() && last.equals(&mask))
            {
                return visit(last.pair);
            }
            last = Some(mask);
            Ok(())
        })
    }
}

fn count_duplicate(left_out: &PendingObject, kept: &PendingObject, has_same_id: bool, sources: &mut [SourceReport]) {
    let why = if has_same_id { "same identifier" } else { "same footprint and height" };
    let detail = format!("{}: {why} as {} of {}", left_out.id, kept.id, sources[kept.source].path);
    let report = &mut sources[left_out.source];
    subtract_from_report(left_out, report);
    report.duplicates.add(|| detail);
}
