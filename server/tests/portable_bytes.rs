//! A bake gives the same bytes on processors whose C library computes sines in another way.
#![allow(clippy::unwrap_used, reason = "a test may panic")]
#![cfg(all(feature = "bake", target_os = "linux", target_env = "gnu", target_arch = "x86_64"))]

use std::{collections::BTreeMap, fmt::Write, fs, path::Path, process::Command};

/// Houses with all kinds of roofs, each turned by another angle: sines are part of every roof and of the projection.
fn turned_houses() -> String {
    let shapes = ["gabled", "hipped", "dome", "onion", "round", "pyramidal", "skillion", "half-hipped"];
    let (mut nodes, mut ways) = (String::new(), String::new());
    for house in 0..160 {
        let (sin, cos) = (f64::from(house) * 0.37).sin_cos();
        let centre = [f64::from(house % 16) * 0.000_4 + 4.35, f64::from(house / 16) * 0.000_3 + 52.01];
        for (corner, [x, y]) in [[-8.0, -5.0], [8.0, -5.0], [8.0, 5.0], [-8.0, 5.0]].into_iter().enumerate() {
            let [lon, lat] = [(x * cos - y * sin) / 68_500.0 + centre[0], (x * sin + y * cos) / 111_200.0 + centre[1]];
            writeln!(
                nodes,
                r#"<node id="{}" version="1" lat="{lat:.7}" lon="{lon:.7}"/>"#,
                house * 4 + corner as i32 + 1
            )
            .unwrap();
        }
        writeln!(ways, r#"<way id="{}" version="1">"#, house + 1).unwrap();
        for corner in [0, 1, 2, 3, 0] {
            writeln!(ways, r#"<nd ref="{}"/>"#, house * 4 + corner + 1).unwrap();
        }
        let (shape, angle) = (shapes[house as usize % shapes.len()], house % 50 + 10);
        for (key, value) in [("building", "yes"), ("height", "14.3"), ("roof:shape", shape)] {
            writeln!(ways, r#"<tag k="{key}" v="{value}"/>"#).unwrap();
        }
        writeln!(ways, r#"<tag k="roof:angle" v="{angle}"/></way>"#).unwrap();
    }
    format!("<?xml version=\"1.0\"?><osm version=\"0.6\">{nodes}{ways}</osm>")
}

fn baked(input: &Path, folder: &Path, tunables: Option<&str>) -> BTreeMap<String, Vec<u8>> {
    fs::create_dir(folder).unwrap();
    let out = folder.join("city");
    let mut bake = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    bake.arg("bake").arg(input).arg("--out").arg(&out).env_remove("GLIBC_TUNABLES");
    bake.envs(tunables.map(|value| ("GLIBC_TUNABLES", value)));
    let output = bake.output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let files = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path());
    files.map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(path).unwrap())).collect()
}

#[test]
fn fused_operations_of_the_c_library_change_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("houses.osm");
    fs::write(&input, turned_houses()).unwrap();
    let with = baked(&input, &folder.path().join("with"), None);
    let without = baked(&input, &folder.path().join("without"), Some("glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2"));
    assert!(with.len() >= 5 && with.keys().eq(without.keys()), "{:?} and {:?}", with.keys(), without.keys());
    for (name, bytes) in &with {
        assert!(without[name] == *bytes, "{name} differs");
    }
}
