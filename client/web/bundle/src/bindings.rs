//! JavaScript and TypeScript for a WebAssembly module, by `wasm-bindgen`.

use crate::error::BundleError;
use std::{collections::BTreeMap, fs, path::Path};
use wasm_bindgen_cli_support::Bindgen;

/// The files that come from the module, by name.
#[derive(Debug, Default)]
pub(crate) struct Bindings {
    /// The module, and the script that loads it.
    pub(crate) assets: BTreeMap<String, Vec<u8>>,
    /// TypeScript declarations.
    pub(crate) types: BTreeMap<String, Vec<u8>>,
}

/// Binds `NAME.wasm`: its files are `NAME.js`, `NAME_bg.wasm` and their types.
pub(crate) fn bind(wasm: &Path) -> Result<Bindings, BundleError> {
    // `Bindgen` would call it "could not read input".
    fs::metadata(wasm).map_err(BundleError::io(wasm))?;
    let folder = tempfile::tempdir().map_err(BundleError::io(Path::new("temporary folder")))?;
    let failed = |error: &dyn std::fmt::Display| BundleError::Bindings(format!("{error:#}"));
    let name = wasm.file_stem().unwrap_or_default().to_string_lossy();
    let mut bindgen = Bindgen::new();
    bindgen.input_path(wasm).out_name(&name).typescript(true);
    // The names of functions are a fifth of the module.
    bindgen.remove_producers_section(true).remove_name_section(true);
    bindgen.web(true).map_err(|error| failed(&error))?.generate(folder.path()).map_err(|error| failed(&error))?;
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
