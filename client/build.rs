//! Writes a Rust array of the bundled cities' files, which `commands::demo` embeds.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let crate_dir = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let folder = crate_dir.join("demo");
    println!("cargo:rerun-if-changed=demo");
    let mut files = Vec::new();
    for city in if folder.is_dir() { entries(&folder)? } else { Vec::new() } {
        if city.is_dir() {
            let city_name = name(&city);
            println!("cargo:rerun-if-changed=demo/{city_name}");
            files.extend(
                entries(&city)?.into_iter().filter(|path| path.is_file()).map(|path| (city_name.clone(), path)),
            );
        }
    }
    files.sort();
    let mut code = String::from("[\n");
    for (city, path) in &files {
        let name = name(path);
        // Worktrees may share this output, so the array names no folder of one of them.
        let at = format!("/demo/{city}/{name}");
        writeln!(code, "    ({city:?}, {name:?}, include_bytes!(concat!(env!(\"CARGO_MANIFEST_DIR\"), {at:?}))),")
            .map_err(io::Error::other)?;
    }
    code.push_str("]\n");
    fs::write(PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("demo_files.rs"), code)
}

fn entries(folder: &Path) -> io::Result<Vec<PathBuf>> {
    fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect()
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
