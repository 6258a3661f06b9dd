//! The tree of nodes: primitives with the transforms of their nodes.

use super::fault::Fault;
use super::primitive::{self, LocalPrimitive, PrimitiveContext};
use super::schema::{Instancing, Node, Root, Skin};
use super::{
    Attributes, FeatureIdValues, FeatureIds, GltfPrimitive, GltfScene, MeshNode, accessor, extras, features, triangles,
};
use glam::{DMat4, DQuat, DVec3};
use insula_source::problems::PART_NOT_READ;
use std::collections::HashMap;
use std::rc::Rc;

/// An instance whose place has no content makes a mesh of nothing. It counts as so many elements without content.
const ZEROS_OF_INSTANCE: u64 = 64;

/// A node with its place in the tree.
struct PlacedNode {
    index: usize,
    to_scene: DMat4,
    /// Index of the topmost ancestor with a mesh, or of the node itself.
    owner: Option<usize>,
    /// Whether neither the node nor one above is hidden.
    is_visible: bool,
}

/// Fills a scene with the primitives of a document.
pub(super) struct SceneBuilder<'a> {
    context: PrimitiveContext<'a>,
    scene: &'a mut GltfScene,
    /// Meshes that several nodes use.
    shared: HashMap<usize, Rc<Vec<LocalPrimitive>>>,
    uses: Vec<u32>,
    points_and_lines: usize,
}

impl<'a> SceneBuilder<'a> {
    pub(super) fn new(context: PrimitiveContext<'a>, scene: &'a mut GltfScene) -> Self {
        let mut uses = vec![0u32; context.root.meshes.len()];
        for mesh in context.root.nodes.iter().filter_map(|node| node.mesh) {
            if let Some(count) = uses.get_mut(mesh) {
                *count += 1;
            }
        }
        Self { context, scene, shared: HashMap::new(), uses, points_and_lines: 0 }
    }

    /// Adds all primitives.
    pub(super) fn build(mut self) {
        let placed = self.placed_nodes();
        let mut to_scene = vec![DMat4::IDENTITY; self.context.root.nodes.len()];
        for node in &placed {
            if let Some(place) = to_scene.get_mut(node.index) {
                *place = node.to_scene;
            }
        }
        for node in &placed {
            if node.is_visible && self.context.buffers.budget().exceeded().is_none() {
                self.add_node(node, &to_scene);
            }
        }
        if self.points_and_lines > 0 {
            let detail = format!("{} primitives", self.points_and_lines);
            self.scene.problems.push(("points and lines are not read", detail));
        }
    }

    /// The nodes of the scene, parents first. A node is placed once, however often it is named.
    fn placed_nodes(&mut self) -> Vec<PlacedNode> {
        let root = self.context.root;
        let mut is_named = vec![false; root.nodes.len()];
        let (mut repeated, mut missing) = (0u64, 0u64);
        let mut is_first = |index: &usize| match is_named.get_mut(*index) {
            Some(is_named) => {
                let is_first = !std::mem::replace(is_named, true);
                repeated += u64::from(!is_first);
                is_first
            }
            None => {
                missing += 1;
                false
            }
        };
        let mut placed = Vec::new();
        let mut open: Vec<PlacedNode> = Vec::new();
        let mut tops = scene_nodes(root);
        tops.retain(&mut is_first);
        let place = |index| PlacedNode { index, to_scene: DMat4::IDENTITY, owner: None, is_visible: true };
        open.extend(tops.into_iter().rev().map(place));
        while let Some(PlacedNode { index, to_scene, owner, is_visible }) = open.pop() {
            let Some(node) = root.nodes.get(index) else { continue };
            let to_scene = to_scene * local_transform(node);
            let owner = owner.or(node.mesh.map(|_| index));
            let visibility = node.extensions.as_deref().and_then(|e| e.visibility.as_ref());
            let is_visible = is_visible && visibility.and_then(|v| v.visible).unwrap_or(true);
            let first = open.len();
            let children = node.children.iter().copied().filter(&mut is_first);
            open.extend(children.map(|child| PlacedNode { index: child, to_scene, owner, is_visible }));
            open.get_mut(first..).unwrap_or(&mut []).reverse();
            placed.push(PlacedNode { index, to_scene, owner, is_visible });
        }
        for (count, kind) in [(repeated, "node with several parents"), (missing, "missing part of a glTF")] {
            if count > 0 {
                self.scene.problems.push((kind, format!("tree of nodes: {count} times")));
            }
        }
        let outside = root.nodes.iter().zip(&is_named).filter(|(node, is_named)| node.mesh.is_some() && !**is_named);
        let outside = outside.count();
        if outside > 0 {
            let detail = format!("nodes with meshes outside of the scene that the file shows: {outside}");
            self.scene.problems.push((PART_NOT_READ, detail));
        }
        placed
    }

    fn add_node(&mut self, placed: &PlacedNode, to_scene: &[DMat4]) {
        let Some((node, mesh_index)) = self.context.root.nodes.get(placed.index).and_then(|n| Some((n, n.mesh?)))
        else {
            return;
        };
        let first_primitive = self.scene.primitives.len();
        let mut lost = None;
        match self.mesh(mesh_index) {
            Ok(primitives) => {
                if let Err(fault) = self.add_primitives(placed, node, mesh_index, &primitives, to_scene) {
                    lost = Some(fault.at(&format!("node {}", placed.index)));
                }
            }
            Err(fault) => lost = Some(fault.at(&format!("node {}", placed.index))),
        }
        if lost.is_none() && self.scene.primitives.len() == first_primitive {
            lost = Some(("mesh has no triangles", format!("mesh {mesh_index}")));
        }
        let mesh = self.context.root.meshes.get(mesh_index);
        self.scene.mesh_nodes.push(MeshNode {
            node: placed.index,
            owner: placed.owner.unwrap_or(placed.index),
            name: node.name.as_deref().or(mesh.and_then(|mesh| mesh.name.as_deref())).map(str::to_owned),
            lost,
        });
    }

    /// The primitives of a mesh; those that cannot be read are left out and reported.
    fn mesh(&mut self, index: usize) -> Result<Rc<Vec<LocalPrimitive>>, Fault> {
        if let Some(known) = self.shared.get(&index) {
            return Ok(Rc::clone(known));
        }
        let mesh = self.context.root.meshes.get(index).ok_or_else(|| Fault::missing("mesh", index))?;
        let mut primitives = Vec::new();
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            if !triangles::is_triangles(primitive.mode.unwrap_or(4)) {
                self.points_and_lines += 1;
                continue;
            }
            let place = format!("mesh {index}, primitive {number}");
            match primitive::decode(self.context, primitive) {
                Ok(mut local) => {
                    let faults = std::mem::take(&mut local.faults);
                    self.scene.problems.extend(faults.into_iter().map(|fault| fault.at(&place)));
                    if !local.triangles.is_empty() {
                        primitives.push(local);
                    }
                }
                Err(fault) => self.scene.problems.push(fault.at(&place)),
            }
        }
        let primitives = Rc::new(primitives);
        if self.uses.get(index).is_some_and(|uses| *uses > 1) {
            self.shared.insert(index, Rc::clone(&primitives));
        }
        Ok(primitives)
    }

    fn add_primitives(
        &mut self,
        placed: &PlacedNode,
        node: &Node,
        mesh: usize,
        primitives: &[LocalPrimitive],
        to_scene: &[DMat4],
    ) -> Result<(), Fault> {
        let instances = self.instances(node)?;
        let skin = node.skin.and_then(|skin| self.context.root.skins.get(skin));
        let joints = skin.map(|skin| self.joint_matrices(skin, to_scene)).transpose()?;
        let count = primitives.iter().map(|local| local.positions.len() as u64).sum::<u64>();
        let bytes = primitives.iter().map(LocalPrimitive::bytes).sum::<u64>();
        let budget = self.context.buffers.budget();
        budget.take_vertices(count.saturating_mul(instances.len() as u64))?;
        budget.take_bytes(bytes.saturating_mul(instances.len() as u64))?;
        for local in primitives {
            let attributes = self.node_attributes(node, mesh, local);
            for instance in &instances {
                let mut primitive = GltfPrimitive {
                    node: placed.index,
                    instance: instance.number,
                    attributes: Rc::clone(&attributes),
                    uv: local.uv.clone(),
                    colours: local.colours.clone(),
                    triangles: local.triangles.clone(),
                    material: local.material,
                    feature_ids: local.feature_ids.clone(),
                    ..GltfPrimitive::default()
                };
                primitive.feature_ids.extend(instance.feature_ids.iter().cloned());
                let matrix = placed.to_scene * instance.to_node;
                match &joints {
                    Some(joints) if !local.joints.is_empty() => skin_positions(local, joints, &mut primitive),
                    _ => transform_positions(local, matrix, &mut primitive),
                }
                self.push(primitive);
            }
        }
        Ok(())
    }

    fn push(&mut self, mut primitive: GltfPrimitive) {
        if primitive.positions.iter().flatten().any(|value| !value.is_finite()) {
            let place = format!("node {}", primitive.node);
            self.scene.problems.push(("transform of a node is not finite", place));
            primitive = GltfPrimitive::default();
        }
        if !primitive.triangles.is_empty() {
            self.scene.primitives.push(primitive);
        }
    }

    fn node_attributes(&self, node: &Node, mesh: usize, local: &LocalPrimitive) -> Rc<Attributes> {
        let mesh_extras = self.context.root.meshes.get(mesh).and_then(|mesh| mesh.extras.as_ref());
        if node.extras.is_none() && mesh_extras.is_none() {
            return Rc::clone(&local.attributes);
        }
        let mut attributes = extras::attributes(&node.extras);
        if let Some(mesh) = self.context.root.meshes.get(mesh) {
            extras::push(&mesh.extras, &mut attributes);
        }
        local.attributes.iter().for_each(|(name, value)| attributes.push(name, value.clone()));
        Rc::new(attributes)
    }

    /// The instances of a node; one without a number if it has no instances.
    fn instances(&self, node: &Node) -> Result<Vec<Instance>, Fault> {
        let extensions = node.extensions.as_deref();
        let Some(instancing) = extensions.and_then(|e| e.instancing.as_ref()) else {
            return Ok(vec![Instance { number: None, to_node: DMat4::IDENTITY, feature_ids: Vec::new() }]);
        };
        let mut instances = self.instance_transforms(instancing)?;
        let sets = extensions.and_then(|e| e.features.as_ref());
        for set in sets.iter().flat_map(|sets| &sets.feature_ids) {
            let name = set.attribute.map(|number| format!("_FEATURE_ID_{number}"));
            let accessor = name.as_ref().and_then(|name| instancing.attributes.get(name)).copied();
            if name.is_some() && accessor.is_none() {
                continue;
            }
            let column =
                accessor.map(|index| accessor::column(self.context.root, self.context.buffers, index)).transpose()?;
            for (instance, number) in instances.iter_mut().zip(0u32..) {
                let id = column.as_ref().map_or(number, |column| column.whole(number as usize));
                let ids = features::with_values(set, FeatureIdValues::All(id), self.context.tables)?;
                instance.feature_ids.push(ids);
            }
        }
        Ok(instances)
    }

    fn instance_transforms(&self, instancing: &Instancing) -> Result<Vec<Instance>, Fault> {
        let (root, buffers) = (self.context.root, self.context.buffers);
        let column = |name: &str| {
            instancing.attributes.get(name).map(|index| accessor::column(root, buffers, *index)).transpose()
        };
        let (moves, turns, scales) = (column("TRANSLATION")?, column("ROTATION")?, column("SCALE")?);
        let count_of = |index: &usize| root.accessors.get(*index).map_or(0, |accessor| accessor.count);
        let count = instancing.attributes.values().map(count_of).min().unwrap_or(0);
        let has_content = |name: &str| {
            let accessor = instancing.attributes.get(name).and_then(|index| root.accessors.get(*index));
            accessor.is_some_and(|accessor| accessor.buffer_view.is_some())
        };
        if !["TRANSLATION", "ROTATION", "SCALE"].into_iter().any(has_content) {
            buffers.budget().take_zeros(count.saturating_mul(ZEROS_OF_INSTANCE))?;
        }
        buffers.budget().take_bytes(count.saturating_mul(size_of::<Instance>() as u64))?;
        let count = u32::try_from(count).map_err(|_| Fault::new("too many instances", count.to_string()))?;
        let instance = |number: u32| {
            let index = number as usize;
            let scale = scales.as_ref().map_or(DVec3::ONE, |column| column.get(index).into());
            let turn = turns.as_ref().map_or(DQuat::IDENTITY, |column| rotation(column.get(index)));
            let shift = moves.as_ref().map_or(DVec3::ZERO, |column| column.get(index).into());
            let to_node = DMat4::from_scale_rotation_translation(scale, turn, shift);
            Instance { number: Some(number), to_node, feature_ids: Vec::new() }
        };
        Ok((0..count).map(instance).collect())
    }

    /// Matrices from the bind pose to the scene.
    fn joint_matrices(&self, skin: &Skin, to_scene: &[DMat4]) -> Result<Vec<DMat4>, Fault> {
        let (root, buffers) = (self.context.root, self.context.buffers);
        let inverse = skin.inverse_bind_matrices.map(|index| accessor::column(root, buffers, index)).transpose()?;
        let matrix = |(number, joint): (usize, &usize)| {
            let to_scene = to_scene.get(*joint).copied().unwrap_or(DMat4::IDENTITY);
            let bind = inverse.as_ref().filter(|column| number < column.count && column.width == 16);
            to_scene * bind.map_or(DMat4::IDENTITY, |column| DMat4::from_cols_array(&column.get(number)))
        };
        Ok(skin.joints.iter().enumerate().map(matrix).collect())
    }
}

/// An instance of the mesh of a node.
struct Instance {
    number: Option<u32>,
    to_node: DMat4,
    feature_ids: Vec<FeatureIds>,
}

/// Nodes at the top of the scene; without scenes, those that are nobody's children.
fn scene_nodes(root: &Root) -> Vec<usize> {
    if let Some(scene) = root.scenes.get(root.scene.unwrap_or(0)).or(root.scenes.first()) {
        return scene.nodes.clone();
    }
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|node| &node.children) {
        if let Some(is_child) = is_child.get_mut(*child) {
            *is_child = true;
        }
    }
    (0..root.nodes.len()).filter(|index| is_child.get(*index) == Some(&false)).collect()
}

fn local_transform(node: &Node) -> DMat4 {
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(matrix);
    }
    let scale = node.scale.as_deref().map_or(DVec3::ONE, |scale| DVec3::from_array(*scale));
    let turn = node.rotation.as_deref().map_or(DQuat::IDENTITY, |turn| rotation(*turn));
    let shift = node.translation.as_deref().map_or(DVec3::ZERO, |shift| DVec3::from_array(*shift));
    DMat4::from_scale_rotation_translation(scale, turn, shift)
}

/// The rotation of a quaternion of any length; none if it has no length.
fn rotation(xyzw: [f64; 4]) -> DQuat {
    let quaternion = DQuat::from_array(xyzw);
    let length = quaternion.length();
    if length.is_finite() && length > 1e-12 { quaternion / length } else { DQuat::IDENTITY }
}

fn transform_positions(local: &LocalPrimitive, matrix: DMat4, primitive: &mut GltfPrimitive) {
    let position = |p: &[f64; 3]| matrix.transform_point3(DVec3::from_array(*p)).to_array();
    primitive.positions = if matrix == DMat4::IDENTITY {
        local.positions.clone()
    } else {
        local.positions.iter().map(position).collect()
    };
    if matrix.determinant() < 0.0 {
        primitive.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
}

/// The rest pose of a skin: the transform of the node does not count.
fn skin_positions(local: &LocalPrimitive, joints: &[DMat4], primitive: &mut GltfPrimitive) {
    let vertices = local.positions.iter().zip(&local.joints).zip(&local.weights);
    let positions = vertices.map(|((position, vertex_joints), weights)| {
        let position = DVec3::from_array(*position);
        let sum = f64::from(weights.iter().sum::<f32>());
        let moved = vertex_joints.iter().zip(weights).map(|(joint, weight)| {
            let matrix = joints.get(usize::from(*joint)).copied().unwrap_or(DMat4::IDENTITY);
            matrix.transform_point3(position) * f64::from(*weight)
        });
        let moved = moved.sum::<DVec3>();
        if sum > 0.0 { (moved / sum).to_array() } else { position.to_array() }
    });
    primitive.positions = positions.collect();
}
