//! Collects the surfaces of geometry properties, through references, once each.

use super::appearance::Appearances;
use super::names::{Class, Names};
use super::placement::matrix_of;
use super::store::{Store, StoredGeometry};
use super::tree::{AttributeKind, Content, Tree, hash_of_reference};
use crate::degrees::TemplatePlace;
use insula_source::affine::{Affine, TRANSPOSED};
use insula_source::object::SurfaceRole;
use insula_source::problems::SEVERAL_SYSTEMS;
use std::collections::HashSet;
use std::ops::Range;
use std::rc::Rc;

/// Deeper geometry, counted through references, is left out.
const MAX_DEPTH: u32 = 300;
/// Further points of an object are left out: few bytes can place a large template many times.
const MAX_OBJECT_POINTS: usize = 2 << 20;

/// Kind of a matrix in a report that cannot be read.
pub(super) const BAD_MATRIX: &str = "transformationMatrix malformed, template not turned";

/// What surfaces are made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene<'s> {
    pub(super) tree: &'s Tree,
    pub(super) names: &'s Names,
    pub(super) appearances: &'s Appearances,
    /// Geometry of other objects.
    pub(super) store: &'s Store,
}

#[derive(Debug, Clone)]
pub(super) enum PieceGeometry {
    /// Index of a face.
    Face(u32),
    /// Indices of points, three for each triangle.
    Triangles(Range<u32>),
    Stored(Rc<StoredGeometry>),
}

/// A surface, or many of the same looks.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub(super) geometry: PieceGeometry,
    pub(super) is_reversed: bool,
    pub(super) role: SurfaceRole,
    /// Number in [`Appearances`].
    pub(super) material: Option<u32>,
    pub(super) placement: Option<Rc<TemplatePlace>>,
}

/// Faults of an object's geometry.
#[derive(Debug, Clone, Default)]
pub(super) struct Faults {
    counts: Vec<(&'static str, u32)>,
}

impl Faults {
    pub(super) fn note(&mut self, kind: &'static str) {
        match self.counts.iter_mut().find(|(known, _)| *known == kind) {
            Some((_, count)) => *count = count.saturating_add(1),
            None => self.counts.push((kind, 1)),
        }
    }

    pub(super) fn add(&mut self, other: Self) {
        for (kind, count) in other.counts {
            self.note(kind);
            if let Some((_, known)) = self.counts.iter_mut().find(|(known, _)| *known == kind) {
                *known = known.saturating_add(count - 1);
            }
        }
    }

    /// Kinds with how often each occurred.
    pub(super) fn iter(&self) -> impl Iterator<Item = (&'static str, u32)> + '_ {
        self.counts.iter().copied()
    }
}

pub(super) const UNRESOLVED: &str = "reference to a surface that the file does not have";
pub(super) const LIBRARY: &str = "geometry in a library file not read";
pub(super) const TOO_DEEP: &str = "surfaces nested too deeply";
pub(super) const TOO_MANY: &str = "too many points in one object";

/// Properties that elements hand down to the surfaces within them.
#[derive(Debug, Clone)]
struct Inherited<'s> {
    role: SurfaceRole,
    is_reversed: bool,
    material: Option<u32>,
    srs: Option<&'s str>,
    placement: Option<Rc<TemplatePlace>>,
}

/// Collects surfaces of one object at one level of detail.
pub(super) struct Gatherer<'s> {
    scene: Scene<'s>,
    /// Elements of other objects, ascending, whose surfaces are theirs.
    excluded: &'s [Range<u32>],
    /// Faces that are collected.
    used: HashSet<u32>,
    /// Targets of references that are collected.
    expanded: HashSet<u32>,
    /// Number of surfaces that were met again, or are those of other objects.
    pub(super) repeated: u32,
    points_left: usize,
    /// Coordinate system of the first surface that tells it.
    pub(super) srs: Option<&'s str>,
    pub(super) has_lines: bool,
    pub(super) faults: Faults,
}

impl<'s> Gatherer<'s> {
    /// `used` are faces that count as collected already.
    pub(super) fn new(scene: Scene<'s>, excluded: &'s [Range<u32>], used: HashSet<u32>) -> Self {
        Self {
            scene,
            excluded,
            used,
            expanded: HashSet::new(),
            repeated: 0,
            points_left: MAX_OBJECT_POINTS,
            srs: None,
            has_lines: false,
            faults: Faults::default(),
        }
    }

    pub(super) fn scene(&self) -> Scene<'s> {
        self.scene
    }

    /// Collects the surfaces of an element.
    pub(super) fn gather(&mut self, node: u32, role: SurfaceRole, pieces: &mut Vec<Piece>) {
        let inherited = Inherited { role, is_reversed: false, material: None, srs: None, placement: None };
        self.walk(node, inherited, 0, pieces);
    }

    fn walk(&mut self, node: u32, mut inherited: Inherited<'s>, depth: u32, pieces: &mut Vec<Piece>) {
        if depth > MAX_DEPTH {
            return self.faults.note(TOO_DEEP);
        }
        let Scene { tree, names, appearances, .. } = self.scene;
        // What a template names is a system of its own: that of its reference point places it.
        if inherited.placement.is_none() {
            inherited.srs = tree.attribute(node, AttributeKind::SrsName).or(inherited.srs);
        }
        if let Some(id) = tree.id_hash(node) {
            inherited.material = appearances.material_of_surface(id).or(inherited.material);
        }
        match tree.node(node).content {
            Content::Face(face) => return self.push_face(face, inherited, pieces),
            Content::Triangles { start, end } => {
                let geometry = PieceGeometry::Triangles(start..end);
                return self.push(geometry, (end - start) as usize, inherited, pieces);
            }
            Content::Points { .. } => self.has_lines = true,
            Content::None | Content::Text { .. } => {}
        }
        match tree.class(names, node) {
            Class::Lines | Class::LodLines => self.has_lines = true,
            Class::Room | Class::Ignored | Class::Appearance | Class::Envelope | Class::ReferencePoint => {}
            Class::ImplicitGeometry => self.walk_implicit(node, &inherited, depth, pieces),
            class => {
                let is_minus = || tree.attribute(node, AttributeKind::Orientation) == Some("-");
                inherited.is_reversed ^= class == Class::OrientableSurface && is_minus();
                if let Some(reference) = tree.attribute(node, AttributeKind::Href) {
                    self.follow(hash_of_reference(reference), &inherited, depth, pieces);
                }
                for child in tree.children(node) {
                    self.walk(child, inherited.clone(), depth + 1, pieces);
                }
            }
        }
    }

    fn follow(&mut self, target: u64, inherited: &Inherited<'s>, depth: u32, pieces: &mut Vec<Piece>) {
        let Some(node) = self.scene.tree.ids.get(&target).copied() else {
            match self.scene.store.get(target) {
                Some(geometry) => {
                    let (points, geometry) = (geometry.points, PieceGeometry::Stored(geometry));
                    self.push(geometry, points, inherited.clone(), pieces);
                }
                None => self.faults.note(UNRESOLVED),
            }
            return;
        };
        let before = self.excluded.partition_point(|range| range.end <= node);
        let is_excluded = self.excluded.get(before).is_some_and(|range| range.contains(&node));
        if is_excluded || !self.expanded.insert(node) {
            self.repeated += 1;
            return;
        }
        self.walk(node, inherited.clone(), depth + 1, pieces);
    }

    fn walk_implicit(&mut self, node: u32, inherited: &Inherited<'s>, depth: u32, pieces: &mut Vec<Piece>) {
        let Scene { tree, names, .. } = self.scene;
        if inherited.placement.is_some() {
            return self.faults.note(TOO_DEEP);
        }
        let child = |class| tree.child_of_class(names, node, class);
        let reference_point = child(Class::ReferencePoint);
        let (mut reference, mut srs) = (None, inherited.srs);
        for point in reference_point.into_iter().flat_map(|point| tree.subtree(point)) {
            srs = tree.attribute(point, AttributeKind::SrsName).or(srs);
            if let Content::Points { start, .. } = tree.node(point).content {
                reference = reference.or_else(|| tree.points.get(start as usize).copied());
            }
        }
        let srs = srs.or(self.scene.store.srs());
        let text = child(Class::Matrix).and_then(|matrix| tree.text_of(matrix));
        let matrix = text.map_or(Ok(Affine::IDENTITY), matrix_of);
        match &matrix {
            Ok(Affine { is_transposed: true, .. }) => self.faults.note(TRANSPOSED),
            Ok(_) => {}
            Err(_) => self.faults.note(BAD_MATRIX),
        }
        let matrix = matrix.unwrap_or(Affine::IDENTITY);
        let placement = Rc::new(TemplatePlace::new(matrix, reference, srs));
        let Some(template) = child(Class::RelativeGeometry) else {
            return self.faults.note(if child(Class::LibraryObject).is_some() { LIBRARY } else { UNRESOLVED });
        };
        // Each placement uses the whole template again.
        let outside = std::mem::take(&mut self.expanded);
        let inherited = Inherited { srs, placement: Some(placement), ..inherited.clone() };
        self.walk(template, inherited, depth + 1, pieces);
        self.expanded = outside;
    }

    fn push_face(&mut self, face: u32, inherited: Inherited<'s>, pieces: &mut Vec<Piece>) {
        if inherited.placement.is_none() && !self.used.insert(face) {
            self.repeated += 1;
            return;
        }
        let points = self.scene.tree.rings_of(face).iter().map(|ring| (ring.end - ring.start) as usize).sum();
        self.push(PieceGeometry::Face(face), points, inherited, pieces);
    }

    fn push(&mut self, geometry: PieceGeometry, points: usize, inherited: Inherited<'s>, pieces: &mut Vec<Piece>) {
        // Points of the file itself are in memory anyway; those of templates are multiplied.
        if inherited.placement.is_some() || matches!(geometry, PieceGeometry::Stored(_)) {
            let Some(left) = self.points_left.checked_sub(points.max(1)) else { return self.faults.note(TOO_MANY) };
            self.points_left = left;
        }
        let Inherited { role, is_reversed, material, srs, placement } = inherited;
        if self.srs.zip(srs).is_some_and(|(first, own)| first != own) {
            self.faults.note(SEVERAL_SYSTEMS);
        }
        self.srs = self.srs.or(srs);
        let is_reversed = is_reversed ^ placement.as_ref().is_some_and(|placement| placement.is_mirrored());
        pieces.push(Piece { geometry, is_reversed, role, material, placement });
    }
}

pub(super) fn faces_of(pieces: &[Piece]) -> impl Iterator<Item = u32> + '_ {
    pieces.iter().filter_map(|piece| match piece.geometry {
        PieceGeometry::Face(face) => Some(face),
        _ => None,
    })
}
