//! Triangles of a node's columns, for nodes that have no mesh: land as one surface, everything else as boxes.

use crate::boxes::{self, QUARTERS};
use crate::land_surface::land_of_columns;
use crate::source::SourceError;
use insula_protocol::blockmap::ColumnObjects;
use insula_protocol::mesh::{Mesh, PositionGrid};
use insula_protocol::{BlockMap, MeshTile};

/// The meshes of a node's columns: its land, and boxes of all else. Either may be empty.
pub(crate) fn column_meshes(map: BlockMap, is_land: &dyn Fn(u32) -> bool) -> Result<[MeshTile; 2], SourceError> {
    let land = land_of_columns(&map, is_land);
    let cell = f64::from(map.cell_m);
    let points: Vec<[f64; 3]> = land
        .places
        .iter()
        .zip(&land.heights)
        .map(|([x, y], z)| [f64::from(*x) * cell, f64::from(*y) * cell, *z])
        .collect();
    let grid = PositionGrid::enclosing(&points, 16);
    let objects = land.triangles.iter().map(|corners| land.objects[corners[0] as usize]).collect();
    let land = tile(grid, points.iter().map(|point| grid.nearest(*point)).collect(), land.triangles, objects);
    Ok([land, box_mesh(map, is_land)?])
}

/// Boxes of all columns but land.
fn box_mesh(map: BlockMap, is_land: &dyn Fn(u32) -> bool) -> Result<MeshTile, SourceError> {
    let step = f64::from(map.cell_m) / f64::from(QUARTERS);
    let grid = PositionGrid { min: [0.0, 0.0, map.z_base_m()], step, bits: 16 };
    let geometry = boxes::boxes(map, &mut |object, _| Ok((!is_land(object)).then_some(object)))?;
    let position = |[x, y, z]: &[u16; 3]| [QUARTERS * x, QUARTERS * y, *z].map(u32::from);
    let triangles: Vec<[u32; 3]> =
        geometry.indices.chunks_exact(3).map(|corners| [corners[0], corners[1], corners[2]]).collect();
    let objects = triangles.iter().map(|corners| geometry.features[corners[0] as usize]).collect();
    Ok(tile(grid, geometry.positions.iter().map(position).collect(), triangles, objects))
}

pub(crate) fn objects(objects: &ColumnObjects) -> impl Iterator<Item = u32> {
    let lists = [&objects.roof, &objects.wall, &objects.lower];
    lists.into_iter().flat_map(|list| list.iter().copied())
}

fn tile(grid: PositionGrid, positions: Vec<[u32; 3]>, triangles: Vec<[u32; 3]>, objects: Vec<u32>) -> MeshTile {
    let mesh = Mesh { grid, positions, triangles, attributes: Vec::new() };
    MeshTile { mesh, texture: None, objects, landmarks: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::land_surface::tests::slope;
    use insula_protocol::NODE_CELLS;

    #[test]
    fn land_is_a_surface_and_a_house_a_box() {
        let mut map = slope(|_, _| true);
        let mut objects = ColumnObjects::default();
        objects.roof[7 * NODE_CELLS + 5] = 9;
        map.objects = Some(Box::new(objects));
        let [land, house] = column_meshes(map, &|object| object != 9).unwrap();
        assert_eq!(land.mesh.triangles.len(), 2);
        assert!(house.objects.iter().all(|object| *object == 9) && !house.objects.is_empty());
        let positions: Vec<[f64; 3]> = house.mesh.positions_m().collect();
        assert!(positions.iter().all(|p| [10.0, 12.0].contains(&p[0]) && [14.0, 16.0].contains(&p[1])));
        let top = positions.iter().map(|p| p[2]).fold(0.0, f64::max);
        assert!((top - (6.0 + 27.0 / 8.0)).abs() <= 0.25, "{top}");
    }
}
