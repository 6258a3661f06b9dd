//! Makes `client/web/dist` from the WebAssembly modules of `insula-web` and the crates beside it, and the files of `client/web/page`.
//!
//! ```text
//! wasm, shaders -> bindings (wasm-bindgen) -> asset_files (names, hash) -> languages (checks) -> joined_modules -> dist (compressed forms, manifest)
//! ```
//!
//! `insula-server` embeds the result, see `docs/decisions/0015-viewer-assets.md`.

mod asset_files;
mod bindings;
mod dist;
mod error;
mod joined_modules;
mod languages;

use error::BundleError;
use std::{collections::BTreeMap, env, fs, path::Path, process::ExitCode};

/// What a page with a GPU fetches when it has drawn a picture.
const SHADERS: &str = "shaders.txt";
const USAGE: &str = "usage: insula-web-bundle SHADERS PAGE DIST MODULE.wasm...
Binds each MODULE.wasm, adds the file SHADERS and the files of the folder PAGE, and replaces the folder DIST.";

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    match &arguments[..] {
        [help] if help == "--help" => {
            println!("{USAGE}");
            ExitCode::SUCCESS
        }
        [shaders, page, out, modules @ ..] if !modules.is_empty() => {
            match bundle(modules, Path::new(shaders), Path::new(page), Path::new(out)) {
                Ok(summary) => {
                    println!("{summary}");
                    ExitCode::SUCCESS
                }
                Err(error) => {
                    eprintln!("error: {error}");
                    ExitCode::FAILURE
                }
            }
        }
        _ => {
            eprintln!("{USAGE}");
            ExitCode::from(2)
        }
    }
}

/// Makes the folder `out`. Returns a summary for people.
fn bundle(modules: &[String], shaders: &Path, page: &Path, out: &Path) -> Result<String, BundleError> {
    let mut files = asset_files::read_page(page)?;
    let mut types = BTreeMap::new();
    for wasm in modules {
        let bound = bindings::bind(Path::new(wasm))?;
        for (name, content) in bound.assets {
            asset_files::add(&mut files, name, content)?;
        }
        types.extend(bound.types);
    }
    let text = fs::read(shaders).map_err(BundleError::io(shaders))?;
    asset_files::add(&mut files, SHADERS.to_owned(), text)?;
    languages::check(&files)?;
    dist::replace(out, &joined_modules::join(files)?, &types)
}
