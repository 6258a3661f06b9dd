//! `export`: a baked city, or a part of it, in the formats of other programs.

use super::{error::CommandError, output::print};
use crate::{
    args::{ExportArgs, ExportFormat},
    store::{CityStore, StoredCity, StoredObjects},
};
use insula_bake::read::EarthPlace;
use insula_export::{
    file,
    format::{Format, PlaneDefinition, Projections},
    glb::{self, ExportView},
    selection::{ObjectSelection, passing},
    source::{ExportSource, SourceError},
    tiles3d::{Destination, Tileset, write_tileset},
};
use insula_objects::filter::Filter;
use insula_protocol::text::{count, human_bytes, printable};
use roaring::RoaringBitmap;
use serde_json::Value;
use std::{
    fs::{self, File},
    io::{BufWriter, Write as _},
    path::Path,
};

/// Largest file of a polygon or a camera.
const MAX_TEXT_BYTES: u64 = 16 << 20;

/// Runs `export`. Fails if the city cannot be read, the selection is invalid or empty, or the output cannot be written.
pub(super) fn run(args: &ExportArgs) -> Result<(), CommandError> {
    let city = CityStore::open(&args.city)?;
    let objects = StoredObjects::open(&city)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::new(city.manifest(), objects.schema(), &read);
    let view = view(args)?;
    let selection = selection(args, &source)?;
    let place = city.manifest().crs.as_deref().and_then(EarthPlace::of);
    let failed = |reason: String| CommandError::Export { path: args.out.clone(), reason };
    let text = match args.format {
        ExportFormat::Glb => {
            let partial = args.out.with_extension("glb.partial");
            let file = File::create(&partial).map_err(|error| failed(error.to_string()))?;
            let mut out = BufWriter::new(file);
            let report =
                glb::write_glb(&source, &selection, view.as_ref(), &mut out).map_err(|error| failed(error.to_string()));
            let report = report.and_then(|report| {
                out.flush()
                    .and_then(|()| fs::rename(&partial, &args.out))
                    .map_err(|error| failed(error.to_string()))?;
                Ok(report)
            });
            let report = report.inspect_err(|_| drop(fs::remove_file(&partial)))?;
            let counts = [count(report.objects, "object"), count(report.triangles, "triangle")];
            format!("{}, {}", counts.join(", "), human_bytes(report.bytes))
        }
        ExportFormat::Tiles3d => {
            let to_geocentric = |p: [f64; 3]| place.as_ref()?.geocentric(p);
            let tileset =
                Tileset::new(&source, &selection, &to_geocentric).map_err(|error| failed(error.to_string()))?;
            let report =
                write_tileset(&tileset, Destination::of(&args.out)).map_err(|error| failed(error.to_string()))?;
            format!("{}, {}", count(report.files, "file"), human_bytes(report.bytes))
        }
        ExportFormat::Table(format) => write_table(args, &source, format, &selection, place.as_ref())?,
    };
    print(&format!("wrote {} ({text})\n", args.out.display()));
    Ok(())
}

fn write_table(
    args: &ExportArgs,
    source: &StoredCity<'_>,
    format: Format,
    selection: &ObjectSelection,
    place: Option<&EarthPlace>,
) -> Result<String, CommandError> {
    let to_lon_lat = |p: [f64; 2]| place?.lon_lat(p);
    let definition = place.and_then(EarthPlace::definition).map(|(base_epsg, proj, ellipsoid)| PlaneDefinition {
        base_epsg,
        proj: proj.to_owned(),
        ellipsoid,
    });
    let projections = Projections {
        to_lon_lat: place.is_some().then_some(&to_lon_lat as _),
        epsg: place.and_then(EarthPlace::epsg),
        definition: definition.as_ref(),
    };
    let report = file::export(source, format, selection, &projections, &args.out)
        .map_err(|error| CommandError::Export { path: args.out.clone(), reason: error.to_string() })?;
    for (reason, number) in &report.skipped {
        eprintln!("note: {} left out: {reason}", count(*number, "object"));
    }
    report.warnings.iter().for_each(|warning| eprintln!("note: {}", printable(warning)));
    if !report.attribution.is_empty() {
        eprintln!("note: name the source wherever this is shown: {}", printable(&report.attribution));
    }
    Ok(format!("{}, {}", count(report.objects, "object"), human_bytes(report.bytes)))
}

/// The view of `--view`. Fails if there is no such file or camera, or if the format has no views.
fn view(args: &ExportArgs) -> Result<Option<ExportView>, CommandError> {
    let Some(path) = &args.view else { return Ok(None) };
    if args.format != ExportFormat::Glb {
        return Err(CommandError::Usage(
            "--view needs --format glb: other formats have no levels of detail".to_owned(),
        ));
    }
    let wrong = |reason: String| CommandError::Usage(format!("--view {}: {reason}", path.display()));
    let text = read_small(path).map_err(wrong)?;
    let camera = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    let view = ExportView::new(camera, args.size, args.tau);
    view.map(Some).ok_or_else(|| wrong("position and target must differ, and fov_y_deg must be 1 to 170".to_owned()))
}

/// The text of a file that is small. Fails with the reason if it cannot be read.
fn read_small(path: &Path) -> Result<String, String> {
    if fs::metadata(path).map_err(|error| error.to_string())?.len() > MAX_TEXT_BYTES {
        return Err("larger than 16 MiB".to_owned());
    }
    fs::read_to_string(path).map_err(|error| error.to_string())
}

/// What the arguments select. Fails if an expression or a file is invalid.
fn selection(args: &ExportArgs, source: &StoredCity<'_>) -> Result<ObjectSelection, CommandError> {
    let bbox = args.bbox.map(|[west, south, east, north]| [[west, south], [east, north]]);
    let polygon = args.polygon.as_deref().map(read_polygon).transpose()?;
    let objects = args.filter.as_deref().map(|text| passing_objects(text, source, &args.city)).transpose()?;
    Ok(ObjectSelection { bbox, polygon, objects })
}

/// The objects that pass a filter, with the parts of those that do.
fn passing_objects(text: &str, source: &StoredCity<'_>, city: &Path) -> Result<RoaringBitmap, CommandError> {
    let filter = Filter::parse(text, source.schema())
        .map_err(|error| CommandError::Usage(format!("--filter {text}: {error}")))?;
    let failed = |error: SourceError| CommandError::Export { path: city.to_owned(), reason: error.to_string() };
    passing(source, &filter).map_err(failed)
}

/// The rings of the first polygon of a GeoJSON file, in the city's coordinate system. Fails if there is none.
fn read_polygon(path: &Path) -> Result<Vec<Vec<[f64; 2]>>, CommandError> {
    let wrong = |reason: &str| CommandError::Usage(format!("--polygon {}: {reason}", path.display()));
    let text = read_small(path).map_err(|reason| wrong(&reason))?;
    let json: Value = serde_json::from_str(&text).map_err(|error| wrong(&error.to_string()))?;
    let geometry = json.pointer("/features/0/geometry").or_else(|| json.get("geometry")).unwrap_or(&json);
    let rings = match geometry.get("type").and_then(Value::as_str) {
        Some("Polygon") => geometry.get("coordinates"),
        Some("MultiPolygon") => geometry.pointer("/coordinates/0"),
        _ => None,
    };
    let point = |point: &Value| Some([point.get(0)?.as_f64()?, point.get(1)?.as_f64()?]);
    let ring = |ring: &Value| ring.as_array()?.iter().map(point).collect::<Option<Vec<_>>>();
    let rings = rings.and_then(Value::as_array).and_then(|rings| rings.iter().map(ring).collect());
    rings.ok_or_else(|| wrong("no GeoJSON polygon, in metres of the city's coordinate system"))
}
