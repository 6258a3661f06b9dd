//! Files for random access.

use std::fs::File;
use std::io::{self, Write};

use crate::error::InputError;
use crate::read::input::{Input, LocalFile};
use crate::read::random_file::RandomFile;
use crate::read::source::is_gz;

/// The source on disk, unpacked to a temporary file if it ends in `.gz`. Fails if it cannot be read or is too large.
pub(super) fn on_disk(input: &Input<'_>) -> Result<LocalFile, InputError> {
    let io_error = |cause| InputError::io(input.label, cause);
    if is_gz(input.name) {
        let mut unpacked = tempfile::NamedTempFile::new().map_err(io_error)?;
        io::copy(&mut input.open()?.reader, &mut unpacked).map_err(io_error)?;
        unpacked.flush().map_err(io_error)?;
        let copy = unpacked.into_temp_path();
        return Ok(LocalFile { path: copy.to_path_buf(), copy: Some(copy) });
    }
    let file = input.files.on_disk(input.name).map_err(io_error)?;
    let bytes = std::fs::metadata(&file.path).map_err(io_error)?.len();
    check_size(input, bytes)?;
    Ok(file)
}

/// The source for reading in any order, a copy of it if it ends in `.gz`. Fails as [`on_disk`].
pub(super) fn random(input: &Input<'_>) -> Result<RandomFile, InputError> {
    let io_error = |cause| InputError::io(input.label, cause);
    if !input.files.is_random() || is_gz(input.name) {
        return RandomFile::of_local(on_disk(input)?).map_err(io_error);
    }
    let file = input.files.random(input.name).map_err(io_error)?;
    check_size(input, file.bytes())?;
    Ok(file)
}

fn check_size(input: &Input<'_>, bytes: u64) -> Result<(), InputError> {
    if bytes > input.max_bytes {
        let what = "its size in bytes".to_owned();
        return Err(InputError::TooLarge { path: input.label.to_owned(), what, limit: input.max_bytes });
    }
    Ok(())
}

/// Opens the source on disk. Fails if it cannot be read.
pub(super) fn open(input: &Input<'_>, file: &LocalFile) -> Result<File, InputError> {
    File::open(&file.path).map_err(|cause| InputError::io(input.label, cause))
}

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
    const MAX_TEXT_BYTES: u64 = 1 << 16;
    let name = sibling(input, extension)?;
    let bytes = Input { name: &name, ..*input }.read_all(MAX_TEXT_BYTES).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_start_matches('\u{feff}').trim();
    (!text.is_empty()).then(|| text.to_owned())
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
