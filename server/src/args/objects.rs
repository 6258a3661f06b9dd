//! Arguments of the commands that read objects.

use std::path::PathBuf;

/// Arguments of `objects`.
#[derive(Debug, clap::Args)]
pub struct ObjectsArgs {
    /// City folder
    pub city: PathBuf,
    /// Numbers of objects, as pictures and tiles give them [default: the attributes of the city]
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(..=0xffff_fffe))]
    pub ids: Vec<u32>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}
