//! Arguments of the commands for mesh files.

use super::JsonArgs;
use super::parse::{city_parser, parse_max_error, parse_ratio, parse_samples};
use insula_command_line::output::OverwriteArgs;
use std::path::PathBuf;

/// Arguments of `compress`.
#[derive(Debug, clap::Args)]
pub struct CompressArgs {
    /// PLY, OFF, OBJ or STL file
    pub input: PathBuf,
    /// File to write
    pub output: PathBuf,
    /// Bits per coordinate, 8 to 16
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u8).range(8..=16))]
    pub bits: u8,
    /// Bits per texture coordinate, 8 to 16
    #[arg(long, value_name = "BITS", default_value_t = 12, value_parser = clap::value_parser!(u8).range(8..=16))]
    pub texcoord_bits: u8,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Arguments of `decompress`.
#[derive(Debug, clap::Args)]
pub struct DecompressArgs {
    /// File that `compress` wrote
    pub input: PathBuf,
    /// PLY, OFF, OBJ or STL file to write
    pub output: PathBuf,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Arguments of `simplify`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("goal").required(true))]
pub struct SimplifyArgs {
    /// PLY, OFF, OBJ or STL file
    pub input: PathBuf,
    /// PLY, OFF, OBJ or STL file to write
    pub output: PathBuf,
    /// Number of triangles to keep
    #[arg(long, value_name = "N", group = "goal")]
    pub triangles: Option<usize>,
    /// Fraction of the triangles to keep, above 0 and at most 1
    #[arg(long, value_name = "R", group = "goal", value_parser = parse_ratio, allow_negative_numbers = true)]
    pub ratio: Option<f64>,
    /// Largest distance of any point of either surface from the other one, in the file's units
    #[arg(long, value_name = "M", group = "goal", value_parser = parse_max_error, allow_negative_numbers = true)]
    pub error: Option<f64>,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Arguments of `compare`.
#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// Mesh file, baked city, or city file
    #[arg(value_parser = city_parser())]
    pub a: PathBuf,
    /// The same
    #[arg(value_parser = city_parser())]
    pub b: PathBuf,
    /// Points that are spread over each surface, besides its vertices; at most 10 million
    #[arg(long, value_name = "N", default_value_t = 200_000, value_parser = parse_samples)]
    pub samples: usize,
    /// PLY file to write: the first surface, with colours from blue (near) to red (the largest distance)
    #[arg(long, value_name = "OUT.ply")]
    pub heatmap: Option<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Arguments of `ao`.
#[derive(Debug, clap::Args)]
pub struct AoArgs {
    /// PLY, OFF, OBJ or STL file
    pub mesh: PathBuf,
    /// PLY file to write
    #[arg(long, value_name = "OUT.ply")]
    pub out: PathBuf,
    /// Directions from which the mesh is looked at, 1 to 4096. They come in opposite pairs
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub views: u32,
    /// Side of a depth map in texels, 64 to 4096
    #[arg(long, value_name = "PX", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(64..=4096))]
    pub map: u32,
    /// Compute on a GPU (containers are built without)
    #[arg(long)]
    pub gpu: bool,
    /// Stretch the greys, so that the most hidden vertex is black and the most open one white; `quality` stays as it is
    #[arg(long)]
    pub stretch: bool,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}
