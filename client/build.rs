//! Lists the bundled city's files, so that the program carries them whatever they are called.

use std::{env, fmt::Write, fs, io, path::PathBuf};

fn main() -> io::Result<()> {
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let folder = here.join("demo").join("chiba");
    println!("cargo:rerun-if-changed=demo");
    let mut names = Vec::new();
    if folder.is_dir() {
        println!("cargo:rerun-if-changed=demo/chiba");
        for entry in fs::read_dir(&folder)? {
            let entry = entry?;
            if entry.file_type()?.is_file() {
                names.push((entry.file_name().to_string_lossy().into_owned(), entry.path()));
            }
        }
    }
    names.sort();
    let mut code = String::from("[\n");
    for (name, path) in &names {
        writeln!(code, "    ({name:?}, include_bytes!({:?})),", path.display().to_string())
            .map_err(io::Error::other)?;
    }
    code.push_str("]\n");
    fs::write(PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("demo_files.rs"), code)
}
