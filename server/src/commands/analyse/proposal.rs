//! What an analysis says of the change by a proposal.

use super::Answer;
use crate::{args::Analysis, proposal::Proposal};
use insula_analysis::{
    proposal::{SurfaceValues, change},
    surface::CitySurface,
};

/// How far around a proposal values are computed.
pub(super) const AROUND_M: f64 = 500.0;

/// What an answer after the change is beside one before it.
pub(super) fn between(
    proposal: &Proposal,
    what: Analysis,
    [before, after]: [&CitySurface; 2],
    earlier: &Answer,
    later: Answer,
) -> Answer {
    let [before, after] = [(before, earlier), (after, &later)].map(|(surface, answer)| SurfaceValues {
        surface,
        tops: &answer.tops,
        points: &answer.points,
        walls: &answer.walls,
    });
    let (tops, points, walls) = change(before, after);
    let name = proposal.name();
    let mut notes = later.notes;
    let meaning = match what {
        Analysis::Shadow => "1 is new shadow, and -1 shadow that goes",
        Analysis::View => "1 is newly seen, and -1 no longer",
        _ => "what is below 0 is lost",
    };
    notes.push(format!("{name}: values are changes, after less before, up to {AROUND_M} m around it; {meaning}"));
    Answer { tops, points, walls, asked: None, title: format!("change of {} by {name}", later.title), notes, ..later }
}
