//! Chooses the geometries of each object: the best level of detail, and never a footprint under a building.

use super::schema::{CityJsonGeometry, CityJsonLod, GeometryOutline, ObjectOutline, shell_depth};
use std::collections::{HashMap, HashSet};

/// More generations than this are treated as a loop.
const MAX_ANCESTORS: usize = 8;
/// Further parents of one object are ignored. Hostile files name every object as a parent of every other.
const MAX_PARENTS: usize = 32;
/// Further ancestors of one object are ignored.
const MAX_FOUND: usize = 64;

/// Which geometries of an object are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum LevelChoice {
    /// The geometries of this level.
    Level(CityJsonLod),
    /// None of this level, because a part or a parent has better ones.
    Coarser(CityJsonLod),
    /// None, because it is inside of what other objects show.
    Interior,
    NoGeometry,
}

/// Chooses for objects that may be related. `None` stands for an object that could not be parsed.
pub(crate) fn choose_levels(
    objects: &[(&str, Option<ObjectOutline<'_>>)],
    templates: &[CityJsonGeometry],
) -> Vec<LevelChoice> {
    let best: Vec<Option<CityJsonLod>> =
        objects.iter().map(|(_, outline)| best_level(outline.as_ref(), templates)).collect();
    let level = |i: usize| best[i].map_or(LevelChoice::NoGeometry, LevelChoice::Level);
    let mut choices: Vec<LevelChoice> = (0..objects.len()).map(level).collect();
    let parents = parents(objects);
    leave_out_interiors(objects, &parents, &mut choices);
    for part in 0..objects.len() {
        let Some(part_lod) = best[part].filter(|_| choices[part] != LevelChoice::Interior) else { continue };
        let is_part = objects[part].1.as_ref().is_some_and(|outline| outline.kind.ends_with("Part"));
        for whole in ancestors(part, &parents) {
            let Some(whole_lod) = best[whole] else { continue };
            // Any child replaces a footprint, but only a part replaces a whole building: a chimney does not.
            if whole_lod < part_lod && (is_footprint(whole_lod) || is_part) {
                choices[whole] = LevelChoice::Coarser(whole_lod);
            } else if part_lod < whole_lod && is_footprint(part_lod) {
                choices[part] = LevelChoice::Coarser(part_lod);
            }
        }
    }
    choices
}

/// Leaves out rooms and what is in them, if an object that is in no room shows the building, bridge or tunnel that they belong to.
fn leave_out_interiors(
    objects: &[(&str, Option<ObjectOutline<'_>>)],
    parents: &[Vec<usize>],
    choices: &mut [LevelChoice],
) {
    let is_interior = |i: usize| objects[i].1.as_ref().is_some_and(|outline| is_of_interior(&outline.kind));
    if !(0..objects.len()).any(is_interior) {
        return;
    }
    let families: Vec<(usize, bool)> = (0..objects.len())
        .map(|i| {
            let above = ancestors(i, parents);
            let is_inside = is_interior(i) || above.iter().any(|whole| is_interior(*whole));
            (above.last().copied().unwrap_or(i), is_inside)
        })
        .collect();
    let has_body = |choice: LevelChoice| matches!(choice, LevelChoice::Level(lod) if !is_footprint(lod));
    let outside =
        families.iter().zip(choices.iter()).filter(|((_, is_inside), choice)| !is_inside && has_body(**choice));
    let shown: HashSet<usize> = outside.map(|((whole, _), _)| *whole).collect();
    for (i, (whole, is_inside)) in families.into_iter().enumerate() {
        if is_inside && shown.contains(&whole) && choices[i] != LevelChoice::NoGeometry {
            choices[i] = LevelChoice::Interior;
        }
    }
}

/// Whether objects of this type are rooms or stand in rooms.
fn is_of_interior(kind: &str) -> bool {
    let kinds =
        ["BuildingRoom", "BuildingFurniture", "BridgeRoom", "BridgeFurniture", "TunnelHollowSpace", "TunnelFurniture"];
    kinds.contains(&kind)
}

/// For each object the furthest ancestor that is a building; the object itself where none is.
pub(crate) fn find_wholes(objects: &[(&str, Option<ObjectOutline<'_>>)]) -> Vec<usize> {
    let parents = parents(objects);
    let is_building = |i: usize| objects[i].1.as_ref().is_some_and(|outline| outline.kind.starts_with("Building"));
    let whole = |i: usize| ancestors(i, &parents).into_iter().rfind(|above| is_building(*above)).unwrap_or(i);
    (0..objects.len()).map(whole).collect()
}

/// Whether a level is 0 or a refinement of it: a footprint or a roof outline.
fn is_footprint(lod: CityJsonLod) -> bool {
    (0.0..1.0).contains(&lod.0)
}

/// The best level with surfaces, else of those without, so that its reader reports them.
fn best_level(outline: Option<&ObjectOutline<'_>>, templates: &[CityJsonGeometry]) -> Option<CityJsonLod> {
    let geometries = outline?.geometry.as_ref()?.iter();
    let has_surfaces = |geometry: &GeometryOutline| {
        geometry.boundaries.0 && (geometry.template.is_some() || shell_depth(&geometry.kind).is_some())
    };
    let levels =
        geometries.map(|geometry| (has_surfaces(geometry), level_of(geometry.lod, geometry.template, templates)));
    levels.max_by(|a, b| a.0.cmp(&b.0).then(a.1.0.total_cmp(&b.1.0))).map(|(_, level)| level)
}

/// The level of a geometry. An instance has its template's level.
pub(crate) fn level_of(own: CityJsonLod, template: Option<i64>, templates: &[CityJsonGeometry]) -> CityJsonLod {
    let template = template.and_then(|index| templates.get(usize::try_from(index).ok()?));
    template.map_or(own, |template| template.lod)
}

/// The parents of each object, as either side names them.
fn parents(objects: &[(&str, Option<ObjectOutline<'_>>)]) -> Vec<Vec<usize>> {
    let by_id: HashMap<&str, usize> = objects.iter().enumerate().map(|(i, (id, _))| (*id, i)).collect();
    let mut parents = vec![Vec::new(); objects.len()];
    for (i, (_, outline)) in objects.iter().enumerate() {
        let Some(outline) = outline else { continue };
        for id in outline.parents.iter().flatten() {
            parents[i].extend(by_id.get(id.as_str()));
        }
        for id in outline.children.iter().flatten() {
            if let Some(&child) = by_id.get(id.as_str()) {
                parents[child].push(i);
            }
        }
    }
    for list in &mut parents {
        list.sort_unstable();
        list.dedup();
        list.truncate(MAX_PARENTS);
    }
    parents
}

fn ancestors(object: usize, parents: &[Vec<usize>]) -> Vec<usize> {
    let mut found = Vec::new();
    let mut generation = vec![object];
    for _ in 0..MAX_ANCESTORS {
        let mut next = Vec::new();
        for &above in generation.iter().flat_map(|&below| &parents[below]) {
            if above != object && !found.contains(&above) {
                if found.len() == MAX_FOUND {
                    return found;
                }
                found.push(above);
                next.push(above);
            }
        }
        generation = next;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choices(text: &str) -> Vec<(String, LevelChoice)> {
        let outlines: Vec<(String, ObjectOutline)> = serde_json::from_str(text).unwrap();
        let objects: Vec<_> = outlines.into_iter().map(|(id, outline)| (id, Some(outline))).collect();
        let borrowed: Vec<(&str, Option<ObjectOutline<'_>>)> =
            objects.into_iter().map(|(id, o)| (&*id.leak(), o)).collect();
        let chosen = choose_levels(&borrowed, &[]);
        borrowed.iter().map(|(id, _)| (*id).to_owned()).zip(chosen).collect()
    }

    fn choice(text: &str) -> Vec<LevelChoice> {
        choices(text).into_iter().map(|(_, choice)| choice).collect()
    }

    #[test]
    fn highest_level_is_chosen_numerically() {
        let text = r#"[["a", {"geometry": [{"lod": "1.3"}, {"lod": "2.2"}, {"lod": "0"}, {"lod": 2}]}], ["b", {}]]"#;
        assert_eq!(choice(text), [LevelChoice::Level(CityJsonLod(2.2)), LevelChoice::NoGeometry]);
    }

    #[test]
    fn levels_without_surfaces_count_only_if_there_are_no_others() {
        let text = r#"[["a", {"geometry": [
            {"type": "Solid", "lod": "2", "boundaries": [[[[0, 1, 2]]]]},
            {"type": "Solid", "lod": "3", "boundaries": [[]]},
            {"type": "MultiLineString", "lod": "3.1", "boundaries": [[0, 1]]}
        ]}], ["b", {"geometry": [{"type": "MultiPoint", "lod": "1", "boundaries": [0]}]}]]"#;
        assert_eq!(choice(text), [2.0, 1.0].map(|level| LevelChoice::Level(CityJsonLod(level))));
    }

    #[test]
    fn footprint_is_left_out_if_a_part_has_a_body() {
        for link in [r#""children": ["p"]"#, r#""x": 0"#] {
            let parents = if link.contains("children") { "[]" } else { r#"["b"]"# };
            let text = format!(
                r#"[["b", {{"type": "Building", "geometry": [{{"lod": "0"}}], {link}}}],
                    ["p", {{"type": "BuildingPart", "geometry": [{{"lod": "1"}}], "parents": {parents}}}]]"#
            );
            let coarser = LevelChoice::Coarser(CityJsonLod(0.0));
            assert_eq!(choice(&text), [coarser, LevelChoice::Level(CityJsonLod(1.0))], "{link}");
        }
    }

    #[test]
    fn parts_replace_a_coarser_parent_and_installations_do_not() {
        let with = |kind: &str| {
            format!(
                r#"[["b", {{"type": "Building", "geometry": [{{"lod": "1"}}]}}],
                    ["p", {{"type": "{kind}", "geometry": [{{"lod": "2"}}], "parents": ["b"]}}]]"#
            )
        };
        let coarser = |level| [LevelChoice::Coarser(CityJsonLod(level)), LevelChoice::Level(CityJsonLod(2.0))];
        assert_eq!(choice(&with("BuildingPart")), coarser(1.0));
        assert_eq!(
            choice(&with("BuildingInstallation")),
            [LevelChoice::Level(CityJsonLod(1.0)), LevelChoice::Level(CityJsonLod(2.0))]
        );
        let on_a_footprint = with("BuildingInstallation").replace(r#""lod": "1""#, r#""lod": "0""#);
        assert_eq!(choice(&on_a_footprint), coarser(0.0));
    }

    #[test]
    fn rooms_are_left_out_if_something_else_shows_the_building() {
        let with = |lod: &str| {
            format!(
                r#"[["b", {{"type": "Building", "geometry": [{{"lod": "{lod}"}}]}}],
                    ["s", {{"type": "BuildingStorey", "parents": ["b"]}}],
                    ["r", {{"type": "BuildingRoom", "geometry": [{{"lod": "2"}}], "parents": ["s"]}}],
                    ["f", {{"type": "BuildingFurniture", "geometry": [{{"lod": "1"}}], "parents": ["r"]}}],
                    ["i", {{"type": "BuildingInstallation", "geometry": [{{"lod": "2"}}], "parents": ["r"]}}],
                    ["p", {{"type": "BuildingPart", "parents": ["b"]}}],
                    ["other", {{"type": "BuildingRoom", "geometry": [{{"lod": "2"}}]}}]]"#
            )
        };
        let level = |level| LevelChoice::Level(CityJsonLod(level));
        let (inside, none) = (LevelChoice::Interior, LevelChoice::NoGeometry);
        assert_eq!(choice(&with("1")), [level(1.0), none, inside, inside, inside, none, level(2.0)]);
        // Nothing else shows the building.
        let coarser = LevelChoice::Coarser(CityJsonLod(0.0));
        assert_eq!(choice(&with("0")), [coarser, none, level(2.0), level(1.0), level(2.0), none, level(2.0)]);
        let of_part = with("0").replace(r#""BuildingPart","#, r#""BuildingPart", "geometry": [{"lod": "2"}],"#);
        assert_eq!(choice(&of_part), [coarser, none, inside, inside, inside, level(2.0), level(2.0)]);
    }

    #[test]
    fn footprint_without_body_stays_and_loops_end() {
        let text = r#"[["a", {"geometry": [{"lod": 0}], "parents": ["b"]}], ["b", {"parents": ["a"]}]]"#;
        assert_eq!(choice(text), [LevelChoice::Level(CityJsonLod(0.0)), LevelChoice::NoGeometry]);
    }

    #[test]
    fn objects_that_are_all_parents_of_each_other_take_no_time() {
        let ids: Vec<String> = (0..1000).map(|i| format!("\"{i}\"")).collect();
        let all = ids.join(",");
        let object = |id: &String| format!(r#"[{id}, {{"geometry": [{{"lod": 1}}], "parents": [{all}]}}]"#);
        let text = format!("[{}]", ids.iter().map(object).collect::<Vec<_>>().join(","));
        // Without a limit on parents and ancestors, this would take hours.
        assert!(choice(&text).iter().all(|choice| *choice == LevelChoice::Level(CityJsonLod(1.0))));
    }
}
