//! Outlines of places on a raster: the borders of their cells.

use std::collections::HashMap;

/// The rings of a polygon, the outer one first, counter-clockwise; holes are clockwise. Corners are in cells from the raster's corner, and
/// the last one does not repeat the first.
pub type CellPolygon = Vec<Vec<[u32; 2]>>;

/// East, north, west, south.
const STEPS: [[i64; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// The polygons of the cells that are in, each of those that meet along a side. `is_in` is row by row from the south.
#[must_use]
pub fn outlines(is_in: &[bool], width: usize) -> Vec<CellPolygon> {
    let places = Places { is_in, width };
    let (parts, count) = places.parts();
    let mut polygons: Vec<CellPolygon> = vec![Vec::new(); count];
    let mut edges = places.edges();
    let mut starts: Vec<([u32; 2], u8)> = edges
        .iter()
        .flat_map(|(from, bits)| (0..4).filter(move |way| bits >> way & 1 == 1).map(|way| (*from, way)))
        .collect();
    starts.sort_unstable_by_key(|([x, y], way)| (*y, *x, *way));
    for (from, way) in starts {
        if edges.get(&from).is_none_or(|bits| bits >> way & 1 == 0) {
            continue;
        }
        let part = parts[places.left_of(from, way)] as usize;
        let is_same = |at, way| parts[places.left_of(at, way)] as usize == part;
        let ring = follow(&mut edges, from, way, &is_same);
        // The first ring of a part begins at its southernmost border, which is an outer one.
        polygons[part].push(ring);
    }
    polygons
}

/// Follows edges with the places on the left until they are closed, and takes them away. `is_same` tells whether the cell on the left of an
/// edge belongs to the same part. Where two cells touch at a corner, a ring goes on to the other one if they are of one part, so that holes
/// touch at points only; else it stays.
fn follow(
    edges: &mut HashMap<[u32; 2], u8>,
    from: [u32; 2],
    way: u8,
    is_same: &dyn Fn([u32; 2], u8) -> bool,
) -> Vec<[u32; 2]> {
    let (mut at, mut way) = (from, way);
    let mut ring = Vec::new();
    loop {
        let Some(bits) = edges.get_mut(&at).filter(|bits| **bits >> way & 1 == 1) else {
            return without_straight_corners(ring);
        };
        *bits &= !(1 << way);
        ring.push(at);
        let [dx, dy] = STEPS[usize::from(way)];
        at = [(i64::from(at[0]) + dx) as u32, (i64::from(at[1]) + dy) as u32];
        let bits = edges.get(&at).copied().unwrap_or(0);
        let [left, right] = [1, 3].map(|turn| (way + turn) % 4);
        let turns = if bits >> right & 1 == 1 && is_same(at, right) { [right, way, left] } else { [left, way, right] };
        let Some(next) = turns.into_iter().find(|next| bits >> next & 1 == 1) else {
            return without_straight_corners(ring);
        };
        way = next;
    }
}

fn without_straight_corners(ring: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
    let count = ring.len();
    let is_corner = |i: &usize| {
        let (before, after) = (ring[(i + count - 1) % count], ring[(i + 1) % count]);
        before[0] != after[0] && before[1] != after[1]
    };
    (0..count).filter(is_corner).map(|i| ring[i]).collect()
}

struct Places<'a> {
    is_in: &'a [bool],
    width: usize,
}

impl Places<'_> {
    fn height(&self) -> usize {
        self.is_in.len() / self.width.max(1)
    }

    fn has(&self, x: i64, y: i64) -> bool {
        let is_inside = x >= 0 && y >= 0 && x < self.width as i64 && y < self.height() as i64;
        is_inside && self.is_in[y as usize * self.width + x as usize]
    }

    /// Which edges begin at each corner, as bits of [`STEPS`], with the places on their left.
    fn edges(&self) -> HashMap<[u32; 2], u8> {
        let mut edges: HashMap<[u32; 2], u8> = HashMap::new();
        for (y, x) in (0..self.height() as i64).flat_map(|y| (0..self.width as i64).map(move |x| (y, x))) {
            if !self.has(x, y) {
                continue;
            }
            let sides = [
                ([x, y - 1], [x, y], 0u8),
                ([x + 1, y], [x + 1, y], 1),
                ([x, y + 1], [x + 1, y + 1], 2),
                ([x - 1, y], [x, y + 1], 3),
            ];
            for ([beside_x, beside_y], from, way) in sides {
                if !self.has(beside_x, beside_y) {
                    *edges.entry(from.map(|v| v as u32)).or_default() |= 1 << way;
                }
            }
        }
        edges
    }

    /// Index of the cell on the left of an edge.
    fn left_of(&self, [x, y]: [u32; 2], way: u8) -> usize {
        let [x, y] = [x as usize, y as usize];
        let (x, y) = match way {
            0 => (x, y),
            1 => (x - 1, y),
            2 => (x - 1, y - 1),
            _ => (x, y - 1),
        };
        y * self.width + x
    }

    /// A number for each cell that is in, the same for those that meet along sides; and how many there are.
    fn parts(&self) -> (Vec<u32>, usize) {
        let mut parts = vec![u32::MAX; self.is_in.len()];
        let (mut count, mut open) = (0u32, Vec::new());
        for start in 0..self.is_in.len() {
            if !self.is_in[start] || parts[start] != u32::MAX {
                continue;
            }
            parts[start] = count;
            open.push(start);
            while let Some(cell) = open.pop() {
                let (x, y) = ((cell % self.width) as i64, (cell / self.width) as i64);
                for [dx, dy] in STEPS {
                    let beside = ((y + dy) * self.width as i64 + x + dx) as usize;
                    if self.has(x + dx, y + dy) && parts[beside] == u32::MAX {
                        parts[beside] = count;
                        open.push(beside);
                    }
                }
            }
            count += 1;
        }
        (parts, count as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[&str]) -> Vec<CellPolygon> {
        let is_in: Vec<bool> = rows.iter().rev().flat_map(|row| row.bytes().map(|c| c == b'#')).collect();
        outlines(&is_in, rows[0].len())
    }

    /// Twice the area, positive counter-clockwise.
    fn area2(ring: &[[u32; 2]]) -> i64 {
        let next = ring.iter().cycle().skip(1);
        ring.iter().zip(next).map(|(a, b)| i64::from(a[0]) * i64::from(b[1]) - i64::from(b[0]) * i64::from(a[1])).sum()
    }

    #[test]
    fn rings_go_around_cells_and_holes() {
        let square = vec![[1, 1], [3, 1], [3, 2], [1, 2]];
        assert_eq!(of(&["....", ".##.", "...."]), [vec![square]]);
        let ring = of(&["####", "#..#", "#.##", "####"]);
        assert_eq!((ring.len(), ring[0].len()), (1, 2));
        assert_eq!([area2(&ring[0][0]), area2(&ring[0][1])], [32, -6]);
        assert!(of(&["..", ".."]).is_empty() && outlines(&[], 0).is_empty());
    }

    #[test]
    fn cells_that_touch_at_a_corner_are_apart() {
        let apart = of(&["#.", ".#"]);
        assert_eq!(apart.iter().map(|polygon| area2(&polygon[0])).collect::<Vec<_>>(), [2, 2]);
        let holes = of(&["#####", "#.###", "##.##", "#####"]);
        assert_eq!((holes.len(), holes[0].len()), (1, 3));
        let nested = of(&["#####", "#...#", "#.#.#", "#...#", "#####"]);
        assert_eq!(nested.iter().map(Vec::len).collect::<Vec<_>>(), [2, 1]);
    }

    #[test]
    fn areas_add_up() {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 30 != 0
        };
        let is_in: Vec<bool> = (0..40 * 30).map(|_| next()).collect();
        let all: i64 = outlines(&is_in, 40).iter().flatten().map(|ring| area2(ring)).sum();
        assert_eq!(all, 2 * is_in.iter().filter(|is_in| **is_in).count() as i64);
    }
}
