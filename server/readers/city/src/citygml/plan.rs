//! Finds the geometry properties of an object by level of detail, and the objects within it.

use super::names::{Class, Names};
use super::tree::{AttributeKind, Tree, hash_of_reference};
use insula_source::object::SurfaceRole;
use std::collections::HashSet;

/// Levels of detail from 0 to 4.
pub(super) const LEVELS: usize = 5;
/// Level of a relief that does not tell it.
const RELIEF_LEVEL: u8 = 1;

/// Geometry properties of one level of detail.
#[derive(Debug, Default)]
pub(super) struct Level {
    /// Properties of the object itself.
    pub(super) own: Vec<u32>,
    /// Outlines of the roof, which repeat the footprint.
    pub(super) roof_edges: Vec<u32>,
    /// Properties of thematic surfaces and of objects that the object consists of.
    pub(super) bounded: Vec<(u32, SurfaceRole)>,
    /// Properties of surfaces that only close openings.
    pub(super) closures: Vec<u32>,
}

/// Geometry of an object.
#[derive(Debug, Default)]
pub(super) struct Plan {
    pub(super) levels: [Level; LEVELS],
    /// Objects whose surfaces are added to those of the object.
    pub(super) installations: Vec<u32>,
    /// Objects whose surfaces are used only if there are no others.
    pub(super) constructions: Vec<u32>,
    pub(super) parts: Vec<u32>,
    pub(super) subdivisions: Vec<u32>,
    pub(super) members: Vec<u32>,
    pub(super) has_lines: bool,
    /// Whether there are rooms, or things in them, which are not read.
    pub(super) has_rooms: bool,
    /// Whether there is a relief of another form than triangles.
    pub(super) has_other_relief: bool,
    /// Thematic surfaces that are referred to: each counts once.
    targets: HashSet<u32>,
}

impl Plan {
    /// The geometry of the object at `node`.
    pub(super) fn new(tree: &Tree, names: &Names, node: u32) -> Self {
        let mut plan = Self::default();
        plan.add_object(&Elements { tree, names }, node, Scope::Object);
        plan
    }

    /// Whether the object has geometry properties with surfaces.
    pub(super) fn has_geometry(&self) -> bool {
        let has = |level: &Level| {
            !(level.own.is_empty()
                && level.roof_edges.is_empty()
                && level.bounded.is_empty()
                && level.closures.is_empty())
        };
        self.levels.iter().any(has) || !self.installations.is_empty() || !self.constructions.is_empty()
    }
}

/// Whose properties are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scope {
    Object,
    /// An object that the object consists of.
    Component,
    /// A space above or around surfaces, whose volume is empty.
    FreeSpace,
}

struct Elements<'e> {
    tree: &'e Tree,
    names: &'e Names,
}

impl Elements<'_> {
    fn class(&self, node: u32) -> Class {
        self.tree.class(self.names, node)
    }

    fn local(&self, node: u32) -> &str {
        self.names.local(self.tree.node(node).name)
    }

    /// The feature that a property refers to, unless it contains the property itself.
    fn target(&self, property: u32) -> Option<u32> {
        let reference = self.tree.attribute(property, AttributeKind::Href).map(hash_of_reference)?;
        let target = self.tree.ids.get(&reference).copied();
        target.filter(|target| !self.tree.subtree(*target).contains(&property))
    }
}

impl Plan {
    fn add_object(&mut self, elements: &Elements<'_>, node: u32, scope: Scope) {
        let inline = |property| elements.tree.children(property);
        for child in elements.tree.children(node) {
            let class = elements.class(child);
            match class {
                Class::Lod(_) | Class::Footprint | Class::RoofEdge | Class::Tin => {
                    self.add_geometry(elements, node, child, scope);
                }
                Class::LodLines => self.has_lines = true,
                Class::Room => self.has_rooms = true,
                Class::Boundary | Class::BoundedBy => {
                    for surface in inline(child).filter(|surface| elements.class(*surface) != Class::Envelope) {
                        self.add_thematic_surface(elements, surface);
                    }
                    if let Some(target) = elements.target(child).filter(|target| self.targets.insert(*target)) {
                        self.add_thematic_surface(elements, target);
                    }
                }
                Class::SameObject => {
                    for component in inline(child) {
                        self.add_component(elements, component);
                    }
                }
                Class::Installation => self.installations.extend(inline(child)),
                Class::Construction => self.constructions.extend(inline(child)),
                Class::Part => self.parts.extend(inline(child)),
                Class::Subdivision => self.subdivisions.extend(inline(child)),
                Class::GroupMember => self.members.extend(inline(child)),
                _ => {}
            }
        }
    }

    fn add_component(&mut self, elements: &Elements<'_>, component: u32) {
        let local = elements.local(component);
        if matches!(local, "BreaklineRelief" | "RasterRelief" | "MassPointRelief") {
            self.has_other_relief = true;
            return;
        }
        let scope = if local.ends_with("Space") { Scope::FreeSpace } else { Scope::Component };
        self.add_object(elements, component, scope);
    }

    fn add_geometry(&mut self, elements: &Elements<'_>, owner: u32, property: u32, scope: Scope) {
        let (level, is_edge) = match elements.class(property) {
            Class::Lod(level) => (level, false),
            Class::Tin => (relief_level(elements, owner), false),
            class => (0, class == Class::RoofEdge),
        };
        let Some(level) = self.levels.get_mut(usize::from(level)) else { return };
        match scope {
            Scope::FreeSpace => {}
            Scope::Component => level.bounded.push((property, SurfaceRole::Other)),
            Scope::Object if is_edge => level.roof_edges.push(property),
            Scope::Object => level.own.push(property),
        }
    }

    fn add_thematic_surface(&mut self, elements: &Elements<'_>, surface: u32) {
        let local = elements.local(surface);
        let Some(role) = role_of(local) else { return };
        let is_closure = local.ends_with("ClosureSurface");
        for child in elements.tree.children(surface) {
            match elements.class(child) {
                Class::Lod(level) => {
                    let Some(level) = self.levels.get_mut(usize::from(level)) else { continue };
                    if is_closure {
                        level.closures.push(child);
                    } else {
                        level.bounded.push((child, role));
                    }
                }
                Class::LodLines => self.has_lines = true,
                Class::Opening | Class::Boundary => {
                    for opening in elements.tree.children(child) {
                        self.add_thematic_surface(elements, opening);
                    }
                }
                _ => {}
            }
        }
    }
}

fn relief_level(elements: &Elements<'_>, relief: u32) -> u8 {
    let level = elements.tree.child_of_class(elements.names, relief, Class::ReliefLod);
    let text = level.and_then(|level| elements.tree.text_of(level));
    text.and_then(|text| text.parse().ok()).filter(|level| usize::from(*level) < LEVELS).unwrap_or(RELIEF_LEVEL)
}

/// The role of a thematic surface by the name of its type, also of an extension; `None` for surfaces of rooms.
fn role_of(local: &str) -> Option<SurfaceRole> {
    let is = |part| local.contains(part);
    Some(match local {
        "InteriorWallSurface" | "CeilingSurface" | "FloorSurface" => return None,
        "OuterCeilingSurface" | "OuterFloorSurface" => SurfaceRole::Other,
        _ if is("Window") => SurfaceRole::Window,
        _ if is("Door") => SurfaceRole::Door,
        _ if is("Roof") => SurfaceRole::Roof,
        _ if is("Wall") => SurfaceRole::Wall,
        "GroundSurface" => SurfaceRole::Ground,
        _ => SurfaceRole::Other,
    })
}
