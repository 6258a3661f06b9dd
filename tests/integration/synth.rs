//! Generated cities are the same in every run, valid, and as planned.
use glam::{DVec2, DVec3};
use insula_bake::Silent;
use insula_protocol::NODE_CELLS;
use insula_protocol::blockmap::flag;
use insula_tests::baked::Baked;
use insula_tests::rng::Rng;
use insula_tests::synth::plan::Plan;
use insula_tests::synth::{City, triangles};
use insula_tests::trials::Trials;
use insula_tests::{programs, tests};
use std::fs;
use std::path::Path;
use std::process::Command;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![generated_cities_are_reproducible_and_valid, columns_are_as_high_as_the_triangles]);
}

const BUILDINGS: u64 = 300;
/// The centre and eight points around it.
const AROUND: [[f64; 2]; 9] =
    [[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];

fn make(out: &Path, threads: usize) {
    City::new(BUILDINGS, 1.0).unwrap().write(out, Some(threads), &Silent).unwrap();
}

fn generated_cities_are_reproducible_and_valid() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["one/city", "two/city"].map(|name| folder.path().join(name));
    for out in [&first, &second] {
        fs::create_dir(out.parent().unwrap()).unwrap();
    }
    make(&first, 1);
    make(&second, 3);
    for file in ["city.json", "blockmaps.pmtiles", "subtrees.pmtiles"] {
        assert!(fs::read(first.join(file)).unwrap() == fs::read(second.join(file)).unwrap(), "{file} differs");
    }
    let output = programs::run(Command::new(programs::program("insula-server").unwrap()).arg("verify").arg(&first));
    assert!(output.unwrap().status.success());
}

/// Away from walls, columns are as high as the triangles.
fn columns_are_as_high_as_the_triangles() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("city");
    make(&out, 2);
    let city = Baked::open(&out).unwrap();
    let manifest = city.manifest().clone();
    let leaves = city.leaves().unwrap();
    let plan = Plan::new(BUILDINGS);
    let [low, high] = plan.bounds();
    let mut corners = Vec::new();
    for at in plan.blocks_in(low, high) {
        triangles::push_block(&plan.block(at).unwrap(), DVec3::ZERO, &mut corners);
    }
    assert_eq!(corners.len() as u64, 3 * manifest.counts.triangles);
    let (mut rng, mut raised, mut compared) = (Rng::new(5), 0, 0);
    for _ in 0..3000 {
        let p = DVec2::new(rng.range(low.x, high.x), rng.range(low.y, high.y));
        let tops = AROUND.map(|d| highest(&corners, p + DVec2::from(d) * 1.2));
        if tops.iter().any(|top| (top - tops[0]).abs() > 1.5) {
            continue;
        }
        let from_corner = p - DVec3::from(manifest.origin).truncate();
        let cell = from_corner.floor().as_uvec2();
        let n = NODE_CELLS as u32;
        let map =
            leaves.iter().find(|(id, _)| [id.x(), id.y()] == [cell.x / n, cell.y / n]).map(|(_, map)| map).unwrap();
        let i = (cell.y % n * n + cell.x % n) as usize;
        assert!(map.flags[i] & flag::OCCUPIED != 0);
        let top = map.z_base_m() + f64::from(map.z_max[i]) * f64::from(map.z_step_m());
        assert!((top - tops[0]).abs() < 1.5, "at {p}: {top} m, meant {} m", tops[0]);
        compared += 1;
        raised += usize::from(tops[0] > 2.0);
    }
    assert!(compared > 1000 && raised > 200, "{compared} places, {raised} of them on buildings");
}

/// Height of the triangles at a position.
fn highest(corners: &[triangles::Corner], p: DVec2) -> f64 {
    let over = corners.as_chunks::<3>().0.iter().filter_map(|[a, b, c]| {
        let [a, b, c] = [a, b, c].map(|corner| corner.p.as_dvec3());
        let cross = |u: DVec2, v: DVec2| u.perp_dot(v);
        let (ab, ac, ap) = ((b - a).truncate(), (c - a).truncate(), p - a.truncate());
        let area = cross(ab, ac);
        let (u, v) = (cross(ap, ac) / area, cross(ab, ap) / area);
        (area.abs() > 1e-9 && u >= 0.0 && v >= 0.0 && u + v <= 1.0).then_some(a.z + (b.z - a.z) * u + (c.z - a.z) * v)
    });
    over.fold(0.0, f64::max)
}
