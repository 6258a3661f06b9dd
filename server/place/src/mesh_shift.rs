//! Shifts of meshes that programs for photogrammetry write beside them: Pix4D in `NAME_offset.xyz`, with the coordinate system in
//! `NAME_wkt.prj` or `NAME.prj`, and OpenDroneMap in `coords.txt`.

use insula_source::packed::unpacked_name;
use insula_source::source::{CitySource, read_sibling};

/// Larger files are of something else.
const MAX_FILE_BYTES: u64 = 64 << 10;
const OFFSET_FILE: &str = "_offset.xyz";
const SYSTEM_FILES: [&str; 2] = ["_wkt.prj", ".prj"];
/// The meshes of OpenDroneMap to which its shift applies; others are in a system of their own.
const SHIFTED_MESH: &str = "odm_textured_model_geo.obj";
const SHIFT_FILES: [&str; 3] = ["coords.txt", "odm_georeferencing/coords.txt", "../odm_georeferencing/coords.txt"];

/// What has to be added to the coordinates of a mesh, and in which system they are then.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MeshShift {
    /// Name of the file that tells it.
    pub(crate) file: String,
    /// Name of a coordinate system; empty if it is not told.
    pub(crate) system: String,
    pub(crate) origin: [f64; 3],
}

impl MeshShift {
    /// Of the files beside a mesh; `None` without such files.
    pub(crate) fn of(source: &CitySource<'_>) -> Option<Self> {
        Self::of_pix4d(source).or_else(|| Self::of_open_drone_map(source))
    }

    fn of_pix4d(source: &CitySource<'_>) -> Option<Self> {
        let (stem, _) = unpacked_name(&source.name).rsplit_once('.')?;
        let file = format!("{stem}{OFFSET_FILE}");
        let numbers = numbers(&text_of(source, &file)?)?;
        let system = SYSTEM_FILES.iter().find_map(|end| text_of(source, &format!("{stem}{end}")));
        Some(Self { file, system: system.unwrap_or_default(), origin: numbers.try_into().ok()? })
    }

    /// Its heights are not shifted.
    fn of_open_drone_map(source: &CitySource<'_>) -> Option<Self> {
        let name = unpacked_name(&source.name);
        let (folder, name) = name.rsplit_once('/').unwrap_or(("", name));
        if !name.eq_ignore_ascii_case(SHIFTED_MESH) {
            return None;
        }
        let above = folder.rsplit_once('/').map_or("", |(above, _)| above);
        let place = |file: &str| match file.strip_prefix("../") {
            Some(file) if folder.is_empty() => file.to_owned(),
            Some(file) => within(above, file),
            None => within(folder, file),
        };
        SHIFT_FILES.iter().map(|file| place(file)).find_map(|file| {
            let text = text_of(source, &file)?;
            let (system, rest) = text.split_once('\n')?;
            let [east, north]: [f64; 2] = numbers(rest)?.try_into().ok()?;
            Some(Self { file, system: utm(system.trim())?, origin: [east, north, 0.0] })
        })
    }
}

fn within(folder: &str, file: &str) -> String {
    if folder.is_empty() { file.to_owned() } else { format!("{folder}/{file}") }
}

fn text_of(source: &CitySource<'_>, name: &str) -> Option<String> {
    let bytes = read_sibling(&*source.files, name, MAX_FILE_BYTES).ok()?;
    Some(String::from_utf8_lossy(&bytes).trim().to_owned())
}

/// All numbers of a text; `None` if it has anything else.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
    words.map(|word| word.parse().ok().filter(|number: &f64| number.is_finite())).collect()
}

/// The name of a system such as `WGS84 UTM 32N`.
fn utm(text: &str) -> Option<String> {
    let zone = text.strip_prefix("WGS84 UTM ")?;
    let (zone, first) = match zone.strip_suffix(['N', 'n']) {
        Some(zone) => (zone, 32_600),
        None => (zone.strip_suffix(['S', 's'])?, 32_700),
    };
    let zone: u32 = zone.trim().parse().ok().filter(|zone| (1..=60).contains(zone))?;
    Some(format!("EPSG:{}", first + zone))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::source::embedded;

    fn shift(files: &[(&str, &[u8])]) -> Option<(String, String, [f64; 3])> {
        let sources = embedded(files);
        let mesh = sources.iter().find(|source| source.name.contains(".obj")).unwrap();
        MeshShift::of(mesh).map(|MeshShift { file, system, origin }| (file, system, origin))
    }

    #[test]
    fn shifts_are_read_from_the_files_of_both_programs() {
        let pix4d: [(&str, &[u8]); 3] = [
            ("out/m.obj.gz", b""),
            ("out/m_offset.xyz", b"566000.0 5932000, 12.5\n"),
            ("out/m_wkt.prj", b"EPSG:25832"),
        ];
        let expected = ("out/m_offset.xyz".to_owned(), "EPSG:25832".to_owned(), [566_000.0, 5_932_000.0, 12.5]);
        assert_eq!(shift(&pix4d), Some(expected.clone()));
        assert_eq!(shift(&pix4d[..2]), Some((expected.0, String::new(), expected.2)));
        let coords = b"WGS84 UTM 21S\n576529 5188003\n";
        for (mesh, file) in [
            ("odm_textured_model_geo.obj", "coords.txt"),
            ("odm_textured_model_geo.obj", "odm_georeferencing/coords.txt"),
            ("odm_texturing/odm_textured_model_geo.obj", "odm_georeferencing/coords.txt"),
            ("a/odm_texturing/odm_textured_model_geo.obj", "a/odm_georeferencing/coords.txt"),
        ] {
            let found = shift(&[(mesh, b""), (file, coords)]);
            let expected = (file.to_owned(), "EPSG:32721".to_owned(), [576_529.0, 5_188_003.0, 0.0]);
            assert_eq!(found, Some(expected), "{mesh}");
        }
    }

    #[test]
    fn other_files_are_no_shifts() {
        let other: [(&str, &[u8]); 2] = [("odm_textured_model.obj", b""), ("coords.txt", b"WGS84 UTM 21S\n1 2\n")];
        assert_eq!(shift(&other), None);
        for text in ["", "1 2", "1 2 x", "1 2 3 4", "1 2 inf"] {
            assert_eq!(shift(&[("m.obj", b""), ("m_offset.xyz", text.as_bytes())]), None, "{text}");
        }
        for text in ["WGS84 UTM 61N\n1 2", "WGS84 UTM N\n1 2", "EPSG:4326\n1 2", "WGS84 UTM 21S\n1"] {
            assert_eq!(shift(&[("odm_textured_model_geo.obj", b""), ("coords.txt", text.as_bytes())]), None, "{text}");
        }
    }
}
