//! The footprint of each object: the outline of its triangles on the map, leaf by leaf.
//!
//! Leaves are visited along a Hilbert curve. An object is open from the first leaf that shows it until the last one that its bounds
//! touch, so memory holds the objects around one place of the curve. The outline of an object has that of its parts.

use super::city::{City, Plan};
use super::columns::ColumnView;
use super::outline::{Outline, area_m2};
use super::{EndNode, ExportError, OpenObjects, visit_end_nodes};
use insula_protocol::mesh_tile::NO_OBJECT;
use insula_protocol::{MeshTile, TileId};
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Positions this close to a leaf's border are on it, in steps of the mesh's grid: triangles are cut there.
const BORDER_STEPS: f64 = 1.5;
/// Smallest tolerance of outlines in metres.
const TOLERANCE_M: f64 = 0.002;

/// Where an object is, in world metres.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Footprint {
    /// Outer ring and holes of each polygon. Rings repeat their first point; outer ones are counter-clockwise, holes clockwise.
    /// Empty if the object covers no area on the map.
    pub(crate) polygons: Vec<Vec<Vec<[f64; 2]>>>,
    /// Height of the lowest and of the highest point.
    pub(crate) z_m: [f64; 2],
    pub(crate) area_m2: f64,
}

type Emit<'a> = &'a mut dyn FnMut(u32, Footprint) -> Result<(), ExportError>;

/// Passes the footprint of each selected object that any leaf shows to `emit`, each object once. Fails if tiles cannot be read, and
/// with the error of `emit`.
pub(crate) fn visit_footprints(city: &City<'_>, plan: &Plan, emit: Emit<'_>) -> Result<(), ExportError> {
    let Some(area) = plan.area else { return Ok(()) };
    let mut gather = Gather { city, plan, open: OpenObjects::default() };
    visit_end_nodes(city.source, area, &mut |node| {
        gather.add(node)?;
        let done = city.order.last(node.id);
        gather.close(done, emit)
    })?;
    gather.close(u64::MAX, emit)
}

struct Gather<'a> {
    city: &'a City<'a>,
    plan: &'a Plan,
    open: OpenObjects<OpenFootprint>,
}

/// The footprint of an object of which leaves are still to come.
struct OpenFootprint {
    outline: Outline,
    z_m: [f64; 2],
    tolerance_m: f64,
}

impl Gather<'_> {
    fn add(&mut self, node: EndNode) -> Result<(), ExportError> {
        let mesh = if node.has_mesh { self.city.source.mesh(node.id, 0)? } else { None };
        match mesh {
            Some(mesh) => self.add_mesh(node, &mesh),
            None => self.add_columns(node),
        }
    }

    fn add_mesh(&mut self, node: EndNode, mesh: &MeshTile) -> Result<(), ExportError> {
        let LeafPositions { world, tolerance_m } = LeafPositions::of(self.city, node.id, mesh);
        let points: Vec<_> = world.iter().map(|[x, y, _]| self.city.grid.point([*x, *y])).collect();
        let mut targets = Targets::default();
        for (triangle, &object) in mesh.mesh.triangles.iter().zip(&mesh.objects) {
            let [Some(a), Some(b), Some(c)] = triangle.map(|vertex| points.get(vertex as usize).copied()) else {
                continue;
            };
            let heights = triangle.map(|vertex| world.get(vertex as usize).map_or(f64::NAN, |position| position[2]));
            for &target in targets.of(self.city, self.plan, object)? {
                let open = self.open(target)?;
                open.tolerance_m = open.tolerance_m.max(tolerance_m);
                heights.iter().for_each(|z| open.add_height(*z));
                open.outline.add_triangle([a, b, c]);
            }
        }
        Ok(())
    }

    fn add_columns(&mut self, node: EndNode) -> Result<(), ExportError> {
        let Some(map) = self.city.source.columns(node.id)? else { return Ok(()) };
        let Some(view) = ColumnView::new(self.city.manifest, &map) else { return Ok(()) };
        let mut targets = Targets::default();
        for run in view.runs() {
            let [min, max] = run.area.map(|corner| self.city.grid.point(corner));
            for &target in targets.of(self.city, self.plan, run.object)? {
                let open = self.open(target)?;
                run.z_m.iter().for_each(|z| open.add_height(*z));
                open.outline.add_rectangle(min, max);
            }
        }
        Ok(())
    }

    fn open(&mut self, object: u32) -> Result<&mut OpenFootprint, ExportError> {
        self.open.get(self.city, self.plan, object, || OpenFootprint {
            outline: Outline::default(),
            z_m: [f64::INFINITY, f64::NEG_INFINITY],
            tolerance_m: TOLERANCE_M,
        })
    }

    /// Emits the objects whose last leaf is at `position` or before it.
    fn close(&mut self, position: u64, emit: Emit<'_>) -> Result<(), ExportError> {
        while let Some((object, open)) = self.open.pop(position) {
            emit(object, open.finish(self.city))?;
        }
        Ok(())
    }
}

impl OpenFootprint {
    fn add_height(&mut self, z: f64) {
        self.z_m = [self.z_m[0].min(z), self.z_m[1].max(z)];
    }

    fn finish(self, city: &City<'_>) -> Footprint {
        let grid = &city.grid;
        let polygons = self.outline.finish(grid, grid.units(self.tolerance_m));
        let area_m2 = area_m2(&polygons, grid);
        let closed = |ring: Vec<_>| {
            let first = ring.first().copied();
            ring.into_iter().chain(first).map(|point| grid.world(point)).collect()
        };
        let polygons = polygons.into_iter().map(|rings| rings.into_iter().map(closed).collect()).collect();
        Footprint { polygons, z_m: self.z_m, area_m2 }
    }
}

/// Positions of the vertices of a leaf's mesh.
pub(crate) struct LeafPositions {
    /// World metres. Those at the leaf's border are exactly on it, so that the triangles of two leaves meet.
    pub(crate) world: Vec<[f64; 3]>,
    /// Vertices of two leaves that are the same in the source may be this far apart.
    pub(crate) tolerance_m: f64,
}

impl LeafPositions {
    pub(crate) fn of(city: &City<'_>, leaf: TileId, mesh: &MeshTile) -> Self {
        let corner = city.manifest.node_corner(leaf);
        let side = city.manifest.node_side_m(leaf.level());
        let tolerance_m = (BORDER_STEPS * mesh.mesh.grid.step).max(TOLERANCE_M);
        let border = |v: f64| {
            if v.abs() <= tolerance_m {
                0.0
            } else if (v - side).abs() <= tolerance_m {
                side
            } else {
                v
            }
        };
        let world =
            mesh.mesh.positions_m().map(|[x, y, z]| [corner[0] + border(x), corner[1] + border(y), corner[2] + z]);
        Self { world: world.collect(), tolerance_m }
    }
}

/// The selected objects to which the parts of a node belong: objects themselves, and those of which they are parts.
#[derive(Default)]
struct Targets(HashMap<u32, Vec<u32>>);

impl Targets {
    fn of(&mut self, city: &City<'_>, plan: &Plan, object: u32) -> Result<&[u32], ExportError> {
        if object == NO_OBJECT {
            return Ok(&[]);
        }
        match self.0.entry(object) {
            Entry::Occupied(known) => Ok(known.into_mut()),
            Entry::Vacant(new) => {
                let all = std::iter::once(object).chain(city.ancestors(object)?);
                Ok(new.insert(all.filter(|target| plan.selected.contains(*target)).collect()))
            }
        }
    }
}
