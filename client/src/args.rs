//! What was typed, and what it means.
//!
//! In: the command line. Out: [`Cli`]. Next: `commands`.

use crate::render::AdapterChoice;
use clap::{Args, Parser, Subcommand};
use insula_shaders::layout::Shading;
use insula_viewer::sun::{Bearing, SunOptions, SunTime, parse_bearing, parse_time};
use std::path::PathBuf;

/// Insula: fly through whole cities, streamed.
#[derive(Debug, Parser)]
#[command(name = "insula", version, about, disable_help_subcommand = true)]
#[command(after_help = "Example:\n  insula demo\n  insula view http://127.0.0.1:7700")]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// For all commands.
    #[command(flatten)]
    pub global: Global,
}

/// Options of all commands.
#[derive(Debug, Clone, Args)]
pub struct Global {
    /// What draws: a graphics device if there is one that works, else (or with `cpu`) the CPU; `gpu` insists.
    #[arg(long, value_enum, default_value = "auto", global = true)]
    pub adapter: AdapterChoice,
    /// Memory for the city, in MiB; never exceeded.
    #[arg(long, default_value = "256", value_name = "MIB", value_parser = clap::value_parser!(u32).range(8..=65_536), global = true)]
    pub cache_mib: u32,
    /// Keep what was fetched in the user's cache folder, at most so many MiB: a visited city opens without a network.
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u32).range(1..=1_048_576), global = true)]
    pub disk_cache_mib: Option<u32>,
    /// Which city, when the server has several.
    #[arg(long, value_name = "NAME", global = true)]
    pub city: Option<String>,
    /// Draw columns where triangles could be drawn, too.
    #[arg(long, global = true)]
    pub no_meshes: bool,
    /// Tolerated projected error in pixels.
    #[arg(long, default_value = "1", value_name = "PX", value_parser = tau, global = true)]
    pub tau: f64,
    /// Give up when the server has not answered for so many seconds (a window stays and tries on).
    #[arg(long, default_value = "30", value_name = "SECS", value_parser = clap::value_parser!(u32).range(1..=86_400), global = true)]
    pub timeout: u32,
}

impl Global {
    /// `--tau` unless given.
    pub const TAU_PX: f64 = 1.0;
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fly through a city in a window.
    #[command(after_help = "Example:\n  insula view http://127.0.0.1:7700/v1/cities/delft\n  insula view cities/delft")]
    View(View),
    /// Bake city files (once, into a cache folder), serve them in this process and fly through them.
    #[command(after_help = "Example:\n  insula open delft.city.json")]
    Open {
        /// City files, as `insula-server bake` takes them.
        #[arg(required = true)]
        inputs: Vec<PathBuf>,
        /// Side of the finest column in metres.
        #[arg(long, value_name = "M")]
        cell: Option<f64>,
        /// Colours of what has none, as `insula-server bake` takes them.
        #[arg(long, value_name = "FILE.json")]
        palette: Option<PathBuf>,
        /// Light.
        #[command(flatten)]
        sun: SunArgs,
    },
    /// The same with the bundled city; without a screen, write a picture of it.
    #[command(after_help = "Example:\n  insula demo --headless --out demo.png")]
    Demo {
        /// Write a picture and open no window, even if there is a screen.
        #[arg(long)]
        headless: bool,
        /// Where to write the picture.
        #[arg(long, default_value = "demo.png", value_name = "PNG")]
        out: PathBuf,
        /// Its size.
        #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = size)]
        size: [u32; 2],
        /// Light.
        #[command(flatten)]
        sun: SunArgs,
    },
    /// Wait until nothing better can be fetched for a view, then write it as a picture.
    #[command(
        after_help = "Example:\n  insula snapshot --server http://127.0.0.1:7700 --camera cam.json --size 640x360 --out a.png"
    )]
    Snapshot(Snapshot),
    /// Replay a camera path without a window, and measure.
    #[command(
        after_help = "Example:\n  insula fly --server http://127.0.0.1:7700 --path path.json --bandwidth 50 --rtt 40 --report fly.json"
    )]
    Fly(Fly),
}

/// `insula view`.
#[derive(Debug, Default, Args)]
pub struct View {
    /// `http://host:port`, `http://host:port/v1/cities/NAME`, a link copied in a window (`insula://...`), or a baked city
    /// without a server: its folder's path, or its address on any host that answers ranges.
    pub url: String,
    /// Fly along a path, over and over, and print what frames and memory took.
    #[arg(long, value_name = "PATH.json")]
    pub path: Option<PathBuf>,
    /// Fly for so long, then end; once along the path without.
    #[arg(long, value_name = "SECS", value_parser = positive, requires = "path")]
    pub seconds: Option<f64>,
    /// Levels of detail change at once, without a fade.
    #[arg(long)]
    pub no_fades: bool,
    /// Light.
    #[command(flatten)]
    pub sun: SunArgs,
}

/// `insula snapshot`.
#[derive(Debug, Args)]
pub struct Snapshot {
    /// `http://host:port`, or with `/v1/cities/NAME`; or a baked city's folder, here or on a plain host.
    #[arg(long, value_name = "PLACE")]
    pub server: String,
    /// Camera file: `{"position":[x,y,z],"target":[x,y,z],"up":[0,0,1],"fov_y_deg":60}`.
    #[arg(long, value_name = "CAM.json")]
    pub camera: PathBuf,
    /// Picture size.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: [u32; 2],
    /// Where the picture goes (PNG).
    #[arg(long, value_name = "PNG")]
    pub out: PathBuf,
    /// Where distances go: metres along each pixel's ray, little-endian PFM, infinity for the sky.
    #[arg(long, value_name = "PFM")]
    pub distance: Option<PathBuf>,
    /// Where the report goes.
    #[arg(long, value_name = "JSON")]
    pub report: Option<PathBuf>,
    /// What pixels show: lit, albedo, ao, normal, lod or kind.
    #[arg(long, default_value = "lit", value_parser = shading)]
    pub shading: Shading,
    /// Light.
    #[command(flatten)]
    pub sun: SunArgs,
}

/// `insula fly`.
#[derive(Debug, Args)]
pub struct Fly {
    /// `http://host:port`, or with `/v1/cities/NAME`; or a baked city's folder, here or on a plain host.
    #[arg(long, value_name = "PLACE")]
    pub server: String,
    /// Path file: `{"seconds":S,"keys":[{"t":0,"position":[x,y,z],"target":[x,y,z]},...]}`.
    #[arg(long, value_name = "PATH.json")]
    pub path: PathBuf,
    /// Picture size.
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = size)]
    pub size: [u32; 2],
    /// Simulated network: megabits a second, shared by all requests.
    #[arg(long, value_name = "MBIT", value_parser = positive)]
    pub bandwidth: Option<f64>,
    /// Simulated network: milliseconds before each answer.
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u32).range(0..=60_000))]
    pub rtt: Option<u32>,
    /// Simulated network: how many of a hundred answers break off half-way.
    #[arg(long, value_name = "PERCENT", value_parser = percent)]
    pub loss: Option<f64>,
    /// Draw like a window: in fewer pixels while frames are slow, and one ray each.
    #[arg(long)]
    pub paced: bool,
    /// Levels of detail change at once, without a fade.
    #[arg(long)]
    pub no_fades: bool,
    /// Frames a second that are drawn; as many as there can be unless given.
    #[arg(long, value_name = "N", value_parser = positive)]
    pub rate: Option<f64>,
    /// How often a picture is compared with the one that it is on its way to, in seconds of the path; never unless given.
    /// The flight stands still meanwhile.
    #[arg(long, value_name = "SECS", value_parser = positive)]
    pub compare: Option<f64>,
    /// Where the report goes; standard output without it.
    #[arg(long, value_name = "JSON")]
    pub report: Option<PathBuf>,
    /// Light.
    #[command(flatten)]
    pub sun: SunArgs,
}

fn tau(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(tau) if (0.1..=1000.0).contains(&tau) => Ok(tau),
        _ => Err("write a number of pixels, 0.1 to 1000".into()),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if v > 0.0 && v < 1e6 => Ok(v),
        _ => Err("write a number over 0".into()),
    }
}

fn percent(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if (0.0..100.0).contains(&v) => Ok(v),
        _ => Err("write a percentage from 0 to under 100".into()),
    }
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let wrong = || "write width x height, like 640x360, each 1 to 8192".to_owned();
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    let side = |t: &str| t.parse().ok().filter(|n| (1..=8192).contains(n)).ok_or_else(wrong);
    Ok([side(width)?, side(height)?])
}

fn shading(text: &str) -> Result<Shading, String> {
    let all = Shading::ALL;
    all.into_iter().find(|s| s.word() == text).ok_or_else(|| {
        let words: Vec<&str> = all.iter().map(|s| s.word()).collect();
        format!("write one of {}", words.join(", "))
    })
}

/// `--time` or `--sun`, and `--shadows`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Args)]
pub struct SunArgs {
    /// Date and hour of the light: 2024-06-21T17:00 in local mean solar time, or with an offset (Z, +09:00)
    #[arg(long, value_name = "TIME", value_parser = parse_time, conflicts_with = "sun")]
    pub time: Option<SunTime>,
    /// Fixed position of the sun: degrees clockwise from north, and above the horizon
    #[arg(long, value_name = "AZIMUTH,ALTITUDE", value_parser = parse_bearing, allow_hyphen_values = true)]
    pub sun: Option<Bearing>,
    /// Whether the sun casts shadows [default: on]
    #[arg(long, value_name = "on|off", value_parser = switch)]
    pub shadows: Option<bool>,
}

impl From<SunArgs> for SunOptions {
    fn from(args: SunArgs) -> Self {
        Self { time: args.time, bearing: args.sun, shadows: args.shadows }
    }
}

fn switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("write on or off".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_sound_and_every_help_has_an_example() {
        Cli::command().debug_assert();
        for command in Cli::command().get_subcommands_mut() {
            assert!(command.render_long_help().to_string().contains("Example:"), "{}", command.get_name());
        }
    }

    #[test]
    fn what_scripts_call() {
        let line = "insula snapshot --server http://h:1 --camera c.json --size 640x360 --tau 2 --out a.png --distance a.pfm \
                    --report r.json --shading lod --adapter cpu --city delft --cache-mib 64";
        let cli = Cli::try_parse_from(line.split_whitespace()).unwrap();
        assert_eq!((cli.global.tau, cli.global.cache_mib, cli.global.adapter), (2.0, 64, AdapterChoice::Cpu));
        let Command::Snapshot(s) = cli.command else { panic!() };
        assert_eq!((s.size, s.shading), ([640, 360], Shading::Lod));
        for wrong in ["640", "0x5", "640x", "9000x1", "axb"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
