//! Joins modules of the page into one file for each entry, so that a browser makes few requests, one after the other.
//!
//! Each module becomes a function that is called once and returns what the module exports. That covers what the page's modules use:
//! named imports from `./NAME.js` at the beginning of a line, values of `./NAME.json`, and exported functions, classes and constants.
//! Anything else is an error. Modules that are not of the page are imported as they are. Comments on lines of their own and indentation
//! are left out of all scripts.

use crate::{asset_files::AssetFiles, error::BundleError};
use std::fmt::Write;

/// Modules that the page, a page of others or a worker starts with, and the files that they become.
const ENTRIES: [(&str, &str); 13] = [
    ("app.js", "app.js"),
    ("insula-viewer.js", "insula-city.js"),
    // The page imports them once they are needed.
    ("controls.js", "controls.js"),
    ("analysis-view.js", "analysis-view.js"),
    ("draped-figures.js", "draped-figures.js"),
    ("proposal-view.js", "proposal-view.js"),
    ("engine.js", "engine.js"),
    ("helper.js", "helper.js"),
    ("caster.js", "insula-caster.js"),
    ("maplibre-layer.js", "insula-maplibre.js"),
    ("three-object.js", "insula-three.js"),
    ("cast-engine.js", "cast-engine.js"),
    ("model-reader.js", "model-reader.js"),
];
/// Entries that another one imports while it runs, and that one: they take the modules that it has from it.
const CONTINUED: [(&str, &str); 1] = [("controls.js", "app.js")];
/// How the names of scripts begin that wasm-bindgen makes; several entries share them.
const EXTERNAL: &str = "insula_web";
/// Texts of the server's own pages, which no script needs.
const SERVER_TEXTS: (&str, &str) = ("language-en.json", "site");
/// Scripts that browsers fetch by themselves.
const SEPARATE: [&str; 1] = ["service-worker.js"];

/// Replaces the entries by what they import, joined, and drops the other modules. Entries that the page lacks are left out.
pub(crate) fn join(files: AssetFiles) -> Result<AssetFiles, BundleError> {
    let mut joined = AssetFiles::new();
    for (entry, file) in ENTRIES.into_iter().filter(|(entry, _)| files.contains_key(*entry)) {
        let base = CONTINUED.iter().find(|(continued, _)| *continued == entry).map(|(_, base)| *base);
        let mut joiner = Joiner::new(&files);
        if let Some(base) = base {
            joiner.given = Joiner::new(&files).modules_of(base)?;
        }
        let exports = joiner.add(entry)?;
        let mut text = joiner.externals.concat();
        if let Some(base) = base.filter(|_| !joiner.taken.is_empty()) {
            let _ = writeln!(text, "import {{ {} }} from './{base}';", variables(&joiner.taken));
        }
        text += &joiner.out;
        if !exports.is_empty() {
            let _ = writeln!(text, "export const {{ {} }} = {};", exports.join(", "), variable(entry));
        }
        for (continued, _) in CONTINUED.iter().filter(|(name, base)| *base == entry && files.contains_key(*name)) {
            let mut other = Joiner::new(&files);
            other.given.clone_from(&joiner.begun);
            other.add(continued)?;
            if !other.taken.is_empty() {
                let _ = writeln!(text, "export {{ {} }};", variables(&other.taken));
            }
        }
        joined.insert(file.to_owned(), without_line_ends(&text).into_bytes());
    }
    let is_kept = |name: &str| !name.ends_with(".js") || name.starts_with(EXTERNAL) || SEPARATE.contains(&name);
    for (name, content) in files.iter().filter(|(name, _)| is_kept(name)) {
        let text = std::str::from_utf8(content).ok().filter(|_| name.ends_with(".js") || name.ends_with(".css"));
        let text = text
            .map(without_comments)
            .map(|text| if name.ends_with(".css") { without_spaces(&text) } else { without_line_ends(&text) });
        let content = text.map_or_else(|| content.clone(), String::into_bytes);
        joined.insert(name.clone(), content);
    }
    Ok(joined)
}

struct Joiner<'a> {
    files: &'a AssetFiles,
    begun: Vec<String>,
    /// Modules that another script has, and those of them that are taken from it.
    given: Vec<String>,
    taken: Vec<String>,
    /// Imports of modules that stay separate.
    externals: Vec<String>,
    out: String,
}

#[derive(Default)]
struct Module {
    /// What each import takes, and the file that it takes it from.
    imports: Vec<(String, String)>,
    exports: Vec<String>,
    body: String,
}

impl<'a> Joiner<'a> {
    fn new(files: &'a AssetFiles) -> Self {
        let (begun, given, taken, externals) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { files, begun, given, taken, externals, out: String::new() }
    }

    /// The modules that the script of an entry has.
    fn modules_of(mut self, entry: &str) -> Result<Vec<String>, BundleError> {
        self.add(entry)?;
        Ok(self.begun)
    }

    /// Adds a module after those that it imports. Returns the names of its exports.
    fn add(&mut self, name: &str) -> Result<Vec<String>, BundleError> {
        let failed = |reason: &str| BundleError::Asset(format!("{name}: {reason}"));
        let content = self.files.get(name).ok_or_else(|| failed("a module imports it, and there is no such file"))?;
        let text = std::str::from_utf8(content).map_err(|_| failed("not UTF-8"))?;
        let module = Module::parse(&without_comments(text)).map_err(|reason| failed(&reason))?;
        if self.begun.iter().any(|begun| begun == name) {
            return Ok(module.exports);
        }
        if self.given.iter().any(|given| given == name) {
            if !self.taken.iter().any(|taken| taken == name) {
                self.taken.push(name.to_owned());
            }
            return Ok(module.exports);
        }
        self.begun.push(name.to_owned());
        let mut head = String::new();
        for (names, from) in &module.imports {
            if from.starts_with(EXTERNAL) {
                let line = format!("import {names} from './{from}';\n");
                if !self.externals.contains(&line) {
                    self.externals.push(line);
                }
                continue;
            }
            if from.ends_with(".json") {
                let _ = writeln!(head, "const {names} = {};", self.json(from).map_err(|reason| failed(&reason))?);
                continue;
            }
            self.add(from)?;
            if !names.is_empty() {
                let _ = writeln!(head, "const {} = {};", names.replace(" as ", ": "), variable(from));
            }
        }
        let Module { exports, body, .. } = module;
        let _ = writeln!(
            self.out,
            "const {} = (() => {{\n{head}{body}return {{ {} }};\n}})();",
            variable(name),
            exports.join(", ")
        );
        Ok(exports)
    }

    /// The value of a JSON file, without spaces. JSON is JavaScript.
    fn json(&self, name: &str) -> Result<String, String> {
        let content = self.files.get(name).ok_or_else(|| format!("it imports {name}, and there is no such file"))?;
        let mut value: serde_json::Value =
            serde_json::from_slice(content).map_err(|error| format!("{name}: {error}"))?;
        if let Some(texts) = value.as_object_mut().filter(|_| name == SERVER_TEXTS.0) {
            texts.remove(SERVER_TEXTS.1);
        }
        Ok(value.to_string())
    }
}

/// The variable that holds a module's exports. No module has a name that begins so.
fn variable(name: &str) -> String {
    format!("module_{}", name.trim_end_matches(".js").replace(['-', '.'], "_"))
}

fn variables(modules: &[String]) -> String {
    modules.iter().map(|name| variable(name)).collect::<Vec<_>>().join(", ")
}

impl Module {
    fn parse(text: &str) -> Result<Self, String> {
        let mut module = Self::default();
        let mut lines = text.lines();
        while let Some(line) = lines.next() {
            if line.starts_with("import ") {
                let mut statement = line.to_owned();
                while !statement.ends_with(';') {
                    statement += " ";
                    statement += lines.next().ok_or("an import does not end with ;")?.trim();
                }
                module.imports.push(import_of(&statement)?);
            } else if let Some(rest) = line.strip_prefix("export ") {
                module.exports.push(exported(rest)?);
                module.push(rest);
            } else {
                module.push(line);
            }
        }
        Ok(module)
    }

    fn push(&mut self, line: &str) {
        self.body += line;
        self.body.push('\n');
    }
}

/// A script or style sheet without indentation, empty lines, and comments that begin a line: a fifth of its compressed size. In strings of several
/// lines they go as well, which only style sheets are here.
fn without_comments(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut is_comment = false;
    for line in text.lines() {
        let mut line = line.trim_start();
        while is_comment || line.starts_with("/*") {
            let end = line.split_once("*/");
            is_comment = end.is_none();
            let Some((_, rest)) = end else { break };
            line = rest.trim_start();
        }
        if !is_comment && !line.is_empty() && !line.starts_with("//") {
            out += &without_types(line);
            out.push('\n');
        }
    }
    out
}

/// A script without line ends that mean nothing: those behind these signs. A line end may also end a comment.
fn without_line_ends(script: &str) -> String {
    let mut out = String::with_capacity(script.len());
    for line in script.lines() {
        out += line;
        if line.contains("//") || !line.ends_with([';', '{', ',', '(', '[']) {
            out.push('\n');
        }
    }
    out
}

fn without_types(mut line: &str) -> String {
    let mut out = String::with_capacity(line.len());
    while let Some((before, after)) = line.split_once("/** @type ") {
        let Some((_, rest)) = after.split_once("*/ ") else { break };
        out += before;
        line = rest;
    }
    out + line
}

/// A style sheet without spaces that mean nothing. Before a colon, they are part of a selector. Texts in it have none.
fn without_spaces(style: &str) -> String {
    let mut out = String::with_capacity(style.len());
    for word in style.split_whitespace() {
        if !out.is_empty() && !out.ends_with(['{', '}', ';', ',', ':']) && !word.starts_with(['{', '}']) {
            out.push(' ');
        }
        out += word;
    }
    out
}

/// What `import NAMES from './FILE';`, `import NAME from './FILE.json' with { type: 'json' };` or `import './FILE';` takes, and from
/// where.
fn import_of(statement: &str) -> Result<(String, String), String> {
    let unknown = || format!("an import that cannot be joined: {statement}");
    let rest = statement.trim_start_matches("import ").trim_end_matches(';');
    let (rest, is_json) = rest.strip_suffix(" with { type: 'json' }").map_or((rest, false), |rest| (rest, true));
    let (names, from) = rest.rsplit_once("from ").unwrap_or(("", rest));
    let file = from.trim().trim_matches(['\'', '"']).strip_prefix("./").ok_or_else(unknown)?;
    let names = names.trim();
    let is_list = names.starts_with('{') && names.ends_with('}');
    let is_name = !names.is_empty() && names.bytes().all(|b| b.is_ascii_alphanumeric());
    if is_json != file.ends_with(".json") {
        return Err(unknown());
    }
    if is_list || names.is_empty() || file.starts_with(EXTERNAL) || (is_json && is_name) {
        Ok((names.to_owned(), file.to_owned()))
    } else {
        Err(unknown())
    }
}

/// The name of `function NAME(...`, `class NAME ...` or `const NAME = ...`.
fn exported(declaration: &str) -> Result<String, String> {
    let kinds = ["async function* ", "async function ", "function* ", "function ", "class ", "const "];
    let name = kinds.iter().find_map(|kind| declaration.strip_prefix(kind));
    let is_part = |c: char| c.is_alphanumeric() || c == '_' || c == '$';
    let name: String = name.unwrap_or_default().chars().take_while(|c| is_part(*c)).collect();
    if name.is_empty() { Err(format!("an export that cannot be joined: export {declaration}")) } else { Ok(name) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may panic")]
mod tests {
    use super::*;

    fn files(list: &[(&str, &str)]) -> AssetFiles {
        list.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect()
    }

    #[test]
    fn modules_come_once_and_after_what_they_import() {
        let all = files(&[
            (
                "app.js",
                "/** The page.\n * Of many lines. */\nimport init, { A } from './insula_web.js';\nimport more, { O } from './insula_web_objects.js';\nimport { a } from './a.js';\nimport {\n  b as c,\n} from './b.js';\nstart(a, c);\nexport class App {}\n",
            ),
            ("a.js", "import { b } from './b.js';\n// Why.\n/** @type {B} */ const d = b;\nexport const a = d;\n"),
            ("b.js", "export function b() { return /** @type {B} */ (1); }\n"),
            ("insula_web.js", "export class A {\n    /**\n     * What.\n     */\n\n    /* a */ /* b\n*/ b() {}\n}\n"),
            ("insula_web_objects.js", "export class O {}\n"),
            ("style.css", "/* Why. */\n\na {\n  b: c;\n}\n"),
        ]);
        let joined = join(all).unwrap();
        let names: Vec<_> = joined.keys().map(String::as_str).collect();
        assert_eq!(names, ["app.js", "insula_web.js", "insula_web_objects.js", "style.css"]);
        assert_eq!(String::from_utf8(joined["style.css"].clone()).unwrap(), "a{b:c;}");
        let expected = "import init, { A } from './insula_web.js';import more, { O } from './insula_web_objects.js';\
            const module_b = (() => {function b() { return (1); }\nreturn { b };})();\
            const module_a = (() => {const { b } = module_b;const d = b;const a = d;return { a };})();\
            const module_app = (() => {const { a } = module_a;const { b: c, } = module_b;start(a, c);class App {}\n\
            return { App };})();export const { App } = module_app;";
        assert_eq!(String::from_utf8(joined["app.js"].clone()).unwrap(), expected);
        assert_eq!(String::from_utf8(joined["insula_web.js"].clone()).unwrap(), "export class A {b() {}\n}\n");
    }

    #[test]
    fn a_continued_script_takes_modules_from_its_base() {
        let all = files(&[
            ("app.js", "import { a } from './a.js';\na();\nimport('./controls.js');\n"),
            ("controls.js", "import { a } from './a.js';\nimport { b } from './b.js';\nexport const c = a(b);\n"),
            ("a.js", "export function a() {}\n"),
            ("b.js", "import { a } from './a.js';\nexport const b = a();\n"),
        ]);
        let joined = join(all).unwrap();
        let text = |name: &str| String::from_utf8(joined[name].clone()).unwrap();
        let app = text("app.js");
        assert!(app.ends_with("export { module_a };") && !app.contains("module_b"), "{app}");
        let controls = text("controls.js");
        assert!(controls.starts_with("import { module_a } from './app.js';const module_b ="), "{controls}");
        assert_eq!(controls.matches("module_a =").count(), 0, "{controls}");
        assert!(controls.ends_with("export const { c } = module_controls;"), "{controls}");
    }

    #[test]
    fn values_of_json_are_part_of_the_script() {
        let text = "import a from './a.json' with { type: 'json' };\nexport const b = a;\n";
        let joined = join(files(&[("app.js", text), ("a.json", "{ \"c\":\n [1, \"d\"] }")])).unwrap();
        let script = String::from_utf8(joined["app.js"].clone()).unwrap();
        assert!(script.contains("const a = {\"c\":[1,\"d\"]};const b = a;"), "{script}");
        assert!(joined.contains_key("a.json"));
        for damaged in ["{", ""] {
            assert!(join(files(&[("app.js", text), ("a.json", damaged)])).is_err(), "{damaged}");
        }
        assert!(join(files(&[("app.js", "import a from './a.json';"), ("a.json", "1")])).is_err());
    }

    #[test]
    fn texts_of_the_server_are_in_no_script() {
        let text = "import a from './language-en.json' with { type: 'json' };\n";
        let language = r#"{ "site": { "b": "c" }, "d": "e" }"#;
        let joined = join(files(&[("app.js", text), ("language-en.json", language)])).unwrap();
        let script = String::from_utf8(joined["app.js"].clone()).unwrap();
        assert!(script.contains("const a = {\"d\":\"e\"};"), "{script}");
        assert_eq!(joined["language-en.json"], language.as_bytes());
    }

    #[test]
    fn what_cannot_be_joined_is_an_error() {
        for text in [
            "import { a } from './missing.js';", "import a from './b.js';", "import { a } from 'react';",
            "export default 1;", "export let a = 1;", "import { a }",
        ] {
            assert!(join(files(&[("app.js", text), ("b.js", "")])).is_err(), "{text}");
        }
    }
}
