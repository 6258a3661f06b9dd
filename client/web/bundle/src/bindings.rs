//! JavaScript and TypeScript for the WebAssembly module, by `wasm-bindgen`, and the module optimised.

use crate::error::BundleError;
use std::{collections::BTreeMap, ffi::OsString, fs, path::Path, process::Command};
use wasm_bindgen_cli_support::Bindgen;

/// Name of the bound module without its suffixes.
const OUT_NAME: &str = "insula_web";
/// What rustc enables by default, and `+simd128`.
const WASM_FEATURES: [&str; 7] =
    ["bulk-memory", "nontrapping-float-to-int", "sign-ext", "mutable-globals", "reference-types", "multivalue", "simd"];

/// The files that come from the module, by name.
#[derive(Debug, Default)]
pub(crate) struct Bindings {
    /// The module, and the script that loads it.
    pub(crate) assets: BTreeMap<String, Vec<u8>>,
    /// TypeScript declarations.
    pub(crate) types: BTreeMap<String, Vec<u8>>,
}

/// Binds a module. `optimiser` is the program that optimises it: `wasm-opt` if that is installed, or "none".
pub(crate) fn bind(wasm: &Path, optimiser: Option<OsString>) -> Result<Bindings, BundleError> {
    // `Bindgen` would call it "could not read input".
    fs::metadata(wasm).map_err(BundleError::io(wasm))?;
    let folder = tempfile::tempdir().map_err(BundleError::io(Path::new("temporary folder")))?;
    let failed = |error: &dyn std::fmt::Display| BundleError::Bindings(format!("{error:#}"));
    let mut bindgen = Bindgen::new();
    bindgen.input_path(wasm).out_name(OUT_NAME).typescript(true).remove_producers_section(true);
    bindgen.web(true).map_err(|error| failed(&error))?.generate(folder.path()).map_err(|error| failed(&error))?;
    optimise(&folder.path().join(format!("{OUT_NAME}_bg.wasm")), optimiser)?;
    let mut bindings = Bindings::default();
    for entry in fs::read_dir(folder.path()).map_err(BundleError::io(folder.path()))? {
        let path = entry.map_err(BundleError::io(folder.path()))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            let reason = format!("it has scripts of its own ({name}); write them in the page instead");
            return Err(BundleError::Bindings(reason));
        }
        let content = fs::read(&path).map_err(BundleError::io(&path))?;
        let of_kind = if name.ends_with(".d.ts") { &mut bindings.types } else { &mut bindings.assets };
        of_kind.insert(name, content);
    }
    Ok(bindings)
}

/// Optimises the module in place.
fn optimise(wasm: &Path, optimiser: Option<OsString>) -> Result<(), BundleError> {
    let is_required = optimiser.is_some();
    let program = optimiser.filter(|name| !name.is_empty()).unwrap_or_else(|| "wasm-opt".into());
    if program == "none" {
        return Ok(());
    }
    let features = WASM_FEATURES.map(|feature| format!("--enable-{feature}"));
    match Command::new(program).arg("-O2").args(features).arg(wasm).arg("-o").arg(wasm).output() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound && !is_required => {
            eprintln!("wasm-opt is not installed: the module is about a tenth larger than it could be");
            Ok(())
        }
        Err(error) => Err(BundleError::Optimiser(error.to_string())),
        Ok(output) if output.status.success() => Ok(()),
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stderr);
            let reason = text.lines().take(3).collect::<Vec<_>>().join("; ");
            // Distributions have versions that are older than what rustc emits.
            if is_required {
                return Err(BundleError::Optimiser(reason));
            }
            eprintln!(
                "the installed wasm-opt is of no use ({reason}): the module is about a tenth larger than it could be"
            );
            Ok(())
        }
    }
}
