//! The voxels of a bake are those that carving leaves (Vacca 2008, 3.4.1): a block is carved by brute force from depth maps of the
//! whole sphere, and compared with the node's voxels.

use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3};
use insula_bake::scene::{ObjectKind, Scene, SceneTriangle};
use insula_protocol::blockmap::ground::{SQUARES, VERTICES, is_rising_diagonal};
use insula_protocol::blockmap::voxels::{ROWS_BELOW, Voxels};
use insula_protocol::blockmap::{NodeGround, flag};
use insula_protocol::{Manifest, NODE_CELLS, TileId};
use insula_simplify::surface::Surface;
use insula_tests::baked::Baked;
use insula_tests::carving::Carving;
use insula_tests::fidelity;
use insula_tests::trials::{Test, Trials, WHOLE_CITY};
use insula_tests::zoo::{BakedShape, Shapes, paint, rectangle, turned};

pub(crate) fn add(trials: &mut Trials) {
    trials.add([
        Test::new("a_block_of_shapes_from_128_views", || check_shapes(128, 0.25, 0.996)),
        Test::new("a_block_of_shapes_from_1024_views", || check_shapes(1024, 0.125, 0.999)).full_tier(),
    ]);
    trials.add(["delft-3dbag", "chiba-textured"].map(|name| {
        Test::new(format!("a_block_of_{name}_from_1024_views"), move || check_city(name))
            .ignored_if(fidelity::real_city(name).is_none())
            .in_turn(&WHOLE_CITY)
            .full_tier()
    }));
}

/// Most voxels that differ for none of the known reasons, as a share of all.
const UNEXPLAINED: f64 = 0.0001;
/// Most voxels that differ because several walls pass through them.
const CROSSED: f64 = 0.001;
/// Rows above the highest voxel that are compared, too.
const ROWS_ABOVE: usize = 2;

/// The voxels of a node that differ, by reason.
#[derive(Debug, Default)]
struct Differences {
    compared: usize,
    full: usize,
    /// A surface passes the voxel's middle within an eighth of a cell. Heights are whole sixteenths of a cell, walls whole 128ths
    /// and 256ths of a turn, and a texel of the depth maps is a quarter or an eighth of a cell.
    near: usize,
    /// A solid is thinner than a voxel and contains no voxel's middle, but has a voxel of its own.
    thin: usize,
    /// A column has one exact gap. Another gap opens only rows that it fills, so that a row at its end stays full.
    second_gap: usize,
    /// A wall clips the column, and beyond it there is one height above the column's foot. What has space below it, as a deck beside its
    /// pier, is left out there.
    clipped: usize,
    /// Another surface passes through the voxel. The lines through its cell decide whether it is full, at least half of them, where planes
    /// of two walls do not: at small parts of buildings, and where walls are missing.
    crossed: usize,
    others: Vec<([usize; 3], bool, f64)>,
}

/// Triangles in world metres.
type Triangles = Vec<[DVec3; 3]>;

/// A source, with the ground that it stands on.
struct Source {
    objects: Triangles,
    ground: Triangles,
}

/// Compares the voxels of a node above the ground with what carving leaves.
fn compare(baked: &Baked, node: TileId, source: &Source, views: usize, texel_cells: f64) -> Result<Differences> {
    let (manifest, map) = (baked.manifest(), baked.map(node)?);
    let cell_m = f64::from(map.cell_m);
    let base_m = map.z_base_m() - ROWS_BELOW as f64 * cell_m;
    let voxels = Voxels::of(map.clone());
    let foot_m =
        |column: usize| map.z_base_m() + f64::from(map.z_min[column]) * f64::from(map.z_step_m()) + manifest.origin[2];
    let corner = DVec3::from(manifest.node_corner(node)) + DVec3::Z * base_m;
    let middle_of = |at: [usize; 3]| corner + DVec3::from(at.map(|n| n as f64 + 0.5)) * cell_m;
    let all: Vec<[usize; 3]> = (0..voxels.rows() + ROWS_ABOVE)
        .flat_map(|z| (0..NODE_CELLS).flat_map(move |y| (0..NODE_CELLS).map(move |x| [x, y, z])))
        .collect();
    let points: Vec<DVec3> = all.iter().map(|at| middle_of(*at)).collect();
    let [low, high] = [points[0], points[points.len() - 1]];
    let carving =
        Carving { middle: (low + high) / 2.0, radius_m: low.distance(high) / 2.0, texel_m: texel_cells * cell_m };
    let triangles = [&source.objects[..], &source.ground].concat();
    let is_hidden = carving.hidden(&triangles, &points, views);
    let ground_m: Vec<f64> =
        points[..NODE_CELLS * NODE_CELLS].iter().map(|p| height_at(&source.ground, p.truncate())).collect();
    let surface = Surface::new(triangles.iter().map(|t| t.map(Into::into)).collect()).context("no triangles")?;
    let mut found = Differences::default();
    for (at, (point, is_hidden)) in all.iter().zip(points.iter().zip(is_hidden)) {
        let column = at[1] * NODE_CELLS + at[0];
        if point.z < ground_m[column] {
            continue;
        }
        // What stands is drawn from its foot on.
        let is_full = voxels.is_full(at.map(|n| n as i32)) && point.z >= foot_m(column);
        found.compared += 1;
        found.full += usize::from(is_full);
        if is_full == is_hidden {
            continue;
        }
        let distance = surface.distance((*point).into()) / cell_m;
        let is_alone = |step: i32| !voxels.is_full([at[0] as i32, at[1] as i32, at[2] as i32 + step]);
        if distance <= 0.125 {
            found.near += 1;
        } else if is_full && distance <= 0.5 && is_alone(1) && is_alone(-1) {
            found.thin += 1;
        } else if is_full && distance <= 1.0 && map.flags[column] & flag::HOLES != 0 {
            found.second_gap += 1;
        } else if !is_full && map.flags[column] & flag::CLIPPED != 0 {
            found.clipped += 1;
        } else if distance <= 0.5 {
            found.crossed += 1;
        } else {
            found.others.push((*at, is_full, distance));
        }
    }
    Ok(found)
}

/// Fails if less than a share of the voxels is equal, or if too many differ for no known reason.
fn check(name: &str, found: &Differences, least_equal: f64) -> Result<()> {
    let Differences { compared, full, near, thin, second_gap, clipped, crossed, others } = found;
    let equal = 1.0 - (near + thin + second_gap + clipped + crossed + others.len()) as f64 / *compared as f64;
    let figures = format!(
        "{name}: {compared} voxels, {full} full, {:.3}% equal; different: {near} at a surface, {thin} thin, {second_gap} at a second gap, {clipped} beyond a clip, {crossed} at several walls, {} others",
        100.0 * equal,
        others.len()
    );
    println!("{figures} {:?}", &others[..others.len().min(8)]);
    ensure!(*full * 20 > *compared, "hardly anything is full: {figures}");
    ensure!(equal >= least_equal, "{figures}");
    ensure!(*crossed as f64 <= CROSSED * *compared as f64, "{figures}");
    ensure!(others.len() as f64 <= UNEXPLAINED * *compared as f64, "{figures}");
    Ok(())
}

/// A scene, with the terrain that it has.
fn source_of(scene: &Scene) -> Source {
    let origin = DVec3::from(scene.origin);
    let is_ground = |object: u32| scene.objects[object as usize].kind == ObjectKind::Terrain;
    let (ground, objects): (Vec<&SceneTriangle>, Vec<&SceneTriangle>) =
        scene.triangles.iter().partition(|t| is_ground(t.object));
    let placed = |triangles: Vec<&SceneTriangle>| {
        triangles.iter().map(|t| t.corners.map(|c| origin + DVec3::from(c.map(f64::from)))).collect()
    };
    let (ground, objects) = (placed(ground), placed(objects));
    Source { objects, ground }
}

/// Height of the highest triangle at a place; negative infinity if there is none.
fn height_at(ground: &Triangles, place: DVec2) -> f64 {
    let height = |[a, b, c]: &[DVec3; 3]| {
        let cross = |p: DVec3, q: DVec3| (p.truncate() - place).perp_dot(q.truncate() - place);
        let weights = [cross(*b, *c), cross(*c, *a), cross(*a, *b)];
        let area: f64 = weights.iter().sum();
        let is_inside = area != 0.0 && weights.iter().all(|weight| weight / area >= -1e-9);
        is_inside.then(|| (a.z * weights[0] + b.z * weights[1] + c.z * weights[2]) / area)
    };
    ground.iter().filter_map(height).fold(f64::NEG_INFINITY, f64::max)
}

/// A block of 32 m: a turned house, a house with a pitched roof, a bridge, slabs above each other, a dome, a courtyard and a tower.
fn shapes() -> Shapes {
    let mut shapes = Shapes::default();
    let ground: Vec<DVec3> = rectangle([-150.0; 2], [150.0; 2]).iter().map(|p| p.extend(0.0)).collect();
    shapes.object(ObjectKind::Terrain).face(&ground, paint::GROUND);
    let moved = |outline: Vec<DVec2>, x: f64, y: f64| outline.iter().map(|p| *p + DVec2::new(x, y)).collect::<Vec<_>>();
    shapes
        .object(ObjectKind::Building)
        .prism(&moved(turned(&rectangle([-4.0, -3.0], [4.0, 3.0]), 25.0), 6.0, 6.0), [0.0, 7.3]);
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    // A pitched roof, whose ridge runs to the north.
    shapes.object(ObjectKind::Building);
    let ring = |z: f64| rectangle([13.2, 2.1], [21.3, 10.4]).iter().map(|p| p.extend(z)).collect::<Vec<_>>();
    let ridge = [at(17.25, 2.1, 8.2), at(17.25, 10.4, 8.2)];
    let eaves = ring(4.1);
    shapes.walls(&ring(0.0), &eaves).face(&ring(0.0).into_iter().rev().collect::<Vec<_>>(), paint::UNDER);
    shapes.face(&[eaves[0], eaves[1], ridge[0]], paint::WALL).face(&[eaves[2], eaves[3], ridge[1]], paint::WALL);
    shapes.face(&[eaves[1], eaves[2], ridge[1], ridge[0]], paint::ROOF);
    shapes.face(&[eaves[3], eaves[0], ridge[0], ridge[1]], paint::ROOF);
    // A bridge.
    for x in [1.3, 28.1] {
        shapes.object(ObjectKind::Building).cuboid([x, 14.2, 0.0], [x + 1.9, 17.1, 4.3]);
    }
    shapes.object(ObjectKind::Building).cuboid([0.7, 14.2, 4.3], [30.6, 17.1, 5.6]);
    // Slabs above each other.
    for (z, side) in [(0.0, 6.8), (4.0, 6.8), (8.0, 3.3)] {
        shapes.object(ObjectKind::Building).cuboid([23.3, 2.3, z], [23.3 + side, 2.3 + side, z + 1.1]);
    }
    // A dome on a drum.
    let rings = (0..=8).map(|k| f64::from(k) / 8.0 * 1.5).map(|a| [4.1 * a.cos(), 3.3 + 4.1 * a.sin()]);
    let rings: Vec<[f64; 2]> = [[4.1, 0.0]].into_iter().chain(rings).collect();
    shapes.object(ObjectKind::Building).turned(DVec2::new(6.2, 25.3), &rings, paint::ROOF);
    // Four wings around a court, and a tower beside them.
    for (low, high) in [
        ([13.1, 20.2], [24.3, 22.1]),
        ([13.1, 28.2], [24.3, 30.4]),
        ([13.1, 22.1], [15.2, 28.2]),
        ([22.3, 22.1], [24.3, 28.2]),
    ] {
        shapes.object(ObjectKind::Building).cuboid([low[0], low[1], 0.0], [high[0], high[1], 5.2]);
    }
    shapes.object(ObjectKind::Building).cuboid([26.2, 24.4, 0.0], [30.3, 28.3, 15.4]);
    shapes
}

fn check_shapes(views: usize, texel_cells: f64, least_equal: f64) -> Result<()> {
    const CELL_M: f64 = 0.5;
    let scene = shapes().scene([0.0; 3]);
    let shape = BakedShape::bake("carving", scene.clone(), CELL_M)?;
    let manifest = shape.baked.manifest();
    let is_block = |id: &TileId| manifest.node_corner(*id)[..2].iter().all(|v| v.abs() < 1e-6);
    let ids = shape.baked.ids(manifest.depth);
    let node = ids.into_iter().find(is_block).context("no node begins at the block's corner")?;
    let found = compare(&shape.baked, node, &source_of(&scene), views, texel_cells)?;
    check(&format!("shapes, {views} views"), &found, least_equal)
}

/// The leaf of a real city with the most triangles.
fn check_city(name: &str) -> Result<()> {
    let inputs = fidelity::real_city(name).context("it is not on this machine")?;
    let baked = Baked::open(&fidelity::baked(name)?)?;
    let mut source = source_of(&fidelity::read(&inputs)?);
    let manifest = baked.manifest();
    let side_m = manifest.node_side_m(manifest.depth);
    let count = |id: &TileId| {
        let [x, y, _] = manifest.node_corner(*id);
        let inside = |p: &DVec3| (x..x + side_m).contains(&p.x) && (y..y + side_m).contains(&p.y);
        source.objects.iter().filter(|t| inside(&t[0])).count()
    };
    let node = baked.ids(manifest.depth).into_iter().max_by_key(count).context("no leaves")?;
    for (id, (base_m, ground)) in baked.grounds()? {
        source.ground.extend(ground_triangles(manifest, id, base_m, &ground));
    }
    let found = compare(&baked, node, &source, 1024, 0.125)?;
    check(&format!("{name}, node {node}, 1024 views"), &found, 0.995)
}

/// The generated ground of a leaf, in world metres.
fn ground_triangles(manifest: &Manifest, node: TileId, base_m: f64, ground: &NodeGround) -> Triangles {
    let corner = DVec3::from(manifest.node_corner(node)) + DVec3::Z * base_m;
    let (step_m, heights) = (manifest.node_side_m(node.level()) / SQUARES as f64, ground.surface().heights);
    let vertex = |x: usize, y: usize| {
        let z = f64::from(heights[y * VERTICES + x]) * manifest.cell_m;
        corner + DVec3::new(x as f64 * step_m, y as f64 * step_m, z)
    };
    let squares = (0..SQUARES * SQUARES).filter(|i| ground.squares >> i & 1 == 1);
    squares
        .flat_map(|i| {
            let [x, y] = [i % SQUARES, i / SQUARES];
            let [sw, se, nw, ne] = [vertex(x, y), vertex(x + 1, y), vertex(x, y + 1), vertex(x + 1, y + 1)];
            if is_rising_diagonal(x, y) { [[sw, se, ne], [sw, ne, nw]] } else { [[sw, se, nw], [se, ne, nw]] }
        })
        .collect()
}
