//! Eyes that are inside of a building or below the ground.

use glam::DVec2;
use insula_export::camera::ExportCamera;
use insula_export::source::{ExportSource, SourceError};
use insula_protocol::TileId;
use insula_viewer::collision;
use insula_viewer::solids::{ColumnSolids, MeshSolids, SolidInterval};

/// A camera that is lifted out of what its eye is inside of, or below, and looks in the same direction; `None` if it is outside. Fails if
/// tiles cannot be read.
pub fn lifted_camera(source: &dyn ExportSource, camera: ExportCamera) -> Result<Option<ExportCamera>, SourceError> {
    let eye = camera.position;
    let z = collision::lifted_eye_z(source.manifest(), solids_at(source, eye)?, eye[2]);
    Ok(z.map(|z| camera.raised(z - eye[2])))
}

/// The solids of the finest tile at the place of an eye, as world heights.
fn solids_at(source: &dyn ExportSource, [x, y, _]: [f64; 3]) -> Result<Vec<SolidInterval>, SourceError> {
    let manifest = source.manifest();
    let [west, south] = [x - manifest.origin[0], y - manifest.origin[1]];
    if !(west >= 0.0 && south >= 0.0) {
        return Ok(Vec::new());
    }
    for level in (0..=manifest.depth).rev() {
        let side_m = manifest.node_side_m(level);
        let [column, row] = [west, south].map(|metres| (metres / side_m) as u32);
        let Some(id) = TileId::new(level, column, row) else { return Ok(Vec::new()) };
        let corner = manifest.node_corner(id);
        let place = DVec2::new(x - corner[0], y - corner[1]);
        let mesh = if level == manifest.depth { source.mesh(id, 0)? } else { None };
        let solids = match mesh {
            Some(tile) => MeshSolids::new(&tile.mesh).intervals_at(place),
            None => match source.columns(id)? {
                Some(map) => ColumnSolids::new(&map.stand_on_ground()).intervals_at(place),
                None => continue,
            },
        };
        let in_world =
            |solid: SolidInterval| SolidInterval { bottom: solid.bottom + corner[2], top: solid.top + corner[2] };
        return Ok(solids.into_iter().map(in_world).collect());
    }
    Ok(Vec::new())
}
