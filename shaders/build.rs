//! Copies the WGSL into the build. Browsers fetch it apart from the program, and only for a GPU: `client/web/build` takes `browser.wgsl`,
//! where the files are minified and joined, each after a line `//@ NAME`.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{env, fs, io};

const FOLDERS: [&str; 2] = ["", "shared/"];
/// Files of the bake, which no browser needs.
const OF_PROGRAMS: [&str; 2] = ["nearest.wgsl", "occlusion.wgsl"];
/// Names of WGSL's own functions and values that declarations here may have, too.
const OWN_NAMES: &str = "abs acos all any asin atan atan2 bitcast ceil clamp cos cross default degrees determinant distance dot exp exp2 \
                         floor fma fract inverseSqrt length log log2 max min mix modf normalize pack4x8unorm position pow radians \
                         reflect refract round saturate select sign sin smoothstep sqrt step tan transpose trunc unpack4x8unorm \
                         vertex_index instance_index local_invocation_id local_invocation_index global_invocation_id workgroup_id \
                         num_workgroups binding builtin compute flat fragment front_facing function group interpolate invariant location perspective private read read_write sample_index storage uniform vertex workgroup workgroup_size write";

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=wgsl");
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("cargo names no OUT_DIR"))?);
    let mut files: BTreeMap<String, String> = BTreeMap::new();
    for folder in FOLDERS {
        fs::create_dir_all(out.join(folder))?;
        for entry in fs::read_dir(Path::new("wgsl").join(folder))? {
            let path = entry?.path();
            if let Some(name) = path.file_name().filter(|_| path.is_file()) {
                let name = format!("{folder}{}", name.to_string_lossy());
                let source = fs::read_to_string(&path)?;
                fs::write(out.join(&name), &source)?;
                files.insert(name, source);
            }
        }
    }
    fs::write(out.join("browser.wgsl"), joined(&files))
}

/// The files that browsers need, minified, with short names for what is declared, each after a line with its name.
fn joined(files: &BTreeMap<String, String>) -> String {
    let files: Vec<(&String, String)> = files
        .iter()
        .filter(|(name, _)| !OF_PROGRAMS.contains(&name.as_str()))
        .map(|(name, source)| (name, minified(source)))
        .collect();
    let short = short_names(files.iter().map(|(_, source)| source.as_str()));
    let small = |source: &str| -> String {
        tokens(source).map(|token| short.get(token).map_or(token, String::as_str)).collect()
    };
    files.iter().map(|(name, source)| format!("//@ {name}\n{}\n", small(source))).collect()
}

fn is_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// The code without comments and the spaces and lines that separate nothing: those beside brackets, commas and semicolons, and between a
/// word and an operator. Words stay apart, and so do operators: two of them might be another one. WGSL has no strings, so that `//`
/// always begins a comment.
fn minified(source: &str) -> String {
    let is_bracket = |c: char| ",;(){}[]".contains(c);
    let code = source.lines().map(|line| line.split("//").next().unwrap_or_default().trim());
    let code = code.filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ");
    let mut out = String::with_capacity(code.len());
    let mut rest = code.chars().peekable();
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

/// Words, and the single characters between them.
fn tokens(mut rest: &str) -> impl Iterator<Item = &str> {
    std::iter::from_fn(move || {
        let first = rest.chars().next()?;
        let length = if is_word(first) { rest.find(|c| !is_word(c)).unwrap_or(rest.len()) } else { first.len_utf8() };
        let (token, after) = rest.split_at(length);
        rest = after;
        Some(token)
    })
}

/// Short names for what is declared, the shortest for the most frequent. Constants and overrides, which are in capitals, and entry points
/// keep theirs: Rust knows them.
fn short_names<'a>(files: impl Iterator<Item = &'a str>) -> BTreeMap<String, String> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let (mut declared, mut kept) = (BTreeSet::new(), BTreeSet::new());
    kept.extend(OWN_NAMES.split_whitespace());
    for file in files {
        let mut before = ["", "", ""];
        let mut is_entry = false;
        for token in tokens(file) {
            *counts.entry(token).or_default() += 1;
            is_entry |= before[1] == "@" && ["compute", "vertex", "fragment"].contains(&before[2]);
            if ["fn", "let", "var", "struct"].contains(&before[1]) && before[2] == " " {
                if is_entry && before[1] == "fn" {
                    kept.insert(token);
                    is_entry = false;
                }
                declared.insert(token);
            }
            // The names of parameters, members and declarations with a type.
            if token == ":" {
                declared.insert(before[2]);
            }
            before = [before[1], before[2], token];
        }
    }
    let is_swizzle = |name: &str| name.len() <= 4 && name.chars().all(|c| "xyzwrgba".contains(c));
    let is_renamed = |name: &&str| {
        name.len() > 2 && !kept.contains(name) && !is_swizzle(name) && name.contains(|c: char| c.is_ascii_lowercase())
    };
    let mut renamed: Vec<&str> = declared.iter().copied().filter(is_renamed).collect();
    renamed.sort_by_key(|name| (Reverse(counts[name]), *name));
    let second = || ('A'..='Z').chain('0'..='9').map(Some);
    let letters = ('a'..='z').flat_map(|a| std::iter::once(None).chain(second()).map(move |b| (b.is_some(), a, b)));
    let mut short: Vec<(bool, char, Option<char>)> = letters.collect();
    short.sort_unstable();
    let short = short.into_iter().map(|(_, a, b)| std::iter::once(a).chain(b).collect::<String>());
    let unused = short.filter(|name| !counts.contains_key(name.as_str()));
    renamed.iter().map(|name| (*name).to_owned()).zip(unused).collect()
}
