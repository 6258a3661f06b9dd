//! Draws a baked city as vector shapes with hidden lines and surfaces removed.
//!
//! | module | contents |
//! |---|---|
//! | `error` | why a drawing failed; progress |
//! | `limits`, `request`, `options` | how much a drawing may be; what is drawn, also as JSON |
//! | `style`, `sheet`, `legend` | the stylesheet; paper, title block, scale bar and north arrow; what colours mean |
//! | `face`, `scene` | convex faces in space; the surfaces of a part of a city |
//! | `view` | from the scene to the page |
//! | `part` | a part of a city, read and sorted once for all views of it |
//! | `terrain` | terrain with no more triangles than the view needs |
//! | `bsp`, `volume` | faces in the order of their distance; what a view shows of space |
//! | `convex`, `warnock` | polygons on the page; their visible parts |
//! | `join`, `lines` | visible parts as shapes and lines |
//! | `paint_order` | translucent surfaces from the farthest to the nearest |
//! | `tone`, `paint`, `shadow` | colours of shapes, of objects by an attribute; shadows of the sun |
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
mod join;
mod legend;
pub mod limits;
pub mod lines;
pub mod options;
mod paint;
mod paint_order;
mod part;
mod pdf;
pub mod picture;
pub mod pipeline;
mod request;
mod scene;
mod shadow;
pub mod sheet;
pub mod style;
pub mod svg;
mod terrain;
mod tone;
pub mod view;
mod volume;
mod warnock;

pub use error::DrawError;
pub use limits::DrawLimits;
pub use paint::over_heights;
pub use part::DrawnPart;
pub use pipeline::{draw, draw_part};
pub use request::DrawRequest;
