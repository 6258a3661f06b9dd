//! Materials: colour, base texture with its mapping, alpha, roughness.

use super::fault::Fault;
use super::images::Images;
use super::schema::{Material, MaterialExtensions, MetallicRoughness, Root, TextureInfo};
use insula_source::object::{SourceMaterial, SourceTexture, Wrap};

/// Emissive textures on surfaces darker than this are photographs: some exporters store unlit colours so.
const BLACK: f32 = 0.01;
/// Coverage of fully transmitting glass.
const GLASS_OPACITY: f32 = 0.25;

/// How a material's texture is mapped.
#[derive(Debug, Clone)]
pub(super) struct TextureUse {
    /// Number of the set of texture coordinates.
    pub(super) tex_coord: u32,
    /// KHR_texture_transform: rows of the matrix from coordinates to coordinates, v down.
    rows: [[f64; 3]; 2],
}

impl TextureUse {
    fn of(info: &TextureInfo) -> Self {
        let transform = info.extensions.transform.clone().unwrap_or_default();
        let ([u, v], [su, sv]) = (transform.offset.unwrap_or_default(), transform.scale.unwrap_or([1.0; 2]));
        let (sin, cos) = libm::sincos(transform.rotation);
        let rows = [[cos * su, sin * sv, u], [-sin * su, cos * sv, v]];
        Self { tex_coord: transform.tex_coord.unwrap_or(info.tex_coord), rows }
    }

    /// Texture coordinates with v up from those of the file; (0, 0) if they are not finite.
    pub(super) fn uv(&self, [u, v]: [f64; 2]) -> [f32; 2] {
        let [x, y] = self.rows.map(|row| row[0] * u + row[1] * v + row[2]);
        let uv = [x as f32, (1.0 - y) as f32];
        if uv.iter().all(|value| value.is_finite()) { uv } else { [0.0; 2] }
    }
}

/// 8-bit sRGB of a linear value; out of range is clamped, not a number is 0.
pub(super) fn linear_to_srgb(linear: f64) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let srgb = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 };
    (srgb * 255.0).round() as u8
}

/// What shows the colour of a material.
struct Base<'a> {
    /// Linear, with alpha.
    factor: Option<[f32; 4]>,
    texture: Option<&'a TextureInfo>,
}

fn base(material: &Material) -> Base<'_> {
    let extensions = material.extensions.as_deref();
    if let Some(old) = extensions.and_then(|e| e.specular_glossiness.as_ref())
        && (old.diffuse_texture.is_some() || old.diffuse_factor.is_some())
    {
        return Base { factor: old.diffuse_factor, texture: old.diffuse_texture.as_ref() };
    }
    let none = MetallicRoughness::default();
    let pbr = material.pbr_metallic_roughness.as_ref().unwrap_or(&none);
    let factor = pbr.base_color_factor;
    let is_black = factor.is_some_and(|factor| factor.iter().take(3).all(|value| *value < BLACK));
    match (&material.emissive_texture, material.pbr_metallic_roughness.as_ref()) {
        (Some(emissive), _) if is_black => {
            let [r, g, b] = material.emissive_factor.unwrap_or([1.0; 3]);
            Base { factor: Some([r, g, b, factor.map_or(1.0, |f| f[3])]), texture: Some(emissive) }
        }
        (_, Some(pbr)) => Base { factor, texture: pbr.base_color_texture.as_ref() },
        (_, None) => Base { factor: None, texture: None },
    }
}

/// How the texture of each material is mapped; `None` without a texture.
pub(super) fn texture_uses(root: &Root) -> Vec<Option<TextureUse>> {
    let of = |material: &Material| {
        base(material).texture.map(TextureUse::of).or_else(|| technique_texture(material).as_ref().map(TextureUse::of))
    };
    root.materials.iter().map(of).collect()
}

/// The material as the bake has it. Faults of its texture are added to `faults`.
pub(super) fn convert(root: &Root, index: usize, images: &mut Images<'_>, faults: &mut Vec<Fault>) -> SourceMaterial {
    let Some(material) = root.materials.get(index) else {
        faults.push(Fault::missing("material", index));
        return SourceMaterial::default();
    };
    let base = base(material);
    let old_texture = technique_texture(material);
    let info = base.texture.or(old_texture.as_ref());
    let texture = info.and_then(|info| match texture(root, info.index, images) {
        Ok(texture) => Some(texture),
        Err(fault) => {
            faults.push(fault);
            None
        }
    });
    let factor = base.factor.or_else(|| technique_colour(material));
    let alpha = factor.map_or(1.0, |factor| factor[3]).clamp(0.0, 1.0);
    let mut converted = SourceMaterial {
        rgb: factor.map(|[r, g, b, _]| [r, g, b].map(|value| linear_to_srgb(value.into()))),
        texture,
        ..SourceMaterial::default()
    };
    set_alpha(material, alpha, &mut converted);
    set_gloss(material, &mut converted);
    converted
}

/// MASK cuts holes. BLEND is coverage; where the texture is mostly clear, it is a hole.
fn set_alpha(material: &Material, alpha: f32, converted: &mut SourceMaterial) {
    match material.alpha_mode.as_deref() {
        Some("MASK") => {
            let cutoff = material.alpha_cutoff.unwrap_or(0.5);
            if converted.texture.is_some() && alpha > 0.0 {
                converted.alpha_cutoff = Some((cutoff / alpha).max(0.0)).filter(|cutoff| cutoff.is_finite());
            } else if alpha < cutoff {
                converted.opacity = 0.0;
            }
        }
        Some("BLEND") => {
            converted.opacity = alpha;
            converted.alpha_cutoff = converted.texture.is_some().then_some(0.5);
        }
        _ => {}
    }
    let transmission = material.extensions.as_deref().and_then(|e| e.transmission.as_ref());
    if let Some(transmission) = transmission {
        let clear = transmission.transmission_factor.clamp(0.0, 1.0);
        converted.opacity = converted.opacity.min(1.0 - clear * (1.0 - GLASS_OPACITY));
    }
}

/// Roughness and metallic as far as they are numbers in the file: textures of them are not read.
fn set_gloss(material: &Material, converted: &mut SourceMaterial) {
    let none = MaterialExtensions::default();
    let extensions = material.extensions.as_deref().unwrap_or(&none);
    if extensions.unlit.is_some() {
        (converted.roughness, converted.metallic) = (Some(1.0), Some(0.0));
    } else if let Some(old) = &extensions.specular_glossiness {
        converted.roughness = old.glossiness_factor.map(|gloss| (1.0 - gloss).clamp(0.0, 1.0));
    } else if let Some(pbr) = &material.pbr_metallic_roughness
        && pbr.metallic_roughness_texture.is_none()
    {
        converted.roughness = pbr.roughness_factor.map(|value| value.clamp(0.0, 1.0));
        converted.metallic = pbr.metallic_factor.map(|value| value.clamp(0.0, 1.0));
    }
}

/// Names of a shader's diffuse colour.
const DIFFUSE: [&str; 4] = ["diffuse", "u_diffuse", "tex", "u_tex"];

/// The diffuse texture of KHR_techniques_webgl.
fn technique_texture(material: &Material) -> Option<TextureInfo> {
    let values = &material.extensions.as_deref()?.techniques.as_ref()?.values;
    let value = DIFFUSE.iter().find_map(|name| values.get(*name))?;
    serde_json::from_value(value.clone()).ok().filter(|_| value.is_object())
}

/// The diffuse colour of KHR_techniques_webgl.
fn technique_colour(material: &Material) -> Option<[f32; 4]> {
    let values = &material.extensions.as_deref()?.techniques.as_ref()?.values;
    DIFFUSE.iter().find_map(|name| serde_json::from_value(values.get(*name)?.clone()).ok())
}

fn texture(root: &Root, index: usize, images: &mut Images<'_>) -> Result<SourceTexture, Fault> {
    let texture = root.textures.get(index).ok_or_else(|| Fault::missing("texture", index))?;
    let extensions = texture.extensions.as_deref();
    let webp = extensions.and_then(|e| e.webp.as_ref()).and_then(|webp| webp.source);
    let basisu = extensions.and_then(|e| e.basisu.as_ref()).and_then(|basisu| basisu.source);
    let source = texture.source.or(webp).or(basisu);
    let source = source.ok_or_else(|| Fault::new("texture without an image", format!("texture {index}")))?;
    let sampler = texture.sampler.and_then(|sampler| root.samplers.get(sampler));
    let wrap = |code: Option<u32>| match code {
        Some(33_071) => Wrap::Clamp,
        Some(33_648) => Wrap::Mirror,
        _ => Wrap::Repeat,
    };
    let (s, t) = sampler.map_or_else(Default::default, |sampler| (wrap(sampler.wrap_s), wrap(sampler.wrap_t)));
    // The bake has one mode for both directions: the one that needs the larger texture.
    let wrap = if s == t || t == Wrap::Clamp {
        s
    } else if s == Wrap::Clamp {
        t
    } else {
        Wrap::Repeat
    };
    Ok(SourceTexture { image: images.get(source)?, wrap })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_colours_become_srgb() {
        assert_eq!([0.0, 0.214_041, 0.5, 1.0, 7.0, f64::NAN].map(linear_to_srgb), [0, 127, 188, 255, 255, 0]);
    }

    #[test]
    fn texture_transforms_apply_scale_then_rotation_then_offset() {
        let json = r#"{"index": 0, "texCoord": 1, "extensions": {"KHR_texture_transform":
            {"offset": [0.5, 0.25], "rotation": 1.5707963267948966, "scale": [2, 3], "texCoord": 2}}}"#;
        let texture = TextureUse::of(&serde_json::from_str(json).expect("valid"));
        assert_eq!(texture.tex_coord, 2);
        // Scaled (2, 0), rotated (0, -2), moved (0.5, -1.75); v up: 2.75.
        let [u, v] = texture.uv([1.0, 0.0]);
        assert!((u - 0.5).abs() < 1e-6 && (v - 2.75).abs() < 1e-6, "{u} {v}");
        let [u, v] = texture.uv([0.0, 1.0]);
        assert!((u - 3.5).abs() < 1e-6 && (v - 0.75).abs() < 1e-6, "{u} {v}");
        assert_eq!(texture.uv([f64::INFINITY, 0.0]), [0.0; 2]);
    }
}
