//! Sequences of commands of both programs, in random order and with random paths, in a folder with files and links of somebody else:
//! nothing of these changes or goes, also if a command is killed.
//!
//! `INSULA_SEQUENCES` is the number of sequences, and `INSULA_SEED` the number of the first. A failure names its number, with which
//! the sequence alone is tried again.

use super::file_safety::{TOWN, Workplace, tree};
use insula_test_support::rng::Rng;
use insula_test_support::tier;
use insula_tests::tests;
use insula_tests::trials::Trials;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![random_commands_leave_the_files_of_others_alone]);
}

/// All commands that write, remove or rename. DIR, IN and OUT.EXTENSION are paths.
pub(crate) const COMMANDS: [&str; 54] = [
    "bake IN --out DIR --cell 8 --views 32 --no-street-sets --no-picture",
    "bake IN --out DIR --cell 8 --views 32 --no-street-sets --no-picture",
    "bake IN --out DIR --cell 8 --views 32 --no-street-sets --update --report OUT.json",
    "bake IN --out DIR --cell 4 --views 32 --no-picture --resume",
    "bake plan --inputs IN --work DIR --cell 8",
    "bake plan --inputs IN --work DIR --cell 4 --update",
    "bake scan 0 --work DIR",
    "bake plan --work DIR",
    "bake shuffle 0 --work DIR",
    "bake region 0 --work DIR",
    "bake crown --work DIR",
    "bake join plan --work DIR",
    "bake join part 0 --work DIR",
    "bake join finish --work DIR",
    "bake abort --work DIR",
    "publish DIR --out DIR",
    "publish city --out DIR --tileset",
    "export DIR --format 3dtiles --out DIR",
    "export city --format 3dtiles --out DIR",
    "export city --format 3dtiles --plain --out DIR",
    "export city --format 3dtiles --out OUT.3tz",
    "export city --format 3dtiles --out OUT.pmtiles",
    "export DIR --format csv --out OUT.csv",
    "export city --format geojson --out OUT.geojson",
    "export city --format geoparquet --out OUT.parquet",
    "export city --format flatgeobuf --out OUT.fgb",
    "export city --format cityjsonseq --out OUT.jsonl",
    "export city --format geotiff --out OUT.tif",
    "analyse city sky --out OUT.tif --buildings OUT.csv",
    "analyse city sun --rule en-17037 --out OUT.tif",
    "analyse city sun --rule en-17037 --points points.csv --out OUT.csv --evidence DIR",
    "analyse city sky --out OUT.tif --pdf OUT.pdf",
    "analyse city view --height 9 --out OUT.tif --of IN",
    "analyse city shadow --time 2025-06-21T10:00 --time 2025-06-21T12:00 --out OUT.tif --pdf OUT.pdf",
    "analyse city sky --proposal plan.toml --out OUT.tif --buildings OUT.fgb",
    "analyse city view --between points.csv points.csv --out OUT.csv",
    "changes DIR city --out OUT.csv",
    "changes city DIR --all --out OUT.fgb",
    "export DIR --format glb --out OUT.glb",
    "inspect DIR --tile 0/0/0 --png OUT.png",
    "inspect DIR --volume 0/0/0 --png OUT.png --ply OUT.ply",
    "compress IN OUT.insm",
    "decompress a.insm OUT.ply",
    "simplify IN OUT.off --ratio 0.5",
    "compare IN b.off --samples 9 --heatmap OUT.ply",
    "ao IN --views 16 --map 64 --out OUT.ply",
    "man --out DIR",
    "insula man --out DIR",
    "SNAPSHOT --server DIR --out OUT.png --report OUT.json --distance OUT.pfm --radiance OUT.pfm",
    "SNAPSHOT --server city --out OUT.jpg --objects OUT.bin --objects-json OUT.json",
    "SNAPSHOT --server city --proposal plan.toml --out OUT.webp",
    "insula fly --server city --path path.json --size 16x12 --adapter cpu --report OUT.json",
    "insula draw DIR --plan --out OUT.svg",
    "insula draw IN --plan --out OUT.pdf",
];
const SNAPSHOT: &str = "insula snapshot --camera camera.json --size 16x12 --adapter cpu";
/// Where somebody may put a file.
const FOREIGN: [&str; 22] = [
    "a/notes.txt", "a/job.json", "a/thumbnail.jpg", "a/plan/notes.txt", "a/tiles/holiday.png", "a/list/notes.txt",
    "b/scan/0/My photo.png", "b/city/impressum.html", "b/assets/mine/holiday.png", "b/temporary/mine.txt",
    "c/insula-site.json", "c/cities/town/impressum.html", "c/search.index", "c/tileset.json", "c/content/0/0/0.glb",
    "city/holiday.jpg", "a.partial/mine.txt", "a.partial/packs/mine.pack", "c.partial/city/mine.tmp",
    ".a.publish/new/mine.html", ".b.publish/lock", "b.job",
];
/// Links that somebody made, and where they lead.
const LINKS: [(&str, &str); 4] =
    [("link", "mine"), ("b/link", "../mine"), ("c/insula-work", "../mine/diary.txt"), ("loop", "loop")];
const DIRECTORIES: [&str; 10] = ["a", "b", "c", "a/city", "b/city", "c/cities/town", "city", "work", "link", "."];
const INPUTS: [&str; 8] =
    ["town.geojson", "a.off", "in", "in/*.geojson", "*/part.geojson", "a/in.geojson", "thesis.ply", "link"];
/// Names of outputs, to which their extensions are added.
const OUTPUTS: [&str; 10] =
    ["out", "out", "thesis", "to-thesis", "to-none", "a/out", "city/new", "work/scan/new", "in/new", "link/new"];
/// Outputs whose names say something else.
const FALSE_OUTPUTS: [&str; 8] = [
    "a/city.json", "city/meshes.pmtiles", "b/job.json", "work/job.json", "town.geojson", "in/part.geojson",
    "c/insula-site.json", "mine/diary.txt",
];
/// Largest time after which a command is killed, in milliseconds.
const MAX_KILL_MS: usize = 400;

/// What somebody has at a path: the bytes of a file, or where a link leads.
#[derive(Debug, PartialEq)]
enum Possession {
    File(Vec<u8>),
    Link(PathBuf),
}

fn found(path: &Path) -> Option<Possession> {
    let kind = path.symlink_metadata().ok()?.file_type();
    if kind.is_symlink() {
        fs::read_link(path).ok().map(Possession::Link)
    } else {
        fs::read(path).ok().map(Possession::File)
    }
}

fn random_commands_leave_the_files_of_others_alone() {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().unwrap());
    let count = number("INSULA_SEQUENCES").unwrap_or(if tier::is_full() { 1200 } else { 10 });
    let first = number("INSULA_SEED").unwrap_or(7);
    let template = Workplace::new();
    let (mut commands, mut done, mut killed) = (0, 0, 0);
    for seed in first..first + count {
        let sequence = run_sequence(seed, &template);
        commands += sequence.commands;
        done += sequence.done;
        killed += sequence.killed;
        if seed % 100 == 99 {
            println!("{} sequences: {commands} commands, {done} succeeded, {killed} were killed", seed + 1 - first);
        }
    }
    println!("{count} sequences: {commands} commands, {done} succeeded, {killed} were killed");
}

/// What a sequence did.
#[derive(Debug, Default)]
struct Sequence {
    commands: u32,
    done: u32,
    killed: u32,
}

fn run_sequence(seed: u64, template: &Workplace) -> Sequence {
    let mut rng = Rng::new(seed);
    let place = template.copy();
    let mut theirs = possessions(&place);
    let (mut history, mut sequence) = (Vec::new(), Sequence::default());
    for step in 0..4 + rng.below(9) {
        if rng.one_in(3) {
            let name = FOREIGN[rng.below(FOREIGN.len())];
            let path = place.path(name);
            // What a program wrote is not somebody else's because it is replaced.
            if path.symlink_metadata().is_err() && fs::create_dir_all(path.parent().unwrap()).is_ok() {
                let text = format!("dear {step}");
                if fs::write(&path, &text).is_ok() {
                    history.push(format!("(write {name})"));
                    theirs.insert(path, Possession::File(text.into_bytes()));
                }
            }
        }
        let command = Command::random(&mut rng);
        let timeout =
            if rng.one_in(8) { format!("-s KILL {}", rng.below(MAX_KILL_MS) as f64 / 1000.0) } else { "60".into() };
        let output = place.run_for(&command.line, &timeout);
        history.push(format!("{} (for {timeout} s: {:?})", command.line, output.status.code()));
        let is_killed = timeout.starts_with('-');
        let is_expected = matches!(output.status.code(), Some(0..=3)) || is_killed;
        assert!(is_expected, "seed {seed}: {history:#?}: {}", String::from_utf8_lossy(&output.stderr));
        sequence.commands += 1;
        sequence.done += u32::from(output.status.success());
        sequence.killed += u32::from(is_killed && output.status.code().is_none_or(|code| code > 100));
        theirs.retain(|path, possession| {
            let now = found(path);
            let is_kept = now.as_ref() == Some(&*possession);
            let is_given = || command.gives(path, &place) && now.is_some();
            assert!(is_kept || is_given(), "seed {seed}: {} changed by the last of {history:#?}", path.display());
            is_kept
        });
    }
    sequence
}

/// Adds files and links of somebody else to a place, and returns them with those that it has.
fn possessions(place: &Workplace) -> BTreeMap<PathBuf, Possession> {
    place.write("in/part.geojson", TOWN);
    place.write("mine/diary.txt", "dear diary");
    place.write("b/own.txt", "b");
    place.write("c/own.txt", "c");
    for extension in COMMANDS.iter().flat_map(|line| line.split(' ')).filter_map(|word| word.strip_prefix("OUT.")) {
        place.write(&format!("thesis.{extension}"), "my very dear thesis");
    }
    let mut theirs: BTreeMap<PathBuf, Possession> = tree(&place.path("mine"))
        .into_iter()
        .chain(tree(&place.path("in")))
        .map(|(path, bytes)| (path, Possession::File(bytes)))
        .collect();
    // All but what `bake plan` wrote.
    let names = fs::read_dir(place.path("")).unwrap().map(|entry| entry.unwrap().path());
    let names = names.filter(|path| path.is_file() && !path.ends_with("work.job"));
    theirs.extend(names.map(|path| (path.clone(), Possession::File(fs::read(path).unwrap()))));
    for name in ["b/own.txt", "c/own.txt"] {
        theirs.insert(place.path(name), found(&place.path(name)).unwrap());
    }
    #[cfg(unix)]
    {
        let theses =
            fs::read_dir(place.path("")).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let theses = theses.filter(|name| name.starts_with("thesis.")).flat_map(|name| {
            let none = name.replace("thesis", "none");
            [(format!("to-{name}"), name), (format!("to-{none}"), none)]
        });
        let links = LINKS.map(|(link, target)| (link.to_owned(), target.to_owned()));
        for (link, target) in theses.collect::<Vec<_>>().into_iter().chain(links) {
            std::os::unix::fs::symlink(&target, place.path(&link)).unwrap();
            theirs.insert(place.path(&link), Possession::Link(target.into()));
        }
    }
    theirs
}

struct Command {
    line: String,
    inputs: Vec<String>,
    outputs: Vec<String>,
    /// Whether it may replace files of other kinds.
    overwrites: bool,
}

impl Command {
    fn random(rng: &mut Rng) -> Self {
        let mut command =
            Self { line: String::new(), inputs: Vec::new(), outputs: Vec::new(), overwrites: rng.one_in(6) };
        let line = COMMANDS[rng.below(COMMANDS.len())].replacen("SNAPSHOT", SNAPSHOT, 1);
        let words = line.split(' ').map(|word| match (word, word.strip_prefix("OUT.")) {
            ("DIR", _) => DIRECTORIES[rng.below(DIRECTORIES.len())].to_owned(),
            ("IN", _) => {
                let input = INPUTS[rng.below(INPUTS.len())].to_owned();
                command.inputs.push(input.clone());
                input
            }
            (_, Some(extension)) => {
                let output = match rng.below(6) {
                    0 => FALSE_OUTPUTS[rng.below(FALSE_OUTPUTS.len())].to_owned(),
                    _ => format!("{}.{extension}", OUTPUTS[rng.below(OUTPUTS.len())]),
                };
                command.outputs.push(output.clone());
                output
            }
            _ => word.to_owned(),
        });
        let mut words: Vec<String> = words.collect();
        if command.overwrites {
            words.push("--overwrite".to_owned());
        }
        command.line = words.join(" ");
        command
    }

    /// Whether somebody gave a file away: it is an output that replaces files of its kind, or of all kinds, and no input.
    fn gives(&self, path: &Path, place: &Workplace) -> bool {
        let real = |path: &Path| fs::canonicalize(path).ok();
        let is = |name: &String| real(&place.path(name)).is_some_and(|found| Some(found) == real(path));
        let is_input = |name: &String| match name.as_str() {
            "in" | "in/*.geojson" | "*/part.geojson" => path.starts_with(place.path("in")),
            _ => is(name),
        };
        let replaces = self.overwrites
            || self.line.contains("--format geojson")
                && path.extension().is_some_and(|extension| extension == "geojson");
        replaces && self.outputs.iter().any(is) && !self.inputs.iter().any(is_input) && !path.is_symlink()
    }
}
