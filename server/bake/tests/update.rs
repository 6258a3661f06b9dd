//! A city that is updated: the same bytes as a whole bake, and only what changed is baked.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::fs;

use insula_bake::{BakeOptions, BakeReport, Silent, bake_scene, read::ReadReport, scene::Scene};
use support::{Folder, city, files, options, partial};

/// Bakes `after` over a city of `before`, and anew; the bytes must be the same.
fn update(name: &str, before: Scene, after: Scene) -> BakeReport {
    let folder = Folder::new(name);
    let (out, whole) = (folder.out("updated"), folder.out("whole"));
    bake_scene(before, ReadReport::default(), &options(&out, 2), &Silent).unwrap();
    let report = bake_scene(after.clone(), ReadReport::default(), &updating(&out), &Silent).unwrap();
    bake_scene(after, ReadReport::default(), &options(&whole, 2), &Silent).unwrap();
    assert!(files(&out) == files(&whole), "{name}: other bytes than a whole bake");
    assert!(!partial(&out).exists());
    report
}

fn updating(out: &std::path::Path) -> BakeOptions {
    BakeOptions { update: true, ..options(out, 2) }
}

/// Without one box; its object stays, as in a source that is edited in place the others keep their order.
fn without(mut scene: Scene, object: u32) -> Scene {
    scene.triangles.retain(|triangle| triangle.object != object);
    scene.objects.remove(object as usize);
    scene.triangles.iter_mut().filter(|triangle| triangle.object > object).for_each(|triangle| triangle.object -= 1);
    scene
}

fn raised(mut scene: Scene, object: u32) -> Scene {
    let high = scene.triangles.iter().filter(|t| t.object == object).flat_map(|t| t.corners).map(|c| c[2]);
    let high = high.fold(f32::MIN, f32::max);
    for corner in scene.triangles.iter_mut().filter(|t| t.object == object).flat_map(|t| &mut t.corners) {
        corner[2] += if corner[2] == high { 3.0 } else { 0.0 };
    }
    scene
}

#[test]
fn what_changed_is_baked_and_nothing_else() {
    let same = update("update-same", city(), city());
    assert_eq!(same.blocks_baked, 0);
    let leaves = 7;
    assert!(same.blocks_unchanged > leaves);
    let changed = update("update-changed", city(), raised(city(), 2));
    assert!(changed.blocks_unchanged >= leaves - 1, "{changed:?}");
    assert!(changed.blocks_baked > 0 && changed.blocks_baked < same.blocks_unchanged / 2 + 1, "{changed:?}");
    let removed = update("update-removed", city(), without(city(), 6));
    assert!(removed.blocks_unchanged > 0 && removed.blocks_baked > 0);
    let added = update("update-added", without(city(), 6), city());
    assert!(added.blocks_unchanged > 0 && added.blocks_baked > 0);
}

#[test]
fn a_building_in_the_margin_counts() {
    // The second box stands 36 m south of the border of two blocks, and shades across it.
    let report = update("update-margin", city(), raised(city(), 4));
    assert!(report.blocks_unchanged > 0 && report.blocks_baked > 0);
}

#[test]
fn other_colours_count_and_other_numbers_do_not() {
    let mut painted = city();
    painted.materials[0].rgb = [1, 2, 3];
    assert_eq!(update("update-painted", city(), painted).blocks_unchanged, 0, "every box has that material");
    let mut swapped = city();
    swapped.materials.reverse();
    swapped.triangles.iter_mut().for_each(|triangle| triangle.material = 1 - triangle.material);
    assert_eq!(update("update-swapped", city(), swapped).blocks_baked, 0);
}

#[test]
fn a_wider_city_other_settings_or_a_damaged_one_are_baked_whole() {
    let wide = |mut scene: Scene| {
        for corner in scene.triangles.iter_mut().filter(|t| t.object == 8).flat_map(|t| &mut t.corners) {
            corner[0] += 3000.0;
        }
        scene
    };
    assert_eq!(update("update-wide", city(), wide(city())).blocks_unchanged, 0);
    let folder = Folder::new("update-whole");
    let (out, whole) = (folder.out("updated"), folder.out("whole"));
    let bake = |options: &BakeOptions| support::bake(options, &Silent).unwrap();
    bake(&options(&whole, 2));
    let good = files(&whole);
    // There is nothing yet; then a city of other cells; then one whose files are damaged, each in turn.
    assert_eq!(bake(&updating(&out)).blocks_unchanged, 0);
    assert!(files(&out) == good);
    bake(&BakeOptions { cell_m: 4.0, ..options(&out, 2) });
    assert_eq!(bake(&updating(&out)).blocks_unchanged, 0);
    assert!(files(&out) == good);
    for (name, bytes) in &good {
        for damaged in [&bytes[..bytes.len() / 2], &[][..]] {
            fs::write(out.join(name), damaged).unwrap();
            bake(&updating(&out));
            assert!(files(&out) == good, "damaged {name} of {} bytes", damaged.len());
        }
        fs::remove_file(out.join(name)).unwrap();
        if name != "city.json" {
            bake(&updating(&out));
            assert!(files(&out) == good, "missing {name}");
        } else {
            fs::write(out.join(name), bytes).unwrap();
        }
    }
    let mut flipped = good["blockmaps.pmtiles"].clone();
    let middle = flipped.len() - 100;
    flipped[middle] ^= 1;
    fs::write(out.join("blockmaps.pmtiles"), flipped).unwrap();
    bake(&updating(&out));
    assert!(files(&out) == good, "a damaged tile was taken over");
}
