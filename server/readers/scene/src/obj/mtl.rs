//! Parses material libraries. Only the diffuse colour, its texture and what tells glass are used.

use insula_source::text::{decoded, decoded_line, likely_encoding};
use std::collections::HashMap;
use std::ops::RangeInclusive;

/// Options of `map_Kd` and their number of arguments.
const MAP_OPTIONS: &[(&str, usize)] = &[
    ("-blendu", 1),
    ("-blendv", 1),
    ("-bm", 1),
    ("-boost", 1),
    ("-cc", 1),
    ("-clamp", 1),
    ("-imfchan", 1),
    ("-mm", 2),
    ("-o", 3),
    ("-s", 3),
    ("-t", 3),
    ("-texres", 1),
    ("-type", 1),
];

/// How texture coordinates become places in the image, and what is outside of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct UvMapping {
    /// `-s`, by which texture coordinates are multiplied, and `-o`, which is added then.
    pub(super) scale: [f32; 2],
    pub(super) offset: [f32; 2],
    /// `-clamp on`: the border of the image goes on outside of it, else the image repeats.
    pub(super) is_clamped: bool,
}

impl Default for UvMapping {
    fn default() -> Self {
        Self { scale: [1.0; 2], offset: [0.0; 2], is_clamped: false }
    }
}

impl UvMapping {
    pub(super) fn apply(&self, uv: [f32; 2]) -> [f32; 2] {
        std::array::from_fn(|axis| uv[axis] * self.scale[axis] + self.offset[axis])
    }

    /// Takes an option of a texture with its arguments.
    fn take(&mut self, option: &str, arguments: &[&str]) {
        let pair = |usual: f32| {
            let number = |word: &&str| word.parse::<f32>().ok().filter(|number| number.is_finite());
            std::array::from_fn(|axis| arguments.get(axis).and_then(number).unwrap_or(usual))
        };
        match option {
            "-s" => self.scale = pair(1.0),
            "-o" => self.offset = pair(0.0),
            "-clamp" => self.is_clamped = arguments.first().is_some_and(|word| word.eq_ignore_ascii_case("on")),
            _ => {}
        }
    }
}

/// The part of a material that is used.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct MtlMaterial {
    /// `Kd`, each component from 0 to 1.
    pub(super) diffuse: Option<[f64; 3]>,
    /// File name of `map_Kd`, as written.
    pub(super) texture: Option<String>,
    /// Of the texture.
    pub(super) mapping: UvMapping,
    /// File name of `map_d`, as written: often that of the texture, whose alpha is meant.
    pub(super) alpha: Option<String>,
    /// `d`, from 0 (invisible) to 1 (opaque), or else 1 less `Tr`.
    dissolve: Option<f64>,
    /// `Ni`.
    refraction: Option<f64>,
    /// `illum`, the number of an illumination model.
    model: Option<f64>,
}

/// The illumination models that the format describes as glass or with refraction.
const GLASS_MODELS: [f64; 4] = [4.0, 6.0, 7.0, 9.0];
/// Refractive indices of water (1.33), glass (1.5 to 1.9) and diamond (2.4). Metals and air are outside.
const GLASS_REFRACTION: RangeInclusive<f64> = 1.2..=2.5;

impl MtlMaterial {
    /// Whether it is water or glass: a little transparent all over, or drawn as glass with its refractive index.
    ///
    /// Leaves and fences are transparent by their texture, and some exporters write `d 0` for opaque materials.
    pub(super) fn is_glass(&self) -> bool {
        let is_transparent = self.texture.is_none() && self.dissolve.is_some_and(|d| d > 0.0 && d < 1.0);
        let is_drawn_as_glass = self.model.is_some_and(|model| GLASS_MODELS.contains(&model));
        is_transparent || is_drawn_as_glass && self.refraction.is_some_and(|n| GLASS_REFRACTION.contains(&n))
    }
}

/// Adds the materials of a library. Of several materials with one name, the first is used. Names of materials are decoded line by line, as
/// those of the model, to be equal.
pub(super) fn parse(library: &[u8], materials: &mut HashMap<String, MtlMaterial>) {
    let mut current: Option<(String, MtlMaterial)> = None;
    let encoding = likely_encoding(library).page;
    for bytes in library.split(|byte| *byte == b'\n') {
        let line = decoded_line(bytes);
        let (word, rest) = split_word(&line);
        match (word.to_ascii_lowercase().as_str(), &mut current) {
            ("newmtl", _) => {
                insert_first(current.take(), materials);
                current = Some((rest.to_owned(), MtlMaterial::default()));
            }
            ("kd", Some((_, material))) => material.diffuse = parse_colour(rest),
            ("map_kd", Some((_, material))) => {
                material.mapping = UvMapping::default();
                material.texture = parse_texture(split_word(&decoded(bytes, encoding)).1, &mut material.mapping);
            }
            ("map_d", Some((_, material))) => {
                let own = &mut UvMapping::default();
                material.alpha = parse_texture(split_word(&decoded(bytes, encoding)).1, own);
            }
            ("d", Some((_, material))) => {
                material.dissolve = rest.strip_prefix("-halo").unwrap_or(rest).trim().parse().ok();
            }
            // Some programs write `Tr 1` for what is opaque, which is neither transparent nor glass this way, too.
            ("tr", Some((_, material))) => {
                let transparency = rest.parse::<f64>().ok();
                material.dissolve = material.dissolve.or(transparency.map(|transparency| 1.0 - transparency));
            }
            ("ni", Some((_, material))) => material.refraction = rest.parse().ok(),
            ("illum", Some((_, material))) => material.model = rest.parse().ok(),
            _ => {}
        }
    }
    insert_first(current, materials);
}

/// The first word of a line, and what follows it.
fn split_word(line: &str) -> (&str, &str) {
    let line = line.trim();
    line.split_once(char::is_whitespace).map_or((line, ""), |(word, rest)| (word, rest.trim()))
}

fn insert_first(material: Option<(String, MtlMaterial)>, materials: &mut HashMap<String, MtlMaterial>) {
    if let Some((name, material)) = material {
        materials.entry(name).or_insert(material);
    }
}

/// Parses three components, or one for all.
fn parse_colour(text: &str) -> Option<[f64; 3]> {
    let mut numbers = text.split_ascii_whitespace().map(|word| word.parse::<f64>().ok().filter(|c| c.is_finite()));
    let red = numbers.next()??;
    match (numbers.next(), numbers.next()) {
        (Some(green), Some(blue)) => Some([red, green?, blue?]),
        _ => Some([red; 3]),
    }
}

/// The file name after the options. It may contain blanks, but not after an option that is not known.
fn parse_texture(text: &str, mapping: &mut UvMapping) -> Option<String> {
    let mut rest = text;
    while rest.starts_with('-') {
        let Some((option, after)) = rest.split_once(char::is_whitespace) else { break };
        let Some((_, arguments)) = MAP_OPTIONS.iter().find(|(name, _)| *name == option).copied() else {
            return rest.split_ascii_whitespace().next_back().map(str::to_owned);
        };
        rest = after.trim_start();
        let mut words = Vec::new();
        for taken in 0..arguments {
            let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            // The options -o, -s and -t may have fewer than three numbers.
            if taken > 0 && word.parse::<f64>().is_err() {
                break;
            }
            words.push(word);
            rest = after.trim_start();
        }
        mapping.take(option, &words);
    }
    (!rest.is_empty()).then(|| rest.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_textures_and_options_are_parsed() {
        let text = "Kd 9 9 9\nnewmtl a\n  Kd 0.5 0.25 1\nmap_Kd -s 1 1 1 -clamp on my wall.jpg\n\
                    newmtl b c\nKd .5\nnewmtl a\nKd 0 0 0\nnewmtl d\nKd x\nmap_Kd -s 2 wall.jpg\nmap_Ka no.jpg";
        let mut materials = HashMap::new();
        parse(text.as_bytes(), &mut materials);
        assert_eq!(materials["a"].diffuse, Some([0.5, 0.25, 1.0]));
        assert_eq!(materials["a"].texture.as_deref(), Some("my wall.jpg"));
        assert_eq!(materials["b c"].diffuse, Some([0.5; 3]));
        let mapping = UvMapping { scale: [2.0, 1.0], ..UvMapping::default() };
        let textured = MtlMaterial { texture: Some("wall.jpg".to_owned()), mapping, ..MtlMaterial::default() };
        assert_eq!(materials["d"], textured);
        assert!(materials["a"].mapping.is_clamped);
        assert_eq!(materials.len(), 3);
        for (line, name) in [
            ("map_Kd -colorspace sRGB wall.jpg", Some("wall.jpg")),
            ("map_Kd -wall.jpg", Some("-wall.jpg")),
            ("map_Kd -clamp on", None),
        ] {
            parse(format!("newmtl {line}\n{line}").as_bytes(), &mut materials);
            assert_eq!(materials[line].texture.as_deref(), name, "{line}");
        }
        parse(b"newmtl f\nmap_Kd -o 0.5 0.25 0 -s 2 4 1 f.png", &mut materials);
        assert_eq!(materials["f"].mapping.apply([1.0, 1.0]), [2.5, 4.25]);
        parse(b"newmtl g\nmap_Kd tree.png\nmap_d -imfchan m tree.png", &mut materials);
        assert_eq!(materials["g"].alpha, materials["g"].texture);
        parse(b"NEWMTL e\nkd 1 0 0\nmap_kd e.png", &mut materials);
        assert_eq!((materials["e"].diffuse, materials["e"].texture.as_deref()), (Some([1.0, 0.0, 0.0]), Some("e.png")));
    }

    #[test]
    fn names_in_other_encodings_stay_apart() {
        // 壁, 床 and 建物 in Shift-JIS.
        let library = b"newmtl \x95\xc7\nKd 1 0 0\nnewmtl \x8f\xb0\nKd 0 1 0\nmap_Kd \x8c\x9a\x95\xa8/\x95\xc7.png";
        let mut materials = HashMap::new();
        parse(library, &mut materials);
        assert_eq!(
            (materials.len(), materials[&*decoded_line(b"\x8f\xb0")].texture.as_deref()),
            (2, Some("建物/壁.png"))
        );
    }

    #[test]
    fn glass_is_known_by_transparency_or_refraction() {
        let is_glass = |lines: &str| {
            let mut materials = HashMap::new();
            parse(format!("newmtl a\n{lines}").as_bytes(), &mut materials);
            materials["a"].is_glass()
        };
        for lines in [
            "d 0.4", "Tr 0.6", "d -halo 0.4", "Tr 1\nd 0.4", "d 1\nillum 9\nNi 1.33",
            "illum 4\nNi 1.5\nmap_Kd pane.png",
        ] {
            assert!(is_glass(lines), "{lines}");
        }
        for lines in [
            "", "d 1", "d 0", "d x", "d nan", "Tr 0", "Tr 1", "d 1\nTr 0.5", "d 0.4\nmap_Kd leaves.png",
            "illum 2\nNi 1.45", "illum 7\nNi 1.0",
        ] {
            assert!(!is_glass(lines), "{lines}");
        }
    }
}
