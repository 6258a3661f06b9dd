//! Reads glTF, 3D Tiles, I3S, OBJ and mesh files.

mod bytes;
mod gltf;
mod i3s;
mod mesh_file;
mod mesh_unit;
mod obj;
mod tiles3d;

pub use gltf::read as read_gltf;
pub use i3s::read as read_i3s;
pub use mesh_file::read as read_mesh;
pub use obj::read as read_obj;
pub use tiles3d::read as read_3d_tiles;
