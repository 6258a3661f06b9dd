//! The triangles of an object and its parts, leaf by leaf. Nodes above the leaves that have no children are plain: their columns show
//! the same as the leaves would, and have no meshes.
//!
//! As in `table::gather`, a family is open from the first leaf that shows it until the last one that the bounds of its members touch.

use super::surfaces::Point;
use crate::table::city::{City, Plan};
use crate::table::columns::{ColumnView, Top};
use crate::table::gather::LeafPositions;
use crate::table::{EndNode, ExportError, OpenObjects, visit_end_nodes};
use insula_protocol::mesh_tile::NO_OBJECT;
use std::collections::{BTreeMap, HashMap};

/// A family of more triangles is left out, because a feature is one line of text that readers keep in memory.
const MAX_TRIANGLES: usize = 1 << 20;

/// An object without a parent, and all that belong to it.
pub(super) struct Family {
    pub(super) root: u32,
    /// By number; `None` if there are more than [`MAX_TRIANGLES`].
    pub(super) members: Option<BTreeMap<u32, Member>>,
}

#[derive(Debug, Default)]
pub(super) struct Member {
    /// From the city's corner, in units of the map's grid and millimetres of height.
    pub(super) triangles: Vec<[Point; 3]>,
    pub(super) tolerance_m: f64,
}

type Emit<'a> = &'a mut dyn FnMut(Family) -> Result<(), ExportError>;

/// Passes each family with a selected member that any mesh shows to `emit`. A member belongs to it if it or one of its parents is
/// selected. Returns whether there was a mesh. Fails if tiles cannot be read, and with the error of `emit`.
pub(super) fn visit_families(city: &City<'_>, plan: &Plan, emit: Emit<'_>) -> Result<bool, ExportError> {
    let Some(area) = plan.area else { return Ok(false) };
    let mut gather = Gather { city, plan, open: OpenObjects::default(), has_mesh: false };
    visit_end_nodes(city.source, area, &mut |node| {
        gather.add(node)?;
        let done = city.order.last(node.id);
        gather.close(done, emit)
    })?;
    gather.close(u64::MAX, emit)?;
    Ok(gather.has_mesh)
}

struct Gather<'a> {
    city: &'a City<'a>,
    plan: &'a Plan,
    open: OpenObjects<OpenFamily>,
    /// Whether a node had a mesh.
    has_mesh: bool,
}

/// A family of which leaves are still to come.
struct OpenFamily {
    family: Family,
    triangles: usize,
}

impl Gather<'_> {
    fn add(&mut self, node: EndNode) -> Result<(), ExportError> {
        let mesh = if node.has_mesh { self.city.source.mesh(node.id, 0)? } else { None };
        let Some(mesh) = mesh else { return self.add_tops(node) };
        self.has_mesh = true;
        let LeafPositions { world, tolerance_m } = LeafPositions::of(self.city, node.id, &mesh);
        let points: Vec<Point> = world.iter().map(|position| self.point(*position)).collect();
        let mut roots = HashMap::new();
        for (triangle, &object) in mesh.mesh.triangles.iter().zip(&mesh.objects) {
            let root = match roots.get(&object) {
                Some(root) => *root,
                None => *roots.entry(object).or_insert(self.root_of(object)?),
            };
            let [Some(a), Some(b), Some(c)] = triangle.map(|vertex| points.get(vertex as usize).copied()) else {
                continue;
            };
            if let Some(root) = root {
                self.open(root)?.add(object, [a, b, c], tolerance_m);
            }
        }
        Ok(())
    }

    /// Adds what the columns of a plain node show from above.
    fn add_tops(&mut self, node: EndNode) -> Result<(), ExportError> {
        if node.id.level() >= self.city.manifest.depth {
            return Ok(());
        }
        let Some(map) = self.city.source.columns(node.id)? else { return Ok(()) };
        let Some(view) = ColumnView::new(self.city.manifest, &map) else { return Ok(()) };
        let tops = view.tops();
        for Top { object, area: [[west, south], [east, north]], z_m } in tops {
            let Some(root) = self.root_of(object)? else { continue };
            let corners = [[west, south], [east, south], [east, north], [west, north]];
            let [a, b, c, d] = corners.map(|[x, y]| self.point([x, y, z_m]));
            let open = self.open(root)?;
            open.add(object, [a, b, c], 0.0);
            open.add(object, [a, c, d], 0.0);
        }
        Ok(())
    }

    /// A position in world metres as a vertex.
    fn point(&self, [x, y, z]: [f64; 3]) -> Point {
        let point = self.city.grid.point([x, y]);
        [point.x, point.y, ((z - super::origin_z(self.city)) * 1000.0).round() as i32]
    }

    /// The family of an object; `None` if the object is not exported.
    fn root_of(&self, object: u32) -> Result<Option<u32>, ExportError> {
        if object == NO_OBJECT || self.city.info(object)?.is_none() {
            return Ok(None);
        }
        let ancestors = self.city.ancestors(object)?;
        let is_selected = ancestors.iter().chain([&object]).any(|member| self.plan.selected.contains(*member));
        Ok((is_selected || self.plan.parents.contains(object)).then(|| ancestors.last().copied().unwrap_or(object)))
    }

    fn open(&mut self, root: u32) -> Result<&mut OpenFamily, ExportError> {
        let new = || OpenFamily { family: Family { root, members: Some(BTreeMap::new()) }, triangles: 0 };
        self.open.get(self.city, self.plan, root, new)
    }

    /// Emits the families whose last leaf is at `position` or before it.
    fn close(&mut self, position: u64, emit: Emit<'_>) -> Result<(), ExportError> {
        while let Some((_, open)) = self.open.pop(position) {
            emit(open.family)?;
        }
        Ok(())
    }
}

impl OpenFamily {
    fn add(&mut self, object: u32, triangle: [Point; 3], tolerance_m: f64) {
        self.triangles += 1;
        if self.triangles > MAX_TRIANGLES {
            self.family.members = None;
        }
        if let Some(members) = &mut self.family.members {
            let member = members.entry(object).or_default();
            member.tolerance_m = member.tolerance_m.max(tolerance_m);
            member.triangles.push(triangle);
        }
    }
}
