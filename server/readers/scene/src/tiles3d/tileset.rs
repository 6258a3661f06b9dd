//! The JSON of a tileset.

use insula_source::error::InputError;
use insula_source::json::members::Members;
use insula_source::json::without_bom;
use serde::Deserialize;

/// A `tileset.json`. Members that are not read are left out.
#[derive(Debug, Deserialize)]
pub(super) struct TilesetJson {
    pub(super) asset: Option<AssetJson>,
    pub(super) root: TileJson,
    /// Metadata that contents share.
    pub(super) groups: Option<Vec<MetadataJson>>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct AssetJson {
    /// `X`, `Y` or `Z`: the direction that is up in the glTF of version 1.0. Never standard, but in use.
    pub(super) gltf_up_axis: Option<String>,
    pub(super) copyright: Option<String>,
}

#[derive(Debug, Deserialize)]
pub(super) struct MetadataJson {
    pub(super) properties: Option<Members>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TileJson {
    pub(super) bounding_volume: Option<VolumeJson>,
    pub(super) transform: Option<Vec<f64>>,
    pub(super) refine: Option<String>,
    pub(super) content: Option<ContentJson>,
    pub(super) contents: Option<Vec<ContentJson>>,
    pub(super) children: Option<Vec<TileJson>>,
    pub(super) implicit_tiling: Option<ImplicitJson>,
    pub(super) metadata: Option<MetadataJson>,
    pub(super) extensions: Option<TileExtensions>,
}

/// Extensions of version 1.0 that became part of 1.1.
#[derive(Debug, Deserialize)]
pub(super) struct TileExtensions {
    #[serde(default, rename = "3DTILES_implicit_tiling")]
    pub(super) implicit_tiling: Option<ImplicitJson>,
    #[serde(default, rename = "3DTILES_multiple_contents")]
    pub(super) multiple_contents: Option<MultipleContents>,
}

#[derive(Debug, Deserialize)]
pub(super) struct MultipleContents {
    #[serde(default, alias = "content")]
    pub(super) contents: Option<Vec<ContentJson>>,
}

#[derive(Debug, Deserialize)]
pub(super) struct ContentJson {
    /// `url` before version 1.0.
    #[serde(default, alias = "url")]
    pub(super) uri: Option<String>,
    /// Index of the tileset's group.
    pub(super) group: Option<u32>,
    pub(super) metadata: Option<MetadataJson>,
}

#[derive(Debug, Clone, Default, Deserialize)]
pub(super) struct VolumeJson {
    /// West, south, east, north in radians, lowest and highest height.
    pub(super) region: Option<Vec<f64>>,
    /// Centre and three half axes.
    #[serde(default, rename = "box")]
    pub(super) box_: Option<Vec<f64>>,
    /// Centre and radius.
    pub(super) sphere: Option<Vec<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct ImplicitJson {
    pub(super) subdivision_scheme: String,
    pub(super) subtree_levels: u32,
    pub(super) available_levels: Option<u32>,
    /// The deepest level: one less than `available_levels`, which came later.
    pub(super) maximum_level: Option<u32>,
    pub(super) subtrees: SubtreesJson,
}

#[derive(Debug, Deserialize)]
pub(super) struct SubtreesJson {
    pub(super) uri: String,
}

impl TilesetJson {
    /// Parses the text of a tileset. Fails if it is no JSON or not that of a tileset.
    pub(super) fn parse(label: &str, text: &[u8]) -> Result<Self, InputError> {
        serde_json::from_slice(without_bom(text)).map_err(|error| InputError::json(label, &error))
    }

    pub(super) fn group(&self, index: u32) -> Option<&Members> {
        self.groups.as_ref()?.get(index as usize)?.properties.as_ref()
    }
}

impl TileJson {
    pub(super) fn contents(&self) -> impl Iterator<Item = &ContentJson> {
        let old = self.extensions.as_ref().and_then(|extensions| extensions.multiple_contents.as_ref());
        let old = old.and_then(|old| old.contents.as_ref());
        self.content.iter().chain(self.contents.iter().flatten()).chain(old.into_iter().flatten())
    }

    /// The tile's implicit children.
    pub(super) fn implicit(&self) -> Option<&ImplicitJson> {
        let old = || self.extensions.as_ref().and_then(|extensions| extensions.implicit_tiling.as_ref());
        self.implicit_tiling.as_ref().or_else(old)
    }
}
