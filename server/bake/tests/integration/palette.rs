//! Colours of a city of three boxes: one with a pure red roof, one all white, one with a dark photo.

use super::support::FACES;
use insula_bake::read::{Palette, ReadOptions, read};
use insula_bake::{BakeOptions, BakeReport, Silent, bake};
use insula_test_support::folder::TestFolder;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// Adds a box of 12 x 12 x 9 m with its south-west corner at `x`, and one material for the roof and one for the rest.
fn add_box(obj: &mut String, number: usize, x: f64, [roof, rest]: [&str; 2]) {
    let first = 8 * number;
    for corner in 0..8 {
        let at = |bit: usize, length: f64| if corner >> bit & 1 == 1 { length } else { 0.0 };
        writeln!(obj, "v {} {} {}", x + at(0, 12.0), at(1, 12.0), at(2, 9.0)).unwrap();
    }
    writeln!(obj, "o box{number}").unwrap();
    for (i, face) in FACES.iter().enumerate() {
        writeln!(obj, "usemtl {}", if i == 1 { roof } else { rest }).unwrap();
        let corners: Vec<String> = face.iter().zip(1..).map(|(v, vt)| format!("{}/{vt}", first + v + 1)).collect();
        writeln!(obj, "f {}", corners.join(" ")).unwrap();
    }
}

fn write_city(folder: &Path) {
    let mut obj = "mtllib city.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n".to_owned();
    for (number, materials) in [["red", "white"], ["white", "white"], ["photo", "photo"]].into_iter().enumerate() {
        add_box(&mut obj, number, 30.0 * number as f64, materials);
    }
    let mtl = "newmtl red\nKd 1 0 0\nnewmtl white\nKd 1 1 1\nnewmtl photo\nKd 1 1 1\nmap_Kd photo.png\n";
    fs::write(folder.join("city.obj"), obj).unwrap();
    fs::write(folder.join("city.mtl"), mtl).unwrap();
    // Windows and walls, with a mean of about 0.1 in linear light.
    let photo =
        image::RgbImage::from_fn(32, 32, |x, y| image::Rgb(if (x / 4 + y / 4) % 2 == 0 { [40; 3] } else { [120; 3] }));
    photo.save(folder.join("photo.png")).unwrap();
}

fn bake_with(folder: &Path, mode: &str) -> BakeReport {
    let options = BakeOptions {
        inputs: vec![folder.join("city.obj")],
        out: folder.join(mode),
        read: ReadOptions { palette: Palette::from_option(Path::new(mode)).unwrap(), ..ReadOptions::default() },
        threads: Some(2),
        ..BakeOptions::default()
    };
    bake(&options, &Silent).unwrap()
}

#[test]
fn primaries_white_and_photos_fit_together_unless_sources_are_kept() {
    let folder = TestFolder::new("palette");
    write_city(&folder.path);
    let of = |mode: &str| bake_with(&folder.path, mode).read.sources.remove(0);
    let (harmonised, source) = (of("harmonised"), of("source"));
    let counts = |colours: insula_bake::read::ColourCounts| {
        [colours.source, colours.harmonised, colours.palette, colours.textured]
    };
    assert_eq!(counts(harmonised.colours), [0, 1, 11, 6]);
    assert_eq!(counts(source.colours), [12, 0, 0, 6]);
    assert!((2.0..=2.5).contains(&harmonised.texture_gain), "{}", harmonised.texture_gain);
    assert_eq!(source.texture_gain, 1.0);
    let archives =
        ["harmonised", "source"].map(|mode| fs::read(folder.path.join(mode).join("blockmaps.pmtiles")).unwrap());
    assert!(archives[0] != archives[1]);
}

#[test]
fn a_bake_is_the_same_again() {
    let folder = TestFolder::new("palette-again");
    write_city(&folder.path);
    let (first, second) = (bake_with(&folder.path, "harmonised"), bake_with(&folder.path, "harmonised"));
    assert_eq!(first.version, second.version);
    assert_eq!(first.read, second.read);
}

#[test]
fn colours_are_those_of_materials() {
    let folder = TestFolder::new("palette-colours");
    write_city(&folder.path);
    let inputs = [folder.path.join("city.obj")];
    let (scene, report) = read(&inputs, &Default::default(), &|_| {}).unwrap();
    let plain: BTreeSet<[u8; 3]> =
        scene.materials.iter().filter(|material| material.texture.is_none()).map(|material| material.rgb).collect();
    assert!(plain.iter().flatten().all(|v| (60..=232).contains(v)), "{plain:?}");
    assert!(plain.iter().any(|[r, g, b]| r > g && g > b && r - b > 50), "no tile red in {plain:?}");
    let photo = scene.materials.iter().find_map(|material| material.texture.as_ref()).unwrap();
    let linear = |v: u8| (f64::from(v) / 255.0).powf(2.2);
    let gain = linear(photo.rgb[4][0]) / linear(120);
    assert!((gain / report.sources[0].texture_gain - 1.0).abs() < 0.05, "{gain}");
}
