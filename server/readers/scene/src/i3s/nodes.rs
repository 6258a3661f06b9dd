//! The tree of nodes of a layer, in pages or in one document for each node.

use super::layer::LayerJson;
use super::resources::Resources;
use crate::tiles3d::uri;
use serde::Deserialize;
use std::collections::HashMap;

/// Pages that are kept in memory.
const MAX_PAGES: usize = 256;
/// Pages with more nodes are refused.
const MAX_NODES_PER_PAGE: u32 = 1 << 20;
/// The number of nodes of a page if the layer does not tell.
const DEFAULT_NODES_PER_PAGE: u32 = 64;

#[derive(Debug, Deserialize)]
struct PageJson {
    nodes: Vec<PagedNodeJson>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct PagedNodeJson {
    obb: Option<ObbJson>,
    children: Option<Vec<u32>>,
    mesh: Option<MeshJson>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
struct ObbJson {
    center: [f64; 3],
    half_size: Option<[f64; 3]>,
}

#[derive(Debug, Clone, Deserialize)]
struct MeshJson {
    material: Option<PartJson>,
    geometry: Option<PartJson>,
    attribute: Option<PartJson>,
}

/// A part of a mesh: where it is, and which definition of the layer it follows.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
struct PartJson {
    definition: Option<u32>,
    resource: Option<u32>,
    vertex_count: Option<u64>,
    feature_count: Option<u64>,
}

/// A node in a document of its own, as before version 1.7.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct NodeJson {
    mbs: Option<[f64; 4]>,
    obb: Option<ObbJson>,
    children: Option<Vec<ReferenceJson>>,
    geometry_data: Option<Vec<HrefJson>>,
    texture_data: Option<Vec<HrefJson>>,
    attribute_data: Option<Vec<HrefJson>>,
    shared_resource: Option<HrefJson>,
}

#[derive(Debug, Deserialize)]
struct ReferenceJson {
    id: serde_json::Value,
}

#[derive(Debug, Deserialize)]
struct HrefJson {
    href: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum NodeId {
    Paged(u32),
    Document(String),
}

impl std::fmt::Display for NodeId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Paged(index) => write!(f, "{index}"),
            Self::Document(id) => f.write_str(id),
        }
    }
}

#[derive(Debug, Clone)]
pub(super) struct Node {
    pub(super) center: [f64; 3],
    pub(super) radius_m: f64,
    pub(super) children: Vec<NodeId>,
    pub(super) mesh: Option<NodeResources>,
}

/// Where the mesh of a node lies. Paths are those within the layer.
#[derive(Debug, Clone)]
pub(super) struct NodeResources {
    pub(super) geometry: GeometrySource,
    /// Numbers of vertices and features.
    pub(super) counts: [Option<u64>; 2],
    /// The folder of the attributes.
    pub(super) attributes: Option<String>,
    pub(super) material: MaterialSource,
}

#[derive(Debug, Clone)]
pub(super) enum GeometrySource {
    /// In the folder, by a geometry definition of the layer.
    Defined { folder: String, definition: u32 },
    /// By the schema of the store.
    Schema { path: String },
}

#[derive(Debug, Clone)]
pub(super) enum MaterialSource {
    None,
    /// A material definition of the layer, with textures in the folder.
    Defined {
        folder: String,
        definition: u32,
    },
    /// The shared resource of the node, and whether the node has textures.
    Shared {
        path: String,
        has_textures: bool,
    },
}

/// Reads nodes by their identifiers.
pub(super) struct Nodes {
    nodes_per_page: u32,
    root: NodeId,
    pages: HashMap<u32, Vec<Node>>,
}

impl Nodes {
    pub(super) fn new(layer: &LayerJson) -> Self {
        let root = match &layer.node_pages {
            Some(pages) => NodeId::Paged(pages.root_index.unwrap_or(0)),
            None => {
                let path = layer.store.as_ref().and_then(|store| store.root_node.as_deref()).unwrap_or("nodes/root");
                NodeId::Document(path.trim_end_matches('/').rsplit('/').next().unwrap_or("root").to_owned())
            }
        };
        let per_page = layer.node_pages.as_ref().and_then(|pages| pages.nodes_per_page).unwrap_or(0);
        let nodes_per_page = if per_page == 0 { DEFAULT_NODES_PER_PAGE } else { per_page };
        Self { nodes_per_page, root, pages: HashMap::new() }
    }

    /// The roots to try: that of the pages, then that of the documents, which are there for older clients.
    pub(super) fn roots(&self) -> Vec<NodeId> {
        let document = NodeId::Document("root".to_owned());
        if self.root == document { vec![document] } else { vec![self.root.clone(), document] }
    }

    /// Reads a node. Fails with what is missing or malformed.
    pub(super) fn get(&mut self, resources: &Resources<'_, '_>, id: &NodeId) -> Result<Node, String> {
        match id {
            NodeId::Paged(index) => {
                let page = index / self.nodes_per_page;
                if !self.pages.contains_key(&page) {
                    if self.pages.len() >= MAX_PAGES {
                        self.pages.clear();
                    }
                    let json: PageJson = resources.json(&format!("nodepages/{page}"))?;
                    if json.nodes.len() > MAX_NODES_PER_PAGE as usize {
                        return Err(format!("nodepages/{page}: too many nodes"));
                    }
                    self.pages.insert(page, json.nodes.into_iter().map(Node::of_page).collect());
                }
                let nodes = self.pages.get(&page).map_or(&[][..], Vec::as_slice);
                let node = nodes.get((index % self.nodes_per_page) as usize);
                node.cloned().ok_or_else(|| format!("node {index} does not exist"))
            }
            NodeId::Document(id) => {
                let json: NodeJson = resources
                    .json(&format!("nodes/{id}/3dNodeIndexDocument"))
                    .or_else(|first| resources.json(&format!("nodes/{id}")).map_err(|_| first))?;
                Ok(Node::of_document(id, json))
            }
        }
    }
}

impl Node {
    fn of_page(json: PagedNodeJson) -> Self {
        let mesh = json.mesh.and_then(|mesh| {
            let geometry = mesh.geometry?;
            let folder = |resource: u32| format!("nodes/{resource}");
            let resource = geometry.resource?;
            let material = mesh.material.filter(|material| material.definition.is_some());
            Some(NodeResources {
                geometry: GeometrySource::Defined {
                    folder: folder(resource),
                    definition: geometry.definition.unwrap_or(0),
                },
                counts: [geometry.vertex_count, geometry.feature_count],
                attributes: mesh.attribute.and_then(|attribute| attribute.resource).map(folder),
                material: material.map_or(MaterialSource::None, |material| MaterialSource::Defined {
                    folder: folder(material.resource.unwrap_or(resource)),
                    definition: material.definition.unwrap_or(0),
                }),
            })
        });
        let mesh = mesh.filter(|mesh| mesh.counts[0] != Some(0));
        let children = json.children.unwrap_or_default().into_iter().map(NodeId::Paged).collect();
        Self {
            center: center_of(json.obb.as_ref(), None),
            radius_m: radius_of(json.obb.as_ref(), None),
            children,
            mesh,
        }
    }

    fn of_document(id: &str, json: NodeJson) -> Self {
        let folder = format!("nodes/{id}");
        let path = |reference: &HrefJson| uri::join(&folder, reference.href.as_deref()?.trim_end_matches('/')).ok();
        let first = |list: &Option<Vec<HrefJson>>| list.as_ref().and_then(|list| list.first()).and_then(path);
        let shared = json.shared_resource.as_ref().and_then(path);
        let has_textures = json.texture_data.as_ref().is_some_and(|list| !list.is_empty());
        let has_attributes = json.attribute_data.as_ref().is_some_and(|list| !list.is_empty());
        let mesh = first(&json.geometry_data).map(|path| NodeResources {
            geometry: GeometrySource::Schema { path },
            counts: [None, None],
            attributes: has_attributes.then(|| folder.clone()),
            material: shared.map_or(MaterialSource::None, |path| MaterialSource::Shared { path, has_textures }),
        });
        let children = json.children.unwrap_or_default().into_iter().filter_map(|child| match child.id {
            serde_json::Value::String(id) => Some(NodeId::Document(id)),
            serde_json::Value::Number(id) => Some(NodeId::Document(id.to_string())),
            _ => None,
        });
        Self {
            center: center_of(json.obb.as_ref(), json.mbs),
            radius_m: radius_of(json.obb.as_ref(), json.mbs),
            children: children.collect(),
            mesh,
        }
    }
}

/// The centre to which geometry is relative. Documents of version 1.6 have spheres only, later ones the same centre in both.
fn center_of(obb: Option<&ObbJson>, mbs: Option<[f64; 4]>) -> [f64; 3] {
    let sphere = mbs.map(|[x, y, z, _]| [x, y, z]);
    sphere.or(obb.map(|obb| obb.center)).unwrap_or([f64::NAN; 3])
}

fn radius_of(obb: Option<&ObbJson>, mbs: Option<[f64; 4]>) -> f64 {
    let half = obb.and_then(|obb| obb.half_size);
    let radius = half.map(|half| half.iter().map(|side| side * side).sum::<f64>().sqrt());
    radius.or(mbs.map(|mbs| mbs[3])).filter(|radius| radius.is_finite()).unwrap_or(f64::INFINITY)
}
