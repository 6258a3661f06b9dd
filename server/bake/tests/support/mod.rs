//! A small city of boxes, folders for tests, and a reader of archives.

#![allow(dead_code, clippy::unwrap_used, reason = "each test file uses a part; a test fails by panicking")]

use std::{
    collections::BTreeMap,
    fs,
    future::Future,
    path::{Path, PathBuf},
    pin::pin,
    task::{Context, Poll, Waker},
};

use insula_bake::{
    BakeError, BakeOptions, BakeReport, Progress, bake_scene,
    read::ReadReport,
    scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle},
};
use insula_protocol::{Manifest, Subtree, TileId, subtree::NodeInfo};
use pmtiles::{AsyncBackend, AsyncPmTilesReader, BackendResponse, PmtResult, TileCoord};

/// South-west corner, sizes and height of the boxes: four blocks of 512 m, and one so far off that there are seven levels.
const BOXES: [[f32; 5]; 9] = [
    [20.0, 30.0, 25.0, 12.0, 9.0],
    [55.0, 40.0, 20.0, 20.0, 31.5],
    [140.0, 90.0, 10.0, 30.0, 6.0],
    [505.0, 60.0, 18.0, 14.0, 12.0],
    [620.0, 33.0, 11.0, 11.0, 80.0],
    [70.0, 530.0, 40.0, 9.0, 5.0],
    [300.0, 700.0, 16.0, 16.0, 22.0],
    [900.0, 880.0, 30.0, 30.0, 15.0],
    [2300.0, 100.0, 12.0, 12.0, 10.0],
];

/// A city of boxes on nothing.
pub(crate) fn city() -> Scene {
    let mut scene = Scene { origin: [84_000.0, 447_000.0, -2.0], crs: Some("EPSG:7415".into()), ..Scene::default() };
    scene.materials =
        vec![Material { rgb: [200, 90, 60], texture: None }, Material { rgb: [120, 130, 140], texture: None }];
    for (i, [x, y, width, depth, height]) in BOXES.into_iter().enumerate() {
        let base_z_m = 1.0 + i as f32 * 0.25;
        add_box(&mut scene, [x, y, base_z_m], [x + width, y + depth, base_z_m + height]);
        scene.objects.push(SceneObject { id: format!("box-{i}"), kind: ObjectKind::Building, base_z_m });
    }
    scene
}

fn add_box(scene: &mut Scene, low: [f32; 3], high: [f32; 3]) {
    let corner = |i: usize| std::array::from_fn(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
    // Corner indices (bit 0 east, 1 north, 2 up), counter-clockwise seen from outside.
    const FACES: [[usize; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [3, 2, 6, 7], [2, 0, 4, 6], [1, 3, 7, 5]];
    let object = scene.objects.len() as u32;
    for (face, [a, b, c, d]) in FACES.into_iter().enumerate() {
        for corners in [[a, b, c], [a, c, d]] {
            let material = u32::from(face != 1);
            scene.triangles.push(SceneTriangle { corners: corners.map(corner), uv: [[0.0; 2]; 3], material, object });
        }
    }
}

/// A folder for one test, removed at its end.
pub(crate) struct Folder {
    pub(crate) path: PathBuf,
}

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("insula-bake-it-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self { path }
    }

    /// The output of a bake in its own parent folder: the city's name is the same in all.
    pub(crate) fn out(&self, run: &str) -> PathBuf {
        self.path.join(run).join("boxes")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path);
    }
}

pub(crate) fn options(out: &Path, threads: usize) -> BakeOptions {
    BakeOptions { out: out.to_owned(), threads: Some(threads), ..BakeOptions::default() }
}

pub(crate) fn bake(options: &BakeOptions, progress: &dyn Progress) -> Result<BakeReport, BakeError> {
    bake_scene(city(), ReadReport::default(), options, progress)
}

/// Name and content of every file.
pub(crate) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entry = |entry: std::io::Result<fs::DirEntry>| {
        let entry = entry.unwrap();
        (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap())
    };
    fs::read_dir(folder).unwrap().map(entry).collect()
}

pub(crate) fn partial(out: &Path) -> PathBuf {
    out.with_file_name("boxes.partial")
}

pub(crate) fn manifest(city: &Path) -> Manifest {
    serde_json::from_slice(&fs::read(city.join("city.json")).unwrap()).unwrap()
}

/// An archive in memory.
pub(crate) struct Archive(AsyncPmTilesReader<Bytes>);

struct Bytes(Vec<u8>);

impl AsyncBackend for Bytes {
    async fn read(&self, offset: u64, length: usize) -> PmtResult<BackendResponse> {
        let tail = self.0.get(offset as usize..).unwrap_or(&[]);
        Ok(BackendResponse::new(tail[..length.min(tail.len())].to_vec().into()))
    }
}

/// Nothing waits here: all bytes are in memory.
fn at_once<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("memory does not wait"),
    }
}

impl Archive {
    pub(crate) fn open(path: &Path) -> Self {
        Self(at_once(AsyncPmTilesReader::try_from_source(Bytes(fs::read(path).unwrap()))).unwrap())
    }

    pub(crate) fn get(&self, id: TileId) -> Option<Vec<u8>> {
        let coord = TileCoord::new(id.level(), id.x(), id.y()).unwrap();
        at_once(self.0.get_tile(coord)).unwrap().map(|bytes| bytes.to_vec())
    }

    pub(crate) fn tiles(&self) -> u64 {
        self.0.get_header().n_addressed_tiles().unwrap().get()
    }

    pub(crate) fn clustered(&self) -> bool {
        self.0.get_header().clustered()
    }
}

/// All nodes that the subtree tiles name, found as a client finds them: from the root's tile on.
pub(crate) fn nodes(city: &Path) -> BTreeMap<TileId, NodeInfo> {
    let archive = Archive::open(&city.join("subtrees.pmtiles"));
    let (mut nodes, mut roots, mut read) = (BTreeMap::new(), vec![TileId::ROOT], 0);
    while let Some(root) = roots.pop() {
        let subtree = Subtree::decode(&archive.get(root).unwrap()).unwrap();
        read += 1;
        for node in subtree.nodes {
            if node.id != root && node.child_mask != 0 && Subtree::is_root(node.id) {
                roots.push(node.id);
            }
            let before = nodes.insert(node.id, node);
            assert!(before.is_none_or(|before| node.id == root && before == node));
        }
    }
    assert_eq!(archive.tiles(), read, "subtree tiles that nothing leads to");
    nodes
}
