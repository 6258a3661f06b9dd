//! Objects of decoded tiles: one for each feature, or one for the tile.

use super::batch_table::BatchTable;
use super::reader::{ContentFault, Place, TileReader};
use super::tile::Tile;
use super::{globe, kind, uri};
use crate::gltf::{FeatureIds, GltfPrimitive, GltfScene};
use glam::{DMat4, DVec3};
use insula_source::attributes::Attributes;
use insula_source::object::{
    CrsReference, Description, FeatureKind, Shape, SourceImage, SourceMaterial, SourceObject, TriangleMesh,
};
use std::collections::BTreeMap;

/// Transforms with larger numbers are refused: no place on Earth needs them.
const MAX_TRANSFORM: f64 = 1e12;
/// Further texts of rights are left out.
const MAX_COPYRIGHTS: usize = 64;

/// A scene of a tile, and what its features are.
pub(super) struct Content<'a> {
    pub(super) scene: &'a GltfScene,
    /// Name of the file with the glTF, to which images are relative.
    pub(super) gltf_name: &'a str,
    /// The format of the tile, for objects without a class.
    pub(super) format: &'static str,
    /// The attributes of the features of a b3dm, and their number.
    pub(super) batch: Option<(&'a BatchTable<'a>, u32)>,
}

/// A feature of a tile: its table in the glTF, and its number.
type FeatureKey = (Option<usize>, Option<u32>);

impl TileReader<'_, '_> {
    /// Adds the objects of a scene. Returns their number.
    pub(super) fn add_scene(&mut self, tile: &Tile, content: &Content<'_>) -> Result<u32, ContentFault> {
        self.report_scene(tile, content.scene);
        let position = positions(tile, content.scene, &tile.transform)?;
        let is_mirrored = tile.transform.determinant() < 0.0;
        let mut materials = MaterialNumbers::default();
        let mut features: BTreeMap<FeatureKey, Vec<TriangleMesh>> = BTreeMap::new();
        for primitive in &content.scene.primitives {
            let material = primitive.material.and_then(|index| materials.get(self, content, index));
            match feature_ids(primitive, content.batch.map(|(_, length)| length)) {
                Some(ids) => {
                    for (feature, mesh) in primitive.meshes_by_feature(ids, &position, material) {
                        let table = ids.table.filter(|_| feature.is_some() && content.batch.is_none());
                        features.entry((table, feature)).or_default().push(mesh);
                    }
                }
                None => features.entry((None, None)).or_default().push(primitive.mesh(&position, material)),
            }
        }
        if let Some((table, length)) = content.batch {
            for row in (0..length).take(table.rows()).filter(|row| !features.contains_key(&(None, Some(*row)))) {
                let id = feature_id(tile, &table.attributes(row).0, Some(row));
                self.sink.skip("feature has no triangles", format!("{id}: in {}", tile.name));
            }
        }
        let mut added = 0;
        for (key, mut meshes) in features {
            meshes.iter_mut().filter(|_| is_mirrored).for_each(turn_around);
            added += self.add_feature(tile, content, key, meshes)?;
        }
        Ok(added)
    }

    /// Adds one feature, or what has none.
    fn add_feature(
        &mut self,
        tile: &Tile,
        content: &Content<'_>,
        (table, feature): FeatureKey,
        meshes: Vec<TriangleMesh>,
    ) -> Result<u32, ContentFault> {
        let scene = content.scene;
        let (attributes, class) = match (feature, content.batch, table) {
            (Some(feature), Some((batch, _)), _) => {
                let (attributes, class) = batch.attributes(feature);
                (attributes, class.map(str::to_owned))
            }
            (Some(feature), None, Some(table)) => {
                let class = scene.tables.get(table).map(|table| table.class.clone());
                (scene.attributes_of(table, feature), class)
            }
            (Some(_), None, None) => (Attributes::default(), None),
            (None, ..) => (whole_attributes(tile, scene), None),
        };
        let class = kind::class_of(&attributes).map(str::to_owned).or(class);
        let object = SourceObject {
            id: feature_id(tile, &attributes, feature),
            parent: None,
            kind: class.as_deref().and_then(kind::kind_of_name).or(tile.kind).unwrap_or(FeatureKind::Building),
            source_type: class.filter(|class| !class.is_empty()).unwrap_or_else(|| content.format.to_owned()),
            lod: kind::lod_of(&attributes),
            attributes,
            shape: Shape::None,
        };
        self.add_meshes(object, meshes)
    }

    /// Adds an object with its meshes, if it has triangles and lies where the others lie.
    pub(super) fn add_meshes(
        &mut self,
        mut object: SourceObject,
        mut meshes: Vec<TriangleMesh>,
    ) -> Result<u32, ContentFault> {
        meshes.retain(|mesh| !mesh.triangles.is_empty());
        let first = meshes.iter().find_map(|mesh| mesh.positions.first()).copied();
        let Some(first) = first.map(DVec3::from_array) else {
            self.sink.skip("feature has no triangles", object.id);
            return Ok(0);
        };
        let place = if globe::is_near_surface(first) { Place::Globe } else { Place::Unknown };
        if self.place.is_none() && place == Place::Globe {
            let crs = CrsReference::east_first("ECEF");
            self.sink.set_crs(&crs).map_err(ContentFault::End)?;
        }
        if *self.place.get_or_insert(place) != place {
            self.sink.skip("object is not on the globe as others of the tileset are, or the reverse", object.id);
            return Ok(0);
        }
        object.shape = Shape::Surfaces { polygons: Vec::new(), meshes };
        self.sink.add(object).map_err(ContentFault::End)?;
        Ok(1)
    }

    /// Passes on faults and rights of a scene.
    pub(super) fn report_scene(&mut self, tile: &Tile, scene: &GltfScene) {
        for (fault, detail) in &scene.problems {
            self.sink.problem(fault, format!("{}: {detail}", tile.name));
        }
        if let Some(text) = &scene.copyright {
            self.note_copyright(text);
        }
    }

    /// Passes on a text of rights, once.
    pub(super) fn note_copyright(&mut self, text: &str) {
        if self.copyrights.len() < MAX_COPYRIGHTS && !text.trim().is_empty() && self.copyrights.insert(text.to_owned())
        {
            self.sink.describe(Description::Attribution, text.trim());
        }
    }
}

/// Maps positions of a scene to those of the tileset. Fails if the transform is absurd.
pub(super) fn positions<'a>(
    tile: &'a Tile,
    scene: &GltfScene,
    transform: &DMat4,
) -> Result<impl Fn([f64; 3]) -> [f64; 3] + use<'a>, ContentFault> {
    let numbers = transform.to_cols_array();
    if !numbers.iter().all(|number| number.abs() < MAX_TRANSFORM) {
        return Err(ContentFault::tile(&tile.name, "its transform is not finite or too large"));
    }
    let transform = *transform * DMat4::from_translation(scene.rtc_center.map_or(DVec3::ZERO, DVec3::from_array));
    let up = tile.up;
    Ok(move |position| transform.transform_point3(DVec3::from_array(up.to_z_up(position))).to_array())
}

/// The identifiers that make the features of a primitive. `batch_length` is that of a b3dm.
fn feature_ids(primitive: &GltfPrimitive, batch_length: Option<u32>) -> Option<&FeatureIds> {
    let sets = &primitive.feature_ids;
    let batch = sets.iter().find(|ids| ids.label.as_deref() == Some("_BATCHID"));
    match batch_length {
        Some(0) => None,
        Some(_) => batch.or(sets.first()),
        None => sets.iter().find(|ids| ids.table.is_some()).or(sets.first()),
    }
}

/// The identifier of a feature: what its attributes say, or its number in the tile.
pub(super) fn feature_id(tile: &Tile, attributes: &Attributes, feature: Option<u32>) -> String {
    kind::id_of(attributes).unwrap_or_else(|| match feature {
        Some(feature) => format!("{}#{feature}", tile.name),
        None => tile.name.clone(),
    })
}

/// The attributes of a tile without features: its metadata, what the glTF says of itself, and those of its only node.
fn whole_attributes(tile: &Tile, scene: &GltfScene) -> Attributes {
    let mut attributes = tile.attributes.clone();
    let mut add = |more: &Attributes| more.iter().for_each(|(name, value)| attributes.push(name, value.clone()));
    add(&scene.attributes);
    if let Some(first) = scene.primitives.first().filter(|first| scene.primitives.iter().all(|p| p.node == first.node))
    {
        add(&first.attributes);
    }
    attributes
}

/// Reverses the triangles of a mesh, which a mirroring transform turned inside out.
pub(super) fn turn_around(mesh: &mut TriangleMesh) {
    mesh.triangles.iter_mut().for_each(|[_, b, c]| std::mem::swap(b, c));
}

/// The sink's numbers of the materials of a scene, added with the first use.
#[derive(Debug, Default)]
pub(super) struct MaterialNumbers {
    numbers: BTreeMap<usize, u32>,
}

impl MaterialNumbers {
    /// The number of a material of the scene; `None` if there is no such material.
    pub(super) fn get(&mut self, reader: &mut TileReader<'_, '_>, content: &Content<'_>, index: usize) -> Option<u32> {
        if let Some(number) = self.numbers.get(&index) {
            return Some(*number);
        }
        let mut material: SourceMaterial = content.scene.materials.get(index)?.clone();
        let gltf_name = content.gltf_name;
        match material.texture.as_mut().map(|texture| &mut texture.image) {
            Some(SourceImage::File(path)) => match uri::join(uri::folder_of(gltf_name), path) {
                Ok(name) => *path = uri::relative_to(uri::folder_of(reader.files.input.name), &name),
                Err(reason) => {
                    reader.sink.problem("texture is not read", format!("{gltf_name}: {path}: {reason}"));
                    material.texture = None;
                }
            },
            Some(SourceImage::Encoded { name, .. } | SourceImage::Texels { name, .. })
                if !name.starts_with(gltf_name) =>
            {
                *name = format!("{gltf_name}#{name}");
            }
            _ => {}
        }
        let number = reader.sink.add_material(material);
        self.numbers.insert(index, number);
        Some(number)
    }
}
