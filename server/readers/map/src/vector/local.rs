//! Files beside the source.

use insula_source::input::Input;
use insula_source::text::{decoded, likely_encoding};

/// The names that a file beside the source can have: the source's with another extension, in usual spellings.
pub(super) fn sibling_names(name: &str, extension: &str) -> Vec<String> {
    let lower = name.to_ascii_lowercase();
    let unpacked = if lower.ends_with(".gz") { &name[..name.len() - 3] } else { name };
    let file_start = unpacked.rfind('/').map_or(0, |slash| slash + 1);
    let stem = unpacked[file_start..].rfind('.').map_or(unpacked, |dot| &unpacked[..file_start + dot]);
    let mut capital = extension.to_owned();
    if let Some(first) = capital.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    let spellings = [extension.to_owned(), extension.to_ascii_uppercase(), capital];
    let mut names: Vec<String> = spellings.iter().map(|extension| format!("{stem}.{extension}")).collect();
    names.extend(spellings[..2].iter().map(|extension| format!("{stem}.{extension}.gz")));
    names
}

/// The name of the first of the files beside the source that exists.
pub(super) fn sibling(input: &Input<'_>, extension: &str) -> Option<String> {
    sibling_names(input.name, extension).into_iter().find(|name| input.files.open(name).is_ok())
}

/// The text of a small file beside the source, such as a `.prj`; `None` if there is none or it is too large to be one.
pub(super) fn sibling_text(input: &Input<'_>, extension: &str) -> Option<String> {
    small_text(input, &sibling(input, extension)?)
}

/// The attribution in a file beside a table, named as the table and with `.txt` after that, as an export writes it. Longer texts are notes
/// of something else.
pub(super) fn attribution_beside(input: &Input<'_>) -> Option<String> {
    small_text(input, &format!("{}.txt", input.name)).filter(|text| text.lines().count() == 1)
}

fn small_text(input: &Input<'_>, name: &str) -> Option<String> {
    const MAX_TEXT_BYTES: u64 = 1 << 16;
    let bytes = Input { name, ..*input }.read_all(MAX_TEXT_BYTES).ok()?;
    let text = decoded(&bytes, likely_encoding(&bytes).page);
    let text = text.trim_start_matches('\u{feff}').trim();
    (!text.is_empty()).then(|| text.to_owned())
}

/// The coordinate system that a file beside the source tells: `.prj`, or `.qpj` of QGIS.
pub(super) fn system_beside(input: &Input<'_>) -> Option<String> {
    sibling_text(input, "prj").or_else(|| sibling_text(input, "qpj"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn siblings_keep_folder_and_stem() {
        assert_eq!(
            sibling_names("a.b/Town.v2.SHP.gz", "dbf")[..3],
            ["a.b/Town.v2.dbf", "a.b/Town.v2.DBF", "a.b/Town.v2.Dbf"]
        );
        assert_eq!(sibling_names("a.b/town", "prj")[0], "a.b/town.prj");
    }
}
