//! Objects that become a city, or are left out.

use super::*;
use crate::error::BakeError;
use crate::read::duplicates::DuplicateOption;
use crate::scene::SceneTexture;
use crate::scene::texture_store::TextureStore;
use insula_scratch::record_list::RecordScratch;
use insula_source::report::SourceFormat;
use insula_test_support::folder::TestFolder;
use std::sync::Arc;

fn face_at(p: [f64; 3]) -> WorldTriangle {
    let corners = [p, [p[0] + 1.0, p[1], p[2]], [p[0], p[1] + 1.0, p[2] + 2.0]];
    WorldTriangle { corners, uv: [[0.0; 2]; 3], material: 0, is_facade: false }
}

fn builder() -> SceneBuilder {
    SceneBuilder::new(TriangleStore::Memory(Vec::new()), 1.0)
}

fn report() -> Vec<SourceReport> {
    vec![SourceReport::new("a", SourceFormat::Obj, 0)]
}

#[test]
fn large_coordinates_keep_a_precision_of_a_millimetre() {
    let (mut builder, mut sources) = (builder(), report());
    let places = [[6_240_000.123, 457_604.591, 2.463], [6_256_000.789, 457_604.501, 37.481]];
    for place in places {
        builder.add(0, "a", ObjectKind::Building, &[face_at(place)], &mut sources[0]);
    }
    let scene = builder.finish(TextureStore::in_memory(), &mut sources).unwrap().into_scene().unwrap();
    assert_eq!(scene.origin, [6_248_000.0, 457_605.0, 2.0]);
    for (triangle, place) in scene.triangles.iter().zip(places) {
        for axis in 0..3 {
            let world = scene.origin[axis] + f64::from(triangle.corners[0][axis]);
            assert!((world - place[axis]).abs() < 1e-3, "{world} is not {}", place[axis]);
        }
    }
    assert_eq!([scene.triangles[0].object, scene.triangles[1].object], [0, 1]);
    assert!((scene.objects[1].base_z_m - 35.481).abs() < 1e-3);
}

#[test]
fn objects_far_from_the_city_are_left_out_and_reported() {
    let (mut builder, mut sources) = (builder(), report());
    for (id, x) in [("a", 500_000.0), ("remote", 0.0), ("b", 500_010.0)] {
        builder.add(0, id, ObjectKind::Terrain, &[face_at([x, 0.0, 0.0])], &mut sources[0]);
    }
    let scene = builder.finish(TextureStore::in_memory(), &mut sources).unwrap().into_scene().unwrap();
    let ids: Vec<_> = scene.objects.iter().map(|object| object.id.as_str()).collect();
    assert_eq!(ids, ["a", "b"]);
    assert_eq!(scene.triangles.len(), 2);
    assert_eq!(scene.triangles[1].object, 1);
    assert_eq!((sources[0].objects, sources[0].triangles, sources[0].terrain_triangles), (2, 2, 2));
    assert_eq!(sources[0].skipped["far from the city"].first, ["remote: 500 km away"]);
}

#[test]
fn of_cities_on_two_continents_one_is_baked_and_the_others_are_named() {
    // The median along x is of the one, that along y of the other.
    for places in [[[0.0, 9e6], [8e6, 0.0]], [[8e6, 0.0], [0.0, 9e6]]] {
        let (mut builder, mut sources) = (builder(), report());
        for (id, [x, y]) in ["first", "second"].into_iter().zip(places) {
            builder.add(0, id, ObjectKind::Building, &[face_at([x + 5e5, y, 0.0])], &mut sources[0]);
        }
        let scene = builder.finish(TextureStore::in_memory(), &mut sources).unwrap().into_scene().unwrap();
        let baked: Vec<_> = scene.objects.iter().map(|object| object.id.as_str()).collect();
        assert_eq!(baked, ["first"]);
        assert_eq!(sources[0].skipped["far from the city"].first, ["second: 9000 km away"]);
    }
}

#[test]
fn objects_too_large_for_the_cells_are_left_out_and_reported() {
    let (mut builder, mut sources) = (builder(), report());
    let mut add = |id: &str, faces: &[WorldTriangle]| {
        builder.add(0, id, ObjectKind::Building, faces, &mut sources[0]);
    };
    let tall = |z: f64| {
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, z]];
        WorldTriangle { corners, uv: [[0.0; 2]; 3], material: 0, is_facade: false }
    };
    add("spike", &[tall(40_000.0)]);
    add("pile", &vec![tall(10_000.0); 2000]);
    add("tower", &[tall(10_000.0)]);
    let wide = [[0.0; 3], [500_000.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    add("wide", &[WorldTriangle { corners: wide, ..tall(1.0) }]);
    let dot = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]];
    add("dot", &[WorldTriangle { corners: dot, ..tall(1.0) }]);
    let mut open = OpenObject::new(ObjectKind::Building);
    builder.push(&mut open, &[tall(1.0)]);
    builder.abandon(0, "broken", open);
    builder.add(0, "last", ObjectKind::Building, &[tall(2.0)], &mut sources[0]);
    let scene = builder.finish(TextureStore::in_memory(), &mut sources).unwrap().into_scene().unwrap();
    let ids: Vec<_> = scene.objects.iter().map(|object| object.id.as_str()).collect();
    assert_eq!(ids, ["tower", "dot", "last"]);
    assert_eq!(scene.triangles.iter().map(|triangle| triangle.object).collect::<Vec<_>>(), [0, 1, 2]);
    assert_eq!((sources[0].objects, sources[0].triangles), (3, 3));
    let first = |reason: &str| sources[0].skipped[reason].first[0].clone();
    assert!(first("too tall for the cell size").starts_with("spike: 40000 cells"));
    assert!(first("too much surface for the cell size").starts_with("pile: "));
    assert_eq!(first("larger than 400 km"), "wide: 500 km");
    assert_eq!(sources[0].problems["smaller than a quarter of a cell"].first, ["dot"]);
}

#[test]
fn equal_materials_are_shared_and_terrain_faces_up() {
    let (mut builder, mut sources) = (builder(), report());
    let mut textures = TextureStore::in_memory();
    let texture = textures.add(Arc::new(SceneTexture { width: 1, height: 1, rgb: vec![[1, 2, 3]], is_pattern: false }));
    let plain = StoredMaterial::matt([9; 3], None);
    let number = builder.material(plain);
    assert_ne!(number, builder.material(StoredMaterial { texture: Some(texture), ..plain }));
    assert_ne!(number, builder.material(StoredMaterial { is_reflective: true, ..plain }));
    assert_eq!(number, builder.material(plain));
    let mut face = face_at([0.0; 3]);
    face.corners.swap(1, 2);
    builder.add(0, "t", ObjectKind::Terrain, &[face], &mut sources[0]);
    let scene = builder.finish(textures, &mut sources).unwrap().into_scene().unwrap();
    let [a, b, c] = scene.triangles[0].corners;
    assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0);
    assert_eq!(scene.materials.len(), 3);
}

#[test]
fn objects_in_scratch_files_make_the_same_city() {
    let folder = TestFolder::new("scene-builder-files");
    let build = |mut builder: SceneBuilder| {
        let mut sources = report();
        // More than the pages in memory, twice: of the second half, every other one is left out as a duplicate of one in the first.
        for i in 0..20_000_u32 {
            let (place, shift) = (f64::from(i % 10_000), if i >= 10_000 && i % 2 == 1 { 3.0 } else { 0.0 });
            let face = face_at([4e5 + place % 100.0 * 20.0 + shift, 5e6 + (place / 100.0).floor() * 20.0, 7.0]);
            builder.add(0, &format!("house {}", i % 10_000), ObjectKind::Building, &[face], &mut sources[0]);
            if i == 9000 {
                // A source that fails behind its first object.
                let mark = builder.len();
                builder.add(0, "bad", ObjectKind::Building, &[face_at([4e5; 3])], &mut sources[0]);
                builder.abandon_since(mark).unwrap();
                sources[0].objects -= 1;
                sources[0].triangles -= 1;
            }
        }
        builder.drop_outside([4e5, 5e6], [4.01e5, 5.1e6], &mut sources).unwrap();
        builder.drop_duplicates(DuplicateOption::KeepFirst, &mut sources).unwrap();
        let city = builder.finish(TextureStore::in_memory(), &mut sources).unwrap();
        let (mut objects, mut placements) = (Vec::new(), Vec::new());
        let read = city.objects.try_for_each(|_, object| {
            objects.push(*object);
            Ok::<_, BakeError>(())
        });
        read.unwrap();
        let read = city.placements.try_for_each(|_, placement| {
            placements.push((placement.offset_m, placement.object));
            Ok::<_, BakeError>(())
        });
        read.unwrap();
        (city.origin, city.bounds, objects, placements, format!("{sources:?}"))
    };
    let mut in_files = builder();
    in_files.keep_in(&RecordScratch::in_folder(&folder.path));
    let (memory, files) = (build(builder()), build(in_files));
    // Columns 0 to 49 and that on the border; the even ones of the second half are duplicates.
    assert_eq!((memory.2.len(), memory.3.len()), (5100 + 2500, 20_002));
    assert!(memory == files);
}

#[test]
fn an_object_is_left_out_for_one_that_is_kept() {
    let slab = |x: f64| {
        let [a, b, c, d] = [[x, 0.0, 5.0], [x + 10.0, 0.0, 5.0], [x + 10.0, 10.0, 5.0], [x, 10.0, 5.0]];
        [[a, b, c], [a, c, d]].map(|corners| WorldTriangle { corners, ..face_at(a) })
    };
    // The objects that are kept of slabs at these places, each of a level of detail.
    let kept = |slabs: &[(f64, f32)], option| -> Vec<String> {
        let (mut builder, mut sources) = (builder(), report());
        for (number, (x, lod)) in slabs.iter().enumerate() {
            let mut open = OpenObject::new(ObjectKind::Building);
            builder.push(&mut open, &slab(*x));
            let relation = ObjectRelation { lod: Some(*lod), ..ObjectRelation::default() };
            builder.close_related(0, &number.to_string(), open, relation, &mut sources[0]);
        }
        builder.drop_duplicates(option, &mut sources).unwrap();
        let scene = builder.finish(TextureStore::in_memory(), &mut sources).unwrap().into_scene().unwrap();
        assert_eq!(sources[0].duplicates.count as usize, slabs.len() - scene.objects.len());
        scene.objects.iter().map(|object| object.id.to_string()).collect()
    };
    let (first, best) = (DuplicateOption::KeepFirst, DuplicateOption::KeepBestLevel);
    // Slabs 0.2 m apart are alike, those 0.4 m apart are not.
    assert_eq!(kept(&[(0.0, 1.0), (0.2, 1.0), (0.4, 1.0)], first), ["0", "2"]);
    assert_eq!(kept(&[(0.2, 1.0), (0.0, 1.0), (0.4, 1.0)], first), ["0"]);
    assert_eq!(kept(&[(0.0, 1.0), (0.2, 2.0), (0.4, 3.0)], best), ["0", "2"]);
    assert_eq!(kept(&[(0.0, 1.0), (0.2, 3.0), (0.4, 2.0)], best), ["1"]);
    assert_eq!(kept(&[(0.0, 1.0), (0.2, 1.0), (0.2, 1.0)], first), ["0"], "a copy is what the other one is");
}
