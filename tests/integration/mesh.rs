//! Real meshes round trip: scans, and every leaf of the real cities. Those that are not on this machine are reported as
//! ignored.

use anyhow::{Context, Result, ensure};
use insula_protocol::mesh::Mesh;
use insula_protocol::mesh::half_edge::HalfEdgeMesh;
use insula_simplify::model::{ModelFormat, TriangleModel, quantise};
use insula_simplify::simplify::{Goal, simplify};
use insula_tests::fidelity::{self, REAL_CITIES};
use insula_tests::leaves;
use insula_tests::trials::{Test, Trials};
use std::path::Path;

pub(crate) fn add(trials: &mut Trials) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/meshes");
    trials.add(["nefertiti.obj", "skull.obj", "bun_zipper.ply"].map(|name| {
        let path = folder.join(name);
        let is_absent = !path.is_file();
        let test = Test::new(name.replace('.', "_"), move || scan(&path)).ignored_if(is_absent);
        if name == "bun_zipper.ply" { test } else { test.full_tier() }
    }));
    trials.add(REAL_CITIES.map(|name| {
        let test = Test::new(format!("leaves_of_{}", name.replace('-', "_")), move || city(name))
            .ignored_if(fidelity::real_city(name).is_none());
        if name == "chiba-textured" { test } else { test.full_tier() }
    }));
}

/// With all numbers of bits, and after simplification.
fn scan(path: &Path) -> Result<()> {
    let format = ModelFormat::of(path).context("a name that is known")?;
    let mut model = TriangleModel::read(&std::fs::read(path)?, format)?;
    model.weld();
    for bits in [8, 10, 12, 14, 16] {
        check_round_trip(&quantise::to_mesh(&model, bits, bits))?;
    }
    let before = HalfEdgeMesh::new(&model.triangles, model.positions.len() as u32);
    for share in [2, 10, 100] {
        let goal = model.triangles.len() / share;
        let out = simplify(&model, Goal { triangles: goal, error: f64::INFINITY }, |_| false);
        let found = out.model.triangles.len();
        ensure!(found.abs_diff(goal) * 100 <= goal, "{found} triangles, {goal} are requested");
        let after = HalfEdgeMesh::new(&out.model.triangles, out.model.positions.len() as u32);
        ensure!(after.is_sound() && after.euler() == before.euler(), "{} is {}", after.euler(), before.euler());
        ensure!(after.report.borders == before.report.borders, "{} borders", after.report.borders);
        check_round_trip(&quantise::to_mesh(&out.model, 12, 12))?;
    }
    Ok(())
}

fn city(name: &str) -> Result<()> {
    let scene = fidelity::read(&fidelity::real_city(name).context("it is not on this machine")?)?;
    let meshes = leaves::leaves(&scene, 64.0, 12);
    ensure!(meshes.len() > 50, "only {} leaves", meshes.len());
    meshes.iter().try_for_each(check_round_trip)?;
    check_round_trip(&leaves::whole_mesh(&scene, 16))
}

fn check_round_trip(mesh: &Mesh) -> Result<()> {
    let encoded = mesh.encode()?;
    let back = Mesh::decode(&encoded.bytes)?;
    let positions = encoded.vertices.iter().map(|vertex| mesh.positions[*vertex as usize]);
    ensure!(back.grid == mesh.grid && back.positions.iter().copied().eq(positions), "positions differ");
    let given = mesh.triangles.as_flattened();
    let found = back.triangles.as_flattened().iter().map(|vertex| encoded.vertices[*vertex as usize]);
    ensure!(found.eq(encoded.corners.iter().map(|corner| given[*corner as usize])), "triangles differ");
    let left_out = (encoded.report.degenerate + encoded.report.duplicate) as usize;
    ensure!(back.triangles.len() + left_out == mesh.triangles.len(), "triangles are missing");
    Ok(())
}
