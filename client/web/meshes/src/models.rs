//! Packs models that a page adds to the city.

use glam::DVec3;
use insula_protocol::mesh::{Attribute, Mesh, PositionGrid};
use insula_viewer::additions::{PackedAddition, added_object};
use insula_viewer::transfer::to_bytes;
use insula_web_host::host::to_js;
use wasm_bindgen::prelude::*;

/// Bits of a coordinate: millimetres for a building.
const GRID_BITS: u8 = 16;

/// Packs a model for `CityViewer::add_model`: `positions` (x, y, z, ...) in metres from `origin`, the `colours` of each (red, green,
/// blue, ...), and the numbers of three positions for each of `triangles`. A named model is the object of its `number`. Fails if it is
/// incomplete or too large.
#[wasm_bindgen]
pub fn pack_model(
    number: u32,
    origin: &[f64],
    positions: &[f32],
    colours: &[u8],
    triangles: &[u32],
    is_named: bool,
) -> Result<Vec<u8>, JsError> {
    let (&[x, y, z], true) = (origin, positions.iter().all(|metres| metres.is_finite())) else {
        return Err(JsError::new("a position of the model is no number"));
    };
    let (mesh, corner) = mesh_of(DVec3::new(x, y, z), positions, colours, triangles);
    let object = added_object(number).filter(|_| is_named);
    let objects = object.map_or(Vec::new(), |object| vec![object; mesh.triangles.len()]);
    to_bytes(&PackedAddition::new(&mesh, corner, &objects).map_err(to_js)?).map_err(to_js)
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
