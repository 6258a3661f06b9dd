//! A surface with what a proposal adds to a city and removes from it, and how far values change by it.

use crate::footprint::footprint;
use crate::outlines::outlines;
use crate::surface::{Building, CitySurface, TopKind};
use crate::walls::WallPoint;
use glam::DVec2;
use insula_export::raster::CellExtent;
use insula_export::selection::{Polygon, SelectedArea, area_around};
use std::collections::{BTreeMap, HashMap, VecDeque};

/// What stands after a proposal, and not before.
#[derive(Debug, Clone)]
pub enum Addition {
    /// Triangles in world metres.
    Model(Vec<[[f64; 3]; 3]>),
    /// All above an outline on the map, up to a height in world metres.
    Block { outline: Polygon, top_m: f64 },
}

impl CitySurface {
    /// The surface without some buildings, and without all that stands in some areas of the map: there is ground as high as the nearest
    /// that is left. What has no ground around it stays.
    #[must_use]
    pub fn without_objects(&self, is_removed: &dyn Fn(&Building) -> bool, areas: &[Polygon]) -> Self {
        let removed: Vec<bool> = self.buildings.iter().map(is_removed).collect();
        let mut open = vec![false; self.tops.values.len()];
        if removed.contains(&true) {
            for (index, kind) in (0..self.size()[1]).flat_map(|row| self.kinds_of_row(row)).enumerate() {
                open[index] = matches!(kind, TopKind::Roof(building) if removed[building as usize]);
            }
        }
        let stands = |index: usize| matches!(self.kind(index), TopKind::Roof(_) | TopKind::Other);
        for area in areas {
            self.cells_in(area).filter(|index| stands(*index)).for_each(|index| open[index] = true);
        }
        self.changed(&self.ground_within(open))
    }

    /// The surface with nothing but ground within an outline on the map: cells there are as high as the lowest one, or one beside them.
    #[must_use]
    pub fn without(&self, outline: &[[f64; 2]]) -> Self {
        let area = vec![outline.to_vec()];
        let [low, high] = area_around(outline.iter().copied());
        let [columns, rows] = self.span(low.map(|v| v - self.cell_m), high.map(|v| v + self.cell_m));
        let cells = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
        let tops = cells.map(|(x, y)| self.top(y * self.size()[0] + x)).filter(|top| top.is_finite());
        let Some(lowest) = tops.reduce(f32::min) else { return self.clone() };
        self.changed(&self.cells_in(&area).map(|index| (index, (lowest, TopKind::Ground))).collect())
    }

    /// The surface with additions.
    #[must_use]
    pub fn with_additions(&self, additions: &[Addition]) -> Self {
        let mut tops: BTreeMap<usize, f64> = BTreeMap::new();
        let mut raise = |index: usize, top_m: f64| {
            let known = tops.entry(index).or_insert(f64::NEG_INFINITY);
            *known = known.max(top_m);
        };
        additions.iter().for_each(|addition| self.cells_of(addition, &mut raise));
        let changes = tops.into_iter().map(|(index, top_m)| (index, (top_m - self.base_m) as f32));
        let higher = changes.filter(|(index, top)| self.is_known(*index) && *top > self.top(*index));
        self.changed(&higher.map(|(index, top)| (index, (top, TopKind::Other))).collect())
    }

    /// The rectangle on the map around the cells whose tops are others than before; `None` if all are the same.
    #[must_use]
    pub fn changes_from(&self, before: &Self) -> Option<[[f64; 2]; 2]> {
        let width = self.size()[0];
        let changed = (0..self.tops.values.len()).filter(|index| !is_same([before, self], *index));
        let cells = changed.map(|index| [index % width, index / width].map(|v| v as f64));
        let around = cells.fold(None, |around: Option<[[f64; 2]; 2]>, cell| {
            let [low, high] = around.unwrap_or([cell; 2]);
            Some([[0, 1].map(|k| low[k].min(cell[k])), [0, 1].map(|k| high[k].max(cell[k]))])
        });
        around.map(|[low, high]| {
            let place = |cell: [f64; 2]| [0, 1].map(|k| self.corner[k] + cell[k] * self.cell_m);
            [place(low), place(high.map(|v| v + 1.0))]
        })
    }

    /// The borders on the map of what was added since before, of a part of its cells: closed rings in world metres. They are those of the
    /// additions where these have plain ones, all of them in the part, else of cells.
    #[must_use]
    pub fn borders_of_added(&self, before: &Self, part: CellExtent, additions: &[&Addition]) -> Vec<Vec<[f64; 2]>> {
        let extent = self.extent;
        let is_in = |index: usize| {
            let cell = [index as u32 % extent.size[0], index as u32 / extent.size[0]];
            (0..2).all(|k| (part.min[k]..part.min[k] + part.size[k]).contains(&(extent.min[k] + cell[k])))
        };
        let mut added: Vec<bool> =
            (0..self.tops.values.len()).map(|index| is_in(index) && self.is_added(before, index)).collect();
        let [low, high] = [part.min, [0, 1].map(|k| part.min[k] + part.size[k])].map(|cell| self.corner_of(cell));
        let is_whole = |polygon: &Polygon| {
            polygon.iter().flatten().all(|place| (0..2).all(|k| (low[k]..=high[k]).contains(&place[k])))
        };
        let mut borders = Vec::new();
        for addition in additions {
            let plain = match addition {
                Addition::Model(triangles) => footprint(triangles),
                Addition::Block { outline, .. } => Some(outline.clone()),
            };
            let Some(plain) = plain.filter(is_whole) else { continue };
            self.cells_of(addition, &mut |index, _| added[index] = false);
            borders.extend(plain);
        }
        let place = |corner: &[u32; 2]| [0, 1].map(|k| self.corner[k] + f64::from(corner[k]) * self.cell_m);
        let of_cells = outlines(&added, self.size()[0]);
        borders.extend(of_cells.iter().flatten().map(|ring| ring.iter().map(place).collect::<Vec<_>>()));
        for border in &mut borders {
            let first = border.first().copied();
            if first != border.last().copied() {
                border.extend(first);
            }
        }
        borders
    }

    /// Whether the top of a cell was added since before.
    #[must_use]
    pub fn is_added(&self, before: &Self, index: usize) -> bool {
        self.kind(index) == TopKind::Other && !is_same([before, self], index)
    }

    /// The cells below an addition, with its height there; several times where it has several.
    fn cells_of(&self, addition: &Addition, raise: &mut impl FnMut(usize, f64)) {
        match addition {
            Addition::Model(triangles) => {
                for triangle in triangles {
                    self.tops_of(triangle, raise);
                }
            }
            Addition::Block { outline, top_m } => self.cells_in(outline).for_each(|index| raise(index, *top_m)),
        }
    }

    /// Indices of the cells with the middle in a polygon.
    fn cells_in(&self, area: &Polygon) -> impl Iterator<Item = usize> {
        let [low, high] = area_around(area.iter().flatten().copied());
        let [columns, rows] = self.span(low, high);
        let area = SelectedArea::new(vec![area.clone()]);
        let (width, corner, cell_m) = (self.size()[0], self.corner, self.cell_m);
        let middle = move |cell: usize, axis: usize| corner[axis] + (cell as f64 + 0.5) * cell_m;
        // Row by row, because a border may have many corners.
        rows.flat_map(move |y| {
            let crossings = area.crossings(middle(y, 1));
            let is_inside = move |x: &usize| crossings.partition_point(|at| *at <= middle(*x, 0)) % 2 == 1;
            columns.clone().filter(is_inside).map(move |x| y * width + x)
        })
    }

    /// The columns and rows of a rectangle in world metres.
    fn span(&self, low: [f64; 2], high: [f64; 2]) -> [std::ops::Range<usize>; 2] {
        let size = self.size();
        [0, 1].map(|k| {
            let [first, last] = [low[k], high[k]].map(|v| (v - self.corner[k]) / self.cell_m);
            let [first, end] = [first.floor(), last.floor() + 1.0].map(|v| v.clamp(0.0, size[k] as f64) as usize);
            first..end.max(first)
        })
    }

    /// Heights of a triangle at the middles of the cells below it.
    fn tops_of(&self, triangle: &[[f64; 3]; 3], raise: &mut impl FnMut(usize, f64)) {
        let [a, b, c] = triangle.map(|[x, y, _]| DVec2::new(x, y));
        let doubled_area = (b - a).perp_dot(c - a);
        if doubled_area.abs() < 1e-9 {
            return;
        }
        let [columns, rows] = self.span(a.min(b).min(c).to_array(), a.max(b).max(c).to_array());
        for (y, x) in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let middle = DVec2::from(self.corner) + DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * self.cell_m;
            let v = (middle - a).perp_dot(c - a) / doubled_area;
            let w = (b - a).perp_dot(middle - a) / doubled_area;
            if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
                let [za, zb, zc] = triangle.map(|[_, _, z]| z);
                raise(y * self.size()[0] + x, za + v * (zb - za) + w * (zc - za));
            }
        }
    }

    /// Ground for open cells, as high as the nearest that is left.
    fn ground_within(&self, mut open: Vec<bool>) -> BTreeMap<usize, (f32, TopKind)> {
        let [width, height] = self.size();
        let around = |index: usize| {
            let (x, y) = (index % width, index / width);
            let left = (x > 0).then(|| index - 1);
            let right = (x + 1 < width).then_some(index + 1);
            let below = (y > 0).then(|| index - width);
            let above = (y + 1 < height).then_some(index + width);
            [left, right, below, above].into_iter().flatten()
        };
        let is_ground = |index: &usize| self.kind(*index).is_ground();
        let mut changes = BTreeMap::new();
        let mut next: VecDeque<(usize, f32)> = VecDeque::new();
        for index in (0..open.len()).filter(|index| open[*index]) {
            next.extend(around(index).find(is_ground).map(|ground| (index, self.top(ground))));
        }
        while let Some((index, top)) = next.pop_front() {
            if std::mem::take(&mut open[index]) {
                changes.insert(index, (top, TopKind::Ground));
                next.extend(around(index).filter(|index| open[*index]).map(|index| (index, top)));
            }
        }
        changes
    }
}

/// Whether the same thing is on top of a cell of two surfaces.
fn is_same(surfaces: [&CitySurface; 2], index: usize) -> bool {
    let [before, after] = surfaces.map(|surface| (surface.top(index).to_bits(), surface.kind(index)));
    before == after
}

/// Values of tops and of points on walls, before and after a change of a surface.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceValues<'a> {
    pub surface: &'a CitySurface,
    pub tops: &'a [f32],
    pub points: &'a [WallPoint],
    pub walls: &'a [f32],
}

/// How far values change: of all tops, NaN where another thing is on top; and of the points on walls that are there before and after, with
/// those points.
#[must_use]
pub fn change(before: SurfaceValues<'_>, after: SurfaceValues<'_>) -> (Vec<f32>, Vec<WallPoint>, Vec<f32>) {
    let surfaces = [before.surface, after.surface];
    let tops = before.tops.iter().zip(after.tops).enumerate();
    let tops =
        tops.map(|(index, (before, after))| if is_same(surfaces, index) { after - before } else { f32::NAN }).collect();
    let key = |point: &WallPoint| (point.cell, point.height_m.to_bits(), point.azimuth_deg.to_bits(), point.building);
    let later: HashMap<_, f32> = after.points.iter().map(key).zip(after.walls.iter().copied()).collect();
    let kept = before.points.iter().zip(before.walls);
    let kept = kept.filter_map(|(point, value)| Some((*point, later.get(&key(point))? - value)));
    let (points, walls) = kept.unzip();
    (tops, points, walls)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_surface::surface;

    /// Land that rises to the east, with a house of 6 m on it.
    fn town() -> CitySurface {
        surface(40, 30, |x, y| if (10..20).contains(&x) && (8..14).contains(&y) { 6.0 } else { x as f32 * 0.01 })
    }

    fn square(low: [f64; 2], high: [f64; 2]) -> Polygon {
        vec![vec![low, [high[0], low[1]], high, [low[0], high[1]]]]
    }

    #[test]
    fn where_a_house_is_removed_there_is_ground() {
        let town = town();
        for cleared in [
            town.without_objects(&|building| building.identifier == "house", &[]),
            town.without_objects(&|_| false, &[square([1009.0, 2007.0], [1021.0, 2015.0])]),
        ] {
            assert!((0..40 * 30).all(|index| cleared.kind(index) == TopKind::Ground));
            assert!(cleared.tops.values.iter().all(|top| *top < 0.4), "as high as the land beside it");
        }
        let half = town.without_objects(&|_| false, &[square([1009.0, 2007.0], [1015.0, 2015.0])]);
        let kinds = [12, 17].map(|x| half.kind(10 * 40 + x));
        assert_eq!(kinds, [TopKind::Ground, TopKind::Roof(0)]);
        assert_eq!(town.without_objects(&|_| false, &[]).tops.values, town.tops.values);
    }

    #[test]
    fn additions_raise_the_cells_below_them() {
        let town = town();
        let block = Addition::Block { outline: square([1025.0, 2005.0], [1030.0, 2010.0]), top_m: 80.0 };
        // A roof that rises to the east, with a wall that has no area on the map.
        let [a, b, c, d] = [[5.0, 20.0, 51.0], [9.0, 20.0, 55.0], [9.0, 24.0, 55.0], [5.0, 24.0, 51.0]]
            .map(|[x, y, z]| [1000.0 + x, 2000.0 + y, z]);
        let model = Addition::Model(vec![[a, b, c], [a, c, d], [a, b, [b[0], b[1], b[2] - 1.0]]]);
        let additions = [block, model];
        let after = town.with_additions(&additions);
        let top = |x: usize, y: usize| (after.top(y * 40 + x), after.kind(y * 40 + x));
        assert_eq!(top(25, 5), (30.0, TopKind::Other));
        assert_eq!(top(30, 5).1, TopKind::Ground);
        assert_eq!([5, 8].map(|x| top(x, 21)), [(1.5, TopKind::Other), (4.5, TopKind::Other)]);
        let changed = (0..40 * 30).filter(|index| after.kind(*index) != town.kind(*index)).count();
        assert_eq!(changed, 25 + 16);
        assert_eq!(after.changes_from(&town), Some([[1005.0, 2005.0], [1030.0, 2024.0]]));
        assert_eq!(town.changes_from(&town), None);
        let borders = after.borders_of_added(&town, after.extent, &additions.each_ref());
        let block = [[1025.0, 2005.0], [1030.0, 2005.0], [1030.0, 2010.0], [1025.0, 2010.0], [1025.0, 2005.0]];
        assert_eq!((borders.len(), &borders[0][..]), (2, &block[..]));
        let south = CellExtent { min: [0, 0], size: [40, 8] };
        let block = [[1025.0, 2005.0], [1030.0, 2005.0], [1030.0, 2008.0], [1025.0, 2008.0], [1025.0, 2005.0]];
        assert_eq!(after.borders_of_added(&town, south, &additions.each_ref()), [block]);
        // What lies below the top of a house is not seen.
        let low = Addition::Block { outline: square([1010.0, 2008.0], [1020.0, 2014.0]), top_m: 52.0 };
        assert_eq!(town.with_additions(&[low]).tops.values, town.tops.values);
    }

    #[test]
    fn borders_of_what_is_added_have_no_steps() {
        let town = town();
        let ring = vec![[1022.2, 2004.0], [1034.0, 2011.7], [1027.5, 2021.0], [1022.2, 2004.0]];
        let block = Addition::Block { outline: vec![ring.clone()], top_m: 80.0 };
        let after = town.with_additions(std::slice::from_ref(&block));
        assert_eq!(after.borders_of_added(&town, after.extent, &[&block]), [ring]);
        // Two floors upon each other have no plain border: that of the cells is taken.
        let [a, b, c, d] = [[5.0, 20.0], [9.0, 20.0], [9.0, 24.0], [5.0, 24.0]].map(|[x, y]| [1000.0 + x, 2000.0 + y]);
        let floor = |z: f64| {
            let [a, b, c, d] = [a, b, c, d].map(|[x, y]| [x, y, z]);
            [[a, b, c], [a, c, d]]
        };
        let floors = Addition::Model([floor(55.0), floor(58.0)].concat());
        let after = town.with_additions(std::slice::from_ref(&floors));
        assert_eq!(after.borders_of_added(&town, after.extent, &[&floors]), [[a, b, c, d, a]]);
    }

    #[test]
    fn changes_are_of_what_is_there_before_and_after() {
        let town = town();
        let after = town
            .with_additions(&[Addition::Block { outline: square([1025.0, 2005.0], [1030.0, 2010.0]), top_m: 80.0 }]);
        let point = |cell, building| WallPoint { cell, height_m: 1.0, azimuth_deg: 90.0, building };
        let (points, tops) = ([point(1, 0), point(2, 0)], [vec![2.0; 1200], vec![1.5; 1200]]);
        let of = |surface, tops, points, walls| SurfaceValues { surface, tops, points, walls };
        let (tops, points, walls) =
            change(of(&town, &tops[0], &points, &[3.0, 4.0]), of(&after, &tops[1], &points[1..], &[1.0]));
        assert_eq!((points, walls), (vec![point(2, 0)], vec![-3.0]));
        assert!(tops[5 * 40 + 27].is_nan());
        assert_eq!(tops.iter().filter(|value| **value == -0.5).count(), 1200 - 25);
    }
}
