//! `export`: a baked city, or a part of it, in the formats of other programs.

use super::error::CommandError;
use super::output::print_result;
use super::site_documents::NO_PLACE;
use crate::area_file::polygons_in_city;
use crate::args::{ExportArgs, ExportFormat};
use crate::store::{CityStore, StoredCity, StoredObjects};
use insula_analysis::eye::lifted_camera;
use insula_archive::file::{read_limited, read_text};
use insula_archive::new_file::replace;
use insula_bake::read::EarthPlace;
use insula_command_line::camera::{GivenCamera, degrees_fault, inside_note};
use insula_command_line::output::{FileKind, Outputs};
use insula_export::camera::ExportCamera;
use insula_export::file;
use insula_export::format::{Format, PlaneDefinition, Projections};
use insula_export::glb::{self, ExportView};
use insula_export::selection::{ObjectSelection, SelectedArea, passing};
use insula_export::source::ExportSource;
use insula_export::table::{ExportReport, TableOptions};
use insula_export::tiles3d::{Destination, Tileset, TilesetForm, write_tileset};
use insula_objects::filter::{Filter, NONE_PASSES};
use insula_protocol::Manifest;
use insula_protocol::text::{count, human_bytes, printable};
use roaring::RoaringBitmap;
use serde_json::{Value, json};
use std::path::Path;

/// Largest file of a camera.
const MAX_TEXT_BYTES: u64 = 16 << 20;
/// A larger `tileset.json` is taken for somebody else's: it has no more than the attributes of a city.
const MAX_TILESET_BYTES: u64 = 64 << 20;

/// Runs `export`. Fails if the city cannot be read, the selection is invalid or empty, or the output cannot be written.
pub(super) fn run(args: &ExportArgs) -> Result<(), CommandError> {
    let city = CityStore::open(&args.city)?;
    let format = args.format().map_err(CommandError::Usage)?;
    check_options(args, format)?;
    check_outputs(args, format, &city)?;
    let objects = StoredObjects::open(&city)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::new(city.manifest(), objects.schema(), &read);
    let view = view(args, format, &source)?;
    let has_datum = city.manifest().heights.is_some();
    let place = city.manifest().crs.as_deref().and_then(EarthPlace::of).map(|place| place.above_sea_level(has_datum));
    let selection = selection(args, &source, place.as_ref())?;
    let nothing = no_object_passes(args, &selection);
    nothing.iter().for_each(|reason| eprintln!("note: nothing is selected: {}", printable(reason)));
    let failed = |reason: String| CommandError::file(&args.out, reason);
    let (mut facts, text) = match format {
        ExportFormat::Glb => {
            let mut bytes = Vec::new();
            let report = glb::write_glb(&source, &selection, view.as_ref(), &mut bytes);
            let report = report.map_err(|error| failed(error.to_string()))?;
            if args.is_text_model() {
                bytes = glb::gltf_of_glb(&bytes).map_err(|error| failed(error.to_string()))?.into_bytes();
            }
            replace(&args.out, &bytes).map_err(|error| failed(error.to_string()))?;
            let counts = [count(report.objects, "object"), count(report.triangles, "triangle")];
            let facts = json!({ "objects": report.objects, "triangles": report.triangles, "bytes": bytes.len() });
            (facts, format!("{}, {}", counts.join(", "), human_bytes(bytes.len() as u64)))
        }
        ExportFormat::Tiles3d => {
            let to_geocentric = |p: [f64; 3]| place.as_ref()?.geocentric(p);
            let tileset =
                Tileset::new(&source, &selection, &to_geocentric).map_err(|error| failed(error.to_string()))?;
            let form = if args.plain { TilesetForm::Plain } else { TilesetForm::Implicit };
            let tileset = tileset.in_form(form);
            let report =
                write_tileset(&tileset, Destination::of(&args.out)).map_err(|error| failed(error.to_string()))?;
            if !tileset.has_place() {
                eprintln!("note: {NO_PLACE}");
            }
            let facts = json!({ "files": report.files, "triangles": report.triangles, "bytes": report.bytes });
            (facts, format!("{}, {}", count(report.files, "file"), human_bytes(report.bytes)))
        }
        ExportFormat::Table(format) => {
            let (report, text) = write_table(args, &source, format, &selection, place.as_ref())?;
            if report.objects == 0 && nothing.is_none() && format != Format::GeoTiff {
                eprintln!("note: nothing is selected{}", by_options(args));
            }
            (json!({ "objects": report.objects, "bytes": report.bytes }), text)
        }
    };
    facts["out"] = args.out.display().to_string().into();
    print_result(args.json, &facts, &format!("wrote {} ({text})\n", args.out.display()));
    Ok(())
}

/// Fails if an option is for another format.
fn check_options(args: &ExportArgs, format: ExportFormat) -> Result<(), CommandError> {
    let is_table = matches!(format, ExportFormat::Table(format) if format.is_table());
    let is_packed = matches!(Destination::of(&args.out), Destination::PmTiles(_));
    let mistake = if args.keep_formulas && format != ExportFormat::Table(Format::Csv) {
        "--keep-formulas needs --format csv"
    } else if args.parts && !is_table {
        "--parts needs a table: csv, geojson, geoparquet or flatgeobuf"
    } else if args.plain && format != ExportFormat::Tiles3d {
        "--plain needs --format 3dtiles"
    } else if args.plain && is_packed {
        "--plain needs a folder or a .3tz as --out"
    } else {
        return Ok(());
    };
    Err(CommandError::Usage(mistake.to_owned()))
}

/// Fails if the output would overwrite anything but an earlier one.
fn check_outputs(args: &ExportArgs, format: ExportFormat, city: &CityStore) -> Result<(), CommandError> {
    let inputs = [Some(&args.city), args.polygon.as_ref(), args.view.as_ref()];
    let mut outputs = Outputs::new(args.overwrite).reading(inputs.into_iter().flatten());
    let kind = match format {
        ExportFormat::Table(format) => return check_table(&mut outputs, format, city.manifest(), &args.out),
        ExportFormat::Glb if args.is_text_model() => FileKind::Json("a glTF model", &["asset", "buffers"]),
        ExportFormat::Glb => FileKind::GLB,
        ExportFormat::Tiles3d => match Destination::of(&args.out) {
            Destination::Folder(folder) => {
                return outputs.folder(folder, None, is_own_tileset).map_err(CommandError::Usage);
            }
            Destination::Archive(_) => FileKind::ZIP,
            Destination::PmTiles(_) => FileKind::PMTILES,
        },
    };
    outputs.file(&args.out, kind).map_err(CommandError::Usage)
}

/// Fails if a file of a city, or the attribution beside it, would overwrite anything but an earlier one.
pub(super) fn check_table(
    outputs: &mut Outputs,
    format: Format,
    manifest: &Manifest,
    out: &Path,
) -> Result<(), CommandError> {
    let kind = match format {
        Format::Csv => FileKind::TABLE,
        Format::GeoJson => FileKind::GEOJSON,
        Format::GeoParquet => FileKind::PARQUET,
        Format::FlatGeobuf => FileKind::FLATGEOBUF,
        Format::CityJsonSeq => FileKind::CITYJSON_SEQUENCE,
        Format::GeoTiff => FileKind::TIFF,
    };
    outputs.file(out, kind).map_err(CommandError::Usage)?;
    let Some((beside, text)) = file::sidecar(format, manifest, out) else { return Ok(()) };
    let is_earlier = read_text(&beside, MAX_TEXT_BYTES).is_ok_and(|found| found == text);
    // Any text could be an attribution: only the same one is known.
    let kind = if is_earlier { FileKind::ANY } else { FileKind::Begins("the attribution of the table", &[]) };
    outputs.file(&beside, kind).map_err(CommandError::Usage)
}

/// Whether a folder has a tileset that this command wrote: others have no attribution there.
fn is_own_tileset(folder: &Path) -> bool {
    let text = read_limited(&folder.join("tileset.json"), MAX_TILESET_BYTES).unwrap_or_default();
    let tileset: Value = serde_json::from_slice(&text).unwrap_or_default();
    tileset.pointer("/asset/extras/attribution").is_some_and(Value::is_array) && tileset["root"].is_object()
}

fn write_table(
    args: &ExportArgs,
    source: &StoredCity<'_>,
    format: Format,
    selection: &ObjectSelection,
    place: Option<&EarthPlace>,
) -> Result<(ExportReport, String), CommandError> {
    let to_lon_lat = |p: [f64; 2]| place?.lon_lat(p);
    let definition = place.and_then(plane_of);
    let projections = Projections {
        to_lon_lat: place.is_some().then_some(&to_lon_lat as _),
        epsg: place.and_then(EarthPlace::epsg),
        definition: definition.as_ref(),
    };
    let options = TableOptions { keeps_formulas: args.keep_formulas, keeps_parts: args.parts };
    let report = file::export(source, format, selection, &projections, options, &args.out)
        .map_err(|error| CommandError::file(&args.out, error))?;
    for (reason, number) in &report.skipped {
        eprintln!("note: {} left out: {reason}", count(*number, "object"));
    }
    report.warnings.iter().for_each(|warning| eprintln!("note: {}", printable(warning)));
    if !report.attribution.is_empty() {
        eprintln!("note: name the source wherever this is shown: {}", printable(&report.attribution));
    }
    let bytes = human_bytes(report.bytes);
    let text = match format {
        // A picture of heights has no objects.
        Format::GeoTiff => bytes,
        _ if format.is_table() => format!("{}, {bytes}", count(report.objects, "row")),
        _ => format!("{}, {bytes}", count(report.objects, "object")),
    };
    Ok((report, text))
}

/// How the coordinate system of a city is defined; `None` if nobody knows.
pub(super) fn plane_of(place: &EarthPlace) -> Option<PlaneDefinition> {
    let (base_epsg, proj, ellipsoid) = place.definition()?;
    let is_north_first = place.is_north_first();
    Some(PlaneDefinition { base_epsg, proj: proj.to_owned(), ellipsoid, is_north_first })
}

/// Why the filter alone selects nothing; `None` if it selects something.
fn no_object_passes(args: &ExportArgs, selection: &ObjectSelection) -> Option<String> {
    let (text, objects) = args.filter.as_ref().zip(selection.objects.as_ref())?;
    objects.is_empty().then(|| format!("--filter {text}: {NONE_PASSES}"))
}

/// The options that restrict a selection, in words.
fn by_options(args: &ExportArgs) -> String {
    let given = [
        ("--bbox", args.area.bbox.is_some()),
        ("--bbox-metres", args.area.bbox_metres.is_some()),
        ("--filter", args.filter.is_some()),
        ("--polygon", args.polygon.is_some()),
    ];
    let names: Vec<&str> = given.into_iter().filter(|(_, is_given)| *is_given).map(|(name, _)| name).collect();
    if names.is_empty() { String::new() } else { format!(" by {}", names.join(" and ")) }
}

/// The view of `--camera`. Fails if there is no such file or camera, or if the format has no views.
fn view(args: &ExportArgs, format: ExportFormat, source: &StoredCity<'_>) -> Result<Option<ExportView>, CommandError> {
    let Some(path) = &args.view else { return Ok(None) };
    if format != ExportFormat::Glb {
        return Err(CommandError::Usage(
            "--camera needs --format glb: other formats have no levels of detail".to_owned(),
        ));
    }
    let wrong = |reason: String| CommandError::Usage(format!("--camera {}: {reason}", path.display()));
    let invalid = || wrong("position and target must differ, and fov_y_deg must be 1 to 170".to_owned());
    let numbers = match GivenCamera::parse(path).map_err(CommandError::Usage)? {
        GivenCamera::OnEarth(camera) => Some(camera.in_city(source.manifest()).map_err(CommandError::Usage)?),
        GivenCamera::InCity(numbers) => Some(numbers),
        GivenCamera::File(_) => None,
    };
    let mut camera = match numbers {
        Some(numbers) => ExportCamera::of_numbers(numbers).ok_or_else(invalid)?,
        None => {
            let text = read_text(path, MAX_TEXT_BYTES).map_err(|error| wrong(error.to_string()))?;
            serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?
        }
    };
    if let Some(fault) = degrees_fault(source.manifest(), [camera.position[0], camera.position[1]]) {
        return Err(CommandError::Usage(fault));
    }
    let lifted = lifted_camera(source, camera).map_err(|error| CommandError::file(&args.city, error))?;
    if let Some(lifted) = lifted {
        eprintln!("note: {}", inside_note(args.keep_camera, lifted.position[2] - camera.position[2]));
        if !args.keep_camera {
            camera = lifted;
        }
    }
    let view = ExportView::new(camera, args.size, args.tau);
    view.map(Some).ok_or_else(invalid)
}

/// What the arguments select. Fails if an expression or a file is invalid, and if an area lies beyond the city.
fn selection(
    args: &ExportArgs,
    source: &StoredCity<'_>,
    place: Option<&EarthPlace>,
) -> Result<ObjectSelection, CommandError> {
    let city = source.manifest().bounds.map(|[x, y, _]| [x, y]);
    let on_map = |degrees| place?.box_on_map(degrees);
    let bbox = args.area.box_in_city(city, on_map, &|at| place?.lon_lat(at)).map_err(CommandError::Usage)?;
    let polygons = args.polygon.as_deref().map(|path| polygons_in_city(path, city, place)).transpose();
    let polygons = polygons.map_err(|reason| CommandError::Usage(format!("--polygon {reason}")))?;
    let objects = args.filter.as_deref().map(|text| passing_objects(text, source, &args.city)).transpose()?;
    Ok(ObjectSelection { bbox, polygons: polygons.map(SelectedArea::new), objects })
}

/// The objects that pass a filter, with the parts of those that do.
fn passing_objects(text: &str, source: &StoredCity<'_>, city: &Path) -> Result<RoaringBitmap, CommandError> {
    let filter = Filter::parse(text, source.schema())
        .map_err(|error| CommandError::Usage(format!("--filter {text}: {error}")))?;
    passing(source, &filter).map_err(|error| CommandError::file(city, error))
}
