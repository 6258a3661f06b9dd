//! Known values, error against rays, hostile inputs, threads.

use crate::prepared::PreparedScene;
use crate::{
    MAP_PX, OccludedMesh, Occlusion, OcclusionError, OcclusionSettings, UNIT, VIEWS, ViewPair, cpu, dot, view_pairs,
};
use glam::{DVec3, Vec3A};
use insula_test_support::rng::Rng;
use obvhs::BvhBuildParams;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::Ray;
use obvhs::triangle::Triangle;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

type Positions = Vec<[f64; 3]>;
type Triangles = Vec<[u32; 3]>;

const SETTINGS: OcclusionSettings = OcclusionSettings { views: 256, map_px: 512, bent_normals: true };

fn occlusion((positions, triangles): &(Positions, Triangles), settings: OcclusionSettings) -> Occlusion {
    cpu(OccludedMesh { positions, triangles }, &[], settings, &|_| true).unwrap()
}

/// A square of `n` by `n` cells between a corner and two edges.
fn grid(corner: DVec3, [a, b]: [DVec3; 2], n: u32) -> (Positions, Triangles) {
    let place = |i: u32| {
        (corner + a * f64::from(i % (n + 1)) / f64::from(n) + b * f64::from(i / (n + 1)) / f64::from(n)).to_array()
    };
    let cell = |i: u32| {
        let at = i / n * (n + 1) + i % n;
        [[at, at + 1, at + n + 2], [at, at + n + 2, at + n + 1]]
    };
    ((0..(n + 1) * (n + 1)).map(place).collect(), (0..n * n).flat_map(cell).collect())
}

/// One mesh of several, without welding.
fn join(parts: &[(Positions, Triangles)]) -> (Positions, Triangles) {
    let mut all = (Vec::new(), Vec::new());
    for (positions, triangles) in parts {
        let first = all.0.len() as u32;
        all.0.extend(positions);
        all.1.extend(triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    }
    all
}

fn sphere(n: u32) -> (Positions, Triangles) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..=n {
        let polar = std::f64::consts::PI * f64::from(i) / f64::from(n);
        for k in 0..2 * n {
            let turn = std::f64::consts::PI * f64::from(k) / f64::from(n);
            positions.push([polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos()]);
            if i < n {
                let [a, b] = [i * 2 * n + k, i * 2 * n + (k + 1) % (2 * n)];
                triangles.extend([[a, a + 2 * n, b + 2 * n], [a, b + 2 * n, b]]);
            }
        }
    }
    (positions, triangles)
}

#[test]
fn plane_and_sphere_are_open() {
    let plane = grid(DVec3::new(5e6, -3e5, 7.0), [DVec3::X * 3.0, DVec3::Y * 2.0], 20);
    let found = occlusion(&plane, SETTINGS);
    let least = found.share.iter().copied().fold(1.0, f32::min);
    assert!(least > 0.9999, "{least}");
    assert!(found.bent_normals.unwrap().iter().all(|bent| bent[2] > 0.995));
    let found = occlusion(&sphere(40), SETTINGS);
    let least = found.share.iter().copied().fold(1.0, f32::min);
    assert!(least > 0.99, "{least}");
}

#[test]
fn foot_of_a_wall_sees_half_and_a_corner_a_quarter() {
    // Far larger than what is looked at, as if without end.
    let wall = |a: DVec3, b: DVec3| grid(DVec3::ZERO, [a * 100.0, b * 100.0], 1);
    let floor = grid(DVec3::new(0.01, 0.01, 0.0), [DVec3::X, DVec3::Y], 10);
    let occluders = |parts: &[(Positions, Triangles)]| -> Vec<[[f64; 3]; 3]> {
        let (positions, triangles) = join(parts);
        triangles.iter().map(|triangle| triangle.map(|vertex| positions[vertex as usize])).collect()
    };
    let at_corner = |walls: &[(Positions, Triangles)], vertex: usize| {
        let mesh = OccludedMesh { positions: &floor.0, triangles: &floor.1 };
        let found = cpu(mesh, &occluders(walls), OcclusionSettings { views: 1024, ..SETTINGS }, &|_| true).unwrap();
        (found.share[vertex], found.bent_normals.unwrap()[vertex])
    };
    // The wall x = 0 reaches from y = -100 to 100.
    let x_wall = grid(DVec3::new(0.0, -100.0, 0.0), [DVec3::Y * 200.0, DVec3::Z * 100.0], 1);
    let (share, bent) = at_corner(std::slice::from_ref(&x_wall), 5 * 11);
    assert!((share - 0.5).abs() < 0.015, "{share}");
    // The means of x and z over this quarter of the sphere, weighted by z, are as 2 to pi.
    assert!((bent[0] - 0.537).abs() < 0.02 && (bent[2] - 0.844).abs() < 0.02 && bent[1].abs() < 0.02, "{bent:?}");
    let (share, _) = at_corner(&[x_wall, wall(DVec3::X, DVec3::Z)], 0);
    assert!((share - 0.25).abs() < 0.015, "{share}");
}

/// The share that cosine-weighted rays see.
fn traced((positions, triangles): &(Positions, Triangles), normals: &[DVec3], rays: u32) -> Vec<f32> {
    let local = |vertex: u32| DVec3::from(positions[vertex as usize]).as_vec3a();
    let boxed = |t: &[u32; 3]| Triangle { v0: local(t[0]), v1: local(t[1]), v2: local(t[2]) };
    let all: Vec<Triangle> = triangles.iter().map(boxed).collect();
    let bvh = build_bvh2_from_tris(&all, BvhBuildParams::medium_build(), &mut Duration::default());
    let share = |vertex: usize| {
        let normal = normals[vertex].as_vec3a();
        let (right, up) = normal.any_orthonormal_pair();
        let start = local(vertex as u32) + normal * 1e-4;
        let is_open = |i: &u32| {
            let height = (*i as f32 + 0.5) / rays as f32;
            let (sin, cos) = (*i as f32 * 2.399_963).sin_cos();
            let direction: Vec3A = (right * cos + up * sin) * height.sqrt() + normal * (1.0 - height).sqrt();
            let mut is_hit = false;
            bvh.ray_traverse_anyhit(Ray::new_inf(start, direction.normalize()), |ray, at| {
                is_hit |= all[bvh.primitive_indices[at] as usize].intersect(ray) < f32::INFINITY;
            });
            !is_hit
        };
        (0..rays).filter(is_open).count() as f32 / rays as f32
    };
    (0..positions.len()).map(share).collect()
}

#[test]
fn error_against_rays_is_small() {
    let mut bumps = sphere(40);
    for p in &mut bumps.0 {
        let radius = 1.0 + 0.25 * (5.0 * p[0]).sin() * (5.0 * p[1] + 1.0).sin() * (6.0 * p[2] + 2.0).sin();
        *p = p.map(|v| v * radius);
    }
    let mesh = OccludedMesh { positions: &bumps.0, triangles: &bumps.1 };
    let scene = PreparedScene::new(mesh, &[], SETTINGS).unwrap();
    let normals: Vec<DVec3> = scene.normals.iter().map(|n| DVec3::from(n.map(f64::from)).normalize()).collect();
    let truth = traced(&bumps, &normals, 4096);
    assert!(truth.iter().any(|share| *share < 0.8));
    for (views, limit) in [(64, 0.035), (256, 0.02)] {
        let found = occlusion(&bumps, OcclusionSettings { views, map_px: 1024, bent_normals: false });
        // The poles are many vertices with a triangle or two each.
        let inner = 80..truth.len() - 80;
        let squares = inner.clone().map(|i| f64::from(found.share[i] - truth[i]).powi(2)).sum::<f64>();
        let rms = (squares / inner.len() as f64).sqrt();
        assert!(rms <= limit, "{views} views: {rms}");
    }
}

/// Triangles of any size, place and orientation.
fn soup(count: u32) -> (Positions, Triangles) {
    let mut rng = Rng::new(7);
    let mut number = || rng.below(2001) as f64 / 1000.0 - 1.0;
    let positions = (0..count).map(|_| [number(), number(), number()]).collect();
    let mut rng = Rng::new(8);
    let mut vertex = || rng.below(count as usize) as u32;
    (positions, (0..count).map(|_| [vertex(), vertex(), vertex()]).collect())
}

#[test]
fn threads_and_opposite_sides_do_not_change_the_result() {
    let soup = soup(300);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| occlusion(&soup, SETTINGS))
    };
    let one = with(1);
    assert!(one.share.iter().any(|share| *share > 0.0 && *share < 1.0));
    for threads in [2, 3, 7] {
        assert_eq!(with(threads), one);
    }
    let turned = (soup.0.clone(), soup.1.iter().map(|[a, b, c]| [*b, *c, *a]).collect());
    let found = occlusion(&turned, SETTINGS);
    let off = found.share.iter().zip(&one.share).filter(|(a, b)| (**a - **b).abs() > 0.01).count();
    assert!(off < 3, "{off} of 300 differ");
}

#[test]
fn hostile_inputs_are_errors_or_values() {
    let (positions, triangles) = grid(DVec3::ZERO, [DVec3::X, DVec3::Y], 2);
    let run = |positions: &[[f64; 3]], triangles: &[[u32; 3]], occluders: &[[[f64; 3]; 3]], settings| {
        cpu(OccludedMesh { positions, triangles }, occluders, settings, &|_| true)
    };
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e16, -1e300] {
        let mut broken = positions.clone();
        broken[4][1] = bad;
        assert_eq!(run(&broken, &triangles, &[], SETTINGS), Err(OcclusionError::Position(4)));
        let occluder = [[0.0; 3], [1.0, 0.0, bad], [0.0; 3]];
        assert_eq!(run(&positions, &triangles, &[occluder], SETTINGS), Err(OcclusionError::Occluder(0)));
    }
    assert_eq!(run(&positions, &[[0, 1, 9]], &[], SETTINGS), Err(OcclusionError::Triangle(0)));
    for views in [0, VIEWS.end() + 1, u32::MAX] {
        assert_eq!(run(&[], &[], &[], OcclusionSettings { views, ..SETTINGS }), Err(OcclusionError::Views(views)));
    }
    for map_px in [0, MAP_PX.start() - 1, MAP_PX.end() + 1, u32::MAX] {
        assert_eq!(run(&[], &[], &[], OcclusionSettings { map_px, ..SETTINGS }), Err(OcclusionError::MapPx(map_px)));
    }
    assert!(run(&[], &[], &[], SETTINGS).unwrap().share.is_empty());
    // Points, lines, and numbers at the ends of their ranges.
    let far = [[-1e15, 1e15, 1e15], [1e15, -1e15, 1e15], [1e15, 1e15, -1e15]];
    for points in [
        vec![[3.0; 3]; 3],
        vec![[0.0; 3], [1.0; 3], [2.0; 3]],
        far.to_vec(),
        vec![[1e-320; 3], [0.0; 3], [1.0, 0.0, 1e-320]],
    ] {
        for settings in [
            SETTINGS,
            OcclusionSettings { views: 1, map_px: 64, ..SETTINGS },
            OcclusionSettings { views: 3, map_px: 4096, ..SETTINGS },
        ] {
            let found = run(&points, &[[0, 1, 2], [0, 0, 0], [2, 1, 0]], &[far, [[0.0; 3]; 3]], settings).unwrap();
            assert!(found.share.iter().all(|share| (0.0..=1.0).contains(share)), "{points:?}: {found:?}");
            assert!(found.bent_normals.unwrap().as_flattened().iter().all(|v| v.is_finite()));
        }
    }
}

#[test]
fn work_is_watched_and_can_be_cancelled() {
    let (positions, triangles) = sphere(8);
    let mesh = OccludedMesh { positions: &positions, triangles: &triangles };
    let (calls, most) = (AtomicU32::new(0), AtomicU32::new(0));
    let count = |views| {
        calls.fetch_add(1, Relaxed);
        most.fetch_max(views, Relaxed);
        true
    };
    cpu(mesh, &[], OcclusionSettings { views: 63, ..SETTINGS }, &count).unwrap();
    assert_eq!((calls.load(Relaxed), most.load(Relaxed)), (32, 64));
    assert_eq!(cpu(mesh, &[], SETTINGS, &|views| views < 20), Err(OcclusionError::Cancelled));
}

#[test]
fn pairs_are_distinct_even_and_nearly_orthogonal() {
    for count in [1, 2, 32, 128, 2048] {
        let pairs = view_pairs(count);
        for ViewPair { axes: [x, y, z] } in &pairs {
            for (a, b) in [(x, y), (y, z), (z, x)] {
                assert!(dot(*a, *b).abs() < 3 * UNIT as i64, "{pairs:?}");
            }
            assert!((dot(*z, *z) as f64).sqrt() - UNIT < 1.0);
        }
        // The second moments of an even set of lines are those of the sphere.
        for k in 0..3 {
            let moment = pairs.iter().map(|p| (f64::from(p.axes[2][k]) / UNIT).powi(2)).sum::<f64>();
            assert!(count < 32 || (moment / f64::from(count) - 1.0 / 3.0).abs() < 0.02, "{count}: {moment}");
        }
    }
}
