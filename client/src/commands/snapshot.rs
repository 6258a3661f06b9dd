//! `insula snapshot`: renders one view at full quality.

use super::headless::{open_session, render_to_file};
use crate::{
    args::{GlobalArgs, SnapshotArgs},
    camera_files::read_camera,
    error::{ClientError, Result},
    image_files::{write_pfm, write_radiance},
    ui::view_link::ViewLink,
};
use insula_viewer::{streamer::FrameRequest, sun::Daylight};

/// Runs the command. Fails if the city cannot be opened, the server does not respond, or a file cannot be read or written.
pub(super) fn run(args: &SnapshotArgs, global: &GlobalArgs) -> Result<()> {
    let link = ViewLink::parse(&args.server)?;
    let camera = match &args.camera {
        Some(path) => read_camera(path)?,
        None => link.camera.ok_or_else(no_camera)?,
    };
    let request = FrameRequest { camera, heading: None, size_px: args.size, tau_px: global.tau };
    let mut session = open_session(&args.server, global, None, Some(&request))?;
    let daylight = Daylight::new(&args.sun.or_time(link.time).into(), session.tree().manifest());
    let pixels = render_to_file(&mut session, &request, global, args.shading, &daylight, &args.out)?;
    if let Some(path) = &args.radiance {
        write_radiance(path, &pixels)?;
    }
    if let Some(path) = &args.distance {
        // With one ray per pixel, the distance is that of the pixel's centre.
        write_pfm(path, &session.draw(&request, &daylight.render_settings(args.shading, 1))?)?;
    }
    match &args.report {
        Some(path) => session.report(global.tau).write(path),
        None => Ok(()),
    }
}

fn no_camera() -> ClientError {
    ClientError::Usage("no camera: use --camera CAM.json, or a view link with a camera as --server".into())
}
