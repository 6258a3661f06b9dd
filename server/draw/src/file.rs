//! Files of drawings.

use crate::{drawing::Drawing, dxf::to_dxf, error::DrawError, pdf::to_pdf, svg::to_svg};
use serde::Deserialize;
use std::{
    fs::{self, File},
    io::{self, Write},
    path::Path,
};

/// A format of drawings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DrawingFormat {
    Svg,
    Pdf,
    Dxf,
}

impl DrawingFormat {
    /// The format of a file by the extension of its name. Fails if there is none of that extension.
    pub fn of(path: &Path) -> Result<Self, DrawError> {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        match extension.to_ascii_lowercase().as_str() {
            "svg" => Ok(Self::Svg),
            "pdf" => Ok(Self::Pdf),
            "dxf" => Ok(Self::Dxf),
            _ => Err(DrawError::Invalid(format!("{}: the file must end in .svg, .pdf or .dxf", path.display()))),
        }
    }
}

/// The drawing in a format.
#[must_use]
pub fn encode(drawing: &Drawing, format: DrawingFormat) -> Vec<u8> {
    match format {
        DrawingFormat::Svg => to_svg(drawing).into_bytes(),
        DrawingFormat::Pdf => to_pdf(drawing),
        DrawingFormat::Dxf => to_dxf(drawing).into_bytes(),
    }
}

/// Writes a file, which gets its name when it is complete. Returns its size in bytes. Fails if it cannot be written; an older file
/// is unchanged then.
pub fn write_drawing(drawing: &Drawing, format: DrawingFormat, path: &Path) -> Result<u64, DrawError> {
    let bytes = encode(drawing, format);
    let mut name = path.as_os_str().to_owned();
    name.push(".partial");
    let partial = Path::new(&name);
    let write = || -> io::Result<()> {
        let mut file = File::create(partial)?;
        file.write_all(&bytes)?;
        file.sync_all()?;
        fs::rename(partial, path)
    };
    write().map_err(|source| {
        // Nothing can be done about a file that cannot be removed; its name says what it is.
        let _ = fs::remove_file(partial);
        DrawError::Write { path: path.to_owned(), source }
    })?;
    Ok(bytes.len() as u64)
}
