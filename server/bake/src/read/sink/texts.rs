//! Titles, attributions and licences of a source.

use insula_protocol::manifest::shorten_text;
use insula_source::object::Description;
use insula_source::report::SourceReport;

/// Further titles, attributions or licences of a source are left out.
const MAX_TEXTS: usize = 1000;

/// Adds a text of a source about itself to its report, unless that has it. A long one is cut.
pub(super) fn add(report: &mut SourceReport, what: Description, text: &str) {
    let (list, name) = match what {
        Description::Title => (&mut report.titles, "title"),
        Description::Attribution => (&mut report.attributions, "attribution"),
        Description::Licence => (&mut report.licences, "licence"),
    };
    let text = text.trim();
    let short = shorten_text(text);
    if text.is_empty() || list.iter().any(|known| known == short) {
        return;
    }
    if list.len() >= MAX_TEXTS {
        report.problem("too many texts in the metadata", || name.to_owned());
        return;
    }
    list.push(short.to_owned());
    if short.len() < text.len() {
        report.problem("text in the metadata too long, cut", || format!("{name}: {} bytes", text.len()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::report::SourceFormat;

    #[test]
    fn long_texts_are_cut_and_too_many_left_out() {
        let mut report = SourceReport::new("a", SourceFormat::CityJson, 0);
        add(&mut report, Description::Title, &"\u{e4}".repeat(1 << 20));
        assert_eq!(report.titles, ["\u{e4}".repeat(2048)]);
        assert_eq!(report.problems["text in the metadata too long, cut"].first, ["title: 2097152 bytes"]);
        (0..1500).for_each(|i| add(&mut report, Description::Licence, &i.to_string()));
        assert_eq!((report.licences.len(), report.problems["too many texts in the metadata"].count), (1000, 500));
    }
}
