//! A picture from above lies where it belongs: numbered squares on hills, in meshes and in columns of all levels, against
//! the ray-traced hills with the same picture.

use anyhow::{Context, Result, ensure};
use glam::{DMat2, DVec2, DVec3};
use insula_bake::read::{Palette, PaletteMode, ReadOptions, TerrainOptions};
use insula_bake::sample::SampleSettings;
use insula_bake::scene::{Material, ObjectKind, Scene, SceneObject, SceneTexture, SceneTriangle};
use insula_bake::{BakeOptions, Silent};
use insula_protocol::TileId;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_test_support::folder::TestFolder;
use insula_tests::baked::Baked;
use insula_tests::trials::Trials;
use insula_tests::truth::Truth;
use insula_tests::view::{Camera, FrameSpec};
use insula_tests::{compare, tests};
use insula_viewer::frame::STILL_SAMPLES;
use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::RGB8;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![pictures_from_above_lie_where_they_belong]);
}

/// South-western corner of the map, in EPSG:25832.
const CORNER: [f64; 2] = [500_032.0, 5_400_096.0];
const SIDE_M: f64 = 192.0;
/// The picture's texels.
const TEXEL_M: f64 = 0.25;
const TEXELS: usize = (SIDE_M / TEXEL_M) as usize;
/// Side of a numbered square, and of the dots of its digits.
const SQUARE_M: f64 = 8.0;
const DOT_M: f64 = 1.0;
/// Distance of the elevation model's points.
const STEP_M: f64 = 2.0;
const SPEC: FrameSpec = FrameSpec { width_px: 384, height_px: 256, shading: Shading::Albedo, samples: STILL_SAMPLES };
/// Side of the windows whose shifts are measured.
const WINDOW_PX: u32 = 32;
/// Digits 0 to 9 as five rows of three dots, the top row first.
const DIGITS: [u16; 10] = [0o75557, 0o26227, 0o71747, 0o71717, 0o55711, 0o74717, 0o74757, 0o71222, 0o75757, 0o75717];

/// Hills with slopes of up to 40%.
fn hills_m(x: f64, y: f64) -> f64 {
    60.0 + 7.0 * (x / 23.0).sin() + 6.0 * (y / 31.0 + x / 90.0).cos() + 0.08 * x
}

/// 8-bit sRGB of the picture at a distance from its south-western corner.
fn picture(x: f64, y: f64) -> [u8; 3] {
    let square = [x, y].map(|along| (along / SQUARE_M) as u32);
    let number = square[1] * 24 + square[0];
    let mixed = number.wrapping_mul(0x9E37_79B9) >> 8;
    // As different as fields and roofs.
    let ground = [0, 1, 2].map(|k| 95 + (mixed >> (8 * k) & 63) as u8);
    // Two digits of three dots and one between, one dot from the western edge and 1.5 from the southern one.
    let [column, row] = [x % SQUARE_M - 0.5, y % SQUARE_M - 1.5].map(|along| (along / DOT_M).floor() as i32);
    let (digit, dot) = (column.div_euclid(4), column.rem_euclid(4));
    let is_digit = (0..2).contains(&digit) && dot < 3 && (0..5).contains(&row);
    let value = if digit == 0 { number / 10 % 10 } else { number % 10 };
    let is_set = is_digit && DIGITS[value as usize] >> (3 * row + 2 - dot) & 1 == 1;
    if is_set { ground.map(|channel| channel - 45) } else { ground }
}

/// The picture's rows from the north.
fn picture_rows() -> Vec<[u8; 3]> {
    let middle = |texel: usize| (texel as f64 + 0.5) * TEXEL_M;
    (0..TEXELS * TEXELS).map(|i| picture(middle(i % TEXELS), middle(TEXELS - 1 - i / TEXELS))).collect()
}

/// Writes the picture, with its place beside it.
fn write_picture(folder: &Path) -> Result<()> {
    let mut encoder = TiffEncoder::new(fs::File::create(folder.join("photo.tif"))?)?;
    encoder.write_image::<RGB8>(TEXELS as u32, TEXELS as u32, picture_rows().as_flattened())?;
    // Sides and middle of the north-western texel.
    let [west, north] = [CORNER[0] + TEXEL_M / 2.0, CORNER[1] + SIDE_M - TEXEL_M / 2.0];
    fs::write(folder.join("photo.tfw"), format!("{TEXEL_M}\n0\n0\n-{TEXEL_M}\n{west}\n{north}\n"))?;
    Ok(fs::write(folder.join("photo.prj"), "EPSG:25832")?)
}

fn write_hills(folder: &Path) -> Result<()> {
    let count = (SIDE_M / STEP_M) as usize + 1;
    let mut text =
        format!("ncols {count}\nnrows {count}\nxllcenter {}\nyllcenter {}\ncellsize {STEP_M}\n", CORNER[0], CORNER[1]);
    for row in (0..count).rev() {
        for column in 0..count {
            write!(text, "{:.4} ", hills_m(column as f64 * STEP_M, row as f64 * STEP_M))?;
        }
        text.push('\n');
    }
    fs::write(folder.join("dem.asc"), text)?;
    Ok(fs::write(folder.join("dem.prj"), "EPSG:25832")?)
}

/// The model's surface with the picture on it.
fn truth() -> Truth {
    let count = (SIDE_M / STEP_M) as u32;
    let point = |column: u32, row: u32| {
        let [x, y] = [column, row].map(|n| f64::from(n) * STEP_M);
        [x as f32, y as f32, hills_m(x, y) as f32]
    };
    let mut triangles = Vec::new();
    for row in 0..count {
        for column in 0..count {
            let [a, b, c, d] = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| point(column + x, row + y));
            for corners in [[a, b, d], [a, d, c]] {
                let uv = corners.map(|corner| [corner[0] / SIDE_M as f32, corner[1] / SIDE_M as f32]);
                triangles.push(SceneTriangle { corners, uv, material: 0, object: 0 });
            }
        }
    }
    let side = TEXELS as u32;
    let texture = SceneTexture { width: side, height: side, rgb: picture_rows(), is_pattern: false };
    Truth::new(Scene {
        origin: [CORNER[0], CORNER[1], 0.0],
        triangles,
        objects: vec![SceneObject { id: "hills".into(), kind: ObjectKind::Terrain, base_z_m: 0.0 }],
        materials: vec![Material { rgb: [255; 3], texture: Some(Arc::new(texture)), is_reflective: false }],
        ..Scene::default()
    })
}

/// A camera above a place of the map.
fn above(x: f64, y: f64, height_m: f64) -> Camera {
    let at = |x: f64, y: f64, z: f64| DVec3::new(CORNER[0] + x, CORNER[1] + y, z);
    let ground_m = hills_m(x, y);
    Camera::looking(at(x, y - height_m * 0.3, ground_m + height_m), at(x, y, ground_m))
}

fn luma([r, g, b]: [u8; 3]) -> f64 {
    0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)
}

/// The luma that each pixel has if the picture lies where it belongs on what is drawn; `None` where that has an edge, or at the sky.
fn expected_luma(camera: &Camera, drawn: &Pixels) -> Vec<Option<f64>> {
    /// Samples along a pixel's side.
    const SAMPLES: u32 = 4;
    let width = drawn.width_px;
    let on_map = |x: u32, y: u32| {
        let distance_m = f64::from(*drawn.distance.get((y * width + x) as usize)?);
        let hit = DVec3::from(camera.position) + camera.ray(&SPEC, x, y) * distance_m;
        distance_m.is_finite().then(|| hit.truncate() - DVec2::from(CORNER))
    };
    let pixel = |i: u32| {
        let (x, y) = (i % width, i / width);
        let (at, right, down) = (on_map(x, y)?, on_map(x + 1, y)?, on_map(x, y + 1)?);
        let (right, down) = (right - at, down - at);
        if x + 1 == width || right.length().max(down.length()) > 3.0 * right.length().min(down.length()) {
            return None;
        }
        let samples = (0..SAMPLES * SAMPLES).map(|s| {
            let [a, b] = [s % SAMPLES, s / SAMPLES].map(|k| (f64::from(k) + 0.5) / f64::from(SAMPLES) - 0.5);
            let place = (at + right * a + down * b).clamp(DVec2::ZERO, DVec2::splat(SIDE_M - 1e-6));
            luma(picture(place.x, place.y))
        });
        Some(samples.sum::<f64>() / f64::from(SAMPLES * SAMPLES))
    };
    (0..width * drawn.height_px).map(pixel).collect()
}

/// Shift in pixels between two pictures in a window, by least squares (Lucas and Kanade 1981); `None` if little of the window is
/// known, or it has few edges.
fn shift_px(expected: &[Option<f64>], drawn: &Pixels, [left, top]: [u32; 2]) -> Option<DVec2> {
    let (mut normal, mut right, mut known) = (DMat2::ZERO, DVec2::ZERO, 0);
    let place = |x: u32, y: u32| (y * drawn.width_px + x) as usize;
    let drawn_luma = |x: u32, y: u32| {
        let [r, g, b, _] = drawn.colour[place(x, y)].to_le_bytes();
        luma([r, g, b])
    };
    for y in top + 1..top + WINDOW_PX - 1 {
        for x in left + 1..left + WINDOW_PX - 1 {
            let mean = |x: u32, y: u32| Some((expected[place(x, y)]? + drawn_luma(x, y)) / 2.0);
            let along = |low: Option<f64>, high: Option<f64>| Some((high? - low?) / 2.0);
            let (slope_x, slope_y) = (along(mean(x - 1, y), mean(x + 1, y)), along(mean(x, y - 1), mean(x, y + 1)));
            let (Some(slope_x), Some(slope_y), Some(value)) = (slope_x, slope_y, expected[place(x, y)]) else {
                continue;
            };
            let slope = DVec2::new(slope_x, slope_y);
            normal += DMat2::from_cols(slope * slope.x, slope * slope.y);
            right += slope * (value - drawn_luma(x, y));
            known += 1;
        }
    }
    (known > WINDOW_PX * WINDOW_PX / 2 && normal.determinant() > 1e6).then(|| normal.inverse() * right)
}

/// How a view differs from the truth.
#[derive(Debug)]
struct Difference {
    psnr_db: f64,
    /// Largest shift of a window, in texels.
    shift_texels: f64,
    windows: usize,
}

fn compare_view(
    truth: &Truth,
    baked: &Baked,
    camera: &Camera,
    ids: &[TileId],
    lod: impl Fn(TileId) -> Option<u8>,
    texel_m: f64,
) -> Result<Difference> {
    let drawn = baked.draw_list_with_meshes(ids, lod)?.scene(camera, &SPEC).render();
    let mut reference = truth.render(camera, &SPEC);
    let is_textured;
    (reference.colour, is_textured) = truth.albedo(camera, &SPEC, 4);
    let counts = |i: usize| is_textured[i] && drawn.distance[i].is_finite();
    let colour = compare::colour(&reference, &drawn, counts)?.context("no pixels")?;
    let focal_px = f64::from(SPEC.height_px) / (2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan());
    let (mut shift_texels, mut windows) = (0.0_f64, 0);
    let expected = expected_luma(camera, &drawn);
    for top in (0..SPEC.height_px).step_by(WINDOW_PX as usize) {
        for left in (0..SPEC.width_px).step_by(WINDOW_PX as usize) {
            let Some(shift) = shift_px(&expected, &drawn, [left, top]) else { continue };
            let middle = ((top + WINDOW_PX / 2) * SPEC.width_px + left + WINDOW_PX / 2) as usize;
            let px_m = f64::from(drawn.distance[middle]) / focal_px;
            shift_texels = shift_texels.max(shift.length() * px_m / texel_m);
            windows += 1;
        }
    }
    if let Some(folder) = std::env::var_os("INSULA_DRAPE_OUT") {
        let name = format!("{texel_m}-{:.0}.png", camera.position[2]);
        compare::side_by_side(&reference, &drawn, baked.manifest().cell_m).save(Path::new(&folder).join(name))?;
    }
    Ok(Difference { psnr_db: colour.psnr_db, shift_texels, windows })
}

fn pictures_from_above_lie_where_they_belong() -> Result<()> {
    let folder = TestFolder::new("drape");
    write_hills(&folder.path)?;
    write_picture(&folder.path)?;
    let out = folder.path.join("city");
    let options = BakeOptions {
        inputs: ["dem.asc", "photo.tif"].map(|name| folder.path.join(name)).into(),
        out: out.clone(),
        read: ReadOptions {
            palette: Palette { mode: PaletteMode::Source, ..Palette::default() },
            terrain: TerrainOptions { texel_m: TEXEL_M, ..TerrainOptions::default() },
            ..ReadOptions::default()
        },
        sample: SampleSettings { sky_directions: 16, low_directions: 16, ..SampleSettings::default() },
        ..BakeOptions::default()
    };
    insula_bake::bake(&options, &Silent).context("bake")?;
    let (truth, baked) = (truth(), Baked::open(&out)?);
    let depth = baked.manifest().depth;

    // From near, over a corner where four leaves meet, and over the middle of one.
    let leaves = baked.ids(depth);
    ensure!(leaves.len() >= 9 && leaves.iter().all(|id| baked.lods(*id) > 0), "each leaf has a mesh");
    for [x, y] in [[96.0, 96.0], [64.0, 128.0], [40.0, 50.0]] {
        let near = compare_view(&truth, &baked, &above(x, y, 45.0), &leaves, |_| Some(0), TEXEL_M)?;
        println!("meshes at {x}, {y}: {near:?}");
        ensure!(near.windows >= 20 && near.shift_texels <= 0.5, "meshes at {x}, {y}: {near:?}");
        ensure!(near.psnr_db >= 30.0, "meshes at {x}, {y}: {near:?}");
    }
    // All levels that show squares, each from where a column has three pixels.
    for level in (0..=depth).rev().take(3) {
        let cell_m = baked.manifest().node_side_m(level) / 64.0;
        let ids = baked.ids(level);
        let focal_px = f64::from(SPEC.height_px) / (2.0 * 30.0_f64.to_radians().tan());
        let from = above(96.0, 96.0, cell_m * focal_px / 3.0);
        let whole = compare_view(&truth, &baked, &from, &ids, |_| None, cell_m)?;
        println!("columns of {cell_m} m: {whole:?}");
        ensure!(whole.windows > 0 && whole.shift_texels <= 0.5, "columns of {cell_m} m: {whole:?}");
    }
    Ok(())
}
