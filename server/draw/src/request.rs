//! What is drawn and how.

use crate::error::DrawError;
use crate::limits::DrawLimits;
use crate::sheet::Paper;
use crate::style::Stylesheet;
use crate::view::DrawView;
use insula_export::selection::ObjectSelection;
use insula_objects::ColorBy;

/// Terrain, and if the scale is given all levels of detail, may be wrong by this much on paper, in millimetres.
pub(crate) const LOD_ERROR_MM: f64 = 0.05;

/// What is drawn and how.
#[derive(Debug, Clone, Default)]
pub struct DrawRequest {
    pub view: DrawView,
    pub selection: ObjectSelection,
    pub paper: Paper,
    /// The scale is one to this; `None` for the largest round one at which the selection fits.
    pub scale: Option<f64>,
    /// Whether the drawing fills the paper, without margins and title block.
    pub is_bare: bool,
    /// Title of the sheet; that of the city if `None`.
    pub title: Option<String>,
    pub style: Stylesheet,
    /// Whether formats that draw in metres draw the sheet of paper instead, in millimetres.
    pub is_sheet: bool,
    /// Date and time of the light for the title block; empty if it is not known.
    pub date: String,
    /// What the title block says in place of the light; empty if that.
    pub note: String,
    /// Colours of objects by an attribute, in place of those by kind.
    pub color_by: Option<ColorBy>,
    pub limits: DrawLimits,
}

impl DrawRequest {
    /// How wrong the levels of detail may be, in metres. Fails if the scale is out of range.
    pub(crate) fn error_m(&self) -> Result<f64, DrawError> {
        match self.scale {
            Some(scale) if (1.0..=10_000_000.0).contains(&scale) => Ok(LOD_ERROR_MM * scale / 1000.0),
            Some(_) => Err(DrawError::Invalid("the scale must be from 1:1 to 1:10000000".to_owned())),
            None => Ok(0.0),
        }
    }
}
