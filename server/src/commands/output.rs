//! Output to standard output and files.

use super::error::CommandError;
use insula_protocol::text::{printable_json, printable_lines};
use std::{
    ffi::OsString,
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};

/// Prints lines to standard output, without anything that a terminal obeys. Errors are ignored, so that a closed pipe
/// (`| head`) does not fail the command.
pub(super) fn print(text: &str) {
    write_out(&printable_lines(text));
}

/// Prints JSON, as [`print`] does.
pub(super) fn print_json(json: &str) {
    write_out(&(printable_json(json) + "\n"));
}

fn write_out(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Writes a file under another name and renames it, so that it exists completely or not at all. Devices and pipes are
/// written directly. Fails if the system refuses.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), CommandError> {
    let is_special = fs::metadata(path).is_ok_and(|found| !found.is_file());
    let written = if is_special { fs::write(path, bytes) } else { replace(path, bytes) };
    written.map_err(|error| CommandError::Write { path: path.to_owned(), reason: error.to_string() })
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A link keeps pointing to its file, which gets the new content.
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let name = path.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "not a file name"))?;
    let mut aside = OsString::from(".");
    aside.push(name);
    aside.push(format!(".{}.tmp", std::process::id()));
    let aside = path.with_file_name(aside);
    let written = File::create_new(&aside).and_then(|mut file| file.write_all(bytes));
    let renamed = written.and_then(|()| fs::rename(&aside, &path));
    if renamed.as_ref().is_err_and(|error| error.kind() != io::ErrorKind::AlreadyExists) {
        let _ = fs::remove_file(&aside);
    }
    renamed
}

/// Fails if writing `output` would overwrite the file `input`, also by another name or link.
#[cfg(feature = "bake")]
pub(super) fn refuse_input(output: &Path, input: &Path) -> Result<(), CommandError> {
    let is_same_path =
        fs::canonicalize(output).is_ok_and(|found| fs::canonicalize(input).is_ok_and(|other| found == other));
    if is_same_path || is_same_file(output, input) {
        let reason = format!("it is the input {}; give another name", input.display());
        return Err(CommandError::Usage(format!("{}: {reason}", output.display())));
    }
    Ok(())
}

/// Whether two paths are hard links of one file.
#[cfg(all(unix, feature = "bake"))]
fn is_same_file(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |path: &Path| fs::metadata(path).ok().map(|found| (found.dev(), found.ino()));
    identity(a).is_some() && identity(a) == identity(b)
}

#[cfg(all(not(unix), feature = "bake"))]
fn is_same_file(_: &Path, _: &Path) -> bool {
    false
}

/// Fails if `output` lies in the folder `folder`, whose files are of a city alone.
pub(super) fn refuse_inside(output: &Path, folder: &Path) -> Result<(), CommandError> {
    if absolute(output).starts_with(absolute(folder)) {
        let reason = format!("it lies in the city's folder {}; write it elsewhere", folder.display());
        return Err(CommandError::Usage(format!("{}: {reason}", output.display())));
    }
    Ok(())
}

/// The path without links, as far as it exists.
fn absolute(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    match (fs::canonicalize(&absolute), absolute.parent(), absolute.file_name()) {
        (Ok(found), ..) => found,
        (Err(_), Some(parent), Some(name)) => self::absolute(parent).join(name),
        _ => absolute,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_that_is_the_input_is_refused_by_any_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir(path("sub")).unwrap();
        fs::write(path("a.ply"), "a").unwrap();
        fs::write(path("b.ply"), "b").unwrap();
        assert!(refuse_input(&path("b.ply"), &path("a.ply")).is_ok());
        assert!(refuse_input(&path("none.ply"), &path("a.ply")).is_ok());
        assert!(refuse_input(&path("sub/../a.ply"), &path("a.ply")).is_err());
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(path("a.ply"), path("link.ply")).unwrap();
            fs::hard_link(path("a.ply"), path("hard.ply")).unwrap();
            assert!(refuse_input(&path("link.ply"), &path("a.ply")).is_err());
            assert!(refuse_input(&path("hard.ply"), &path("a.ply")).is_err());
        }
        assert!(refuse_inside(&path("sub/new/x.json"), &path("sub")).is_err());
        assert!(refuse_inside(&path("sub2/x.json"), &path("sub")).is_ok());
    }

    #[test]
    fn file_is_replaced_whole_and_nothing_stays_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        for text in ["first", "second"] {
            write(&path, text.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert!(write(&folder.path().join("none/a.json"), b"x").is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
