//! What the command lines of both programs share: how errors are printed, values of options, and the commands that write shell
//! completions, man pages and docs/cli.md.

pub mod area;
pub mod camera;
pub mod http;
pub mod log;
mod markdown;
pub mod output;
mod private_network;
pub mod tls;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, CommandFactory, Parser, Subcommand};
use clap_complete::Shell;
use insula_archive::file::open_regular;
use insula_archive::new_file::replace;
use insula_protocol::text::printable;
use output::{FileKind, Outputs};
use std::borrow::Cow;
use std::ffi::OsString;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The commands of both programs, in the order of their help. Each names the other one for those that it does not have.
const COMMANDS: [(&str, &[&str]); 2] = [
    ("insula", &["view", "open", "demo", "snapshot", "fly", "draw"]),
    (
        "insula-server",
        &[
            "bake", "serve", "sign", "publish", "inspect", "objects", "search", "export", "changes", "analyse",
            "openapi", "verify", "compress", "decompress", "simplify", "compare", "ao",
        ],
    ),
];

/// Environment variable with the file of the certificates that clients trust.
const CERTIFICATES: &str = "SSL_CERT_FILE";

/// Parses the arguments of this process. If there is nothing to run, prints why, and fails with the exit code of the process:
/// 0 after help and version that were asked for, 2 after a usage error. Without any arguments, the help is the error.
pub fn parse<P: Parser>() -> Result<P, ExitCode> {
    if let Some(path) = std::env::var_os(CERTIFICATES).filter(|path| Path::new(path).exists()) {
        // The library that reads it would wait for a pipe, and read a device without end. A missing file it reports itself, to commands
        // that need one.
        open_regular(Path::new(&path)).map_err(|error| {
            let what = format!("{CERTIFICATES}={}: {error}; give a file of certificates", path.display());
            eprintln!("error: {}", one_line(&what));
            ExitCode::from(2)
        })?;
    }
    P::try_parse_from(with_full_switches(&P::command(), std::env::args_os())).map_err(|error| {
        let is_requested = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
        if is_requested || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
            // A closed pipe (`| head`) is no failure.
            let _ = error.print();
        } else {
            eprintln!("{}", usage_line::<P>(&error, std::env::args_os()));
        }
        if is_requested { ExitCode::SUCCESS } else { ExitCode::from(2) }
    })
}

/// The command line in which each switch whose value is optional, such as `--shadows`, has a value. Clap would take the next word as the
/// value, also where it is the place of a city. A switch's value name lists the values, such as `on|off`; the first is the default.
fn with_full_switches(program: &Command, line: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let needs_none = |arg: &&clap::Arg| arg.get_num_args().is_some_and(|number| number.min_values() == 0);
    let values =
        |arg: &clap::Arg| Some((format!("--{}", arg.get_long()?), arg.get_value_names()?.first()?.to_string()));
    let switches: Vec<(String, String)> = program
        .get_subcommands()
        .flat_map(|command| command.get_arguments().filter(|arg| arg.get_action().takes_values()))
        .filter(needs_none)
        .filter_map(values)
        .collect();
    let mut line: Vec<OsString> = line.into_iter().collect();
    let end = line.iter().position(|word| word == "--").unwrap_or(line.len());
    for index in 1..end {
        let Some((name, values)) = switches.iter().find(|(name, _)| line[index] == **name) else { continue };
        let is_value = |word: &OsString| values.split('|').any(|value| word == value);
        if !line.get(index + 1).is_some_and(is_value) {
            line[index] = format!("{name}={}", values.split('|').next().unwrap_or_default()).into();
        }
    }
    line
}

/// The message of a usage error in one line: with the command and its help, without the usage that clap appends.
fn usage_line<P: CommandFactory>(error: &clap::Error, line: impl IntoIterator<Item = OsString>) -> String {
    let text = error.render().to_string();
    let message = text.split("\nUsage:").next().and_then(|text| text.split("\nFor more").next()).unwrap_or_default();
    // Nobody means an option that does not exist as a value.
    let is_told = |line: &&str| !line.trim_start().starts_with("tip: to pass ");
    let message = message.trim_start_matches("error: ").lines().filter(is_told).collect::<Vec<_>>().join("\n");
    let program = P::command();
    if let (ErrorKind::InvalidSubcommand, Some(ContextValue::String(command))) =
        (error.kind(), error.get(ContextKind::InvalidSubcommand))
        && let Some(other) = other_program(program.get_name(), command)
    {
        return named_line(None, &format!("{command} is a command of {other}; see {other} {command} --help"));
    }
    let command = subcommand_of(&program, line);
    let help = command.iter().fold(program.get_name().to_owned(), |help, command| help + " " + command);
    format!("{}; see {help} --help", named_line(command.as_deref(), &message))
}

/// The other program, if it has this command.
fn other_program(program: &str, command: &str) -> Option<&'static str> {
    COMMANDS.iter().find(|(name, commands)| *name != program && commands.contains(&command)).map(|(name, _)| *name)
}

/// A failure of the command of this process in one line, which names the command.
pub fn error_line<P: CommandFactory>(message: &str) -> String {
    named_line(subcommand_of(&P::command(), std::env::args_os()).as_deref(), message)
}

fn named_line(command: Option<&str>, message: &str) -> String {
    one_line(&command.map_or_else(|| format!("error: {message}"), |command| format!("error: {command}: {message}")))
}

/// The command in a command line, which begins with the program: the first word that is the name of one.
fn subcommand_of(program: &Command, line: impl IntoIterator<Item = OsString>) -> Option<String> {
    let known =
        |word: OsString| program.get_subcommands().map(Command::get_name).find(|name| word == *name).map(str::to_owned);
    line.into_iter().skip(1).find_map(known)
}

/// The text in one line that is safe to print.
pub fn one_line(text: &str) -> String {
    printable(&text.split_whitespace().map(without_query).collect::<Vec<_>>().join(" ")).into_owned()
}

/// A word without the query of an address in it, which may be a signature.
fn without_query(word: &str) -> Cow<'_, str> {
    let start = ["http://", "https://", "s3://"].iter().filter_map(|scheme| word.find(scheme)).min();
    let Some(query) = start.and_then(|start| Some(start + word[start..].find('?')?)) else { return word.into() };
    let (plain, query) = word.split_at(query);
    // What follows belongs to the sentence.
    let end = query.trim_end_matches([':', ';', ',', '.', ')', '"', '\'', '>']).len();
    format!("{plain}{}", &query[end..]).into()
}

/// The tolerated screen-space error in pixels, 0.1 to 1000. Fails with what was expected.
pub fn parse_tau(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(tau) if (0.1..=1000.0).contains(&tau) => Ok(tau),
        _ => Err("expected a number of pixels from 0.1 to 1000".into()),
    }
}

/// Width and height of a picture, as in `640x360`, each from 1 to 8192. Fails with what was expected.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let invalid = || "expected WIDTHxHEIGHT, for example 640x360, each from 1 to 8192".to_owned();
    let (width, height) = text.split_once('x').ok_or_else(invalid)?;
    let side = |t: &str| t.parse().ok().filter(|n| (1..=8192).contains(n)).ok_or_else(invalid);
    Ok([side(width)?, side(height)?])
}

/// Commands that prepare a shell, `man` and documentation for a program. Help does not list them: they are for those who make packages.
#[derive(Debug, Clone, Subcommand)]
pub enum SetupCommand {
    /// Print the completions of a shell
    #[command(hide = true)]
    Completions {
        /// Shell that reads them
        shell: Shell,
    },
    /// Write man pages, one per command
    #[command(hide = true)]
    Man {
        /// Folder to write to
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Print all commands and options as Markdown
    #[command(hide = true)]
    Options,
}

impl SetupCommand {
    /// Runs the command for the program with the command line `P`. Fails with the path that cannot be written.
    pub fn run<P: CommandFactory>(&self) -> Result<(), (PathBuf, io::Error)> {
        let mut command = P::command();
        match self {
            Self::Completions { shell } => {
                let (name, mut script) = (command.get_name().to_owned(), Vec::new());
                clap_complete::generate(*shell, &mut command, name, &mut script);
                print(&script);
                Ok(())
            }
            Self::Options => {
                print(markdown::page(&command).as_bytes());
                Ok(())
            }
            Self::Man { out } => write_man_pages(command, out).map_err(|error| (out.clone(), error)),
        }
    }
}

/// Writes to standard output. A closed pipe is no failure.
fn print(bytes: &[u8]) {
    let _ = io::stdout().lock().write_all(bytes);
}

/// Writes the man pages of a program into a folder, in place of earlier ones. Fails if another file has the name of one.
fn write_man_pages(command: Command, out: &Path) -> io::Result<()> {
    let made = tempfile::tempdir()?;
    clap_mangen::generate_to(command, made.path())?;
    let mut pages: Vec<_> = fs::read_dir(made.path())?.collect::<io::Result<_>>()?;
    pages.sort_by_key(fs::DirEntry::file_name);
    let mut outputs = Outputs::default().creating(out);
    for page in &pages {
        let refused = |reason| io::Error::new(io::ErrorKind::AlreadyExists, reason);
        outputs.file(&out.join(page.file_name()), FileKind::MAN_PAGE).map_err(refused)?;
    }
    fs::create_dir_all(out)?;
    pages.iter().try_for_each(|page| replace(&out.join(page.file_name()), &fs::read(page.path())?))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    /// A program.
    #[derive(Debug, Parser)]
    #[command(name = "town")]
    struct Town {
        #[command(subcommand)]
        command: TownCommand,
    }

    #[derive(Debug, Subcommand)]
    enum TownCommand {
        /// Build a house
        Build {
            /// Number of storeys
            #[arg(long)]
            storeys: u8,
            /// Whether it has a cellar
            #[arg(long, value_name = "on|off", num_args = 0..=1)]
            cellar: Option<String>,
            /// Where it stands
            places: Vec<OsString>,
        },
        #[command(flatten)]
        Setup(SetupCommand),
    }

    #[test]
    fn usage_errors_are_one_safe_line_that_names_the_command() {
        let error = |line: &[&str]| {
            let error = Town::try_parse_from(line).unwrap_err();
            usage_line::<Town>(&error, line.iter().map(OsString::from))
        };
        let hostile = error(&["town", "build", "--storeys", "\u{1b}[2J"]);
        assert!(
            hostile.starts_with("error: build: invalid value") && !hostile.contains(char::is_control),
            "{hostile:?}"
        );
        let missing = error(&["town", "build"]);
        assert!(missing.ends_with("not provided: --storeys <STOREYS>; see town build --help"), "{missing}");
        // Of no command.
        let unknown = error(&["town", "dance"]);
        assert_eq!(unknown, "error: unrecognized subcommand 'dance'; see town --help");
        assert!(error(&["town", "build", "--storey", "1"]).contains("tip: "));
        let other = error(&["town", "build", "--storeys", "1", "--balcony"]);
        assert_eq!(other, "error: build: unexpected argument '--balcony' found; see town build --help");
        let elsewhere = error(&["town", "snapshot"]);
        assert_eq!(elsewhere, "error: snapshot is a command of insula; see insula snapshot --help");
    }

    #[test]
    fn a_switch_does_not_take_the_place_behind_it() {
        for (words, cellar, places) in [
            ("--cellar street", "on", vec!["street"]),
            ("street --cellar", "on", vec!["street"]),
            ("--cellar off street", "off", vec!["street"]),
            ("--cellar=off street", "off", vec!["street"]),
            ("street -- --cellar on", "", vec!["street", "--cellar", "on"]),
        ] {
            let line = format!("town build --storeys 1 {words}");
            let line = with_full_switches(&Town::command(), line.split(' ').map(OsString::from));
            let TownCommand::Build { cellar: found, places: left, .. } = Town::try_parse_from(line).unwrap().command
            else {
                panic!("not built")
            };
            assert_eq!(
                (found.unwrap_or_default().as_str(), left),
                (cellar, places.into_iter().map(OsString::from).collect()),
                "{words}"
            );
        }
    }

    #[test]
    fn errors_have_no_secrets_of_addresses() {
        for (text, shown) in [
            ("https://me:a@h/x.gml?sig=b: no such file", "https://h/x.gml: no such file"),
            ("\"s3://h/x?sig=b\", (http://h?sig=b); what?", "\"s3://h/x\", (http://h); what?"),
            ("write insula://host/v1/cities/NAME?camera=...", "write insula://host/v1/cities/NAME?camera=..."),
        ] {
            assert_eq!(one_line(text), shown);
        }
    }

    #[test]
    fn man_pages_are_of_the_commands_that_help_lists() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new/man1");
        let TownCommand::Setup(setup) =
            Town::try_parse_from(["town", "man", "--out", out.to_str().unwrap()]).unwrap().command
        else {
            panic!("not a setup command")
        };
        setup.run::<Town>().unwrap();
        let mut names: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["town-build.1", "town.1"]);
        assert!(fs::read_to_string(out.join("town-build.1")).unwrap().contains("Number of storeys"));
        let (path, _) = SetupCommand::Man { out: out.join("town.1") }.run::<Town>().unwrap_err();
        assert_eq!(path, out.join("town.1"));
    }
}
