//! The command line of `insula`.

mod draw;
mod switch;
mod view_options;

use crate::image_files::parse_picture_path;
use crate::objects::ObjectStyleArgs;
use crate::render::AdapterChoice;
use crate::stream::fetch::HttpOptions;
use clap::builder::TypedValueParser;
use clap::{Args, Parser, Subcommand};
pub use draw::DrawArgs;
use insula_command_line::output::OverwriteArgs;
use insula_command_line::{SetupCommand, parse_size, parse_tau};
use insula_shaders::layout::Shading;
use insula_shaders::look::Look;
use insula_viewer::interaction::frame_pacing::FRAME_RATES;
use insula_viewer::sun::{Bearing, SunOptions, SunTime, parse_bearing, parse_time};
use insula_viewer::translucency::Translucency;
use std::path::PathBuf;
pub use switch::SwitchArgs;
pub use view_options::{PlaceArgs, StreetPlace, Target, ViewpointArgs};

/// Insula: fly through whole cities, streamed.
#[derive(Debug, Parser)]
#[command(name = "insula", version)]
#[command(after_help = "Example:\n  insula demo\n  insula view http://127.0.0.1:7700")]
pub struct Cli {
    #[command(subcommand)]
    pub command: ClientCommand,
    #[command(flatten)]
    pub global: GlobalArgs,
}

/// Options of all commands.
#[derive(Debug, Clone, Args)]
pub struct GlobalArgs {
    /// Ray-caster: `auto` uses a GPU if one works and the CPU otherwise; a software driver only if it draws faster than the CPU
    /// ray-caster in a short trial at start. `gpu` fails without any driver.
    #[arg(long, value_enum, default_value = "auto", env = "INSULA_ADAPTER", global = true)]
    pub adapter: AdapterChoice,
    /// Size of the tile cache in MiB; never exceeded. What is known of the city's nodes takes at most a quarter of it, or 16 MiB, more.
    #[arg(long, default_value = "256", value_name = "MIB", value_parser = clap::value_parser!(u32).range(8..=65_536), global = true)]
    pub cache_mib: u32,
    /// Keep fetched tiles in the user's cache folder, at most this many MiB. A visited city then opens without a network.
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u32).range(1..=1_048_576), global = true)]
    pub disk_cache_mib: Option<u32>,
    /// Name of the city, if the server has several.
    #[arg(long, value_name = "NAME", global = true)]
    pub city: Option<String>,
    /// Draw columns only, even where meshes are available.
    #[arg(long, global = true)]
    pub no_meshes: bool,
    /// Tolerated screen-space error in pixels: larger is coarser and faster.
    #[arg(long, default_value = "1", value_name = "PX", value_parser = parse_tau, global = true)]
    pub tau: f64,
    /// Fail when the server has not responded for this many seconds. A window keeps trying instead.
    #[arg(long, default_value = "30", value_name = "SECS", value_parser = clap::value_parser!(u32).range(1..=86_400), global = true)]
    pub timeout: u32,
    /// Follow redirects to other hosts, also to addresses of this machine and of its private network.
    #[arg(long, global = true)]
    pub follow_redirects: bool,
}

impl GlobalArgs {
    /// Default of `--tau`, in pixels.
    pub const DEFAULT_TAU_PX: f64 = 1.0;

    /// Options of all requests.
    pub fn http_options(&self) -> HttpOptions {
        HttpOptions { follow_redirects: self.follow_redirects, ..HttpOptions::default() }
    }
}

/// Commands of `insula`.
#[derive(Debug, Subcommand)]
pub enum ClientCommand {
    /// Fly through a city in a window.
    #[command(after_help = "Example:\n  insula view http://127.0.0.1:7700/v1/cities/delft\n  insula view cities/delft")]
    View(ViewArgs),
    /// Bake city files once into a cache folder, then serve and view them in one process.
    #[command(after_help = "Example:\n  insula open delft.city.json")]
    Open(OpenArgs),
    /// View the bundled city. Without a screen, write an image of it.
    #[command(after_help = "Example:\n  insula demo\n  insula demo chiba --headless --out chiba.png")]
    Demo(DemoArgs),
    /// Fetch everything that a view needs, then render it to an image.
    #[command(after_help = "Example:\n  insula snapshot http://127.0.0.1:7700 --out a.png")]
    Snapshot(SnapshotArgs),
    /// Replay a camera path without a window, and report measurements.
    #[command(
        after_help = "Example:\n  insula fly http://127.0.0.1:7700 --path path.json --bandwidth 50 --rtt 40 --report fly.json"
    )]
    Fly(FlyArgs),
    /// Draw a city as vector shapes, with hidden lines and surfaces removed.
    #[command(
        after_help = "Example:\n  insula draw cities/delft --axonometric 30,35 --scale 1:1000 --paper A3 --out delft.svg"
    )]
    Draw(DrawArgs),
    #[command(flatten)]
    Setup(SetupCommand),
}

/// Parses the name of a picture. It need not be UTF-8.
fn picture_path() -> impl TypedValueParser<Value = PathBuf> {
    clap::builder::PathBufValueParser::new().try_map(parse_picture_path)
}

/// Arguments of `insula view`.
#[derive(Debug, Default, Args)]
pub struct ViewArgs {
    #[command(flatten)]
    pub place: PlaceArgs,
    /// Camera to begin with: LON,LAT,HEIGHT,HEADING,PITCH[,FOV] in degrees and metres; or, in metres of the city's system, a camera file or
    /// a view link [default: that of the view link, else the first view of the city].
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true)]
    pub camera: Option<PathBuf>,
    /// Show the city with a proposal: a TOML file of models and blocks that are added, and of objects that are removed.
    #[arg(long, value_name = "FILE.toml")]
    pub proposal: Option<PathBuf>,
    /// Fly along a camera path repeatedly, and print frame times and memory use.
    #[arg(long, value_name = "PATH.json")]
    pub path: Option<PathBuf>,
    /// Stop the flight after this many seconds [default: once along the path].
    #[arg(long, value_name = "SECS", value_parser = parse_positive, requires = "path")]
    pub seconds: Option<f64>,
    /// Frames a second while the view moves, 5 to 240: on a slow machine by less detail, up to four times `--tau`, then by fewer pixels.
    /// A view that rests has all of them [default: 30].
    #[arg(long, value_name = "N", value_parser = parse_frame_rate)]
    pub fps: Option<f64>,
    /// Switch levels of detail at once instead of cross-fading them.
    #[arg(long)]
    pub no_fades: bool,
    #[command(flatten)]
    pub switch: SwitchArgs,
    #[command(flatten)]
    pub pictures: PictureArgs,
    #[command(flatten)]
    pub sun: SunArgs,
}

/// Arguments of `insula open`.
#[derive(Debug, Args)]
pub struct OpenArgs {
    /// City files, as for `insula-server bake`; or one place, as for `insula view`, of a city that is baked already.
    #[arg(required_unless_present = "server", value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// The same as one place.
    #[arg(long, value_name = "PLACE", conflicts_with = "inputs")]
    server: Option<PathBuf>,
    /// Side of the finest column in metres [default: 1].
    #[arg(long, value_name = "M")]
    pub cell: Option<f64>,
    /// Colours of surfaces, as for `insula-server bake`.
    #[arg(long, value_name = "harmonised|source|FILE.json")]
    pub palette: Option<PathBuf>,
    /// Walls of which the files have no picture: of one colour, or with generated windows.
    #[arg(long, value_parser = ["plain", "windows"], default_value = "windows")]
    pub facades: String,
    #[command(flatten)]
    pub pictures: PictureArgs,
    #[command(flatten)]
    pub sun: SunArgs,
}

impl OpenArgs {
    /// City files, or one place.
    pub fn inputs(&self) -> &[PathBuf] {
        self.server.as_ref().map_or(&self.inputs[..], std::slice::from_ref)
    }
}

/// The bundled cities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum DemoCity {
    /// Streets, buildings, trees and the sea of OpenStreetMap.
    Monaco,
    /// Photographed walls of Project PLATEAU.
    Chiba,
}

/// Arguments of `insula demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// The bundled city.
    // `--city` is an option of all commands.
    #[arg(value_enum, default_value = "monaco", value_name = "CITY")]
    pub bundled: DemoCity,
    /// Write an image and open no window, even if there is a screen.
    #[arg(long)]
    pub headless: bool,
    /// Image file to write: .png, .jpg, .jpeg or .webp.
    #[arg(long, default_value = "demo.png", value_name = "FILE", value_parser = picture_path())]
    pub out: PathBuf,
    /// Size of the image in pixels.
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = parse_size)]
    pub size: [u32; 2],
    #[command(flatten)]
    pub pictures: PictureArgs,
    #[command(flatten)]
    pub sun: SunArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Arguments of `insula snapshot`.
#[derive(Debug, Args)]
pub struct SnapshotArgs {
    // A view link gives the time of the light, too.
    #[command(flatten)]
    pub place: PlaceArgs,
    #[command(flatten)]
    pub viewpoint: ViewpointArgs,
    /// Size of the image in pixels.
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Image file to write: .png, .jpg, .jpeg or .webp.
    #[arg(long, value_name = "FILE", value_parser = picture_path())]
    pub out: PathBuf,
    #[command(flatten)]
    pub pictures: PictureArgs,
    /// Distance file to write: metres along each pixel's ray as little-endian PFM, infinity for the sky.
    #[arg(long, value_name = "PFM")]
    pub distance: Option<PathBuf>,
    /// Light file to write: linear RGB of each pixel as little-endian PFM, where 1 is what a white matt surface that faces the
    /// sun sends.
    #[arg(long, value_name = "PFM")]
    pub radiance: Option<PathBuf>,
    /// Object file to write: the number of each pixel's object as little-endian u32, row by row from the top, 4294967295 for none; the
    /// same bytes as red, green, blue and alpha of a .png.
    #[arg(long, value_name = "FILE")]
    pub objects: Option<PathBuf>,
    /// File of what is known of the objects that are seen.
    #[arg(long, value_name = "JSON")]
    pub objects_json: Option<PathBuf>,
    #[command(flatten)]
    pub styles: ObjectStyleArgs,
    /// Show the city with a proposal: a TOML file of models and blocks that are added, and of objects that are removed.
    #[arg(long, value_name = "FILE.toml")]
    pub proposal: Option<PathBuf>,
    /// Draw the legend of the colours into the image.
    #[arg(long, requires = "color_by")]
    pub legend: bool,
    /// Report file to write.
    #[arg(long, value_name = "JSON")]
    pub report: Option<PathBuf>,
    /// Value that pixels show: lit, albedo, ao, normal, lod (levels of detail), kind (of columns), wire (edges of triangles), triangles
    /// or bounds (levels of detail, and the boxes of nodes).
    #[arg(long, default_value = "lit", value_parser = parse_shading)]
    pub shading: Shading,
    #[command(flatten)]
    pub switch: SwitchArgs,
    #[command(flatten)]
    pub sun: SunArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

impl SnapshotArgs {
    /// Whether anything is asked of the objects.
    pub fn needs_objects(&self) -> bool {
        self.objects.is_some() || self.objects_json.is_some() || !self.styles.is_empty()
    }
}

/// Arguments of `insula fly`.
#[derive(Debug, Args)]
pub struct FlyArgs {
    #[command(flatten)]
    pub place: PlaceArgs,
    /// Camera path file: `{"seconds":S,"keys":[{"t":0,"position":[x,y,z],"target":[x,y,z]},...]}`.
    #[arg(long, value_name = "PATH.json")]
    pub path: PathBuf,
    /// Size of the frames in pixels.
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Simulated network: bandwidth in megabits per second, shared by all requests.
    #[arg(long, value_name = "MBIT", value_parser = parse_positive)]
    pub bandwidth: Option<f64>,
    /// Simulated network: delay before each response in milliseconds.
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u32).range(0..=60_000))]
    pub rtt: Option<u32>,
    /// Simulated network: percentage of responses that break off half-way.
    #[arg(long, value_name = "PERCENT", value_parser = parse_percent)]
    pub loss: Option<f64>,
    #[command(flatten)]
    pub switch: SwitchArgs,
    /// Pace frames like a window: less detail and fewer pixels while frames are slow.
    #[arg(long)]
    pub paced: bool,
    /// Frames a second that this keeps, 5 to 240 [default: 30].
    #[arg(long, value_name = "N", value_parser = parse_frame_rate, requires = "paced")]
    pub fps: Option<f64>,
    /// Switch levels of detail at once instead of cross-fading them.
    #[arg(long)]
    pub no_fades: bool,
    /// Frames per second [default: as many as possible].
    #[arg(long, value_name = "N", value_parser = parse_positive)]
    pub rate: Option<f64>,
    /// Compare a frame with its converged frame at this interval, in seconds of the path [default: never]. The flight pauses
    /// meanwhile.
    #[arg(long, value_name = "SECS", value_parser = parse_positive)]
    pub compare: Option<f64>,
    /// Report file to write [default: standard output].
    #[arg(long, value_name = "JSON")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub sun: SunArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Options of saved images, for all commands that write any.
#[derive(Debug, Clone, Copy, Default, PartialEq, Args)]
pub struct PictureArgs {
    /// Draw no sources and licences into the corner of saved images: you name them beside the image, as their licences ask.
    #[arg(long)]
    pub no_caption: bool,
}

/// Options of the light, for all commands that render.
#[derive(Debug, Clone, Copy, Default, PartialEq, Args)]
pub struct SunArgs {
    /// Date and time of the light: 2024-06-21T17:00 in local mean solar time, or with an offset (Z, +09:00)
    #[arg(long, value_name = "TIME", value_parser = parse_time, conflicts_with = "sun")]
    pub time: Option<SunTime>,
    /// Fixed position of the sun: degrees clockwise from the map's north, and above the horizon
    #[arg(long, value_name = "AZIMUTH,ALTITUDE", value_parser = parse_bearing, allow_hyphen_values = true)]
    pub sun: Option<Bearing>,
    /// How the city is shown: model (a white model by day), physical (light as measured) or paper (even light, for reports) [default:
    /// model]
    #[arg(long, value_name = "LOOK", value_parser = parse_look)]
    pub look: Option<Look>,
    /// Whether edges of buildings have lines [default: on in the looks model and paper]
    #[arg(long, value_name = "on|off", value_parser = parse_switch)]
    pub lines: Option<bool>,
    /// Whether surfaces are darker where they meet others [default: on in the looks model and paper]
    #[arg(long, value_name = "on|off", value_parser = parse_switch)]
    pub contact_shade: Option<bool>,
    /// Whether the sun casts shadows [default: on]
    #[arg(long, value_name = "on|off", value_parser = parse_switch)]
    pub shadows: Option<bool>,
    /// Whether surfaces that see less of the sky are darker [default: on]
    #[arg(long, value_name = "on|off", value_parser = parse_switch)]
    pub occlusion: Option<bool>,
    /// Brightness: factor from light to display, where a white surface in the sun has light 1 [default: by the frame's mean]
    #[arg(long, value_name = "FACTOR", value_parser = parse_exposure)]
    pub exposure: Option<f32>,
    /// Turbidity of the air: 2 very clear, 3 clear, 6 hazy [default: 3]
    #[arg(long, value_name = "T", value_parser = parse_turbidity)]
    pub turbidity: Option<f32>,
    /// Distance in kilometres at which haze hides the city [default: 45]
    #[arg(long, value_name = "KM", value_parser = parse_visibility)]
    pub visibility: Option<f32>,
    /// Light windows in walls after sunset: generated, not from the sources
    #[arg(long)]
    pub lit_windows: bool,
    /// Sunlight through landmarks of marble: off, fast (maps of 256 texels, 9 taps) or fine (512 texels, 21 taps) [default: fine]
    #[arg(long, value_name = "QUALITY", value_parser = parse_translucency)]
    pub translucency: Option<Translucency>,
}

impl SunArgs {
    /// These options, with the look of a view link where they give none, and its time where they give neither a time nor a position of
    /// the sun.
    pub fn or_link(self, time: Option<SunTime>, look: Option<Look>) -> Self {
        let time = if self.sun.is_some() { self.time } else { self.time.or(time) };
        Self { time, look: self.look.or(look), ..self }
    }
}

impl From<SunArgs> for SunOptions {
    fn from(args: SunArgs) -> Self {
        Self {
            time: args.time,
            bearing: args.sun,
            shadows: args.shadows,
            occlusion: args.occlusion,
            exposure: args.exposure,
            turbidity: args.turbidity,
            visibility_km: args.visibility,
            lit_windows: args.lit_windows,
            translucency: args.translucency.unwrap_or_default(),
            look: args.look.unwrap_or_default(),
            lines: args.lines,
            contact: args.contact_shade,
        }
    }
}

fn parse_look(text: &str) -> Result<Look, String> {
    Look::of_word(text).ok_or_else(|| "expected model, physical or paper".into())
}

fn parse_translucency(text: &str) -> Result<Translucency, String> {
    let found = Translucency::ALL.into_iter().find(|(word, _)| *word == text).map(|(_, quality)| quality);
    found.ok_or_else(|| "expected off, fast or fine".into())
}

fn parse_in(text: &str, range: std::ops::RangeInclusive<f32>) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value| range.contains(value));
    value.ok_or_else(|| format!("expected a number from {} to {}", range.start(), range.end()))
}

fn parse_exposure(text: &str) -> Result<f32, String> {
    parse_in(text, 0.001..=10_000.0)
}

fn parse_turbidity(text: &str) -> Result<f32, String> {
    parse_in(text, 1.0..=20.0)
}

fn parse_visibility(text: &str) -> Result<f32, String> {
    parse_in(text, 0.1..=1000.0)
}

fn parse_positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if v > 0.0 && v < 1e6 => Ok(v),
        _ => Err("expected a number above 0 and below 1000000".into()),
    }
}

fn parse_frame_rate(text: &str) -> Result<f64, String> {
    let [least, most] = [FRAME_RATES.start(), FRAME_RATES.end()];
    let rate = text.parse().ok().filter(|rate| FRAME_RATES.contains(rate));
    rate.ok_or_else(|| format!("expected a number from {least} to {most}"))
}

fn parse_percent(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if (0.0..100.0).contains(&v) => Ok(v),
        _ => Err("expected a percentage from 0 to below 100".into()),
    }
}

fn parse_shading(text: &str) -> Result<Shading, String> {
    let all = Shading::ALL;
    all.into_iter().find(|s| s.word() == text).ok_or_else(|| {
        let words: Vec<&str> = all.iter().map(|s| s.word()).collect();
        format!("expected one of {}", words.join(", "))
    })
}

fn parse_switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("expected on or off".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent_and_every_help_has_an_example() {
        Cli::command().debug_assert();
        for command in Cli::command().get_subcommands_mut().filter(|command| !command.is_hide_set()) {
            assert!(command.render_long_help().to_string().contains("Example:"), "{}", command.get_name());
        }
    }

    #[test]
    fn both_bundled_cities_are_accepted_beside_the_option_for_a_city() {
        for (line, expected) in [
            ("insula demo", DemoCity::Monaco),
            ("insula demo chiba --headless", DemoCity::Chiba),
            ("insula demo monaco --city x", DemoCity::Monaco),
        ] {
            let ClientCommand::Demo(args) = Cli::try_parse_from(line.split_whitespace()).unwrap().command else {
                panic!()
            };
            assert_eq!(args.bundled, expected, "{line}");
        }
    }

    #[test]
    fn a_place_may_have_its_option_in_all_commands() {
        let parse = |line: &str| Cli::try_parse_from(line.split_whitespace()).map(|cli| cli.command);
        for place in ["cities/delft", "--server cities/delft"] {
            let ClientCommand::Draw(args) = parse(&format!("insula draw {place} --plan --out a.svg")).unwrap() else {
                panic!()
            };
            assert_eq!(args.sources(), [PathBuf::from("cities/delft")]);
            let ClientCommand::Open(args) = parse(&format!("insula open {place}")).unwrap() else { panic!() };
            assert_eq!(args.inputs(), [PathBuf::from("cities/delft")]);
        }
        for wrong in ["insula draw --plan --out a.svg", "insula open", "insula open a --server b"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_snapshot_options_that_scripts_use_are_accepted() {
        let line = "insula snapshot --server http://h:1 --camera c.json --size 640x360 --tau 2 --out a.png --distance a.pfm \
                    --report r.json --shading lod --adapter cpu --city delft --cache-mib 64 --color-by year --range -5,20.5 \
                    --legend";
        let cli = Cli::try_parse_from(line.split_whitespace()).unwrap();
        assert_eq!((cli.global.tau, cli.global.cache_mib, cli.global.adapter), (2.0, 64, AdapterChoice::Cpu));
        let ClientCommand::Snapshot(args) = cli.command else { panic!() };
        assert_eq!((args.size, args.shading), ([640, 360], Shading::Lod));
        assert!(!args.pictures.no_caption);
        assert_eq!((args.styles.range, args.legend), (Some([-5.0, 20.5]), true));
        let refused = Cli::try_parse_from(line.replace("a.png", "a.gif").split_whitespace()).unwrap_err().to_string();
        assert!(refused.contains(".png, .jpg, .jpeg or .webp"), "{refused}");
        for invalid in ["640", "0x5", "640x", "9000x1", "axb"] {
            assert!(parse_size(invalid).is_err(), "{invalid}");
        }
    }
}
