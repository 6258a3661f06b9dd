//! Copies the WGSL into the build: for browsers, which download it with the program, squeezed, and squeezed beside it for tests.

use std::{env, fs, io, path::Path};

const FOLDERS: [&str; 2] = ["", "shared"];

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=wgsl");
    let is_browser = env::var("CARGO_CFG_TARGET_ARCH").is_ok_and(|arch| arch == "wasm32");
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("cargo names no OUT_DIR"))?;
    for folder in FOLDERS {
        let target = Path::new(&out).join(folder);
        let squeezed_target = Path::new(&out).join("squeezed").join(folder);
        fs::create_dir_all(&target)?;
        fs::create_dir_all(&squeezed_target)?;
        for entry in fs::read_dir(Path::new("wgsl").join(folder))? {
            let path = entry?.path();
            if let Some(name) = path.file_name().filter(|_| path.is_file()) {
                let source = fs::read_to_string(&path)?;
                let small = squeezed(&source);
                fs::write(squeezed_target.join(name), &small)?;
                fs::write(target.join(name), if is_browser { small } else { source })?;
            }
        }
    }
    Ok(())
}

/// The code without comments, indentation and the spaces that separate nothing. WGSL has no strings, so that `//` always begins a
/// comment.
fn squeezed(source: &str) -> String {
    let code = source.lines().map(|line| line.split("//").next().unwrap_or_default().trim());
    code.filter(|line| !line.is_empty()).map(squeezed_line).collect::<Vec<_>>().join("\n")
}

/// A line without the spaces beside brackets, commas and semicolons, and between a word and an operator. Words stay apart, and so do
/// operators: two of them might be another one.
fn squeezed_line(line: &str) -> String {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let is_bracket = |c: char| ",;(){}[]".contains(c);
    let mut out = String::with_capacity(line.len());
    let mut rest = line.chars().peekable();
    while let Some(c) = rest.next() {
        if let (' ', Some(before), Some(&after)) = (c, out.chars().next_back(), rest.peek())
            && (is_bracket(before) || is_bracket(after) || is_word(before) != is_word(after))
        {
            continue;
        }
        out.push(c);
    }
    out
}
