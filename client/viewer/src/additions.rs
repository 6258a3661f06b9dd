//! What is added to a city without a bake: meshes that stay resident and are drawn at every distance.

use glam::DVec3;
use insula_protocol::blockmap::NO_OBJECT;
use insula_protocol::mesh::{Attribute, Mesh, PositionGrid};
use insula_shaders::mesh::{MAX_TRIANGLES, PackError, PackedMesh};
use serde::{Deserialize, Serialize};

/// Most meshes that are added: each ray tests the boxes of all.
pub const MAX_ADDED_MESHES: usize = 64;
/// Number of the first added object. No city has so many objects.
pub const FIRST_ADDED: u32 = 0xffff_0000;
/// Bits of a coordinate: millimetres for a building.
const GRID_BITS: u8 = 16;
/// Plaster, in 8-bit sRGB.
const PLASTER_RGB: [u8; 3] = [228, 219, 205];

/// An object that is added.
#[derive(Debug, Clone)]
pub struct AddedObject {
    pub name: String,
    /// World metres.
    pub triangles: Vec<[[f64; 3]; 3]>,
}

/// Why objects cannot be added.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AdditionError {
    /// They would take more meshes than rays can test.
    #[error("the added models are {0} meshes, of which {MAX_ADDED_MESHES} can be drawn: join models in fewer files")]
    TooMany(usize),
    /// They would take too much of the cache.
    #[error("the added models take {needed_mib} MiB, more than half of the cache: raise --cache-mib, or simplify them")]
    TooLarge { needed_mib: u64 },
    #[error(transparent)]
    Pack(#[from] PackError),
}

/// A mesh that is to be added.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PackedAddition {
    /// World position that the mesh is relative to, in whole metres.
    pub(crate) corner: DVec3,
    pub(crate) mesh: PackedMesh,
}

impl PackedAddition {
    /// A mesh with colours, relative to a position. `objects` are those of its triangles, or empty. Fails if it is too large or
    /// incomplete.
    pub fn new(mesh: &Mesh, corner: DVec3, objects: &[u32]) -> Result<Self, PackError> {
        Ok(Self { corner, mesh: PackedMesh::new(mesh, None, objects, &[])? })
    }
}

/// The object that the model of a number is; `None` if there are no more.
pub fn added_object(number: u32) -> Option<u32> {
    FIRST_ADDED.checked_add(number).filter(|object| *object != NO_OBJECT)
}

impl AddedObject {
    /// World coordinates of the middle of its box; `None` without triangles.
    pub fn centre(&self) -> Option<[f64; 3]> {
        let [low, high] = self.bounds();
        (low[0] <= high[0]).then(|| std::array::from_fn(|k| 0.5 * (low[k] + high[k])))
    }

    /// Lowest and highest corner; inverted without triangles.
    fn bounds(&self) -> [[f64; 3]; 2] {
        let nothing = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        self.triangles.iter().flatten().fold(nothing, |[low, high], corner| {
            [std::array::from_fn(|k| low[k].min(corner[k])), std::array::from_fn(|k| high[k].max(corner[k]))]
        })
    }
}

/// The meshes of objects, which are numbered from [`FIRST_ADDED`] on. Fails if there are too many.
pub fn pack(objects: &[AddedObject]) -> Result<Vec<PackedAddition>, AdditionError> {
    let parts = |object: &AddedObject| object.triangles.len().div_ceil(MAX_TRIANGLES);
    let meshes: usize = objects.iter().map(parts).sum();
    if meshes > MAX_ADDED_MESHES {
        return Err(AdditionError::TooMany(meshes));
    }
    let mut packed = Vec::with_capacity(meshes);
    for (number, object) in (FIRST_ADDED..).zip(objects) {
        let corner = DVec3::from(object.bounds()[0]).floor();
        for triangles in object.triangles.chunks(MAX_TRIANGLES) {
            let mesh = mesh_of(triangles, corner);
            let numbers = vec![number; triangles.len()];
            packed.push(PackedAddition::new(&mesh, corner, &numbers)?);
        }
    }
    Ok(packed)
}

/// Triangles of plaster, relative to `corner`.
fn mesh_of(triangles: &[[[f64; 3]; 3]], corner: DVec3) -> Mesh {
    let places: Vec<[f64; 3]> =
        triangles.iter().flatten().map(|place| (DVec3::from(*place) - corner).to_array()).collect();
    let grid = PositionGrid::enclosing(&places, GRID_BITS);
    Mesh {
        grid,
        positions: places.iter().map(|place| grid.nearest(*place)).collect(),
        triangles: (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        attributes: vec![Attribute::colours([PLASTER_RGB], vec![0; places.len()])],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(x: f64) -> AddedObject {
        let [a, b, c] = [[x, 500.0, 20.0], [x + 10.0, 500.0, 20.0], [x, 500.0, 80.0]];
        AddedObject { name: "tower".to_owned(), triangles: vec![[a, b, c]] }
    }

    #[test]
    fn each_object_is_a_mesh_of_its_own_number() {
        let packed = pack(&[object(85_000.5), object(85_100.0)]).unwrap();
        let numbers: Vec<_> = packed.iter().map(|found| found.mesh.objects.as_ref().unwrap().list.clone()).collect();
        assert_eq!(numbers, [vec![FIRST_ADDED], vec![FIRST_ADDED + 1]]);
        assert_eq!((packed[0].corner, packed[0].mesh.z_m), (DVec3::new(85_000.0, 500.0, 20.0), [0.0, 60.0]));
        assert_eq!(object(85_000.0).centre(), Some([85_005.0, 500.0, 50.0]));
        assert_eq!(AddedObject { name: String::new(), triangles: Vec::new() }.centre(), None);
        assert_eq!([0, 1, 0xffff].map(added_object), [Some(FIRST_ADDED), Some(FIRST_ADDED + 1), None]);
    }

    #[test]
    fn too_many_meshes_are_refused() {
        let objects: Vec<AddedObject> = (0..65).map(|x| object(f64::from(x))).collect();
        assert_eq!(pack(&objects).unwrap_err(), AdditionError::TooMany(65));
        assert_eq!(pack(&objects[1..]).unwrap().len(), 64);
    }
}
