//! Positions of buildings, whose walls are vertical, whose eaves are level and whose corners lie above each other.
//!
//! Each vertex first codes which neighbour lies vertically above or below it, then which neighbour has the same height.
//! Both depend on how the neighbours lie to each other: across the diagonal of a vertical wall there is nearly always
//! another corner of the wall. Coordinates that no neighbour gives are coded as differences from the parallelogram, by
//! the size of the triangle and by the differences at the neighbours.

use super::completed::{CompletedTriangle, CompletedTriangles};
use super::connectivity::Connectivity;
use super::points::Points;
use super::{DIGIT_COUNTS, DifferenceCoder, digits};
use crate::codec::rans::{SymbolCoder, SymbolModel};
use crate::error::{DecodeError, invalid_if};

/// Number of neighbours that a vertex is compared with.
const NEIGHBOURS: usize = 4;
/// Symbol for no such neighbour.
const NO_NEIGHBOUR: usize = 0;

type Point = [i32; 3];

struct ArchitecturalModels {
    /// Which neighbour is vertically aligned; 1 and up are the order of [`Neighbourhood::points`].
    aligned: Vec<SymbolModel<8>>,
    /// Which neighbour has the same height.
    level: Vec<SymbolModel<8>>,
    /// Other coordinates: by axis and triangle size, and by axis and neighbours' differences.
    differences: DifferenceCoder,
}

impl ArchitecturalModels {
    fn new() -> Self {
        Self {
            aligned: vec![SymbolModel::new(|i| [8, 8, 3, 3, 3, 1, 1, 1][i]); 64],
            level: vec![SymbolModel::new(|i| [8, 4, 4, 3, 3, 1, 1, 1][i]); 320],
            differences: DifferenceCoder::new([4 * DIGIT_COUNTS; 2]),
        }
    }
}

/// Digits of the differences that a vertex was coded with: horizontal (the larger axis) and vertical.
type CodedDigits = [u8; 2];

/// What a vertex is predicted from.
struct Neighbourhood {
    /// The corners of the completed triangle before and after the vertex, the next neighbour, and the vertex beyond.
    points: [Point; NEIGHBOURS],
    expected: Point,
    /// Whether the vertex completes no triangle. Then the last coded vertices stand in for neighbours.
    is_first: bool,
    /// Largest [`CodedDigits`] of the neighbours.
    digits: [usize; 2],
}

impl Neighbourhood {
    fn new(triangles: &[CompletedTriangle], points: &Points, coded: &[CodedDigits], last: [Point; 2]) -> Self {
        let [triangle, rest @ ..] = triangles else {
            let points = [last[0], last[1], last[0], last[0]];
            return Self { points, expected: last[0], is_first: true, digits: [0, 0] };
        };
        let [a, b, beyond] = [triangle.a, triangle.b, triangle.beyond].map(|other| points.coordinates(other));
        let next = points.coordinates(rest.first().map_or(triangle.b, CompletedTriangle::not_full));
        let near = [triangle.a, triangle.b, triangle.beyond].map(|other| coded[other as usize]);
        let most = |k: usize| usize::from(near[0][k].max(near[1][k]).max(near[2][k]));
        Self {
            points: [b, a, next, beyond],
            expected: std::array::from_fn(|k| a[k] + b[k] - beyond[k]),
            is_first: false,
            digits: [most(0), most(1)],
        }
    }

    /// Which neighbours agree with each other by `agree`, as a number of six bits.
    fn pattern(&self, agree: impl Fn(Point, Point) -> bool) -> usize {
        let [b, a, next, beyond] = self.points;
        let bit = |p, q| usize::from(agree(p, q));
        bit(a, b)
            + 2 * bit(beyond, a)
            + 4 * bit(beyond, b)
            + 8 * bit(next, b)
            + 16 * bit(next, a)
            + 32 * usize::from(self.is_first)
    }

    /// The symbol of the first neighbour that agrees with `point`.
    fn find(&self, point: Point, agree: impl Fn(Point, Point) -> bool) -> usize {
        self.points.iter().position(|neighbour| agree(*neighbour, point)).map_or(NO_NEIGHBOUR, |i| i + 1)
    }

    /// Binary digits of the completed triangle's extent along an axis.
    fn extent_digits(&self, axis: usize) -> usize {
        let [b, a, _, beyond] = self.points;
        digits((a[axis] - b[axis]).abs().max((beyond[axis] - b[axis]).abs()))
    }
}

fn is_aligned(p: Point, q: Point) -> bool {
    p[..2] == q[..2]
}

fn is_level(p: Point, q: Point) -> bool {
    p[2] == q[2]
}

/// Codes all positions. Copies get the position of their original. Fails on positions outside the grid, on neighbours
/// that do not exist and on truncated symbols.
pub(super) fn code<C: SymbolCoder>(
    coder: &mut C,
    mesh: &Connectivity,
    points: &mut Points,
    originals: &[u32],
) -> Result<(), DecodeError> {
    let mut models = ArchitecturalModels::new();
    let mut completed = CompletedTriangles::default();
    let mut coded = vec![[0u8; 2]; points.len()];
    let mut last = [points.middle(); 2];
    for vertex in 0..points.len() as u32 {
        if !points.is_real(vertex) {
            continue;
        }
        let original = originals[vertex as usize];
        let position = if original == vertex {
            completed.find(mesh, vertex, |other| points.is_real(other));
            let neighbourhood = Neighbourhood::new(completed.triangles(), points, &coded, last);
            let (position, digits) = models.code(coder, &neighbourhood, points.coordinates(vertex))?;
            coded[vertex as usize] = digits;
            position
        } else {
            coded[vertex as usize] = coded[original as usize];
            points.coordinates(original)
        };
        points.set_coordinates(vertex, position)?;
        last = [position, last[0]];
        invalid_if(vertex % 1024 == 0 && coder.overrun(), "a mesh's positions are truncated")?;
    }
    Ok(())
}

impl ArchitecturalModels {
    /// Codes one position. `value` is the writer's.
    fn code<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        neighbourhood: &Neighbourhood,
        value: Point,
    ) -> Result<(Point, CodedDigits), DecodeError> {
        let mut position = value;
        let mut coded = [0u8; 2];
        let expected = neighbourhood.expected;
        let model = &mut self.aligned[neighbourhood.pattern(is_aligned)];
        let aligned = coder.symbol(model, neighbourhood.find(value, is_aligned));
        invalid_if(aligned > NEIGHBOURS, "a mesh's vertex is aligned with a neighbour that does not exist")?;
        if aligned != NO_NEIGHBOUR {
            position[..2].copy_from_slice(&neighbourhood.points[aligned - 1][..2]);
        } else {
            let extent = neighbourhood.extent_digits(0).max(neighbourhood.extent_digits(1));
            for k in 0..2 {
                let axis = DIGIT_COUNTS * if neighbourhood.is_first { 2 } else { k };
                let contexts = [axis + extent, axis + neighbourhood.digits[0]];
                position[k] = self.differences.code(coder, contexts, value[k], expected[k]);
                coded[0] = coded[0].max(digits(position[k] - expected[k]) as u8);
            }
        }
        let model = &mut self.level[neighbourhood.pattern(is_level) * (NEIGHBOURS + 1) + aligned];
        let level = coder.symbol(model, neighbourhood.find(value, is_level));
        invalid_if(level > NEIGHBOURS, "a mesh's vertex is level with a neighbour that does not exist")?;
        if level != NO_NEIGHBOUR {
            position[2] = neighbourhood.points[level - 1][2];
        } else {
            let axis = DIGIT_COUNTS * 3;
            let contexts = [axis + neighbourhood.extent_digits(2), axis + neighbourhood.digits[1]];
            position[2] = self.differences.code(coder, contexts, value[2], expected[2]);
            coded[1] = digits(position[2] - expected[2]) as u8;
        }
        Ok((position, coded))
    }
}
