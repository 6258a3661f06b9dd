//! The command line as it is typed. `serve` turns its part into a [`ServeConfig`](crate::config::ServeConfig).

#[cfg(feature = "bake")]
mod analyse;
mod choices;
mod meshes;
mod objects;
mod parse;
mod publish;

use crate::config::PublicUrl;
#[cfg(feature = "bake")]
pub use analyse::{AnalyseArgs, Analysis};
pub use choices::{GeneratedFacades, GeneratedGround, LengthUnit, Preference, UpAxis, VisibilityRenderer};
use clap::builder::ArgPredicate;
use clap::{Parser, Subcommand};
use insula_command_line::SetupCommand;
use insula_command_line::area::AreaArgs;
use insula_command_line::output::OverwriteArgs;
use insula_protocol::TileId;
use insula_protocol::blockmap::Quality;
pub use meshes::{AoArgs, CompareArgs, CompressArgs, DecompressArgs, SimplifyArgs};
#[cfg(feature = "bake")]
pub use objects::{ChangesArgs, ExportArgs, ExportFormat};
pub use objects::{ObjectsArgs, SearchArgs};
pub use parse::GeoPlace;
use parse::{
    city_parser, parse_address, parse_bytes, parse_cell, parse_crs, parse_date, parse_kilometres, parse_metres,
    parse_name, parse_place, parse_positive_metres, parse_quality, parse_tile,
};
pub use publish::{PublishArgs, SignArgs};
use std::path::PathBuf;

const EXAMPLE: &str = "Example:\n  insula-server bake delft.city.json --out delft\n  insula-server serve delft";

/// Bakes cities and serves them.
#[derive(Debug, Parser)]
#[command(name = "insula-server", version, after_help = EXAMPLE)]
pub struct Args {
    #[command(subcommand)]
    pub command: ServerCommand,
}

/// A command with its arguments.
#[derive(Debug, Subcommand)]
pub enum ServerCommand {
    /// Bake city files into a city that can be served
    #[command(
        after_help = "Example:\n  insula-server bake buildings.city.json terrain.city.json --out cities/delft --cell 0.5 \\\n    --attribution \"3D BAG, tudelft3d\" --licence \"CC BY 4.0\" --source-url https://3dbag.nl\n\nIf the bake is killed, CITY is either absent or complete; --resume continues where it stopped.\nAfter a change of the sources, the same command with --update bakes only what has changed."
    )]
    Bake(Box<BakeArgs>),
    /// Serve cities over HTTP
    #[command(
        after_help = "Example:\n  insula-server serve cities/delft cities/chiba --listen 0.0.0.0:7700\n\nSettings are read from a TOML file, then from the environment (limits.in_flight is INSULA_SERVE_LIMITS_IN_FLIGHT),\nthen from --set; later values override earlier ones. --print-config prints all settings with their documentation.\nSIGHUP reloads cities, certificate and tokens. Replace a city's folder by renaming, as bake does.\nThe log goes to standard error; RUST_LOG sets its level."
    )]
    Serve(ServeArgs),
    /// Print a link that opens a private city for a time
    #[command(
        after_help = "Example:\n  echo \"2026-11 $(openssl rand -hex 32)\" >> share.keys\n  insula-server sign --keys share.keys --city delft --expires 7d --url https://cities.example.org\n\nA server that has the same file as access.share_keys accepts the link. The last key of the file signs; all verify.\nRemove a key to end its links. Who has a link has the city: send it over a private channel."
    )]
    Sign(SignArgs),
    /// Write a static web site with the viewer and cities
    #[command(
        after_help = "Example:\n  insula-server publish cities/delft cities/chiba --out site --title \"Our cities\"\n\nSITE needs no server of its own: any host that answers range requests will do (object stores, nginx, web hosts).\nAn earlier site is replaced at the end; any other folder that is not empty is refused."
    )]
    Publish(PublishArgs),
    /// Show the contents of a city, or of a file before it is baked
    #[command(
        after_help = "Example:\n  insula-server inspect cities/delft\n  insula-server inspect 52397519_bldg_6697_op.gml\n  insula-server inspect cities/delft --tile 3/2/5 --png node.png\n  insula-server inspect cities/delft --volume 3/2/5 --png voxels.png --ply voxels.ply"
    )]
    Inspect(Box<InspectArgs>),
    /// Show what is known of objects, or the attributes that a city has
    #[command(
        after_help = "Example:\n  insula-server objects cities/delft\n  insula-server objects cities/delft --ids 17,4711 --json"
    )]
    Objects(ObjectsArgs),
    /// Find objects by names, addresses and identifiers
    #[command(
        after_help = "Example:\n  insula-server search cities/delft \"oude kerk\"\n  insula-server search cities/delft \"markt 87\" --limit 3 --json\n\nA text matches if each word of TEXT begins a word of it; case and accents do not matter. Longer words may have a typo."
    )]
    Search(SearchArgs),
    /// Write a city, or a part of it, in a format of other programs
    #[cfg(feature = "bake")]
    #[command(
        after_help = "Example:\n  insula-server export cities/delft --format flatgeobuf --out delft.fgb --filter 'height > 20'\n  insula-server export cities/delft --format 3dtiles --out delft.3tz"
    )]
    Export(ExportArgs),
    /// List the buildings that were built, demolished or changed from one city to another
    #[cfg(feature = "bake")]
    #[command(
        after_help = "Example:\n  insula-server changes cities/delft-2024 cities/delft-2025 --out changes.csv\n\nBuildings are the same if their footprints overlap by half; identifiers only tell which of several is meant.\nBake both cities alike: other cells and levels of detail look like changes."
    )]
    Changes(ChangesArgs),
    /// Compute hours of sun, sky view factors, shadows and view sheds
    #[cfg(feature = "bake")]
    #[command(
        after_help = "Example:\n  insula-server analyse cities/delft sun --rule nl-tno-light --out sun.tif --buildings sun.csv\n  insula-server analyse cities/delft sky --out sky.tif\n  insula-server analyse cities/delft shadow --time 2025-12-21T10:00+01:00 --out shadow.tif\n  insula-server analyse cities/delft view --from 4.3610,52.0116,40 --out view.tif\n  insula-server analyse cities/delft view --between masts.csv houses.csv --out lines.csv\n\nRules: au-21-june, cn-great-cold, cn-winter-solstice, en-17037, jp-winter-solstice, nl-the-hague, nl-tno-light,\nnl-tno-strict, uk-br209-apsh, uk-br209-apsh-winter, uk-br209-gardens, or a TOML file. A result says how many hours there are and how many the rule asks for;\nwhether a plan is lawful is for others to say."
    )]
    Analyse(Box<AnalyseArgs>),
    /// Print the HTTP interface as OpenAPI 3.0
    #[command(after_help = "Example:\n  insula-server openapi > openapi.json")]
    Openapi,
    /// Check every checksum of a city and decode every tile
    #[command(
        after_help = "Example:\n  insula-server verify cities/delft\n\nPrints the damaged tiles, one per line, and exits with 1 if there are any."
    )]
    Verify(VerifyArgs),
    /// Compress a mesh file
    #[command(
        after_help = "Example:\n  insula-server compress bunny.ply bunny.insm --bits 12\n\nReads PLY, OFF, OBJ and STL. Welds vertices at the same position and triangulates polygons; attributes of corners are kept.\nPositions are rounded to a grid of 2^BITS points along the longest side; nothing else is lost. Repairs are counted."
    )]
    Compress(CompressArgs),
    /// Decompress a file that `compress` wrote
    #[command(
        after_help = "Example:\n  insula-server decompress bunny.insm bunny.ply\n\nThe output's file name extension selects PLY, OFF, OBJ or STL."
    )]
    Decompress(DecompressArgs),
    /// Simplify a mesh file
    #[command(
        after_help = "Example:\n  insula-server simplify skull.obj skull_small.obj --ratio 0.1\n  insula-server simplify town.obj town_small.obj --error 0.5\n\nReads and writes PLY, OFF, OBJ and STL, selected by file name extension. A small component is removed as a whole once that\ncosts less than collapsing another edge."
    )]
    Simplify(SimplifyArgs),
    /// Measure how far two meshes or cities lie from each other
    #[command(
        after_help = "Example:\n  insula-server compare skull.obj skull_small.obj\n  insula-server compare delft.city.jsonl cities/delft --heatmap delft.ply\n\nReads PLY, OFF, OBJ and STL, baked cities (their finest meshes, and columns where they have none)\nand everything that `bake` reads. Prints the mean, the root mean square and the largest distance in both directions, and in parts\nof the first one's diagonal."
    )]
    Compare(CompareArgs),
    /// Compute the ambient occlusion of a mesh
    #[command(
        after_help = "Example:\n  insula-server ao nefertiti.obj --out nefertiti_ao.ply\n\nReads PLY, OFF, OBJ and STL. Each vertex of OUT.ply has the cosine-weighted share of its surroundings that it sees as `quality`,\nfrom 0 (closed) to 1 (open), and the same as grey colour."
    )]
    Ao(AoArgs),
    #[command(flatten)]
    Setup(SetupCommand),
}

#[derive(Debug, Clone, Default, clap::Args)]
#[command(
    mut_arg("bbox", |arg| arg.help("Only objects that reach into this area, in degrees")),
    mut_arg("bbox_metres", |arg| arg.help("The same in metres of the city's coordinate system"))
)]
/// What is read of the inputs, and where it goes.
pub struct ReadArgs {
    /// Coordinate system of the city, as in EPSG:25832 [default: the first projected one of the inputs, else a UTM zone]
    #[arg(long, value_name = "EPSG:N", value_parser = parse_crs)]
    pub crs: Option<String>,
    /// Folder of geoid grids (GeoTIFF, as PROJ has them), for heights above the ellipsoid
    #[arg(long, value_name = "DIR", env = "INSULA_GRIDS")]
    pub grids: Option<PathBuf>,
    /// Longitude, latitude (degrees) and height (metres) of the origin of meshes: OBJ, PLY, STL, glTF
    #[arg(long, value_name = "LON,LAT,H", value_parser = parse_place, allow_hyphen_values = true)]
    pub at: Option<GeoPlace>,
    /// Order of the coordinates where files do not tell it right: en (east or longitude first), ne, or auto; for some inputs
    /// as in 'north/*.gml=ne'; may be repeated, the last that fits counts [default: auto]
    #[arg(long, value_name = "[PATTERN=]ORDER")]
    pub axis_order: Vec<String>,
    #[command(flatten)]
    pub area: AreaArgs,
    /// Only objects of these kinds: building, building-part, bridge, tunnel, road, rail, water, vegetation, land-use,
    /// furniture, relief, generic
    #[arg(long, value_name = "KINDS", value_delimiter = ',')]
    pub only: Vec<String>,
    /// No objects of these kinds
    #[arg(long, value_name = "KINDS", value_delimiter = ',')]
    pub skip: Vec<String>,
    /// Attribute that has the heights of footprints
    #[arg(long, value_name = "NAME")]
    pub height_field: Option<String>,
    /// Unit of heights in attributes that do not tell it [default: m]
    #[arg(long, value_enum, value_name = "UNIT")]
    pub height_unit: Option<LengthUnit>,
    /// Value of elevation models that marks missing heights, besides what they declare; then all heights from -12,000 to
    /// 9,000 m count, else those from -500 m
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    pub nodata: Option<f64>,
    /// Attributes that the city must not have, as in 'owner*'; may be repeated
    #[arg(long, value_name = "NAME")]
    pub drop: Vec<String>,
    /// Attribute whose texts can be searched, besides names, addresses and identifiers; may be repeated
    #[arg(long, value_name = "NAME")]
    pub search: Vec<String>,
    /// Of objects that inputs have at several levels of detail, keep the best
    #[arg(long, value_enum, value_name = "lod")]
    pub prefer: Option<Preference>,
    /// Read files to which links in folders of inputs lead, also outside of the folders
    #[arg(long)]
    pub follow_links: bool,
    /// Host to which an address may be redirected, with its port if it is unusual; may be repeated
    #[arg(long, value_name = "HOST")]
    pub allow_host: Vec<String>,
    /// Keep objects that two inputs have
    #[arg(long, conflicts_with = "prefer")]
    pub keep_duplicates: bool,
}

/// How a command says what it did.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct JsonArgs {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `bake`.
#[derive(Debug, Clone, clap::Args)]
pub struct BakeArgs {
    /// City files, folders or .zip archives of them, patterns as in 'tiles/*.gml', @FILE with an input in each line, or
    /// addresses (https://, s3://BUCKET/...).
    /// With --work: a step, such as 'region 7'
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub read: ReadArgs,
    /// Folder to write the city to. A city there is replaced at the very end; any other folder that is not empty is refused
    #[arg(
        long,
        value_name = "CITY",
        required = false,
        required_unless_present = "work",
        default_value_if("work", ArgPredicate::IsPresent, "city")
    )]
    pub out: PathBuf,
    /// Run one step of a bake that many machines run; the steps' results are in this folder or at s3://BUCKET/PATH, and
    /// in the end the city, in its folder city
    #[arg(long, value_name = "URL", conflicts_with_all = ["report", "resume", "json"])]
    pub work: Option<String>,
    /// Hash of the job, as the step 'plan' that began it printed; steps of another job fail [default: that in the file WORK.job beside
    /// the folder]
    #[arg(long, value_name = "HASH", env = "INSULA_JOB")]
    pub job: Option<String>,
    /// Inputs of a bake in steps, for the step 'plan' that begins it
    #[arg(long = "inputs", value_name = "INPUT", num_args = 1.., requires = "work")]
    pub step_inputs: Vec<PathBuf>,
    /// Inputs that one scan reads in a bake in steps, as in 256MiB
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes, requires = "step_inputs")]
    pub chunk: Option<u64>,
    /// Leaves along the side of a region in a bake in steps: a power of two from 2 to 4096 [default: 32]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=4096), requires = "step_inputs")]
    pub region: Option<u32>,
    /// Width of a leaf's columns in metres, 0.01 to 1000 [default: 1, less for a single small mesh]
    #[arg(long, value_name = "M", value_parser = parse_cell, allow_negative_numbers = true)]
    pub cell: Option<f64>,
    /// Scans of statues and monuments, placed in the city by a JSON file
    #[arg(long, value_name = "FILE.json")]
    pub landmarks: Option<PathBuf>,
    /// Stone of a mesh that is the only input: a preset, or a file of parameters
    #[arg(long, value_name = "NAME|FILE.json", conflicts_with = "landmarks")]
    pub stone: Option<String>,
    /// Lowest colour quality: PSNR in dB (20 to 60), or lossless
    #[arg(long, value_name = "DB", default_value = "36", value_parser = parse_quality, allow_negative_numbers = true)]
    pub quality: Quality,
    /// Omit the meshes: near views then show columns
    #[arg(long)]
    pub no_meshes: bool,
    /// Ground where the sources have no terrain
    #[arg(long, value_enum, default_value_t = GeneratedGround::Auto)]
    pub ground: GeneratedGround,
    /// Largest distance of terrain from an elevation model, in metres [default: a fifth of a cell]
    #[arg(long, value_name = "M", value_parser = parse_positive_metres, allow_negative_numbers = true)]
    pub terrain_error: Option<f64>,
    /// How far terrain reaches beyond the city, in metres
    #[arg(long, value_name = "M", default_value = "500", value_parser = parse_metres, allow_negative_numbers = true)]
    pub terrain_margin: f64,
    /// The terrain is changed to meet buildings with heights of their own that are at most this far above or below it,
    /// in metres; 0 leaves it as it is. Other buildings are reported
    #[arg(long, value_name = "M", default_value = "3", value_parser = parse_metres, allow_negative_numbers = true)]
    pub terrain_tolerance: f64,
    /// Map (such as an .osm.pbf) of which streets, water and green are painted on the city's ground, and nothing else is
    /// taken; may be repeated
    #[arg(long, value_name = "FILE")]
    pub streets: Vec<PathBuf>,
    /// Elevation model of the land around the city, or a picture of it: drawn far beyond the city in columns of up to
    /// 64 metres; may be repeated
    #[arg(long, value_name = "FILE")]
    pub surroundings: Vec<PathBuf>,
    /// How far the land around the city reaches, in kilometres
    #[arg(long, value_name = "KM", default_value = "30", requires = "surroundings", value_parser = parse_kilometres, allow_negative_numbers = true)]
    pub surroundings_reach: f64,
    /// Smallest texels of pictures from above, in metres
    #[arg(long, value_name = "M", default_value = "0.25", value_parser = parse_positive_metres, allow_negative_numbers = true)]
    pub ground_texel: f64,
    /// Walls of which the inputs have no picture: of one colour, or with generated windows
    #[arg(long, value_enum, default_value_t = GeneratedFacades::Windows)]
    pub facades: GeneratedFacades,
    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024), allow_negative_numbers = true)]
    pub threads: Option<u16>,
    /// Approximate memory to use, as in 600MiB or 2GB [default: 192MiB per thread, at least 512MiB, with scans 1200MiB]
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    pub memory: Option<u64>,
    /// Most scratch files beside CITY for its triangles and textures, as in 200GiB
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes, default_value = "64GiB")]
    pub scratch: u64,
    /// Write a report of inputs, results and times
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
    /// Continue an interrupted bake
    #[arg(long)]
    pub resume: bool,
    /// Bake only what has changed since CITY was baked; the result is the same as that of a full bake
    #[arg(long)]
    pub update: bool,
    /// Take unchanged blocks from another city of the same inputs and settings, which stays as it is
    #[arg(long, value_name = "CITY", conflicts_with_all = ["update", "work"])]
    pub reuse: Option<PathBuf>,
    /// Bake another version of a city, of the same settings and another --date: it takes little space, because CITY, which stays
    /// beside it, has the tiles that are the same
    #[arg(long, value_name = "CITY", requires = "date", conflicts_with_all = ["update", "reuse", "work"], value_parser = city_parser())]
    pub version_of: Option<PathBuf>,
    /// Day of which the city is, as in 2024-01-31: CITY@2024-01-31 names it, and pages show the versions of a city by their days
    #[arg(long, value_name = "DATE", value_parser = parse_date)]
    pub date: Option<String>,
    /// Bake the city of --reuse with a proposal: a TOML file of models and blocks that are added, and of objects that are
    /// removed
    #[arg(long, value_name = "FILE.toml", requires = "reuse")]
    pub proposal: Option<PathBuf>,
    /// Do not compute what can be seen from streets: clients there then fetch more that is occluded
    #[arg(long)]
    pub no_street_sets: bool,
    /// Do not draw the city's first view (`thumbnail.jpg`) for lists and previews of links
    #[arg(long)]
    pub no_picture: bool,
    /// Leave out inputs that cannot be read, or of which every object is left out, instead of failing
    #[arg(long)]
    pub skip_bad_inputs: bool,
    /// Name in URLs (a-z, 0-9, _ and -) [default: the folder's name]
    #[arg(long, value_parser = parse_name)]
    pub name: Option<String>,
    /// Title for people
    #[arg(long)]
    pub title: Option<String>,
    /// Author of the data, to be named wherever the city is shown
    #[arg(long, value_name = "TEXT")]
    pub attribution: Option<String>,
    /// Licence of the data
    #[arg(long, value_name = "TEXT", requires = "attribution")]
    pub licence: Option<String>,
    /// Web page of the data
    #[arg(long, value_name = "URL", requires = "attribution")]
    pub source_url: Option<String>,
    /// Axis of OBJ, PLY and STL files that points up
    #[arg(long, value_enum, default_value = "z")]
    pub obj_up: UpAxis,
    /// harmonised (default): pure and white colours of sources become materials, photos get the level of lit walls;
    /// source: keep the sources' colours and photos; or a file of colours for surfaces, objects and materials
    #[arg(long, value_name = "harmonised|source|FILE.json")]
    pub palette: Option<PathBuf>,
    /// Titles, units, order and hiding of attributes for people
    #[arg(long, value_name = "FILE.toml")]
    pub labels: Option<PathBuf>,
    /// Folder from which textures may be read besides those of the inputs; may be repeated
    #[arg(long, value_name = "DIR")]
    pub texture_root: Vec<PathBuf>,
    /// Directions of the sky from which the bake looks at the city; a quarter as many more look at undersides. More of
    /// them make occlusion more even, and take longer
    #[arg(long, default_value_t = 128, value_name = "N", value_parser = clap::value_parser!(u32).range(32..=1024))]
    pub views: u32,
    /// Device that renders the visibility maps (containers are built without gpu)
    #[arg(long, value_enum, default_value = "cpu")]
    pub visibility: VisibilityRenderer,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Arguments of `serve`.
#[derive(Debug, clap::Args)]
pub struct ServeArgs {
    /// City folders, folders of city folders, or URLs of cities (s3://BUCKET/PATH, https://HOST/PATH)
    #[arg(required_unless_present = "print_config", value_name = "CITY")]
    pub cities: Vec<PathBuf>,
    /// Address to listen on; port 0 picks a free one [default: 127.0.0.1:7700]
    #[arg(long, value_name = "HOST:PORT", value_parser = parse_address)]
    pub listen: Option<String>,
    /// Address of a listener for /healthz, /readyz and /metrics alone [default: all at --listen]
    #[arg(long, value_name = "HOST:PORT", value_parser = parse_address)]
    pub metrics_address: Option<String>,
    /// Address at which people reach the server behind a proxy, as in https://example.org/city [default: that of each request]
    #[arg(long, value_name = "URL")]
    pub public_url: Option<PublicUrl>,
    /// Do not start if one of the cities cannot be opened [default: serve the others, and try again]
    #[arg(long)]
    pub strict: bool,
    /// Make vector drawings for clients, so many at once [default: 0, none]
    #[arg(long, value_name = "N")]
    pub drawings: Option<usize>,
    /// Make analyses of sun, sky and shadows for clients, so many at once [default: 0, none]
    #[arg(long, value_name = "N")]
    pub analyses: Option<usize>,
    /// Folder of proposals that the pages of cities show, as CITY/NAME.toml
    #[arg(long, value_name = "DIR")]
    pub proposals: Option<PathBuf>,
    /// TOML file of settings
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One setting, as in limits.in_flight=64
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print all settings as a TOML file instead of serving
    #[arg(long)]
    pub print_config: bool,
}

/// Arguments of `inspect`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("picture").multiple(true))]
pub struct InspectArgs {
    /// City folder, or an input of `bake`
    #[arg(value_name = "CITY|INPUT", value_parser = city_parser())]
    pub city: PathBuf,
    #[command(flatten)]
    pub read: ReadArgs,
    /// Print JSON
    #[arg(long, conflicts_with_all = ["tile", "volume", "png", "ply"])]
    pub json: bool,
    /// Node of which the geometry, roof and wall maps are drawn, as level/x/y
    #[arg(long, value_name = "L/X/Y", value_parser = parse_tile, requires = "png", group = "node")]
    pub tile: Option<TileId>,
    /// Node of which the voxels are drawn: cubes of a column's width
    #[arg(long, value_name = "L/X/Y", value_parser = parse_tile, requires = "picture", group = "node")]
    pub volume: Option<TileId>,
    /// Image file to write of the node
    #[arg(long, value_name = "FILE", requires = "node", group = "picture")]
    pub png: Option<PathBuf>,
    /// PLY file to write of the visible faces of the node's voxels
    #[arg(long, value_name = "FILE", requires = "volume", group = "picture")]
    pub ply: Option<PathBuf>,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

/// Arguments of `verify`.
#[derive(Debug, clap::Args)]
pub struct VerifyArgs {
    /// City folder
    #[arg(value_parser = city_parser())]
    pub city: PathBuf,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn every_command_is_valid_and_has_an_example() {
        Args::command().debug_assert();
        for command in Args::command().get_subcommands().filter(|command| !command.is_hide_set()) {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains(&format!("insula-server {} ", command.get_name())), "{help}");
        }
    }

    #[test]
    fn invalid_arguments_are_usage_errors() {
        let parse = |line: &str| Args::try_parse_from(line.split(' ')).map_err(|error| error.exit_code());
        assert!(
            parse("insula-server bake a b --out c --cell 0.5 --quality lossless --threads 2 --report r.json --resume")
                .is_ok()
        );
        assert!(parse("insula-server bake a --out c --update --memory 600MiB").is_ok());
        assert!(parse("insula-server serve a b --listen localhost:0 --config c.json").is_ok());
        assert!(
            parse("insula-server sign --city a --expires 7d --bbox-metres -1,2,3,4 --read-only --version ab*").is_ok()
        );
        let link = parse("insula-server sign --city a --expires 7d --url https://h/maps/3d/").unwrap();
        assert!(
            matches!(link.command, ServerCommand::Sign(args) if args.url.as_ref().is_some_and(|url| url.base() == "https://h/maps/3d"))
        );
        assert!(parse("insula-server publish a b --out s --title T --url https://h/path").is_ok());
        assert!(parse("insula-server inspect a --tile 1/1/0 --png p.png").is_ok());
        assert!(parse("insula-server search a kerk --limit 1000 --json").is_ok());
        assert!(parse("insula-server compress a.ply b --bits 16").is_ok());
        assert!(parse("insula-server simplify a.ply b.obj --error 0.5").is_ok());
        assert!(parse("insula-server ao a.obj --out b.ply --views 64 --map 512 --gpu").is_ok());
        for invalid in [
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
            "insula-server serve a --metrics-address 7700",
            "insula-server sign --city a",
            "insula-server sign --city A --expires 7d",
            "insula-server sign --city a --expires 7",
            "insula-server sign --city a --expires 7d --bbox-metres 1,2,3",
            "insula-server sign --city a --expires 7d --bbox 84000,447000,84620,447620",
            "insula-server sign --city a --expires 7d --bbox 1,2,3,4 --bbox-metres 1,2,3,4",
            "insula-server bake a --out c --bbox 1,2,3,4 --bbox-metres 1,2,3,4",
            "insula-server sign --city a --expires 7d --url h:80",
            "insula-server sign --city a --expires 7d --url http://h/x?y",
            "insula-server inspect a --tile 1/2/0 --png p",
            "insula-server inspect a --tile 1/1/0",
            "insula-server inspect a --png p",
            "insula-server search a",
            "insula-server search a ",
            "insula-server search a kerk --limit 0",
            "insula-server search a kerk --limit 1001",
            "insula-server verify",
            "insula-server publish a",
            "insula-server publish --out s",
            "insula-server publish a --out s --url h",
            "insula-server compress a.ply",
            "insula-server compress a.ply b --bits 17",
            "insula-server decompress a",
            "insula-server simplify a.ply b.ply",
            "insula-server simplify a.ply b.ply --ratio 0",
            "insula-server simplify a.ply b.ply --ratio 0.5 --error 1",
            "insula-server simplify a.ply b.ply --error -1",
            "insula-server ao a.obj",
            "insula-server ao a.obj --out b.ply --views 0",
            "insula-server ao a.obj --out b.ply --views 4097",
            "insula-server ao a.obj --out b.ply --map 63",
            "insula-server dance",
        ] {
            assert_eq!(parse(invalid).err(), Some(2), "{invalid}");
        }
    }
}
