//! `insula snapshot`: renders one view at full quality.

use super::headless::{PictureFile, open_session, render_to_file, settle_with_progress};
use super::proposal;
use crate::args::{GlobalArgs, SnapshotArgs};
use crate::camera_files::PlacedCamera;
use crate::error::{ClientError, Result};
use crate::image_files::{objects_kind, picture_kind, write_objects, write_pfm, write_radiance};
use crate::objects::ObjectLookup;
use crate::report::RunReport;
use crate::session::Session;
use crate::ui::view_link::ViewLink;
use crate::viewpoint::{camera_in, chosen_camera, lifted_out, stand_on_ground};
use glam::DVec3;
use insula_archive::new_file::replace;
use insula_command_line::camera::inside_note;
use insula_command_line::output::{FileKind, Outputs};
use insula_objects::filter::NONE_PASSES_IN_VIEW;
use insula_protocol::blockmap::NO_OBJECT;
use insula_protocol::text::{count, human_bytes, printable};
use insula_shaders::layout::Shading;
use insula_viewer::camera::Camera;
use insula_viewer::objects::ObjectDescription;
use insula_viewer::streamer::FrameRequest;
use insula_viewer::sun::Daylight;
use serde::Serialize;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::fs;
use std::path::{Path, PathBuf};

/// Runs the command. Fails if the city cannot be opened, the server does not respond, or a file cannot be read or written.
pub(super) fn run(args: &SnapshotArgs, global: &GlobalArgs) -> Result<()> {
    check_outputs(args, &proposal::files(args.proposal.as_deref())?).map_err(ClientError::Usage)?;
    let link = ViewLink::parse(args.place.place())?;
    let (switching, tau_px) = args.switch.switching(global.tau).map_err(ClientError::Usage)?;
    let request = |camera| FrameRequest { camera, heading: None, size_px: args.size, tau_px, switching };
    let given = chosen_camera(&args.viewpoint, link.camera)?;
    let known = given.and_then(PlacedCamera::known).map(request);
    let mut session = open_session(args.place.place(), global, None, known.as_ref(), args.proposal.as_deref())?;
    let manifest = session.tree().manifest();
    let request = request(match given {
        Some(given) => given.in_city(manifest)?.1,
        None => camera_in(&args.viewpoint, manifest, args.size)?,
    });
    let request = outside(args, global, request, &mut session)?;
    let daylight = Daylight::new(&args.sun.or_link(link.time, link.look).into(), session.tree().manifest());
    let objects = if args.needs_objects() { Some(session.open_objects()?) } else { None };
    let mut legend = None;
    if let Some(objects) = objects.as_ref().filter(|_| !args.styles.is_empty()) {
        let styled = objects.styles(&args.styles.rules())?;
        if args.styles.filter.is_some() {
            match styled.passing {
                0 => eprintln!("warning: {NONE_PASSES_IN_VIEW}"),
                passing => eprintln!("{} of the city pass the filter", count(passing as u64, "object")),
            }
        }
        session.set_styles(styled.styles);
        legend = styled.legend.filter(|_| args.legend);
    }
    let out = PictureFile { path: &args.out, has_caption: !args.pictures.no_caption, legend };
    let pixels = render_to_file(&mut session, &request, global, args.shading, &daylight, &out)?;
    if let Some(path) = &args.radiance {
        write_radiance(path, &pixels)?;
    }
    if let Some(objects) = objects.as_ref().filter(|_| args.objects.is_some() || args.objects_json.is_some()) {
        let ids = session.draw(&request, &daylight.render_settings(Shading::Objects, 1))?;
        let ids = session.objects_of(&ids);
        if let Some(path) = &args.objects {
            write_objects(path, args.size, &ids)?;
        }
        if let Some(path) = &args.objects_json {
            write_object_list(path, objects, &ids)?;
        }
    }
    if let Some(path) = &args.distance {
        // With one ray per pixel, the distance is that of the pixel's centre.
        write_pfm(path, &session.draw(&request, &daylight.render_settings(args.shading, 1))?)?;
    }
    let is_inside = session.solids().is_inside(request.camera.position);
    if let Some(path) = &args.report {
        RunReport { camera_inside_solid: Some(is_inside), ..session.report(global.tau) }.write(path)?;
    }
    eprintln!("{}", printable(&written_files(args)));
    Ok(())
}

/// The request with its eye on the ground, if it stands on a street, and outside of buildings and of the ground. Says on standard error
/// what is wrong with a camera.
fn outside(
    args: &SnapshotArgs,
    global: &GlobalArgs,
    mut request: FrameRequest,
    session: &mut Session,
) -> Result<FrameRequest> {
    if args.viewpoint.at_street.is_some() {
        // From above, the tiles around the place are those of an eye that stands there.
        let high_m = session.tree().manifest().bounds[1][2] + 50.0;
        let above = Camera {
            position: request.camera.position.with_z(high_m),
            ..Camera::from_angles(DVec3::ZERO, 0.0, -FRAC_PI_2, 1.0)
        };
        settle_with_progress(session, &FrameRequest { camera: above, ..request }, global)?;
        request.camera = stand_on_ground(request.camera, session);
    }
    settle_with_progress(session, &request, global)?;
    if let Some(lifted) = lifted_out(request.camera, session) {
        let up_m = lifted.position.z - request.camera.position.z;
        eprintln!("note: {}", inside_note(args.viewpoint.keep_camera, up_m));
        if !args.viewpoint.keep_camera {
            request.camera = lifted;
        }
    }
    Ok(request)
}

/// Fails if a file would overwrite anything but an earlier one. `proposal` has the files of a proposal.
fn check_outputs(args: &SnapshotArgs, proposal: &[PathBuf]) -> std::result::Result<(), String> {
    let inputs = [Some(Path::new(args.place.place())), args.viewpoint.camera.as_deref()];
    let inputs = inputs.into_iter().flatten().chain(proposal.iter().map(PathBuf::as_path));
    let mut outputs = Outputs::new(args.overwrite).reading(inputs);
    outputs.file(&args.out, picture_kind(&args.out))?;
    for path in [&args.distance, &args.radiance].into_iter().flatten() {
        outputs.file(path, FileKind::PFM)?;
    }
    if let Some(path) = &args.objects {
        outputs.file(path, objects_kind(path))?;
    }
    if let Some(path) = &args.objects_json {
        outputs.file(path, FileKind::Json("a list of objects", &["pixels"]))?;
    }
    args.report.as_ref().map_or(Ok(()), |path| outputs.file(path, RunReport::KIND))
}

#[derive(Serialize)]
struct ShownObject {
    #[serde(flatten)]
    object: ObjectDescription,
    pixels: u64,
}

/// Writes what is known of the objects that a picture shows, those with the most pixels first.
fn write_object_list(path: &Path, objects: &ObjectLookup, ids: &[u32]) -> Result<()> {
    let mut pixels = BTreeMap::<u32, u64>::new();
    ids.iter().filter(|id| **id != NO_OBJECT).for_each(|id| *pixels.entry(*id).or_default() += 1);
    let mut shown: Vec<(u32, u64)> = pixels.into_iter().collect();
    shown.sort_by_key(|(id, pixels)| (Reverse(*pixels), *id));
    let mut list = Vec::with_capacity(shown.len());
    for (id, pixels) in shown {
        if let Some(object) = objects.describe(id)? {
            list.push(ShownObject { object, pixels });
        }
    }
    let json = serde_json::to_string_pretty(&list).map_err(|error| ClientError::Failed(error.to_string()))?;
    replace(path, (json + "\n").as_bytes()).map_err(ClientError::file(path))
}

/// The written files with their sizes.
fn written_files(args: &SnapshotArgs) -> String {
    let [width, height] = args.size;
    let describe = |path: &PathBuf, what: &str| {
        let size = fs::metadata(path).map_or(String::new(), |found| human_bytes(found.len()));
        format!("{} ({what}{size})", path.display())
    };
    let image = describe(&args.out, &format!("{width} x {height} pixels, "));
    let others = [&args.radiance, &args.distance, &args.objects, &args.objects_json, &args.report]
        .into_iter()
        .flatten()
        .map(|path| describe(path, ""));
    format!("wrote {}", std::iter::once(image).chain(others).collect::<Vec<_>>().join(", "))
}
