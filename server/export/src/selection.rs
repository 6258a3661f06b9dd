//! Which part of a city an export has.

use crate::source::{ExportSource, SourceError};
use insula_objects::BLOCK_OBJECTS;
use insula_objects::filter::{Filter, FilterBuilder};
use roaring::RoaringBitmap;

/// The rings of a polygon.
pub type Polygon = Vec<Vec<[f64; 2]>>;

/// Most bands of an area.
const MAX_BANDS: usize = 4096;
/// Edges are in so many bands on average at most.
const BANDS_OF_EDGE: usize = 4;

/// Polygons of closed rings in world metres. A place inside an odd number of the rings of any of them is in the area; the last point of a
/// ring need not repeat the first.
///
/// Their edges are kept by bands from west to east, so that a place is compared with those of its band only.
#[derive(Debug, Clone, PartialEq)]
pub struct SelectedArea {
    polygons: Vec<Polygon>,
    /// Lowest y, and bands in a metre.
    from: [f64; 2],
    bands: Vec<Vec<AreaEdge>>,
}

/// From one corner of a ring to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
struct AreaEdge {
    polygon: u32,
    ends: [[f64; 2]; 2],
}

impl AreaEdge {
    /// Where it crosses a line from west to east; `None` if it does not.
    fn crossing(&self, y: f64) -> Option<f64> {
        let [[x0, y0], [x1, y1]] = self.ends;
        ((y0 > y) != (y1 > y)).then(|| x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    }
}

impl SelectedArea {
    /// The area of polygons.
    #[must_use]
    pub fn new(polygons: Vec<Polygon>) -> Self {
        let rings = (0u32..).zip(&polygons).flat_map(|(polygon, rings)| rings.iter().map(move |ring| (polygon, ring)));
        let edges = rings.flat_map(|(polygon, ring)| {
            let before = ring.last().into_iter().chain(ring);
            before.zip(ring).map(move |(from, to)| AreaEdge { polygon, ends: [*from, *to] })
        });
        let edges: Vec<AreaEdge> = edges.filter(|edge| edge.ends[0][1] != edge.ends[1][1]).collect();
        let ys = || edges.iter().flat_map(|edge| edge.ends).map(|[_, y]| y);
        let (low, high) = (ys().fold(f64::INFINITY, f64::min), ys().fold(f64::NEG_INFINITY, f64::max));
        let mut count = edges.len().clamp(1, MAX_BANDS);
        loop {
            let per_metre = count as f64 / (high - low).max(f64::MIN_POSITIVE);
            let mut area = Self { polygons: Vec::new(), from: [low, per_metre], bands: vec![Vec::new(); count] };
            let spans = edges.iter().map(|edge| area.bands_of(edge));
            if count == 1 || spans.map(|span| span.count()).sum::<usize>() <= BANDS_OF_EDGE * edges.len() {
                for edge in &edges {
                    area.bands_of(edge).for_each(|band| area.bands[band].push(*edge));
                }
                return Self { polygons, ..area };
            }
            count /= 2;
        }
    }

    /// The polygons.
    #[must_use]
    pub fn polygons(&self) -> &[Polygon] {
        &self.polygons
    }

    /// Whether a place is in the area.
    #[must_use]
    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let is_east = |edge: &&AreaEdge| edge.crossing(y).is_some_and(|crossing| x < crossing);
        // The edges of a polygon follow each other.
        let mut crossed = self.bands[self.band(y)].iter().filter(is_east).peekable();
        while let Some(first) = crossed.next() {
            let mut count = 1;
            while crossed.next_if(|edge| edge.polygon == first.polygon).is_some() {
                count += 1;
            }
            if count % 2 == 1 {
                return true;
            }
        }
        false
    }

    /// Where the borders of an area of one polygon cross a line from west to east, ascending: places between an odd number of crossings and
    /// the next one are inside.
    #[must_use]
    pub fn crossings(&self, y: f64) -> Vec<f64> {
        let mut all: Vec<f64> = self.bands[self.band(y)].iter().filter_map(|edge| edge.crossing(y)).collect();
        all.sort_unstable_by(f64::total_cmp);
        all
    }

    fn band(&self, y: f64) -> usize {
        let [low, per_metre] = self.from;
        ((y - low) * per_metre).clamp(0.0, (self.bands.len() - 1) as f64) as usize
    }

    fn bands_of(&self, edge: &AreaEdge) -> std::ops::RangeInclusive<usize> {
        let [from, to] = edge.ends.map(|[_, y]| self.band(y));
        from.min(to)..=from.max(to)
    }
}

/// A part of a city: the objects and places that are in all of the given sets.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ObjectSelection {
    /// Lower and upper corner in world metres, borders included.
    pub bbox: Option<[[f64; 2]; 2]>,
    /// Polygons in world metres.
    pub polygons: Option<SelectedArea>,
    /// Numbers of objects.
    pub objects: Option<RoaringBitmap>,
}

impl ObjectSelection {
    /// Whether an object is selected: its number, and the middle of its bounds on the map. So of two areas side by side, one has
    /// it. An object without bounds is selected if only numbers restrict the selection.
    #[must_use]
    pub fn contains(&self, object: u32, bounds: Option<[[f64; 2]; 2]>) -> bool {
        let is_in_area = match bounds {
            Some([min, max]) => self.contains_point([0, 1].map(|k| 0.5 * (min[k] + max[k]))),
            None => self.bbox.is_none() && self.polygons.is_none(),
        };
        is_in_area && self.contains_object(object)
    }

    /// Whether an object is selected wherever it is.
    #[must_use]
    pub fn contains_object(&self, object: u32) -> bool {
        self.objects.as_ref().is_none_or(|objects| objects.contains(object))
    }

    /// Whether a place is selected, in world metres.
    #[must_use]
    pub fn contains_point(&self, point: [f64; 2]) -> bool {
        let in_bbox = |[min, max]: [[f64; 2]; 2]| [0, 1].iter().all(|k| min[*k] <= point[*k] && point[*k] <= max[*k]);
        self.bbox.is_none_or(in_bbox) && self.polygons.as_ref().is_none_or(|area| area.contains(point))
    }

    /// Whether a rectangle may have selected places. Never false if it has one.
    #[must_use]
    pub fn may_touch(&self, [min, max]: [[f64; 2]; 2]) -> bool {
        self.area().is_none_or(|area| [0, 1].iter().all(|k| area[0][*k] <= max[*k] && min[*k] <= area[1][*k]))
    }

    /// Lower and upper corner of a rectangle around all selected places; `None` if the selection has no area. Corners are
    /// inverted if no place is selected.
    #[must_use]
    pub fn area(&self) -> Option<[[f64; 2]; 2]> {
        let around = self.polygons.as_ref().map(|area| area_around(area.polygons.iter().flatten().flatten().copied()));
        match (self.bbox, around) {
            (Some(a), Some(b)) => Some([[0, 1].map(|k| a[0][k].max(b[0][k])), [0, 1].map(|k| a[1][k].min(b[1][k]))]),
            (area, other) => area.or(other),
        }
    }
}

/// Lower and upper corner of the rectangle around places; inverted without any.
#[must_use]
pub fn area_around(places: impl Iterator<Item = [f64; 2]>) -> [[f64; 2]; 2] {
    let nothing = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    places
        .fold(nothing, |[min, max], place| [[0, 1].map(|k| min[k].min(place[k])), [0, 1].map(|k| max[k].max(place[k]))])
}

/// The objects of a city that pass a filter, with the parts of those that do. Fails if objects cannot be read.
pub fn passing(source: &dyn ExportSource, filter: &Filter) -> Result<RoaringBitmap, SourceError> {
    let mut builder = FilterBuilder::default();
    for number in 0..source.schema().objects.div_ceil(BLOCK_OBJECTS as u32) {
        if let Some(block) = source.objects(number)? {
            builder.add(&block, filter);
        }
    }
    for [parents, parts] in builder.apart() {
        if let (Some(parents), Some(parts)) = (source.objects(parents)?, source.objects(parts)?) {
            builder.add_apart(&parents, &parts, filter);
        }
    }
    Ok(builder.finish().passing)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    #[test]
    fn objects_are_in_the_area_of_their_middle() {
        let ring = |min: f64, max: f64| vec![[min, min], [max, min], [max, max], [min, max]];
        let selection = ObjectSelection {
            bbox: Some([[0.0, 0.0], [8.0, 20.0]]),
            polygons: Some(SelectedArea::new(vec![
                vec![ring(0.0, 10.0), ring(4.0, 6.0)],
                vec![ring(7.0, 9.0)],
                vec![ring(6.5, 8.0)],
            ])),
            objects: Some([1, 2].into_iter().collect()),
        };
        let at = |object, x: f64, y: f64| selection.contains(object, Some([[x - 9.0, y - 1.0], [x + 9.0, y + 1.0]]));
        assert!(at(1, 2.0, 2.0) && at(2, 7.0, 5.0) && at(1, 7.5, 7.4), "polygons may lie on each other");
        assert!(!at(3, 2.0, 2.0) && !at(1, 5.0, 5.0) && !at(1, 9.0, 5.0) && !at(1, 2.0, 12.0));
        assert!(!selection.contains(1, None));
        assert_eq!(selection.area(), Some([[0.0, 0.0], [8.0, 10.0]]));
        assert!(selection.may_touch([[8.0, 9.0], [10.0, 10.0]]) && !selection.may_touch([[8.5, 9.0], [10.0, 10.0]]));
    }

    /// Whether a point lies inside a ring, by all of its edges.
    fn is_inside(ring: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
        let mut is_inside = false;
        let mut previous = ring.last().copied().unwrap_or_default();
        for &point in ring {
            let ([x0, y0], [x1, y1]) = (previous, point);
            if (y0 > y) != (y1 > y) && x < x0 + (y - y0) / (y1 - y0) * (x1 - x0) {
                is_inside = !is_inside;
            }
            previous = point;
        }
        is_inside
    }

    #[test]
    fn bands_find_what_all_edges_do() {
        let mut rng = Rng::new(51);
        for corners in [3, 5, 40, 3000] {
            let mut ring = || (0..corners).map(|_| [0, 1].map(|_| rng.below(200) as f64 / 2.0)).collect::<Vec<_>>();
            let polygons = vec![vec![ring(), ring()], vec![ring()], vec![vec![[5.0, 5.0]; 4]]];
            let area = SelectedArea::new(polygons.clone());
            for _ in 0..500 {
                let place = [0, 1].map(|_| rng.below(420) as f64 / 4.0 - 2.5);
                let in_polygon = |rings: &Polygon| rings.iter().filter(|ring| is_inside(ring, place)).count() % 2 == 1;
                assert_eq!(area.contains(place), polygons.iter().any(in_polygon), "{corners} corners, {place:?}");
                let one = SelectedArea::new(polygons[1..2].to_vec());
                let before = one.crossings(place[1]).iter().filter(|at| **at <= place[0]).count();
                assert_eq!(before % 2 == 1, in_polygon(&polygons[1]), "{corners} corners, {place:?}");
            }
        }
        assert!(!SelectedArea::new(Vec::new()).contains([0.0; 2]));
    }

    #[test]
    fn a_place_is_compared_with_few_edges_of_a_long_border() {
        let border = |i: u32| {
            let angle = f64::from(i) / 100_000.0 * std::f64::consts::TAU;
            [1000.0 * angle.cos(), 1000.0 * angle.sin()]
        };
        let area = SelectedArea::new(vec![vec![(0..100_000).map(border).collect()]]);
        assert!(area.contains([0.0; 2]) && !area.contains([999.0, 999.0]));
        let most = area.bands.iter().map(Vec::len).max().unwrap();
        assert!(most < 5000, "{most} edges in a band");
        // A comb, all of whose edges are in all bands, takes no more memory than a few bands.
        let comb = (0..100_000).map(|i| [f64::from(i), f64::from(i % 2)]).collect();
        let comb = SelectedArea::new(vec![vec![comb]]);
        assert!(comb.bands.iter().map(Vec::len).sum::<usize>() <= BANDS_OF_EDGE * 100_000);
        assert!(comb.contains([500.0, 0.001]) && !comb.contains([500.0, 0.999]));
    }

    #[test]
    fn without_sets_everything_is_selected() {
        let all = ObjectSelection::default();
        assert!(all.contains(7, None) && all.contains_point([1e9, -1e9]) && all.may_touch([[0.0; 2]; 2]));
        let some = ObjectSelection { objects: Some([7].into_iter().collect()), ..all };
        assert!(some.contains(7, None) && !some.contains(8, None));
        assert_eq!(some.area(), None);
    }
}
