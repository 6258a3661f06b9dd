//! The city's textures by number, in memory or in scratch files with a cache of limited size.

use crate::error::BakeError;
use crate::hash::{ShortHash, short_hash};
use crate::scene::SceneTexture;
use crate::scene::scratch_budget::ScratchBudget;
use lru::LruCache;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// New value of each 8-bit value.
type ToneCurve = [u8; 256];

/// Size and hash of a texture, kept while its texels are on disk.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(crate) struct TextureFacts {
    width: u32,
    height: u32,
    hash: ShortHash,
    is_pattern: bool,
    /// Applied when the texels are loaded: 256 values.
    tone: Option<Vec<u8>>,
}

impl TextureFacts {
    /// Hash of the size and the texels, after the tone.
    pub(crate) fn hash(&self) -> ShortHash {
        self.hash
    }

    fn tone_curve(&self) -> Option<ToneCurve> {
        self.tone.as_deref().and_then(|tone| tone.try_into().ok())
    }
}

/// Textures by number. Those in files are loaded on demand and cached.
#[derive(Debug)]
pub(crate) struct TextureStore {
    facts: Vec<TextureFacts>,
    /// Numbers by the hashes of the textures as they were added.
    by_hash: HashMap<(ShortHash, bool), u32>,
    /// Bytes of those in memory, without those of a cache.
    held_bytes: u64,
    storage: TextureStorage,
    failed: Option<BakeError>,
}

#[derive(Debug)]
enum TextureStorage {
    Memory(Vec<Arc<SceneTexture>>),
    Folder { path: PathBuf, cache: Mutex<TextureCache>, budget: ScratchBudget },
}

/// Loaded textures. Evicts the least recently used; a texture that a block still uses stays alive outside the cache.
#[derive(Debug)]
struct TextureCache {
    loaded: LruCache<u32, Arc<SceneTexture>>,
    bytes: usize,
    limit_bytes: usize,
}

impl TextureStore {
    pub(crate) fn in_memory() -> Self {
        Self::of(TextureStorage::Memory(Vec::new()))
    }

    /// Keeps textures in files of the existing folder `path`, and at most `limit_bytes` of them in memory.
    pub(crate) fn in_folder(path: PathBuf, limit_bytes: usize, budget: ScratchBudget) -> Self {
        let cache = Mutex::new(TextureCache { loaded: LruCache::unbounded(), bytes: 0, limit_bytes });
        Self::of(TextureStorage::Folder { path, cache, budget })
    }

    fn of(storage: TextureStorage) -> Self {
        Self { facts: Vec::new(), by_hash: HashMap::new(), held_bytes: 0, storage, failed: None }
    }

    /// Bytes that the texels of all textures take in memory, without those of a cache.
    pub(crate) fn held_bytes(&self) -> u64 {
        self.held_bytes
    }

    /// Stores a texture and returns its number, that of an equal one if there is one. A write error is kept until [`Self::finish`].
    pub(crate) fn add(&mut self, texture: Arc<SceneTexture>) -> u32 {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&texture.width.to_le_bytes()).update(&texture.height.to_le_bytes());
        let hash = short_hash(&hasher.update(texture.rgb.as_flattened()).finalize());
        let SceneTexture { width, height, is_pattern, .. } = *texture;
        if let Some(known) = self.by_hash.get(&(hash, is_pattern)) {
            return *known;
        }
        let number = self.facts.len() as u32;
        self.by_hash.insert((hash, is_pattern), number);
        self.facts.push(TextureFacts { width, height, hash, is_pattern, tone: None });
        match &mut self.storage {
            TextureStorage::Memory(all) => {
                self.held_bytes += texture.rgb.as_flattened().len() as u64;
                all.push(texture);
            }
            TextureStorage::Folder { path, budget, .. } => {
                let (path, texels) = (texture_path(path, number), texture.rgb.as_flattened());
                let write = || fs::write(&path, texels).map_err(|cause| BakeError::io(&path, "written", cause));
                if let Err(error) = budget.spend(texels.len()).and_then(|()| write()) {
                    self.failed.get_or_insert(error);
                }
            }
        }
        number
    }

    /// Adds a texture whose texels will be in the folder by its number, which is returned: that of an equal one if there is one.
    pub(crate) fn add_known(&mut self, facts: TextureFacts) -> u32 {
        let next = self.facts.len() as u32;
        let number = *self.by_hash.entry((facts.hash, facts.is_pattern)).or_insert(next);
        if number == next {
            self.facts.push(facts);
        }
        number
    }

    /// Fails if a texture could not be written, or the scratch files are larger than they may be.
    pub(crate) fn finish(&mut self) -> Result<(), BakeError> {
        self.failed.take().map_or(Ok(()), Err)
    }

    /// Changes the texels of a texture by a curve, once.
    pub(crate) fn set_tone(&mut self, number: u32, tone: &ToneCurve) {
        let facts = &mut self.facts[number as usize];
        facts.hash = short_hash(&blake3::Hasher::new().update(&facts.hash).update(tone).finalize());
        match &mut self.storage {
            TextureStorage::Memory(all) => apply_tone(&mut Arc::make_mut(&mut all[number as usize]).rgb, tone),
            TextureStorage::Folder { cache, .. } => {
                facts.tone = Some(tone.to_vec());
                cache.get_mut().unwrap_or_else(PoisonError::into_inner).remove(number);
            }
        }
    }

    /// What is known of all textures, by number.
    pub(crate) fn facts(&self) -> &[TextureFacts] {
        &self.facts
    }

    /// Textures whose texels are in files of the existing folder `path` already, see [`texture_path`].
    pub(crate) fn of_files(facts: Vec<TextureFacts>, path: PathBuf, limit_bytes: usize) -> Self {
        Self { facts, ..Self::in_folder(path, limit_bytes, ScratchBudget::new(0)) }
    }

    /// Hash of the texture's size and texels.
    pub(crate) fn hash(&self, number: u32) -> ShortHash {
        self.facts[number as usize].hash
    }

    /// The texture. Fails if its file cannot be read or has changed.
    pub(crate) fn get(&self, number: u32) -> Result<Arc<SceneTexture>, BakeError> {
        match &self.storage {
            TextureStorage::Memory(all) => Ok(Arc::clone(&all[number as usize])),
            TextureStorage::Folder { path, cache, .. } => {
                // Loading under the lock: two blocks that need the same texture load it once.
                let mut cache = cache.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(texture) = cache.loaded.get(&number) {
                    return Ok(Arc::clone(texture));
                }
                let texture = Arc::new(load(&texture_path(path, number), &self.facts[number as usize])?);
                cache.insert(number, &texture);
                Ok(texture)
            }
        }
    }
}

impl TextureCache {
    fn remove(&mut self, number: u32) {
        if let Some(removed) = self.loaded.pop(&number) {
            self.bytes -= removed.rgb.as_flattened().len();
        }
    }

    fn insert(&mut self, number: u32, texture: &Arc<SceneTexture>) {
        self.bytes += texture.rgb.as_flattened().len();
        self.loaded.put(number, Arc::clone(texture));
        while self.bytes > self.limit_bytes
            && let Some((_, evicted)) = self.loaded.pop_lru()
        {
            self.bytes -= evicted.rgb.as_flattened().len();
        }
    }
}

fn apply_tone(rgb: &mut [[u8; 3]], tone: &ToneCurve) {
    rgb.as_flattened_mut().iter_mut().for_each(|v| *v = tone[usize::from(*v)]);
}

pub(crate) fn texture_path(folder: &Path, number: u32) -> PathBuf {
    folder.join(format!("{number}.rgb"))
}

fn load(path: &Path, facts: &TextureFacts) -> Result<SceneTexture, BakeError> {
    let bytes = fs::read(path).map_err(|cause| BakeError::io(path, "read", cause))?;
    let (texels, rest) = bytes.as_chunks::<3>();
    if !rest.is_empty() || texels.len() as u64 != u64::from(facts.width) * u64::from(facts.height) {
        return Err(BakeError::Scratch { path: path.to_owned() });
    }
    let mut rgb = texels.to_vec();
    facts.tone_curve().iter().for_each(|tone| apply_tone(&mut rgb, tone));
    Ok(SceneTexture { width: facts.width, height: facts.height, rgb, is_pattern: facts.is_pattern })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

    #[test]
    fn textures_are_loaded_on_demand_within_the_cache_limit() {
        let folder = TestFolder::new("textures");
        let mut textures = TextureStore::in_folder(folder.path.clone(), 100, ScratchBudget::new(120));
        for i in 0..4u8 {
            textures.add(Arc::new(SceneTexture { width: 5, height: 2, rgb: vec![[i; 3]; 10], is_pattern: false }));
        }
        textures.finish().unwrap();
        for i in [0u8, 1, 2, 0, 3, 1] {
            assert_eq!(textures.get(i.into()).unwrap().rgb, [[i; 3]; 10]);
            let TextureStorage::Folder { cache, .. } = &textures.storage else { panic!("not in a folder") };
            assert!(cache.lock().unwrap().bytes <= 100);
        }
        assert_ne!(textures.hash(0), textures.hash(1));
        let hash = textures.hash(1);
        textures.set_tone(1, &std::array::from_fn(|v| 255 - v as u8));
        assert_eq!((textures.get(1).unwrap().rgb[0], textures.get(0).unwrap().rgb[0]), ([254; 3], [0; 3]));
        assert_ne!(textures.hash(1), hash);
        fs::write(folder.path.join("2.rgb"), [0; 29]).unwrap();
        assert!(matches!(textures.get(2), Err(BakeError::Scratch { .. })));
    }
}
