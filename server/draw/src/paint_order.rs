//! The order in which translucent surfaces are painted, from the farthest to the nearest (Moldoveanu, "Algoritmul pictorului" and
//! "Algoritmul BSP"; Giannitrapani and Fusiello, "Depth-sort").
//!
//! The BSP tree orders faces. A drawing has shapes, each of the many faces of an object and colour. A shape is painted when all that
//! is behind it is. Where shapes are in front of each other in turn, or a shape is in front of itself, its planes are painted one by
//! one, and faces where planes do not help either.

use crate::convex::{PagePoint, PageRect, shared_area};
use crate::error::DrawError;
use crate::warnock::{PagePolygon, VisiblePart};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Parts that share a narrower strip only share a border, in units: their corners are rounded.
const MIN_SHARED_UNITS: f64 = 4.0;

/// Parts that are painted as one shape.
#[derive(Debug, PartialEq)]
pub(crate) struct Coat<S> {
    pub(crate) shape: S,
    pub(crate) rings: Vec<Vec<PagePoint>>,
}

/// The translucent ones of `parts`, from the farthest to the nearest. `names` gives shape and plane of a face of the scene; `None` if
/// it is not painted. Fails if more than `max_overlaps` pairs of faces overlap.
pub(crate) fn coats<S: Copy + Ord + Sync, P: Copy + Ord>(
    parts: &[VisiblePart],
    polygons: &[PagePolygon],
    names: impl Fn(u32) -> Option<(S, P)>,
    max_overlaps: usize,
) -> Result<Vec<Coat<S>>, DrawError> {
    let translucent = parts.iter().filter(|part| !polygons[part.polygon as usize].is_opaque);
    let named = translucent.filter_map(|part| Some((part, names(polygons[part.polygon as usize].triangle)?)));
    let (parts, named): (Vec<&VisiblePart>, Vec<(S, P)>) = named.unzip();
    let mut by_polygon: BTreeMap<u32, (Vec<&VisiblePart>, (S, P))> = BTreeMap::new();
    for (part, names) in parts.iter().zip(named) {
        by_polygon.entry(part.polygon).or_insert_with(|| (Vec::new(), names)).0.push(part);
    }
    let numbers: HashMap<u32, u32> = by_polygon.keys().copied().zip(0..).collect();
    let mut overlaps: Vec<[u32; 2]> = Vec::new();
    for of_cell in parts.par_chunk_by(|a, b| a.cell == b.cell).map(overlaps_in_cell).collect::<Vec<_>>() {
        overlaps.extend(of_cell);
        if overlaps.len() > max_overlaps {
            return Err(DrawError::TooManyParts { limit: max_overlaps });
        }
    }
    overlaps.sort_unstable();
    overlaps.dedup();
    overlaps.iter_mut().flatten().for_each(|polygon| *polygon = numbers[polygon]);
    let (of_faces, faces): (Vec<Vec<&VisiblePart>>, Vec<(S, P)>) = by_polygon.into_values().unzip();
    let rings = |face: &u32| of_faces[*face as usize].iter().map(|part| part.shape.points.clone());
    let order = PaintOrder::new(&faces, &overlaps).finish().into_iter();
    Ok(order.map(|(shape, faces)| Coat { shape, rings: faces.iter().flat_map(rings).collect() }).collect())
}

/// Pairs of polygons that overlap in one cell, the nearer one first.
fn overlaps_in_cell(parts: &[&VisiblePart]) -> BTreeSet<[u32; 2]> {
    let bounds: Vec<PageRect> = parts.iter().map(|part| PageRect::of(&part.shape.points)).collect();
    let mut pairs = BTreeSet::new();
    for (i, a) in parts.iter().enumerate() {
        for (j, b) in parts.iter().enumerate().skip(i + 1) {
            let pair = [a.polygon.min(b.polygon), a.polygon.max(b.polygon)];
            if a.polygon == b.polygon || !bounds[i].overlaps(&bounds[j]) || pairs.contains(&pair) {
                continue;
            }
            let narrow = MIN_SHARED_UNITS * f64::from(bounds[i].side().min(bounds[j].side()));
            if shared_area(&a.shape.points, &b.shape.points) > narrow {
                pairs.insert(pair);
            }
        }
    }
    pairs
}

/// Faces that are not yet painted, and those of them that are behind nothing but painted ones.
#[derive(Default)]
struct Left {
    all: Vec<u32>,
    unpainted: usize,
    ready: usize,
}

impl Left {
    fn is_whole(&self) -> bool {
        self.unpainted > 0 && self.ready == self.unpainted
    }
}

/// The work on an order. Faces have numbers from the nearest to the farthest.
struct PaintOrder<'a, S, P> {
    faces: &'a [(S, P)],
    /// Of each face, the nearer ones that overlap it.
    in_front: Vec<Vec<u32>>,
    /// Of each face, how many that it overlaps are not yet painted; `None` if it is painted itself.
    waits: Vec<Option<u32>>,
    shapes: BTreeMap<S, Left>,
    planes: BTreeMap<(S, P), Left>,
    /// Shapes and planes of which all unpainted faces are ready, and the faces that are.
    whole_shapes: BTreeSet<S>,
    whole_planes: BTreeSet<(S, P)>,
    ready: BTreeSet<u32>,
}

impl<'a, S: Copy + Ord, P: Copy + Ord> PaintOrder<'a, S, P> {
    /// `overlaps` are pairs of faces, the nearer one first.
    fn new(faces: &'a [(S, P)], overlaps: &[[u32; 2]]) -> Self {
        let mut order = Self {
            faces,
            in_front: vec![Vec::new(); faces.len()],
            waits: vec![Some(0); faces.len()],
            shapes: BTreeMap::new(),
            planes: BTreeMap::new(),
            whole_shapes: BTreeSet::new(),
            whole_planes: BTreeSet::new(),
            ready: BTreeSet::new(),
        };
        for [near, far] in overlaps {
            order.in_front[*far as usize].push(*near);
            order.waits[*near as usize] = order.waits[*near as usize].map(|waits| waits + 1);
        }
        for (number, name) in (0..).zip(faces) {
            for left in [order.shapes.entry(name.0).or_default(), order.planes.entry(*name).or_default()] {
                left.all.push(number);
                left.unpainted += 1;
            }
        }
        let first: Vec<u32> = (0..).zip(&order.waits).filter(|(_, waits)| **waits == Some(0)).map(|(k, _)| k).collect();
        first.into_iter().for_each(|face| order.make_ready(face));
        order
    }

    /// Shapes with their faces from the farthest to the nearest.
    fn finish(mut self) -> Vec<(S, Vec<u32>)> {
        let mut painted = Vec::new();
        // The farthest of the unpainted faces is always ready.
        while let Some(farthest) = self.ready.last() {
            let whole_plane = self.whole_planes.first();
            let (shape, is_plane) = match (self.whole_shapes.first(), whole_plane) {
                (Some(shape), _) => (*shape, false),
                (None, Some((shape, _))) => (*shape, true),
                (None, None) => (self.faces[*farthest as usize].0, false),
            };
            let is_next = |face: &u32| {
                let is_ready = self.waits[*face as usize] == Some(0);
                is_ready && (!is_plane || self.whole_planes.contains(&self.faces[*face as usize]))
            };
            let faces: Vec<u32> = self.shapes[&shape].all.iter().copied().filter(is_next).collect();
            self.paint(shape, &faces);
            painted.push((shape, faces));
        }
        painted
    }

    fn paint(&mut self, shape: S, faces: &[u32]) {
        for &face in faces {
            self.waits[face as usize] = None;
            self.ready.remove(&face);
            let name = self.faces[face as usize];
            for left in self.shapes.get_mut(&shape).into_iter().chain(self.planes.get_mut(&name)) {
                left.unpainted -= 1;
                left.ready -= 1;
            }
            self.note(name);
        }
        if let Some(left) = self.shapes.get_mut(&shape) {
            left.all.retain(|face| self.waits[*face as usize].is_some());
        }
        for &face in faces {
            for near in std::mem::take(&mut self.in_front[face as usize]) {
                let waits = &mut self.waits[near as usize];
                *waits = waits.map(|waits| waits - 1);
                if *waits == Some(0) {
                    self.make_ready(near);
                }
            }
        }
    }

    fn make_ready(&mut self, face: u32) {
        self.ready.insert(face);
        let name = self.faces[face as usize];
        for left in self.shapes.get_mut(&name.0).into_iter().chain(self.planes.get_mut(&name)) {
            left.ready += 1;
        }
        self.note(name);
    }

    /// Whether shape and plane of a face are whole now.
    fn note(&mut self, name: (S, P)) {
        if self.shapes[&name.0].is_whole() {
            self.whole_shapes.insert(name.0);
        } else {
            self.whole_shapes.remove(&name.0);
        }
        if self.planes[&name].is_whole() {
            self.whole_planes.insert(name);
        } else {
            self.whole_planes.remove(&name);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(faces: &[(char, u8)], overlaps: &[[u32; 2]]) -> Vec<(char, Vec<u32>)> {
        PaintOrder::new(faces, overlaps).finish()
    }

    #[test]
    fn shapes_are_whole_where_they_can_be() {
        // The tree gives a part of the near shape as farther than the far one, because they do not overlap there.
        let faces = [('n', 0), ('f', 0), ('n', 0)];
        assert_eq!(order(&faces, &[[0, 1]]), [('f', vec![1]), ('n', vec![0, 2])]);
        assert_eq!(order(&faces, &[]), [('f', vec![1]), ('n', vec![0, 2])], "by name if nothing decides");
        assert_eq!(order(&[], &[]), []);
    }

    #[test]
    fn shapes_in_front_of_each_other_are_painted_by_planes_and_these_by_faces() {
        // A house with two wings in front of itself: both triangles of its front wing are painted at once.
        let house = [('h', 1), ('h', 1), ('h', 2), ('h', 2)];
        assert_eq!(order(&house, &[[0, 2]]), [('h', vec![2, 3]), ('h', vec![0, 1])]);
        // Three bars, each over the next one.
        let bars = [('a', 0), ('b', 0), ('c', 0), ('a', 1), ('b', 1), ('c', 1)];
        let over = [[0, 4], [1, 5], [2, 3]];
        let painted = order(&bars, &over);
        let place = |face: u32| painted.iter().position(|(_, faces)| faces.contains(&face)).unwrap();
        assert!(over.iter().all(|[near, far]| place(*near) > place(*far)), "{painted:?}");
        // Planes through each other.
        let planes = [('a', 0), ('b', 0), ('a', 0), ('b', 0)];
        assert_eq!(
            order(&planes, &[[0, 1], [1, 2], [2, 3]]),
            [('b', vec![3]), ('a', vec![2]), ('b', vec![1]), ('a', vec![0])]
        );
    }

    #[test]
    fn each_face_is_painted_once_and_after_all_behind_it() {
        let mut random = 1u32;
        let mut next = |below: u32| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8) % below
        };
        for count in 1..40 {
            let faces: Vec<(u32, u32)> = (0..count).map(|_| (next(6), next(3))).collect();
            let pairs = (0..3 * count).map(|_| [next(count), next(count)]);
            let mut overlaps: Vec<[u32; 2]> = pairs.filter(|[a, b]| a < b).collect();
            overlaps.sort_unstable();
            overlaps.dedup();
            let painted = PaintOrder::new(&faces, &overlaps).finish();
            let place = |face: u32| painted.iter().position(|(_, faces)| faces.contains(&face));
            assert_eq!(painted.iter().map(|(_, faces)| faces.len()).sum::<usize>(), faces.len());
            assert!(painted.iter().all(|(shape, all)| all.iter().all(|face| faces[*face as usize].0 == *shape)));
            assert!(overlaps.iter().all(|[near, far]| place(*far).is_some() && place(*near) > place(*far)));
        }
    }
}
