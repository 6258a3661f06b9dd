//! The evidence of a place: what it sees of the sky, as a picture with the sun's path.

use super::answer::{Progress, grown};
use super::error::RequestError;
use image::{ImageError, ImageFormat, RgbImage};
use insula_analysis::evidence::Evidence;
use insula_analysis::points::{Point, PointHeight, sun_at_points};
use insula_analysis::rays::CityTriangles;
use insula_analysis::rule::Rule;
use insula_analysis::sun::Site;
use insula_analysis::surface::CitySurface;
use insula_export::raster::CellExtent;
use insula_export::source::ExportSource;
use insula_export::table::{ExportError, attribution};
use std::io::{self, Cursor};
use std::path::PathBuf;
use std::slice;

/// How far around a place the ground is read.
pub(crate) const GROUND_M: f64 = 20.0;
/// Most triangles around a place, which take about 115 bytes each.
const MAX_TRIANGLES: usize = 2_000_000;

/// The city and who must be named.
pub(crate) fn credit(source: &dyn ExportSource) -> String {
    let attribution = attribution(source.manifest());
    let title = &source.manifest().title;
    if attribution.is_empty() { title.clone() } else { format!("{title}: {attribution}") }
}

/// A picture as PNG. Fails if it is too large for one.
pub(crate) fn png(picture: &RgbImage) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// A place whose sky is asked for: the ground or the roof there.
pub(crate) struct SkyPlace {
    /// As the picture names it.
    pub(crate) name: String,
    /// World metres.
    pub(crate) at: [f64; 2],
    /// What stands so far around it hides the sky.
    pub(crate) reach_m: f64,
}

impl SkyPlace {
    /// What it sees of the sky, with what a rule counts of the sun's path, as PNG. Fails if no part of the city lies there, if more than
    /// `max_cells` cells or too many triangles do, or if the city cannot be read, and once `progress` says so.
    pub(crate) fn picture(
        self,
        source: &dyn ExportSource,
        (site, rule): (&Site, &Rule),
        max_cells: u64,
        progress: Progress<'_>,
    ) -> Result<Vec<u8>, RequestError> {
        let near = Some(grown([self.at; 2], GROUND_M));
        if CellExtent::of(source.manifest(), near).map_err(RequestError::of_export)?.len() > max_cells {
            return Err(RequestError::TooLarge);
        }
        let ground = CitySurface::read(source, near).map_err(RequestError::of_export)?;
        let around = grown([self.at; 2], self.reach_m);
        let city = CityTriangles::read_at_most(source, around, MAX_TRIANGLES).map_err(RequestError::of_export)?;
        if !progress(0.5) {
            return Err(RequestError::Stopped);
        }
        let point = Point { id: self.name, place: self.at, height: PointHeight::AboveTop(0.0), azimuth_deg: None };
        let suns = sun_at_points(&city, Some(&ground), slice::from_ref(&point), site, rule);
        let Some(sun) = suns.first().and_then(Option::as_ref) else {
            return Err(RequestError::Outside("no part of the city lies at the place".to_owned()));
        };
        let evidence = Evidence { city: &city, site, rule, note: None, credit: credit(source) };
        let written = png(&evidence.picture(&point, sun));
        written.map_err(|error| {
            let (path, source) = (PathBuf::from("picture.png"), io::Error::other(error));
            RequestError::Source(ExportError::Write { path, source })
        })
    }
}
