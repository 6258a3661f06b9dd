//! Arguments of `analyse`.

use super::JsonArgs;
use super::parse::city_parser;
use clap::{ValueEnum, value_parser};
use insula_command_line::area::AreaArgs;
use insula_command_line::output::OverwriteArgs;
use std::path::PathBuf;

/// What `analyse` computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Analysis {
    /// Hours of sun by a rule
    Sun,
    /// Sky view factors, and vertical sky components of walls
    Sky,
    /// Energy of sun and sky in a year, without clouds or with the weather of a file
    Solar,
    /// Shadows at a time
    Shadow,
    /// Which places are visible from a point, or see a planned building
    View,
}

/// Arguments of `analyse`.
#[derive(Debug, clap::Args)]
pub struct AnalyseArgs {
    /// City folder
    #[arg(value_parser = city_parser())]
    pub city: PathBuf,
    /// What to compute
    #[arg(value_enum, value_name = "WHAT")]
    pub what: Analysis,
    /// Raster of the results: hours of sun; sky view factors from 0 to 1; kWh/m2 a year of `solar`; 1 for shadow and for visible places, 0 elsewhere. With a name
    /// that ends with .geojson, the areas of `shadow` and `view` as polygons
    #[arg(long, value_name = "FILE.tif|FILE.geojson|FILE.csv")]
    pub out: PathBuf,
    /// Table with a row for each building, of `sun`, `sky`, `solar` and `view --vista`. With a name that ends with .fgb, it is FlatGeobuf,
    /// with the footprints and attributes of buildings
    #[arg(long, value_name = "FILE.csv|FILE.fgb")]
    pub buildings: Option<PathBuf>,
    /// Sheet of paper with the plan of the city under the colours of the values, for a part of a city (--bbox) or a small one
    #[arg(long, value_name = "FILE.pdf")]
    pub pdf: Option<PathBuf>,
    /// Gardens and other open areas, for the values of the ground in each of them: polygons in a GeoJSON file, in degrees or in metres of the
    /// city's coordinate system. Without --bbox, only the rectangle around them is computed
    #[arg(long, value_name = "FILE.geojson")]
    pub gardens: Option<PathBuf>,
    #[command(flatten)]
    pub area: AreaArgs,
    /// Rule of `sun`: a name or a TOML file
    #[arg(long, value_name = "NAME|FILE")]
    pub rule: Option<String>,
    /// Hours of `sun` at the points of this table, by rays against the finest triangles; --out is a table, too. Its columns are x and y in
    /// metres or lon and lat in degrees, height above the ground or z above sea level, and, if wanted, id and azimuth, the direction that a
    /// wall looks at
    #[arg(long, value_name = "FILE.csv")]
    pub points: Option<PathBuf>,
    /// Folder for a picture of each point of --points: the sky that its rays see, with the sun's path, in sun and in shade
    #[arg(long, value_name = "DIR", requires = "points")]
    pub evidence: Option<PathBuf>,
    /// Linke's turbidity of the air of `solar`: 2 is very clear, 5 is haze [default: 3]
    #[arg(long, value_name = "T", value_parser = parse_turbidity)]
    pub turbidity: Option<f64>,
    /// Weather of a year for `solar`, with its clouds, in place of a year without any: an EPW file with the sun and the sky of each hour
    #[arg(long, value_name = "FILE.epw", conflicts_with = "turbidity")]
    pub weather: Option<PathBuf>,
    /// Time of `shadow`, with an offset from universal time, else in the time of --time-zone. Several of them make as many files, with the
    /// time in their names
    #[arg(long, value_name = "YYYY-MM-DDTHH:MM[+HH:MM]")]
    pub time: Vec<String>,
    /// First and last time of `shadow`, and the step between, as in 2025-06-21T09:00/2025-06-21T15:00/1h or /30min
    #[arg(long, value_name = "FROM/TO/STEP")]
    pub times: Option<String>,
    /// What the hours of --time and --times are that have no offset: true-solar, mean-solar, or a time zone with its summer time, such as
    /// Europe/Amsterdam [default: mean-solar]
    #[arg(long, value_name = "NAME")]
    pub time_zone: Option<String>,
    /// Place of the eye of `view`: longitude, latitude, and metres above the ground or the roof there
    #[arg(long, value_name = "LON,LAT,H", value_parser = parse_eye, allow_hyphen_values = true)]
    pub from: Option<[f64; 3]>,
    /// Height of the targets of `view` above the ground or the roof, in metres [default: 0; 1.6 with --of]
    #[arg(long, value_name = "M", value_parser = parse_height, allow_hyphen_values = true)]
    pub target_height: Option<f64>,
    /// Outline of a planned building, for the share of it that `view` sees from each place: a polygon in a GeoJSON file, in degrees or in
    /// metres of the city's coordinate system
    #[arg(long, value_name = "FILE", conflicts_with = "from", requires = "height")]
    pub of: Option<PathBuf>,
    /// Height of the planned building of --of above the ground, in metres
    #[arg(long, value_name = "M", requires = "of", value_parser = parse_height, allow_hyphen_values = true)]
    pub height: Option<f64>,
    /// Protected vistas, for what breaks into them: a GeoJSON file with a line from the viewpoint to the target of each, with their heights
    /// above sea level, and the corridor's width there as `width_m`, or its angle as `angle_deg`. The raster has metres above the plane;
    /// the table of --buildings has a row for each building that rises above it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["from", "of"])]
    pub vista: Option<PathBuf>,
    /// Lines of sight of `view` from each point of a table to each of another one; --out is a table, too: whether each is free, its first
    /// obstacle, and its clearance. Columns are those of --points
    #[arg(long, num_args = 2, value_names = ["FILE.csv", "FILE.csv"], conflicts_with_all = ["from", "of", "vista"])]
    pub between: Vec<PathBuf>,
    /// Proposal, for what it changes: a TOML file of models and blocks that are added to the city, and of what is removed from it. Values
    /// are then those after less those before, up to 500 m around it; with --points, --between and --vista, they are those after
    #[arg(long, value_name = "FILE.toml")]
    pub proposal: Option<PathBuf>,
    /// Heights above the ground of the points on walls, in metres [default: those of the rule, 1.6 for the sky, 5 for `solar`]
    #[arg(long, value_name = "M,M", value_delimiter = ',', value_parser = parse_height, allow_hyphen_values = true)]
    pub wall_heights: Vec<f64>,
    /// Distance around the area of --bbox or the points within which obstacles count, in metres
    #[arg(long, value_name = "M", default_value = "3000", value_parser = parse_reach, allow_hyphen_values = true)]
    pub reach: f64,
    /// Most cells in memory at once, with about 25 bytes each. A larger area is computed in tiles with --reach around each. Finished tiles are
    /// kept beside --out until it is written, so that a run that was ended goes on
    #[arg(long, value_name = "N", default_value = "67108864", value_parser = value_parser!(u64).range(10_000..=67_108_864))]
    pub cells_at_once: u64,
    /// Share of the tiles of an area that does not fit into memory at once, as in 2/8, for several machines with one folder: they are kept
    /// beside --out, and the same command without this option writes it
    #[arg(long, value_name = "K/N", value_parser = parse_share)]
    #[arg(conflicts_with_all = ["points", "between", "proposal", "vista", "from", "of"])]
    pub tiles: Option<[u32; 2]>,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

fn parse_eye(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let eye: Option<[f64; 3]> = numbers.and_then(|numbers| numbers.try_into().ok());
    eye.filter(|[lon, lat, height]| lon.abs() <= 180.0 && lat.abs() <= 90.0 && (0.0..=10_000.0).contains(height))
        .ok_or_else(|| "write longitude, latitude and metres above the ground, as in 4.3610,52.0116,1.6".to_owned())
}

fn parse_height(text: &str) -> Result<f64, String> {
    let height = text.trim().parse().ok().filter(|height| (0.0..=1000.0).contains(height));
    height.ok_or_else(|| "expected metres, 0 to 1000".to_owned())
}

fn parse_reach(text: &str) -> Result<f64, String> {
    let reach = text.trim().parse().ok().filter(|reach| (0.0..=100_000.0).contains(reach));
    reach.ok_or_else(|| "expected metres, 0 to 100000".to_owned())
}

fn parse_turbidity(text: &str) -> Result<f64, String> {
    let turbidity = text.trim().parse().ok().filter(|turbidity| (1.0..=20.0).contains(turbidity));
    turbidity.ok_or_else(|| "expected 1 to 20".to_owned())
}

fn parse_share(text: &str) -> Result<[u32; 2], String> {
    let numbers = text.split_once('/').and_then(|(part, of)| Some([part.parse().ok()?, of.parse().ok()?]));
    numbers
        .filter(|[part, of]: &[u32; 2]| (1..=*of).contains(part))
        .ok_or_else(|| "expected a number and of how many, as in 2/8".to_owned())
}
