//! Pictures from above, as textures of terrain.

use super::lattice::MapGrid;
use super::{Elevation, raster_fault};
use crate::error::InputError;
use crate::scene::SceneTexture;

/// Texels along the side of a texture.
const MAX_SIDE: f64 = 4096.0;
/// Texels around the wanted area, so that reads at its border do not reach the other side of the texture.
const MARGIN: f64 = 2.0;

/// Where a texture lies on the map.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrapePlace {
    /// World position of its south-western corner, and its size in metres.
    corner: [f64; 2],
    size_m: [f64; 2],
}

impl DrapePlace {
    /// Texture coordinates of a world position, v up.
    pub(crate) fn uv(&self, position: [f64; 3]) -> [f32; 2] {
        [0, 1].map(|axis| ((position[axis] - self.corner[axis]) / self.size_m[axis]) as f32)
    }
}

impl Elevation {
    /// The pictures over the rectangle from `low` to `high`, with texels of `texel_m` or of the pictures' own size if
    /// that is larger. Where there is none, it has the colour `ground`; `None` if there is none anywhere. Fails if a
    /// picture cannot be read.
    pub(crate) fn drape(
        &self,
        [low, high]: [[f64; 2]; 2],
        texel_m: f64,
        ground: [u8; 3],
    ) -> Result<Option<(SceneTexture, DrapePlace)>, InputError> {
        let overlapping = || {
            let placed = self.pictures.iter().filter_map(|picture| Some((picture, picture.placed.as_ref()?)));
            placed.filter(|(_, placed)| {
                (0..2).all(|axis| placed.bounds[0][axis] < high[axis] && placed.bounds[1][axis] > low[axis])
            })
        };
        let Some(pixel_m) = overlapping().map(|(_, placed)| placed.pixel_m).reduce(f64::min) else { return Ok(None) };
        let extent = [high[0] - low[0], high[1] - low[1]];
        let texel_m = texel_m.max(pixel_m).max(extent[0].max(extent[1]) / (MAX_SIDE - 2.0 * MARGIN));
        let size = extent.map(|side| ((side / texel_m).ceil() + 2.0 * MARGIN) as usize);
        let corner = low.map(|along| along - MARGIN * texel_m);
        let first = corner.map(|along| along + texel_m / 2.0);
        let grid = MapGrid { corner: first, step_m: texel_m, size };
        let mut colours = vec![None; size[0] * size[1]];
        for (picture, _) in overlapping() {
            let found = picture.colours(&grid).map_err(|error| raster_fault(&picture.label, error))?;
            for (colour, finer) in colours.iter_mut().zip(found) {
                *colour = finer.or(*colour);
            }
        }
        if colours.iter().all(Option::is_none) {
            return Ok(None);
        }
        // Rows of textures go from the top.
        let rows = colours.chunks_exact(size[0]).rev().flatten();
        let rgb = rows.map(|colour| colour.unwrap_or(ground)).collect();
        let texture = SceneTexture { width: size[0] as u32, height: size[1] as u32, rgb, is_pattern: false };
        let size_m = size.map(|side| side as f64 * texel_m);
        Ok(Some((texture, DrapePlace { corner, size_m })))
    }
}
