//! Arguments of `sign` and `publish`.

use super::JsonArgs;
use super::parse::{parse_signed_city, parse_site_address};
use crate::config::PublicUrl;
use crate::share_link::{parse_lifetime, parse_version};
use insula_command_line::area::AreaArgs;
use std::path::PathBuf;
use std::time::Duration;

#[derive(Debug, clap::Args)]
#[command(
    mut_arg("bbox", |arg| arg.help("Area that the link opens, in degrees, with the city's folder as --city [default: all]")),
    mut_arg("bbox_metres", |arg| arg.help("The same in metres of the city's coordinate system"))
)]
/// Arguments of `sign`.
pub struct SignArgs {
    /// Name of the city, or its folder
    #[arg(long, value_name = "NAME|CITY", value_parser = parse_signed_city)]
    pub city: String,
    /// Lifetime of the link, as in 30m, 12h, 7d or 4w
    #[arg(long, value_name = "TIME", value_parser = parse_lifetime)]
    pub expires: Duration,
    #[command(flatten)]
    pub area: AreaArgs,
    /// Page, manifest, tiles and search only
    #[arg(long)]
    pub read_only: bool,
    /// Version that the link opens; may end with * [default: all versions]
    #[arg(long, value_name = "V", default_value = "*", hide_default_value = true, value_parser = parse_version)]
    pub version: String,
    /// Address of the server, which the link begins with; with its path behind a proxy [default: public_url of the settings, or
    /// http://127.0.0.1:7700]
    #[arg(long, value_name = "URL")]
    pub url: Option<PublicUrl>,
    /// File of keys, one "ID SECRET" per line [default: access.share_keys of the settings]
    #[arg(long, value_name = "FILE")]
    pub keys: Option<PathBuf>,
    /// TOML file of settings
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
}

/// Arguments of `publish`.
#[derive(Debug, Default, clap::Args)]
pub struct PublishArgs {
    /// City folders, or folders of city folders
    #[arg(required = true, value_name = "CITY")]
    pub cities: Vec<PathBuf>,
    /// Folder to write the site to. A site there is replaced at the very end; any other folder that is not empty is refused
    #[arg(long, value_name = "SITE")]
    pub out: PathBuf,
    /// Title of the site
    #[arg(long, value_name = "T")]
    pub title: Option<String>,
    /// Address that the site will have, for previews of links to it, catalogues, and the page of wrong addresses
    #[arg(long, value_name = "URL", value_parser = parse_site_address)]
    pub url: Option<String>,
    /// Write each city as 3D Tiles, too, for QGIS, ArcGIS Pro, CesiumJS and other viewers
    #[arg(long)]
    pub tileset: bool,
    /// Folder of proposals that the pages of cities show, as CITY/NAME.toml
    #[arg(long, value_name = "DIR")]
    pub proposals: Option<PathBuf>,
    /// TOML file of settings, of which the table site counts: name, logo, colour, imprint and first views
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
}
