//! The files of the browser viewer, ready to be sent.

use super::content_encoding::EncodedContent;
use super::representation::{IMMUTABLE, REVALIDATE};
use crate::page::{SERVICE_WORKER_FILE, ViewerAssets, ViewerFile, media_type};
use std::collections::BTreeMap;

/// The viewer with its files ready to be sent.
#[derive(Debug)]
pub(super) struct ViewerContent {
    pub(super) assets: ViewerAssets,
    files: BTreeMap<String, EncodedContent>,
    service_worker: Option<EncodedContent>,
}

impl ViewerContent {
    pub(super) fn new(assets: ViewerAssets) -> Self {
        let content = |name: &str, file: &ViewerFile, cache_control| {
            let ViewerFile { plain, brotli, gzip } = file.clone();
            EncodedContent::compressed_before(plain, brotli, gzip, media_type(name), cache_control)
        };
        let files = assets.files().map(|(name, file)| (name.to_owned(), content(name, file, IMMUTABLE))).collect();
        let worker = assets.files().find(|(name, _)| *name == SERVICE_WORKER_FILE);
        let service_worker = worker.map(|(name, file)| content(name, file, REVALIDATE));
        Self { assets, files, service_worker }
    }

    /// A file of the version `hash`.
    pub(super) fn file(&self, hash: &str, name: &str) -> Option<&EncodedContent> {
        self.files.get(name).filter(|_| hash == self.assets.hash())
    }

    /// The script that keeps visited cities for offline use.
    pub(super) fn service_worker(&self) -> Option<&EncodedContent> {
        self.service_worker.as_ref()
    }
}
