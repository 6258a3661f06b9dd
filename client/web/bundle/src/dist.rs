//! Writes the folder of assets, each plain and compressed, and replaces the old folder as a whole.
//!
//! ```text
//! DIST/assets/HASH/FILE, FILE.br, FILE.gz
//! DIST/types/*.d.ts
//! DIST/manifest.json
//! ```

use crate::{
    asset_files::{AssetFiles, hash},
    error::BundleError,
};
use serde::Serialize;
use std::{
    collections::BTreeMap,
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

const BROTLI_QUALITY: i32 = 11;
/// Base-2 logarithm of the window: the largest of the standard format.
const BROTLI_WINDOW: i32 = 24;

/// `manifest.json`
#[derive(Debug, Serialize)]
struct DistManifest {
    hash: String,
    files: Vec<AssetEntry>,
}

/// An asset with its size in each form.
#[derive(Debug, Serialize)]
struct AssetEntry {
    name: String,
    bytes: usize,
    brotli: usize,
    gzip: usize,
}

/// Replaces the folder `out`. Returns a summary for people.
pub(crate) fn replace(
    out: &Path,
    files: &AssetFiles,
    types: &BTreeMap<String, Vec<u8>>,
) -> Result<String, BundleError> {
    let out = std::path::absolute(out).map_err(BundleError::io(out))?;
    let parent = out.parent().unwrap_or(&out);
    fs::create_dir_all(parent).map_err(BundleError::io(parent))?;
    // Beside the old folder, so that it can be renamed.
    let builder = |prefix| tempfile::Builder::new().prefix(prefix).suffix(".tmp").tempdir_in(parent);
    let new = builder(".dist-").map_err(BundleError::io(parent))?;
    let manifest = write(new.path(), files, types)?;
    let old = builder(".dist-old-").map_err(BundleError::io(parent))?;
    if out.exists() {
        fs::rename(&out, old.path().join("dist")).map_err(BundleError::io(&out))?;
    }
    let new = new.keep();
    open_to_all(&new).and_then(|()| fs::rename(&new, &out)).map_err(BundleError::io(&out))?;
    let total = |of: fn(&AssetEntry) -> usize| manifest.files.iter().map(of).sum::<usize>();
    Ok(format!(
        "{}: {} files, {} bytes, {} as brotli, {} as gzip, hash {}",
        out.display(),
        manifest.files.len(),
        total(|entry| entry.bytes),
        total(|entry| entry.brotli),
        total(|entry| entry.gzip),
        manifest.hash
    ))
}

fn write(folder: &Path, files: &AssetFiles, types: &BTreeMap<String, Vec<u8>>) -> Result<DistManifest, BundleError> {
    let mut manifest = DistManifest { hash: hash(files), files: Vec::new() };
    let assets = folder.join("assets").join(&manifest.hash);
    for (name, content) in files {
        let path = |suffix: &str| assets.join(format!("{name}{suffix}"));
        let [brotli, gzip] = [brotli(content), gzip(content)].map(|bytes| bytes.map_err(BundleError::io(&path(""))));
        let (brotli, gzip) = (brotli?, gzip?);
        for (suffix, bytes) in [("", content), (".br", &brotli), (".gz", &gzip)] {
            write_file(&path(suffix), bytes)?;
        }
        let entry = AssetEntry { name: name.clone(), bytes: content.len(), brotli: brotli.len(), gzip: gzip.len() };
        manifest.files.push(entry);
    }
    for (name, content) in types {
        write_file(&folder.join("types").join(name), content)?;
    }
    let path = folder.join("manifest.json");
    let json = serde_json::to_vec_pretty(&manifest).map_err(|error| BundleError::io(&path)(error.into()))?;
    write_file(&path, &json)?;
    Ok(manifest)
}

fn write_file(path: &PathBuf, bytes: &[u8]) -> Result<(), BundleError> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(BundleError::io(folder))?;
    fs::write(path, bytes).map_err(BundleError::io(path))
}

/// A temporary folder is for its owner alone; the result is as any folder that a build makes.
#[cfg(unix)]
fn open_to_all(folder: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(folder, fs::Permissions::from_mode(0o755))
}

#[cfg(not(unix))]
fn open_to_all(_: &Path) -> io::Result<()> {
    Ok(())
}

/// The shortest result of the encoder's modes: which one it is differs from file to file.
fn brotli(content: &[u8]) -> io::Result<Vec<u8>> {
    use brotli::enc::backward_references::BrotliEncoderMode::{
        BROTLI_FORCE_SIGNED_PRIOR, BROTLI_MODE_FONT, BROTLI_MODE_GENERIC, BROTLI_MODE_TEXT,
    };
    let mut shortest: Option<Vec<u8>> = None;
    for mode in [BROTLI_MODE_GENERIC, BROTLI_MODE_TEXT, BROTLI_MODE_FONT, BROTLI_FORCE_SIGNED_PRIOR] {
        let parameters = brotli::enc::BrotliEncoderParams {
            mode,
            quality: BROTLI_QUALITY,
            lgwin: BROTLI_WINDOW,
            size_hint: content.len(),
            ..Default::default()
        };
        let mut out = Vec::new();
        brotli::BrotliCompress(&mut &*content, &mut out, &parameters)?;
        if shortest.as_ref().is_none_or(|known| out.len() < known.len()) {
            shortest = Some(out);
        }
    }
    Ok(shortest.unwrap_or_default())
}

fn gzip(content: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(content)?;
    encoder.finish()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may panic")]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn the_folder_is_replaced_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("dist");
        for text in ["first", "second"] {
            let text = text.repeat(100);
            let files = AssetFiles::from([("app.js".to_owned(), text.clone().into_bytes())]);
            let types = BTreeMap::from([("app.d.ts".to_owned(), Vec::new())]);
            replace(&out, &files, &types).unwrap();
            let hashes: Vec<_> = fs::read_dir(out.join("assets")).unwrap().map(|entry| entry.unwrap().path()).collect();
            assert!(hashes.len() == 1 && hashes[0].ends_with(hash(&files)), "{hashes:?}");
            assert_eq!(fs::read_to_string(hashes[0].join("app.js")).unwrap(), text);
            let mut plain = String::new();
            let compressed = fs::read(hashes[0].join("app.js.br")).unwrap();
            brotli::Decompressor::new(&compressed[..], 4096).read_to_string(&mut plain).unwrap();
            assert_eq!(plain, text);
            plain.clear();
            let compressed = fs::read(hashes[0].join("app.js.gz")).unwrap();
            flate2::read::GzDecoder::new(&compressed[..]).read_to_string(&mut plain).unwrap();
            assert_eq!(plain, text);
            assert!(out.join("types/app.d.ts").is_file());
            let manifest: serde_json::Value =
                serde_json::from_slice(&fs::read(out.join("manifest.json")).unwrap()).unwrap();
            assert_eq!(manifest["files"][0]["bytes"], text.len());
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing stays beside it");
    }
}
