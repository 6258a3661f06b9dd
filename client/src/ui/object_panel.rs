//! The selected objects: which they are, and a panel of what is known of them.

use super::bookmarks::ViewAction;
use super::object_source::{ObjectWorker, SharedLookup};
use crate::language;
use egui::{Color32, RichText, Ui};
use insula_objects::FeatureKind;
use insula_objects::schema::ShownValue;
use insula_protocol::text::printable;
use insula_viewer::additions::FIRST_ADDED;
use insula_viewer::objects::ObjectDescription;
use std::collections::BTreeSet;

/// Most objects whose attributes are shown.
const MAX_SHOWN: usize = 32;
/// Longest value on a line, in characters. The pointer shows all of it.
const MAX_VALUE_CHARS: usize = 40;
/// Width of the panel, in points.
const MAX_WIDTH: f32 = 400.0;
/// Greatest height of the attributes as a share of the window's.
const MAX_HEIGHT_SHARE: f32 = 0.45;

/// What was found of an object, or why nothing was.
struct FoundObject {
    id: u32,
    result: std::result::Result<Option<ObjectDescription>, String>,
    /// Its attributes as people read them.
    shown: Vec<ShownValue>,
}

pub(super) struct ObjectPanel {
    selected: BTreeSet<u32>,
    /// What is known of the selected objects, in the order of arrival.
    found: Vec<FoundObject>,
    /// What the shown attributes' names or values contain.
    needle: String,
    worker: ObjectWorker<FoundObject>,
    /// An object to go to as soon as its place is known.
    to_visit: Option<u32>,
    hovered: Option<u32>,
    /// Number of changes of the selection and of the object under the pointer.
    generation: u64,
}

impl ObjectPanel {
    /// Nothing is selected.
    pub(super) fn new(objects: SharedLookup) -> Self {
        Self {
            selected: BTreeSet::new(),
            found: Vec::new(),
            needle: String::new(),
            worker: ObjectWorker::new(objects),
            to_visit: None,
            hovered: None,
            generation: 0,
        }
    }

    pub(super) fn selected(&self) -> &BTreeSet<u32> {
        &self.selected
    }

    pub(super) fn only_selected(&self) -> Option<u32> {
        // What a proposal adds has no number in the city.
        self.selected.first().copied().filter(|object| self.selected.len() == 1 && *object < FIRST_ADDED)
    }

    /// The selected objects, the parts of those without a shape, and the object under the pointer.
    pub(super) fn outlined(&self) -> BTreeSet<u32> {
        let known = self.found.iter().filter_map(|found| found.result.as_ref().ok()?.as_ref());
        let parts = known.flat_map(|object| object.parts.iter().copied());
        self.selected.iter().copied().chain(parts).chain(self.hovered).collect()
    }

    /// Another object, or none, is under the pointer. Returns whether that changes the outlines.
    pub(super) fn hover(&mut self, object: Option<u32>) -> bool {
        let before = self.outlined();
        self.hovered = object;
        let has_changed = self.outlined() != before;
        self.generation += u64::from(has_changed);
        has_changed
    }

    /// Number of changes of the selection and of the object under the pointer.
    pub(super) fn generation(&self) -> u64 {
        self.generation
    }

    /// Whether attributes are on their way.
    pub(super) fn is_waiting(&self) -> bool {
        self.worker.is_busy()
    }

    /// A click on an object, or on none. With `adds` it is added to the selection, or removed from it; otherwise it is the only one.
    pub(super) fn click(&mut self, object: Option<u32>, adds: bool) {
        self.generation += 1;
        self.to_visit = None;
        match object {
            Some(id) if adds && self.selected.remove(&id) => self.found.retain(|found| found.id != id),
            Some(id) => {
                if !adds {
                    self.clear();
                }
                self.selected.insert(id);
            }
            None if adds => {}
            None => self.clear(),
        }
    }

    /// Selects only what is to be kept, of what is selected.
    pub(super) fn retain(&mut self, is_kept: impl Fn(u32) -> bool) {
        self.generation += 1;
        self.selected.retain(|id| is_kept(*id));
        self.found.retain(|found| is_kept(found.id));
        self.to_visit = self.to_visit.filter(|id| is_kept(*id));
        self.hovered = self.hovered.filter(|id| is_kept(*id));
    }

    pub(super) fn clear(&mut self) {
        self.generation += 1;
        self.selected.clear();
        self.found.clear();
    }

    /// Makes [`Self::poll`] return the place of an object as soon as it is known.
    pub(super) fn go_to_when_known(&mut self, id: u32) {
        self.to_visit = Some(id);
    }

    /// Takes in attributes that have arrived, and fetches those of the next object. Returns the place to go to, in world coordinates,
    /// once.
    pub(super) fn poll(&mut self) -> Option<[f64; 3]> {
        if let Some(found) = self.worker.take() {
            self.add(found);
        }
        if !self.worker.is_busy() && self.selected.len() <= MAX_SHOWN {
            self.fetch_next();
        }
        let visited = self.found.iter().find(|found| Some(found.id) == self.to_visit)?;
        self.to_visit = None;
        visited.result.as_ref().ok()?.as_ref()?.centre
    }

    fn add(&mut self, found: FoundObject) {
        if !self.selected.contains(&found.id) {
            return;
        }
        // Its parts may be outlined now.
        self.generation += 1;
        // All land is one object: an outline of it would be one of the city.
        let is_ground = |object: &ObjectDescription| object.kind == FeatureKind::Relief.name();
        if found.result.as_ref().is_ok_and(|object| object.as_ref().is_some_and(is_ground)) {
            self.selected.remove(&found.id);
        } else {
            self.found.push(found);
        }
    }

    fn fetch_next(&mut self) {
        let is_missing = |id: &&u32| self.found.iter().all(|found| found.id != **id);
        let Some(id) = self.selected.iter().find(is_missing).copied() else { return };
        let describe = move |objects: &SharedLookup| {
            let described = objects.read(|objects| {
                let object = objects.describe_with_parent(id)?;
                let language = language::of_environment();
                let shown = object.as_ref().map(|object| objects.schema().shown(&object.attributes, &language));
                Ok((object, shown.unwrap_or_default()))
            });
            match described {
                Ok((object, shown)) => FoundObject { id, result: Ok(object), shown },
                Err(reason) => FoundObject { id, result: Err(reason), shown: Vec::new() },
            }
        };
        if let Err(reason) = self.worker.start(describe) {
            self.add(FoundObject { id, result: Err(reason), shown: Vec::new() });
        }
    }

    /// Lays the panel out. Returns what the user asks for.
    pub(super) fn show(&mut self, ui: &mut Ui) -> Option<ViewAction> {
        ui.set_max_width(MAX_WIDTH);
        let mut action = None;
        let count = self.selected.len();
        let title = if count == 1 { "1 object".to_owned() } else { format!("{count} objects") };
        ui.horizontal(|ui| {
            ui.label(RichText::new(title).strong().color(Color32::WHITE));
            ui.add(egui::TextEdit::singleline(&mut self.needle).hint_text("find an attribute").desired_width(130.0));
            if ui.button("Copy").on_hover_text("all attributes as JSON").clicked() {
                ui.ctx().copy_text(self.json());
            }
            if ui.button("Close").on_hover_text("Esc").clicked() {
                action = Some(ViewAction::DeselectObjects);
            }
        });
        let needle = self.needle.to_lowercase();
        let height = ui.ctx().content_rect().height() * MAX_HEIGHT_SHARE;
        egui::ScrollArea::vertical().max_height(height).show(ui, |ui| {
            for found in &self.found {
                ui.separator();
                match &found.result {
                    Ok(Some(object)) => action = show_object(ui, object, &found.shown, &needle).or(action.take()),
                    Ok(None) => drop(ui.label(format!("nothing is known of object {}", found.id))),
                    Err(reason) => drop(ui.label(printable(reason).into_owned())),
                }
            }
        });
        if self.is_waiting() {
            ui.spinner();
        }
        action
    }

    fn json(&self) -> String {
        let known: Vec<&ObjectDescription> =
            self.found.iter().filter_map(|found| found.result.as_ref().ok()?.as_ref()).collect();
        serde_json::to_string_pretty(&known).unwrap_or_default()
    }
}

/// One object. Only attributes whose title, name or value contains `needle` are shown.
fn show_object(ui: &mut Ui, object: &ObjectDescription, shown: &[ShownValue], needle: &str) -> Option<ViewAction> {
    let mut action = None;
    ui.horizontal(|ui| {
        ui.label(RichText::new(printable(&object.identifier)).strong());
        if let Some([x, y, z]) = object.centre
            && ui.button("Go to").clicked()
        {
            action = Some(ViewAction::GoTo { x, y, z: Some(z) });
        }
    });
    let part = object.parent.as_ref().map(|parent| format!(", part of {}", printable(parent))).unwrap_or_default();
    ui.label(RichText::new(format!("{} {}{part}", object.kind, object.id)).color(Color32::from_gray(160)));
    egui::Grid::new(("object", object.id)).num_columns(2).spacing([10.0, 2.0]).show(ui, |ui| {
        for ShownValue { name, title, text } in shown {
            if ![name, title, text].iter().any(|text| text.to_lowercase().contains(needle)) {
                continue;
            }
            let text = printable(text).into_owned();
            let shown: String = text.chars().take(MAX_VALUE_CHARS).collect();
            let is_cut = shown.len() < text.len();
            let shown = if is_cut { format!("{shown}…") } else { shown };
            ui.label(RichText::new(printable(title)).color(Color32::from_gray(160))).on_hover_text(printable(name));
            let line = if text.starts_with("https://") || text.starts_with("http://") {
                ui.hyperlink_to(shown, &text)
            } else {
                ui.label(shown)
            };
            if is_cut {
                line.on_hover_text(text);
            }
            ui.end_row();
        }
    });
    action
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ClientError;
    use insula_objects::NamedValues;

    fn panel() -> ObjectPanel {
        ObjectPanel::new(SharedLookup::new(Box::new(|| Err(ClientError::Failed("no objects here".into())))))
    }

    #[test]
    fn clicks_select_one_object_and_with_shift_several() {
        let mut panel = panel();
        panel.click(Some(3), false);
        panel.click(Some(5), true);
        assert_eq!(*panel.selected(), BTreeSet::from([3, 5]));
        panel.click(Some(3), true);
        assert_eq!(*panel.selected(), BTreeSet::from([5]));
        panel.click(Some(9), false);
        assert_eq!((panel.selected(), panel.only_selected()), (&BTreeSet::from([9]), Some(9)));
        panel.click(Some(FIRST_ADDED), false);
        assert_eq!((panel.selected().len(), panel.only_selected()), (1, None), "links have no numbers of a proposal");
        panel.click(Some(9), false);
        panel.click(Some(2), true);
        panel.retain(|id| id == 2);
        assert_eq!(*panel.selected(), BTreeSet::from([2]));
        let before = panel.generation();
        panel.click(None, false);
        assert!(panel.selected().is_empty() && panel.generation() > before);
    }

    #[test]
    fn the_object_under_the_pointer_is_outlined_until_the_pointer_leaves() {
        let mut panel = panel();
        panel.click(Some(3), false);
        assert!(!panel.hover(Some(3)) && panel.hover(Some(5)));
        assert_eq!(panel.outlined(), BTreeSet::from([3, 5]));
        assert!(!panel.hover(Some(5)) && panel.hover(None));
        assert_eq!((panel.outlined(), panel.selected()), (BTreeSet::from([3]), &BTreeSet::from([3])));
    }

    #[test]
    fn a_click_on_the_ground_selects_nothing() {
        let mut panel = panel();
        let found = |kind: FeatureKind| {
            let object = ObjectDescription {
                id: 3,
                identifier: String::new(),
                parent: None,
                kind: kind.name(),
                attributes: NamedValues::default(),
                centre: None,
                parts: Vec::new(),
            };
            FoundObject { id: 3, result: Ok(Some(object)), shown: Vec::new() }
        };
        for (kind, selected) in [(FeatureKind::Relief, BTreeSet::new()), (FeatureKind::Road, BTreeSet::from([3]))] {
            panel.click(Some(3), false);
            panel.add(found(kind));
            assert_eq!(*panel.selected(), selected);
        }
    }

    #[test]
    fn a_failure_is_shown_with_its_reason() {
        let mut panel = panel();
        panel.click(Some(3), false);
        panel.poll();
        while panel.is_waiting() {
            panel.poll();
            std::thread::yield_now();
        }
        assert!(matches!(&panel.found[0].result, Err(reason) if reason.contains("no objects here")));
    }
}
