//! The command line (design 3): what may be typed.
//!
//! In: arguments. Out: [`Args`]. Next: `commands`; `serve` turns them into a [`ServeConfig`](crate::config::ServeConfig) first.

use crate::config::{DEFAULT_LISTEN, check_address};
use clap::{Parser, Subcommand, ValueEnum};
use insula_protocol::{TileId, blockmap::Quality, manifest::is_name};
use std::path::PathBuf;

/// Bakes cities and serves them.
#[derive(Debug, Parser)]
#[command(
    name = "insula-server",
    version,
    after_help = "Example:\n  insula-server bake delft.city.json --out delft\n  insula-server serve delft"
)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: ServerCommand,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum ServerCommand {
    /// Turn city files into a city that can be served
    #[command(
        after_help = "Example:\n  insula-server bake buildings.city.json terrain.city.json --out cities/delft --cell 0.5 \\\n    --attribution \"3D BAG, tudelft3d\" --licence \"CC BY 4.0\" --source-url https://3dbag.nl\n\nKilled at any moment it leaves no city or a whole one; --resume goes on where it stopped.\nAfter a change of the sources, the same command with --update bakes only what changed."
    )]
    Bake(BakeArgs),
    /// Serve cities over HTTP
    #[command(
        after_help = "Example:\n  insula-server serve cities/delft cities/chiba --listen 0.0.0.0:7700\n\nSettings come from a TOML file, over it from the environment (limits.in_flight is INSULA_SERVE_LIMITS_IN_FLIGHT),\nover it from --set. --print-config writes all of them, with what they mean.\nSIGHUP reads cities, certificate and tokens again; replace a city's folder by renaming, as bake does.\nLogs go to standard error; RUST_LOG chooses their level."
    )]
    Serve(ServeArgs),
    /// Show what is in a city
    #[command(
        after_help = "Example:\n  insula-server inspect cities/delft\n  insula-server inspect cities/delft --tile 3/2/5 --png node.png"
    )]
    Inspect(InspectArgs),
    /// Check every checksum and that every tile decodes
    #[command(
        after_help = "Example:\n  insula-server verify cities/delft\n\nPrints the bad tiles, one a line, and exits with 1 if there are any."
    )]
    Verify(VerifyArgs),
    /// Make a mesh file small
    #[command(
        after_help = "Example:\n  insula-server compress bunny.ply bunny.insm --bits 12\n\nReads PLY, OFF and OBJ. Vertices at the same place become one, polygons become triangles; what corners carry comes with\nthem. Places are rounded to a grid of 2^BITS points along the longest side; nothing else is lost, and what has to be mended\nis counted."
    )]
    Compress(CompressArgs),
    /// Make a mesh file of what `compress` wrote
    #[command(
        after_help = "Example:\n  insula-server decompress bunny.insm bunny.ply\n\nWrites PLY, OFF or OBJ, by the name."
    )]
    Decompress(DecompressArgs),
    /// Make a mesh of fewer triangles
    #[command(
        after_help = "Example:\n  insula-server simplify skull.obj skull_small.obj --ratio 0.1\n  insula-server simplify town.obj town_small.obj --error 0.5\n\nReads and writes PLY, OFF and OBJ, by the names. Small parts leave as a whole once that is the cheapest thing to do."
    )]
    Simplify(SimplifyArgs),
}

/// `compress`.
#[derive(Debug, clap::Args)]
pub struct CompressArgs {
    /// PLY, OFF or OBJ file
    pub input: PathBuf,
    /// File to write
    pub output: PathBuf,
    /// Bits of a coordinate, 8 to 16
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u8).range(8..=16))]
    pub bits: u8,
    /// Bits of a texture coordinate, 8 to 16
    #[arg(long, value_name = "BITS", default_value_t = 12, value_parser = clap::value_parser!(u8).range(8..=16))]
    pub texcoord_bits: u8,
}

/// `decompress`.
#[derive(Debug, clap::Args)]
pub struct DecompressArgs {
    /// File that `compress` wrote
    pub input: PathBuf,
    /// PLY, OFF or OBJ file to write
    pub output: PathBuf,
}

/// `simplify`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("goal").required(true))]
pub struct SimplifyArgs {
    /// PLY, OFF or OBJ file
    pub input: PathBuf,
    /// PLY, OFF or OBJ file to write
    pub output: PathBuf,
    /// Share of the triangles to keep, above 0 and up to 1
    #[arg(long, value_name = "R", group = "goal", value_parser = ratio)]
    pub ratio: Option<f64>,
    /// Largest error, in the file's own units
    #[arg(long, value_name = "M", group = "goal", value_parser = error)]
    pub error: Option<f64>,
}

/// `bake`.
#[derive(Debug, clap::Args)]
pub struct BakeArgs {
    /// CityJSON, CityJSONSeq, GeoJSON or OBJ files, or folders of them
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Folder to write the city to
    #[arg(long, value_name = "CITY")]
    pub out: PathBuf,
    /// Side of a leaf's column in metres
    #[arg(long, value_name = "M", default_value = "1", value_parser = cell)]
    pub cell: f64,
    /// Least quality of the colours in dB (20 to 60), or lossless
    #[arg(long, value_name = "DB", default_value = "36", value_parser = quality)]
    pub quality: Quality,
    /// Leave out the meshes: views from near then show columns
    #[arg(long)]
    pub no_meshes: bool,
    /// Threads to use; all cores unless given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Memory to use, about: 600MiB, 2GB; 512MiB or 192MiB a thread unless given
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Write a report of what was read, made and how long it took
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
    /// Go on with a bake that was interrupted
    #[arg(long)]
    pub resume: bool,
    /// Bake only what changed since CITY was made; the result is that of a whole bake
    #[arg(long)]
    pub update: bool,
    /// Name in URLs (a-z, 0-9, _ and -); the folder's name unless given
    #[arg(long, value_parser = name)]
    pub name: Option<String>,
    /// Title for people
    #[arg(long)]
    pub title: Option<String>,
    /// Who made the data and must be named wherever it is shown
    #[arg(long, value_name = "TEXT")]
    pub attribution: Option<String>,
    /// Licence of the data
    #[arg(long, value_name = "TEXT", requires = "attribution")]
    pub licence: Option<String>,
    /// Where the data comes from
    #[arg(long, value_name = "URL", requires = "attribution")]
    pub source_url: Option<String>,
    /// Which axis of OBJ files points up
    #[arg(long, value_enum, default_value = "z")]
    pub obj_up: UpAxis,
    /// Colours for surfaces, objects and materials that have none
    #[arg(long, value_name = "FILE.json")]
    pub palette: Option<PathBuf>,
    /// Who draws what is seen from where: the processor, or a graphics device (in programs built with feature `gpu`)
    #[arg(long, value_enum, default_value = "cpu")]
    pub visibility: VisibilityRenderer,
}

/// Who draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum VisibilityRenderer {
    /// The processor.
    Cpu,
    /// A graphics device.
    Gpu,
}

/// An axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UpAxis {
    /// As in surveying.
    Z,
    /// As in most modelling programs.
    Y,
}

/// `serve`.
#[derive(Debug, clap::Args)]
pub struct ServeArgs {
    /// City folders, folders of city folders, or URLs of cities (s3://BUCKET/PATH, https://HOST/PATH)
    #[arg(required_unless_present = "print_config", value_name = "CITY")]
    pub cities: Vec<PathBuf>,
    /// Address to listen on, 127.0.0.1:7700 unless given; port 0 picks a free one
    #[arg(long, value_name = "HOST:PORT", value_parser = address)]
    pub listen: Option<String>,
    /// TOML file of settings
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One setting, as in limits.in_flight=64
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print the settings as a TOML file instead of serving
    #[arg(long)]
    pub print_config: bool,
}

/// `inspect`.
#[derive(Debug, clap::Args)]
pub struct InspectArgs {
    /// City folder
    pub city: PathBuf,
    /// Print JSON
    #[arg(long, conflicts_with_all = ["tile", "png"])]
    pub json: bool,
    /// Node to draw, as level/x/y
    #[arg(long, value_name = "L/X/Y", value_parser = tile, requires = "png")]
    pub tile: Option<TileId>,
    /// Picture to write of the node's geometry, roofs and walls maps
    #[arg(long, value_name = "FILE", requires = "tile")]
    pub png: Option<PathBuf>,
}

/// `verify`.
#[derive(Debug, clap::Args)]
pub struct VerifyArgs {
    /// City folder
    pub city: PathBuf,
}

fn ratio(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(ratio) if ratio > 0.0 && ratio <= 1.0 => Ok(ratio),
        _ => Err("a share above 0 and up to 1 is wanted, as in 0.1".into()),
    }
}

fn error(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(error) if error >= 0.0 && error.is_finite() => Ok(error),
        _ => Err("a length of at least 0 is wanted, as in 0.5".into()),
    }
}

fn cell(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(cell) if (0.01..=1000.0).contains(&cell) => Ok(cell),
        _ => Err("metres between 0.01 and 1000 are wanted, as in 0.5".into()),
    }
}

/// `600MiB`, `2GB`, `1G`, `1073741824`.
fn bytes(text: &str) -> Result<u64, String> {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    let factor: Option<u64> = match unit.to_ascii_lowercase().as_str() {
        "" | "b" => Some(1),
        "k" | "kib" => Some(1 << 10),
        "m" | "mib" => Some(1 << 20),
        "g" | "gib" => Some(1 << 30),
        "kb" => Some(1_000),
        "mb" => Some(1_000_000),
        "gb" => Some(1_000_000_000),
        _ => None,
    };
    let bytes = number.parse::<u64>().ok().zip(factor).and_then(|(number, factor)| number.checked_mul(factor));
    bytes.ok_or_else(|| "a size is wanted, as in 600MiB or 2GB".into())
}

fn quality(text: &str) -> Result<Quality, String> {
    match text.parse::<f32>() {
        _ if text == "lossless" => Ok(Quality::Lossless),
        Ok(db) if (20.0..=60.0).contains(&db) => Ok(Quality::Decibels(db)),
        _ => Err("decibels between 20 and 60 or the word lossless are wanted, as in 36".into()),
    }
}

fn name(text: &str) -> Result<String, String> {
    if is_name(text) { Ok(text.into()) } else { Err("1 to 64 of a-z, 0-9, _ and - are wanted".into()) }
}

fn address(text: &str) -> Result<String, String> {
    check_address(text).map(|()| text.to_owned()).map_err(|_| format!("HOST:PORT is wanted, as in {DEFAULT_LISTEN}"))
}

fn tile(text: &str) -> Result<TileId, String> {
    let mut parts = text.split('/').map(str::parse::<u32>);
    let id = match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(Ok(level)), Some(Ok(x)), Some(Ok(y)), None) => {
            u8::try_from(level).ok().and_then(|level| TileId::new(level, x, y))
        }
        _ => None,
    };
    id.ok_or_else(|| "level/x/y is wanted, as in 3/2/5, with x and y below 2^level".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Args::command().debug_assert();
        for command in Args::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains(&format!("insula-server {} ", command.get_name())), "{help}");
        }
    }

    #[test]
    fn slips_are_usage_errors() {
        let parse = |line: &str| Args::try_parse_from(line.split(' ')).map_err(|error| error.exit_code());
        assert!(
            parse("insula-server bake a b --out c --cell 0.5 --quality lossless --threads 2 --report r.json --resume")
                .is_ok()
        );
        assert!(parse("insula-server bake a --out c --update --memory 600MiB").is_ok());
        assert!(parse("insula-server serve a b --listen localhost:0 --config c.json").is_ok());
        assert!(parse("insula-server inspect a --tile 1/1/0 --png p.png").is_ok());
        assert!(parse("insula-server compress a.ply b --bits 16").is_ok());
        assert!(parse("insula-server simplify a.ply b.obj --error 0.5").is_ok());
        for wrong in [
            "insula-server",
            "insula-server bake a",
            "insula-server bake --out c",
            "insula-server bake a --out c --cell 0",
            "insula-server bake a --out c --cell nan",
            "insula-server bake a --out c --quality 0",
            "insula-server bake a --out c --threads 0",
            "insula-server bake a --out c --name A",
            "insula-server bake a --out c --memory much",
            "insula-server bake a --out c --memory 1.5GiB",
            "insula-server bake a --out c --memory 99999999999GiB",
            "insula-server bake a --out c --licence L",
            "insula-server serve",
            "insula-server serve a --listen 7700",
            "insula-server serve a --listen h:70000",
            "insula-server inspect a --tile 1/2/0 --png p",
            "insula-server inspect a --tile 1/1/0",
            "insula-server inspect a --png p",
            "insula-server verify",
            "insula-server compress a.ply",
            "insula-server compress a.ply b --bits 17",
            "insula-server decompress a",
            "insula-server simplify a.ply b.ply",
            "insula-server simplify a.ply b.ply --ratio 0",
            "insula-server simplify a.ply b.ply --ratio 0.5 --error 1",
            "insula-server simplify a.ply b.ply --error -1",
            "insula-server dance",
        ] {
            assert_eq!(parse(wrong).err(), Some(2), "{wrong}");
        }
    }
}
