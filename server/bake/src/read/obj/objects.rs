//! Which faces of an OBJ make one object: its own groups, else what hangs together.
//!
//! In: a [`ObjFile`]. Out: [`FaceGroups`]. Next: `builder`.

use std::collections::HashMap;

use super::parse::{ObjFace, ObjFile};

/// Positions that round to the same millimetre are one: tiles come with every triangle's corners for itself.
const WELD_PER_M: f64 = 1000.0;

/// Objects of a model.
pub(super) struct FaceGroups {
    /// Identifiers.
    pub(super) ids: Vec<String>,
    /// For each of the given polygons its object; those in order of their first polygon.
    pub(super) of_polygon: Vec<u32>,
}

/// Groups polygons. `o` goes before `g`; a name that all faces share groups nothing, nor does one that exporters give
/// to everything, and then each connected component is an object.
pub(super) fn group(model: &ObjFile, polygons: &[ObjFace], stem: &str) -> FaceGroups {
    type Key = fn(&ObjFace) -> u32;
    let keys: [Key; 2] = [|polygon| polygon.object, |polygon| polygon.group];
    for key in keys {
        let first = polygons.first().map(key);
        if polygons.iter().any(|polygon| Some(key(polygon)) != first) {
            let labels: Vec<u32> = polygons.iter().map(key).collect();
            let (names, of_polygon) = in_order(&labels);
            let name = |label: &u32| match model.names[*label as usize].as_str() {
                "" => stem.to_owned(),
                name => name.to_owned(),
            };
            return FaceGroups { ids: names.iter().map(name).collect(), of_polygon };
        }
    }
    let shared_name = polygons.first().map_or("", |polygon| {
        let names = [polygon.object, polygon.group].map(|i| model.names[i as usize].as_str());
        names.into_iter().find(|name| !matches!(*name, "" | "default" | "off")).unwrap_or("")
    });
    let prefix = if shared_name.is_empty() { stem } else { shared_name };
    if is_terrain(prefix) {
        return FaceGroups { ids: vec![prefix.to_owned()], of_polygon: vec![0; polygons.len()] };
    }
    let (components, of_polygon) = in_order(&components(model, polygons));
    let id = |i: usize| if components.len() == 1 { prefix.to_owned() } else { format!("{prefix}#{i}") };
    FaceGroups { ids: (0..components.len()).map(id).collect(), of_polygon }
}

/// OBJ has no types, so the name must do: the ground is one-sided and everything else is not.
pub(super) fn is_terrain(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    ["terrain", "relief", "dem", "dtm", "tin"].iter().any(|word| {
        name.strip_prefix(word).is_some_and(|rest| !rest.starts_with(|next: char| next.is_ascii_alphabetic()))
    })
}

/// Renumbers labels by first occurrence: the labels in that order, and each entry's number.
fn in_order(labels: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut order, mut numbers) = (Vec::new(), HashMap::new());
    let numbered = labels.iter().map(|&label| {
        *numbers.entry(label).or_insert_with(|| {
            order.push(label);
            order.len() as u32 - 1
        })
    });
    let numbered = numbered.collect();
    (order, numbered)
}

/// For each polygon a label that it shares with all that it hangs together with by welded corners.
fn components(model: &ObjFile, polygons: &[ObjFace]) -> Vec<u32> {
    let mut welded = HashMap::new();
    let mut weld = |position: u32| {
        let cell = model.positions[position as usize].map(|c| (c * WELD_PER_M).round() as i64);
        let next = welded.len() as u32;
        *welded.entry(cell).or_insert(next)
    };
    // One entry a weld, as they come: the root of its component, or a step towards it.
    let mut above: Vec<u32> = Vec::new();
    let mut first_weld = Vec::with_capacity(polygons.len());
    for polygon in polygons {
        let corners = &model.corners[polygon.first..polygon.first + polygon.len as usize];
        let mut first = None;
        for corner in corners {
            let own = weld(corner[0]);
            if own as usize == above.len() {
                above.push(own);
            }
            let first = *first.get_or_insert(own);
            let (a, b) = (root(&mut above, first), root(&mut above, own));
            above[a.max(b) as usize] = a.min(b);
        }
        first_weld.push(first.unwrap_or(0));
    }
    first_weld.into_iter().map(|weld| root(&mut above, weld)).collect()
}

/// Follows the steps up and halves the path.
fn root(above: &mut [u32], mut at: u32) -> u32 {
    while above[at as usize] != at {
        let next = above[above[at as usize] as usize];
        above[at as usize] = next;
        at = next;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::super::parse::parse;
    use super::*;
    use crate::read::report::{SourceFormat, SourceReport};

    fn grouped(text: &str) -> (Vec<String>, Vec<u32>) {
        let mut report = SourceReport::new("a.obj", SourceFormat::Obj, 0);
        let model = parse(&mut text.as_bytes(), 1 << 20, &mut report, &|| {}).unwrap();
        let objects = group(&model, &model.polygons, "tile");
        (objects.ids, objects.of_polygon)
    }

    /// Two squares of two triangles each, every corner for itself, interleaved.
    const SOUP: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 9 0 0\nv 10 0 0\nv 10 1 0\nv 0 0.0001 0\nv 1 1 0\nv 0 1 0\n\
                        v 9 0 0\nv 10 1 0\nv 9 1 0\n";

    #[test]
    fn unshared_vertices_are_welded_to_components() {
        let (ids, of_polygon) = grouped(&format!("{SOUP}f 1 2 3\nf 4 5 6\nf 7 8 9\nf 10 11 12"));
        assert_eq!(ids, ["tile#0", "tile#1"]);
        assert_eq!(of_polygon, [0, 1, 0, 1]);
    }

    #[test]
    fn own_groups_go_first_and_a_name_for_everything_groups_nothing() {
        let (ids, of_polygon) = grouped(&format!("{SOUP}o a\nf 1 2 3\no b\nf 4 5 6\no a\nf 7 8 9"));
        assert_eq!((ids, of_polygon), (vec!["a".to_owned(), "b".to_owned()], vec![0, 1, 0]));
        let (ids, _) = grouped(&format!("{SOUP}o city\nf 1 2 3\ng x\nf 4 5 6"));
        assert_eq!(ids, ["tile", "x"]);
        let (ids, _) = grouped(&format!("{SOUP}g city\nf 1 2 3\nf 4 5 6"));
        assert_eq!(ids, ["city#0", "city#1"]);
        let (ids, _) = grouped(&format!("{SOUP}g default\nf 1 2 3\nf 7 8 9"));
        assert_eq!(ids, ["tile"]);
        let (ids, of_polygon) = grouped(&format!("{SOUP}o Terrain\nf 1 2 3\nf 4 5 6"));
        assert_eq!((ids, of_polygon), (vec!["Terrain".to_owned()], vec![0, 0]));
    }

    #[test]
    fn terrain_is_known_by_name() {
        assert!(is_terrain("terrain") && is_terrain("DEM_10m") && is_terrain("tin.001"));
        assert!(!is_terrain("demo") && !is_terrain("tinsmith's house") && !is_terrain("tower"));
    }
}
