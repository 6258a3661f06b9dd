//! Counts the objects that an OBJ names, and reports those that are merged or have no faces.

use std::collections::HashSet;

use super::grouping::{FaceGroups, GroupedBy};
use super::parse::{ObjFace, ObjFile};
use insula_source::report::SourceReport;

/// Counts the objects of a file, by the lines that begin them. An object that several lines begin is one object of the city, and
/// the others are merged into it. Names without any of the `usable` faces are skipped. Parts of a file that are only told apart by
/// being connected count as found.
pub(super) fn count_objects(file: &ObjFile, usable: &[ObjFace], groups: &FaceGroups, report: &mut SourceReport) {
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
            let reason = if with_any.contains(name) { "no usable face" } else { "no face" };
            report.skip(reason, text);
        } else if is_named && !is_first {
            report.merge("name of an earlier object", text);
        } else if !is_named {
            continue;
        }
        report.found += 1;
    }
    report.found += match groups.by {
        GroupedBy::Connection => groups.ids.len() as u64,
        // Faces before the first name.
        _ => with_usable.difference(&seen).count() as u64,
    };
}
