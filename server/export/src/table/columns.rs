//! What columns show on the map, in cities without meshes: rows of cells of one object.

use insula_protocol::{
    BlockMap, Manifest, NODE_CELLS,
    blockmap::{ColumnObjects, NO_OBJECT, flag},
};

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

    /// The objects of a cell, with bottom and top of its column.
    fn shown(&self, cell: usize) -> Vec<(u32, [f64; 2])> {
        if self.map.flags[cell] & flag::OCCUPIED == 0 {
            return Vec::new();
        }
        let z = |code: u16| self.corner[2] + self.map.z_base_m() + f64::from(code) * f64::from(self.map.z_step_m());
        let z_m = [z(self.map.z_min[cell]), z(self.map.z_max[cell])];
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
