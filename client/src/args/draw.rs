//! Arguments of `insula draw`.

use super::parse_switch;
use crate::objects::parse_range;
use clap::{ArgGroup, Args};
use insula_command_line::area::AreaArgs;
use insula_command_line::output::OverwriteArgs;
use insula_shaders::look::Look;
use insula_viewer::sun::{Bearing, SunTime, parse_bearing, parse_time};
use std::path::PathBuf;

/// Arguments of `insula draw`.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("seen").required(true).args(["view", "plan", "axonometric"]))]
pub struct DrawArgs {
    /// The folder of a baked city, its address as for `insula view`, or city files as for `insula-server bake`.
    #[arg(required_unless_present = "server", value_name = "SOURCE")]
    sources: Vec<PathBuf>,
    /// The same as one SOURCE.
    #[arg(long, value_name = "PLACE", conflicts_with = "sources")]
    server: Option<PathBuf>,
    /// Perspective view: LON,LAT,HEIGHT,HEADING,PITCH[,FOV] in degrees and metres; or, in metres of the city's system, a camera file or a
    /// view link. The field of view is the height of the drawing.
    #[arg(long = "camera", alias = "view", value_name = "CAMERA", allow_hyphen_values = true)]
    pub view: Option<PathBuf>,
    /// Keep a camera that is inside of a building or below the ground, instead of lifting it out.
    #[arg(long, requires = "view")]
    pub keep_camera: bool,
    /// View from above, to scale, north at the top.
    #[arg(long)]
    pub plan: bool,
    /// View along parallel rays, to scale: degrees clockwise from north towards which it looks, and degrees above the horizon from
    /// which it does, 0 to 90. With 0 it is an elevation.
    #[arg(long, value_name = "AZIMUTH,ELEVATION", value_parser = parse_angles, allow_hyphen_values = true)]
    pub axonometric: Option<[f64; 2]>,
    /// File to write: .svg, .pdf or .dxf.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    #[command(flatten)]
    pub area: AreaArgs,
    /// Only objects that pass, as in 'height > 20'.
    #[arg(long, value_name = "EXPR")]
    pub filter: Option<String>,
    /// Colour objects by an attribute, by `kind` or by `height`, as for `insula snapshot`: ATTRIBUTE or ATTRIBUTE:PALETTE.
    #[arg(long, value_name = "ATTRIBUTE[:PALETTE]")]
    pub color_by: Option<String>,
    /// Values of the two ends of the palette [default: the smallest and largest of the city].
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse_range, allow_hyphen_values = true, requires = "color_by")]
    pub range: Option<[f64; 2]>,
    /// Scale [default: the largest round one at which all is on the paper].
    #[arg(long, value_name = "1:N", value_parser = parse_scale, conflicts_with = "view")]
    pub scale: Option<f64>,
    /// Paper: A0 to A5 in landscape format, A3-portrait, or width and height in millimetres.
    #[arg(long, value_name = "A3|WxH", default_value = "A3")]
    pub paper: String,
    /// Stylesheet: line weights, colours, opacities, hatching and shadows, as in docs/formats.md.
    #[arg(long, value_name = "STYLE.toml")]
    pub style: Option<PathBuf>,
    /// Title of the sheet [default: that of the city].
    #[arg(long, value_name = "TEXT")]
    pub title: Option<String>,
    /// Fill the paper with the drawing: no frame, title block, scale bar and north arrow. Name the sources beside it.
    #[arg(long)]
    pub bare: bool,
    /// Draw the sheet of paper in millimetres into a .dxf file [default: metres of the city's coordinate system].
    #[arg(long)]
    pub sheet: bool,
    /// Whose light fills have: `model`, a white model by day, or `paper`, even light for reports [default: that of the stylesheet, model].
    #[arg(long, value_name = "LOOK", value_parser = parse_look)]
    pub look: Option<Look>,
    /// Whether the shadows of the sun are drawn as shapes; without a word, they are [default: as the stylesheet says, off].
    #[arg(long, value_name = "on|off", num_args = 0..=1, default_missing_value = "on", value_parser = parse_switch)]
    pub shadows: Option<bool>,
    /// Date and time of the light: 2024-06-21T17:00 in local mean solar time, or with an offset (Z, +09:00).
    #[arg(long, value_name = "TIME", value_parser = parse_time, conflicts_with = "sun")]
    pub time: Option<SunTime>,
    /// Position of the sun: degrees clockwise from the map's north, and above the horizon.
    #[arg(long, value_name = "AZIMUTH,ALTITUDE", value_parser = parse_bearing, allow_hyphen_values = true)]
    pub sun: Option<Bearing>,
    #[command(flatten)]
    pub overwrite: OverwriteArgs,
}

impl DrawArgs {
    /// The place of a city, or city files.
    pub fn sources(&self) -> &[PathBuf] {
        self.server.as_ref().map_or(&self.sources[..], std::slice::from_ref)
    }
}

fn parse_angles(text: &str) -> Result<[f64; 2], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
    match numbers[..] {
        [azimuth, elevation] if azimuth.abs() <= 360.0 && (0.0..=90.0).contains(&elevation) => Ok([azimuth, elevation]),
        _ => Err("expected degrees from north, and degrees above the horizon from 0 to 90, like 30,35".to_owned()),
    }
}

fn parse_look(text: &str) -> Result<Look, String> {
    let look = Look::of_word(text).filter(|look| *look != Look::Physical);
    look.ok_or_else(|| "expected model or paper".to_owned())
}

fn parse_scale(text: &str) -> Result<f64, String> {
    let number = text.strip_prefix("1:").and_then(|number| number.parse().ok());
    number.filter(|v| (1.0..=10_000_000.0).contains(v)).ok_or_else(|| "expected a scale such as 1:1000".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_checked() {
        assert_eq!(parse_scale("1:500"), Ok(500.0));
        assert_eq!(parse_angles("-30, 35"), Ok([-30.0, 35.0]));
        for wrong in ["500", "1:0.1", "1:nan"] {
            assert!(parse_scale(wrong).is_err(), "{wrong}");
        }
        assert!(parse_angles("30,91").is_err() && parse_angles("30").is_err());
        assert_eq!(parse_look("paper"), Ok(Look::Paper));
        assert!(parse_look("physical").is_err());
    }

    #[test]
    fn options_have_the_names_and_values_of_those_of_pictures() {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            draw: DrawArgs,
        }
        let parse = |words: &str| {
            let line = format!("draw city --out a.svg {words}");
            <Line as clap::Parser>::try_parse_from(line.split(' ')).map(|line| line.draw)
        };
        for (words, shadows) in
            [("", None), (" --shadows", Some(true)), (" --shadows on", Some(true)), (" --shadows off", Some(false))]
        {
            assert_eq!(parse(&format!("--plan{words}")).unwrap().shadows, shadows, "{words}");
        }
        assert_eq!(parse("--camera c.json").unwrap().view, Some("c.json".into()));
        let coloured = parse("--plan --color-by height --range -1,20").unwrap();
        assert_eq!(coloured.range, Some([-1.0, 20.0]));
        assert!(parse("--plan --range 1,2").is_err() && parse("--plan --shadows maybe").is_err());
    }
}
