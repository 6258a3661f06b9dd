//! Tests of whole simplifications: goals are reached, and topology, borders and seams are kept.

use super::*;
use crate::model::{CornerLayer, NO_VALUE};
use crate::surface::Surface;
use insula_protocol::mesh::AttributeKind;

/// A sphere of radius 10 with `n` quads around, each split into two triangles.
fn sphere(n: u32) -> TriangleModel {
    let mut model = TriangleModel::default();
    let at = |i: u32, j: u32| {
        let (a, b) =
            (f64::from(i) / f64::from(n) * std::f64::consts::TAU, f64::from(j) / f64::from(n) * std::f64::consts::PI);
        [10.0 * b.sin() * a.cos(), 10.0 * b.sin() * a.sin(), 10.0 * b.cos()]
    };
    model.positions.push([0.0, 0.0, 10.0]);
    for j in 1..n {
        model.positions.extend((0..n).map(|i| at(i, j)));
    }
    model.positions.push([0.0, 0.0, -10.0]);
    let last = model.positions.len() as u32 - 1;
    let number = |i: u32, j: u32| 1 + (j - 1) * n + i % n;
    for i in 0..n {
        model.triangles.push([0, number(i, 1), number(i + 1, 1)]);
        model.triangles.push([last, number(i + 1, n - 1), number(i, n - 1)]);
        for j in 1..n - 1 {
            let [a, b, c, d] = [number(i, j), number(i, j + 1), number(i + 1, j + 1), number(i + 1, j)];
            model.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    model
}

/// A square of `n` x `n` quads with a hill, and texture coordinates with a seam in its middle.
fn hill(n: u32) -> TriangleModel {
    let mut model = TriangleModel::default();
    let mut layer = CornerLayer { kind: AttributeKind::TexCoord, width: 2, values: vec![], corners: vec![] };
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (f64::from(i), f64::from(j));
            let half = f64::from(n) / 2.0;
            model.positions.push([x, y, (-(x - half).powi(2) / half - (y - half).powi(2) / half).exp() * half]);
        }
    }
    for i in 0..n {
        for j in 0..n {
            let at = |i: u32, j: u32| i * (n + 1) + j;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            for triangle in [[a, b, c], [a, c, d]] {
                model.triangles.push(triangle);
                for vertex in triangle {
                    let [x, y, _] = model.positions[vertex as usize];
                    let seam_offset = if i >= n / 2 { 100.0 } else { 0.0 };
                    layer.values.push([x as f32 + seam_offset, y as f32, 0.0, 0.0]);
                    layer.corners.push(layer.values.len() as u32 - 1);
                }
            }
        }
    }
    model.layers.push(layer);
    model
}

/// The model's pieces, which must need no repair.
fn sound_pieces(model: &TriangleModel) -> HalfEdgeMesh {
    let pieces = HalfEdgeMesh::new(&model.triangles, model.positions.len() as u32);
    assert!(pieces.is_sound());
    let RepairReport { degenerate, duplicate, unused, .. } = pieces.report;
    assert_eq!([degenerate, duplicate, unused], [0; 3]);
    pieces
}

const UNLIMITED: f64 = f64::INFINITY;

#[test]
fn sphere_keeps_its_topology_and_shape() {
    let model = sphere(64);
    for share in [2, 10, 50] {
        let goal = model.triangles.len() / share;
        let out = simplify(&model, Goal { triangles: goal, error: UNLIMITED }, |_| false);
        let pieces = sound_pieces(&out.model);
        assert!(out.model.triangles.len().abs_diff(goal) <= 1, "{} of {goal}", out.model.triangles.len());
        assert_eq!((pieces.euler(), pieces.report.borders, pieces.report.pieces), (2, 0, 1));
        let off = out.model.positions.iter().map(|p| (DVec3::from(*p).length() - 10.0).abs()).fold(0.0, f64::max);
        assert!(off < 0.3 && out.error > 0.0 && out.error < 0.6, "{share}: {off}, {}", out.error);
    }
}

#[test]
fn error_stays_within_the_goal() {
    let model = sphere(64);
    let mut before = model.triangles.len();
    for error in [0.01, 0.05, 0.2] {
        let out = simplify(&model, Goal { triangles: 0, error }, |_| false);
        assert!(out.error <= error && out.model.triangles.len() < before);
        before = out.model.triangles.len();
    }
}

#[test]
fn a_limit_of_the_distance_is_kept_in_both_directions() {
    for model in [sphere(48), hill(32)] {
        let source = Surface::of_model(&model).unwrap();
        let mut before = model.triangles.len();
        for limit in [0.02, 0.1, 0.4] {
            let out = simplify_within(&model, &source, limit);
            let found = largest_distance(&source, &out.model);
            assert!(found <= limit && found > 0.2 * limit && out.error == found, "{found} {limit}");
            assert!(out.model.triangles.len() < before);
            before = out.model.triangles.len();
        }
        let untouched = simplify_within(&model, &source, 0.0);
        assert!(largest_distance(&source, &untouched.model) < 1e-9);
    }
}

#[test]
fn borders_and_seams_keep_their_places() {
    let n = 24;
    let model = hill(n);
    let out = simplify(&model, Goal { triangles: model.triangles.len() / 10, error: UNLIMITED }, |_| false);
    let pieces = sound_pieces(&out.model);
    assert_eq!((pieces.euler(), pieces.report.borders), (1, 1));
    assert!(out.model.triangles.len() <= model.triangles.len() / 10);
    // The border is a square at a height of nearly 0, and the seam runs through its middle.
    let side = f64::from(n);
    for &h in pieces.borders().iter().flatten() {
        let [x, y, _] = out.model.positions[pieces.vertex[pieces.origin[h as usize] as usize] as usize];
        let off = [x, y, side - x, side - y].map(f64::abs).into_iter().fold(UNLIMITED, f64::min);
        assert!(off < 0.05, "{off}");
    }
    let layer = &out.model.layers[0];
    for (corner, vertex) in out.model.triangles.as_flattened().iter().enumerate() {
        let [x, y, _] = out.model.positions[*vertex as usize];
        let [u, v, ..] = layer.values[layer.corners[corner] as usize].map(f64::from);
        let u = if u > 60.0 { u - 100.0 } else { u };
        assert!((u - x).abs() < 0.8 && (v - y).abs() < 0.8, "{u} {v} at {x} {y}");
    }
}

/// Root mean square difference of the texture coordinates of a model's corners from a function of their places.
fn texture_slide(model: &TriangleModel, uv: impl Fn([f64; 3]) -> [f64; 2]) -> f64 {
    let slide = |(corner, vertex): (usize, &u32)| {
        let [u, v, ..] = model.layers[0].value(corner).unwrap().map(f64::from);
        let [x, y] = uv(model.positions[*vertex as usize]);
        (u - x).powi(2) + (v - y).powi(2)
    };
    let corners = model.triangles.as_flattened();
    (corners.iter().enumerate().map(slide).sum::<f64>() / corners.len() as f64).sqrt()
}

/// The centres of triangles show how far the texture has moved between the corners.
fn with_centres(model: &TriangleModel) -> TriangleModel {
    let mut out = TriangleModel { layers: model.layers.clone(), ..TriangleModel::default() };
    let layer = &mut out.layers[0];
    layer.corners.clear();
    for (t, triangle) in model.triangles.iter().enumerate() {
        let mean = |of: &dyn Fn(usize, usize) -> f64, axis| (0..3).map(|k| of(k, axis)).sum::<f64>() / 3.0;
        let place = |k: usize, axis: usize| model.positions[triangle[k] as usize][axis];
        let texture = |k: usize, axis: usize| f64::from(model.layers[0].value(3 * t + k).unwrap()[axis]);
        out.positions.push([0, 1, 2].map(|axis| mean(&place, axis)));
        layer.values.push([mean(&texture, 0) as f32, mean(&texture, 1) as f32, 0.0, 0.0]);
        out.triangles.push([out.positions.len() as u32 - 1; 3]);
        layer.corners.extend([layer.values.len() as u32 - 1; 3]);
    }
    out
}

#[test]
fn a_bent_texture_on_a_plane_is_kept() {
    // The texture is straight on the left and bent on the right, so that triangles are needed there. The plane needs none:
    // without the texture, the slide is 0.14.
    let uv = |[x, y, _]: [f64; 3]| [if x > 16.0 { x + 0.05 * (x - 16.0).powi(2) } else { x }, y];
    let mut model = hill(32);
    model.positions.iter_mut().for_each(|p| p[2] = 0.0);
    for (corner, vertex) in model.triangles.as_flattened().iter().enumerate() {
        let [u, v] = uv(model.positions[*vertex as usize]);
        model.layers[0].values[corner] = [u as f32, v as f32, 0.0, 0.0];
    }
    let out = simplify(&model, Goal { triangles: model.triangles.len() / 20, error: UNLIMITED }, |_| false).model;
    sound_pieces(&out);
    let slide = texture_slide(&with_centres(&out), uv);
    assert!(slide < 0.03, "{slide}");
}

#[test]
fn corners_without_values_stay_without() {
    let mut model = hill(24);
    let has_texture = |model: &TriangleModel, t: usize| {
        model.triangles[t].iter().map(|vertex| model.positions[*vertex as usize][0]).sum::<f64>() < 3.0 * 12.0
    };
    for t in (0..model.triangles.len()).filter(|t| !has_texture(&model, *t)).collect::<Vec<_>>() {
        model.layers[0].corners[3 * t..3 * t + 3].fill(NO_VALUE);
    }
    let out = simplify(&model, Goal { triangles: model.triangles.len() / 10, error: UNLIMITED }, |_| false).model;
    sound_pieces(&out);
    assert!(out.triangles.len() <= model.triangles.len() / 10);
    for t in 0..out.triangles.len() {
        let values = [0, 1, 2].map(|k| out.layers[0].value(3 * t + k).is_some());
        assert_eq!(values, [has_texture(&out, t); 3]);
    }
}

#[test]
fn locked_vertices_keep_their_places() {
    let model = hill(16);
    let rim = |vertex: u32| {
        let [x, y, _] = model.positions[vertex as usize];
        [x, y].iter().any(|v| *v == 0.0 || *v == 16.0)
    };
    let out = simplify(&model, Goal { triangles: 1, error: UNLIMITED }, rim);
    sound_pieces(&out.model);
    for vertex in (0..model.positions.len() as u32).filter(|vertex| rim(*vertex)) {
        assert!(out.model.positions.contains(&model.positions[vertex as usize]));
    }
}

#[test]
fn small_boxes_are_removed_until_the_goal_is_reached() {
    const SIDES: [[u32; 3]; 12] = [
        [0, 1, 5],
        [0, 5, 4],
        [1, 3, 7],
        [1, 7, 5],
        [3, 2, 6],
        [3, 6, 7],
        [2, 0, 4],
        [2, 4, 6],
        [4, 5, 7],
        [4, 7, 6],
        [0, 3, 1],
        [0, 2, 3],
    ];
    let mut model = TriangleModel::default();
    for i in 0..200u32 {
        let first = model.positions.len() as u32;
        let (x, y, side) = (f64::from(i % 20) * 50.0, f64::from(i / 20) * 50.0, 1.0 + f64::from(i * 7 % 40));
        let corner = |k: u32| [x + f64::from(k & 1) * side, y + f64::from(k >> 1 & 1) * side, f64::from(k >> 2) * side];
        model.positions.extend((0..8).map(corner));
        model.triangles.extend(SIDES.map(|t| t.map(|k| first + k)));
    }
    for goal in [1200, 240, 24] {
        let out = simplify(&model, Goal { triangles: goal, error: UNLIMITED }, |_| false);
        sound_pieces(&out.model);
        let found = out.model.triangles.len();
        assert!(found <= goal && found + 12 > goal, "{found} of {goal}");
        assert!(out.removed_parts > 0);
    }
    let out = simplify(&model, Goal { triangles: 0, error: 5.0 }, |_| false);
    assert!(out.removed_parts > 20 && out.removed_parts < 100 && out.error <= 5.0, "{}", out.removed_parts);
}

#[test]
fn two_edges_between_the_same_vertices_are_no_endless_loop() {
    // Four triangles at one edge, connected around one of its ends.
    let triangles = vec![[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5], [5, 0, 2], [3, 0, 4], [2, 1, 6], [6, 1, 3]];
    let positions = vec![
        [0.0, 0.0, 1.0],
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.5],
        [0.0, 1.0, 0.5],
        [-1.0, 0.0, 0.5],
        [0.0, -1.0, 0.5],
        [1.0, 1.0, 0.0],
    ];
    for turn in 0..triangles.len() {
        let mut triangles: Vec<[u32; 3]> = triangles.clone();
        triangles.rotate_left(turn);
        let model = TriangleModel { positions: positions.clone(), triangles, layers: vec![] };
        for locked in 0..8 {
            let out = simplify(&model, Goal { triangles: 0, error: f64::INFINITY }, |vertex| vertex == locked);
            assert!(out.model.triangles.len() <= 8);
        }
    }
}
