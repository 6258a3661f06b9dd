//! What an analysis says of the change by a proposal.

use super::super::error::CommandError;
use crate::analysis::answer::Answer;
use crate::args::Analysis;
use crate::proposal::{Proposal, ProposedChange, ProposedObjects};
use insula_analysis::proposal::{SurfaceValues, change};
use insula_analysis::rays::CityTriangles;
use insula_analysis::surface::CitySurface;
use insula_export::source::ExportSource;

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
    let title = format!("change of {} by {name}", later.title);
    Answer { tops, points, walls, asked: None, title, notes, is_change: true, ..later }
}

/// What rays meet after a proposal.
pub(super) struct AfterProposal<'a> {
    proposal: &'a Proposal,
    change: &'a ProposedChange,
    objects: ProposedObjects,
}

impl<'a> AfterProposal<'a> {
    /// Fails if a building that is removed is not there, or if the city cannot be read.
    pub(super) fn new(
        proposal: &'a Proposal,
        change: &'a ProposedChange,
        source: &dyn ExportSource,
    ) -> Result<Self, CommandError> {
        Ok(Self { proposal, change, objects: change.objects(proposal, source)? })
    }

    pub(super) fn triangles(&self, city: CityTriangles) -> CityTriangles {
        let ProposedObjects { added, removed } = &self.objects;
        let added: Vec<[[f64; 3]; 3]> = added.iter().flat_map(|object| object.triangles.iter().copied()).collect();
        // The numbers ascend.
        city.changed(&|object| removed.binary_search(&object).is_ok(), &added)
    }

    pub(super) fn ground(&self, surface: &CitySurface) -> CitySurface {
        self.change.cleared(surface)
    }

    /// What the values mean.
    pub(super) fn note(&self) -> String {
        format!("{}: values are those after it", self.proposal.name())
    }
}
