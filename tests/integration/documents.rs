//! The commands of the documents: those that name a program are ones that it takes, and fences that begin with "sh" run, page by page, as
//! they stand there. A fence of "sh needs ..." says what a test lacks for it.

use anyhow::{Context, Result, bail, ensure};
use clap::Parser;
use insula_client::args::Cli;
use insula_protocol::mesh_tile::MAX_LODS;
use insula_server::args::Args;
use insula_server::page::ViewerAssets;
use insula_test_support::programs::{ServerProcess, find_installed, program, run};
use insula_tests::source_code::{root, tracked_files};
use insula_tests::tests;
use insula_tests::trials::{Test, Trials};
use std::collections::BTreeSet;
use std::env;
use std::path::Path;
use std::process::Command;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        every_command_is_one_that_its_program_takes,
        the_doors_are_short_and_plain,
        pages_have_the_number_of_levels_of_the_code
    ]);
    let lacks_a_tool = ["bash", "curl", "openssl"].into_iter().any(|tool| find_installed(tool).is_none());
    let is_ignored = lacks_a_tool || cfg!(not(target_os = "linux"));
    trials.add([
        Test::new("commands_of_docs_run", || commands_run_as_they_stand(|page| page != "README.md"))
            .ignored_if(is_ignored),
        // It bakes a whole bundled city.
        Test::new("commands_of_readme_run", || commands_run_as_they_stand(|page| page == "README.md"))
            .ignored_if(is_ignored)
            .full_tier(),
    ]);
}

/// What a reader opens first. Their commands run in this order.
const DOORS: [&str; 4] = ["README.md", "docs/publish.md", "docs/draw.md", "docs/web.md"];
const MAX_README_WORDS: usize = 900;
/// Most commands of a page behind it.
const MAX_WALK: usize = 10;
/// Pages of measurements. Their commands take hours, and cities that are not bundled.
const MEASURED: [&str; 4] = ["docs/light.md", "docs/measurements.md", "docs/monuments.md", "docs/papers.md"];
/// What the commands of other pages begin with.
const PROGRAMS: [&str; 8] = ["cargo", "client/web/build", "curl", "docker", "git", "insula", "insula-server", "sudo"];
/// Where the documents' servers listen.
const ADDRESS: &str = "127.0.0.1:7700";

/// A fence: what stands behind its backticks, and its commands without comments.
#[derive(Debug)]
struct Fence<'a> {
    info: &'a str,
    commands: Vec<String>,
}

impl Fence<'_> {
    fn runs(&self) -> bool {
        self.info == "sh"
    }

    fn is_marked(&self) -> bool {
        self.runs() || self.info.starts_with("sh needs ")
    }
}

/// The fences of a page. Lines that end with a backslash go on in the next one.
fn fences(text: &str) -> Vec<Fence<'_>> {
    let mut fences: Vec<Fence<'_>> = Vec::new();
    let (mut is_open, mut goes_on) = (false, false);
    for line in text.lines() {
        if let Some(info) = line.strip_prefix("```") {
            (is_open, goes_on) = (!is_open, false);
            if is_open {
                fences.push(Fence { info, commands: Vec::new() });
            }
            continue;
        }
        let line = line.trim();
        let Some(fence) = fences.last_mut().filter(|_| is_open && !line.is_empty() && !line.starts_with('#')) else {
            continue;
        };
        let text = line.strip_suffix('\\').unwrap_or(line);
        match fence.commands.last_mut().filter(|_| goes_on) {
            Some(command) => command.push_str(text),
            None => fence.commands.push(text.to_owned()),
        }
        goes_on = text != line;
    }
    fences
}

/// The words of a shell's command, up to a comment, a pipe or another file.
fn words(command: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for letter in command.chars() {
        match letter {
            _ if quote == Some(letter) => quote = None,
            '\'' | '"' if quote.is_none() => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            ' ' if quote.is_none() => words.extend(word.take()),
            '#' if quote.is_none() && word.is_none() => break,
            '|' | '>' | '&' | ';' if quote.is_none() => break,
            _ => word.get_or_insert_default().push(letter),
        }
    }
    words.extend(word);
    words
}

/// The pages by name, those of the doors first.
fn pages() -> Result<Vec<(String, String)>> {
    let mut files = tracked_files()?;
    let mut pages = Vec::new();
    for door in DOORS {
        pages.push((door.to_owned(), files.remove(door).with_context(|| format!("{door} is missing"))?));
    }
    let is_page = |name: &str| name.starts_with("docs/") && name.ends_with(".md") && name.matches('/').count() == 1;
    pages.extend(files.into_iter().filter(|(name, _)| is_page(name)));
    Ok(pages)
}

fn every_command_is_one_that_its_program_takes() -> Result<()> {
    let mut count = 0;
    for (page, text) in pages()? {
        for fence in fences(&text) {
            for command in &fence.commands {
                let words = words(command);
                let first = words.first().map_or("", String::as_str);
                ensure!(
                    fence.is_marked() || MEASURED.contains(&page.as_str()) || !PROGRAMS.contains(&first),
                    "{page}: {command}: write ```sh, so that a test runs it, or ```sh needs WHAT"
                );
                let words = if first == "sudo" { &words[1..] } else { &words[..] };
                let parsed = match words.first().map(String::as_str) {
                    Some("insula") => Cli::try_parse_from(words).map(drop),
                    Some("insula-server") => Args::try_parse_from(words).map(drop),
                    _ => continue,
                };
                if let Err(error) = parsed {
                    bail!("{page}: {command}: {error}");
                }
                count += 1;
            }
        }
    }
    ensure!(count > 30, "only {count} commands in the documents");
    Ok(())
}

/// Citizens and planners read no word of the programs' inside.
fn the_doors_are_short_and_plain() -> Result<()> {
    for (page, text) in pages()?.into_iter().take(DOORS.len()) {
        let count = text.split_whitespace().count();
        ensure!(page != "README.md" || count <= MAX_README_WORDS, "README.md has {count} words");
        let commands: usize =
            fences(&text).iter().filter(|fence| fence.is_marked()).map(|fence| fence.commands.len()).sum();
        ensure!(commands <= MAX_WALK, "{page} has {commands} commands, {MAX_WALK} are allowed");
        let plain = text.to_lowercase().replace("3d tiles", "").replace("3d-tiles", "");
        for word in plain.split(|letter: char| !letter.is_alphanumeric()) {
            let is_ours = ["tau", "node", "nodes", "tile", "tiles", "quadtree", "lod"].contains(&word);
            ensure!(!is_ours, "{page} says {word}, which readers of this page do not know");
        }
    }
    Ok(())
}

/// One city serves all pages: a bake that an earlier page has is not run again.
fn commands_run_as_they_stand(is_wanted: fn(&str) -> bool) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let (mut baked, mut count) = (BTreeSet::new(), 0);
    #[cfg(unix)]
    std::os::unix::fs::symlink(root().join("client").canonicalize()?, folder.path().join("client"))?;
    for (page, text) in pages()?.into_iter().filter(|(page, _)| is_wanted(page)) {
        let mut server = None;
        for fence in fences(&text).into_iter().filter(Fence::runs) {
            for command in fence.commands {
                if !command.starts_with("insula-server bake ") || baked.insert(command.clone()) {
                    run_command(&command, folder.path(), &mut server).with_context(|| format!("{page}: {command}"))?;
                    count += 1;
                }
            }
        }
    }
    ensure!(count > 0, "no command to run");
    Ok(())
}

/// Runs a command. A server runs until the next one starts, at a free port, to which later commands go.
fn run_command(command: &str, folder: &Path, server: &mut Option<ServerProcess>) -> Result<()> {
    // This test is a part of all tests, and no site is published without the viewer.
    let has_no_viewer = command.starts_with("insula-server publish ") && ViewerAssets::embedded().is_none();
    if command.starts_with("cargo test ") || has_no_viewer {
        return Ok(());
    }
    if command.starts_with("insula-server serve ") && !command.contains("--print-config") {
        let mut process = Command::new(program("insula-server")?);
        process.current_dir(folder);
        *server = Some(ServerProcess::start_with(&mut process, &words(command)[2..], "127.0.0.1:0", &[])?);
        return Ok(());
    }
    let text = command.replace("cargo run --release -p insula-client --", "insula");
    let text = match server {
        Some(server) => text.replace(ADDRESS, &server.address.to_string()),
        None => text,
    };
    let programs = program("insula")?.parent().context("a program without a folder")?.to_owned();
    let installed = env::var_os("PATH").unwrap_or_default();
    let path = env::join_paths([programs].into_iter().chain(env::split_paths(&installed)))?;
    let mut shell = Command::new("bash");
    shell.args(["-euo", "pipefail", "-c", &text]).current_dir(folder).env("PATH", path).env("HOME", folder);
    shell.env("XDG_CACHE_HOME", folder.join("cache")).env("INSULA_ADAPTER", "cpu");
    shell.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("RUST_LOG");
    let output = run(&mut shell)?;
    let errors = String::from_utf8_lossy(&output.stderr);
    // A window is all that it lacks.
    let has_no_screen = command.starts_with("insula view ") && errors.contains("there is no screen");
    ensure!(output.status.success() || has_no_screen, "{}: {errors}", output.status);
    Ok(())
}

/// A leaf has so many levels of detail, wherever a page names their number.
fn pages_have_the_number_of_levels_of_the_code() -> Result<()> {
    let (most, last) = (MAX_LODS, MAX_LODS - 1);
    let pages = [
        (
            "docs/formats.md",
            vec![
                format!("the number of its levels of detail, 0 to {most}."),
                format!("u8: level of detail, 0 (finest) to {last};"),
                format!("| levels of detail of a leaf | {most} | `mesh_tile::MAX_LODS` |"),
                format!("`lod` 0 (finest) to {last} |"),
                format!("lod over {last}, "),
            ],
        ),
        ("docs/papers.md", vec![format!("A leaf has at most {most} meshes")]),
    ];
    for (page, sentences) in pages {
        let text = std::fs::read_to_string(root().join(page))?;
        for sentence in sentences {
            ensure!(text.contains(&sentence), "{page} lacks \"{sentence}\"");
        }
        let others = text.match_indices("leaf has at most ").map(|(at, words)| &text[at + words.len()..]);
        for number in others.filter_map(|rest| rest.split(" meshes").next().filter(|number| number.len() < 10)) {
            ensure!(number == most.to_string(), "{page}: a leaf has at most {number} meshes");
        }
    }
    Ok(())
}
