//! Copies the WGSL into the build: for browsers, which download it with the program, without comments and indentation.

use std::{env, fs, io, path::Path};

const FOLDERS: [&str; 2] = ["", "shared"];

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=wgsl");
    let is_browser = env::var("CARGO_CFG_TARGET_ARCH").is_ok_and(|arch| arch == "wasm32");
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("cargo names no OUT_DIR"))?;
    for folder in FOLDERS {
        let target = Path::new(&out).join(folder);
        fs::create_dir_all(&target)?;
        for entry in fs::read_dir(Path::new("wgsl").join(folder))? {
            let path = entry?.path();
            if let Some(name) = path.file_name().filter(|_| path.is_file()) {
                let source = fs::read_to_string(&path)?;
                fs::write(target.join(name), if is_browser { without_comments(&source) } else { source })?;
            }
        }
    }
    Ok(())
}

/// WGSL has no strings, so that `//` always begins a comment.
fn without_comments(source: &str) -> String {
    let code = source.lines().map(|line| line.split("//").next().unwrap_or_default().trim());
    code.filter(|line| !line.is_empty()).collect::<Vec<_>>().join("\n")
}
