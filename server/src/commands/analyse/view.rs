//! View sheds: of a place, and of a planned building.

use super::super::error::CommandError;
use super::vista::vista;
use crate::analysis::answer::{Answer, EYE_M, Progress};
use crate::area_file::read_polygons;
use crate::args::AnalyseArgs;
use insula_analysis::surface::CitySurface;
use insula_analysis::view_shed::{seen_from, share_seen};
use insula_bake::read::EarthPlace;
use std::path::Path;

pub(super) fn view(
    args: &AnalyseArgs,
    surface: &CitySurface,
    place: Option<&EarthPlace>,
    progress: Progress<'_>,
) -> Result<Answer, CommandError> {
    if let Some(path) = &args.vista {
        return vista(path, surface, place, None);
    }
    if let Some(path) = &args.of {
        return view_of(args, path, surface, place, progress);
    }
    let [lon, lat, height] = args.from.ok_or_else(|| {
        CommandError::Usage("view needs --from, as in 4.3610,52.0116,1.6, or --of with --height".to_owned())
    })?;
    let wrong = |reason: &str| CommandError::Usage(format!("--from {lon},{lat},{height}: {reason}"));
    let place = place.ok_or_else(|| wrong("it is not known where on Earth this city lies"))?;
    let on_map = place.on_map([lon, lat]).ok_or_else(|| wrong("out of the city's coordinate system"))?;
    let beyond = || {
        let corner = |share: [f64; 2]| {
            let size = surface.size().map(|cells| cells as f64 * surface.cell_m);
            place.lon_lat([0, 1].map(|k| surface.corner[k] + share[k] * size[k])).unwrap_or_default()
        };
        let ([west, south], [east, north]) = (corner([0.0, 0.0]), corner([1.0, 1.0]));
        wrong(&format!("beyond the area, which lies in {west:.4},{south:.4},{east:.4},{north:.4}"))
    };
    let cell = surface.cell_at(on_map).ok_or_else(beyond)?;
    let top = surface.top(cell[1] * surface.size()[0] + cell[0]);
    if !top.is_finite() {
        return Err(wrong("nothing was baked there, so that the height of the ground is not known"));
    }
    let eye = [on_map[0], on_map[1], surface.base_m + f64::from(top) + height];
    let target_m = args.target_height.unwrap_or(0.0);
    let seen = seen_from(surface, eye, target_m, f64::INFINITY).ok_or_else(beyond)?;
    let note = format!("the eye is {height} m above the ground or roof there, {:.1} m above sea level", eye[2]);
    Ok(Answer { notes: vec![note], ..Answer::of_places(surface, &seen, "visibility".to_owned()) })
}

/// From where a planned building is seen.
fn view_of(
    args: &AnalyseArgs,
    path: &Path,
    surface: &CitySurface,
    place: Option<&EarthPlace>,
    progress: Progress<'_>,
) -> Result<Answer, CommandError> {
    let polygons = read_polygons(path, surface.bounds(), place);
    let polygons = polygons.map_err(|reason| CommandError::Usage(format!("--of {reason}")))?;
    let wrong = |reason: &str| CommandError::Usage(format!("--of {}: {reason}", path.display()));
    let [polygon] = &polygons[..] else { return Err(wrong("more than one polygon")) };
    let outline = polygon.first().map(Vec::as_slice).unwrap_or_default();
    let height = args.height.unwrap_or_default();
    let eye_m = args.target_height.unwrap_or(EYE_M);
    let share = share_seen(surface, outline, height, eye_m, progress)
        .ok_or_else(|| wrong("no part of it is on ground that was baked"))?;
    let value = |(index, share)| if surface.is_known(index) { share } else { f32::NAN };
    let tops = share.into_iter().enumerate().map(value).collect();
    let title = format!("visible share of a building of {height} m");
    let note = format!("the building is {height} m high; eyes are {eye_m} m above ground or roof");
    Ok(Answer { tops, title, notes: vec![note], ..Answer::of_places(surface, &[], String::new()) })
}
