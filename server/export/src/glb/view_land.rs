//! The land of a view: surfaces of different fineness, which meet on their borders.
//!
//! ROAM leaves no vertex inside of an edge of one surface. Between two, triangles at a border are split at the vertices of the surface
//! beside them, and both take the heights of the finer one there: both have the same edges on their border, so no gap shows. Strips hang
//! only from borders beside which there are boxes of columns, meshes, or nothing.

use super::ExportError;
use super::builder::GlbBuilder;
use super::matrix::numbers_of;
use crate::land_surface::{CommonHeights, LandSurface};
use glam::DVec2;
use insula_protocol::{Manifest, NODE_CELLS, TileId};
use insula_roam::Place;
use std::collections::{BTreeMap, BTreeSet};

/// Surfaces of land that do not overlap.
#[derive(Debug, Default)]
pub(super) struct ViewLand {
    /// The truest first, of those that are as fine.
    parts: Vec<LandPart>,
}

/// A surface of land at its place on the map.
#[derive(Debug)]
pub(super) struct LandPart {
    name: String,
    /// Places in cells of leaves from `corner`, and rows of the property table.
    surface: LandSurface,
    /// In cells of leaves from the city's corner.
    corner: Place,
    /// Distance of its places, in cells of leaves.
    step: u32,
    /// Height of its strips.
    skirt_m: f64,
}

/// The vertices on borders along the axes, where surfaces may meet.
#[derive(Debug, Default)]
struct Seams {
    /// The height that all surfaces have at a place, with the step of the surface that it comes from.
    heights: BTreeMap<Place, (u32, f64)>,
    /// The places by axis, their coordinate on it, and the other one.
    lines: BTreeSet<(usize, u32, u32)>,
}

impl LandPart {
    /// A surface whose places are steps from a node's corner, so many along its side, with its name and the height of its strips.
    pub(super) fn new(
        manifest: &Manifest,
        (node, side_steps): (TileId, u32),
        mut surface: LandSurface,
        (name, skirt_m): (String, f64),
    ) -> Self {
        let side = (NODE_CELLS as u32) << manifest.depth.saturating_sub(node.level());
        let step = side / side_steps.max(1);
        surface.places.iter_mut().for_each(|place| *place = place.map(|at| at * step));
        let corner = [node.x() * side, node.y() * side];
        Self { name, surface, corner, step, skirt_m }
    }

    /// The place of a vertex on the map.
    fn at(&self, vertex: u32) -> Place {
        let place = self.surface.places[vertex as usize];
        [0, 1].map(|k| self.corner[k] + place[k])
    }

    /// Adds a vertex at a place between two others.
    fn insert(&mut self, place: Place, height_m: f64, [a, b]: [u32; 2]) -> u32 {
        let apart = |from: Place, to: Place| f64::from(from[0].abs_diff(to[0]) + from[1].abs_diff(to[1]));
        let share = apart(self.at(a), place) / apart(self.at(a), self.at(b));
        let corner = self.corner;
        let surface = &mut self.surface;
        let [of_a, of_b] = [a, b].map(|vertex| surface.colours[vertex as usize].map(f64::from));
        surface.colours.push([0, 1, 2].map(|k| (of_a[k] + share * (of_b[k] - of_a[k])).round() as u8));
        surface.objects.push(surface.objects[a as usize]);
        surface.heights.push(height_m);
        surface.places.push([0, 1].map(|k| place[k] - corner[k]));
        surface.places.len() as u32 - 1
    }
}

/// The axis on which both ends of an edge have the same coordinate: across a border that runs along the other axis.
fn axis_across([from, to]: [Place; 2]) -> Option<usize> {
    (0..2).find(|axis| from[*axis] == to[*axis] && from[1 - axis] != to[1 - axis])
}

impl Seams {
    fn of(parts: &[LandPart]) -> Self {
        let mut seams = Self::default();
        for part in parts {
            for edge in part.surface.border() {
                let ends = edge.ends.map(|end| part.at(end));
                if axis_across(ends).is_some() {
                    let heights = edge.ends.map(|end| part.surface.heights[end as usize]);
                    ends.into_iter().zip(heights).for_each(|(place, height_m)| seams.add(place, (part.step, height_m)));
                }
            }
        }
        seams
    }

    fn add(&mut self, place: Place, found: (u32, f64)) {
        self.lines.extend((0..2).map(|axis| (axis, place[axis], place[1 - axis])));
        let known = self.heights.entry(place).or_insert(found);
        if found.0 < known.0 {
            *known = found;
        }
    }

    /// The places inside of an edge across `axis`, from its first end on.
    fn inside(&self, axis: usize, [from, to]: [Place; 2]) -> Vec<Place> {
        let (line, [first, last]) = (from[axis], [from[1 - axis], to[1 - axis]]);
        let range = (axis, line, first.min(last) + 1)..(axis, line, first.max(last));
        let place = |(_, _, along): &(usize, u32, u32)| if axis == 0 { [line, *along] } else { [*along, line] };
        let mut places: Vec<Place> = self.lines.range(range).map(place).collect();
        if last < first {
            places.reverse();
        }
        places
    }

    /// Gives a surface the vertices and heights of its seams.
    fn join(&self, part: &mut LandPart) {
        let mut inner: BTreeMap<(usize, usize), Vec<u32>> = BTreeMap::new();
        for edge in part.surface.border() {
            let ends = edge.ends.map(|end| part.at(end));
            let Some(axis) = axis_across(ends) else { continue };
            for (place, vertex) in ends.iter().zip(edge.ends) {
                if let Some((_, height_m)) = self.heights.get(place) {
                    part.surface.heights[vertex as usize] = *height_m;
                }
            }
            for place in self.inside(axis, ends) {
                if let Some((_, height_m)) = self.heights.get(&place) {
                    let vertex = part.insert(place, *height_m, edge.ends);
                    inner.entry((edge.triangle, edge.side)).or_default().push(vertex);
                }
            }
        }
        let triangles = std::mem::take(&mut part.surface.triangles);
        for (triangle, corners) in triangles.into_iter().enumerate() {
            let sides = [0, 1, 2].map(|side| inner.get(&(triangle, side)).map_or(&[][..], Vec::as_slice));
            split(corners, sides, &mut part.surface.triangles);
        }
    }
}

/// Divides a triangle at vertices on its sides, each side's from the corner of its number to the next.
fn split(corners: [u32; 3], sides: [&[u32]; 3], out: &mut Vec<[u32; 3]>) {
    let turned = (0..3).map(|k| ([0, 1, 2].map(|n| corners[(k + n) % 3]), [0, 1, 2].map(|n| sides[(k + n) % 3])));
    for ([a, b, c], [ab, bc, ca]) in turned {
        if let (Some(first), Some(last)) = (ab.first(), ab.last()) {
            split([a, *first, c], [&[], &[], ca], out);
            out.extend(ab.array_windows().map(|[p, q]| [*p, *q, c]));
            split([*last, b, c], [&[], bc, &[]], out);
            return;
        }
    }
    out.push(corners);
}

impl ViewLand {
    /// Adds a surface, unless it is empty.
    pub(super) fn add(&mut self, part: LandPart) {
        if !part.surface.triangles.is_empty() {
            self.parts.push(part);
        }
    }

    /// Adds a surface that is truer than the others with its step.
    pub(super) fn add_truest(&mut self, part: LandPart) {
        if !part.surface.triangles.is_empty() {
            self.parts.insert(0, part);
        }
    }

    fn join(&mut self) {
        let seams = Seams::of(&self.parts);
        self.parts.iter_mut().for_each(|part| seams.join(part));
    }

    /// Hangs strips from the edges that only one surface has.
    fn add_skirts(&mut self) {
        let mut counts: BTreeMap<[Place; 2], u32> = BTreeMap::new();
        let sorted = |mut ends: [Place; 2]| {
            ends.sort_unstable();
            ends
        };
        for part in &self.parts {
            for edge in part.surface.border() {
                *counts.entry(sorted(edge.ends.map(|end| part.at(end)))).or_default() += 1;
            }
        }
        for LandPart { surface, corner, skirt_m, .. } in &mut self.parts {
            let on_map = |place: Place| [0, 1].map(|k| corner[k] + place[k]);
            surface.add_skirt(*skirt_m, &|ends| counts.get(&sorted(ends.map(on_map))) == Some(&1));
        }
    }

    /// Joins and writes the surfaces. Returns the number of triangles. `origin` is that of the scene in world metres.
    pub(super) fn write(
        mut self,
        glb: &mut GlbBuilder,
        manifest: &Manifest,
        origin: [f64; 3],
    ) -> Result<usize, ExportError> {
        self.join();
        self.add_skirts();
        let heights = CommonHeights::over(self.parts.iter().flat_map(|part| part.surface.heights.iter().copied()));
        let cell_m = manifest.cell_m_at(manifest.depth);
        let mut triangles = 0;
        for LandPart { name, mut surface, corner, .. } in self.parts {
            triangles += surface.triangles.len();
            // Positions have 16 bits. No node of a view has one beside it that is ten levels finer, so coarser steps lose no place.
            let widest = surface.places.iter().flatten().copied().max().unwrap_or(0);
            let shift = (u32::BITS - widest.leading_zeros()).saturating_sub(u16::BITS);
            surface.places.iter_mut().for_each(|place| *place = place.map(|at| at >> shift));
            let place = |axis: usize| manifest.origin[axis] - origin[axis] + f64::from(corner[axis]) * cell_m;
            let step = DVec2::splat(cell_m * f64::from(1u32 << shift));
            let (geometry, matrix) = surface.geometry((DVec2::new(place(0), place(1)), step), heights);
            let material = glb.plain_material();
            let mesh = glb.add_mesh(&geometry, material)?;
            glb.add_node(Some(name), numbers_of(matrix), mesh);
        }
        Ok(triangles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::test_city::manifest;

    const STEPS: u32 = 64;

    /// A node with two triangles for each square of so many steps, with heights by place.
    fn surface(square: u32, height_m: impl Fn(Place) -> f64) -> LandSurface {
        let squares = STEPS / square;
        let width = squares + 1;
        let places: Vec<Place> = (0..width).flat_map(|y| (0..width).map(move |x| [x * square, y * square])).collect();
        let cells = (0..squares).flat_map(|y| (0..squares).map(move |x| y * width + x));
        LandSurface {
            heights: places.iter().map(|place| height_m(*place)).collect(),
            colours: places.iter().map(|[x, _]| [*x as u8, 0, 0]).collect(),
            objects: vec![7; places.len()],
            triangles: cells.flat_map(|a| [[a, a + 1, a + width + 1], [a, a + width + 1, a + width]]).collect(),
            places,
        }
    }

    /// A western half of four squares, an eastern one of fine triangles in the south and coarse ones in the north.
    fn land() -> ViewLand {
        let manifest = manifest(3, 1.0);
        let mut land = ViewLand::default();
        for (node, square, height_m) in [((1, 0, 0), 32, 10.0), ((2, 2, 0), 8, 11.0), ((2, 2, 1), 16, 13.0)] {
            let node = TileId::new(node.0, node.1, node.2).unwrap();
            let surface = surface(square, |[x, _]| height_m + f64::from(x));
            land.add(LandPart::new(&manifest, (node, STEPS), surface, (node.to_string(), 2.0)));
        }
        land
    }

    fn area(surface: &LandSurface) -> f64 {
        let corner = |vertex: u32| DVec2::from(surface.places[vertex as usize].map(f64::from));
        let of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(corner);
            0.5 * (b - a).perp_dot(c - a)
        };
        assert!(surface.triangles.iter().all(|t| of(t) > 0.0));
        surface.triangles.iter().map(of).sum()
    }

    /// The edges of a part on a line across an axis, with the heights of their ends.
    fn edges(part: &LandPart, axis: usize, line: u32) -> BTreeSet<[(Place, u64); 2]> {
        let end = |vertex: u32| (part.at(vertex), part.surface.heights[vertex as usize].to_bits());
        let on_line = |edge: &[(Place, u64); 2]| edge.iter().all(|(place, _)| place[axis] == line);
        let sorted = |mut edge: [(Place, u64); 2]| {
            edge.sort_unstable();
            edge
        };
        part.surface.border().iter().map(|edge| sorted(edge.ends.map(end))).filter(on_line).collect()
    }

    #[test]
    fn surfaces_of_any_steps_have_the_same_edges_on_their_border() {
        let mut land = land();
        // Cells of leaves: the western node has steps of 4, the others of 2.
        assert_eq!(land.parts.iter().map(|part| part.step).collect::<Vec<_>>(), [4, 2, 2]);
        let before: Vec<f64> = land.parts.iter().map(|part| area(&part.surface)).collect();
        assert!(edges(&land.parts[0], 0, 256).is_disjoint(&edges(&land.parts[1], 0, 256)));
        land.join();
        let [west, south, north] = &land.parts[..] else { panic!("{land:?}") };
        let beside: BTreeSet<_> = edges(south, 0, 256).union(&edges(north, 0, 256)).copied().collect();
        assert_eq!((edges(west, 0, 256), beside.len()), (beside, 12));
        assert_eq!((edges(south, 1, 128), edges(south, 1, 128).len()), (edges(north, 1, 128), 8));
        let after: Vec<f64> = land.parts.iter().map(|part| area(&part.surface)).collect();
        assert_eq!(before, after);
        // The finer one's heights count, and of two that are as fine the first one's.
        let heights = |part: &LandPart, place: Place| {
            let at = (0..part.surface.places.len() as u32).filter(|vertex| part.at(*vertex) == place);
            at.map(|vertex| part.surface.heights[vertex as usize]).collect::<Vec<_>>()
        };
        assert_eq!([west, south].map(|part| heights(part, [256, 16])), [[11.0], [11.0]]);
        assert_eq!([west, south, north].map(|part| heights(part, [256, 128])), [[11.0], [11.0], [11.0]]);
        assert_eq!(heights(north, [384, 128]), [75.0]);
    }

    #[test]
    fn inserted_vertices_have_a_colour_between_those_beside_them() {
        let mut land = land();
        land.join();
        let north = &land.parts[2];
        let at = (0..north.surface.places.len() as u32).find(|vertex| north.at(*vertex) == [256 + 16, 128]).unwrap();
        assert_eq!((north.surface.colours[at as usize], north.surface.objects[at as usize]), ([8, 0, 0], 7));
    }

    #[test]
    fn strips_hang_where_nothing_else_begins() {
        let mut land = land();
        land.join();
        let triangles: Vec<usize> = land.parts.iter().map(|part| part.surface.triangles.len()).collect();
        land.add_skirts();
        let strips: Vec<usize> =
            land.parts.iter().zip(triangles).map(|(part, before)| part.surface.triangles.len() - before).collect();
        // Two triangles for each edge on the outer border: 3 sides of 2 edges, 2 of 8, 2 of 4.
        assert_eq!(strips, [12, 32, 16]);
    }

    #[test]
    fn triangles_are_divided_at_vertices_on_several_sides() {
        let mut out = Vec::new();
        split([0, 1, 2], [&[], &[], &[]], &mut out);
        assert_eq!(out, [[0, 1, 2]]);
        out.clear();
        split([0, 1, 2], [&[3, 4], &[5], &[6]], &mut out);
        assert_eq!(out, [[2, 6, 3], [6, 0, 3], [3, 4, 2], [1, 5, 4], [5, 2, 4]]);
    }
}
