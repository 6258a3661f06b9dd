//! The switch between the city as it is and with a proposal.

use super::bookmarks::ViewAction;
use super::overlay::panel;
use crate::session::Session;
use egui::{Align2, Color32, Context, RichText};
use insula_protocol::text::printable;

/// Shows the switch if there is a proposal. Returns what the user asks for.
pub(super) fn show(ctx: &Context, session: &Session) -> Option<ViewAction> {
    let proposal = session.proposal()?;
    let mut is_shown = proposal.is_shown();
    panel(ctx, "proposal", Align2::CENTER_BOTTOM, [0.0, -44.0], |ui| {
        ui.horizontal(|ui| {
            ui.label(RichText::new(printable(proposal.title())).strong().color(Color32::WHITE));
            ui.radio_value(&mut is_shown, false, "before").on_hover_text("Y");
            ui.radio_value(&mut is_shown, true, "after").on_hover_text("Y");
        });
    });
    (is_shown != proposal.is_shown()).then_some(ViewAction::ToggleProposal)
}
