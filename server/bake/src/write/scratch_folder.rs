//! The folder `CITY.partial`, in which a city is baked.
//!
//! ```text
//! CITY.partial/insula-bake-scratch  marks the folder as a bake's; without it, nothing is reused or removed
//!              lock        locked while a bake runs; the system releases it however the bake ends
//!              packs/      finished blocks, each with the hash of what it is made from
//!              spool/      the scratch scene and the partition's buckets; rewritten by every run
//!              city/       the final files, renamed to CITY when complete
//!              replaced/   the previous city, between the two renames
//! ```

use super::files::{remove_folder, sync_folder};
use super::ownership::{check_mount, check_out, check_scratch, claim_scratch, remove_city, remove_scratch};
use super::tile_pack;
use crate::error::BakeError;
use crate::kept_work::{PACKS_FOLDER, has_kept_work, scratch_folder};
use insula_archive::places::has_manifest;
use serde::Serialize;
use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};

/// What became of an interrupted bake's work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ResumeStatus {
    /// There was none.
    Fresh,
    /// It was removed, because `--resume` was not given.
    Discarded,
    /// Nothing of it was of use, because its input or settings were different.
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
    scene_folder_created: Cell<bool>,
}

impl ScratchFolder {
    /// Creates and locks the scratch folder without changing its content. Fails if `out` must not be replaced or
    /// another bake holds the lock.
    pub(crate) fn lock(out: &Path) -> Result<Self, BakeError> {
        let root = scratch_folder(out);
        check_mount(out)?;
        check_mount(&root)?;
        if let Some(parent) = root.parent() {
            fs::create_dir_all(parent).map_err(|cause| BakeError::io(parent, "created", cause))?;
        }
        check_out(out)?;
        claim_scratch(&root)?;
        let path = root.join("lock");
        // Neither truncated nor, as `claim_scratch` has checked, a link.
        let opened = fs::OpenOptions::new().write(true).create(true).truncate(false).open(&path);
        let lock = opened.map_err(|cause| BakeError::io(&path, "written", cause))?;
        match lock.try_lock() {
            Err(fs::TryLockError::WouldBlock) => return Err(BakeError::Busy { path: root }),
            // Some file systems have no locks. The user must then avoid two bakes of one city.
            Ok(()) | Err(fs::TryLockError::Error(_)) => {}
        }
        // A bake that was killed between the two renames of `publish` left the previous city here. One that runs is between them.
        let replaced = root.join("replaced");
        if replaced.is_dir() && !has_manifest(out) {
            // Nothing, or an empty folder, as checked.
            let _ = fs::remove_dir(out);
            fs::rename(&replaced, out).map_err(|cause| BakeError::io(out, "restored", cause))?;
        }
        let scene_folder_created = Cell::new(false);
        Ok(Self { root, out: out.to_owned(), lock: Some(lock), scene_folder_created })
    }

    /// Keeps the packs of an interrupted bake if `resume` is set, else removes them. While none of them is found to be of the same input,
    /// they are a mismatch. Fails if the folder cannot be read or written.
    pub(crate) fn prepare(&self, resume: bool) -> Result<ResumeStatus, BakeError> {
        let packs = self.packs();
        let status = match fs::read_dir(&packs) {
            Err(_) => ResumeStatus::Fresh,
            Ok(_) if !resume => ResumeStatus::Discarded,
            Ok(_) if tile_pack::has_any(&packs) => ResumeStatus::Mismatch,
            Ok(_) => ResumeStatus::Resumed,
        };
        if !resume {
            remove_folder(&packs)?;
        }
        fs::create_dir_all(&packs).map_err(|cause| BakeError::io(&packs, "created", cause))?;
        remove_city(&self.root.join("replaced"))?;
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

    pub(crate) fn packs(&self) -> PathBuf {
        self.root.join(PACKS_FOLDER)
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
            // A file that was put into the folder since the last check is not to be removed with it.
            if let Err(error) = check_out(&replaced) {
                let _ = fs::rename(&replaced, &self.out);
                return Err(error);
            }
        }
        if let Err(cause) = fs::rename(&city, &self.out) {
            // The error of the first rename is the one to report.
            let _ = fs::rename(&replaced, &self.out);
            return Err(failed(cause));
        }
        if let Some(parent) = self.out.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            sync_folder(parent)?;
        }
        // Held meanwhile, so that no other bake begins in the folder. Windows does not remove a folder with an open file.
        let lock = self.lock.take().filter(|_| cfg!(unix));
        let removed = remove_scratch(&self.root);
        drop(lock);
        removed
    }
}

impl Drop for ScratchFolder {
    /// Removes the scratch scene, and the whole folder if a bake that resumes would find nothing in it.
    fn drop(&mut self) {
        if self.lock.is_none() {
            // Published: another bake may have the folder now.
            return;
        }
        // What somebody else has put into it meanwhile stays.
        if check_scratch(&self.root).is_ok() {
            let _ = remove_folder(&self.root.join("spool"));
        }
        if !has_kept_work(&self.out) {
            let _ = remove_scratch(&self.root);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::manifest::{FORMAT_VERSION, Manifest};
    use insula_test_support::folder::{TestFolder, tree};

    /// Begins a bake, and ends it after its first block.
    fn start(out: &Path, resume: bool) -> ResumeStatus {
        let scratch = ScratchFolder::lock(out).unwrap();
        let start = scratch.prepare(resume).unwrap();
        fs::write(scratch.packs().join("1-0-0.pack"), "a").unwrap();
        start
    }

    #[test]
    fn packs_are_kept_only_with_resume() {
        let folder = TestFolder::new("scratch");
        let out = folder.path.join("city");
        let packs = folder.path.join("city.partial/packs");
        assert_eq!(start(&out, true), ResumeStatus::Fresh);
        assert_eq!(start(&out, true), ResumeStatus::Mismatch, "until a pack is found to be of the same input");
        assert_eq!(fs::read_dir(&packs).unwrap().count(), 1);
        let scratch = ScratchFolder::lock(&out).unwrap();
        assert_eq!(scratch.prepare(false).unwrap(), ResumeStatus::Discarded);
        assert_eq!(fs::read_dir(&packs).unwrap().count(), 0);
        drop(scratch);
        assert_eq!(start(&out, true), ResumeStatus::Resumed, "nothing that does not fit");
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

    /// Writes a city's manifest with the given title.
    fn write_manifest(folder: &Path, title: &str) {
        fs::create_dir_all(folder).unwrap();
        let manifest = Manifest {
            format_version: FORMAT_VERSION,
            name: "city".into(),
            title: title.into(),
            version: "0123456789abcdef".into(),
            root_side_m: 64.0,
            node_cells: 64,
            cell_m: 1.0,
            tile_version: 1,
            ..Manifest::default()
        };
        fs::write(folder.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    }

    fn title(folder: &Path) -> String {
        insula_archive::city::read_manifest(folder).unwrap().title
    }

    /// The message of the refusal, which must change nothing in `folder`.
    #[track_caller]
    fn refused(folder: &Path, out: &Path) -> String {
        let before = tree(folder);
        let error = ScratchFolder::lock(out).unwrap_err();
        assert!(matches!(error, BakeError::Out { .. }), "{error}");
        assert_eq!(tree(folder), before, "{error}");
        error.to_string()
    }

    #[test]
    fn only_a_city_or_an_empty_folder_is_replaced() {
        let folder = TestFolder::new("foreign");
        let out = folder.path.join("city");
        fs::write(&out, "a file").unwrap();
        refused(&folder.path, &out);
        fs::remove_file(&out).unwrap();
        fs::create_dir(&out).unwrap();
        assert!(ScratchFolder::lock(&out).is_ok());
        for text in ["{}", r#"{"type": "CityJSON", "version": "2.0", "NumberedRecords": {}, "vertices": []}"#, ""] {
            fs::write(out.join("city.json"), text).unwrap();
            assert!(refused(&folder.path, &out).contains("city.json"), "{text}");
        }
        write_manifest(&out, "a");
        assert!(ScratchFolder::lock(&out).is_ok());
        let text = fs::read_to_string(out.join("city.json")).unwrap();
        fs::write(out.join("city.json"), text.replace("\"format_version\":1", "\"format_version\":99")).unwrap();
        assert!(ScratchFolder::lock(&out).is_ok(), "a city of another version");
        fs::write(out.join("letters.txt"), "dear").unwrap();
        assert!(refused(&folder.path, &out).contains("letters.txt"));
        fs::remove_file(out.join("letters.txt")).unwrap();
        fs::write(out.join("thumbnail.jpg"), b"\xff\xd8\xff\xe1\0\x20Exif holiday").unwrap();
        assert!(refused(&folder.path, &out).contains("thumbnail.jpg"), "a picture of somebody else");
        fs::remove_file(out.join("thumbnail.jpg")).unwrap();
        fs::create_dir(out.join("meshes.pmtiles")).unwrap();
        assert!(refused(&folder.path, &out).contains("meshes.pmtiles"), "a folder with a city file's name");
    }

    #[test]
    fn folder_that_no_bake_made_is_no_scratch_folder() {
        let folder = TestFolder::new("not-scratch");
        let (out, root) = (folder.path.join("city"), folder.path.join("city.partial"));
        fs::create_dir_all(root.join("packs")).unwrap();
        fs::write(root.join("state.json"), "mine").unwrap();
        assert!(refused(&folder.path, &out).contains("city.partial"));
        fs::remove_dir_all(&root).unwrap();
        start(&out, false);
        for (name, part) in [
            ("notes.txt", "city.partial"),
            ("packs/notes.txt", "packs"),
            ("packs/notes.pack", "packs"),
            ("spool/notes.rgb", "spool"),
            ("city/notes.tmp", "city"),
            ("replaced/notes.txt", "replaced"),
        ] {
            let path = root.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, "mine").unwrap();
            let message = refused(&folder.path, &out);
            assert!(message.contains("notes.") && message.contains(part), "{message}");
            fs::remove_file(&path).unwrap();
        }
        assert_eq!(start(&out, true), ResumeStatus::Mismatch);
    }

    #[test]
    #[cfg(unix)]
    fn links_are_refused_and_never_followed() {
        use std::os::unix::fs::symlink;
        let folder = TestFolder::new("links");
        let (out, root) = (folder.path.join("city"), folder.path.join("city.partial"));
        let (mine, target) = (folder.path.join("mine"), folder.path.join("mine/notes.txt"));
        fs::create_dir(&mine).unwrap();
        fs::write(&target, "dear").unwrap();
        for link in [&out, &root] {
            symlink(&mine, link).unwrap();
            refused(&folder.path, &out);
            fs::remove_file(link).unwrap();
        }
        start(&out, false);
        for (name, to) in
            [("lock", &target), ("state.json", &target), ("packs", &mine), ("city", &mine), ("spool", &mine)]
        {
            let path = root.join(name);
            let _ = fs::remove_file(&path);
            let _ = fs::remove_dir_all(&path);
            symlink(to, &path).unwrap();
            refused(&folder.path, &out);
            fs::remove_file(&path).unwrap();
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn mount_point_is_refused_before_the_bake() {
        let error = ScratchFolder::lock(Path::new("/proc")).unwrap_err();
        assert!(matches!(&error, BakeError::Out { .. }) && error.to_string().contains("mounted"), "{error}");
    }

    #[test]
    fn file_put_into_the_city_during_the_bake_stays() {
        let folder = TestFolder::new("late");
        let out = folder.path.join("city");
        write_manifest(&out, "old");
        let scratch = ScratchFolder::lock(&out).unwrap();
        scratch.prepare(false).unwrap();
        write_manifest(&scratch.city(), "new");
        fs::write(out.join("letters.txt"), "dear").unwrap();
        assert!(matches!(scratch.publish(), Err(BakeError::Out { .. })));
        assert_eq!((title(&out), fs::read_to_string(out.join("letters.txt")).unwrap()), ("old".into(), "dear".into()));
    }

    #[test]
    fn a_second_bake_leaves_the_previous_city_of_a_running_one_in_its_place() {
        let folder = TestFolder::new("between-running");
        let out = folder.path.join("city");
        let running = ScratchFolder::lock(&out).unwrap();
        let replaced = folder.path.join("city.partial/replaced");
        write_manifest(&replaced, "old");
        assert!(matches!(ScratchFolder::lock(&out), Err(BakeError::Busy { .. })));
        assert!(!out.exists() && title(&replaced) == "old");
        drop(running);
    }

    #[test]
    fn previous_city_is_restored_after_a_kill_between_the_renames() {
        let folder = TestFolder::new("between");
        let out = folder.path.join("city");
        start(&out, false);
        write_manifest(&folder.path.join("city.partial/replaced"), "old");
        // As earlier versions of the program left it.
        for name in ["state.json", "packs/m-1-0-0.pack"] {
            fs::write(folder.path.join("city.partial").join(name), "{}").unwrap();
        }
        // Somebody may have prepared the place for the next bake.
        fs::create_dir(&out).unwrap();
        let scratch = ScratchFolder::lock(&out).unwrap();
        assert_eq!(title(&out), "old");
        scratch.prepare(false).unwrap();
        write_manifest(&scratch.city(), "new");
        scratch.publish().unwrap();
        assert_eq!(title(&out), "new");
        assert!(!folder.path.join("city.partial").exists());
    }
}
