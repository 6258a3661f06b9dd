//! `insula demo`: a bundled city, in a window or as an image.

use super::embedded::{BakeJob, CacheRoot, VERSIONS, bake_cached, serve};
use super::headless::{PictureFile, open_session, render_to_file};
use super::view;
use crate::args::{DemoArgs, DemoCity, GlobalArgs, ViewArgs};
use crate::error::{ClientError, Result};
use crate::image_files::picture_kind;
use insula_archive::file::read_limited;
use insula_archive::new_file::replace;
use insula_bake::read::{FACADE_ALGORITHM, FacadeOption};
use insula_command_line::output::Outputs;
use insula_protocol::manifest::Attribution;
use insula_protocol::text::printable;
use insula_shaders::layout::Shading;
use insula_viewer::camera::Camera;
use insula_viewer::streamer::FrameRequest;
use insula_viewer::sun::Daylight;
use serde::Deserialize;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::path::PathBuf;
use std::{env, fs};

/// Folders, names and contents of the bundled cities' files, from `build.rs`.
const FILES: &[(&str, &str, &[u8])] = &include!(concat!(env!("OUT_DIR"), "/demo_files.rs"));
/// The file with the [`DemoInfo`].
const INFO_FILE: &str = "about.json";

/// Content of `demo/CITY/about.json`. All fields are optional.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct DemoInfo {
    title: Option<String>,
    attribution: Vec<Attribution>,
    cell_m: Option<f64>,
    /// West, south, east and north in degrees.
    bbox_deg: Option<[f64; 4]>,
    /// Fewer than usual make the first start quick.
    views: Option<u32>,
}

/// Runs the command. Fails if the city cannot be baked, viewed or rendered.
pub(super) fn run(args: &DemoArgs, global: &GlobalArgs) -> Result<()> {
    Outputs::new(args.overwrite).file(&args.out, picture_kind(&args.out)).map_err(ClientError::Usage)?;
    let cache = CacheRoot::open()?;
    let job = unpack_demo(args.bundled, &cache)?;
    if !args.headless && has_screen() {
        let view = ViewArgs { sun: args.sun, pictures: args.pictures, ..ViewArgs::default() };
        match view::open_baked(job.clone(), cache.clone(), &view, global) {
            Err(ClientError::Graphics(reason)) => {
                eprintln!("note: {}; writing an image instead", printable(&reason));
            }
            ended => return ended,
        }
    }
    let server = serve(&bake_cached(&job, &cache, None)?)?;
    let mut session = open_session(&server.url, global, None, None, None)?;
    let aspect = f64::from(args.size[0]) / f64::from(args.size[1].max(1));
    let camera = Camera::overview(session.tree().manifest(), aspect);
    let request = FrameRequest { camera, heading: None, size_px: args.size, tau_px: global.tau, switching: None };
    let daylight = Daylight::new(&args.sun.into(), session.tree().manifest());
    let picture = PictureFile { path: &args.out, has_caption: !args.pictures.no_caption, legend: None };
    render_to_file(&mut session, &request, global, Shading::Lit, &daylight, &picture)?;
    let out = args.out.canonicalize().unwrap_or_else(|_| args.out.clone());
    let note = format!("wrote {} (drawn by {})", out.display(), session.adapter_info().name);
    println!("{}", printable(&note));
    for source in &session.tree().manifest().attribution {
        println!("source: {}", printable(&source.text));
    }
    Ok(())
}

/// Unpacks the files of a bundled city into a cache folder, unless they are there.
fn unpack_demo(city: DemoCity, cache: &CacheRoot) -> Result<BakeJob> {
    let city = match city {
        DemoCity::Monaco => "monaco",
        DemoCity::Chiba => "chiba",
    };
    let files: Vec<(&str, &[u8])> =
        FILES.iter().filter(|(of, ..)| *of == city).map(|(_, name, bytes)| (*name, *bytes)).collect();
    if files.is_empty() {
        let what = format!("this program was built without the bundled city {city}: use insula open");
        return Err(ClientError::Failed(what));
    }
    let mut hasher = DefaultHasher::new();
    (&files, VERSIONS, FACADE_ALGORITHM).hash(&mut hasher);
    let cache_key = hasher.finish();
    let folder = cache.folder("demo")?.join(format!("{city}-{cache_key:016x}"));
    fs::create_dir_all(&folder).map_err(ClientError::file(&folder))?;
    let mut info = DemoInfo::default();
    for (name, bytes) in &files {
        let path = folder.join(name);
        if *name == INFO_FILE {
            info = serde_json::from_slice(bytes).map_err(|e| ClientError::Failed(format!("{INFO_FILE}: {e}")))?;
            continue;
        }
        // Writing would follow it, to a file of somebody else.
        if path.is_symlink() {
            let what = "it is a link in the place of a file of the bundled city: remove it";
            return Err(ClientError::Failed(format!("{}: {what}", path.display())));
        }
        if !read_limited(&path, bytes.len() as u64).is_ok_and(|found| found == *bytes) {
            replace(&path, bytes).map_err(ClientError::file(&path))?;
        }
    }
    let inputs: Vec<PathBuf> =
        files.iter().filter(|(name, _)| is_city_file(name)).map(|(name, _)| folder.join(name)).collect();
    let DemoInfo { title, attribution, cell_m, bbox_deg, views } = info;
    let name = Some(city.into());
    let cell_m = cell_m.unwrap_or(1.0);
    let facades = FacadeOption::Windows;
    Ok(BakeJob { name, inputs, cell_m, title, attribution, bbox_deg, views, facades, cache_key, ..BakeJob::default() })
}

fn is_city_file(name: &str) -> bool {
    let name = name.strip_suffix(".gz").unwrap_or(name);
    [".obj", ".city.json", ".city.jsonl", ".cityjson", ".osm.pbf"].iter().any(|end| name.ends_with(end))
}

fn has_screen() -> bool {
    let is_set = |name| env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(all(unix, not(target_os = "macos"))) || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bundled_files_are_unpacked_whole_and_through_no_link() {
        let folder = tempfile::tempdir().unwrap();
        let cache = CacheRoot::at(Some(folder.path())).unwrap();
        let job = unpack_demo(DemoCity::Monaco, &cache).unwrap();
        let path = &job.inputs[0];
        let good = fs::read(path).unwrap();
        fs::write(path, vec![0; good.len()]).unwrap();
        unpack_demo(DemoCity::Monaco, &cache).unwrap();
        assert!(fs::read(path).unwrap() == good, "a damaged file of the same length");
        #[cfg(unix)]
        {
            let other = folder.path().join("thesis");
            fs::write(&other, "dear").unwrap();
            fs::remove_file(path).unwrap();
            std::os::unix::fs::symlink(&other, path).unwrap();
            assert!(unpack_demo(DemoCity::Monaco, &cache).unwrap_err().to_string().contains("a link"));
            assert_eq!(fs::read_to_string(&other).unwrap(), "dear");
        }
    }
}
