//! Pictures of the ground from above, as textures of terrain: what is painted, and photos over it.

use super::lattice::MapGrid;
use super::{Elevation, raster_fault};
use insula_dress::map_store::MapStore;
use insula_dress::paint::{GroundPainter, PaintError, PaintShape, over};
use insula_source::error::InputError;
use insula_source::texture::SceneTexture;

/// Texels along the side of a texture.
const MAX_SIDE: f64 = 4096.0;
/// Texels around the wanted area, so that reads at its border do not reach the other side of the texture.
const MARGIN: f64 = 2.0;
/// Texels of what is painted, in cells: finer ones would be seen only where meshes are, at a multiple of the bytes.
const PAINTED_TEXEL_CELLS: f64 = 0.5;

/// What pictures of the ground are made of, besides photos.
pub struct GroundPictures<'s> {
    shapes: Option<&'s MapStore<PaintShape>>,
    /// 8-bit sRGB where there is nothing.
    ground: [u8; 3],
    texel_m: f64,
    painted_texel_m: f64,
}

/// A picture of the ground.
pub struct Drape {
    pub texture: SceneTexture,
    pub place: DrapePlace,
    /// Whether a part of it is a photo.
    pub has_photo: bool,
}

/// The ground as seen from above.
pub(super) struct AerialPicture {
    /// By row from the south; `None` where there is nothing to show.
    colours: Vec<Option<[u8; 3]>>,
    /// World position of its south-western corner.
    corner: [f64; 2],
    texel_m: f64,
    size: [usize; 2],
    has_photo: bool,
}

impl AerialPicture {
    /// Whether there is anything to show in a rectangle, which lies within the picture.
    pub(super) fn shows(&self, bounds: [[f64; 2]; 2]) -> bool {
        let [columns, [south, north]] = self.texels(bounds);
        (south..north).any(|y| self.row(y, columns).iter().any(Option::is_some))
    }

    /// Columns and rows of a rectangle's texels, first and end.
    fn texels(&self, [low, high]: [[f64; 2]; 2]) -> [[usize; 2]; 2] {
        [0, 1].map(|axis| {
            let [first, end] = [low, high].map(|bound| (bound[axis] - self.corner[axis]) / self.texel_m);
            [first.floor().max(0.0) as usize, (end.ceil().max(0.0) as usize).min(self.size[axis])]
        })
    }

    fn row(&self, y: usize, [first, end]: [usize; 2]) -> &[Option<[u8; 3]>] {
        &self.colours[y * self.size[0] + first..y * self.size[0] + end]
    }

    /// The part in a rectangle, which lies within the picture.
    pub(super) fn part(&self, bounds: [[f64; 2]; 2], ground: &GroundPictures<'_>) -> Drape {
        let margin = MARGIN as usize;
        let texels = self.texels(bounds);
        let [columns, rows] = [0, 1].map(|axis| {
            let [first, end] = texels[axis];
            [first.saturating_sub(margin), (end + margin).min(self.size[axis])]
        });
        // Rows of textures go from the top.
        let colours = (rows[0]..rows[1]).rev().flat_map(|y| self.row(y, columns));
        let rgb = colours.map(|colour| colour.unwrap_or(ground.ground)).collect();
        let size = [columns, rows].map(|[first, end]| end - first);
        let texture = SceneTexture { width: size[0] as u32, height: size[1] as u32, rgb, is_pattern: false };
        let first = [columns[0], rows[0]];
        let corner = [0, 1].map(|axis| self.corner[axis] + first[axis] as f64 * self.texel_m);
        let place = DrapePlace { corner, size_m: size.map(|side| side as f64 * self.texel_m) };
        Drape { texture, place, has_photo: self.has_photo }
    }
}

/// Where a texture lies on the map.
#[derive(Debug, Clone, Copy)]
pub struct DrapePlace {
    /// World position of its south-western corner, and its size in metres.
    corner: [f64; 2],
    size_m: [f64; 2],
}

impl DrapePlace {
    /// Texture coordinates of a world position, v up.
    pub fn uv(&self, position: [f64; 3]) -> [f32; 2] {
        [0, 1].map(|axis| ((position[axis] - self.corner[axis]) / self.size_m[axis]) as f32)
    }
}

impl<'s> GroundPictures<'s> {
    /// Photos with texels of at least `texel_m`, and shapes, on ground of a colour. Fails if texels of this size cannot
    /// be painted.
    pub fn new(
        shapes: &'s MapStore<PaintShape>,
        ground: [u8; 3],
        cell_m: f64,
        texel_m: f64,
    ) -> Result<Self, PaintError> {
        let painted_texel_m = texel_m.max(PAINTED_TEXEL_CELLS * cell_m);
        GroundPainter::new(painted_texel_m)?;
        Ok(Self { shapes: (!shapes.is_empty()).then_some(shapes), ground, texel_m, painted_texel_m })
    }

    pub(super) fn photos(ground: [u8; 3], texel_m: f64) -> Self {
        Self { shapes: None, ground, texel_m, painted_texel_m: texel_m }
    }

    /// Whether there is anything to paint.
    pub(super) fn is_painted(&self) -> bool {
        self.shapes.is_some()
    }

    /// Longest side of an area whose picture has the wanted texels.
    pub(super) fn side_m(&self) -> f64 {
        (MAX_SIDE - 2.0 * MARGIN) * if self.is_painted() { self.painted_texel_m } else { self.texel_m }
    }
}

impl Elevation {
    /// A picture of the rectangle from `low` to `high`, with texels as large as wanted, or as the photos' pixels if
    /// those are larger; `None` if there is nothing to show. Fails if a photo or a shape cannot be read.
    pub(super) fn picture(
        &self,
        [low, high]: [[f64; 2]; 2],
        ground: &GroundPictures<'_>,
    ) -> Result<Option<AerialPicture>, InputError> {
        let overlapping = || {
            let placed = self.pictures.iter().filter_map(|picture| Some((picture, picture.placed.as_ref()?)));
            placed.filter(|(_, placed)| {
                (0..2).all(|axis| placed.bounds[0][axis] < high[axis] && placed.bounds[1][axis] > low[axis])
            })
        };
        let pixel_m = overlapping().map(|(_, placed)| placed.pixel_m).reduce(f64::min);
        let wanted_m = match (pixel_m, ground.is_painted()) {
            (Some(pixel_m), _) => ground.texel_m.max(pixel_m),
            (None, true) => ground.painted_texel_m,
            (None, false) => return Ok(None),
        };
        let extent = [high[0] - low[0], high[1] - low[1]];
        let texel_m = wanted_m.max(extent[0].max(extent[1]) / (MAX_SIDE - 2.0 * MARGIN - 1.0));
        // On the grid of texels that all pictures share, so that they meet.
        let corner = low.map(|along| ((along / texel_m).floor() - MARGIN) * texel_m);
        let size = [0, 1].map(|axis| ((high[axis] - corner[axis]) / texel_m + MARGIN).ceil() as usize);
        let mut colours = self.paint(ground, corner, size, texel_m)?;
        let first = corner.map(|along| along + texel_m / 2.0);
        let grid = MapGrid { corner: first, step_m: texel_m, size };
        let mut has_photo = false;
        for (picture, _) in overlapping() {
            let found = picture.colours(&grid).map_err(|error| raster_fault(&picture.label, error))?;
            has_photo |= found.iter().any(Option::is_some);
            for (colour, finer) in colours.iter_mut().zip(found) {
                *colour = finer.or(*colour);
            }
        }
        let is_empty = colours.iter().all(Option::is_none);
        Ok((!is_empty).then_some(AerialPicture { colours, corner, texel_m, size, has_photo }))
    }

    /// A picture of a whole rectangle, as [`Self::picture`].
    pub(super) fn drape(
        &self,
        bounds: [[f64; 2]; 2],
        ground: &GroundPictures<'_>,
    ) -> Result<Option<Drape>, InputError> {
        Ok(self
            .picture(bounds, ground)?
            .filter(|picture| picture.shows(bounds))
            .map(|picture| picture.part(bounds, ground)))
    }

    /// What is painted in a rectangle, by row from the south.
    fn paint(
        &self,
        ground: &GroundPictures<'_>,
        corner: [f64; 2],
        size: [usize; 2],
        texel_m: f64,
    ) -> Result<Vec<Option<[u8; 3]>>, InputError> {
        let nothing = || vec![None; size[0] * size[1]];
        let Some(store) = ground.shapes else { return Ok(nothing()) };
        let failed =
            |error: &dyn std::error::Error| InputError::io("the ground", std::io::Error::other(error.to_string()));
        let high = [0, 1].map(|axis| corner[axis] + size[axis] as f64 * texel_m);
        let shapes = store.shapes_in([corner, high]).map_err(|error| failed(&error))?;
        if shapes.is_empty() {
            return Ok(nothing());
        }
        let painter = GroundPainter::new(texel_m).map_err(|error| failed(&error))?;
        let painted = painter.paint(&shapes, corner, size).map_err(|error| failed(&error))?;
        Ok(painted.into_iter().map(|texel| (texel[3] > 0).then(|| over(texel, ground.ground))).collect())
    }
}
