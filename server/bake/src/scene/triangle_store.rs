//! Triangles in the order of reading, in memory or in a scratch file.

use crate::error::BakeError;
use crate::scene::SceneTriangle;
use crate::scene::scratch_budget::ScratchBudget;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Size of a triangle in a scratch file: corners, texture coordinates, material, object; 4 bytes each, little-endian.
pub(crate) const RECORD_BYTES: usize = 17 * 4;
const BUFFER_BYTES: usize = RECORD_BYTES << 12;

/// Encodes a triangle for a scratch file.
pub(crate) fn to_record(triangle: &SceneTriangle) -> [u8; RECORD_BYTES] {
    let mut record = [0; RECORD_BYTES];
    let floats = triangle.corners.as_flattened().iter().chain(triangle.uv.as_flattened()).map(|v| v.to_bits());
    let words = floats.chain([triangle.material, triangle.object]);
    for (slot, word) in record.chunks_exact_mut(4).zip(words) {
        slot.copy_from_slice(&word.to_le_bytes());
    }
    record
}

/// The inverse of [`to_record`].
pub(crate) fn from_record(record: &[u8; RECORD_BYTES]) -> SceneTriangle {
    let word = |i: usize| u32::from_le_bytes([record[4 * i], record[4 * i + 1], record[4 * i + 2], record[4 * i + 3]]);
    let float = |i: usize| f32::from_bits(word(i));
    SceneTriangle {
        corners: std::array::from_fn(|i| std::array::from_fn(|axis| float(3 * i + axis))),
        uv: std::array::from_fn(|i| [float(9 + 2 * i), float(10 + 2 * i)]),
        material: word(15),
        object: word(16),
    }
}

/// Triangles in the order in which they were added.
#[derive(Debug)]
pub(crate) enum TriangleStore {
    Memory(Vec<SceneTriangle>),
    File(TriangleFile),
    /// Files that others wrote, then one of its own.
    Parts(Vec<TrianglePart>, TriangleFile),
}

/// One of several files of triangles, which have numbers of objects and materials of their own.
#[derive(Debug, Clone)]
pub(crate) struct TrianglePart {
    pub(crate) path: PathBuf,
    /// Number of its first object.
    pub(crate) first_object: u32,
    /// Number of each of its materials.
    pub(crate) materials: Vec<u32>,
}

/// A scratch file of triangles. The first write error is kept until [`TriangleStore::finish`], so that readers need not
/// handle it.
#[derive(Debug)]
pub(crate) struct TriangleFile {
    path: PathBuf,
    writer: Option<BufWriter<File>>,
    budget: ScratchBudget,
    failed: Option<BakeError>,
}

impl TriangleFile {
    /// Fails if the file cannot be created.
    fn create(path: PathBuf, budget: ScratchBudget) -> Result<Self, BakeError> {
        let file = File::create_new(&path).map_err(|cause| BakeError::io(&path, "written", cause))?;
        let writer = Some(BufWriter::with_capacity(BUFFER_BYTES, file));
        Ok(Self { path, writer, budget, failed: None })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// What limits the scratch files.
    pub(crate) fn budget(&self) -> ScratchBudget {
        self.budget.clone()
    }

    /// Calls `visit` for every triangle, in order. Fails if the file cannot be read, or with the first error of `visit`.
    fn try_for_each(&self, visit: &mut dyn FnMut(SceneTriangle) -> Result<(), BakeError>) -> Result<(), BakeError> {
        read_file(&self.path, visit)
    }

    /// Removes the file. A file that cannot be removed stays until the whole scratch folder is removed.
    pub(crate) fn remove(self) {
        drop(self.writer);
        let _ = std::fs::remove_file(self.path);
    }
}

impl TriangleStore {
    /// Fails if the file at `path` cannot be created.
    pub(crate) fn in_file(path: PathBuf, budget: ScratchBudget) -> Result<Self, BakeError> {
        Ok(Self::File(TriangleFile::create(path, budget)?))
    }

    /// Triangles of files that others wrote, and further ones at `path`. Fails as [`Self::in_file`].
    pub(crate) fn of_parts(parts: Vec<TrianglePart>, path: PathBuf, budget: ScratchBudget) -> Result<Self, BakeError> {
        Ok(Self::Parts(parts, TriangleFile::create(path, budget)?))
    }

    /// The file that is written; `None` in memory.
    pub(crate) fn own_file(&self) -> Option<&TriangleFile> {
        match self {
            Self::Memory(_) => None,
            Self::File(file) | Self::Parts(_, file) => Some(file),
        }
    }

    /// Bytes that triangles take in memory.
    pub(crate) fn held_bytes(&self) -> u64 {
        match self {
            Self::Memory(all) => (all.len() * size_of::<SceneTriangle>()) as u64,
            Self::File(_) | Self::Parts(..) => 0,
        }
    }

    pub(crate) fn push(&mut self, triangle: SceneTriangle) {
        match self {
            Self::Memory(all) => all.push(triangle),
            Self::File(file) | Self::Parts(_, file) => {
                let Some(writer) = &mut file.writer else { return };
                let written = |cause| BakeError::io(&file.path, "written", cause);
                let spent = file.budget.spend(RECORD_BYTES);
                if let Err(error) = spent.and_then(|()| writer.write_all(&to_record(&triangle)).map_err(written)) {
                    file.failed = Some(error);
                    file.writer = None;
                }
            }
        }
    }

    /// Makes what was pushed so far readable. Fails if it cannot be written.
    pub(crate) fn flush(&mut self) -> Result<(), BakeError> {
        let (Self::File(file) | Self::Parts(_, file)) = self else { return Ok(()) };
        let TriangleFile { path, writer: Some(writer), .. } = file else { return Ok(()) };
        writer.flush().map_err(|cause| BakeError::io(path, "written", cause))
    }

    /// Ends the writing. Fails if any write failed or the scratch files are larger than they may be.
    pub(crate) fn finish(&mut self) -> Result<(), BakeError> {
        let (Self::File(file) | Self::Parts(_, file)) = self else { return Ok(()) };
        let flushed = file.writer.take().map_or(Ok(()), |mut writer| writer.flush());
        let flushed = flushed.map_err(|cause| BakeError::io(&file.path, "written", cause));
        file.failed.take().map_or(flushed, Err)
    }

    /// Adds triangles after the writing has ended. Fails if they cannot be written.
    pub(crate) fn append(&mut self, triangles: impl Iterator<Item = SceneTriangle>) -> Result<(), BakeError> {
        if let Self::File(file) | Self::Parts(_, file) = self {
            let opened = File::options().append(true).open(&file.path);
            let opened = opened.map_err(|cause| BakeError::io(&file.path, "written", cause))?;
            file.writer = Some(BufWriter::with_capacity(BUFFER_BYTES, opened));
        }
        triangles.for_each(|triangle| self.push(triangle));
        self.finish()
    }

    /// Calls `visit` for every triangle, in order. Fails if the file cannot be read, or with the first error of
    /// `visit`.
    pub(crate) fn try_for_each(
        &self,
        mut visit: impl FnMut(SceneTriangle) -> Result<(), BakeError>,
    ) -> Result<(), BakeError> {
        match self {
            Self::Memory(all) => all.iter().try_for_each(|triangle| visit(*triangle)),
            Self::File(file) => file.try_for_each(&mut visit),
            Self::Parts(parts, file) => {
                parts.iter().try_for_each(|part| part.try_for_each(&mut visit))?;
                file.try_for_each(&mut visit)
            }
        }
    }
}

/// Calls `visit` for every triangle of a file. Fails if it cannot be read, or with the first error of `visit`.
pub(crate) fn read_file(
    path: &Path,
    visit: &mut dyn FnMut(SceneTriangle) -> Result<(), BakeError>,
) -> Result<(), BakeError> {
    let failed = |cause| BakeError::io(path, "read", cause);
    let mut reader = BufReader::with_capacity(BUFFER_BYTES, File::open(path).map_err(failed)?);
    let mut record = [0; RECORD_BYTES];
    while !io::BufRead::fill_buf(&mut reader).map_err(failed)?.is_empty() {
        reader.read_exact(&mut record).map_err(failed)?;
        visit(from_record(&record))?;
    }
    Ok(())
}

impl TrianglePart {
    fn try_for_each(&self, visit: &mut dyn FnMut(SceneTriangle) -> Result<(), BakeError>) -> Result<(), BakeError> {
        read_file(&self.path, &mut |mut triangle| {
            let damaged = || BakeError::Scratch { path: self.path.clone() };
            triangle.object = triangle.object.checked_add(self.first_object).ok_or_else(damaged)?;
            triangle.material = *self.materials.get(triangle.material as usize).ok_or_else(damaged)?;
            visit(triangle)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SceneTexture;
    use crate::scene::texture_store::TextureStore;
    use insula_test_support::folder::TestFolder;
    use std::fs;
    use std::sync::Arc;

    fn triangle(i: u32) -> SceneTriangle {
        let corners = [[i as f32, 0.5, -1.0], [5.0, 0.0, 1.0], [0.0, -3.0, f32::MIN_POSITIVE]];
        SceneTriangle { corners, uv: [[0.25, i as f32], [1.0, 0.0], [-7.5, 2.0]], material: i, object: 3 * i }
    }

    #[test]
    fn no_more_than_the_budget_is_written() {
        let folder = TestFolder::new("triangle-budget");
        let path = folder.path.join("triangles");
        let budget = ScratchBudget::new(1000 * RECORD_BYTES as u64);
        let mut stored = TriangleStore::in_file(path.clone(), budget.clone()).unwrap();
        (0..600).for_each(|i| stored.push(triangle(i)));
        stored.finish().unwrap();
        stored.append((0..400).map(triangle)).unwrap();
        assert!(matches!(stored.append((0..100_000).map(triangle)), Err(BakeError::ScratchLimit { limit_mib: 0 })));
        assert_eq!(fs::metadata(path).unwrap().len(), 1000 * RECORD_BYTES as u64);
        let mut textures = TextureStore::in_folder(folder.path.clone(), 0, budget);
        textures.add(Arc::new(SceneTexture { width: 1, height: 1, rgb: vec![[7; 3]], is_pattern: false }));
        assert!(matches!(textures.finish(), Err(BakeError::ScratchLimit { .. })));
    }

    #[test]
    fn triangle_file_returns_its_triangles_in_order_and_reports_truncation() {
        let folder = TestFolder::new("triangle-store");
        let mut stored = TriangleStore::in_file(folder.path.join("triangles"), ScratchBudget::new(u64::MAX)).unwrap();
        let all: Vec<SceneTriangle> = (0..10_000).map(triangle).collect();
        all.iter().for_each(|triangle| stored.push(*triangle));
        stored.finish().unwrap();
        let mut back = Vec::new();
        stored
            .try_for_each(|triangle| {
                back.push(triangle);
                Ok(())
            })
            .unwrap();
        assert!(back == all);
        let path = folder.path.join("triangles");
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert!(matches!(stored.try_for_each(|_| Ok(())), Err(BakeError::Io { .. })));
    }
}
