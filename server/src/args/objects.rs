//! Arguments of the commands that read objects.

use super::JsonArgs;
use super::parse::city_parser;
#[cfg(feature = "bake")]
use super::parse::parse_positive_metres;
#[cfg(feature = "bake")]
use insula_command_line::{area::AreaArgs, output::OverwriteArgs, parse_size, parse_tau};
use insula_objects::search::MAX_QUERY_CHARS;
#[cfg(feature = "bake")]
use std::path::Path;
use std::path::PathBuf;

/// Arguments of `objects`.
#[derive(Debug, clap::Args)]
pub struct ObjectsArgs {
    /// City folder
    #[arg(value_parser = city_parser())]
    pub city: PathBuf,
    /// Numbers of objects, as pictures and tiles give them [default: the attributes of the city]
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(..=0xffff_fffe))]
    pub ids: Vec<u32>,
    #[command(flatten)]
    pub json: JsonArgs,
}

/// Arguments of `search`.
#[derive(Debug, clap::Args)]
pub struct SearchArgs {
    /// City folder
    #[arg(value_parser = city_parser())]
    pub city: PathBuf,
    /// Starts of words of a name, an address or an identifier, in any order; 1 to 128 characters
    #[arg(value_parser = parse_text)]
    pub text: String,
    /// Most hits, 1 to 1000
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub limit: u16,
    #[command(flatten)]
    pub json: JsonArgs,
}

/// Fails for a text that no search takes.
fn parse_text(text: &str) -> Result<String, String> {
    let is_valid = !text.trim().is_empty() && text.chars().count() <= MAX_QUERY_CHARS;
    if is_valid { Ok(text.to_owned()) } else { Err(format!("expected 1 to {MAX_QUERY_CHARS} characters")) }
}

/// Arguments of `export`.
#[cfg(feature = "bake")]
#[derive(Debug, clap::Args)]
pub struct ExportArgs {
    /// City folder
    #[arg(value_parser = city_parser())]
    pub city: PathBuf,
    /// csv, geojson, geoparquet, flatgeobuf (footprints, heights and attributes), cityjsonseq, glb (meshes), geotiff (heights) or 3dtiles
    /// [default: by the name of the file]
    #[arg(long, value_name = "FORMAT", value_parser = parse_format)]
    pub format: Option<ExportFormat>,
    /// File to write: .csv, .geojson, .parquet, .fgb, .city.jsonl, .glb, .gltf or .tif; for 3dtiles a folder, or a file that ends in .3tz or
    /// .pmtiles
    #[arg(long, value_name = "PATH")]
    pub out: PathBuf,
    #[command(flatten)]
    pub area: AreaArgs,
    /// 3D Tiles for QGIS, ArcGIS Pro and others that read neither implicit tiling nor compression, two and a half to four times as large
    #[arg(long)]
    pub plain: bool,
    /// Only objects that pass, as in 'height > 20'
    #[arg(long, value_name = "EXPR")]
    pub filter: Option<String>,
    /// A row for each part of a building in a table, instead of one for the building
    #[arg(long)]
    pub parts: bool,
    /// Only objects with the middle in the polygons of a GeoJSON file, in degrees or in metres of the city's coordinate system
    #[arg(long, value_name = "FILE")]
    pub polygon: Option<PathBuf>,
    /// Only what a camera sees, as coarse as its picture allows, for `--format glb`: LON,LAT,HEIGHT,HEADING,PITCH[,FOV] in degrees and
    /// metres; or, in metres of the city's system, a camera file or a view link
    #[arg(long = "camera", alias = "view", value_name = "CAMERA", allow_hyphen_values = true)]
    pub view: Option<PathBuf>,
    /// Keep a camera that is inside of a building or below the ground, instead of lifting it out
    #[arg(long, requires = "view")]
    pub keep_camera: bool,
    /// Size of the picture of `--camera`
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1280x720", requires = "view")]
    pub size: [u32; 2],
    /// Tolerated error in pixels of the picture of `--camera`
    #[arg(long, value_name = "PX", value_parser = parse_tau, default_value = "1", requires = "view")]
    pub tau: f64,
    /// Leave texts that spreadsheets run as formulas as they are, for `--format csv` [default: an apostrophe before them]
    #[arg(long)]
    pub keep_formulas: bool,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

#[cfg(feature = "bake")]
impl ExportArgs {
    /// The format, by its name or by that of the file. Fails if neither tells it, or if they differ.
    pub fn format(&self) -> Result<ExportFormat, String> {
        let out = self.out.display();
        match (self.format, ExportFormat::by_name(&self.out)) {
            (Some(format), Some(named)) if format != named => {
                Err(format!("{out}: its name tells another format than --format; change one of them"))
            }
            (format, named) => format.or(named).ok_or_else(|| {
                let is_drawing = [".svg", ".pdf", ".dxf"].iter().any(|end| out.to_string().ends_with(end));
                let hint = if is_drawing { ", or draw it with `insula draw`" } else { "" };
                format!(
                    "{out}: its name tells no format; end it in .csv, .geojson, .parquet, .fgb, .city.jsonl, .glb, .gltf, .tif, .3tz or \
                     .pmtiles, or give --format{hint}"
                )
            }),
        }
    }

    /// Whether a model is written as text: JSON with its bytes inside.
    pub fn is_text_model(&self) -> bool {
        self.out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gltf"))
    }
}

/// A format of `export`.
#[cfg(feature = "bake")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportFormat {
    Glb,
    Tiles3d,
    Table(insula_export::format::Format),
}

#[cfg(feature = "bake")]
impl ExportFormat {
    /// The format that the name of a file tells.
    fn by_name(path: &Path) -> Option<Self> {
        use insula_export::format::Format;
        let name = path.extension().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
        match name.as_str() {
            "glb" | "gltf" => Some(Self::Glb),
            "3tz" | "pmtiles" => Some(Self::Tiles3d),
            "csv" => Some(Self::Table(Format::Csv)),
            "geojson" => Some(Self::Table(Format::GeoJson)),
            "parquet" | "geoparquet" => Some(Self::Table(Format::GeoParquet)),
            "fgb" => Some(Self::Table(Format::FlatGeobuf)),
            "jsonl" => Some(Self::Table(Format::CityJsonSeq)),
            "tif" | "tiff" => Some(Self::Table(Format::GeoTiff)),
            _ => None,
        }
    }
}

/// Arguments of `changes`.
#[cfg(feature = "bake")]
#[derive(Debug, clap::Args)]
pub struct ChangesArgs {
    /// Folder of the earlier city, or CITY@DATE for a version of it beside it
    #[arg(value_parser = city_parser())]
    pub before: PathBuf,
    /// Folder of the later city
    #[arg(value_parser = city_parser())]
    pub after: PathBuf,
    /// Table to write, with the footprint of each building that was built, demolished or changed
    #[arg(long, value_name = "FILE.csv|FILE.geojson|FILE.parquet|FILE.fgb")]
    pub out: PathBuf,
    /// Least difference in height that counts, in metres
    #[arg(long, value_name = "M", default_value = "1", value_parser = parse_positive_metres, allow_negative_numbers = true)]
    pub height_step: f64,
    /// Footprints are the same if what they have in common is at least this share of both together, 0.5 to 1
    #[arg(long, value_name = "SHARE", default_value = "0.9", value_parser = parse_overlap, allow_negative_numbers = true)]
    pub same_footprint: f64,
    /// Attribute whose values are compared, too; may be repeated
    #[arg(long, value_name = "NAME")]
    pub attribute: Vec<String>,
    /// List the buildings that did not change, too
    #[arg(long)]
    pub all: bool,
    #[command(flatten)]
    pub area: AreaArgs,
    #[command(flatten)]
    pub json: JsonArgs,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

#[cfg(feature = "bake")]
impl ChangesArgs {
    /// The format that the name of the table tells. Fails if it is none of a table.
    pub fn format(&self) -> Result<insula_export::format::Format, String> {
        match ExportFormat::by_name(&self.out) {
            Some(ExportFormat::Table(format)) if format.is_table() => Ok(format),
            _ => Err(format!("--out {}: a table is a .csv, .geojson, .parquet or .fgb", self.out.display())),
        }
    }
}

#[cfg(feature = "bake")]
fn parse_overlap(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.5..=1.0).contains(share));
    share.ok_or_else(|| "expected a share between 0.5 and 1, such as 0.9".to_owned())
}

#[cfg(feature = "bake")]
fn parse_format(text: &str) -> Result<ExportFormat, String> {
    use insula_export::format::Format;
    match text {
        "glb" => Ok(ExportFormat::Glb),
        "3dtiles" => Ok(ExportFormat::Tiles3d),
        _ => {
            let found = Format::NAMES.iter().find(|(name, _)| *name == text);
            let names: Vec<&str> = Format::NAMES.iter().map(|(name, _)| *name).collect();
            found
                .map(|(_, format)| ExportFormat::Table(*format))
                .ok_or_else(|| format!("expected {}, glb or 3dtiles", names.join(", ")))
        }
    }
}
