//! The bintree of right isosceles triangles, addressed by grid places alone.
//!
//! A triangle is halved at the middle of its longest edge. The one or two triangles with the same longest edge are a
//! diamond; they are halved together, so that no vertex ever lies inside of an edge. Each place of the grid is the
//! middle of exactly one diamond, whose size follows from the powers of two in its coordinates.

/// Column and row of a grid place.
pub type Place = [u32; 2];

/// Both ends of a triangle's longest edge, then its right angle; counter-clockwise in (column, row).
pub(super) type Corners = [Place; 3];

/// Triangles that share their longest edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Diamond {
    centre: Place,
    /// Ends of the longest edge.
    pub(super) ends: [Place; 2],
    /// Right angles of the triangles on both sides. `None` where a coordinate would be negative.
    pub(super) apexes: [Option<Place>; 2],
    /// Half the side of a square diamond, half the longest edge of one that stands on a corner.
    pub(super) half: u32,
    /// Whether the diamond is a square with sides along the axes.
    pub(super) is_square: bool,
}

impl Diamond {
    /// The diamond with this middle. `None` for the corners of root squares with `side` steps.
    pub(super) fn at(centre: Place, side: u32) -> Option<Self> {
        let [x, y] = centre;
        let half = (1 << (x | y).trailing_zeros().min(31)).min(side);
        if half == side {
            return None;
        }
        let is_square = x & y & half != 0;
        let step = half.cast_signed();
        let at = |dx: i32, dy: i32| Some([x.checked_add_signed(dx * step)?, y.checked_add_signed(dy * step)?]);
        let (ends, apexes) = if is_square {
            // The longest edge joins the middle of the next larger square and one of its corners.
            let is_even = ((x ^ y) / half / 2).is_multiple_of(2);
            let (rising, falling) = ([at(-1, -1), at(1, 1)], [at(1, -1), at(-1, 1)]);
            if is_even { (rising, falling) } else { (falling, rising) }
        } else if x & half != 0 {
            ([at(-1, 0), at(1, 0)], [at(0, 1), at(0, -1)])
        } else {
            ([at(0, -1), at(0, 1)], [at(1, 0), at(-1, 0)])
        };
        Some(Self { centre, ends: [ends[0]?, ends[1]?], apexes, half, is_square })
    }

    /// Larger diamonds come after their parts: a diamond's parts have lower ranks.
    pub(super) fn rank(&self) -> u32 {
        2 * self.half.trailing_zeros() + u32::from(self.is_square)
    }

    pub(super) fn triangles(self) -> impl Iterator<Item = Corners> {
        let [a, b] = self.ends;
        self.apexes.into_iter().flatten().map(move |c| if turn(a, b, c) > 0 { [a, b, c] } else { [b, a, c] })
    }

    /// Middles of the diamonds that can be halved only after this one: those of its four sides.
    pub(super) fn parts(self) -> impl Iterator<Item = Place> {
        let [x, y] = self.centre;
        let offsets =
            if self.is_square { [[1, 0], [0, 1], [-1, 0], [0, -1]] } else { [[1, 1], [-1, 1], [-1, -1], [1, -1]] };
        let step = if self.is_square { self.half } else { self.half / 2 }.cast_signed();
        let place =
            move |[dx, dy]: [i32; 2]| Some([x.checked_add_signed(dx * step)?, y.checked_add_signed(dy * step)?]);
        offsets.into_iter().filter(move |_| step > 0).filter_map(place)
    }
}

/// The middle of the longest edge; `None` if it lies between places: then the triangle is one of the smallest.
pub(super) fn middle([a, b, _]: &Corners) -> Option<Place> {
    let sum = [a[0] + b[0], a[1] + b[1]];
    sum.iter().all(|v| v.is_multiple_of(2)).then(|| sum.map(|v| v / 2))
}

/// The halves of a triangle whose longest edge has this middle.
pub(super) fn halves([a, b, c]: Corners, middle: Place) -> [Corners; 2] {
    [[c, a, middle], [b, c, middle]]
}

/// The two largest triangles of a root square.
pub(super) fn roots(corner: Place, side: u32) -> impl Iterator<Item = Corners> {
    let centre = corner.map(|v| v + side / 2);
    Diamond::at(centre, side).into_iter().flat_map(Diamond::triangles)
}

/// Twice the area on the left of `a` to `b` to `c`.
fn turn(a: Place, b: Place, c: Place) -> i64 {
    let [a, b, c] = [a, b, c].map(|p| p.map(i64::from));
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Middles of all diamonds between two places, the smallest first. `side`: steps of root squares, a power of two.
pub(super) fn upwards([min, max]: [Place; 2], side: u32) -> impl Iterator<Item = Place> {
    let halves = (0..side.trailing_zeros()).map(|power| 1_u32 << power);
    let first = move |axis: usize, offset: u32, step: u32| min[axis] + (offset + step - min[axis] % step) % step;
    let lattice = move |[dx, dy]: [u32; 2], step: u32| {
        let rows = (first(1, dy, step)..=max[1]).step_by(step as usize);
        rows.flat_map(move |y| (first(0, dx, step)..=max[0]).step_by(step as usize).map(move |x| [x, y]))
    };
    // Places between two corners of the larger squares along x, then along y, then in their middles.
    halves.flat_map(move |half| [[half, 0], [0, half], [half; 2]].into_iter().flat_map(move |d| lattice(d, 2 * half)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_is_the_middle_of_one_diamond() {
        let mut places: Vec<Place> = upwards([[0, 0], [20, 9]], 8).collect();
        let count = places.len();
        places.sort_unstable();
        places.dedup();
        // All but the corners of root squares.
        assert_eq!((places.len(), count), (21 * 10 - 3 * 2, 21 * 10 - 3 * 2));
        let ranks: Vec<u32> =
            upwards([[0, 0], [20, 9]], 8).filter_map(|p| Diamond::at(p, 8)).map(|d| d.rank()).collect();
        assert!(ranks.is_sorted());
    }
}
