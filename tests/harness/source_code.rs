//! The project's own source text, for tests about its structure: modules, what they import, names, lengths.

use anyhow::{Context, Result, ensure};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Tracked text files by their path from the root. Fails outside of a git clone.
pub fn tracked_files() -> Result<BTreeMap<String, String>> {
    let output = Command::new("git").args(["ls-files", "-z"]).current_dir(root()).output()?;
    ensure!(output.status.success(), "git ls-files failed: run these tests in a clone");
    let names = String::from_utf8(output.stdout)?;
    let read = |name: &str| Some((name.to_owned(), std::fs::read_to_string(root().join(name)).ok()?));
    let files: BTreeMap<_, _> = names.split('\0').filter(|name| !name.is_empty()).filter_map(read).collect();
    ensure!(files.len() > 50, "only {} tracked files", files.len());
    Ok(files)
}

/// Whether a file holds tests only.
pub fn is_test(name: &str) -> bool {
    let in_folder = |folder: &str| name.starts_with(&format!("{folder}/")) || name.contains(&format!("/{folder}/"));
    ["tests", "benches", "examples"].into_iter().any(in_folder) || name.ends_with("tests.rs")
}

/// The text before the first `#[cfg(test)] mod tests {`.
pub fn without_inline_tests(text: &str) -> &str {
    text.find("#[cfg(test)]\nmod tests {").map_or(text, |at| &text[..at])
}

/// One crate's modules: paths below the crate's root (empty for `lib.rs`), with their text.
#[derive(Debug, Default)]
pub struct CrateModules(BTreeMap<Vec<String>, String>);

impl CrateModules {
    /// The modules below `source` (a folder such as `protocol/src`), tests left out.
    pub fn new(files: &BTreeMap<String, String>, source: &str) -> Self {
        let module = |(name, text): (&String, &String)| {
            let file = name.strip_prefix(source)?.strip_prefix('/')?;
            let inner = file.strip_suffix(".rs")?;
            let mut path: Vec<String> = inner.split('/').map(str::to_owned).collect();
            if matches!(path.last().map(String::as_str), Some("lib" | "main" | "mod")) {
                path.pop();
            }
            let is_kept = !is_test(file) && !inner.ends_with("main");
            is_kept.then(|| (path, without_inline_tests(text).to_owned()))
        };
        Self(files.iter().filter_map(module).collect())
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no modules.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Which modules name which others, by any path in their code. A path from one module to another counts between the two
    /// siblings that have them: a parent and its children may name each other.
    pub fn imports(&self) -> Result<BTreeMap<&[String], BTreeSet<&[String]>>> {
        let mut imports: BTreeMap<&[String], BTreeSet<&[String]>> = BTreeMap::new();
        for (module, text) in &self.0 {
            let code = without_comments(text);
            let named = use_paths(&code)?.into_iter().chain(inline_paths(&code));
            for path in named.filter_map(|path| self.absolute(module, &path)) {
                let target = self.deepest_module(&path);
                let common = module.iter().zip(target).take_while(|(a, b)| a == b).count();
                if let (Some(from), Some(to)) = (module.get(..=common), target.get(..=common)) {
                    imports.entry(from).or_default().insert(to);
                }
            }
        }
        Ok(imports)
    }

    /// `path` from the crate's root; `None` for other crates.
    fn absolute(&self, module: &[String], path: &[String]) -> Option<Vec<String>> {
        let (first, rest) = path.split_first()?;
        match first.as_str() {
            "crate" => Some(rest.to_vec()),
            "self" => Some([module, rest].concat()),
            "super" => absolute_super(module, path),
            child => {
                let of_child = [module, &[child.to_owned()]].concat();
                self.0.contains_key(&of_child).then(|| [module, path].concat())
            }
        }
    }

    fn deepest_module(&self, path: &[String]) -> &[String] {
        let known = (0..=path.len()).rev().find_map(|length| self.0.get_key_value(&path[..length]));
        known.map_or(&[], |(module, _)| &module[..])
    }

    /// A circle of imports, if there is one: each module imports from the next.
    pub fn import_circle(&self) -> Result<Option<Vec<String>>> {
        let imports = self.imports()?;
        let mut done = BTreeSet::new();
        for start in imports.keys() {
            let mut path = Vec::new();
            if let Some(circle) = visit(start, &imports, &mut path, &mut done) {
                return Ok(Some(circle.iter().map(|module| module.join("::")).collect()));
            }
        }
        Ok(None)
    }
}

/// Depth-first search; a module that is met again on the current path closes a circle.
fn visit<'a>(
    module: &'a [String],
    imports: &BTreeMap<&'a [String], BTreeSet<&'a [String]>>,
    path: &mut Vec<&'a [String]>,
    done: &mut BTreeSet<&'a [String]>,
) -> Option<Vec<&'a [String]>> {
    if let Some(at) = path.iter().position(|known| *known == module) {
        return Some(path[at..].to_vec());
    }
    if done.contains(module) {
        return None;
    }
    path.push(module);
    let circle = imports.get(module).into_iter().flatten().find_map(|next| visit(next, imports, path, done));
    path.pop();
    done.insert(module);
    circle
}

fn absolute_super(module: &[String], path: &[String]) -> Option<Vec<String>> {
    let ups = path.iter().take_while(|part| *part == "super").count();
    Some([module.get(..module.len().checked_sub(ups)?)?, &path[ups..]].concat())
}

/// Every path that the `use` declarations of a file name, groups expanded.
fn use_paths(text: &str) -> Result<Vec<Vec<String>>> {
    let mut paths = Vec::new();
    let mut rest = text;
    while let Some(at) = find_use(rest) {
        let body = &rest[at..];
        let end = body.find(';').context("a use declaration without an end")?;
        expand(&[], &body[..end], &mut paths);
        rest = &body[end..];
    }
    Ok(paths)
}

/// Every path from the crate, a module or its parents outside of `use` declarations.
fn inline_paths(text: &str) -> Vec<Vec<String>> {
    let is_in_word = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let mut words = text.split(|c: char| !is_in_word(c));
    let from_here = |word: &&str| ["crate::", "super::", "self::"].iter().any(|start| word.starts_with(start));
    let path = |word: &str| word.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect();
    words.by_ref().filter(from_here).map(path).collect()
}

/// The code without what follows `//` on each line, except in addresses.
fn without_comments(text: &str) -> String {
    let end = |line: &str| line.match_indices("//").map(|(at, _)| at).find(|at| !line[..*at].ends_with(':'));
    text.lines().flat_map(|line| [&line[..end(line).unwrap_or(line.len())], "\n"]).collect()
}

/// Where the tree of the next `use` declaration begins: after `use ` at the start of a line, indented or public or not.
fn find_use(text: &str) -> Option<usize> {
    let mut from = 0;
    loop {
        let at = from + text[from..].find("use ")?;
        let line = text[..at].rfind('\n').map_or(0, |newline| newline + 1);
        let before = text[line..at].trim();
        if before.is_empty() || before == "pub" || before.starts_with("pub(") && before.ends_with(')') {
            return Some(at + "use ".len());
        }
        from = at + 1;
    }
}

fn expand(prefix: &[String], tree: &str, paths: &mut Vec<Vec<String>>) {
    let tree = tree.trim();
    let (head, group) = match tree.find('{') {
        Some(at) => (&tree[..at], tree[at + 1..].trim_end().strip_suffix('}')),
        None => (tree, None),
    };
    let parts = head.split("::").map(|part| part.split_whitespace().next().unwrap_or_default());
    let path: Vec<String> =
        prefix.iter().cloned().chain(parts.filter(|part| !part.is_empty()).map(str::to_owned)).collect();
    let Some(group) = group else { return paths.push(path) };
    let (mut depth, mut start) = (0, 0);
    for (at, letter) in group.char_indices().chain([(group.len(), ',')]) {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                if !group[start..at].trim().is_empty() {
                    expand(&path, &group[start..at], paths);
                }
                start = at + 1;
            }
            _ => {}
        }
    }
}

/// Names of types and traits, with the files that define each; tests left out.
pub fn type_definitions(files: &BTreeMap<String, String>) -> BTreeMap<String, Vec<String>> {
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (name, text) in files.iter().filter(|(name, _)| name.ends_with(".rs") && !is_test(name)) {
        for line in without_inline_tests(text).lines() {
            if let Some(defined) = defined_type(line) {
                found.entry(defined.to_owned()).or_default().push(name.clone());
            }
        }
    }
    found
}

fn defined_type(line: &str) -> Option<&str> {
    let mut words = line.split_whitespace().skip_while(|word| word.starts_with("pub") || *word == "unsafe");
    let keyword = words.next()?;
    let name = words.next()?.split(|c: char| !c.is_alphanumeric() && c != '_').next()?;
    let is_type = ["struct", "enum", "trait", "union"].contains(&keyword);
    (is_type && name.starts_with(|c: char| c.is_ascii_uppercase())).then_some(name)
}

/// Name and number of lines of each function in formatted Rust or WGSL.
pub fn function_lengths(text: &str) -> Vec<(String, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let length = |(at, line): (usize, &&str)| {
        let name = function_name(line)?;
        if line.trim_end().ends_with(['}', ';']) {
            return Some((name.to_owned(), 1));
        }
        let indent = &line[..line.len() - line.trim_start().len()];
        let end = lines[at..].iter().position(|l| l.strip_prefix(indent).is_some_and(|l| l.starts_with('}')))?;
        Some((name.to_owned(), end + 1))
    };
    lines.iter().enumerate().filter_map(length).collect()
}

fn function_name(line: &str) -> Option<&str> {
    let line = line.trim_start();
    let is_prefix = |word: &&str| word.starts_with("pub") || ["const", "async", "unsafe", "extern"].contains(word);
    let mut words = line.split_whitespace().skip_while(is_prefix);
    (words.next()? == "fn").then_some(())?;
    words.next()?.split(['(', '<']).next()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn modules(files: &[(&str, &str)]) -> CrateModules {
        let files = files.iter().map(|(name, text)| (format!("a/src/{name}"), (*text).to_owned())).collect();
        CrateModules::new(&files, "a/src")
    }

    #[test]
    fn circles_are_found_between_siblings_at_any_depth() {
        let open = [("lib.rs", "mod b; mod c;"), ("b.rs", "use crate::c::X;"), ("c/mod.rs", ""), ("c/d.rs", "")];
        assert_eq!(modules(&open).import_circle().unwrap(), None);
        let closed = |text: &'static str| {
            let mut files = open;
            files[3].1 = text;
            modules(&files).import_circle().unwrap()
        };
        // `b` names `c`, and a child of `c` names `b`: in a group, in the code, not in a comment.
        assert!(closed("use std::fmt;\npub(crate) use crate::{\n    b::{self, Y as Z},\n};").is_some());
        assert!(closed("fn f() {\n    super::super::b::y();\n}").is_some());
        assert!(closed("// See crate::b::Y.\nconst HOST: &str = \"http://crate\";").is_none());
        let child_and_parent = [("c/mod.rs", "mod d;\nuse d::X;"), ("c/d.rs", "use super::Y;"), ("c/e.rs", "")];
        assert_eq!(modules(&child_and_parent).import_circle().unwrap(), None, "a child may use its parent");
        let children = [("c/mod.rs", ""), ("c/d.rs", "use super::e::Y;"), ("c/e.rs", "use crate::c::d::X;")];
        assert_eq!(modules(&children).import_circle().unwrap().unwrap(), ["c::d", "c::e"]);
    }

    #[test]
    fn functions_and_types_are_measured() {
        let text = "pub struct A;\nimpl A {\n    pub(crate) async fn b(\n        &self,\n    ) {\n        x()\n    }\n\n    fn c() {}\n}\n";
        assert_eq!(function_lengths(text), [("b".to_owned(), 5), ("c".to_owned(), 1)]);
        assert_eq!(defined_type("pub(crate) enum Kind<T> {"), Some("Kind"));
        assert_eq!(defined_type("    let struct_ = 1;"), None);
    }
}
