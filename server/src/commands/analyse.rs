//! `analyse`: hours of sun, sky, shadows and views of a city.

use super::{area_file::read_polygons, error::CommandError, output::print};
use crate::{
    args::{AnalyseArgs, Analysis},
    store::{CityStore, StoredCity, StoredObjects},
};
use indicatif::{ProgressBar, ProgressStyle};
use insula_analysis::{
    buildings::{CityValues, PlaceValues, sum_up, write_table},
    outlines::outlines,
    points::{PointHeight, around, parse_points, sun_at_points, write_table as write_points},
    rays::CityTriangles,
    rule::{DayMode, Rule},
    sky::sky_view,
    sun::{Bearing, Site, parse_time},
    sun_hours::{shadow, sun_hours},
    surface::{CitySurface, TopKind},
    view_shed::{seen_from, share_seen},
    walls::WallPoint,
};
use insula_archive::{file::read_text, new_file::replace};
use insula_bake::read::EarthPlace;
use insula_command_line::output::{FileKind, Outputs};
use insula_export::{
    format::Projections,
    raster::{CellExtent, NODATA, write_raster},
    source::ExportSource,
    table::ExportError,
};
use insula_protocol::text::{count, human_bytes, printable};
use std::path::Path;

/// How far around points the ground is read.
const GROUND_M: f64 = 20.0;
/// Largest file of points.
const MAX_POINTS_BYTES: u64 = 256 << 20;
/// Largest file of a rule.
const MAX_RULE_BYTES: u64 = 1 << 20;
/// Heights above the ground at which walls look at the sky: an eye.
const SKY_HEIGHTS_M: [f64; 1] = [EYE_M];

/// Height of an eye above the ground.
const EYE_M: f64 = 1.6;

/// Values of a surface, and what they say.
struct Answer {
    tops: Vec<f32>,
    points: Vec<WallPoint>,
    walls: Vec<f32>,
    /// What the rule asks for.
    asked: Option<f64>,
    /// Of the values, for the name of a raster.
    title: String,
    /// A word for the names of columns.
    column: &'static str,
    /// Sentences for people.
    notes: Vec<String>,
}

/// Runs `analyse`. Fails if the city cannot be read, an option does not fit, or an output cannot be written.
pub(super) fn run(args: &AnalyseArgs) -> Result<(), CommandError> {
    check_options(args)?;
    let city = CityStore::open(&args.city)?;
    check_outputs(args)?;
    let objects = StoredObjects::open(&city)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::new(city.manifest(), objects.schema(), &read);
    let manifest = city.manifest();
    let place = manifest.crs.as_deref().and_then(EarthPlace::of);
    let failed = |error: ExportError| CommandError::Export { path: args.city.clone(), reason: error.to_string() };
    let area = args.area.world_box(|degrees| place.as_ref()?.box_on_map(degrees)).map_err(CommandError::Usage)?;
    if let Some(points) = &args.points {
        return sun_at(args, points, &source, place.as_ref());
    }
    let extent = CellExtent::of(manifest, area).map_err(failed)?;
    let around = area.map(|[min, max]| [min.map(|v| v - args.reach), max.map(|v| v + args.reach)]);
    let surface = CitySurface::read(&source, around).map_err(failed)?;
    let answer = answer(args, &surface, Site::of(manifest), place.as_ref())?;
    let answer = answer.within(&surface, extent);
    let written = match is_geojson(&args.out) {
        true => write_polygons(args, &answer, &surface, place.as_ref(), &source)?,
        false => write_cells(args, &answer, &surface, extent, place.as_ref(), &source)?,
    };
    let values = sum_up(&surface, &answer.tops, &answer.points, &answer.walls, answer.asked);
    if let Some(path) = &args.buildings {
        write_buildings(&values, &answer, path)?;
    }
    print(&text(args, &answer, &values, &written));
    Ok(())
}

/// Fails on options of another analysis.
fn check_options(args: &AnalyseArgs) -> Result<(), CommandError> {
    use Analysis::{Shadow, Sky, Sun, View};
    let of = |is_given: bool, option: &str, analyses: &[Analysis]| {
        if !is_given || analyses.contains(&args.what) {
            return Ok(());
        }
        let names = analyses.iter().map(|analysis| name(*analysis)).collect::<Vec<_>>().join(" and ");
        Err(CommandError::Usage(format!("{option} is an option of {names}, not of {}", name(args.what))))
    };
    of(args.rule.is_some(), "--rule", &[Sun])?;
    of(args.buildings.is_some(), "--buildings", &[Sun, Sky])?;
    of(!args.wall_heights.is_empty(), "--wall-heights", &[Sun, Sky])?;
    of(args.points.is_some(), "--points", &[Sun])?;
    of(args.time.is_some(), "--time", &[Shadow])?;
    of(args.from.is_some(), "--from", &[View])?;
    of(args.of.is_some(), "--of", &[View])?;
    of(args.target_height.is_some(), "--target-height", &[View])?;
    of(is_geojson(&args.out), "a GeoJSON file", &[Shadow, View])?;
    check_name(args)?;
    let area = args.area.bbox.is_some() || args.area.bbox_metres.is_some();
    let beside_points = [
        ("--buildings", args.buildings.is_some()),
        ("--wall-heights", !args.wall_heights.is_empty()),
        ("--bbox", area),
    ];
    match beside_points.into_iter().find(|(_, is_given)| *is_given && args.points.is_some()) {
        Some((option, _)) => {
            Err(CommandError::Usage(format!("{option} has no use with --points: leave one of them out")))
        }
        None => Ok(()),
    }
}

/// Fails on an output whose name says something else than its content.
fn check_name(args: &AnalyseArgs) -> Result<(), CommandError> {
    let ends = |known: &[&str]| known.iter().any(|end| has_extension(&args.out, end));
    let (is_right, what) = match args.points.is_some() {
        true => (ends(&["csv"]), "the table of --points is a .csv"),
        false => (ends(&["tif", "tiff", "geojson"]), "a raster is a .tif; tables need --buildings or --points"),
    };
    if is_right { Ok(()) } else { Err(CommandError::Usage(format!("--out {}: {what}", args.out.display()))) }
}

fn has_extension(path: &Path, end: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(end))
}

/// Whether an output is to be polygons.
fn is_geojson(path: &Path) -> bool {
    has_extension(path, "geojson")
}

fn name(analysis: Analysis) -> &'static str {
    match analysis {
        Analysis::Sun => "sun",
        Analysis::Sky => "sky",
        Analysis::Shadow => "shadow",
        Analysis::View => "view",
    }
}

fn check_outputs(args: &AnalyseArgs) -> Result<(), CommandError> {
    let rule = args.rule.as_ref().map(std::path::PathBuf::from).filter(|path| path.is_file());
    let inputs = [Some(&args.city), rule.as_ref(), args.points.as_ref(), args.of.as_ref()];
    let mut outputs = Outputs::new(args.overwrite).reading(inputs.into_iter().flatten());
    let kind = match () {
        () if args.points.is_some() => FileKind::ANALYSIS_TABLE,
        () if is_geojson(&args.out) => FileKind::GEOJSON,
        () => FileKind::TIFF,
    };
    outputs.file(&args.out, kind).map_err(CommandError::Usage)?;
    args.buildings.iter().try_for_each(|path| outputs.file(path, FileKind::ANALYSIS_TABLE)).map_err(CommandError::Usage)
}

/// Computes what is asked for.
fn answer(
    args: &AnalyseArgs,
    surface: &CitySurface,
    site: Option<Site>,
    place: Option<&EarthPlace>,
) -> Result<Answer, CommandError> {
    let bar = progress_bar();
    let progress = |share: f64| bar.set_position((share * 1000.0) as u64);
    let answer = match args.what {
        Analysis::Sun => sun(args, surface, &self::site(site)?, &progress)?,
        Analysis::Sky => {
            let heights = if args.wall_heights.is_empty() { &SKY_HEIGHTS_M[..] } else { &args.wall_heights };
            let sky = sky_view(surface, heights, &progress);
            Answer {
                tops: sky.tops,
                points: sky.wall_points,
                walls: sky.walls,
                asked: None,
                title: "sky view factor".to_owned(),
                column: "sky",
                notes: vec!["values of walls are vertical sky components in percent, at most 39.6".to_owned()],
            }
        }
        Analysis::Shadow => {
            let text = args
                .time
                .as_deref()
                .ok_or_else(|| CommandError::Usage("shadow needs --time, as in 2025-12-21T10:00+01:00".to_owned()))?;
            let time = parse_time(text).map_err(|reason| CommandError::Usage(format!("--time {text}: {reason}")))?;
            let sun = self::site(site)?.sun_at(&time);
            let sun = sun.ok_or_else(|| CommandError::Usage(format!("--time {text}: the sun's place is not known")))?;
            let dark = shadow(surface, sun);
            Answer { notes: vec![sun_text(sun)], ..Answer::of_places(surface, &dark, format!("shadow at {text}")) }
        }
        Analysis::View => view(args, surface, place, &progress)?,
    };
    bar.finish_and_clear();
    Ok(answer)
}

fn progress_bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{wide_bar} {percent:>3}% {elapsed} (about {eta} left)");
    ProgressBar::new(1000).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

fn sun_text(sun: Bearing) -> String {
    if sun.altitude_deg <= 0.0 {
        return "the sun is below the horizon: all lies in shadow".to_owned();
    }
    format!("the sun stands at {:.1} degrees, {:.1} above the horizon", sun.azimuth_deg, sun.altitude_deg)
}

fn sun(
    args: &AnalyseArgs,
    surface: &CitySurface,
    site: &Site,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Answer, CommandError> {
    let rule = rule(args)?;
    let hours = sun_hours(surface, site, &rule, progress);
    Ok(Answer {
        tops: hours.tops,
        points: hours.wall_points,
        walls: hours.walls,
        asked: rule.asked_hours,
        notes: notes_of(&rule),
        title: rule.title,
        column: "hours",
    })
}

/// The rule of `--rule`. Fails if there is none of its name, and no such file.
fn rule(args: &AnalyseArgs) -> Result<Rule, CommandError> {
    let names = || Rule::names().collect::<Vec<_>>().join(", ");
    let text = args
        .rule
        .as_deref()
        .ok_or_else(|| CommandError::Usage(format!("sun needs --rule: {}, or a TOML file", names())))?;
    let mut rule = match Rule::built_in(text) {
        Some(rule) => rule,
        None => read_rule(Path::new(text))
            .map_err(|reason| CommandError::Usage(format!("--rule {text}: {reason}; built in are {}", names())))?,
    };
    if !args.wall_heights.is_empty() {
        rule.wall_heights_m.clone_from(&args.wall_heights);
    }
    Ok(rule)
}

/// What a rule says, in sentences.
fn notes_of(rule: &Rule) -> Vec<String> {
    let mut notes = vec![format!("rule: {} ({})", rule.title, rule.source)];
    if rule.left_out > 0 {
        let each = count(rule.days.len() as u64, "day");
        notes.push(format!("{each} of the rule's {} were computed", rule.days.len() + rule.left_out));
    }
    if rule.days.len() > 1 {
        let which = match rule.day_mode {
            DayMode::Least => "hours are those of the day with the least sun",
            DayMode::Most => "hours are those of the day with the most sun",
            DayMode::Sum => "hours are those of all days together",
        };
        notes.push(which.to_owned());
    }
    notes
}

/// Hours of sun at the points of a table.
fn sun_at(
    args: &AnalyseArgs,
    path: &Path,
    source: &StoredCity<'_>,
    place: Option<&EarthPlace>,
) -> Result<(), CommandError> {
    let rule = rule(args)?;
    let wrong = |reason: String| CommandError::Usage(format!("--points {}: {reason}", path.display()));
    let text = read_text(path, MAX_POINTS_BYTES).map_err(|error| wrong(error.to_string()))?;
    let points = parse_points(&text, &|degrees| place?.on_map(degrees)).map_err(wrong)?;
    let site = site(Site::of(source.manifest()))?;
    let city = CityTriangles::read(source, around(&points, args.reach))
        .map_err(|error| CommandError::Export { path: args.city.clone(), reason: error.to_string() })?;
    // A surface of the whole city takes long; only heights above the ground need it.
    let needs_ground = points.iter().any(|point| matches!(point.height, PointHeight::AboveTop(_)));
    let ground = needs_ground.then(|| CitySurface::read(source, Some(around(&points, GROUND_M))));
    let ground = ground
        .transpose()
        .map_err(|error| CommandError::Export { path: args.city.clone(), reason: error.to_string() })?;
    let suns = sun_at_points(&city, ground.as_ref(), &points, &site, &rule);
    let failed = |error: std::io::Error| CommandError::Write { path: args.out.clone(), reason: error.to_string() };
    let mut bytes = Vec::new();
    write_points(&points, &suns, &rule, &mut bytes).map_err(failed)?;
    replace(&args.out, &bytes).map_err(failed)?;
    let mut lines = vec![format!("wrote {} ({})", args.out.display(), count(points.len() as u64, "point"))];
    lines.extend(notes_of(&rule));
    let beyond = suns.iter().filter(|sun| sun.is_none()).count();
    if beyond > 0 {
        lines.push(format!(
            "{} without a surface to measure the height from: beyond the city?",
            count(beyond as u64, "point")
        ));
    }
    let mut values = PlaceValues::default();
    suns.iter().flatten().for_each(|sun| values.add(sun.hours as f32, rule.asked_hours));
    lines.extend(summary(Analysis::Sun, &values, rule.asked_hours));
    print(&lines.iter().map(|line| format!("{}\n", printable(line))).collect::<String>());
    Ok(())
}

/// Where the city lies. Fails if that is not known.
fn site(site: Option<Site>) -> Result<Site, CommandError> {
    site.ok_or_else(|| {
        CommandError::Usage("it is not known where on Earth this city lies: bake it with --crs or --at".to_owned())
    })
}

fn read_rule(path: &Path) -> Result<Rule, String> {
    let text = read_text(path, MAX_RULE_BYTES).map_err(|error| error.to_string())?;
    Rule::parse(&text).map_err(|error| error.to_string())
}

fn view(
    args: &AnalyseArgs,
    surface: &CitySurface,
    place: Option<&EarthPlace>,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Answer, CommandError> {
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
    Ok(Answer { notes: vec![note], ..Answer::of_places(surface, &seen, "seen".to_owned()) })
}

/// From where a planned building is seen.
fn view_of(
    args: &AnalyseArgs,
    path: &Path,
    surface: &CitySurface,
    place: Option<&EarthPlace>,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Answer, CommandError> {
    let size = surface.size().map(|cells| cells as f64 * surface.cell_m);
    let far = [0, 1].map(|k| surface.corner[k] + size[k]);
    let polygons = read_polygons("--of", path, [surface.corner, far], place)?;
    let wrong = |reason: &str| CommandError::Usage(format!("--of {}: {reason}", path.display()));
    let [polygon] = &polygons[..] else { return Err(wrong("more than one polygon")) };
    let outline = polygon.first().map(Vec::as_slice).unwrap_or_default();
    let height = args.height.unwrap_or_default();
    let eye_m = args.target_height.unwrap_or(EYE_M);
    let share = share_seen(surface, outline, height, eye_m, progress)
        .ok_or_else(|| wrong("no part of it is on ground that was baked"))?;
    let value = |(index, share)| if surface.kind(index) == TopKind::Nothing { f32::NAN } else { share };
    let tops = share.into_iter().enumerate().map(value).collect();
    let title = format!("share that is seen of a building of {height} m");
    let note = format!("the building is {height} m high; who looks has the eye {eye_m} m above ground or roof");
    Ok(Answer { tops, title, notes: vec![note], ..Answer::of_places(surface, &[], String::new()) })
}

impl Answer {
    /// 1 where something is true, else 0, and no value where nothing was baked.
    fn of_places(surface: &CitySurface, places: &[bool], title: String) -> Self {
        let value = |(index, place): (usize, &bool)| match surface.kind(index) {
            TopKind::Nothing => f32::NAN,
            _ => f32::from(u8::from(*place)),
        };
        let tops = places.iter().enumerate().map(value).collect();
        Self { tops, points: Vec::new(), walls: Vec::new(), asked: None, title, column: "share", notes: Vec::new() }
    }

    /// The values of a part of the surface; what lies around it was only there to be in the way.
    fn within(mut self, surface: &CitySurface, part: CellExtent) -> Self {
        let all = surface.extent;
        if part == all {
            return self;
        }
        let has = |index: u32| {
            let cell = [all.min[0] + index % all.size[0], all.min[1] + index / all.size[0]];
            (0..2).all(|k| (part.min[k]..part.min[k] + part.size[k]).contains(&cell[k]))
        };
        for (index, value) in (0u32..).zip(&mut self.tops) {
            if !has(index) {
                *value = f32::NAN;
            }
        }
        let kept: Vec<bool> = self.points.iter().map(|point| has(point.cell)).collect();
        let mut keep = kept.iter();
        self.points.retain(|_| keep.next().is_some_and(|kept| *kept));
        let mut keep = kept.iter();
        self.walls.retain(|_| keep.next().is_some_and(|kept| *kept));
        self
    }
}

fn write_buildings(values: &CityValues<'_>, answer: &Answer, path: &Path) -> Result<(), CommandError> {
    let failed = |error: std::io::Error| CommandError::Write { path: path.to_owned(), reason: error.to_string() };
    let mut bytes = Vec::new();
    write_table(values, answer.column, answer.asked.is_some(), &mut bytes).map_err(failed)?;
    replace(path, &bytes).map_err(failed)
}

/// Writes the values as a raster. Fails if it cannot be written.
fn write_cells(
    args: &AnalyseArgs,
    answer: &Answer,
    surface: &CitySurface,
    extent: CellExtent,
    place: Option<&EarthPlace>,
    source: &StoredCity<'_>,
) -> Result<Written, CommandError> {
    let projections = Projections { epsg: place.and_then(EarthPlace::epsg), ..Projections::default() };
    let title = format!("{}: {}", source.manifest().title, answer.title);
    let mut part = |part: CellExtent| {
        let cells = (0..part.len() as usize).map(|i| {
            let [x, y] = [i % part.size[0] as usize, i / part.size[0] as usize].map(|v| v as u32);
            let value = answer.tops[surface.extent.index([part.min[0] + x, part.min[1] + y])];
            if value.is_nan() { NODATA } else { value }
        });
        Ok(cells.collect())
    };
    let report = write_raster(source, extent, &projections, None, &title, &args.out, &mut part)
        .map_err(|error| CommandError::Export { path: args.out.clone(), reason: error.to_string() })?;
    report.warnings.iter().for_each(|warning| eprintln!("note: {}", printable(warning)));
    Ok(Written { bytes: report.bytes, attribution: report.attribution })
}

/// Writes the areas of more than half as polygons in degrees (RFC 7946). Fails if it is not known where the city lies, or if the file
/// cannot be written.
fn write_polygons(
    args: &AnalyseArgs,
    answer: &Answer,
    surface: &CitySurface,
    place: Option<&EarthPlace>,
    source: &StoredCity<'_>,
) -> Result<Written, CommandError> {
    let unknown = "it is not known where on Earth this city lies: write a .tif";
    let place = place.ok_or_else(|| CommandError::Usage(unknown.to_owned()))?;
    let is_in: Vec<bool> = answer.tops.iter().map(|value| *value > 0.5).collect();
    let degrees = |[x, y]: &[u32; 2]| {
        let corner = [x, y].map(|v| f64::from(*v) * surface.cell_m);
        // Decimals of a degree below a centimetre.
        let round = |degrees: f64| (degrees * 1e7).round() / 1e7;
        place.lon_lat([0, 1].map(|k| surface.corner[k] + corner[k])).map(|place| place.map(round))
    };
    let ring = |ring: &Vec<[u32; 2]>| ring.iter().chain(ring.first()).map(degrees).collect::<Option<Vec<_>>>();
    let polygons = outlines(&is_in, surface.size()[0]);
    let polygons: Option<Vec<_>> =
        polygons.iter().map(|rings| rings.iter().map(ring).collect::<Option<Vec<_>>>()).collect();
    let polygons = polygons.ok_or_else(|| CommandError::Usage(unknown.to_owned()))?;
    let attribution = insula_export::table::attribution(source.manifest());
    let collection = serde_json::json!({
        "type": "FeatureCollection",
        "attribution": attribution,
        "features": [{
            "type": "Feature",
            "properties": { "title": answer.title },
            "geometry": { "type": "MultiPolygon", "coordinates": polygons },
        }],
    });
    let bytes = collection.to_string().into_bytes();
    replace(&args.out, &bytes)
        .map_err(|error| CommandError::Write { path: args.out.clone(), reason: error.to_string() })?;
    Ok(Written { bytes: bytes.len() as u64, attribution })
}

/// An output that was written.
struct Written {
    bytes: u64,
    attribution: String,
}

/// What was written and what it says.
fn text(args: &AnalyseArgs, answer: &Answer, values: &CityValues<'_>, written: &Written) -> String {
    let attribution = &written.attribution;
    let mut lines = vec![format!("wrote {} ({})", args.out.display(), human_bytes(written.bytes))];
    if let Some(path) = &args.buildings {
        let with_values = values.buildings.iter().filter(|row| row.roof.count + row.walls.count > 0).count();
        lines.push(format!("wrote {} ({})", path.display(), count(with_values as u64, "building")));
    }
    lines.extend(answer.notes.iter().map(|note| printable(note).to_string()));
    for (name, part) in [("roofs", &values.roofs), ("walls", &values.walls), ("ground", &values.ground)] {
        lines.extend(summary(args.what, part, answer.asked).map(|summary| format!("{name}: {summary}")));
    }
    if !attribution.is_empty() {
        lines.push(format!("name the source wherever this is shown: {}", printable(attribution)));
    }
    lines.iter().map(|line| format!("{line}\n")).collect()
}

/// The values of one kind of place in words; `None` without a value.
fn summary(what: Analysis, values: &PlaceValues, asked: Option<f64>) -> Option<String> {
    let mean = values.mean()?;
    let percent = |share: f64| format!("{:.1}%", share * 100.0);
    Some(match what {
        Analysis::Sun => {
            let hours = format!("{mean:.2} h of sun on average, {:.2} to {:.2}", values.least, values.most);
            let reaching = asked.zip(values.share());
            let reaching = reaching.map(|(asked, share)| format!("; {} reach the {asked} h asked for", percent(share)));
            hours + &reaching.unwrap_or_default()
        }
        Analysis::Sky => format!("{mean:.3} on average, {:.3} to {:.3}", values.least, values.most),
        Analysis::Shadow => format!("{} in shadow", percent(mean)),
        Analysis::View => format!("{} seen", percent(mean)),
    })
}
