//! The search box: objects by their names, addresses and identifiers.
//!
//! One search runs at a time. When it ends, the text of that moment is searched.

use super::object_source::{ObjectWorker, SharedLookup};
use egui::{Color32, RichText, Ui};
use insula_objects::search::{MAX_QUERY_CHARS, SearchHit};
use insula_protocol::text::printable;

/// Most hits that are listed.
const MAX_SHOWN: usize = 12;
/// Longest text of a hit, in characters.
const MAX_HIT_CHARS: usize = 80;

/// Hits of a text, or why there are none; `None` if the city has no search.
type SearchAnswer = Result<Option<Vec<SearchHit>>, String>;

/// The box and its hits.
pub(super) struct SearchPanel {
    pub(super) is_open: bool,
    worker: ObjectWorker<SearchAnswer>,
    text: String,
    /// The text of `answer`, or of the search that runs.
    searched: String,
    answer: SearchAnswer,
    /// Whether the box was open at the last frame.
    was_open: bool,
}

impl SearchPanel {
    /// Nothing is searched yet.
    pub(super) fn new(objects: SharedLookup) -> Self {
        Self {
            is_open: false,
            worker: ObjectWorker::new(objects),
            text: String::new(),
            searched: String::new(),
            answer: Ok(Some(Vec::new())),
            was_open: false,
        }
    }

    /// Whether hits are on their way.
    pub(super) fn is_waiting(&self) -> bool {
        self.worker.is_busy()
    }

    /// Takes in hits that have arrived, and searches what was typed since.
    pub(super) fn poll(&mut self) {
        if let Some(answer) = self.worker.take() {
            self.answer = answer;
        }
        let text = self.text.trim();
        if self.worker.is_busy() || text == self.searched {
            return;
        }
        self.searched = text.to_owned();
        if text.is_empty() {
            self.answer = Ok(Some(Vec::new()));
            return;
        }
        let text = text.to_owned();
        let search = move |objects: &SharedLookup| objects.read(|objects| objects.search(&text, MAX_SHOWN));
        if let Err(reason) = self.worker.start(search) {
            self.answer = Err(reason);
        }
    }

    /// Lays the panel out. Returns the object of a hit that the user chooses: by a click, or the first by Enter.
    pub(super) fn show(&mut self, ui: &mut Ui) -> Option<u32> {
        let hint = "name, address, identifier";
        let field = egui::TextEdit::singleline(&mut self.text).hint_text(hint).char_limit(MAX_QUERY_CHARS);
        let field = ui.add(field.desired_width(260.0));
        if !std::mem::replace(&mut self.was_open, true) {
            field.request_focus();
        }
        let is_entered = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        match &self.answer {
            Ok(Some(hits)) if hits.is_empty() && !self.worker.is_busy() && !self.searched.is_empty() => {
                ui.label("nothing found");
                None
            }
            Ok(Some(hits)) => {
                let clicked = hits.iter().filter(|hit| show_hit(ui, hit)).map(|hit| hit.object).last();
                clicked.or_else(|| hits.first().filter(|_| is_entered).map(|hit| hit.object))
            }
            Ok(None) => {
                ui.label("this city has no search: bake it again");
                None
            }
            Err(reason) => {
                ui.colored_label(Color32::from_rgb(255, 150, 130), printable(reason));
                None
            }
        }
    }

    /// Called in a frame without the panel.
    pub(super) fn hide(&mut self) {
        self.was_open = false;
    }
}

fn show_hit(ui: &mut Ui, hit: &SearchHit) -> bool {
    let text: String = printable(&hit.text).chars().take(MAX_HIT_CHARS).collect();
    ui.selectable_label(false, RichText::new(text)).on_hover_text(format!("object {}", hit.object)).clicked()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ClientError;

    #[test]
    fn a_typed_text_is_searched_and_a_failure_shown() {
        let open = || Err(ClientError::Failed("no objects here".into()));
        let mut panel = SearchPanel::new(SharedLookup::new(Box::new(open)));
        panel.poll();
        assert!(!panel.is_waiting());
        panel.text = " oude ".into();
        panel.poll();
        assert!(panel.is_waiting() && panel.searched == "oude");
        while panel.is_waiting() {
            panel.poll();
            std::thread::yield_now();
        }
        assert!(panel.answer.as_ref().is_err_and(|reason| reason.contains("no objects here")));
        panel.text.clear();
        panel.poll();
        assert!(panel.answer.as_ref().is_ok_and(|hits| hits.as_ref().is_some_and(Vec::is_empty)));
    }
}
