//! Files of drawings.

use crate::drawing::Drawing;
use crate::dxf::to_dxf;
use crate::error::DrawError;
use crate::pdf::to_pdf;
pub use crate::pdf::{PdfLetters, pdf_letters};
use crate::svg::to_svg;
use insula_archive::new_file::replace;
use serde::Deserialize;
use std::path::Path;

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
    replace(path, &bytes).map_err(|source| DrawError::Write { path: path.to_owned(), source })?;
    Ok(bytes.len() as u64)
}
