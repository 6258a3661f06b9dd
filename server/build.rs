//! Copies the files of the browser viewer, if `client/web/build` has made them, and writes the Rust code that embeds them.
//!
//! `INSULA_WEB_DIST` names another folder than `client/web/dist`; if it is empty, nothing is embedded.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-env-changed=INSULA_WEB_DIST");
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    let code = match dist_folder() {
        Some(dist) => embed(&dist, &out.join("viewer"))?,
        None => "None".to_owned(),
    };
    fs::write(out.join("embedded_viewer.rs"), code)
}

/// The folder that `client/web/build` writes, if it exists. Cargo runs this again once it does, or when it changes.
fn dist_folder() -> Option<PathBuf> {
    if let Some(folder) = env::var_os("INSULA_WEB_DIST") {
        let folder = PathBuf::from(folder);
        if folder.as_os_str().is_empty() {
            return None;
        }
        println!("cargo:rerun-if-changed={}", folder.display());
        return Some(folder);
    }
    let web = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default()).join("../client/web");
    let dist = web.join("dist");
    // A path that does not exist would make every build run this, and compile the server again.
    let watched = [&dist, &web].into_iter().find(|folder| folder.is_dir());
    println!("cargo:rerun-if-changed={}", watched.map_or("build.rs".into(), |folder| folder.display().to_string()));
    dist.is_dir().then_some(dist)
}

/// Copies the assets of `dist` into `copies`, so that a later build of them cannot mix two versions. Returns an expression of
/// them. Fails if `dist` is not what `client/web/build` writes.
fn embed(dist: &Path, copies: &Path) -> io::Result<String> {
    let invalid = |what: &str| io::Error::other(format!("{}: {what}: run client/web/build again", dist.display()));
    let folders: Vec<_> = fs::read_dir(dist.join("assets"))?.collect::<io::Result<_>>()?;
    let [folder] = &folders[..] else { return Err(invalid("`assets` must have one folder")) };
    let hash = folder.file_name().into_string().map_err(|_| invalid("a name is not text"))?;
    let mut names = Vec::new();
    for entry in fs::read_dir(folder.path())? {
        let name = entry?.file_name().into_string().map_err(|_| invalid("a name is not text"))?;
        if !name.ends_with(".br") && !name.ends_with(".gz") {
            names.push(name);
        }
    }
    names.sort();
    fs::create_dir_all(copies)?;
    let mut code = format!("Some(EmbeddedViewer {{ hash: {hash:?}, files: &[\n");
    for name in &names {
        let mut forms = String::new();
        for (form, suffix) in [("plain", ""), ("brotli", ".br"), ("gzip", ".gz")] {
            let file = format!("{name}{suffix}");
            let copy = copies.join(&file);
            fs::write(&copy, fs::read(folder.path().join(&file)).map_err(|_| invalid(&format!("{file} is missing")))?)?;
            let _ = write!(forms, ", {form}: include_bytes!({:?})", copy.display().to_string());
        }
        let _ = writeln!(code, "    EmbeddedFile {{ name: {name:?}{forms} }},");
    }
    Ok(code + "] })\n")
}
