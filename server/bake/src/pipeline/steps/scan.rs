//! `scan I`: reads a chunk of the sources.

use super::job::BakeSteps;
use super::sealed::{SealedKind, SealedStore};
use crate::error::BakeError;
use crate::hash::ShortHash;
use crate::read::{PartHead, RECORDS, ReadProgress, SHAPES, ScratchOptions, TRIANGLES};
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::texture_store::texture_path;
use insula_source::temporary::{self, TemporaryFolder};
use std::fs;

pub(super) const HEAD: SealedKind = *b"HEAD";

/// Names of a chunk's objects.
pub(super) fn head_name(chunk: usize) -> String {
    format!("scan/{chunk}/head")
}

pub(super) fn triangles_name(chunk: usize) -> String {
    format!("scan/{chunk}/{TRIANGLES}")
}

pub(super) fn shapes_name(chunk: usize) -> String {
    format!("scan/{chunk}/{SHAPES}")
}

pub(super) fn records_name(chunk: usize) -> String {
    format!("scan/{chunk}/{RECORDS}")
}

/// Name of a texture's texels.
pub(super) fn picture_name(hash: ShortHash) -> String {
    let hex: String = hash.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("pic/{hex}")
}

impl BakeSteps<'_> {
    /// Reads a chunk. Fails if its sources cannot be read, or have changed since they were listed.
    pub(super) fn scan(&self, chunk: usize) -> Result<(), BakeError> {
        self.check_task("scan", chunk, self.chunks().len())?;
        let objects = self.objects();
        let wanted = &self.chunks()[chunk];
        let listed = self.list_inputs()?;
        let range = wanted.first..wanted.first + wanted.bytes.len();
        let folder = scratch_folder()?;
        let budget = ScratchBudget::new(self.config.options.scratch_bytes);
        let texture_cache_bytes = self.config.texture_cache_bytes();
        let scratch = ScratchOptions { folder: folder.path(), texture_cache_bytes, budget: &budget };
        self.progress.stage("read", wanted.bytes.iter().sum());
        let done = std::cell::Cell::new(0);
        let tick =
            |now: ReadProgress| self.progress.advance(now.bytes_done.saturating_sub(done.replace(now.bytes_done)));
        let head = listed.read(range, &self.config.options.read, scratch, &tick)?;
        for (number, facts) in (0..).zip(&head.textures) {
            let name = picture_name(facts.hash());
            if !objects.has(&name)? {
                put_file(objects, &name, &texture_path(folder.path(), number))?;
            }
        }
        put_file(objects, &triangles_name(chunk), &folder.path().join(TRIANGLES))?;
        put_file(objects, &shapes_name(chunk), &folder.path().join(SHAPES))?;
        let records = folder.path().join(RECORDS);
        if !records.exists() {
            fs::write(&records, []).map_err(|cause| BakeError::io(&records, "written", cause))?;
        }
        put_file(objects, &records_name(chunk), &records)?;
        // The last object: with it, the step is done.
        objects.write(&head_name(chunk), HEAD, &head)
    }

    /// What a chunk has. Fails if it is not scanned, or damaged.
    pub(super) fn head(&self, chunk: usize) -> Result<PartHead, BakeError> {
        let head: PartHead = self.objects().read(&head_name(chunk), HEAD)?;
        if head.is_valid() {
            Ok(head)
        } else {
            Err(self.objects().damaged(&head_name(chunk), "its fields are damaged"))
        }
    }
}

/// A folder for the files of a step, which is removed with it. Fails if it cannot be created.
pub(super) fn scratch_folder() -> Result<TemporaryFolder, BakeError> {
    temporary::folder().map_err(|cause| BakeError::io(&std::env::temp_dir(), "written", cause))
}

/// Copies a file to an object. Fails if that is not possible.
pub(super) fn put_file(objects: SealedStore<'_>, name: &str, path: &std::path::Path) -> Result<(), BakeError> {
    objects.store.put_file(name, path).map_err(|cause| objects.failed(name, cause))
}

/// Copies an object to a new file. Fails if that is not possible.
pub(super) fn fetch(objects: SealedStore<'_>, name: &str, path: &std::path::Path) -> Result<(), BakeError> {
    objects.store.fetch(name, path).map_err(|cause| objects.failed(name, cause))
}
