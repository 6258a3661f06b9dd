//! Draws a baked city as vector shapes with hidden lines and surfaces removed.
//!
//! | module | contents |
//! |---|---|
//! | `error` | why a drawing failed; progress |
//! | `limits`, `options` | how much a drawing may be; what is drawn, as JSON |
//! | `style`, `sheet`, `legend` | the stylesheet; paper, title block, scale bar and north arrow; what colours mean |
//! | `face`, `scene` | convex faces in space; the surfaces of a part of a city |
//! | `view` | from the scene to the page |
//! | `terrain` | terrain with no more triangles than the view needs |
//! | `bsp` | faces in the order of their distance |
//! | `convex`, `warnock` | polygons on the page; their visible parts |
//! | `join`, `lines` | visible parts as shapes and lines |
//! | `overlap` | whether visible parts overlap |
//! | `paint_order` | translucent surfaces from the farthest to the nearest |
//! | `tone`, `paint`, `hatch`, `shadow` | colours of shapes, of objects by an attribute; hatching, shadows of the sun |
//! | `drawing` | the finished drawing |
//! | `picture` | values as colours over the surfaces of a plan |
//! | `pipeline` | all steps of a drawing |
//! | `svg`, `pdf`, `dxf`, `file` | files |

mod bsp;
mod convex;
pub mod drawing;
mod dxf;
pub mod error;
mod face;
pub mod file;
mod hatch;
mod join;
mod legend;
pub mod limits;
pub mod lines;
pub mod options;
mod overlap;
mod paint;
mod paint_order;
mod pdf;
pub mod picture;
pub mod pipeline;
mod scene;
mod shadow;
pub mod sheet;
pub mod style;
pub mod svg;
mod terrain;
mod tone;
pub mod view;
mod warnock;

pub use error::DrawError;
pub use limits::DrawLimits;
pub use pipeline::{DrawRequest, draw};
