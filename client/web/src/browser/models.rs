//! Models that the page adds to the city.

use super::viewer::CityViewer;
use glam::DVec3;
use insula_protocol::blockmap::NO_OBJECT;
use insula_protocol::mesh::{Attribute, Mesh, PositionGrid};
use insula_viewer::additions::{AdditionError, FIRST_ADDED, MAX_ADDED_MESHES, PackedAddition};
use insula_web_host::host::to_js;
use wasm_bindgen::prelude::*;

/// Bits of a coordinate: millimetres for a building.
const GRID_BITS: u8 = 16;

#[wasm_bindgen]
impl CityViewer {
    /// Adds a model: `positions` (x, y, z, ...) in metres from `origin`, the `colours` of each (red, green, blue, ...), and the numbers
    /// of three positions for each of `triangles`. All tiles are fetched again. Returns the object that a named model is. Fails if it is
    /// incomplete, or too large together with the others, and then is not added.
    #[wasm_bindgen(js_name = addModel)]
    pub fn add_model(
        &mut self,
        number: u32,
        origin: &[f64],
        positions: &[f32],
        colours: &[u8],
        triangles: &[u32],
        is_named: bool,
    ) -> Result<Option<u32>, JsError> {
        let (&[x, y, z], true) = (origin, positions.iter().all(|metres| metres.is_finite())) else {
            return Err(JsError::new("a position of the model is no number"));
        };
        let (mesh, corner) = mesh_of(DVec3::new(x, y, z), positions, colours, triangles);
        let object = FIRST_ADDED.checked_add(number).filter(|object| is_named && *object != NO_OBJECT);
        let objects = object.map_or(Vec::new(), |object| vec![object; mesh.triangles.len()]);
        let addition = PackedAddition::new(&mesh, corner, &objects).map_err(to_js)?;
        if self.models.len() >= MAX_ADDED_MESHES {
            return Err(to_js(AdditionError::TooMany(self.models.len() + 1)));
        }
        self.models.insert(number, addition);
        let pages = self.streamer.cache().capacity_pages();
        if self.restart(pages).is_err() {
            self.models.remove(&number);
            self.renew(pages);
            return Err(JsError::new("the models take more than half of the memory for the city: simplify them"));
        }
        Ok(object)
    }

    /// Shows or hides all models from the next frame on. No tile is fetched again.
    #[wasm_bindgen(js_name = showModels)]
    pub fn show_models(&mut self, are_shown: bool) {
        self.are_models_shown = are_shown;
        self.streamer.show_additions(are_shown);
        self.style_changes += 1;
    }

    /// Removes a model. All tiles are fetched again.
    #[wasm_bindgen(js_name = removeModel)]
    pub fn remove_model(&mut self, number: u32) {
        if self.models.remove(&number).is_some() {
            self.renew(self.streamer.cache().capacity_pages());
        }
    }
}

/// A mesh of coloured triangles, and the position that it is relative to.
fn mesh_of(origin: DVec3, positions: &[f32], colours: &[u8], triangles: &[u32]) -> (Mesh, DVec3) {
    let place = |&[x, y, z]: &[f32; 3]| origin + DVec3::new(x.into(), y.into(), z.into());
    let places: Vec<DVec3> = positions.as_chunks::<3>().0.iter().map(place).collect();
    let corner = places.iter().copied().reduce(DVec3::min).unwrap_or_default().floor();
    let places: Vec<[f64; 3]> = places.iter().map(|place| (*place - corner).to_array()).collect();
    let grid = PositionGrid::enclosing(&places, GRID_BITS);
    let mesh = Mesh {
        grid,
        positions: places.iter().map(|place| grid.nearest(*place)).collect(),
        triangles: triangles.as_chunks::<3>().0.to_vec(),
        attributes: vec![Attribute::colours(colours.as_chunks::<3>().0.iter().copied(), triangles.to_vec())],
    };
    (mesh, corner)
}
