//! Chooses the level of detail of an object, and which of its surfaces count where some are given twice.

use super::gather::{Faults, Gatherer, Piece, PieceGeometry, Scene, faces_of};
use super::plan::{LEVELS, Level, Plan};
use super::tree::Tree;
use insula_dress::palette::area_vector;
use insula_source::object::SurfaceRole;
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::Range;

/// Surfaces of an object with this part of the area of its thematic surfaces, but none in common, show the same again.
const SAME_AREA: f64 = 0.5;
/// Surfaces with this multiple of the area of the thematic surfaces show what those leave out.
const MORE_AREA: f64 = 1.5;

/// The surfaces of an object at its best level of detail.
#[derive(Debug, Default)]
pub(super) struct Chosen {
    pub(super) level: Option<u8>,
    pub(super) pieces: Vec<Piece>,
    /// Coordinate system of the surfaces, if they tell it.
    pub(super) srs: Option<String>,
    pub(super) has_lines: bool,
    pub(super) faults: Faults,
}

/// Chooses the surfaces of the object at `node`, with those of its installations. Surfaces in `excluded` belong to its
/// parts.
pub(super) fn choose(scene: Scene<'_>, plan: &Plan, excluded: &[Range<u32>]) -> Chosen {
    let mut extra = choose_all(scene, &plan.installations);
    let used: HashSet<u32> = faces_of(&extra.pieces).collect();
    let mut chosen = best_level(scene, plan, excluded, &used);
    chosen.has_lines |= plan.has_lines;
    if chosen.pieces.is_empty() && extra.pieces.is_empty() {
        extra = choose_all(scene, &plan.constructions);
    }
    chosen.level = chosen.level.or(extra.level);
    chosen.srs = chosen.srs.or(extra.srs);
    chosen.pieces.append(&mut extra.pieces);
    chosen.faults.add(extra.faults);
    chosen
}

/// The surfaces of all of several objects, each at its best level.
fn choose_all(scene: Scene<'_>, nodes: &[u32]) -> Chosen {
    let mut all = Chosen::default();
    for node in nodes {
        let plan = Plan::new(scene.tree, scene.names, *node);
        let mut chosen = choose(scene, &plan, &[]);
        all.level = all.level.max(chosen.level);
        all.srs = all.srs.or(chosen.srs);
        all.pieces.append(&mut chosen.pieces);
        all.faults.add(chosen.faults);
    }
    all
}

fn best_level(scene: Scene<'_>, plan: &Plan, excluded: &[Range<u32>], used: &HashSet<u32>) -> Chosen {
    let mut best = Chosen::default();
    for level in (0..LEVELS).rev() {
        let mut gatherer = Gatherer::new(scene, excluded, used.clone());
        let pieces = pieces_of_level(&mut gatherer, &plan.levels[level]);
        best.has_lines |= gatherer.has_lines;
        let is_usable = pieces.iter().any(|piece| has_surface(scene.tree, piece));
        if is_usable {
            best.faults = gatherer.faults;
            best.srs = gatherer.srs.map(str::to_owned);
            best.level = Some(level as u8);
            best.pieces = pieces;
            return best;
        }
        // Faulty surfaces are kept for their problems, in case no level has better ones.
        if best.pieces.is_empty() {
            best.pieces = pieces;
            best.faults.add(gatherer.faults);
        }
    }
    best
}

fn pieces_of_level(gatherer: &mut Gatherer<'_>, level: &Level) -> Vec<Piece> {
    let (mut bounded, mut closures, mut own) = (Vec::new(), Vec::new(), Vec::new());
    for (property, role) in &level.bounded {
        gatherer.gather(*property, *role, &mut bounded);
    }
    for property in &level.closures {
        gatherer.gather(*property, SurfaceRole::Other, &mut closures);
    }
    gatherer.repeated = 0;
    for property in &level.own {
        gatherer.gather(*property, SurfaceRole::Other, &mut own);
    }
    if own.is_empty() && bounded.is_empty() {
        for property in &level.roof_edges {
            gatherer.gather(*property, SurfaceRole::Roof, &mut own);
        }
    }
    let mut pieces = join(gatherer.scene().tree, bounded, own, &closures, gatherer.repeated);
    if pieces.is_empty() {
        pieces = closures;
    }
    pieces
}

/// Joins thematic surfaces and the object's own ones, which may repeat them: by reference (then they are left out
/// already), as copies, or as another model of the same.
fn join(tree: &Tree, mut bounded: Vec<Piece>, mut own: Vec<Piece>, closures: &[Piece], repeated: u32) -> Vec<Piece> {
    if bounded.is_empty() || own.is_empty() {
        bounded.append(&mut own);
        return bounded;
    }
    let keys: HashSet<u64> = bounded.iter().chain(closures).filter_map(|piece| key_of(tree, piece)).collect();
    let count = own.len();
    own.retain(|piece| key_of(tree, piece).is_none_or(|key| !keys.contains(&key)));
    if repeated == 0 && own.len() == count {
        let (own_area, bounded_area) = (area_of(tree, &own), area_of(tree, &bounded));
        if own_area > bounded_area * MORE_AREA {
            return own;
        }
        if own_area >= bounded_area * SAME_AREA {
            return bounded;
        }
    }
    bounded.append(&mut own);
    bounded
}

/// Leaves out the surfaces of an object that its parts repeat as copies.
pub(super) fn remove_copies(tree: &Tree, pieces: &mut Vec<Piece>, parts: &[Piece]) {
    let keys: HashSet<u64> = parts.iter().filter_map(|piece| key_of(tree, piece)).collect();
    pieces.retain(|piece| key_of(tree, piece).is_none_or(|key| !keys.contains(&key)));
}

/// A number that two faces of the same outline have in common, whatever their first point and orientation.
fn key_of(tree: &Tree, piece: &Piece) -> Option<u64> {
    let PieceGeometry::Face(face) = piece.geometry else { return None };
    let points = open_ring(tree.points_of(tree.rings_of(face).first()?));
    if piece.placement.is_some() || points.is_empty() {
        return None;
    }
    let hash = |point: &[f64; 3]| {
        let mut hasher = DefaultHasher::new();
        point.map(f64::to_bits).hash(&mut hasher);
        hasher.finish()
    };
    Some(points.iter().fold(points.len() as u64, |key, point| key.wrapping_add(hash(point))))
}

/// A ring without the repetition of its first point.
pub(super) fn open_ring(points: &[[f64; 3]]) -> &[[f64; 3]] {
    match points {
        [first, rest @ .., last] if first == last && !rest.is_empty() => &points[..points.len() - 1],
        points => points,
    }
}

fn has_surface(tree: &Tree, piece: &Piece) -> bool {
    match &piece.geometry {
        PieceGeometry::Face(face) => {
            let outer = tree.rings_of(*face).first().map_or(&[][..], |ring| open_ring(tree.points_of(ring)));
            outer.len() >= 3 && outer.iter().flatten().all(|value| value.is_finite())
        }
        PieceGeometry::Triangles(range) => !range.is_empty(),
        PieceGeometry::Stored(geometry) => geometry.points > 0,
    }
}

/// Area of faces in square units of the file: good for ratios only.
fn area_of(tree: &Tree, pieces: &[Piece]) -> f64 {
    let of_ring = |points: &[[f64; 3]]| area_vector(points).length();
    let areas = pieces.iter().map(|piece| match &piece.geometry {
        PieceGeometry::Face(face) => tree.rings_of(*face).first().map_or(0.0, |ring| of_ring(tree.points_of(ring))),
        PieceGeometry::Triangles(range) => {
            let points = tree.points.get(range.start as usize..range.end as usize).unwrap_or(&[]);
            points.chunks_exact(3).map(of_ring).sum()
        }
        PieceGeometry::Stored(_) => 0.0,
    });
    areas.filter(|area| area.is_finite()).sum()
}
