//! Which part of a city an export has.

use crate::source::{ExportSource, SourceError};
use insula_objects::{
    BLOCK_OBJECTS,
    filter::{Filter, FilterBuilder},
};
use roaring::RoaringBitmap;

/// The rings of a polygon.
pub type Polygon = Vec<Vec<[f64; 2]>>;

/// A part of a city: the objects and places that are in all of the given sets.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ObjectSelection {
    /// Lower and upper corner in world metres, borders included.
    pub bbox: Option<[[f64; 2]; 2]>,
    /// Polygons of closed rings in world metres. A place inside an odd number of the rings of any of them is selected; the last point
    /// need not repeat the first.
    pub polygons: Option<Vec<Polygon>>,
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
        let in_polygon = |rings: &Polygon| rings.iter().filter(|ring| is_inside(ring, point)).count() % 2 == 1;
        let in_any = |polygons: &Vec<Polygon>| polygons.iter().any(in_polygon);
        self.bbox.is_none_or(in_bbox) && self.polygons.as_ref().is_none_or(in_any)
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
        let around = self.polygons.as_ref().map(|polygons| {
            let nothing = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
            polygons.iter().flatten().flatten().fold(nothing, |[min, max], point| {
                [[0, 1].map(|k| min[k].min(point[k])), [0, 1].map(|k| max[k].max(point[k]))]
            })
        });
        match (self.bbox, around) {
            (Some(a), Some(b)) => Some([[0, 1].map(|k| a[0][k].max(b[0][k])), [0, 1].map(|k| a[1][k].min(b[1][k]))]),
            (area, other) => area.or(other),
        }
    }
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

/// Whether a point lies inside a ring.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_in_the_area_of_their_middle() {
        let ring = |min: f64, max: f64| vec![[min, min], [max, min], [max, max], [min, max]];
        let selection = ObjectSelection {
            bbox: Some([[0.0, 0.0], [8.0, 20.0]]),
            polygons: Some(vec![vec![ring(0.0, 10.0), ring(4.0, 6.0)], vec![ring(7.0, 9.0)], vec![ring(6.5, 8.0)]]),
            objects: Some([1, 2].into_iter().collect()),
        };
        let at = |object, x: f64, y: f64| selection.contains(object, Some([[x - 9.0, y - 1.0], [x + 9.0, y + 1.0]]));
        assert!(at(1, 2.0, 2.0) && at(2, 7.0, 5.0) && at(1, 7.5, 7.4), "polygons may lie on each other");
        assert!(!at(3, 2.0, 2.0) && !at(1, 5.0, 5.0) && !at(1, 9.0, 5.0) && !at(1, 2.0, 12.0));
        assert!(!selection.contains(1, None));
        assert_eq!(selection.area(), Some([[0.0, 0.0], [8.0, 10.0]]));
        assert!(selection.may_touch([[8.0, 9.0], [10.0, 10.0]]) && !selection.may_touch([[8.5, 9.0], [10.0, 10.0]]));
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
