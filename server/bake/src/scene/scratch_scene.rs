//! A city between reading and partition: what is small in memory, its triangles and pictures in scratch files.
//!
//! In: triangles and pictures as `read` finds them. Out: [`ScratchScene`], which hands them out again, triangles in their order.
//! Next: `partition`.
//!
//! A city that was read for its own sake ([`crate::read::read`]) or handed over as a [`Scene`] keeps both in memory.

use std::{
    fs::{self, File},
    io::{self, BufReader, BufWriter, Read, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use lru::LruCache;

use crate::{
    error::BakeError,
    scene::{Material, ObjectKind, Scene, SceneObject, SceneTexture, SceneTriangle},
};

/// Bytes of a triangle in a file: corners, texture coordinates, material, object; 4 bytes each, little-endian.
pub(crate) const RECORD_BYTES: usize = 17 * 4;
/// Buffer of a file of triangles.
const BUFFER_BYTES: usize = RECORD_BYTES << 12;

/// A triangle as it lies in scratch files.
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

/// Triangles in the order in which they came.
#[derive(Debug)]
pub(crate) enum TriangleStore {
    /// All of them at hand.
    Memory(Vec<SceneTriangle>),
    /// In a scratch file.
    File(TriangleFile),
}

/// A file of triangles. The first fault is kept until [`TriangleStore::finish`]: readers go on without looking.
#[derive(Debug)]
pub(crate) struct TriangleFile {
    path: PathBuf,
    writer: Option<BufWriter<File>>,
    failed: Option<io::Error>,
}

impl TriangleStore {
    /// To be written to `path`.
    pub(crate) fn in_file(path: PathBuf) -> Result<Self, BakeError> {
        let file = File::create(&path).map_err(|cause| BakeError::io(&path, "written", cause))?;
        let writer = Some(BufWriter::with_capacity(BUFFER_BYTES, file));
        Ok(Self::File(TriangleFile { path, writer, failed: None }))
    }

    pub(crate) fn push(&mut self, triangle: SceneTriangle) {
        match self {
            Self::Memory(all) => all.push(triangle),
            Self::File(file) => {
                if let Some(writer) = &mut file.writer
                    && let Err(cause) = writer.write_all(&to_record(&triangle))
                {
                    file.failed = Some(cause);
                    file.writer = None;
                }
            }
        }
    }

    /// Ends the writing; tells what went wrong since the beginning.
    pub(crate) fn finish(&mut self) -> Result<(), BakeError> {
        let Self::File(file) = self else { return Ok(()) };
        let flushed = file.writer.take().map_or(Ok(()), |mut writer| writer.flush());
        let failed = file.failed.take().map_or(flushed, Err);
        failed.map_err(|cause| BakeError::io(&file.path, "written", cause))
    }

    /// Every triangle, in order.
    fn each(&self, mut then: impl FnMut(SceneTriangle) -> Result<(), BakeError>) -> Result<(), BakeError> {
        match self {
            Self::Memory(all) => all.iter().try_for_each(|triangle| then(*triangle)),
            Self::File(file) => {
                let failed = |cause| BakeError::io(&file.path, "read", cause);
                let mut reader = BufReader::with_capacity(BUFFER_BYTES, File::open(&file.path).map_err(failed)?);
                let mut record = [0; RECORD_BYTES];
                while !io::BufRead::fill_buf(&mut reader).map_err(failed)?.is_empty() {
                    reader.read_exact(&mut record).map_err(failed)?;
                    then(from_record(&record))?;
                }
                Ok(())
            }
        }
    }
}

/// The first 16 bytes of a blake3 hash.
pub(crate) type ShortHash = [u8; 16];

pub(crate) fn short(hash: &blake3::Hash) -> ShortHash {
    std::array::from_fn(|i| hash.as_bytes()[i])
}

/// What is known of a picture without its texels.
#[derive(Debug, Clone, Copy)]
struct TextureFacts {
    width: u32,
    height: u32,
    hash: ShortHash,
}

/// The city's pictures, by number. Those in files are loaded when asked for, and kept as far as a number of bytes allows.
#[derive(Debug)]
pub(crate) struct TextureStore {
    facts: Vec<TextureFacts>,
    kept: TextureStorage,
    failed: Option<BakeError>,
}

#[derive(Debug)]
enum TextureStorage {
    Memory(Vec<Arc<SceneTexture>>),
    Folder { path: PathBuf, cache: Mutex<TextureCache> },
}

/// Loaded pictures, the one used longest ago first to go. What a block in work holds stays alive beside it.
#[derive(Debug)]
struct TextureCache {
    loaded: LruCache<u32, Arc<SceneTexture>>,
    bytes: usize,
    limit: usize,
}

impl TextureStore {
    /// In memory.
    pub(crate) fn in_memory() -> Self {
        Self { facts: Vec::new(), kept: TextureStorage::Memory(Vec::new()), failed: None }
    }

    /// In files of the folder `path`, which is there; at most `limit` bytes of them are kept loaded.
    pub(crate) fn in_folder(path: PathBuf, limit: usize) -> Self {
        let cache = Mutex::new(TextureCache { loaded: LruCache::unbounded(), bytes: 0, limit });
        Self { facts: Vec::new(), kept: TextureStorage::Folder { path, cache }, failed: None }
    }

    /// Keeps a picture and gives it its number.
    pub(crate) fn add(&mut self, texture: Arc<SceneTexture>) -> u32 {
        let number = self.facts.len() as u32;
        let mut hasher = blake3::Hasher::new();
        hasher.update(&texture.width.to_le_bytes()).update(&texture.height.to_le_bytes());
        let hash = short(&hasher.update(texture.rgb.as_flattened()).finalize());
        self.facts.push(TextureFacts { width: texture.width, height: texture.height, hash });
        match &mut self.kept {
            TextureStorage::Memory(all) => all.push(texture),
            TextureStorage::Folder { path, .. } => {
                let path = picture_path(path, number);
                if let Err(cause) = fs::write(&path, texture.rgb.as_flattened()) {
                    self.failed.get_or_insert(BakeError::io(&path, "written", cause));
                }
            }
        }
        number
    }

    /// Tells what went wrong while pictures were added.
    pub(crate) fn finish(&mut self) -> Result<(), BakeError> {
        self.failed.take().map_or(Ok(()), Err)
    }

    /// Names a picture by its content.
    pub(crate) fn hash(&self, number: u32) -> ShortHash {
        self.facts[number as usize].hash
    }

    /// The picture itself.
    pub(crate) fn get(&self, number: u32) -> Result<Arc<SceneTexture>, BakeError> {
        match &self.kept {
            TextureStorage::Memory(all) => Ok(Arc::clone(&all[number as usize])),
            TextureStorage::Folder { path, cache } => {
                // Loaded under the lock: two blocks that want the same picture load it once.
                let mut cache = cache.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(texture) = cache.loaded.get(&number) {
                    return Ok(Arc::clone(texture));
                }
                let texture = Arc::new(load(&picture_path(path, number), self.facts[number as usize])?);
                cache.add(number, &texture);
                Ok(texture)
            }
        }
    }
}

impl TextureCache {
    fn add(&mut self, number: u32, texture: &Arc<SceneTexture>) {
        self.bytes += texture.rgb.as_flattened().len();
        self.loaded.put(number, Arc::clone(texture));
        while self.bytes > self.limit
            && let Some((_, gone)) = self.loaded.pop_lru()
        {
            self.bytes -= gone.rgb.as_flattened().len();
        }
    }
}

fn picture_path(folder: &Path, number: u32) -> PathBuf {
    folder.join(format!("{number}.rgb"))
}

fn load(path: &Path, facts: TextureFacts) -> Result<SceneTexture, BakeError> {
    let bytes = fs::read(path).map_err(|cause| BakeError::io(path, "read", cause))?;
    let (texels, rest) = bytes.as_chunks::<3>();
    if !rest.is_empty() || texels.len() as u64 != u64::from(facts.width) * u64::from(facts.height) {
        return Err(BakeError::Scratch { path: path.to_owned() });
    }
    Ok(SceneTexture { width: facts.width, height: facts.height, rgb: texels.to_vec() })
}

/// How triangles are coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct StoredMaterial {
    /// 8-bit sRGB.
    pub(crate) rgb: [u8; 3],
    /// Number of a picture.
    pub(crate) picture: Option<u32>,
}

/// What is known of an object without its triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StoredObject {
    pub(crate) kind: ObjectKind,
    /// As in [`SceneObject`].
    pub(crate) base_z_m: f32,
}

/// Where an object's triangles belong, which were kept relative to a point of their own.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ObjectPlacement {
    /// From the city's origin to that point.
    pub(crate) offset_m: [f64; 3],
    /// The object's number in the city; `None` for one that is left out.
    pub(crate) object: Option<u32>,
}

/// A city that was read.
#[derive(Debug)]
pub(crate) struct ScratchScene {
    /// As in [`Scene`].
    pub(crate) origin: [f64; 3],
    /// As in [`Scene`].
    pub(crate) crs: Option<String>,
    /// Of all corners, relative to the origin; `None` without triangles.
    pub(crate) bounds: Option<[[f64; 3]; 2]>,
    pub(crate) objects: Vec<StoredObject>,
    pub(crate) paints: Vec<StoredMaterial>,
    pub(crate) pictures: TextureStore,
    /// How many.
    pub(crate) triangles: u64,
    /// Their objects' names; only where the city is in memory.
    pub(crate) names: Vec<String>,
    /// By the object number that the stored triangles have; empty if they are placed.
    pub(crate) placings: Vec<ObjectPlacement>,
    pub(crate) stored: TriangleStore,
}

impl ScratchScene {
    /// Every triangle in its order: corners relative to the origin, material an index into `paints`.
    pub(crate) fn each(&self, mut then: impl FnMut(&SceneTriangle) -> Result<(), BakeError>) -> Result<(), BakeError> {
        self.stored.each(|mut triangle| {
            if !self.placings.is_empty() {
                let ObjectPlacement { offset_m, object } = self.placings[triangle.object as usize];
                let Some(object) = object else { return Ok(()) };
                triangle.object = object;
                for corner in &mut triangle.corners {
                    *corner = std::array::from_fn(|axis| (f64::from(corner[axis]) + offset_m[axis]) as f32);
                }
            }
            then(&triangle)
        })
    }

    /// Once they are in buckets nobody asks for them here: their memory or file, and where each object stands.
    pub(crate) fn forget_triangles(&mut self) {
        self.placings = Vec::new();
        self.names = Vec::new();
        if let TriangleStore::File(TriangleFile { path, .. }) =
            std::mem::replace(&mut self.stored, TriangleStore::Memory(Vec::new()))
        {
            // Left behind it takes room, no more; the scratch folder goes at the end.
            let _ = fs::remove_file(path);
        }
    }

    /// All of it in memory.
    pub(crate) fn into_scene(self) -> Result<Scene, BakeError> {
        let mut triangles = Vec::with_capacity(self.triangles as usize);
        self.each(|triangle| {
            triangles.push(*triangle);
            Ok(())
        })?;
        let objects = self.objects.iter().zip(&self.names);
        let objects =
            objects.map(|(facts, id)| SceneObject { id: id.clone(), kind: facts.kind, base_z_m: facts.base_z_m });
        let material = |paint: &StoredMaterial| {
            let texture = paint.picture.map(|number| self.pictures.get(number)).transpose()?;
            Ok(Material { rgb: paint.rgb, texture })
        };
        let materials = self.paints.iter().map(material).collect::<Result<_, BakeError>>()?;
        Ok(Scene { origin: self.origin, triangles, objects: objects.collect(), materials, crs: self.crs })
    }

    /// A scene that came from elsewhere: checked for what readers promise.
    pub(crate) fn from_scene(scene: Scene) -> Result<Self, BakeError> {
        let bounds = bounds(&scene)?;
        let mut pictures = TextureStore::in_memory();
        let mut known: Vec<Arc<SceneTexture>> = Vec::new();
        let mut number = |texture: Arc<SceneTexture>| {
            let place = known.iter().position(|other| Arc::ptr_eq(other, &texture));
            place.map_or_else(
                || {
                    known.push(Arc::clone(&texture));
                    pictures.add(texture)
                },
                |place| place as u32,
            )
        };
        let paints = scene.materials.into_iter();
        let paints = paints.map(|m| StoredMaterial { rgb: m.rgb, picture: m.texture.map(&mut number) }).collect();
        let objects = scene.objects.iter().map(|o| StoredObject { kind: o.kind, base_z_m: o.base_z_m });
        Ok(Self {
            origin: scene.origin,
            crs: scene.crs,
            bounds,
            objects: objects.collect(),
            paints,
            pictures,
            triangles: scene.triangles.len() as u64,
            names: Vec::new(),
            placings: Vec::new(),
            stored: TriangleStore::Memory(scene.triangles),
        })
    }
}

fn bounds(scene: &Scene) -> Result<Option<[[f64; 3]; 2]>, BakeError> {
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for (triangle, t) in scene.triangles.iter().enumerate() {
        let wrong = |what| Err(BakeError::Scene { triangle, what });
        if t.material as usize >= scene.materials.len() || t.object as usize >= scene.objects.len() {
            return wrong("its material or object does not exist");
        }
        if !t.corners.iter().flatten().chain(t.uv.iter().flatten()).all(|v| v.is_finite()) {
            return wrong("a coordinate is not finite");
        }
        for corner in t.corners {
            for axis in 0..3 {
                min[axis] = min[axis].min(f64::from(corner[axis]));
                max[axis] = max[axis].max(f64::from(corner[axis]));
            }
        }
    }
    Ok((!scene.triangles.is_empty()).then_some([min, max]))
}

#[cfg(test)]
mod tests {
    use crate::scene::scratch_scene::*;
    use crate::write::scratch::tests::Folder;

    fn triangle(i: u32) -> SceneTriangle {
        let corners = [[i as f32, 0.5, -1.0], [5.0, 0.0, 1.0], [0.0, -3.0, f32::MIN_POSITIVE]];
        SceneTriangle { corners, uv: [[0.25, i as f32], [1.0, 0.0], [-7.5, 2.0]], material: i, object: 3 * i }
    }

    #[test]
    fn triangles_come_back_from_a_file_in_order() {
        let folder = Folder::new("spool");
        let mut stored = TriangleStore::in_file(folder.path.join("triangles")).unwrap();
        let all: Vec<SceneTriangle> = (0..10_000).map(triangle).collect();
        all.iter().for_each(|triangle| stored.push(*triangle));
        stored.finish().unwrap();
        let mut back = Vec::new();
        stored
            .each(|triangle| {
                back.push(triangle);
                Ok(())
            })
            .unwrap();
        assert!(back == all);
        let path = folder.path.join("triangles");
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert!(matches!(stored.each(|_| Ok(())), Err(BakeError::Io { .. })));
    }

    #[test]
    fn pictures_are_loaded_when_asked_for_and_kept_as_far_as_allowed() {
        let folder = Folder::new("pictures");
        let mut pictures = TextureStore::in_folder(folder.path.clone(), 100);
        for i in 0..4u8 {
            pictures.add(Arc::new(SceneTexture { width: 5, height: 2, rgb: vec![[i; 3]; 10] }));
        }
        pictures.finish().unwrap();
        for i in [0u8, 1, 2, 0, 3, 1] {
            assert_eq!(pictures.get(i.into()).unwrap().rgb, [[i; 3]; 10]);
            let TextureStorage::Folder { cache, .. } = &pictures.kept else { panic!("not in a folder") };
            assert!(cache.lock().unwrap().bytes <= 100);
        }
        assert_ne!(pictures.hash(0), pictures.hash(1));
        fs::write(folder.path.join("2.rgb"), [0; 29]).unwrap();
        assert!(matches!(pictures.get(2), Err(BakeError::Scratch { .. })));
    }

    #[test]
    fn a_sound_scene_has_bounds_and_an_unsound_one_an_error() {
        let scene = || Scene {
            triangles: vec![SceneTriangle { material: 0, object: 0, ..triangle(2) }],
            objects: vec![SceneObject { id: "a".into(), kind: ObjectKind::Building, base_z_m: -1.0 }],
            materials: vec![Material { rgb: [9, 8, 7], texture: None }],
            ..Scene::default()
        };
        let bounds = ScratchScene::from_scene(scene()).unwrap().bounds.unwrap();
        assert_eq!(bounds, [[0.0, -3.0, -1.0], [5.0, 0.5, 1.0]]);
        assert_eq!(ScratchScene::from_scene(Scene::default()).unwrap().bounds, None);
        let wrong: [fn(&mut SceneTriangle); 4] =
            [|t| t.material = 1, |t| t.object = 1, |t| t.corners[1][2] = f32::NAN, |t| t.uv[2][0] = f32::INFINITY];
        for spoil in wrong {
            let mut scene = scene();
            spoil(&mut scene.triangles[0]);
            assert!(matches!(ScratchScene::from_scene(scene), Err(BakeError::Scene { triangle: 0, .. })));
        }
    }
}
