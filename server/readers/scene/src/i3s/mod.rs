//! I3S scene layers: 3D objects, integrated meshes and buildings, unpacked from an SLPK or as folders of a server.

mod atlas;
mod attributes;
#[cfg(feature = "draco")]
mod draco;
mod geometry;
mod layer;
mod materials;
mod mesh;
mod nodes;
mod place;
mod reader;
mod resources;
#[cfg(test)]
mod tests;

use super::tiles3d::files::TileFiles;
use super::tiles3d::{kind, uri};
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{Description, FeatureKind, ObjectSink};
use layer::{LayerJson, SublayerJson};
use reader::LayerReader;
use resources::Resources;

/// Sublayers are nested at most this deep, and there are at most this many.
const MAX_SUBLAYER_DEPTH: u32 = 16;
const MAX_SUBLAYERS: usize = 4096;

/// What all objects of a layer have in common.
#[derive(Debug, Clone, Copy)]
struct Objects<'a> {
    kind: FeatureKind,
    /// The type of the layer, or the category of a building's sublayer.
    source_type: &'a str,
}

#[cfg(not(feature = "draco"))]
mod draco {
    use super::mesh::NodeMesh;

    pub(super) const MAGIC: &[u8; 5] = b"DRACO";

    pub(super) fn decode(_: &[u8], _: u64) -> Result<NodeMesh, String> {
        Err(insula_source::error::left_out("draco"))
    }
}

/// Reads a scene layer by its document (`3dSceneLayer.json`, or what a server has at `layers/0`), or all layers of a service.
/// Fails if the document cannot be read or the layer has no surfaces; nodes that cannot be read are skipped.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let files = TileFiles::new(*input);
    let bytes = files.read(input.name).map_err(|cause| InputError::io(input.label, cause))?;
    let text = insula_source::json::without_bom(&bytes);
    let layer: LayerJson = serde_json::from_slice(text).map_err(|error| InputError::json(input.label, &error))?;
    let folder = folder_of(input.name);
    if layer.layer_type.is_none()
        && let Some(layers) = &layer.layers
    {
        for sublayer in layers.iter().take(MAX_SUBLAYERS) {
            let folder = joined(&folder, &format!("layers/{}", sublayer.id.unwrap_or(0)));
            read_sublayer(&files, &folder, (&layer, sublayer), None, sink)?;
        }
        return Ok(());
    }
    read_layer(&files, folder, &layer, input.label, sink)
}

/// The folder that has the resources of a layer document.
fn folder_of(name: &str) -> String {
    let stem = uri::stem(name).to_ascii_lowercase();
    let is_file = stem == "3dscenelayer" || stem == "index" || !uri::extension(name).is_empty();
    if is_file { uri::folder_of(name).to_owned() } else { name.split('?').next().unwrap_or_default().to_owned() }
}

fn joined(folder: &str, path: &str) -> String {
    if folder.is_empty() { path.to_owned() } else { format!("{folder}/{path}") }
}

fn read_layer(
    files: &TileFiles<'_>,
    folder: String,
    layer: &LayerJson,
    label: &str,
    sink: &mut dyn ObjectSink,
) -> Result<(), InputError> {
    if let Some(name) = layer.name.as_deref().filter(|name| !name.is_empty()) {
        sink.describe(Description::Title, name);
    }
    if let Some(text) = layer.copyright_text.as_deref().filter(|text| !text.trim().is_empty()) {
        sink.describe(Description::Attribution, text);
    }
    let layer_type = layer.layer_type.as_deref().unwrap_or_default();
    match layer_type {
        "3DObject" => {
            let names = [layer.name.as_deref(), layer.model_name.as_deref()];
            let kind = names.into_iter().flatten().find_map(kind::kind_of_name).unwrap_or(FeatureKind::Building);
            let objects = Objects { kind, source_type: layer_type };
            LayerReader::new(Resources::new(files, folder), layer, objects, sink).read()
        }
        "IntegratedMesh" => {
            let objects = Objects { kind: FeatureKind::Generic, source_type: layer_type };
            LayerReader::new(Resources::new(files, folder), layer, objects, sink).read()
        }
        "Building" => read_building(files, &folder, layer, sink),
        "" => Err(InputError::unsupported(label, "it is not the document of a scene layer")),
        other => {
            let what = format!("scene layers of the type {other} are not read, because they have no surfaces");
            Err(InputError::unsupported(label, what))
        }
    }
}

/// Reads the sublayers of a building: the overview, which is the outside of the building, or else all parts of the full model.
fn read_building(
    files: &TileFiles<'_>,
    folder: &str,
    layer: &LayerJson,
    sink: &mut dyn ObjectSink,
) -> Result<(), InputError> {
    let mut leaves = Vec::new();
    collect_sublayers(layer.sublayers.as_deref().unwrap_or_default(), 0, &mut leaves);
    let is_overview = |sublayer: &SublayerJson| {
        let names = [sublayer.model_name.as_deref(), sublayer.name.as_deref()];
        names.into_iter().flatten().any(|name| name.eq_ignore_ascii_case("overview"))
    };
    let has_overview = leaves.iter().any(|sublayer| is_overview(sublayer));
    for sublayer in leaves {
        let name = sublayer.name.as_deref().or(sublayer.model_name.as_deref()).unwrap_or("sublayer");
        if has_overview && !is_overview(sublayer) {
            sink.skip("sublayer is a part of the building whose overview is read", name.to_owned());
            continue;
        }
        if sublayer.model_name.as_deref() == Some("Rooms") {
            sink.skip("sublayer has the rooms of a building", name.to_owned());
            continue;
        }
        let kind = if has_overview { FeatureKind::Building } else { FeatureKind::BuildingPart };
        let source_type = sublayer.model_name.as_deref().unwrap_or("Building");
        let folder = joined(folder, &format!("sublayers/{}", sublayer.id.unwrap_or(0)));
        read_sublayer(files, &folder, (layer, sublayer), Some(Objects { kind, source_type }), sink)?;
    }
    Ok(())
}

/// The sublayers that are no groups.
fn collect_sublayers<'l>(sublayers: &'l [SublayerJson], depth: u32, leaves: &mut Vec<&'l SublayerJson>) {
    for sublayer in sublayers.iter().take_while(|_| depth < MAX_SUBLAYER_DEPTH) {
        if leaves.len() >= MAX_SUBLAYERS {
            return;
        }
        match sublayer.layer_type.as_deref() {
            Some("3DObject") => leaves.push(sublayer),
            _ => collect_sublayers(sublayer.sublayers.as_deref().unwrap_or_default(), depth + 1, leaves),
        }
    }
}

/// Reads a layer whose document lies in its folder, and which has the coordinate system of the one around it if it names none. One that
/// cannot be read is skipped.
fn read_sublayer(
    files: &TileFiles<'_>,
    folder: &str,
    (around, sublayer): (&LayerJson, &SublayerJson),
    objects: Option<Objects<'_>>,
    sink: &mut dyn ObjectSink,
) -> Result<(), InputError> {
    let resources = Resources::new(files, String::new());
    let document = resources
        .json::<LayerJson>(&joined(folder, "3dSceneLayer"))
        .or_else(|first| resources.json(folder).map_err(|_| first));
    let layer = match document {
        Ok(layer) => layer.within(around),
        Err(what) => {
            let name = sublayer.name.as_deref().unwrap_or("sublayer");
            sink.skip("layer cannot be read", format!("{name}: {what}"));
            return Ok(());
        }
    };
    match objects {
        Some(objects) => LayerReader::new(Resources::new(files, folder.to_owned()), &layer, objects, sink).read(),
        None => match read_layer(files, folder.to_owned(), &layer, folder, sink) {
            Err(InputError::Unsupported { what, .. }) => {
                sink.skip("layer cannot be read", format!("{folder}: {what}"));
                Ok(())
            }
            read => read,
        },
    }
}
