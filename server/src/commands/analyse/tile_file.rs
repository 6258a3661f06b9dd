//! Files of finished tiles: a mark, a head as JSON with its length, the values of the cells row by row from the south, and a hash of all that.

use insula_analysis::gathered::TileValues;
use insula_archive::file::{open_regular, read_limited};
use insula_export::raster::CellExtent;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// What the files begin with.
pub(super) const TILE_MARK: &[u8] = b"insula-analysis-tile-1\n";
/// Largest head. A building has about 200 bytes.
const MAX_HEAD_BYTES: u64 = 256 << 20;
const HASH_BYTES: usize = blake3::OUT_LEN;
const VALUE_BYTES: u64 = 4;
/// Most files that are open at once.
const MAX_OPEN: usize = 64;

/// The values of a tile, and what they say.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct FinishedTile {
    pub(super) title: String,
    pub(super) column: String,
    pub(super) asked: Option<f64>,
    pub(super) total: Option<String>,
    pub(super) notes: Vec<String>,
    pub(super) values: TileValues,
    /// Row by row from the south; NaN is no value.
    #[serde(skip)]
    pub(super) cells: Vec<f32>,
}

impl FinishedTile {
    /// A tile of so many cells where nothing was baked, which says nothing.
    pub(super) fn without_values(cells: usize) -> Self {
        Self { cells: vec![f32::NAN; cells], ..Self::default() }
    }

    pub(super) fn has_no_values(&self) -> bool {
        self.title.is_empty()
    }

    /// The bytes of a file.
    pub(super) fn encode(&self) -> Vec<u8> {
        // Texts and finite numbers are always JSON.
        let head = serde_json::to_vec(self).unwrap_or_default();
        let mut bytes = TILE_MARK.to_vec();
        bytes.extend((head.len() as u64).to_le_bytes());
        bytes.extend(head);
        bytes.extend(self.cells.iter().flat_map(|value| value.to_le_bytes()));
        let hash = blake3::hash(&bytes);
        bytes.extend(hash.as_bytes());
        bytes
    }

    /// The tile of a file, without the values of its cells; `None` if there is no such file, or if it is damaged.
    pub(super) fn read(path: &Path, extent: CellExtent) -> Option<Self> {
        let bytes = read_limited(path, extent.len() * VALUE_BYTES + MAX_HEAD_BYTES).ok()?;
        let (content, hash) = bytes.split_at_checked(bytes.len().checked_sub(HASH_BYTES)?)?;
        if blake3::hash(content).as_bytes() != hash {
            return None;
        }
        let (length, rest) = content.strip_prefix(TILE_MARK)?.split_first_chunk::<8>()?;
        let (head, cells) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        let is_whole = cells.len() as u64 == extent.len() * VALUE_BYTES;
        if is_whole { serde_json::from_slice(head).ok() } else { None }
    }

    /// Words for the names of columns, and for what a roof has in all; `None` of an unknown analysis.
    pub(super) fn columns(&self) -> Option<(&'static str, Option<&'static str>)> {
        let column = ["hours", "percent", "sky", "kwh_m2", "share"].into_iter().find(|known| *known == self.column)?;
        Some((column, self.total.as_ref().map(|_| "kwh")))
    }
}

/// Reads the values of parts of a result from its tiles.
pub(super) struct TileRows<'a> {
    tiles: &'a [(CellExtent, &'a Path)],
    /// By their numbers.
    open: HashMap<usize, File>,
}

impl<'a> TileRows<'a> {
    pub(super) fn new(tiles: &'a [(CellExtent, &'a Path)]) -> Self {
        Self { tiles, open: HashMap::new() }
    }

    /// The values of a part, row by row from the south. Fails with the file that cannot be read.
    pub(super) fn part(&mut self, part: CellExtent) -> Result<Vec<f32>, (PathBuf, io::Error)> {
        let mut values = vec![f32::NAN; part.len() as usize];
        for number in 0..self.tiles.len() {
            let (tile, path) = self.tiles[number];
            let Some(common) = common(part, tile) else { continue };
            let failed = |error: io::Error| (path.to_owned(), error);
            let file = self.file(number).map_err(failed)?;
            for y in common.min[1]..common.min[1] + common.size[1] {
                let first = tile.index([common.min[0], y]) as u64;
                let row = row(file, tile.len() - first, common.size[0]).map_err(failed)?;
                let at = part.index([common.min[0], y]);
                values[at..at + row.len()].copy_from_slice(&row);
            }
        }
        Ok(values)
    }

    fn file(&mut self, number: usize) -> io::Result<&mut File> {
        if self.open.len() >= MAX_OPEN && !self.open.contains_key(&number) {
            self.open.clear();
        }
        let file = match self.open.remove(&number) {
            Some(file) => file,
            None => open_regular(self.tiles[number].1)?,
        };
        Ok(self.open.entry(number).or_insert(file))
    }
}

/// The values of cells, the first of which is so many before the end of all.
fn row(file: &mut File, before_end: u64, cells: u32) -> io::Result<Vec<f32>> {
    let from_end = (before_end * VALUE_BYTES) as i64 + HASH_BYTES as i64;
    file.seek(SeekFrom::End(-from_end))?;
    let mut bytes = vec![0; cells as usize * VALUE_BYTES as usize];
    file.read_exact(&mut bytes)?;
    let value = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap_or_default());
    Ok(bytes.chunks_exact(VALUE_BYTES as usize).map(value).collect())
}

/// The cells that two extents have in common.
fn common(a: CellExtent, b: CellExtent) -> Option<CellExtent> {
    let min = [0, 1].map(|k| a.min[k].max(b.min[k]));
    let end = [0, 1].map(|k| (a.min[k] + a.size[k]).min(b.min[k] + b.size[k]));
    (0..2).all(|k| min[k] < end[k]).then(|| CellExtent { min, size: [0, 1].map(|k| end[k] - min[k]) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(cells: Vec<f32>) -> FinishedTile {
        FinishedTile {
            title: "t".to_owned(),
            column: "sky".to_owned(),
            asked: Some(1.5),
            total: None,
            notes: vec!["a note".to_owned()],
            values: TileValues::default(),
            cells,
        }
    }

    #[test]
    fn files_are_read_as_they_were_written_and_not_if_they_are_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tile");
        let extent = CellExtent { min: [3, 4], size: [2, 1] };
        let bytes = tile(vec![0.5, f32::NAN]).encode();
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(FinishedTile::read(&path, extent), Some(tile(Vec::new())));
        assert_eq!(tile(Vec::new()).columns(), Some(("sky", None)));
        assert_eq!(FinishedTile::read(&path, CellExtent { min: [3, 4], size: [3, 1] }), None);
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert_eq!(FinishedTile::read(&path, extent), None, "{length}");
        }
        std::fs::write(&path, FinishedTile::without_values(2).encode()).unwrap();
        assert!(FinishedTile::read(&path, extent).is_some_and(|tile| tile.has_no_values()));
        let mut other = bytes;
        other[TILE_MARK.len() + 20] ^= 1;
        std::fs::write(&path, &other).unwrap();
        assert_eq!(FinishedTile::read(&path, extent), None);
        assert_eq!(FinishedTile::read(&folder.path().join("none"), extent), None);
    }

    #[test]
    fn parts_are_put_together_from_tiles() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["west", "east"].map(|name| folder.path().join(name));
        let extents = [CellExtent { min: [10, 5], size: [2, 2] }, CellExtent { min: [12, 5], size: [1, 2] }];
        std::fs::write(&paths[0], tile(vec![1.0, 2.0, 4.0, 5.0]).encode()).unwrap();
        std::fs::write(&paths[1], tile(vec![3.0, 6.0]).encode()).unwrap();
        let tiles = [(extents[0], paths[0].as_path()), (extents[1], paths[1].as_path())];
        let mut rows = TileRows::new(&tiles);
        let all = CellExtent { min: [10, 5], size: [3, 2] };
        assert_eq!(rows.part(all).unwrap(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(rows.part(CellExtent { min: [11, 6], size: [2, 1] }).unwrap(), [5.0, 6.0]);
        std::fs::write(&paths[1], b"short").unwrap();
        let mut rows = TileRows::new(&tiles);
        assert_eq!(rows.part(all).unwrap_err().0, paths[1]);
    }
}
