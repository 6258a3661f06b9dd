//! Parses material libraries. Only the diffuse colour and its texture are used.

use std::collections::HashMap;

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

/// The part of a material that is used.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct MtlMaterial {
    /// `Kd`, each component from 0 to 1.
    pub(super) diffuse: Option<[f64; 3]>,
    /// File name of `map_Kd`, as written.
    pub(super) texture: Option<String>,
}

/// Adds the materials of a library. Of several materials with one name, the first is used.
pub(super) fn parse(text: &str, materials: &mut HashMap<String, MtlMaterial>) {
    let mut current: Option<(String, MtlMaterial)> = None;
    for line in text.lines() {
        let line = line.trim();
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        match (word, &mut current) {
            ("newmtl", _) => {
                insert_first(current.take(), materials);
                current = Some((rest.to_owned(), MtlMaterial::default()));
            }
            ("Kd", Some((_, material))) => material.diffuse = parse_colour(rest),
            ("map_Kd", Some((_, material))) => material.texture = parse_texture(rest),
            _ => {}
        }
    }
    insert_first(current, materials);
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

/// The file name after the options. It may contain blanks.
fn parse_texture(text: &str) -> Option<String> {
    let mut rest = text;
    while rest.starts_with('-') {
        let (option, after) = rest.split_once(char::is_whitespace)?;
        let arguments = MAP_OPTIONS.iter().find(|(name, _)| *name == option).map(|(_, count)| *count)?;
        rest = after.trim_start();
        for taken in 0..arguments {
            let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            // The options -o, -s and -t may have fewer than three numbers.
            if taken > 0 && word.parse::<f64>().is_err() {
                break;
            }
            rest = after.trim_start();
        }
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
        parse(text, &mut materials);
        assert_eq!(materials["a"].diffuse, Some([0.5, 0.25, 1.0]));
        assert_eq!(materials["a"].texture.as_deref(), Some("my wall.jpg"));
        assert_eq!(materials["b c"].diffuse, Some([0.5; 3]));
        assert_eq!(materials["d"], MtlMaterial { diffuse: None, texture: Some("wall.jpg".to_owned()) });
        assert_eq!(materials.len(), 3);
    }
}
