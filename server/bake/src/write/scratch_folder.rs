//! The folder `CITY.partial`, in which a city is baked.
//!
//! ```text
//! CITY.partial/lock        locked while a bake runs; the system releases it however the bake ends
//!              state.json  hashes of the input of the packs
//!              packs/      finished blocks
//!              spool/      the scratch scene and the partition's buckets; rewritten by every run
//!              city/       the final files, renamed to CITY when complete
//!              replaced/   the previous city, between the two renames
//! ```

use std::{
    cell::Cell,
    ffi::OsString,
    fs, io,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use super::files::{remove_file, remove_folder, sync_folder, write_synced};
use crate::error::BakeError;

/// Hashes of the input of the packs. Packs are reused only if both are equal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct InputHashes {
    pub(crate) settings: String,
    pub(crate) scene: String,
}

/// What became of an interrupted bake's work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ResumeStatus {
    /// There was none.
    Fresh,
    /// It was removed, because `--resume` was not given.
    Discarded,
    /// It was removed, because its input or settings were different.
    Mismatch,
    /// It is continued.
    Resumed,
}

/// `CITY.partial`, locked.
#[derive(Debug)]
pub(crate) struct ScratchFolder {
    root: PathBuf,
    out: PathBuf,
    lock: Option<fs::File>,
    prepared: bool,
    scene_folder_created: Cell<bool>,
}

fn partial(out: &Path) -> PathBuf {
    let mut name = out.file_name().map(OsString::from).unwrap_or_default();
    name.push(".partial");
    out.with_file_name(name)
}

impl ScratchFolder {
    /// Creates and locks the scratch folder without changing its content. Fails if `out` must not be replaced or
    /// another bake holds the lock.
    pub(crate) fn lock(out: &Path) -> Result<Self, BakeError> {
        let root = partial(out);
        // A bake that was killed between the two renames of `publish` left the previous city here.
        let replaced = root.join("replaced");
        if replaced.is_dir() && !out.exists() {
            fs::rename(&replaced, out).map_err(|cause| BakeError::io(out, "restored", cause))?;
        }
        check_out(out)?;
        fs::create_dir_all(&root).map_err(|cause| BakeError::io(&root, "created", cause))?;
        let path = root.join("lock");
        let lock = fs::File::create(&path).map_err(|cause| BakeError::io(&path, "written", cause))?;
        match lock.try_lock() {
            Err(fs::TryLockError::WouldBlock) => return Err(BakeError::Busy { path: root }),
            // Some file systems have no locks. The user must then avoid two bakes of one city.
            Ok(()) | Err(fs::TryLockError::Error(_)) => {}
        }
        let scene_folder_created = Cell::new(false);
        Ok(Self { root, out: out.to_owned(), lock: Some(lock), prepared: false, scene_folder_created })
    }

    /// Keeps the packs of an interrupted bake if `resume` is set and its input was the same, else removes them. Fails
    /// if the folder cannot be read or written.
    pub(crate) fn prepare(&mut self, input: &InputHashes, resume: bool) -> Result<ResumeStatus, BakeError> {
        self.prepared = true;
        let state = self.root.join("state.json");
        let found: Option<InputHashes> = fs::read(&state).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
        let status = match found {
            Some(found) if resume && found == *input => ResumeStatus::Resumed,
            Some(_) if resume => ResumeStatus::Mismatch,
            Some(_) => ResumeStatus::Discarded,
            None => ResumeStatus::Fresh,
        };
        if status != ResumeStatus::Resumed {
            remove_file(&state)?;
            remove_folder(&self.packs())?;
            let json = serde_json::to_vec(input).map_err(|cause| BakeError::io(&state, "written", cause.into()))?;
            fs::create_dir_all(self.packs()).map_err(|cause| BakeError::io(&self.packs(), "created", cause))?;
            write_synced(&state, &json)?;
        }
        remove_folder(&self.root.join("replaced"))?;
        remove_folder(&self.city())?;
        Ok(status)
    }

    /// The folder of the scratch scene. The first call empties it. Fails if it cannot be removed or created.
    pub(crate) fn scene_folder(&self) -> Result<PathBuf, BakeError> {
        let path = self.root.join("spool");
        if !self.scene_folder_created.replace(true) {
            remove_folder(&path)?;
            fs::create_dir(&path).map_err(|cause| BakeError::io(&path, "created", cause))?;
        }
        Ok(path)
    }

    /// The folder of the packs.
    pub(crate) fn packs(&self) -> PathBuf {
        self.root.join("packs")
    }

    /// The folder of the final files.
    pub(crate) fn city(&self) -> PathBuf {
        self.root.join("city")
    }

    /// Renames the final files, which must be synchronised, to the output and removes the scratch folder. Fails if the
    /// output cannot be replaced; the previous city is then restored.
    pub(crate) fn publish(mut self) -> Result<(), BakeError> {
        let (city, replaced) = (self.city(), self.root.join("replaced"));
        sync_folder(&city)?;
        check_out(&self.out)?;
        let failed = |cause| BakeError::io(&self.out, "replaced", cause);
        if self.out.exists() {
            fs::rename(&self.out, &replaced).map_err(failed)?;
        }
        if let Err(cause) = fs::rename(&city, &self.out) {
            // The error of the first rename is the one to report.
            let _ = fs::rename(&replaced, &self.out);
            return Err(failed(cause));
        }
        if let Some(parent) = self.out.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            sync_folder(parent)?;
        }
        self.lock = None;
        remove_folder(&self.root)
    }
}

impl Drop for ScratchFolder {
    /// Removes the scratch scene, and the whole folder if the bake failed before it wrote any packs.
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(self.root.join("spool"));
        if !self.prepared && !self.root.join("state.json").exists() {
            let _ = fs::remove_file(self.root.join("lock"));
            let _ = fs::remove_dir(&self.root);
        }
    }
}

/// Fails unless `out` does not exist, is empty or contains a city: nothing else is ever replaced.
fn check_out(out: &Path) -> Result<(), BakeError> {
    let refuse = |what| Err(BakeError::Out { path: out.to_owned(), what });
    match fs::metadata(out) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(cause) => Err(BakeError::io(out, "read", cause)),
        Ok(found) if !found.is_dir() => refuse("a file with this name exists"),
        Ok(_) if out.join("city.json").is_file() => Ok(()),
        Ok(_) => match fs::read_dir(out).map(|mut entries| entries.next().is_some()) {
            Ok(false) => Ok(()),
            Ok(true) => refuse("the folder is not empty and contains no city"),
            Err(cause) => Err(BakeError::io(out, "read", cause)),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

    fn input(scene: &str) -> InputHashes {
        InputHashes { settings: "s".into(), scene: scene.into() }
    }

    fn start(out: &Path, scene: &str, resume: bool) -> ResumeStatus {
        let mut scratch = ScratchFolder::lock(out).unwrap();
        let start = scratch.prepare(&input(scene), resume).unwrap();
        fs::write(scratch.packs().join("1-0-0.pack"), scene).unwrap();
        start
    }

    #[test]
    fn packs_are_kept_only_with_resume_and_equal_input() {
        let folder = TestFolder::new("scratch");
        let out = folder.path.join("city");
        let packs = folder.path.join("city.partial/packs");
        assert_eq!(start(&out, "a", true), ResumeStatus::Fresh);
        assert_eq!(start(&out, "a", true), ResumeStatus::Resumed);
        let mut scratch = ScratchFolder::lock(&out).unwrap();
        assert_eq!(scratch.prepare(&input("b"), true).unwrap(), ResumeStatus::Mismatch);
        assert_eq!(fs::read_dir(&packs).unwrap().count(), 0);
        drop(scratch);
        assert_eq!(start(&out, "b", false), ResumeStatus::Discarded);
        fs::write(folder.path.join("city.partial/state.json"), "{").unwrap();
        assert_eq!(start(&out, "b", true), ResumeStatus::Fresh);
    }

    #[test]
    fn second_bake_of_the_same_city_is_refused() {
        let folder = TestFolder::new("busy");
        let out = folder.path.join("city");
        let first = ScratchFolder::lock(&out).unwrap();
        assert!(matches!(ScratchFolder::lock(&out), Err(BakeError::Busy { .. })));
        drop(first);
        assert!(!folder.path.join("city.partial").exists());
        assert!(ScratchFolder::lock(&out).is_ok());
    }

    #[test]
    fn only_a_city_or_an_empty_folder_is_replaced() {
        let folder = TestFolder::new("foreign");
        let out = folder.path.join("city");
        fs::write(&out, "a file").unwrap();
        assert!(matches!(ScratchFolder::lock(&out), Err(BakeError::Out { .. })));
        fs::remove_file(&out).unwrap();
        fs::create_dir(&out).unwrap();
        assert!(ScratchFolder::lock(&out).is_ok());
        fs::write(out.join("letters.txt"), "dear").unwrap();
        assert!(matches!(ScratchFolder::lock(&out), Err(BakeError::Out { .. })));
        fs::write(out.join("city.json"), "{}").unwrap();
        assert!(ScratchFolder::lock(&out).is_ok());
    }

    #[test]
    fn previous_city_is_restored_after_a_kill_between_the_renames() {
        let folder = TestFolder::new("between");
        let out = folder.path.join("city");
        let replaced = folder.path.join("city.partial/replaced");
        fs::create_dir_all(&replaced).unwrap();
        fs::write(replaced.join("city.json"), "old").unwrap();
        let mut scratch = ScratchFolder::lock(&out).unwrap();
        assert_eq!(fs::read_to_string(out.join("city.json")).unwrap(), "old");
        scratch.prepare(&input("a"), false).unwrap();
        fs::create_dir(scratch.city()).unwrap();
        fs::write(scratch.city().join("city.json"), "new").unwrap();
        scratch.publish().unwrap();
        assert_eq!(fs::read_to_string(out.join("city.json")).unwrap(), "new");
        assert!(!folder.path.join("city.partial").exists());
    }
}
