//! Polygons as well-known binary and well-known text (OGC 06-103r4, Simple Features).

use crate::selection::Polygon;

/// Type codes of geometries.
const POLYGON: u32 = 3;
const MULTI_POLYGON: u32 = 6;

/// A polygon, or a multipolygon of several; `None` of nothing. Little-endian.
pub(super) fn well_known_binary(polygons: &[Polygon]) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    match polygons {
        [] => return None,
        [polygon] => push_polygon(&mut out, polygon),
        _ => {
            push_head(&mut out, MULTI_POLYGON, polygons.len());
            polygons.iter().for_each(|polygon| push_polygon(&mut out, polygon));
        }
    }
    Some(out)
}

fn push_head(out: &mut Vec<u8>, code: u32, count: usize) {
    out.push(1);
    out.extend(code.to_le_bytes());
    out.extend((count as u32).to_le_bytes());
}

fn push_polygon(out: &mut Vec<u8>, rings: &[Vec<[f64; 2]>]) {
    push_head(out, POLYGON, rings.len());
    for ring in rings {
        out.extend((ring.len() as u32).to_le_bytes());
        out.extend(ring.iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
}

/// `POLYGON ((x y, ...), ...)`, or `MULTIPOLYGON` of several; empty of nothing.
pub(super) fn well_known_text(polygons: &[Polygon]) -> String {
    let ring = |ring: &Vec<[f64; 2]>| {
        let points: Vec<String> = ring.iter().map(|[x, y]| format!("{x} {y}")).collect();
        format!("({})", points.join(","))
    };
    let polygon = |rings: &Polygon| format!("({})", rings.iter().map(ring).collect::<Vec<_>>().join(","));
    match polygons {
        [] => String::new(),
        [only] => format!("POLYGON {}", polygon(only)),
        _ => format!("MULTIPOLYGON ({})", polygons.iter().map(polygon).collect::<Vec<_>>().join(",")),
    }
}

/// West, south, east and north end of polygons; `None` of nothing.
pub(super) fn bounds(polygons: &[Polygon]) -> Option<[f64; 4]> {
    polygons.iter().flatten().flatten().fold(None, |bounds: Option<[f64; 4]>, [x, y]| {
        let [west, south, east, north] = bounds.unwrap_or([*x, *y, *x, *y]);
        Some([west.min(*x), south.min(*y), east.max(*x), north.max(*y)])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(at: f64) -> Polygon {
        vec![vec![[at, 0.0], [at + 1.5, 0.0], [at, 1.0], [at, 0.0]]]
    }

    #[test]
    fn one_polygon_and_several() {
        assert_eq!(well_known_text(&[]), "");
        assert_eq!(well_known_text(&[triangle(2.0)]), "POLYGON ((2 0,3.5 0,2 1,2 0))");
        assert_eq!(
            well_known_text(&[triangle(0.0), triangle(2.0)]),
            "MULTIPOLYGON (((0 0,1.5 0,0 1,0 0)),((2 0,3.5 0,2 1,2 0)))"
        );
        assert_eq!(well_known_binary(&[]), None);
        let one = well_known_binary(&[triangle(0.0)]).unwrap();
        assert_eq!((one.len(), &one[..9]), (13 + 4 * 16, &[1, 3, 0, 0, 0, 1, 0, 0, 0][..]));
        let two = well_known_binary(&[triangle(0.0), triangle(2.0)]).unwrap();
        assert_eq!((two.len(), two[1]), (9 + 2 * one.len(), 6));
        assert_eq!(&two[9..9 + one.len()], &one[..]);
        assert_eq!(bounds(&[triangle(0.0), triangle(2.0)]), Some([0.0, 0.0, 3.5, 1.0]));
    }
}
