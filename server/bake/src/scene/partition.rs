//! Sorts triangles into blocks of leaves. Each block has a file of its own, its bucket.
//!
//! In: the city and its grid. Out: [`Partition`], which lists the leaves that may have content, block by block, and has
//! for each block a file of the triangles that may touch or shade it. Next: `sample`, one block at a time.
//!
//! The city is read once. Records for a bucket are buffered in memory up to a limit, then appended to its file.

use crate::error::BakeError;
use crate::scene::SceneTriangle;
use crate::scene::block_content::{BlockContent, TriangleExtent, span};
use crate::scene::grid::{BLOCK_LEAVES, CityGrid};
use crate::scene::scratch_budget::ScratchBudget;
use crate::scene::scratch_scene::ScratchScene;
use crate::scene::triangle_store::{RECORD_BYTES, from_record, to_record};
use insula_protocol::TileId;
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};

const _: () = assert!(BLOCK_LEAVES <= 8, "a block's leaves are kept as the bits of a u64");

/// A block of `BLOCK_LEAVES` x `BLOCK_LEAVES` leaves, aligned to multiples of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LeafBlock {
    /// Column of blocks.
    pub(crate) x: u32,
    /// Row of blocks.
    pub(crate) y: u32,
    /// Bit `y * BLOCK_LEAVES + x` is set if that leaf may have content.
    pub(crate) leaves: u64,
    /// Number of triangles in the bucket.
    pub(crate) triangles: u64,
    /// What is in the block itself, for the estimate of its memory.
    pub(crate) content: BlockContent,
}

/// All blocks that have content.
#[derive(Debug)]
pub(crate) struct Partition {
    /// In order of (y, x).
    pub(crate) blocks: Vec<LeafBlock>,
    depth: u8,
    folder: PathBuf,
}

/// How a city is partitioned.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PartitionOptions<'a> {
    /// Folder of the buckets, which is created.
    pub(crate) folder: &'a Path,
    /// The blocks that are wanted.
    pub(crate) square: BlockSquare,
    /// Distance around a block within which a triangle may shade it.
    pub(crate) margin_m: f64,
    /// Size of all write buffers together.
    pub(crate) buffer_bytes: usize,
    /// Most blocks that are in memory.
    pub(crate) max_blocks: usize,
    /// Bounds the buckets.
    pub(crate) budget: &'a ScratchBudget,
}

impl Partition {
    /// Sorts the city's triangles into buckets; calls `advance` with the number of triangles done since the last call.
    /// Fails if a file cannot be read or written, if the city has too many blocks, or if the buckets exceed the budget.
    pub(crate) fn new(
        city: &ScratchScene,
        grid: &CityGrid,
        options: PartitionOptions<'_>,
        advance: impl Fn(u64),
    ) -> Result<Self, BakeError> {
        /// Triangles between two calls of `advance`.
        const STEP: u64 = 1 << 14;
        let PartitionOptions { folder, square, margin_m, buffer_bytes, max_blocks, budget } = options;
        fs::create_dir(folder).map_err(|cause| BakeError::io(folder, "created", cause))?;
        let by_block = BTreeMap::new();
        let mut buckets = BucketWriter { grid, square, margin_m, folder, max_blocks, budget, by_block, buffered: 0 };
        let mut count = 0;
        city.try_for_each_exact(|triangle, exact| {
            count += 1;
            if count % STEP == 0 {
                advance(STEP);
            }
            buckets.add(triangle, exact)?;
            if buckets.buffered >= buffer_bytes { buckets.flush() } else { Ok(()) }
        })?;
        buckets.flush()?;
        advance(count % STEP);
        let mut blocks = Vec::new();
        for ((y, x), bucket) in buckets.by_block {
            if bucket.leaves == 0 {
                let path = bucket_path(folder, x, y);
                fs::remove_file(&path).map_err(|cause| BakeError::io(&path, "removed", cause))?;
                continue;
            }
            let BlockBucket { leaves, triangles, content, .. } = bucket;
            blocks.push(LeafBlock { x, y, leaves, triangles, content });
        }
        Ok(Self { blocks, depth: grid.depth, folder: folder.to_owned() })
    }

    /// The triangles that touch the block and its margin, in the city's order, relative to the block's south-west corner on the
    /// map. Fails if the bucket cannot be read or has changed.
    pub(crate) fn triangles(&self, block: &LeafBlock) -> Result<Vec<SceneTriangle>, BakeError> {
        let path = bucket_path(&self.folder, block.x, block.y);
        let bytes = fs::read(&path).map_err(|cause| BakeError::io(&path, "read", cause))?;
        let (records, rest) = bytes.as_chunks::<RECORD_BYTES>();
        if records.len() as u64 != block.triangles || !rest.is_empty() {
            return Err(BakeError::Scratch { path });
        }
        Ok(records.iter().map(from_record).collect())
    }

    /// Number of the object with most surface in the block. Fails if the bucket cannot be read.
    pub(crate) fn largest_object(&self, block: &LeafBlock, grid: &CityGrid) -> Result<Option<u32>, BakeError> {
        let path = bucket_path(&self.folder, block.x, block.y);
        let failed = |cause| BakeError::io(&path, "read", cause);
        let mut reader = BufReader::new(File::open(&path).map_err(failed)?);
        let (mut by_object, mut all) = (BTreeMap::<u32, f64>::new(), BlockContent::default());
        let mut record = [0; RECORD_BYTES];
        for _ in 0..block.triangles {
            reader.read_exact(&mut record).map_err(failed)?;
            let triangle = from_record(&record);
            let before_m2 = all.surface_m2;
            let on_map = triangle.corners.map(|[x, y, _]| [f64::from(x), f64::from(y)]);
            all.add(&TriangleExtent::new(&triangle, &on_map), [0.0; 2], grid.block_side_m());
            *by_object.entry(triangle.object).or_default() += all.surface_m2 - before_m2;
        }
        Ok(by_object.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(object, _)| object))
    }

    /// The block's leaves that may have content, row by row.
    pub(crate) fn leaves(&self, block: &LeafBlock) -> Vec<TileId> {
        (0..BLOCK_LEAVES * BLOCK_LEAVES)
            .filter(|bit| block.leaves >> bit & 1 == 1)
            .filter_map(|bit| {
                let (x, y) = (block.x * BLOCK_LEAVES + bit % BLOCK_LEAVES, block.y * BLOCK_LEAVES + bit / BLOCK_LEAVES);
                TileId::new(self.depth, x, y)
            })
            .collect()
    }
}

fn bucket_path(folder: &Path, x: u32, y: u32) -> PathBuf {
    folder.join(format!("{x}-{y}.bucket"))
}

/// The bucket of a block while it is filled.
#[derive(Debug, Default)]
struct BlockBucket {
    leaves: u64,
    triangles: u64,
    content: BlockContent,
    /// Records that are not in the file yet.
    buffer: Vec<u8>,
}

struct BucketWriter<'a> {
    grid: &'a CityGrid,
    /// The blocks that are wanted.
    square: BlockSquare,
    margin_m: f64,
    folder: &'a Path,
    max_blocks: usize,
    budget: &'a ScratchBudget,
    /// By (y, x).
    by_block: BTreeMap<(u32, u32), BlockBucket>,
    /// Bytes in all buffers.
    buffered: usize,
}

impl BucketWriter<'_> {
    /// Adds a triangle, with its exact corners. Fails if there are too many blocks, or the buckets exceed the budget.
    fn add(&mut self, triangle: &SceneTriangle, exact: &[[f64; 3]; 3]) -> Result<(), BakeError> {
        let grid = self.grid;
        let p = on_lattice(exact, grid);
        let side = grid.node_side_m(grid.depth);
        let last = (1u32 << grid.depth) - 1;
        let block_side = grid.block_side_m();
        let extent = TriangleExtent::new(triangle, &p);
        for [x, y] in self.square.clip(touched_blocks(&p, self.margin_m, grid)).places() {
            let bucket = self.by_block.entry((y, x)).or_default();
            let low = grid.block_offset_m([x, y]);
            let corner = |k: usize| [(p[k][0] - low[0]) as f32, (p[k][1] - low[1]) as f32, triangle.corners[k][2]];
            let record = to_record(&SceneTriangle { corners: std::array::from_fn(corner), ..*triangle });
            bucket.triangles += 1;
            bucket.content.add(&extent, low, block_side);
            bucket.buffer.extend_from_slice(&record);
            self.buffered += record.len();
            self.budget.spend(record.len())?;
            if self.by_block.len() > self.max_blocks {
                return Err(BakeError::TooManyBlocks { limit: self.max_blocks, side_m: block_side });
            }
        }
        self.mark_leaves(&p, side, last);
        Ok(())
    }

    /// Marks the leaves that the triangle touches.
    fn mark_leaves(&mut self, p: &[[f64; 2]; 3], side: f64, last: u32) {
        let [x, y] = [0, 1].map(|axis| touched_range(span(p, axis), side, last));
        let one = x[0] == x[1] && y[0] == y[1];
        let [x, y] = self.square.leaves().clip([x, y]).ranges;
        for leaf_y in y[0]..=y[1] {
            for leaf_x in x[0]..=x[1] {
                let low = [f64::from(leaf_x) * side, f64::from(leaf_y) * side];
                if one || touches(p, low, side) {
                    let bit = leaf_y % BLOCK_LEAVES * BLOCK_LEAVES + leaf_x % BLOCK_LEAVES;
                    self.by_block.entry((leaf_y / BLOCK_LEAVES, leaf_x / BLOCK_LEAVES)).or_default().leaves |= 1 << bit;
                }
            }
        }
    }

    /// Appends all buffers to their files.
    fn flush(&mut self) -> Result<(), BakeError> {
        for ((y, x), bucket) in &mut self.by_block {
            let buffer = std::mem::take(&mut bucket.buffer);
            if buffer.is_empty() {
                continue;
            }
            let path = bucket_path(self.folder, *x, *y);
            let open = || -> io::Result<File> { OpenOptions::new().append(true).create(true).open(&path) };
            let written = open().and_then(|mut file| file.write_all(&buffer));
            written.map_err(|cause| BakeError::io(&path, "written", cause))?;
        }
        self.buffered = 0;
        Ok(())
    }
}

/// A rectangle of blocks: first and last column, first and last row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BlockSquare {
    pub(crate) ranges: [[u32; 2]; 2],
}

impl BlockSquare {
    /// All blocks of a city.
    pub(crate) fn all() -> Self {
        Self { ranges: [[0, u32::MAX]; 2] }
    }

    /// What it has in common with ranges of columns and rows.
    fn clip(self, [x, y]: [[u32; 2]; 2]) -> Self {
        let [own_x, own_y] = self.ranges;
        let common = |a: [u32; 2], b: [u32; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        Self { ranges: [common(own_x, x), common(own_y, y)] }
    }

    /// Its leaves, as columns and rows.
    fn leaves(self) -> Self {
        let leaves = |[first, last]: [u32; 2]| {
            [first.saturating_mul(BLOCK_LEAVES), last.saturating_mul(BLOCK_LEAVES).saturating_add(BLOCK_LEAVES - 1)]
        };
        Self { ranges: self.ranges.map(leaves) }
    }

    /// Its members, row by row.
    fn places(self) -> impl Iterator<Item = [u32; 2]> {
        let [x, y] = self.ranges;
        (y[0]..=y[1]).flat_map(move |y| (x[0]..=x[1]).map(move |x| [x, y]))
    }
}

/// Corners on the map in metres from the grid's corner, on the lattice. `exact` are those in the scene.
pub(crate) fn on_lattice(exact: &[[f64; 3]; 3], grid: &CityGrid) -> [[f64; 2]; 3] {
    let step_m = grid.lattice_m();
    exact.map(|corner| [0, 1].map(|axis: usize| ((corner[axis] - grid.corner[axis]) / step_m).round() * step_m))
}

/// First and last column, first and last row of the blocks that a triangle touches with a margin. `p` are its corners on the map in metres
/// from the grid's corner.
pub(crate) fn touched_blocks(p: &[[f64; 2]; 3], margin_m: f64, grid: &CityGrid) -> [[u32; 2]; 2] {
    let last = (1u32 << grid.depth) - 1;
    [0, 1].map(|axis| {
        let [low, high] = span(p, axis);
        touched_range([low - margin_m, high + margin_m], grid.block_side_m(), last / BLOCK_LEAVES)
    })
}

/// First and last of the squares of side `side` that the closed interval touches, within `0..=last`.
fn touched_range(span: [f64; 2], side: f64, last: u32) -> [u32; 2] {
    // A float cast saturates: an interval outside the root counts for the root's outermost squares.
    [((span[0] / side).ceil() as i64 - 1).clamp(0, i64::from(last)) as u32, ((span[1] / side) as u32).min(last)]
}

/// Whether the triangle touches the square at `low`, given that its bounding box does: no edge of the triangle
/// separates them.
fn touches(p: &[[f64; 2]; 3], low: [f64; 2], side: f64) -> bool {
    let q = [low, [low[0] + side, low[1]], [low[0], low[1] + side], [low[0] + side, low[1] + side]];
    let separates = |i: usize| {
        let (a, b) = (p[i], p[(i + 1) % 3]);
        let distance = |c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let own = distance(p[(i + 2) % 3]);
        (own >= 0.0 && q.iter().all(|c| distance(*c) < 0.0)) || (own <= 0.0 && q.iter().all(|c| distance(*c) > 0.0))
    };
    !(0..3).any(separates)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, ObjectKind, Scene, SceneObject};
    use insula_test_support::folder::TestFolder;
    use insula_test_support::rng::Rng;

    fn triangle(corners: [[f32; 3]; 3]) -> SceneTriangle {
        SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object: 0 }
    }

    /// Partitions the triangles in a folder of the test's own.
    fn partition(
        name: &str,
        triangles: &[SceneTriangle],
        margin_m: f64,
        buffer_bytes: usize,
    ) -> (Partition, TestFolder) {
        let scene = Scene {
            triangles: triangles.to_vec(),
            objects: vec![SceneObject { id: "a".into(), kind: ObjectKind::Building, base_z_m: 0.0 }],
            materials: vec![Material { rgb: [0; 3], texture: None, is_reflective: false }],
            ..Scene::default()
        };
        let folder = TestFolder::new(&format!("partition-{name}"));
        let buckets = folder.path.join("buckets");
        let budget = &ScratchBudget::new(u64::MAX);
        let square = BlockSquare::all();
        let options =
            PartitionOptions { folder: &buckets, square, margin_m, buffer_bytes, max_blocks: 1 << 10, budget };
        let city = ScratchScene::from_scene(scene).unwrap();
        (Partition::new(&city, &grid(5), options, |_| {}).unwrap(), folder)
    }

    fn grid(depth: u8) -> CityGrid {
        CityGrid { corner: [0.0; 3], depth, cell_m: 1.0 }
    }

    fn id(x: u32, y: u32) -> TileId {
        TileId::new(5, x, y).unwrap()
    }

    #[test]
    fn triangles_within_the_margin_are_in_neighbouring_buckets() {
        let all = [
            triangle([[500.0, 10.0, 0.0], [505.0, 10.0, 0.0], [500.0, 15.0, 5.0]]),
            triangle([[600.0, 10.0, 0.0], [605.0, 10.0, 0.0], [600.0, 15.0, 5.0]]),
            triangle([[900.0, 10.0, 0.0], [905.0, 10.0, 0.0], [900.0, 15.0, 5.0]]),
        ];
        let held = |partition: &Partition| -> Vec<Vec<usize>> {
            // Corners are relative to the block.
            let at = |block: &LeafBlock, t: &SceneTriangle| t.corners[0][0] + 128.0 * block.x as f32;
            let number = |x: f32| all.iter().position(|other| other.corners[0][0] == x).unwrap();
            let triangles =
                |block: &LeafBlock| partition.triangles(block).unwrap().iter().map(|t| number(at(block, t))).collect();
            partition.blocks.iter().map(triangles).collect()
        };
        let (narrow, _folder) = partition("small", &all, 64.0, 1 << 20);
        let leaves: Vec<_> = narrow.blocks.iter().map(|block| narrow.leaves(block)).collect();
        assert_eq!(leaves, [[id(7, 0)], [id(9, 0)], [id(14, 0)]]);
        assert_eq!(held(&narrow), [vec![0], vec![0, 1], vec![2]]);
        let (wider, _folder) = partition("wider", &all, 100.0, 1 << 20);
        assert_eq!(held(&wider), [vec![0, 1], vec![0, 1], vec![2]]);
    }

    #[test]
    fn diagonal_triangle_does_not_mark_leaves_beside_it() {
        let sliver = triangle([[1.0, 1.0, 0.0], [2040.0, 2045.0, 0.0], [2045.0, 2040.0, 0.0]]);
        let (partition, folder) = partition("sliver", &[sliver], 0.0, 1 << 20);
        let leaves: Vec<_> = partition.blocks.iter().flat_map(|block| partition.leaves(block)).collect();
        assert!((0..32).all(|i| leaves.contains(&id(i, i))));
        assert!(!leaves.contains(&id(0, 31)));
        assert!(leaves.len() < 100, "{}", leaves.len());
        let files = fs::read_dir(folder.path.join("buckets")).unwrap().count();
        assert_eq!(files, partition.blocks.len(), "buckets of blocks without leaves are removed");
    }

    #[test]
    fn triangle_on_a_leaf_border_marks_both_leaves() {
        let wall = triangle([[64.0, 10.0, 0.0], [64.0, 20.0, 0.0], [64.0, 15.0, 9.0]]);
        let (partition, _folder) = partition("edge", &[wall], 0.0, 1 << 20);
        assert_eq!(partition.leaves(&partition.blocks[0]), [id(0, 0), id(1, 0)]);
    }

    #[test]
    fn every_point_of_every_triangle_lies_in_a_marked_leaf() {
        let mut rng = Rng::new(7);
        let mut random = || rng.range(0.0, 2047.0) as f32;
        let triangles: Vec<_> =
            (0..200).map(|_| triangle(std::array::from_fn(|_| [random(), random(), 0.0]))).collect();
        let (partition, _folder) = partition("random", &triangles, 64.0, 1 << 20);
        let held: Vec<_> = partition.blocks.iter().map(|block| partition.triangles(block).unwrap()).collect();
        for triangle in &triangles {
            for (u, v) in [(0.2, 0.3), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5), (0.1, 0.8)] {
                let [a, b, c] = triangle.corners;
                let [x, y] = [0, 1].map(|k| ((a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k])) / 64.0) as u32);
                let of = |block: &LeafBlock| (block.x, block.y) == (x / BLOCK_LEAVES, y / BLOCK_LEAVES);
                let i = partition.blocks.iter().position(of).unwrap();
                assert!(partition.leaves(&partition.blocks[i]).contains(&id(x, y)));
                // The corners are relative to the block, and on the lattice.
                let block = &partition.blocks[i];
                let low = [block.x, block.y].map(|n| (n * 128) as f32);
                let is_own = |other: &SceneTriangle| {
                    let offset = |k: usize, axis: usize| other.corners[k][axis] + low[axis] - triangle.corners[k][axis];
                    (0..3).all(|k| (0..2).all(|axis| offset(k, axis).abs() < 1e-3))
                };
                assert!(held[i].iter().any(is_own));
            }
        }
        assert!(partition.blocks.is_sorted_by_key(|block| (block.y, block.x)));
    }

    #[test]
    fn too_many_blocks_and_too_large_buckets_are_refused() {
        let scene = Scene {
            triangles: vec![triangle([[0.0; 3], [2000.0, 0.0, 0.0], [0.0, 2000.0, 0.0]])],
            objects: vec![SceneObject { id: "a".into(), kind: ObjectKind::Building, base_z_m: 0.0 }],
            materials: vec![Material { rgb: [0; 3], texture: None, is_reflective: false }],
            ..Scene::default()
        };
        let folder = TestFolder::new("partition-blocks");
        let city = ScratchScene::from_scene(scene).unwrap();
        let partition = |name: &str, max_blocks: usize, budget: u64| {
            let (folder, budget) = (&folder.path.join(name), &ScratchBudget::new(budget));
            let square = BlockSquare::all();
            let options = PartitionOptions { folder, square, margin_m: 0.0, buffer_bytes: 99, max_blocks, budget };
            Partition::new(&city, &grid(5), options, |_| {}).map(|_| ())
        };
        assert!(matches!(partition("blocks", 200, u64::MAX), Err(BakeError::TooManyBlocks { limit: 200, .. })));
        // 256 copies of the triangle.
        let bytes = 256 * RECORD_BYTES as u64;
        assert!(matches!(partition("bytes", 300, bytes - 1), Err(BakeError::ScratchLimit { .. })));
        assert!(partition("fits", 300, bytes).is_ok());
    }

    #[test]
    fn buckets_do_not_depend_on_the_buffer_size() {
        let triangles: Vec<_> = (0..300)
            .map(|i| {
                let [x, y] = [(i * 37 % 2000) as f32, (i * 91 % 2000) as f32];
                triangle([[x, y, 0.0], [x + 30.0, y, 0.0], [x, y + 40.0, 1.0]])
            })
            .collect();
        let (large, _folder) = partition("large", &triangles, 64.0, 1 << 20);
        let (small, _folder) = partition("little", &triangles, 64.0, 200);
        assert!(large.blocks == small.blocks && large.blocks.len() > 20);
        for block in &large.blocks {
            assert_eq!(large.triangles(block).unwrap(), small.triangles(block).unwrap());
        }
    }
}
