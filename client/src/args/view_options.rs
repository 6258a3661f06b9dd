//! Which city a command shows, and from where.

use clap::Args;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;

/// Heading of eyes on streets without one: north.
const NORTH: f64 = 0.0;

/// The city of a command.
#[derive(Debug, Clone, Default, Args)]
#[group(id = "city_place", required = true, multiple = false)]
pub struct PlaceArgs {
    /// City: `http://host:port`, `http://host:port/v1/cities/NAME`, the address of its page, a view link (`insula://...`), the folder of a
    /// baked city, or the URL of such a folder on any host that supports range requests.
    #[arg(value_name = "PLACE")]
    place: Option<OsString>,
    /// The same as PLACE.
    #[arg(long, value_name = "PLACE")]
    server: Option<OsString>,
}

impl From<OsString> for PlaceArgs {
    fn from(place: OsString) -> Self {
        Self { place: Some(place), server: None }
    }
}

impl PlaceArgs {
    /// The place as it was typed.
    pub fn place(&self) -> &OsStr {
        self.place.as_deref().or(self.server.as_deref()).unwrap_or_default()
    }
}

/// Where a picture is taken.
#[derive(Debug, Clone, Default, Args)]
pub struct ViewpointArgs {
    /// LON,LAT,HEIGHT,HEADING,PITCH[,FOV] in degrees and metres, the heading clockwise from north; or, in metres of the city's system, a
    /// camera file `{"position":[x,y,z],"target":[x,y,z],"up":[0,0,1],"fov_y_deg":60}` or a view link [default: that of the view link, else
    /// the first view of the city].
    #[arg(long, value_name = "CAMERA", group = "viewpoint", allow_hyphen_values = true)]
    pub camera: Option<PathBuf>,
    /// Eye above the ground at a place in degrees, which looks in a direction clockwise from north [default: to the north].
    #[arg(long, value_name = "LON,LAT[,HEADING]", group = "viewpoint", value_parser = parse_street, allow_hyphen_values = true)]
    pub at_street: Option<StreetPlace>,
    /// Look at a place in degrees and its height in metres, from the south or, on the southern half of the Earth, from the north.
    #[arg(long, value_name = "LON,LAT,H", group = "viewpoint", value_parser = parse_target, allow_hyphen_values = true)]
    pub lookat: Option<Target>,
    /// Keep a camera that is inside of a building or below the ground, instead of lifting it out.
    #[arg(long)]
    pub keep_camera: bool,
}

/// A place on a street, and a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreetPlace {
    /// Longitude and latitude in degrees.
    pub place_deg: [f64; 2],
    /// Degrees clockwise from north.
    pub heading_deg: f64,
}

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Longitude and latitude in degrees.
    pub place_deg: [f64; 2],
    /// In the city's heights.
    pub height_m: f64,
}

fn parse_street(text: &str) -> Result<StreetPlace, String> {
    let wrong = || "write LON,LAT or LON,LAT,HEADING in degrees, like 4.3571,52.0116,90".to_owned();
    let (place_deg, heading) = parse_place(text).ok_or_else(wrong)?;
    Ok(StreetPlace { place_deg, heading_deg: heading.unwrap_or(NORTH) })
}

fn parse_target(text: &str) -> Result<Target, String> {
    let wrong = || "write LON,LAT,H in degrees and metres, like 4.3571,52.0116,20".to_owned();
    let (place_deg, height) = parse_place(text).ok_or_else(wrong)?;
    Ok(Target { place_deg, height_m: height.ok_or_else(wrong)? })
}

/// Longitude, latitude and a further finite number, if there is one.
fn parse_place(text: &str) -> Option<([f64; 2], Option<f64>)> {
    let numbers: Vec<f64> = text.split(',').map(|number| number.trim().parse().ok()).collect::<Option<_>>()?;
    let (place, third) = match numbers[..] {
        [lon, lat] => ([lon, lat], None),
        [lon, lat, third] => ([lon, lat], Some(third)),
        _ => return None,
    };
    let is_on_earth = (-180.0..=180.0).contains(&place[0]) && (-90.0..=90.0).contains(&place[1]);
    (is_on_earth && third.is_none_or(|number| number.abs() < 1e5)).then_some((place, third))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_in_degrees() {
        let street = parse_street("-70.5, -33.25,270").unwrap();
        assert_eq!(street, StreetPlace { place_deg: [-70.5, -33.25], heading_deg: 270.0 });
        assert_eq!(parse_street("4.3,52").unwrap().heading_deg, NORTH);
        assert_eq!(parse_target("4.3,52,20").unwrap(), Target { place_deg: [4.3, 52.0], height_m: 20.0 });
        for wrong in ["4.3", "4.3,52,1,2", "85000,447500", "4.3,91", "nan,52", "4,52,inf", ""] {
            assert!(parse_street(wrong).is_err() && parse_target(wrong).is_err(), "{wrong}");
        }
        assert!(parse_target("4.3,52").is_err());
    }
}
