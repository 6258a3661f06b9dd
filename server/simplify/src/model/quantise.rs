//! Converts models to meshes with quantised values, and back.

use super::triangle_model::{CornerLayer, NO_VALUE, TriangleModel};
use insula_protocol::mesh::{Attribute, AttributeKind, Mesh, PositionGrid};
use insula_protocol::octahedral;

/// Bits of a colour component, and of each half of a normal.
const BYTE: u8 = 8;

/// Quantises a model with `bits` (8 to 16) for each coordinate, and `texcoord_bits` (8 to 16) for each texture
/// coordinate.
pub fn to_mesh(model: &TriangleModel, bits: u8, texcoord_bits: u8) -> Mesh {
    let grid = PositionGrid::enclosing(&model.positions, bits);
    let attributes = model.layers.iter().map(|layer| attribute(layer, texcoord_bits)).collect();
    Mesh {
        grid,
        positions: model.positions.iter().map(|position| grid.nearest(*position)).collect(),
        triangles: model.triangles.clone(),
        attributes,
    }
}

fn attribute(layer: &CornerLayer, texcoord_bits: u8) -> Attribute {
    let counting = || layer.values.iter().flat_map(|value| &value[..layer.width]);
    let (bits, components, range) = match layer.kind {
        AttributeKind::Normal => (BYTE, 2, [0.0, 1.0]),
        AttributeKind::Colour => (BYTE, layer.width as u8, [0.0, 1.0 / 255.0]),
        AttributeKind::TexCoord | AttributeKind::Other => {
            let min = counting().copied().fold(f32::INFINITY, f32::min);
            let max = counting().copied().fold(f32::NEG_INFINITY, f32::max);
            let step = (max - min) / ((1u32 << texcoord_bits) - 1) as f32;
            let usable = step > 0.0 && step.is_finite();
            (
                texcoord_bits,
                layer.width as u8,
                if usable { [min, step] } else { [if min.is_finite() { min } else { 0.0 }, 1.0] },
            )
        }
    };
    let most = ((1u32 << bits) - 1) as f32;
    let value = |value: &[f32; 4]| {
        if layer.kind == AttributeKind::Normal {
            let code = octahedral::encode([value[0], value[1], value[2]]);
            return [u32::from(code & 0xff), u32::from(code >> 8), 0, 0];
        }
        std::array::from_fn(|k| {
            if k < layer.width { ((value[k] - range[0]) / range[1] + 0.5).floor().clamp(0.0, most) as u32 } else { 0 }
        })
    };
    let values = layer.values.iter().map(value).collect();
    let attribute = Attribute { kind: layer.kind, components, bits, range, values, corners: layer.corners.clone() };
    if layer.missing() > 0 { with_flag(attribute) } else { attribute }
}

/// The component that tells whether a corner has no value, for kinds that may have one: 0 or 1.
fn flag_of(kind: AttributeKind) -> Option<usize> {
    matches!(kind, AttributeKind::Normal | AttributeKind::TexCoord).then_some(2)
}

/// Adds the component that marks corners without a value. A kind that has none gets zeros.
fn with_flag(mut attribute: Attribute) -> Attribute {
    let mut none = [0; 4];
    if let Some(flag) = flag_of(attribute.kind) {
        none[flag] = 1;
        attribute.components = flag as u8 + 1;
    }
    let number = attribute.values.len() as u32;
    attribute.values.push(none);
    attribute.corners.iter_mut().filter(|value| **value == NO_VALUE).for_each(|value| *value = number);
    attribute
}

/// The model of a mesh.
pub fn to_model(mesh: &Mesh) -> TriangleModel {
    let layers = mesh.attributes.iter().map(|attribute| {
        let value = |value: &[u32; 4]| {
            if attribute.kind == AttributeKind::Normal {
                let [x, y, z] = octahedral::decode((value[0] | value[1] << 8) as u16);
                return [x, y, z, 0.0];
            }
            std::array::from_fn(|k| {
                let [min, step] = attribute.range;
                if k < usize::from(attribute.components) && flag_of(attribute.kind).is_none_or(|flag| k < flag) {
                    min + value[k] as f32 * step
                } else {
                    0.0
                }
            })
        };
        let flag = flag_of(attribute.kind).filter(|flag| *flag < usize::from(attribute.components));
        let width = match attribute.kind {
            AttributeKind::Normal => 3,
            _ => flag.unwrap_or(usize::from(attribute.components)),
        };
        let has_value = |number: &u32| flag.is_none_or(|flag| attribute.values[*number as usize][flag] == 0);
        let corners = attribute.corners.iter().map(|number| if has_value(number) { *number } else { NO_VALUE });
        let (corners, values) = (corners.collect(), attribute.values.iter().map(value).collect());
        CornerLayer { kind: attribute.kind, width, values, corners }
    });
    TriangleModel {
        positions: mesh.positions_m().collect(),
        triangles: mesh.triangles.clone(),
        layers: layers.collect(),
    }
}
