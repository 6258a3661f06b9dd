//! `insula demo`: the bundled city, in a window or as a picture.
//!
//! In: files inside this program. Out: a window, or a PNG. Next: people.

use super::{
    embedded::{Recipe, VERSIONS, bake, cache_folder, serve},
    snapshot::{overlook, start, take},
    view,
};
use crate::{
    args::{Global, SunArgs, View},
    error::{ClientError, Result},
};
use insula_protocol::manifest::Attribution;
use insula_shaders::layout::Shading;
use insula_viewer::{streamer::FrameRequest, sun::Daylight};
use serde::Deserialize;
use std::{
    collections::hash_map::DefaultHasher,
    env, fs,
    hash::{Hash, Hasher},
    path::{Path, PathBuf},
};

/// The bundled city's files.
const FILES: &[(&str, &[u8])] = &include!(concat!(env!("OUT_DIR"), "/demo_files.rs"));
/// Tells of the source: title, attribution, cell.
const ABOUT: &str = "about.json";

/// `demo/chiba/about.json`; all of it may be left out.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct About {
    title: Option<String>,
    attribution: Vec<Attribution>,
    cell_m: Option<f64>,
}

/// Runs the command.
pub fn run(headless: bool, out: &Path, size_px: [u32; 2], sun: &SunArgs, global: &Global) -> Result<()> {
    let server = serve(&bake(&recipe()?)?)?;
    if !headless && has_screen() {
        match view::run(&View { url: server.url.clone(), sun: *sun, ..View::default() }, global) {
            Err(ClientError::Graphics(reason)) => eprintln!("note: {reason}; writing a picture instead"),
            ended => return ended,
        }
    }
    let mut session = start(&server.url, global, None, None)?;
    let shot = FrameRequest { camera: overlook(&session, size_px), heading: None, size_px, tau_px: global.tau };
    let daylight = Daylight::new(&(*sun).into(), session.tree().manifest());
    take(&mut session, &shot, global, Shading::Lit, &daylight, out)?;
    let place = out.canonicalize().unwrap_or_else(|_| out.to_owned());
    println!("wrote {} (drawn by {})", place.display(), session.adapter_info().name);
    for source in &session.tree().manifest().attribution {
        println!("source: {}", source.text);
    }
    Ok(())
}

/// Unpacks the files once.
fn recipe() -> Result<Recipe> {
    if FILES.is_empty() {
        return Err(ClientError::Failed("this program was built without its bundled city: use insula open".into()));
    }
    let mut hasher = DefaultHasher::new();
    (FILES, VERSIONS).hash(&mut hasher);
    let key = hasher.finish();
    let folder = cache_folder("demo")?.join(format!("chiba-{key:016x}"));
    fs::create_dir_all(&folder).map_err(ClientError::file(&folder))?;
    let mut about = About::default();
    for (name, bytes) in FILES {
        let path = folder.join(name);
        if *name == ABOUT {
            about = serde_json::from_slice(bytes).map_err(|e| ClientError::Failed(format!("{ABOUT}: {e}")))?;
        } else if fs::metadata(&path).map_or(0, |m| m.len()) != bytes.len() as u64 {
            fs::write(&path, bytes).map_err(ClientError::file(&path))?;
        }
    }
    let inputs: Vec<PathBuf> =
        FILES.iter().filter(|(name, _)| is_city(name)).map(|(name, _)| folder.join(name)).collect();
    let About { title, attribution, cell_m } = about;
    let name = Some("chiba".into());
    Ok(Recipe { name, inputs, cell_m: cell_m.unwrap_or(1.0), title, attribution, key, ..Recipe::default() })
}

fn is_city(name: &str) -> bool {
    let name = name.strip_suffix(".gz").unwrap_or(name);
    [".obj", ".city.json", ".city.jsonl", ".cityjson"].iter().any(|end| name.ends_with(end))
}

fn has_screen() -> bool {
    let set = |name| env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(all(unix, not(target_os = "macos"))) || set("DISPLAY") || set("WAYLAND_DISPLAY")
}
