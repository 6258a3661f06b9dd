//! `insula draw`: a city as vector shapes.

use super::city_tiles::fetch_tile;
use super::connect;
use super::embedded::{BakeJob, CacheRoot, bake_cached, cache_key};
use super::open::{is_address, is_baked};
use crate::args::{DrawArgs, GlobalArgs};
use crate::camera_files::given_camera;
use crate::error::{ClientError, Result};
use crate::language;
use crate::objects::warn_of_range;
use crate::stream::fetch::Http;
use insula_analysis::eye::lifted_camera;
use insula_archive::file;
use insula_bake::read::{EarthPlace, FacadeOption, Palette};
use insula_command_line::camera::inside_note;
use insula_command_line::output::{FileKind, Outputs};
use insula_draw::drawing::Drawing;
use insula_draw::error::DrawStep;
use insula_draw::file::{DrawingFormat, pdf_letters, write_drawing};
use insula_draw::sheet::Paper;
use insula_draw::style::Stylesheet;
use insula_draw::view::DrawView;
use insula_draw::{DrawError, DrawRequest, draw, over_heights};
use insula_export::camera::ExportCamera;
use insula_export::selection::{ObjectSelection, passing};
use insula_export::source::ExportSource;
use insula_objects::ColorBy;
use insula_objects::filter::{Filter, NONE_PASSES};
use insula_protocol::Manifest;
use insula_protocol::text::{count, human_bytes, printable};
use insula_server::store::{CityStore, ReadTileFn, StoredCity};
use insula_viewer::camera::CameraFile;
use insula_viewer::source::WITHOUT_OBJECTS;
use insula_viewer::sun::{Daylight, SunOptions};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Larger stylesheets are refused.
const MAX_TEXT_BYTES: u64 = 1 << 20;

/// Runs the command. Fails if the files cannot be baked, the city cannot be read, there is nothing or too much to draw, or the file
/// cannot be written.
pub(super) fn run(args: &DrawArgs, global: &GlobalArgs) -> Result<()> {
    check_output(args)?;
    if args.sheet && !args.out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("dxf")) {
        return Err(ClientError::Usage("--sheet needs a .dxf file: .svg and .pdf always have a sheet".to_owned()));
    }
    if let [place] = args.sources()
        && is_address(place)
    {
        let http = Arc::new(Http::new(None)?);
        let city = connect(&http, place, global)?;
        if (args.filter.is_some() || args.color_by.is_some()) && !city.source.opens_objects() {
            return Err(ClientError::Usage(WITHOUT_OBJECTS.to_owned()));
        }
        let read = |kind, id| fetch_tile(&http, &city, kind, id);
        return draw_source(args, &city.manifest, &read);
    }
    let folder = baked_folder(args.sources())?;
    let city = CityStore::open(&folder).map_err(|error| unreadable(&error))?;
    draw_source(args, city.manifest(), &|kind, id| city.tile(kind, id))
}

/// Fails if the drawing would overwrite anything but an earlier one.
fn check_output(args: &DrawArgs) -> Result<()> {
    let kind = match DrawingFormat::of(&args.out).map_err(|error| failed(&error))? {
        DrawingFormat::Svg => FileKind::SVG,
        DrawingFormat::Pdf => FileKind::PDF,
        DrawingFormat::Dxf => FileKind::DXF,
    };
    let inputs = args.sources().iter().chain(&args.view).chain(&args.style);
    Outputs::new(args.overwrite).reading(inputs).file(&args.out, kind).map_err(ClientError::Usage)
}

/// Draws the city whose tiles `read` reads.
fn draw_source(args: &DrawArgs, manifest: &Manifest, read: &ReadTileFn<'_>) -> Result<()> {
    let format = DrawingFormat::of(&args.out).map_err(|error| failed(&error))?;
    let paper = Paper::parse(&args.paper).map_err(|error| failed(&error))?;
    let source = StoredCity::open(manifest, read).map_err(|error| unreadable(&error))?;
    let view = view(args, &source)?;
    let color_by = args.color_by.as_ref().map(|text| {
        let parsed = ColorBy::parse(text, source.schema());
        let color_by = parsed.map_err(|error| ClientError::Usage(format!("--color-by {text}: {error}")))?;
        let color_by = match args.range {
            Some(ends) => {
                if color_by.range().is_none() {
                    warn_of_range(text);
                }
                color_by.with_range(ends)
            }
            None => over_heights(color_by, &source).map_err(|error| unreadable(&error))?,
        };
        Ok::<_, ClientError>(color_by.in_language(&language::of_environment()))
    });
    let request = DrawRequest {
        view,
        selection: selection(args, &source)?,
        paper,
        scale: args.scale,
        is_bare: args.bare,
        title: args.title.clone(),
        style: style(args, &source)?,
        is_sheet: args.sheet,
        date: args.time.map(|time| time.to_string()).unwrap_or_default(),
        color_by: color_by.transpose()?,
        ..DrawRequest::default()
    };
    let shown = Mutex::new(None);
    let drawing = draw(&source, &request, &|step, share| show(&shown, step, share));
    if std::io::stderr().is_terminal() {
        eprint!("\r\x1b[K");
    }
    let drawing = drawing.map_err(|error| failed(&error))?;
    let bytes = write_drawing(&drawing, format, &args.out).map_err(|error| failed(&error))?;
    report(&drawing, args, bytes);
    Ok(())
}

fn report(drawing: &Drawing, args: &DrawArgs, bytes: u64) {
    if drawing.without_mesh > 0 {
        let nodes = count(drawing.without_mesh, "node");
        eprintln!("note: {nodes} of the city without a mesh: drawn from columns");
    }
    if DrawingFormat::of(&args.out).is_ok_and(|format| format == DrawingFormat::Pdf) {
        pdf_letters(drawing).messages("; a .svg has all letters").iter().for_each(|message| eprintln!("{message}"));
    }
    if args.bare && !drawing.attribution.is_empty() {
        eprintln!("note: name the source beside the drawing: {}", printable(&drawing.attribution));
    }
    if let (Some(scale), Some(fitting)) = (args.scale, drawing.fitting_scale) {
        eprintln!(
            "warning: not all is on the paper at 1:{scale}: --scale 1:{fitting} is the largest round scale at which it is; or take larger \
             paper with --paper, or a part with --bbox"
        );
    }
    let objects = count(drawing.objects.iter().filter(|object| object.number.is_some()).count() as u64, "object");
    let text = format!("wrote {} ({objects}, {})", args.out.display(), human_bytes(bytes));
    eprintln!("{}", printable(&text));
}

fn unreadable(error: &dyn std::fmt::Display) -> ClientError {
    ClientError::Failed(error.to_string())
}

fn failed(error: &DrawError) -> ClientError {
    match error {
        DrawError::Invalid(_) => ClientError::Usage(error.to_string()),
        _ => ClientError::Failed(error.to_string()),
    }
}

/// The folder of the baked city that the sources are, or are baked into.
fn baked_folder(sources: &[PathBuf]) -> Result<PathBuf> {
    if let [place] = sources
        && is_baked(place)
    {
        // The place may be the manifest of the city.
        return Ok(if place.is_file() { place.parent().unwrap_or(Path::new("")).to_owned() } else { place.clone() });
    }
    let palette = Palette::default();
    let cell_m = 1.0;
    let cache_key = cache_key(sources, &palette, FacadeOption::default(), cell_m)?;
    let job = BakeJob { inputs: sources.to_vec(), cell_m, palette, cache_key, ..BakeJob::default() };
    bake_cached(&job, &CacheRoot::open()?, None)
}

fn read_text(path: &Path) -> Result<String> {
    file::read_text(path, MAX_TEXT_BYTES).map_err(ClientError::file(path))
}

/// The view of the options, whose eye is lifted out of buildings and the ground. Fails if a file cannot be read, or a tile of the city.
fn view(args: &DrawArgs, source: &dyn ExportSource) -> Result<DrawView> {
    if let Some([azimuth_deg, elevation_deg]) = args.axonometric {
        return Ok(DrawView::Axonometric { azimuth_deg, elevation_deg });
    }
    let Some(given) = &args.view else { return Ok(DrawView::Plan) };
    // The numbers of the file as they are: a server draws the same of them.
    let (CameraFile { position, target, up, fov_y_deg }, _) = given_camera(given)?.in_city(source.manifest())?;
    let mut camera = ExportCamera { position, target, up, fov_y_deg };
    if let Some(lifted) = lifted_camera(source, camera).map_err(|error| unreadable(&error))? {
        eprintln!("note: {}", inside_note(args.keep_camera, lifted.position[2] - camera.position[2]));
        if !args.keep_camera {
            camera = lifted;
        }
    }
    Ok(DrawView::Perspective(camera))
}

fn selection(args: &DrawArgs, source: &dyn ExportSource) -> Result<ObjectSelection> {
    let place = source.manifest().crs.as_deref().and_then(EarthPlace::of);
    let bbox = args.area.world_box(|degrees| place.as_ref()?.box_on_map(degrees)).map_err(ClientError::Usage)?;
    let passing = |text: &String| {
        let filter = Filter::parse(text, source.schema())
            .map_err(|error| ClientError::Usage(format!("--filter {text}: {error}")))?;
        passing(source, &filter).map_err(|error| ClientError::Failed(error.to_string()))
    };
    let objects = args.filter.as_ref().map(passing).transpose()?;
    if let (Some(text), Some(objects)) = (&args.filter, &objects)
        && objects.is_empty()
    {
        return Err(ClientError::Usage(format!("nothing to draw: --filter {text}: {NONE_PASSES}")));
    }
    let city = source.manifest().bounds.map(|[x, y, _]| [x, y]);
    if let Some(reason) = bbox.and_then(|area| args.area.beyond(area, city, &|p| place.as_ref()?.lon_lat(p))) {
        return Err(ClientError::Usage(format!("nothing to draw: {reason}")));
    }
    Ok(ObjectSelection { bbox, objects, ..ObjectSelection::default() })
}

fn style(args: &DrawArgs, source: &dyn ExportSource) -> Result<Stylesheet> {
    let mut style = match &args.style {
        Some(path) => {
            let wrong = |error: DrawError| ClientError::Usage(format!("{}: {error}", path.display()));
            Stylesheet::parse(&read_text(path)?).map_err(wrong)?
        }
        None => Stylesheet::default(),
    };
    style.shadows = args.shadows.unwrap_or(style.shadows);
    style.look = args.look.unwrap_or(style.look);
    if args.sun.is_some() || args.time.is_some() {
        let options = SunOptions { time: args.time, bearing: args.sun, ..SunOptions::default() };
        let bearing = Daylight::new(&options, source.manifest()).map_bearing();
        if bearing.altitude_deg < 0.0 {
            return Err(ClientError::Usage("the sun is below the horizon: choose another --time or --sun".into()));
        }
        style.sun = [bearing.azimuth_deg, bearing.altitude_deg];
    }
    Ok(style)
}

/// Shows the progress on a terminal. Returns true: nothing stops the drawing but the end of the process.
fn show(shown: &Mutex<Option<(DrawStep, u32)>>, step: DrawStep, share: f64) -> bool {
    let percent = (share * 100.0) as u32;
    if std::io::stderr().is_terminal()
        && let Ok(mut shown) = shown.lock()
        && *shown != Some((step, percent))
    {
        *shown = Some((step, percent));
        eprint!("\r\x1b[K{} {percent}%", step.word());
    }
    true
}
