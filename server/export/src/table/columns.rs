//! What columns show on the map, in cities and nodes without meshes: rows of cells of one object, and level tops.

use insula_protocol::blockmap::{ColumnObjects, NO_OBJECT, flag};
use insula_protocol::{BlockMap, Manifest, NODE_CELLS};

/// The columns of a node with objects.
pub(crate) struct ColumnView<'a> {
    map: &'a BlockMap,
    objects: &'a ColumnObjects,
    /// World metres.
    corner: [f64; 3],
    cell_m: f64,
}

/// Cells side by side from west to east that show one object.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Run {
    pub(crate) object: u32,
    /// South-west and north-east corner in world metres.
    pub(crate) area: [[f64; 2]; 2],
    /// World heights of the lowest bottom and of the highest top.
    pub(crate) z_m: [f64; 2],
}

/// Cells that show one object from above, at one height.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Top {
    pub(crate) object: u32,
    /// South-west and north-east corner in world metres.
    pub(crate) area: [[f64; 2]; 2],
    /// World height.
    pub(crate) z_m: f64,
}

/// Cells of a row that show the same from above: object, height, first cell and the one behind the last.
type TopRow = (u32, u16, usize, usize);

impl<'a> ColumnView<'a> {
    /// `None` if the columns have no objects.
    pub(crate) fn new(manifest: &Manifest, map: &'a BlockMap) -> Option<Self> {
        let cell_m = manifest.cell_m_at(map.id.level());
        Some(Self { map, objects: map.objects.as_deref()?, corner: manifest.node_corner(map.id), cell_m })
    }

    /// All runs, row by row. A cell belongs to the object of its roof and to that of its wall.
    pub(crate) fn runs(&self) -> Vec<Run> {
        let mut runs = Vec::new();
        for y in 0..NODE_CELLS {
            let mut open: Vec<(u32, usize, [f64; 2])> = Vec::new();
            for x in 0..=NODE_CELLS {
                let shown = if x < NODE_CELLS { self.shown(y * NODE_CELLS + x) } else { Vec::new() };
                open.retain(|(object, first, z_m)| {
                    let goes_on = shown.iter().any(|(other, _)| other == object);
                    if !goes_on {
                        runs.push(Run { object: *object, area: self.area(*first, x, y), z_m: *z_m });
                    }
                    goes_on
                });
                for (object, z_m) in shown {
                    match open.iter_mut().find(|(other, ..)| *other == object) {
                        Some((.., known)) => *known = [known[0].min(z_m[0]), known[1].max(z_m[1])],
                        None => open.push((object, x, z_m)),
                    }
                }
            }
        }
        runs
    }

    /// All tops as rectangles. Inclined ones are level, at the height of their middle.
    pub(crate) fn tops(&self) -> Vec<Top> {
        let mut tops = Vec::new();
        // Those that may go on in the next row, with their first row.
        let mut open: Vec<(TopRow, usize)> = Vec::new();
        for y in 0..=NODE_CELLS {
            let row = if y < NODE_CELLS { self.top_rows(y) } else { Vec::new() };
            let (going_on, ended): (Vec<_>, Vec<_>) = open.into_iter().partition(|(top, _)| row.contains(top));
            tops.extend(ended.into_iter().map(|((object, code, first, end), from)| Top {
                object,
                area: [self.area(first, end, from)[0], self.area(first, end, y - 1)[1]],
                z_m: self.height_m(code),
            }));
            let new = row.into_iter().filter(|top| !going_on.iter().any(|(known, _)| known == top));
            open = new.map(|top| (top, y)).chain(going_on.iter().copied()).collect();
        }
        tops
    }

    fn top_rows(&self, y: usize) -> Vec<TopRow> {
        let mut row: Vec<TopRow> = Vec::new();
        for x in 0..NODE_CELLS {
            let cell = y * NODE_CELLS + x;
            let (object, code) = (self.objects.roof[cell], self.map.z_max[cell]);
            if self.map.flags[cell] & flag::OCCUPIED == 0 || object == NO_OBJECT {
                continue;
            }
            match row.last_mut() {
                Some((known, height, _, end)) if (*known, *height, *end) == (object, code, x) => *end = x + 1,
                _ => row.push((object, code, x, x + 1)),
            }
        }
        row
    }

    /// World height of a code of the columns.
    fn height_m(&self, code: u16) -> f64 {
        self.corner[2] + self.map.z_base_m() + f64::from(code) * f64::from(self.map.z_step_m())
    }

    /// The objects of a cell, with bottom and top of its column.
    fn shown(&self, cell: usize) -> Vec<(u32, [f64; 2])> {
        if self.map.flags[cell] & flag::OCCUPIED == 0 {
            return Vec::new();
        }
        let z_m = [self.map.z_min[cell], self.map.z_max[cell]].map(|code| self.height_m(code));
        let [roof, wall] = [self.objects.roof[cell], self.objects.wall[cell]];
        let mut shown = vec![(roof, z_m)];
        if wall != roof {
            shown.push((wall, z_m));
        }
        shown.retain(|(object, _)| *object != NO_OBJECT);
        shown
    }

    fn area(&self, first: usize, end: usize, y: usize) -> [[f64; 2]; 2] {
        let at =
            |x: usize, y: usize| [self.corner[0] + x as f64 * self.cell_m, self.corner[1] + y as f64 * self.cell_m];
        [at(first, y), at(end, y + 1)]
    }
}
