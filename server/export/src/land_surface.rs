//! Land as a surface with few triangles, in place of the steps that its columns are.

use crate::boxes::COLOUR_RANGE;
use crate::geometry::{Geometry, linear};
use crate::matrix::stretched;
use glam::{DAffine3, DVec2, Vec3};
use insula_protocol::blockmap::{MapColumn, NO_OBJECT};
use insula_protocol::{BlockMap, NODE_CELLS, octahedral};
use insula_roam::{HeightField, Place, triangulate};
use std::collections::BTreeMap;

/// Corners of cells along a node's side.
const CORNERS: usize = NODE_CELLS + 1;
/// How far the surface may lie from the corners of its columns, in cells: less than the columns' own error.
const ERROR_CELLS: f32 = 0.25;
/// Slopes whose normal points less far up say nothing of the height at a cell's corner.
const MIN_UP: f32 = 0.2;

/// A surface over places of a grid.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct LandSurface {
    pub(crate) places: Vec<Place>,
    /// Metres, one for each place.
    pub(crate) heights: Vec<f64>,
    /// Linear light, 0 to 255.
    pub(crate) colours: Vec<[u8; 3]>,
    /// Object of each place, or its row in a property table.
    pub(crate) objects: Vec<u32>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// The land of a node's columns. Heights are metres above the city's height zero, places corners of cells. It goes on below what
/// stands on it. Empty if no column is land.
pub(crate) fn land_of_columns(map: &BlockMap, is_land: &dyn Fn(u32) -> bool) -> LandSurface {
    let columns = map.columns();
    let object = |column: usize| map.objects.as_ref().map_or(NO_OBJECT, |objects| objects.roof[column]);
    let land: Vec<bool> =
        columns.iter().enumerate().map(|(i, column)| column.is_some() && is_land(object(i))).collect();
    let Some(heights) = corner_heights(map, &columns, &land) else { return LandSurface::default() };
    let field = HeightField::new([CORNERS as u32; 2], heights.clone());
    let mesh = field.map(|field| triangulate(&field, ERROR_CELLS * map.cell_m)).unwrap_or_default();
    // The column of a corner, a column of land if there is one.
    let column_at = |[x, y]: &Place| {
        let around = [(0, 0), (1, 0), (0, 1), (1, 1)].into_iter().filter_map(|(dx, dy)| {
            let [x, y] = [(*x as usize).checked_sub(dx)?, (*y as usize).checked_sub(dy)?];
            (x < NODE_CELLS && y < NODE_CELLS).then_some(y * NODE_CELLS + x)
        });
        let around: Vec<usize> = around.collect();
        around.iter().find(|i| land[**i]).or(around.first()).copied().unwrap_or(0)
    };
    let sources: Vec<usize> = mesh.vertices.iter().map(column_at).collect();
    let colour = |i: &usize| columns[*i].as_ref().map_or([0; 3], |column| column.roof.rgb().map(linear));
    LandSurface {
        heights: mesh.vertices.iter().map(|[x, y]| f64::from(heights[*y as usize * CORNERS + *x as usize])).collect(),
        colours: sources.iter().map(colour).collect(),
        objects: sources.iter().map(|i| if land[*i] { object(*i) } else { NO_OBJECT }).collect(),
        places: mesh.vertices,
        triangles: mesh.triangles,
    }
}

/// Whether the land of a node has about one colour.
pub(crate) fn has_one_colour(map: &BlockMap, is_land: &dyn Fn(u32) -> bool) -> bool {
    let object = |column: usize| map.objects.as_ref().map_or(NO_OBJECT, |objects| objects.roof[column]);
    let columns = map.columns();
    let land = columns.iter().enumerate().filter(|(i, _)| is_land(object(*i)));
    is_one_colour(land.filter_map(|(_, column)| Some(column.as_ref()?.roof.rgb())))
}

/// Whether 8-bit sRGB colours are about the same.
pub(crate) fn is_one_colour(colours: impl Iterator<Item = [u8; 3]>) -> bool {
    let (low, high) = colours.fold(([u8::MAX; 3], [0; 3]), |(low, high), colour| {
        ([0, 1, 2].map(|k| low[k].min(colour[k])), [0, 1, 2].map(|k| high[k].max(colour[k])))
    });
    (0..3).all(|k| high[k].saturating_sub(low[k]) <= COLOUR_RANGE)
}

/// Heights of the corners of cells, the mean of what the columns of land around each have there. Corners of other columns have the
/// mean of their neighbours; `NaN` without columns. `None` if no column is land.
fn corner_heights(map: &BlockMap, columns: &[Option<MapColumn>], land: &[bool]) -> Option<Vec<f32>> {
    let mut sums = vec![(0.0f32, 0u32); CORNERS * CORNERS];
    let mut is_missing = vec![false; CORNERS * CORNERS];
    for (i, column) in columns.iter().enumerate() {
        let Some(column) = column else { continue };
        let [x, y] = [i % NODE_CELLS, i / NODE_CELLS];
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let corner = (y + dy) * CORNERS + x + dx;
            is_missing[corner] = true;
            if land[i] {
                let (sum, count) = &mut sums[corner];
                *sum += corner_height(map, column, [dx, dy].map(|side| side as f32 - 0.5));
                *count += 1;
            }
        }
    }
    let mut heights: Vec<f32> = sums.iter().map(|(sum, count)| sum / *count as f32).collect();
    let mut missing: Vec<usize> = (0..heights.len()).filter(|i| is_missing[*i] && heights[*i].is_nan()).collect();
    // From the land inwards, ring by ring.
    while !missing.is_empty() {
        let filled: Vec<(usize, f32)> =
            missing.iter().map(|i| (*i, mean_around(&heights, *i))).filter(|(_, height)| !height.is_nan()).collect();
        if filled.is_empty() {
            return None;
        }
        filled.iter().for_each(|(i, height)| heights[*i] = *height);
        missing.retain(|i| heights[*i].is_nan());
    }
    heights.iter().any(|height| !height.is_nan()).then_some(heights)
}

/// Mean of the known heights beside a corner; `NaN` without one.
fn mean_around(heights: &[f32], corner: usize) -> f32 {
    let [x, y] = [corner % CORNERS, corner / CORNERS];
    let beside = [
        (x > 0).then(|| corner - 1),
        (x + 1 < CORNERS).then_some(corner + 1),
        (y > 0).then(|| corner - CORNERS),
        (y + 1 < CORNERS).then_some(corner + CORNERS),
    ];
    let known = beside.into_iter().flatten().map(|i| heights[i]).filter(|height| !height.is_nan());
    let (sum, count) = known.fold((0.0, 0u32), |(sum, count), height| (sum + height, count + 1));
    sum / count as f32
}

/// Height of a column's top at a place in cells from the middle of its cell.
fn corner_height(map: &BlockMap, column: &MapColumn, [x, y]: [f32; 2]) -> f32 {
    let middle = map.z_base_m() as f32 + f32::from(column.z_max) * map.z_step_m();
    let normal = Vec3::from(octahedral::decode(column.roof_normal));
    if !column.inclined || normal.z < MIN_UP {
        return middle;
    }
    middle - map.cell_m * (normal.x * x + normal.y * y) / normal.z
}

/// An edge that only one triangle of a surface has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BorderEdge {
    pub(crate) triangle: usize,
    /// The corner of the triangle with which it begins.
    pub(crate) side: usize,
    /// The places where it begins and ends, by their numbers.
    pub(crate) ends: [u32; 2],
}

/// The heights that vertices of a file may have: with the same ones, surfaces meet on a common border.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CommonHeights {
    low_m: f64,
    step_m: f64,
}

impl CommonHeights {
    /// As fine as 16 bits can be for these heights.
    pub(crate) fn over(heights_m: impl Iterator<Item = f64>) -> Self {
        let (low, high) =
            heights_m.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
        let low_m = if low.is_finite() { low } else { 0.0 };
        Self { low_m, step_m: ((high - low) / f64::from(u16::MAX)).max(1e-6) }
    }

    fn nearest(self, height_m: f64) -> u16 {
        ((height_m - self.low_m) / self.step_m).round() as u16
    }
}

impl LandSurface {
    /// The edges on its border, in a fixed order.
    pub(crate) fn border(&self) -> Vec<BorderEdge> {
        let mut edges: BTreeMap<[u32; 2], Option<BorderEdge>> = BTreeMap::new();
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for side in 0..3 {
                let ends = [corners[side], corners[(side + 1) % 3]];
                let name = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                let edge = BorderEdge { triangle, side, ends };
                edges.entry(name).and_modify(|known| *known = None).or_insert(Some(edge));
            }
        }
        edges.into_values().flatten().collect()
    }

    /// Hangs a strip of this height from those edges of the border that are open, by the places of their ends: nothing else begins there
    /// that has the same edge.
    pub(crate) fn add_skirt(&mut self, height_m: f64, is_open: &dyn Fn([Place; 2]) -> bool) {
        let mut lower: BTreeMap<u32, u32> = BTreeMap::new();
        for BorderEdge { ends: [a, b], .. } in self.border() {
            if is_open([a, b].map(|v| self.places[v as usize])) {
                let [low_a, low_b] =
                    [a, b].map(|v| *lower.entry(v).or_insert_with(|| self.add_below(v as usize, height_m)));
                self.triangles.extend([[b, a, low_a], [b, low_a, low_b]]);
            }
        }
    }

    fn add_below(&mut self, vertex: usize, height_m: f64) -> u32 {
        let below = self.places.len() as u32;
        self.places.push(self.places[vertex]);
        self.heights.push(self.heights[vertex] - height_m);
        self.colours.push(self.colours[vertex]);
        self.objects.push(self.objects[vertex]);
        below
    }

    /// The surface as glTF stores it, and the matrix from its grid to metres. Its objects must be rows of the property table, `origin` and
    /// `step` are those of the places, of which there must be fewer than 2^16 a side.
    pub(crate) fn geometry(self, (origin, step): (DVec2, DVec2), heights: CommonHeights) -> (Geometry, DAffine3) {
        let position = |([x, y], z): (&Place, &f64)| [*x as u16, *y as u16, heights.nearest(*z)];
        let mut geometry = Geometry {
            positions: self.places.iter().zip(&self.heights).map(position).collect(),
            colours: self.colours,
            features: self.objects,
            indices: self.triangles.concat(),
            ..Geometry::default()
        };
        geometry.drop_empty_features();
        (geometry, stretched(step.extend(heights.step_m), origin.extend(heights.low_m)))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use insula_protocol::TileId;
    use insula_protocol::blockmap::COLUMNS;

    /// Columns of 2 m on a plane that rises by 1 in 8 to the east.
    pub(crate) fn slope(is_there: impl Fn(usize, usize) -> bool) -> BlockMap {
        let normal = Vec3::new(-0.125, 0.0, 1.0).normalize();
        let columns: Vec<Option<MapColumn>> = (0..COLUMNS)
            .map(|i| {
                let (x, y) = (i % NODE_CELLS, i / NODE_CELLS);
                let column = MapColumn {
                    // Steps of a sixteenth of a cell, half a cell to the middle.
                    z_max: (16 + 2 * x + 1) as u16,
                    inclined: true,
                    roof_normal: octahedral::encode(normal.to_array()),
                    ..MapColumn::default()
                };
                is_there(x, y).then_some(column)
            })
            .collect();
        BlockMap::from_columns(TileId::ROOT, 2.0, 3, 0, &columns).unwrap()
    }

    #[test]
    fn an_inclined_plane_has_two_triangles() {
        let land = land_of_columns(&slope(|_, _| true), &|_| true);
        assert_eq!((land.triangles.len(), &land.objects), (2, &vec![NO_OBJECT; 4]));
        for ([x, _], z) in land.places.iter().zip(&land.heights) {
            // The base of 3 cells, a cell, and an eighth of the way.
            assert!((z - (6.0 + 2.0 + f64::from(*x) / 4.0)).abs() < 0.02, "{x} {z}");
        }
    }

    #[test]
    fn land_ends_with_its_columns_and_goes_on_below_houses() {
        let part = land_of_columns(&slope(|x, _| x < 20), &|_| true);
        assert_eq!(part.places.iter().map(|place| place[0]).max(), Some(20));
        assert_eq!(land_of_columns(&slope(|_, _| false), &|_| true), LandSurface::default());
        let mut map = slope(|_, _| true);
        let mut objects = insula_protocol::blockmap::ColumnObjects::default();
        (20..30).for_each(|y| objects.roof[y * NODE_CELLS + 20..][..10].fill(7));
        map.objects = Some(Box::new(objects));
        let land = land_of_columns(&map, &|object| object != 7);
        let area: f64 = land
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| land.places[v as usize].map(f64::from)).map(DVec2::from);
                0.5 * (b - a).perp_dot(c - a)
            })
            .sum();
        assert_eq!(area, 64.0 * 64.0);
        assert!(land.heights.iter().all(|z| (8.0..=24.1).contains(z)));
        assert_eq!(land_of_columns(&map, &|_| false), LandSurface::default());
    }

    #[test]
    fn a_skirt_hangs_from_the_open_border() {
        let mut land = land_of_columns(&slope(|_, _| true), &|_| true);
        assert_eq!(land.border().len(), 4);
        // All but the western side: two triangles for each of the other three.
        land.add_skirt(3.0, &|ends| ends.iter().any(|[x, _]| *x > 0));
        assert_eq!((land.triangles.len(), land.places.len()), (8, 8));
        let heights = CommonHeights::over(land.heights.iter().copied());
        let (geometry, matrix) = land.geometry((DVec2::new(5.0, 6.0), DVec2::splat(2.0)), heights);
        let heights: Vec<f64> =
            geometry.positions.iter().map(|p| matrix.transform_point3(p.map(f64::from).into()).z).collect();
        let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
        assert!((lowest - 5.0).abs() < 0.02, "{heights:?}");
        assert_eq!(matrix.translation.truncate(), DVec2::new(5.0, 6.0));
        assert!(geometry.features.is_empty());
    }

    #[test]
    fn colours_are_one_within_a_range() {
        assert!(is_one_colour([[10, 20, 30], [50, 60, 70]].into_iter()) && is_one_colour([].into_iter()));
        assert!(!is_one_colour([[10, 20, 30], [10, 61, 30]].into_iter()));
    }
}
