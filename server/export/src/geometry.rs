//! Triangles as glTF stores them: quantised positions, colours or texture coordinates, and feature ids, interleaved.

/// Bytes of the position of a vertex: three 16-bit integers, padded to the alignment that attributes must have, or three floats.
const POSITION_BYTES: [usize; 2] = [8, 12];
/// Bytes of texture coordinates: two 16-bit integers, or two floats.
const UV_BYTES: [usize; 2] = [4, 8];
/// Bytes of each other attribute of a vertex.
const ATTRIBUTE_BYTES: usize = 4;
/// Feature of vertices without an object.
pub(crate) const NO_FEATURE: u32 = u32::MAX;
/// What [`NO_FEATURE`] is stored as. Larger feature ids than the first make all of a mesh floats, because glTF has no vertices with
/// 32-bit integers. Floats are exact up to 2^24.
const NULL_FEATURES: [u32; 2] = [u16::MAX as u32, (1 << 24) - 1];

/// Triangles with their vertices. Lists other than `positions` and `indices` are empty if the vertices do not have the attribute.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Geometry {
    /// On a grid that the matrix of the node scales.
    pub(crate) positions: Vec<[u16; 3]>,
    /// Linear light, 0 to 255.
    pub(crate) colours: Vec<[u8; 3]>,
    /// From left to right and from top to bottom, 65535 being 1.
    pub(crate) uv: Vec<[u16; 2]>,
    /// Rows of the property table, or [`NO_FEATURE`].
    pub(crate) features: Vec<u32>,
    /// Three for each triangle, counter-clockwise.
    pub(crate) indices: Vec<u32>,
}

/// Where the attributes of a vertex are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layout {
    pub(super) stride: usize,
    pub(super) colour: Option<usize>,
    pub(super) uv: Option<usize>,
    pub(super) feature: Option<usize>,
    /// Feature ids are floats, otherwise 16-bit integers.
    pub(super) wide_features: bool,
}

impl Layout {
    /// What stands for no object.
    pub(super) fn null_feature(self) -> u32 {
        NULL_FEATURES[usize::from(self.wide_features)]
    }
}

impl Geometry {
    fn layout(&self, has_floats: bool) -> Layout {
        let mut stride = POSITION_BYTES[usize::from(has_floats)];
        let mut place = |is_present: bool, bytes: usize| {
            let at = stride;
            stride += if is_present { bytes } else { 0 };
            is_present.then_some(at)
        };
        let colour = place(!self.colours.is_empty(), ATTRIBUTE_BYTES);
        let uv = place(!self.uv.is_empty(), UV_BYTES[usize::from(has_floats)]);
        let feature = place(!self.features.is_empty(), ATTRIBUTE_BYTES);
        let wide_features = self.features.iter().any(|feature| *feature >= NULL_FEATURES[0] && *feature != NO_FEATURE);
        Layout { stride, colour, uv, feature, wide_features }
    }

    /// Leaves out feature ids if no vertex has an object.
    pub(crate) fn drop_empty_features(&mut self) {
        if self.features.iter().all(|feature| *feature == NO_FEATURE) {
            self.features.clear();
        }
    }

    /// The vertices one after the other. `has_floats`: positions and texture coordinates are floats, otherwise 16-bit integers.
    pub(super) fn interleaved(&self, has_floats: bool) -> (Vec<u8>, Layout) {
        let layout = self.layout(has_floats);
        let mut out = vec![0; layout.stride * self.positions.len()];
        for (i, vertex) in out.chunks_exact_mut(layout.stride).enumerate() {
            let mut put = |at: usize, bytes: &[u8]| vertex[at..at + bytes.len()].copy_from_slice(bytes);
            let position = self.positions[i];
            if has_floats {
                put(0, &position.map(|at| f32::from(at).to_le_bytes()).concat());
            } else {
                put(0, &position.map(u16::to_le_bytes).concat());
            }
            if let Some((at, [r, g, b])) = layout.colour.zip(self.colours.get(i).copied()) {
                put(at, &[r, g, b, u8::MAX]);
            }
            if let Some((at, uv)) = layout.uv.zip(self.uv.get(i)) {
                if has_floats {
                    put(at, &uv.map(|share| (f32::from(share) / f32::from(u16::MAX)).to_le_bytes()).concat());
                } else {
                    put(at, &uv.map(u16::to_le_bytes).concat());
                }
            }
            if let Some((at, feature)) = layout.feature.zip(self.features.get(i).copied()) {
                let feature = if feature == NO_FEATURE { layout.null_feature() } else { feature };
                let bytes = if layout.wide_features { (feature as f32).to_le_bytes() } else { feature.to_le_bytes() };
                put(at, &bytes);
            }
        }
        (out, layout)
    }

    /// Lowest and highest coordinates; zeros without vertices.
    pub(super) fn bounds(&self) -> [[u16; 3]; 2] {
        let Some(first) = self.positions.first() else { return [[0; 3]; 2] };
        self.positions.iter().fold([*first; 2], |[min, max], position| {
            [[0, 1, 2].map(|k| min[k].min(position[k])), [0, 1, 2].map(|k| max[k].max(position[k]))]
        })
    }
}

/// An 8-bit sRGB value as linear light, 0 to 255 (IEC 61966-2-1).
pub(crate) fn linear(srgb: u8) -> u8 {
    let value = f32::from(srgb) / 255.0;
    let linear = if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
    (linear * 255.0).round() as u8
}

/// Linear light, 0 to 255, as an 8-bit sRGB value.
pub(crate) fn srgb(linear: u8) -> u8 {
    let value = f32::from(linear) / 255.0;
    let srgb = if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 };
    (srgb * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_are_at_multiples_of_four_bytes() {
        let geometry = Geometry {
            positions: vec![[1, 2, 3], [4, 5, 600]],
            colours: vec![[7, 8, 9]; 2],
            features: vec![3, 70_000],
            ..Geometry::default()
        };
        let (bytes, layout) = geometry.interleaved(false);
        assert_eq!((layout.stride, layout.colour, layout.uv, layout.feature), (16, Some(8), None, Some(12)));
        assert_eq!(&bytes[..8], &[1, 0, 2, 0, 3, 0, 0, 0]);
        assert_eq!(&bytes[24..28], &[7, 8, 9, 255]);
        assert_eq!(f32::from_le_bytes(bytes[28..32].try_into().unwrap()), 70_000.0);
        assert_eq!(geometry.bounds(), [[1, 2, 3], [4, 5, 600]]);
    }

    #[test]
    fn floats_have_the_same_values() {
        let geometry = Geometry { positions: vec![[1, 2, 600]], uv: vec![[0, u16::MAX]], ..Geometry::default() };
        let (bytes, layout) = geometry.interleaved(true);
        assert_eq!((layout.stride, layout.uv), (20, Some(12)));
        let floats: Vec<f32> = bytes.chunks(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect();
        assert_eq!(floats, [1.0, 2.0, 600.0, 0.0, 1.0]);
    }

    #[test]
    fn colours_are_linear() {
        assert_eq!([0, 20, 128, 255].map(linear), [0, 2, 55, 255]);
        assert_eq!([0, 55, 255].map(srgb), [0, 128, 255]);
    }
}
