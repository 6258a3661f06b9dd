//! Heights of given terrain at the vertices of the grid.

use super::grid::GroundGrid;
use crate::error::BakeError;
use crate::sample::rasterise;
use crate::scene::ObjectKind;
use crate::scene::scratch_scene::ScratchScene;

/// Triangles that are steeper, by the z of their unit normal, have no height.
const MIN_NORMAL_Z: f32 = 0.05;

/// The highest terrain at each vertex; not finite where there is none. Fails if the triangles cannot be read.
pub(super) fn find(city: &ScratchScene, grid: &GroundGrid) -> Result<Vec<f32>, BakeError> {
    let mut heights = vec![f32::NEG_INFINITY; grid.len()];
    let mut has_terrain = false;
    city.objects.try_for_each(|_, object| {
        has_terrain |= object.kind == ObjectKind::Terrain;
        Ok::<_, BakeError>(())
    })?;
    if !has_terrain {
        return Ok(heights);
    }
    let mut objects = city.objects.cursor();
    city.try_for_each(|triangle| {
        if objects.get(triangle.object as usize)?.kind != ObjectKind::Terrain {
            return Ok(());
        }
        // In steps from the south-west vertex.
        let [a, b, c] = triangle.corners.map(|corner| {
            let along = |axis: usize| ((f64::from(corner[axis]) - grid.corner[axis]) / grid.step_m) as f32;
            glam::Vec3::new(along(0), along(1), corner[2])
        });
        let n = (b - a).cross(c - a);
        if n.z.abs() <= MIN_NORMAL_Z * n.length() {
            return Ok(());
        }
        // Points of the scan conversion lie half a step from the origin.
        let corners = [a, b, c].map(|p| [p.x + 0.5, p.y + 0.5]);
        rasterise(corners, 1.0, grid.size, |y, first, end| {
            for x in first..end {
                let z = a.z - (n.x * (x as f32 - a.x) + n.y * (y as f32 - a.y)) / n.z;
                let highest = &mut heights[grid.index(x, y)];
                *highest = highest.max(z);
            }
        });
        Ok(())
    })?;
    Ok(heights)
}
