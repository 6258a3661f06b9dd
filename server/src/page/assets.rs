//! The files of the browser viewer, which `client/web/build` makes and `build.rs` embeds.

use bytes::Bytes;
use insula_protocol::route::{self, is_asset_name};
use std::collections::BTreeMap;

/// The viewer of this program; `None` if there was none when it was built.
static EMBEDDED: Option<EmbeddedViewer> = include!(concat!(env!("OUT_DIR"), "/embedded_viewer.rs"));

/// What `build.rs` writes.
struct EmbeddedViewer {
    hash: &'static str,
    files: &'static [EmbeddedFile],
}

struct EmbeddedFile {
    name: &'static str,
    plain: &'static [u8],
    brotli: &'static [u8],
    gzip: &'static [u8],
}

/// The files of the browser viewer. All of them have addresses with the hash of all, so none ever changes. Cheap to clone.
#[derive(Debug, Clone)]
pub struct ViewerAssets {
    hash: String,
    files: BTreeMap<String, ViewerFile>,
}

/// A file, plain and compressed.
#[derive(Debug, Clone)]
pub struct ViewerFile {
    pub plain: Bytes,
    pub brotli: Bytes,
    pub gzip: Bytes,
}

impl ViewerAssets {
    /// The viewer that is part of this program, if there is one.
    pub fn embedded() -> Option<Self> {
        let viewer = EMBEDDED.as_ref()?;
        let file = |file: &EmbeddedFile| {
            let [plain, brotli, gzip] = [file.plain, file.brotli, file.gzip].map(Bytes::from_static);
            (file.name.to_owned(), ViewerFile { plain, brotli, gzip })
        };
        Some(Self::new(viewer.hash, viewer.files.iter().map(file)))
    }

    /// A viewer of other files. Those with names that addresses cannot have are left out.
    pub fn new(hash: &str, files: impl IntoIterator<Item = (String, ViewerFile)>) -> Self {
        let files = files.into_iter().filter(|(name, _)| is_asset_name(name)).collect();
        Self { hash: hash.to_owned(), files }
    }

    /// Hash of all files, which is part of their addresses.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// Address of the folder of files below the address of a site's root.
    pub(crate) fn folder(&self, root: &str) -> String {
        format!("{root}{}", route::assets(&self.hash).trim_start_matches('/'))
    }

    /// The files by name.
    pub fn files(&self) -> impl ExactSizeIterator<Item = (&str, &ViewerFile)> {
        self.files.iter().map(|(name, file)| (name.as_str(), file))
    }

    /// The languages besides English, by their codes.
    pub(crate) fn languages(&self) -> impl Iterator<Item = (&str, &ViewerFile)> {
        self.files().filter_map(|(name, file)| Some((code_of(name)?, file)))
    }

    /// Whether there is a file of this name.
    pub fn has(&self, name: &str) -> bool {
        self.files.contains_key(name)
    }
}

/// The code of a language in the name of its file; `None` of another file, and of English, which needs none.
fn code_of(file: &str) -> Option<&str> {
    let code = file.strip_prefix("language-")?.strip_suffix(".json")?;
    let is_code = (2..=3).contains(&code.len()) && code.bytes().all(|byte| byte.is_ascii_lowercase());
    (is_code && code != "en").then_some(code)
}

pub(crate) fn media_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map_or("", |(_, suffix)| suffix) {
        "js" => "text/javascript; charset=utf-8",
        "wasm" => "application/wasm",
        "css" => "text/css; charset=utf-8",
        "json" => "application/json",
        "webmanifest" => "application/manifest+json",
        "html" => "text/html; charset=utf-8",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "woff2" => "font/woff2",
        "txt" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}
