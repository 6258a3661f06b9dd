//! Groups the faces of an OBJ into objects: by its own groups, else by connected components. Reports those that are merged or have no
//! faces.

use super::parse::{ObjFace, ObjFile};
use insula_simplify::disjoint_sets::DisjointSets;
use insula_source::object::ObjectSink;
use std::collections::{HashMap, HashSet};

/// Positions that round to the same millimetre are welded, because in some files each triangle has its own corners.
const WELD_PER_M: f64 = 1000.0;

/// The objects of a file.
pub(super) struct FaceGroups {
    /// Identifiers of the objects.
    pub(super) ids: Vec<String>,
    /// For each of the given faces the index of its object. Objects are in the order of their first face.
    pub(super) of_face: Vec<u32>,
    pub(super) by: GroupedBy,
}

/// What makes faces one object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GroupedBy {
    /// The name after `o`.
    Object,
    /// The name after `g`.
    Group,
    /// That they are connected, or that all are terrain.
    Connection,
}

/// Groups faces. `o` takes precedence over `g`. If all faces have the same name, each connected component is an object.
/// `stem` names faces without a name.
pub(super) fn group_faces(file: &ObjFile, faces: &[ObjFace], stem: &str) -> FaceGroups {
    type NameOf = fn(&ObjFace) -> u32;
    let names: [(GroupedBy, NameOf); 2] =
        [(GroupedBy::Object, |face| face.object), (GroupedBy::Group, |face| face.group)];
    for (by, name_of) in names {
        let first = faces.first().map(name_of);
        if faces.iter().any(|face| Some(name_of(face)) != first) {
            let labels: Vec<u32> = faces.iter().map(name_of).collect();
            let (names, of_face) = renumber(&labels);
            let id = |label: &u32| match file.names[*label as usize].as_str() {
                "" => stem.to_owned(),
                name => name.to_owned(),
            };
            return FaceGroups { ids: names.iter().map(id).collect(), of_face, by };
        }
    }
    let shared_name = faces.first().map_or("", |face| {
        let names = [face.object, face.group].map(|i| file.names[i as usize].as_str());
        // Exporters give the names `default` and `off` to everything.
        names.into_iter().find(|name| !matches!(*name, "" | "default" | "off")).unwrap_or("")
    });
    let by = GroupedBy::Connection;
    let prefix = if shared_name.is_empty() { stem } else { shared_name };
    if is_terrain(prefix) {
        return FaceGroups { ids: vec![prefix.to_owned()], of_face: vec![0; faces.len()], by };
    }
    let (components, of_face) = renumber(&connected_components(file, faces));
    let id = |i: usize| if components.len() == 1 { prefix.to_owned() } else { format!("{prefix}#{i}") };
    FaceGroups { ids: (0..components.len()).map(id).collect(), of_face, by }
}

/// Whether an object is terrain, judged by its name, because OBJ has no types.
pub(super) fn is_terrain(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    ["terrain", "relief", "dem", "dtm", "tin"].iter().any(|word| {
        name.strip_prefix(word).is_some_and(|rest| !rest.starts_with(|next: char| next.is_ascii_alphabetic()))
    })
}

/// Renumbers labels by first occurrence: the labels in that order, and each entry's number.
fn renumber(labels: &[u32]) -> (Vec<u32>, Vec<u32>) {
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

/// For each face a label of its connected component, by the sets of connected welded corners.
fn connected_components(file: &ObjFile, faces: &[ObjFace]) -> Vec<u32> {
    let mut welded = HashMap::new();
    let mut weld = |position: u32| {
        let cell = file.positions[position as usize].map(|c| (c * WELD_PER_M).round() as i64);
        let next = welded.len() as u32;
        *welded.entry(cell).or_insert(next)
    };
    let mut sets = DisjointSets::new(file.positions.len());
    let mut first_weld = Vec::with_capacity(faces.len());
    for face in faces {
        let mut first = None;
        for corner in file.corners_of(face) {
            let own = weld(corner[0]);
            sets.union(*first.get_or_insert(own), own);
        }
        first_weld.push(first.unwrap_or(0));
    }
    first_weld.into_iter().map(|weld| sets.find(weld)).collect()
}

/// Reports the lines that begin an object which the sink does not get. Of several lines that begin an object, all but the first
/// are merged into it. Names without any of the `usable` faces are skipped.
pub(super) fn report_others(file: &ObjFile, usable: &[ObjFace], groups: &FaceGroups, sink: &mut dyn ObjectSink) {
    type NameOf = fn(&ObjFace) -> u32;
    let by_object =
        groups.by == GroupedBy::Object || groups.by == GroupedBy::Connection && !file.object_lines.is_empty();
    let (lines, name_of): (&[u32], NameOf) =
        if by_object { (&file.object_lines, |face| face.object) } else { (&file.group_lines, |face| face.group) };
    let names_of = |faces: &[ObjFace]| faces.iter().map(name_of).collect::<HashSet<u32>>();
    let (with_usable, with_any) = (names_of(usable), names_of(&file.faces));
    let is_named = groups.by != GroupedBy::Connection;
    let mut seen = HashSet::new();
    for name in lines {
        let text = || file.names[*name as usize].clone();
        let is_first = seen.insert(*name);
        if !with_usable.contains(name) {
            sink.skip(if with_any.contains(name) { "no usable face" } else { "no face" }, text());
        } else if is_named && !is_first {
            sink.merge("name of an earlier object", text());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse::parse;
    use super::*;
    use insula_source::testing::TestSink;

    fn grouped(text: &str) -> (Vec<String>, Vec<u32>) {
        let file = parse("a.obj", &mut text.as_bytes(), 1 << 20, &mut TestSink::default(), &|| 0).unwrap();
        let groups = group_faces(&file, &file.faces, "tile");
        (groups.ids, groups.of_face)
    }

    /// Two squares of two triangles each, interleaved and without shared corners.
    const SOUP: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 9 0 0\nv 10 0 0\nv 10 1 0\nv 0 0.0001 0\nv 1 1 0\nv 0 1 0\n\
                        v 9 0 0\nv 10 1 0\nv 9 1 0\n";

    #[test]
    fn unshared_vertices_are_welded_to_components() {
        let (ids, of_face) = grouped(&format!("{SOUP}f 1 2 3\nf 4 5 6\nf 7 8 9\nf 10 11 12"));
        assert_eq!(ids, ["tile#0", "tile#1"]);
        assert_eq!(of_face, [0, 1, 0, 1]);
    }

    #[test]
    fn names_take_precedence_unless_all_faces_share_one() {
        let (ids, of_face) = grouped(&format!("{SOUP}o a\nf 1 2 3\no b\nf 4 5 6\no a\nf 7 8 9"));
        assert_eq!((ids, of_face), (vec!["a".to_owned(), "b".to_owned()], vec![0, 1, 0]));
        let (ids, _) = grouped(&format!("{SOUP}o city\nf 1 2 3\ng x\nf 4 5 6"));
        assert_eq!(ids, ["tile", "x"]);
        let (ids, _) = grouped(&format!("{SOUP}g city\nf 1 2 3\nf 4 5 6"));
        assert_eq!(ids, ["city#0", "city#1"]);
        let (ids, _) = grouped(&format!("{SOUP}g default\nf 1 2 3\nf 7 8 9"));
        assert_eq!(ids, ["tile"]);
        let (ids, of_face) = grouped(&format!("{SOUP}o Terrain\nf 1 2 3\nf 4 5 6"));
        assert_eq!((ids, of_face), (vec!["Terrain".to_owned()], vec![0, 0]));
    }

    #[test]
    fn terrain_is_recognised_by_name() {
        assert!(is_terrain("terrain") && is_terrain("DEM_10m") && is_terrain("tin.001"));
        assert!(!is_terrain("demo") && !is_terrain("tinsmith's house") && !is_terrain("tower"));
    }
}
