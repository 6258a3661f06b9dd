//! The folder `CITY.partial`, where a city is made.
//!
//! In: the output's path and the hashes of what is baked. Out: a folder for packs and one for the final files, and the
//! rename that makes the city appear. Next: `archive` and `city` fill it.
//!
//! ```text
//! CITY.partial/lock        held while a bake runs; the system lets go of it however the bake ends
//!              state.json  what the packs were made from
//!              packs/      finished blocks
//!              spool/      what was read, sorted into blocks; every run makes it anew
//!              city/       the final files, renamed to CITY when whole
//!              replaced/   the city that was there before, for the moment between two renames
//! ```

use std::{
    cell::Cell,
    ffi::OsString,
    fs, io,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use super::{sync_folder, write_whole};
use crate::error::BakeError;

/// What packs are made from: they are used again only if it is the same.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct InputHashes {
    /// Hash of the settings.
    pub(crate) settings: String,
    /// Hash of the scene.
    pub(crate) scene: String,
}

/// How a scratch folder was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ResumeStatus {
    /// Nothing was there.
    Fresh,
    /// An interrupted bake's work was removed, because to resume was not asked for.
    Discarded,
    /// An interrupted bake's work was of other input or settings, and was removed.
    Mismatch,
    /// An interrupted bake goes on.
    Resumed,
}

/// `CITY.partial`, locked.
#[derive(Debug)]
pub(crate) struct ScratchFolder {
    root: PathBuf,
    out: PathBuf,
    lock: Option<fs::File>,
    prepared: bool,
    spooled: Cell<bool>,
}

fn partial(out: &Path) -> PathBuf {
    let mut name = out.file_name().map(OsString::from).unwrap_or_default();
    name.push(".partial");
    out.with_file_name(name)
}

impl ScratchFolder {
    /// Looks at the output, makes the scratch folder and takes its lock. Nothing that is there is touched yet.
    pub(crate) fn lock(out: &Path) -> Result<Self, BakeError> {
        let root = partial(out);
        // Killed between two renames (see `publish`): the old city goes back first.
        let replaced = root.join("replaced");
        if replaced.is_dir() && !out.exists() {
            fs::rename(&replaced, out).map_err(|cause| BakeError::io(out, "restored", cause))?;
        }
        check_out(out)?;
        fs::create_dir_all(&root).map_err(|cause| BakeError::io(&root, "made", cause))?;
        let path = root.join("lock");
        let lock = fs::File::create(&path).map_err(|cause| BakeError::io(&path, "written", cause))?;
        match lock.try_lock() {
            Err(fs::TryLockError::WouldBlock) => return Err(BakeError::Busy { path: root }),
            // Some file systems have no locks: then two bakes of one city are the user's to avoid.
            Ok(()) | Err(fs::TryLockError::Error(_)) => {}
        }
        Ok(Self { root, out: out.to_owned(), lock: Some(lock), prepared: false, spooled: Cell::new(false) })
    }

    /// Keeps the packs of an interrupted bake if that is wished and right, removes them otherwise.
    pub(crate) fn prepare(&mut self, origin: &InputHashes, resume: bool) -> Result<ResumeStatus, BakeError> {
        self.prepared = true;
        let state = self.root.join("state.json");
        let found: Option<InputHashes> = fs::read(&state).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
        let start = match found {
            Some(found) if resume && found == *origin => ResumeStatus::Resumed,
            Some(_) if resume => ResumeStatus::Mismatch,
            Some(_) => ResumeStatus::Discarded,
            None => ResumeStatus::Fresh,
        };
        if start != ResumeStatus::Resumed {
            remove_file(&state)?;
            remove_folder(&self.packs())?;
            let json = serde_json::to_vec(origin).map_err(|cause| BakeError::io(&state, "written", cause.into()))?;
            fs::create_dir_all(self.packs()).map_err(|cause| BakeError::io(&self.packs(), "made", cause))?;
            write_whole(&state, &json)?;
        }
        remove_folder(&self.root.join("replaced"))?;
        remove_folder(&self.city())?;
        Ok(start)
    }

    /// The folder of what is read, empty the first time that it is asked for.
    pub(crate) fn spool(&self) -> Result<PathBuf, BakeError> {
        let path = self.root.join("spool");
        if !self.spooled.replace(true) {
            remove_folder(&path)?;
            fs::create_dir(&path).map_err(|cause| BakeError::io(&path, "made", cause))?;
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

    /// Makes the city appear and removes the scratch folder. The final files must be synchronised.
    pub(crate) fn publish(mut self) -> Result<(), BakeError> {
        let (city, replaced) = (self.city(), self.root.join("replaced"));
        sync_folder(&city)?;
        check_out(&self.out)?;
        let failed = |cause| BakeError::io(&self.out, "replaced", cause);
        if self.out.exists() {
            fs::rename(&self.out, &replaced).map_err(failed)?;
        }
        if let Err(cause) = fs::rename(&city, &self.out) {
            // Best effort: the rename's own fault is the one to tell.
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
    /// A bake that failed before it wrote anything leaves nothing behind.
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(self.root.join("spool"));
        if !self.prepared && !self.root.join("state.json").exists() {
            let _ = fs::remove_file(self.root.join("lock"));
            let _ = fs::remove_dir(&self.root);
        }
    }
}

/// A folder that holds other things than a city is never replaced.
fn check_out(out: &Path) -> Result<(), BakeError> {
    let refuse = |what| Err(BakeError::Out { path: out.to_owned(), what });
    match fs::metadata(out) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(cause) => Err(BakeError::io(out, "read", cause)),
        Ok(found) if !found.is_dir() => refuse("there is a file of that name"),
        Ok(_) if out.join("city.json").is_file() => Ok(()),
        Ok(_) => match fs::read_dir(out).map(|mut entries| entries.next().is_some()) {
            Ok(false) => Ok(()),
            Ok(true) => refuse("the folder is not empty and holds no city"),
            Err(cause) => Err(BakeError::io(out, "read", cause)),
        },
    }
}

fn remove_folder(path: &Path) -> Result<(), BakeError> {
    match fs::remove_dir_all(path) {
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(BakeError::io(path, "removed", cause)),
        _ => Ok(()),
    }
}

fn remove_file(path: &Path) -> Result<(), BakeError> {
    match fs::remove_file(path) {
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(BakeError::io(path, "removed", cause)),
        _ => Ok(()),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A folder for one test, removed at its end.
    pub(crate) struct Folder {
        pub(crate) path: PathBuf,
    }

    impl Folder {
        pub(crate) fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("insula-bake-{name}-{}", std::process::id()));
            let _ = fs::remove_dir_all(&path);
            fs::create_dir_all(&path).unwrap();
            Self { path }
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.path);
        }
    }

    fn origin(scene: &str) -> InputHashes {
        InputHashes { settings: "s".into(), scene: scene.into() }
    }

    fn start(out: &Path, scene: &str, resume: bool) -> ResumeStatus {
        let mut scratch = ScratchFolder::lock(out).unwrap();
        let start = scratch.prepare(&origin(scene), resume).unwrap();
        fs::write(scratch.packs().join("1-0-0.pack"), scene).unwrap();
        start
    }

    #[test]
    fn work_is_kept_only_if_wished_and_right() {
        let folder = Folder::new("scratch");
        let out = folder.path.join("city");
        let packs = folder.path.join("city.partial/packs");
        assert_eq!(start(&out, "a", true), ResumeStatus::Fresh);
        assert_eq!(start(&out, "a", true), ResumeStatus::Resumed);
        let mut scratch = ScratchFolder::lock(&out).unwrap();
        assert_eq!(scratch.prepare(&origin("b"), true).unwrap(), ResumeStatus::Mismatch);
        assert_eq!(fs::read_dir(&packs).unwrap().count(), 0);
        drop(scratch);
        assert_eq!(start(&out, "b", false), ResumeStatus::Discarded);
        fs::write(folder.path.join("city.partial/state.json"), "{").unwrap();
        assert_eq!(start(&out, "b", true), ResumeStatus::Fresh);
    }

    #[test]
    fn two_bakes_of_one_city_do_not_meet() {
        let folder = Folder::new("busy");
        let out = folder.path.join("city");
        let first = ScratchFolder::lock(&out).unwrap();
        assert!(matches!(ScratchFolder::lock(&out), Err(BakeError::Busy { .. })));
        drop(first);
        assert!(!folder.path.join("city.partial").exists());
        assert!(ScratchFolder::lock(&out).is_ok());
    }

    #[test]
    fn only_a_city_or_an_empty_folder_is_replaced() {
        let folder = Folder::new("foreign");
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
    fn killed_between_the_renames_the_old_city_comes_back() {
        let folder = Folder::new("between");
        let out = folder.path.join("city");
        let replaced = folder.path.join("city.partial/replaced");
        fs::create_dir_all(&replaced).unwrap();
        fs::write(replaced.join("city.json"), "old").unwrap();
        let mut scratch = ScratchFolder::lock(&out).unwrap();
        assert_eq!(fs::read_to_string(out.join("city.json")).unwrap(), "old");
        scratch.prepare(&origin("a"), false).unwrap();
        fs::create_dir(scratch.city()).unwrap();
        fs::write(scratch.city().join("city.json"), "new").unwrap();
        scratch.publish().unwrap();
        assert_eq!(fs::read_to_string(out.join("city.json")).unwrap(), "new");
        assert!(!folder.path.join("city.partial").exists());
    }
}
