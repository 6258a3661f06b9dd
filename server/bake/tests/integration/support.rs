//! A small city of boxes, baked cities in memory, and a reader of archives.

use insula_bake::read::ReadReport;
use insula_bake::sample::SampleSettings;
use insula_bake::scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle};
use insula_bake::{BakeError, BakeOptions, BakeReport, Progress, Silent, bake_scene};
use insula_protocol::subtree::NodeInfo;
use insula_protocol::{BlockMap, Manifest, Subtree, TileId};
use insula_test_support::folder::TestFolder;
use pmtiles::{AsyncBackend, AsyncPmTilesReader, BackendResponse, PmtResult, TileCoord};
use std::collections::BTreeMap;
use std::fs;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::sync::OnceLock;
use std::task::{Context, Poll, Waker};

/// Cells so coarse that the whole city is two blocks, for tests that do not need more.
pub(crate) const COARSE_CELL_M: f64 = 8.0;

/// So few directions that sampling takes little time, for tests that compare bytes.
pub(crate) const FEW_VIEWS: u32 = 32;

/// South-west corner, width, depth and height of the boxes. Most are within four areas of 512 m; one is so far away
/// that the quadtree has seven levels.
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

/// A city of boxes without terrain.
pub(crate) fn city() -> Scene {
    let mut scene = Scene { origin: [84_000.0, 447_000.0, -2.0], crs: Some("EPSG:7415".into()), ..Scene::default() };
    scene.materials = vec![
        Material { rgb: [200, 90, 60], texture: None, is_reflective: false },
        Material { rgb: [120, 130, 140], texture: None, is_reflective: false },
    ];
    for (i, [x, y, width, depth, height]) in BOXES.into_iter().enumerate() {
        let base_z_m = 1.0 + i as f32 * 0.25;
        scene.objects.push(SceneObject { id: format!("box-{i}"), kind: ObjectKind::Building, base_z_m });
        add_box(&mut scene, [x, y, base_z_m], [x + width, y + depth, base_z_m + height], [0, 1]);
    }
    scene
}

/// Corner indices of the faces of a box (bit 0 east, 1 north, 2 up), counter-clockwise seen from outside; the second is the top.
pub(crate) const FACES: [[usize; 4]; 6] =
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [3, 2, 6, 7], [2, 0, 4, 6], [1, 3, 7, 5]];

/// Adds a box to the last object. `materials` are those of its top and of its other faces.
pub(crate) fn add_box(scene: &mut Scene, low: [f32; 3], high: [f32; 3], [top, other]: [u32; 2]) {
    let corner = |i: usize| std::array::from_fn(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
    let object = scene.objects.len() as u32 - 1;
    for (face, [a, b, c, d]) in FACES.into_iter().enumerate() {
        for corners in [[a, b, c], [a, c, d]] {
            let material = if face == 1 { top } else { other };
            scene.triangles.push(SceneTriangle { corners: corners.map(corner), uv: [[0.0; 2]; 3], material, object });
        }
    }
}

/// The vertices and faces of a box as OBJ, where `vertices` come before it.
pub(crate) fn obj_box(vertices: usize, low: [f64; 3], high: [f64; 3]) -> String {
    let vertex = |i: usize| {
        let [x, y, z] = [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
        format!("v {x} {y} {z}\n")
    };
    let face = |face: [usize; 4]| {
        let [a, b, c, d] = face.map(|corner| vertices + corner + 1);
        format!("f {a} {b} {c} {d}\n")
    };
    (0..8).map(vertex).chain(FACES.map(face)).collect()
}

/// The output of a bake, in a folder of its own so that all cities have the same name.
pub(crate) fn out_folder(folder: &TestFolder, run: &str) -> PathBuf {
    folder.path.join(run).join("boxes")
}

/// Options with few views.
pub(crate) fn options(out: &Path, threads: usize) -> BakeOptions {
    let sample = SampleSettings::with_views(FEW_VIEWS);
    BakeOptions { out: out.to_owned(), threads: Some(threads), sample, ..BakeOptions::default() }
}

pub(crate) fn coarse_options(out: &Path) -> BakeOptions {
    BakeOptions { cell_m: COARSE_CELL_M, ..options(out, 2) }
}

/// Bakes the city of boxes.
pub(crate) fn bake(options: &BakeOptions, progress: &dyn Progress) -> Result<BakeReport, BakeError> {
    bake_scene(city(), ReadReport::default(), options, progress)
}

/// Name and content of every file in a folder.
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

/// A baked city in memory.
pub(crate) struct BakedCity {
    pub(crate) files: BTreeMap<String, Vec<u8>>,
    pub(crate) report: BakeReport,
}

impl BakedCity {
    /// Bakes a scene; `options.out` is replaced by a temporary folder.
    pub(crate) fn bake(name: &str, scene: Scene, options: BakeOptions) -> Self {
        let folder = TestFolder::new(name);
        let out = out_folder(&folder, "city");
        let options = BakeOptions { out: out.clone(), ..options };
        let report = bake_scene(scene, ReadReport::default(), &options, &Silent).unwrap();
        assert!(!partial(&out).exists());
        Self { files: files(&out), report }
    }

    /// Bakes the files in `folder`; `options.inputs` are names in it, and `options.out` is replaced by a folder in it.
    pub(crate) fn bake_files(folder: &Path, options: BakeOptions) -> Self {
        let out = folder.join("out").join("city");
        let inputs = options.inputs.iter().map(|name| folder.join(name)).collect();
        let report = insula_bake::bake(&BakeOptions { inputs, out: out.clone(), ..options }, &Silent).unwrap();
        Self { files: files(&out), report }
    }

    /// The city of boxes with the usual options, baked once per test program with three threads.
    pub(crate) fn boxes() -> &'static Self {
        static BOXES: OnceLock<BakedCity> = OnceLock::new();
        BOXES.get_or_init(|| Self::bake("shared-boxes", city(), options(Path::new(""), 3)))
    }

    pub(crate) fn write(&self, folder: &Path) {
        fs::create_dir_all(folder).unwrap();
        for (name, bytes) in &self.files {
            fs::write(folder.join(name), bytes).unwrap();
        }
    }

    pub(crate) fn manifest(&self) -> Manifest {
        serde_json::from_slice(&self.files["city.json"]).unwrap()
    }

    pub(crate) fn archive(&self, name: &str) -> MemoryArchive {
        MemoryArchive::new(self.files[name].clone())
    }

    /// The V-BlockMaps of all nodes, as they are stored.
    pub(crate) fn maps(&self) -> BTreeMap<TileId, BlockMap> {
        let archive = self.archive("blockmaps.pmtiles");
        let decode = |id: &TileId| BlockMap::decode(*id, &archive.get(*id).unwrap()).unwrap();
        self.nodes().keys().map(|id| (*id, decode(id))).collect()
    }

    /// All nodes that the subtree tiles name, found as a client finds them, beginning at the root's tile.
    pub(crate) fn nodes(&self) -> BTreeMap<TileId, NodeInfo> {
        let archive = self.archive("subtrees.pmtiles");
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
        assert_eq!(archive.tiles(), read, "subtree tiles without a parent");
        nodes
    }
}

/// A PMTiles archive in memory.
pub(crate) struct MemoryArchive(AsyncPmTilesReader<MemoryBackend>);

struct MemoryBackend(Vec<u8>);

impl AsyncBackend for MemoryBackend {
    async fn read(&self, offset: u64, length: usize) -> PmtResult<BackendResponse> {
        let tail = self.0.get(offset as usize..).unwrap_or(&[]);
        Ok(BackendResponse::new(tail[..length.min(tail.len())].to_vec().into()))
    }
}

/// Polls a future that is ready at once, because all bytes are in memory.
fn poll_once<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("a read from memory was not ready"),
    }
}

impl MemoryArchive {
    fn new(bytes: Vec<u8>) -> Self {
        Self(poll_once(AsyncPmTilesReader::try_from_source(MemoryBackend(bytes))).unwrap())
    }

    pub(crate) fn get(&self, id: TileId) -> Option<Vec<u8>> {
        let coord = TileCoord::new(id.level(), id.x(), id.y()).unwrap();
        poll_once(self.0.get_tile(coord)).unwrap().map(|bytes| bytes.to_vec())
    }

    /// Number of tiles that can be requested.
    pub(crate) fn tiles(&self) -> u64 {
        self.0.get_header().n_addressed_tiles().unwrap().get()
    }

    /// Number of different tiles that are stored.
    pub(crate) fn contents(&self) -> u64 {
        self.0.get_header().n_tile_contents().unwrap().get()
    }

    pub(crate) fn is_clustered(&self) -> bool {
        self.0.get_header().clustered()
    }
}
