//! Updated cities: the same bytes as a full bake, and only what changed is baked.

use super::support::{BakedCity, COARSE_CELL_M, bake, city, coarse_options, files, options, out_folder, partial};
use insula_bake::read::ReadReport;
use insula_bake::scene::Scene;
use insula_bake::{BakeOptions, BakeReport, Silent, bake_scene};
use insula_objects::{ObjectBlock, Schema};
use insula_protocol::object_tile::{self, SCHEMA_ID};
use insula_protocol::{TileKind, VisibilityTile, visibility_tile};
use insula_test_support::folder::TestFolder;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Updates the city `before` to the scene of `after`. The result must equal `after`.
fn update(name: &str, before: &BakedCity, scene: Scene, after: &BakedCity) -> BakeReport {
    let folder = TestFolder::new(name);
    let out = out_folder(&folder, "updated");
    before.write(&out);
    let report = bake_scene(scene, ReadReport::default(), &updating(options(&out, 2)), &Silent).unwrap();
    assert!(files(&out) == after.files, "{name}: other bytes than a full bake");
    assert!(!partial(&out).exists());
    report
}

/// Updates the city of boxes to a changed scene.
fn update_boxes(name: &str, scene: Scene) -> BakeReport {
    let after = full_bake(&format!("{name}-full"), scene.clone());
    update(name, BakedCity::boxes(), scene, &after)
}

fn full_bake(name: &str, scene: Scene) -> BakedCity {
    BakedCity::bake(name, scene, options(Path::new(""), 2))
}

fn updating(options: BakeOptions) -> BakeOptions {
    BakeOptions { update: true, ..options }
}

/// Removes a box. The order of the others stays, as in a source that is edited.
pub(crate) fn without(mut scene: Scene, object: u32) -> Scene {
    scene.triangles.retain(|triangle| triangle.object != object);
    scene.objects.remove(object as usize);
    scene.triangles.iter_mut().filter(|triangle| triangle.object > object).for_each(|triangle| triangle.object -= 1);
    scene
}

/// Makes a box 3 m higher.
pub(crate) fn raised(mut scene: Scene, object: u32) -> Scene {
    let high = scene.triangles.iter().filter(|t| t.object == object).flat_map(|t| t.corners).map(|c| c[2]);
    let high = high.fold(f32::MIN, f32::max);
    for corner in scene.triangles.iter_mut().filter(|t| t.object == object).flat_map(|t| &mut t.corners) {
        corner[2] += if corner[2] == high { 3.0 } else { 0.0 };
    }
    scene
}

#[test]
fn only_changed_blocks_are_baked() {
    let boxes = BakedCity::boxes();
    let same = update("update-same", boxes, city(), boxes);
    assert_eq!(same.blocks_baked, 0);
    let leaf_blocks = 7;
    assert!(same.blocks_unchanged > leaf_blocks);
    let changed = update_boxes("update-changed", raised(city(), 2));
    assert!(changed.blocks_unchanged >= leaf_blocks - 1, "{changed:?}");
    assert!(changed.blocks_baked > 0 && changed.blocks_baked < same.blocks_unchanged / 2 + 1, "{changed:?}");
}

/// The number of each object by its identifier.
fn numbers(city: &Path) -> BTreeMap<String, u32> {
    let city = insula_archive::BakedCity::open(city).unwrap();
    let content = |id| object_tile::decode(id, &city.tile(TileKind::Objects, id).unwrap().unwrap()).unwrap();
    let schema: Schema = serde_json::from_slice(&content(SCHEMA_ID)).unwrap();
    let block = ObjectBlock::decode(0, &content(object_tile::block_id(0).unwrap()), &schema).unwrap();
    block.ids().iter().map(|id| (block.identifier(*id).unwrap().to_owned(), *id)).collect()
}

#[test]
fn objects_keep_their_numbers_when_others_come_and_go() {
    let folder = TestFolder::new("update-numbers");
    let out = out_folder(&folder, "updated");
    BakedCity::boxes().write(&out);
    let before = numbers(&out);
    let bake = |scene: Scene| bake_scene(scene, ReadReport::default(), &updating(options(&out, 2)), &Silent).unwrap();
    let removed = bake(without(city(), 6));
    assert!(removed.blocks_unchanged > 0 && removed.blocks_baked > 0);
    let without_one = numbers(&out);
    assert_eq!(without_one.len(), before.len() - 1);
    assert!(without_one.iter().all(|(identifier, number)| before[identifier] == *number));
    let added = bake(city());
    assert!(added.blocks_unchanged > 0 && added.blocks_baked > 0);
    let with_it = numbers(&out);
    assert_eq!(with_it.len(), before.len());
    assert!(without_one.iter().all(|(identifier, number)| with_it[identifier] == *number));
    let all: BTreeSet<&u32> = with_it.values().collect();
    assert_eq!(all.len(), before.len(), "two objects have one number");
}

#[test]
fn change_within_the_margin_of_a_block_is_baked() {
    // The second box is 36 m south of the border of two blocks and shades across it.
    let report = update_boxes("update-margin", raised(city(), 4));
    assert!(report.blocks_unchanged > 0 && report.blocks_baked > 0);
}

#[test]
fn changed_colours_are_baked_and_changed_material_numbers_are_not() {
    let mut painted = city();
    painted.materials[0].rgb = [1, 2, 3];
    assert_eq!(update_boxes("update-painted", painted).blocks_unchanged, 0, "every box has that material");
    let mut swapped = city();
    swapped.materials.reverse();
    swapped.triangles.iter_mut().for_each(|triangle| triangle.material = 1 - triangle.material);
    assert_eq!(update_boxes("update-swapped", swapped).blocks_baked, 0);
}

#[test]
fn larger_city_is_baked_in_full() {
    let mut wide = city();
    for corner in wide.triangles.iter_mut().filter(|t| t.object == 8).flat_map(|t| &mut t.corners) {
        corner[0] += 3000.0;
    }
    let after = full_bake("update-wide-full", wide.clone());
    let folder = TestFolder::new("update-wide");
    let out = out_folder(&folder, "updated");
    BakedCity::boxes().write(&out);
    let report = bake_scene(wide, ReadReport::default(), &updating(options(&out, 2)), &Silent).unwrap();
    assert_eq!(report.blocks_unchanged, 0);
    // Objects keep their numbers, so tiles, which name them, differ from those of a full bake.
    let updated = BakedCity { files: files(&out), report };
    assert!(updated.nodes().keys().eq(after.nodes().keys()), "other nodes than a full bake");
}

#[test]
fn missing_city_or_one_with_different_settings_is_baked_in_full() {
    let folder = TestFolder::new("update-full");
    let out = out_folder(&folder, "updated");
    let updating = updating(coarse_options(&out));
    assert_eq!(bake(&updating, &Silent).unwrap().blocks_unchanged, 0);
    let expected = files(&out);
    bake(&BakeOptions { cell_m: 2.0 * COARSE_CELL_M, ..options(&out, 2) }, &Silent).unwrap();
    assert_eq!(bake(&updating, &Silent).unwrap().blocks_unchanged, 0);
    assert!(files(&out) == expected);
}

#[test]
fn damaged_city_is_repaired() {
    let folder = TestFolder::new("update-damaged");
    let out = out_folder(&folder, "updated");
    let good = BakedCity::bake("update-good", city(), coarse_options(Path::new("")));
    good.write(&out);
    let check = |damage: &str| {
        bake(&updating(coarse_options(&out)), &Silent).unwrap();
        assert!(files(&out) == good.files, "{damage}");
    };
    // Without a valid city.json the folder is not a city and is not replaced.
    for (name, bytes) in good.files.iter().filter(|(name, _)| *name != "city.json") {
        for length in [bytes.len() / 2, 0] {
            fs::write(out.join(name), &bytes[..length]).unwrap();
            check(&format!("{name} cut to {length} bytes"));
        }
        fs::remove_file(out.join(name)).unwrap();
        check(&format!("missing {name}"));
    }
    let mut flipped = good.files["blockmaps.pmtiles"].clone();
    let tile = flipped.len() - 100;
    flipped[tile] ^= 1;
    fs::write(out.join("blockmaps.pmtiles"), flipped).unwrap();
    check("a damaged tile");
}

#[test]
fn an_updated_city_has_the_sets_and_the_picture_of_a_full_bake() {
    let with_sets = |out: &Path| BakeOptions { street_sets: true, picture: true, ..options(out, 2) };
    let folder = TestFolder::new("update-sets");
    let out = out_folder(&folder, "updated");
    bake_scene(city(), ReadReport::default(), &with_sets(&out), &Silent).unwrap();
    let baked = insula_archive::BakedCity::open(&out).unwrap();
    let stated = &baked.manifest().version;
    assert_eq!(insula_archive::city::content_version(&out, stated).unwrap(), *stated);
    let leaves = baked.blockmaps().lengths().filter(|(id, _)| id.level() == baked.manifest().depth);
    for (leaf, _) in leaves {
        let block = visibility_tile::block_of_leaf(leaf);
        let bytes = baked.tile(TileKind::Visibility, block).unwrap().unwrap();
        let tile = VisibilityTile::decode(block, &bytes).unwrap();
        let cell = tile.cells[tile.cell_index(leaf.x(), leaf.y()).unwrap()].as_ref().unwrap();
        let middle = cell.seen.len() / 2;
        assert_eq!(cell.seen[middle], 0, "{leaf} is seen from above itself");
    }
    let full = BakedCity::bake("update-sets-full", raised(city(), 2), with_sets(Path::new("")));
    let updated = bake_scene(raised(city(), 2), ReadReport::default(), &updating(with_sets(&out)), &Silent).unwrap();
    assert!(updated.blocks_unchanged > 0 && updated.blocks_baked > 0);
    assert!(files(&out) == full.files, "other bytes than a full bake");
}
