//! The commands and options of a program as Markdown.

use crate::one_line;
use clap::{Arg, Command};
use std::collections::BTreeSet;

/// Options that so many commands have are in one table.
const SHARED: usize = 3;
/// For scripts. The programs' tests check it.
const EXIT_CODES: &str = "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 a step of a bake that no retry mends. An error is one line on standard error.";

/// A section for the program, one for each command that help lists, with a table of its arguments and options, and one for the options
/// of several commands.
pub(crate) fn page(program: &Command) -> String {
    let name = program.get_name();
    let mut page = format!("# {name}\n\n{}\n\n{EXIT_CODES}\n", about(program));
    let options = rows(program);
    if !options.is_empty() {
        page += &format!("\nOptions of all its commands:\n\n{}", table("option", &options));
    }
    let commands = program.get_subcommands().filter(|command| !command.is_hide_set());
    let commands: Vec<(&Command, Vec<String>)> = commands.map(|command| (command, rows(command))).collect();
    let count = |row: &str| commands.iter().filter(|(_, rows)| rows.iter().any(|other| other == row)).count();
    let is_shared = |row: &str| row.starts_with("| `--") && count(row) >= SHARED;
    let (mut several, mut known) = (Vec::new(), BTreeSet::new());
    for (command, rows) in &commands {
        page += &format!("\n## {name} {}\n\n{}\n", command.get_name(), about(command));
        let (shared, own): (Vec<&String>, Vec<&String>) = rows.iter().partition(|row| is_shared(row.as_str()));
        if !own.is_empty() {
            page += &format!("\n{}", table("argument or option", own));
        }
        if !shared.is_empty() {
            let names = shared.iter().filter_map(|row| row.split(['`', ' ']).find(|word| word.starts_with("--")));
            let names: Vec<String> = names.map(|name| format!("`{name}`")).collect();
            let link = format!("#options-of-several-commands-of-{name}");
            page += &format!("\nAnd those of [several commands]({link}): {}.\n", names.join(", "));
        }
        several.extend(shared.into_iter().filter(|row| known.insert(row.as_str())));
    }
    if !several.is_empty() {
        page += &format!("\n## Options of several commands of {name}\n\n{}", table("option", several));
    }
    page
}

fn about(command: &Command) -> String {
    let text = command.get_about().map(ToString::to_string).unwrap_or_default();
    sentence(&escaped(&one_line(&text)))
}

fn table<'a>(first: &str, rows: impl IntoIterator<Item = &'a String>) -> String {
    let rows: String = rows.into_iter().map(String::as_str).collect();
    format!("| {first} | meaning |\n|---|---|\n{rows}")
}

/// Arguments come before options, as in the help.
fn rows(command: &Command) -> Vec<String> {
    let shown = || command.get_arguments().filter(|arg| !arg.is_hide_set());
    let arguments = shown().filter(|arg| arg.is_positional());
    let options = shown().filter(|arg| arg.get_long().is_some());
    arguments.chain(options).map(row).collect()
}

fn row(arg: &Arg) -> String {
    // Switches have values and defaults that nobody writes.
    let takes_values = arg.get_action().takes_values();
    let option = arg.get_long().map(|long| format!("--{long}"));
    let values = takes_values.then(|| value_names(arg));
    let name: Vec<String> = [option, values].into_iter().flatten().collect();
    let help = arg.get_long_help().or(arg.get_help()).map(ToString::to_string).unwrap_or_default();
    let mut meaning = escaped(&one_line(&help));
    let names: Vec<String> = arg.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect();
    if takes_values && !names.is_empty() {
        meaning += &format!(" [{}]", names.join(", "));
    }
    if takes_values && !arg.is_hide_default_value_set() && !arg.get_default_values().is_empty() {
        let defaults: Vec<_> = arg.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
        meaning += &format!(" [default: {}]", escaped(&defaults.join(" ")));
    }
    if let Some(variable) = arg.get_env() {
        meaning += &format!(" [environment: `{}`]", variable.to_string_lossy());
    }
    if arg.is_required_set() && !arg.is_positional() {
        meaning += " [required]";
    }
    format!("| `{}` | {} |\n", name.join(" ").replace('|', "\\|"), sentence(&meaning))
}

fn value_names(arg: &Arg) -> String {
    let names = arg.get_value_names().unwrap_or_default().join(" ");
    let is_list = arg.get_num_args().is_some_and(|range| range.max_values() > 1);
    if is_list && !names.ends_with("...") { names + "..." } else { names }
}

/// Escapes the characters that Markdown would read as markup. Text in backticks stays as it is.
fn escaped(text: &str) -> String {
    let mut is_code = false;
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        is_code ^= letter == '`';
        if letter == '|' || !is_code && "*_<".contains(letter) {
            escaped.push('\\');
        }
        escaped.push(letter);
    }
    escaped
}

/// The text with a full stop, unless it ends in a bracket.
fn sentence(text: &str) -> String {
    if text.ends_with(['.', ']']) || text.is_empty() { text.to_owned() } else { format!("{text}.") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::OverwriteArgs;
    use clap::{CommandFactory, Parser, Subcommand, ValueEnum};

    /// A program
    #[derive(Debug, Parser)]
    #[command(name = "town")]
    struct Town {
        #[command(subcommand)]
        command: TownCommand,
        /// Say all. There is much
        #[arg(long, global = true, env = "TOWN_LOUD")]
        loud: bool,
    }

    #[derive(Debug, Clone, Copy, ValueEnum)]
    enum Roof {
        Flat,
        Round,
    }

    #[derive(Debug, Subcommand)]
    enum TownCommand {
        /// Build a house
        Build {
            /// Plans, as in 'plans/*.gml'
            #[arg(required = true, value_name = "PLAN")]
            plans: Vec<String>,
            /// Roof, or `a|b`
            #[arg(long, value_enum, default_value = "flat")]
            roof: Roof,
            #[arg(long, value_name = "A|B")]
            owner: String,
            #[command(flatten)]
            overwrite: OverwriteArgs,
        },
        /// Paint all
        Paint(OverwriteArgs),
        /// Sell all
        Sell(OverwriteArgs),
        #[command(hide = true)]
        Secret,
    }

    #[test]
    fn all_that_help_lists_is_in_the_tables() {
        let several = "\nAnd those of [several commands](#options-of-several-commands-of-town): `--overwrite`.\n";
        let expected = format!(
            "# town\n\nA program.\n\n{EXIT_CODES}\n\nOptions of all its commands:\n\n| option | meaning |\n|---|---|\n\
            | `--loud` | Say all. There is much [environment: `TOWN_LOUD`] |\n\n\
            ## town build\n\nBuild a house.\n\n| argument or option | meaning |\n|---|---|\n\
            | `PLAN...` | Plans, as in 'plans/\\*.gml'. |\n\
            | `--roof ROOF` | Roof, or `a\\|b` [flat, round] [default: flat] |\n\
            | `--owner A\\|B` |  [required] |\n{several}\n\
            ## town paint\n\nPaint all.\n{several}\n## town sell\n\nSell all.\n{several}\n\
            ## Options of several commands of town\n\n| option | meaning |\n|---|---|\n\
            | `--overwrite` | Replace existing files of other kinds, too. |\n"
        );
        assert_eq!(page(&Town::command()), expected);
    }
}
