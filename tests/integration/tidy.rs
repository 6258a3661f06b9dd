//! Rules about the text of the repository.

use insula_tests::source_code::{is_test, tracked_files, without_inline_tests};
use insula_tests::tests;
use insula_tests::trials::Trials;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        stages_of_the_pipeline_exist, every_module_has_a_doc, public_items_have_docs, no_file_is_too_long,
        no_unfinished_work_is_marked, no_file_names_a_machine, tests_named_by_the_security_page_exist,
        links_between_pages_resolve
    ]);
}

const MAX_LINES: usize = 600;

fn is_source(name: &str) -> bool {
    name.ends_with(".rs") || name.ends_with(".wgsl")
}

/// Files of the pipeline's stages: the second column of the table in docs/architecture.md.
fn stages(architecture: &str) -> Vec<&str> {
    let table = architecture.split("\n## ").find(|section| section.starts_with("Data flow")).unwrap_or_default();
    let rows = table.lines().filter(|line| line.starts_with("| ") && line.contains(".rs`"));
    rows.filter_map(|row| row.split('|').nth(2)?.split('`').nth(1)).collect()
}

fn stages_of_the_pipeline_exist() {
    let files = tracked_files().unwrap();
    let stages = stages(&files["docs/architecture.md"]);
    assert!(stages.len() > 10, "only {} stages in docs/architecture.md", stages.len());
    for stage in stages {
        assert!(files.contains_key(stage), "docs/architecture.md names {stage}, which does not exist");
    }
}

fn every_module_has_a_doc() {
    for (name, text) in tracked_files().unwrap().into_iter().filter(|(name, _)| name.ends_with(".rs")) {
        assert!(text.starts_with("//!"), "{name} has no doc");
    }
}

/// Public items need a doc; fields and variants only where there is something to add, so `missing_docs` is off.
fn public_items_have_docs() {
    let items =
        ["fn ", "async fn ", "const fn ", "unsafe fn ", "struct ", "enum ", "trait ", "type ", "const ", "static "];
    for (name, text) in tracked_files().unwrap().into_iter().filter(|(name, _)| name.ends_with(".rs") && !is_test(name))
    {
        let mut last = "";
        for line in without_inline_tests(&text).lines().map(str::trim).filter(|line| !line.is_empty()) {
            let item = line.strip_prefix("pub ").filter(|rest| items.iter().any(|item| rest.starts_with(item)));
            // A macro gives items with a name of its own their docs.
            let is_documented = last.starts_with("///") || last.starts_with("#[doc") || line.contains(" $name");
            assert!(item.is_none() || is_documented, "{name}: no doc: {line}");
            // Attributes stand between the doc and the item.
            if !line.starts_with("#[") && !line.ends_with(")]") {
                last = line;
            }
        }
    }
}

fn no_file_is_too_long() {
    for (name, text) in tracked_files().unwrap().into_iter().filter(|(name, _)| is_source(name)) {
        let lines = text.lines().count();
        assert!(lines <= MAX_LINES, "{name} has {lines} lines, {MAX_LINES} are allowed: split it");
    }
}

fn no_unfinished_work_is_marked() {
    for (name, text) in tracked_files().unwrap() {
        for word in [concat!("TO", "DO"), concat!("FIX", "ME"), concat!("XX", "X:"), concat!("dbg", "!(")] {
            assert!(!text.contains(word), "{name} says {word}");
        }
    }
}

/// Paths and hosts that exist on one machine or network only.
fn no_file_names_a_machine() {
    let banned = [
        concat!("/wo", "rk/"),
        concat!("/ro", "ot/"),
        concat!("/ho", "me/"),
        concat!("arti", "factory"),
        concat!("index.crates", ".io:"),
    ];
    for (name, text) in tracked_files().unwrap() {
        for word in banned {
            let line = text.lines().position(|line| line.contains(word) && !line.contains("github.com"));
            assert!(line.is_none(), "{name}:{} names {word}", line.unwrap_or_default() + 1);
        }
    }
}

/// The names in backticks without a path or an option.
fn quoted_names(text: &str) -> impl Iterator<Item = &str> {
    let is_name = |name: &&str| name.contains('_') && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    text.split('`').skip(1).step_by(2).filter(is_name)
}

fn tests_named_by_the_security_page_exist() {
    let files = tracked_files().unwrap();
    let sources: String =
        files.iter().filter(|(name, _)| name.ends_with(".rs")).map(|(_, text)| text.as_str()).collect();
    let mut count = 0;
    for name in quoted_names(&files["SECURITY.md"]) {
        assert!(sources.contains(&format!("fn {name}(")), "SECURITY.md names the test {name}, which does not exist");
        count += 1;
    }
    assert!(count > 40, "only {count} tests in SECURITY.md");
}

/// The names by which links reach the headings of a page.
fn anchors(text: &str) -> Vec<String> {
    let headings = text.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim());
    let is_kept = |letter: &char| letter.is_alphanumeric() || "-_ ".contains(*letter);
    headings
        .map(|heading| heading.to_lowercase().chars().filter(is_kept).collect::<String>().replace(' ', "-"))
        .collect()
}

fn links_between_pages_resolve() {
    let files = tracked_files().unwrap();
    for (name, text) in files.iter().filter(|(name, _)| name.ends_with(".md")) {
        let links = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for link in links.filter(|link| !link.contains("://") && !link.contains(' ')) {
            let (target, anchor) = link.split_once('#').unwrap_or((link, ""));
            let folder = std::path::Path::new(name).parent().unwrap();
            let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
            let path = if target.is_empty() { root.join(name) } else { root.join(folder).join(target) };
            assert!(path.exists(), "{name} links to {target}, which does not exist");
            if !anchor.is_empty() && path.extension().is_some_and(|extension| extension == "md") {
                let found = anchors(&std::fs::read_to_string(&path).unwrap());
                assert!(
                    found.iter().any(|heading| heading == anchor),
                    "{name} links to {link}, a heading that does not exist"
                );
            }
        }
    }
}
