//! Reports the objects that an OBJ names and that are merged or have no faces.

use super::grouping::{FaceGroups, GroupedBy};
use super::parse::{ObjFace, ObjFile};
use insula_source::object::ObjectSink;
use std::collections::HashSet;

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
