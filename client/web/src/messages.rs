//! Messages of the viewer to the page, as JSON.

use insula_objects::NamedValues;
use insula_viewer::objects::ObjectDescription;
use serde::Serialize;

/// What is over the picture that is on the screen. Places are pixels of the frame, from the upper left corner.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct FrameMessage {
    pub(crate) op: &'static str,
    /// `X,Y,Z,AZIMUTH,PITCH,FOV` in metres and degrees.
    pub(crate) camera: String,
    pub(crate) position: [f64; 3],
    /// Degrees clockwise from the grid's north.
    pub(crate) azimuth: f64,
    /// Degrees above the horizon.
    pub(crate) pitch: f64,
    pub(crate) mode: &'static str,
    /// Whether ground and buildings stop the camera.
    pub(crate) collides: bool,
    /// Solar time, `YYYY-MM-DDThh:mm`.
    pub(crate) time: String,
    /// At the surface in the middle of the view; `null` if there is none.
    pub(crate) meters_per_pixel: Option<f64>,
    /// Place of each marker, and whether nothing hides it.
    pub(crate) markers: Vec<(f64, f64, bool)>,
    /// The same of points along each line.
    pub(crate) lines: Vec<Vec<(f64, f64, bool)>>,
    pub(crate) measure: Option<MeasureMessage>,
    /// Edges of the boxes of nodes, with a shading that asks for them: x, y, x, y.
    pub(crate) boxes: Vec<[f64; 4]>,
    /// Tiles that the frame lacks.
    pub(crate) missing: usize,
    /// Whether nothing can improve the frame.
    pub(crate) is_settled: bool,
    /// Tiles that arrived so far.
    #[cfg_attr(test, ts(type = "number"))]
    pub(crate) tiles: u64,
}

/// The measured figure.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct MeasureMessage {
    pub(crate) kind: &'static str,
    /// The result as lengths and areas with their units, such as `13.00 m`; none before there is one.
    pub(crate) figures: Vec<String>,
    pub(crate) points: Vec<[f64; 2]>,
    /// Ends of each line: x, y, x, y.
    pub(crate) lines: Vec<[f64; 4]>,
    pub(crate) closed: bool,
}

/// The state of streaming.
#[derive(Debug, Serialize, PartialEq, Clone)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct StatusMessage {
    pub(crate) op: &'static str,
    /// `loading`, `offline`, `error`; `null` if all is well.
    pub(crate) kind: Option<&'static str>,
    pub(crate) text: String,
}

/// What is known of an object. Texts are of the city's source: show them as text.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct ObjectMessage {
    pub(crate) id: u32,
    pub(crate) identifier: String,
    /// Identifier of its parent.
    pub(crate) parent: Option<String>,
    pub(crate) kind: &'static str,
    /// By name, in the order in which they are shown. What the object lacks is from its parent. Dates are texts.
    #[cfg_attr(test, ts(type = "Record<string, string | number | boolean>"))]
    pub(crate) attributes: NamedValues,
    /// World coordinates of the middle of its box, or of its parts' if it has no shape.
    pub(crate) centre: Option<[f64; 3]>,
    /// Parts of an object without a shape.
    pub(crate) parts: Vec<u32>,
}

impl From<ObjectDescription> for ObjectMessage {
    fn from(object: ObjectDescription) -> Self {
        let ObjectDescription { id, identifier, parent, kind, attributes, centre, parts } = object;
        Self { id, identifier, parent, kind, attributes, centre, parts }
    }
}

/// What objects of a city have.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct SchemaMessage {
    /// Number of objects.
    pub(crate) objects: u32,
    /// Names of attributes by which objects can be coloured.
    pub(crate) color_by: Vec<String>,
    pub(crate) palettes: Vec<&'static str>,
    /// The attributes as the schema of the city has them.
    #[cfg_attr(test, ts(type = "import('./insula-viewer.js').Attribute[]"))]
    pub(crate) attributes: serde_json::Value,
    /// What people read, by the name of the attribute.
    #[cfg_attr(test, ts(type = "Record<string, import('./insula-viewer.js').AttributeLabel>"))]
    pub(crate) labels: serde_json::Value,
}

/// The colours of objects.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct ColorsMessage {
    /// What explains the colours; `null` without an attribute.
    #[cfg_attr(test, ts(type = "import('./insula-viewer.js').Legend | null"))]
    pub(crate) legend: serde_json::Value,
    /// Number of objects that pass the filter.
    pub(crate) passing: usize,
}

/// What the engine does next.
#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
#[cfg_attr(test, derive(ts_rs::TS))]
pub(crate) struct Step {
    /// `rows` of a frame on the CPU, a frame on the `gpu`, or `none`.
    pub(crate) action: &'static str,
    /// How long to wait for an arrival or a command before the next update.
    pub(crate) wait_ms: f64,
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// The rows to draw.
    pub(crate) first: u32,
    pub(crate) end: u32,
    /// Whether the frame must be sent to the workers.
    pub(crate) is_new: bool,
    /// Whether writes to the atlas must be sent to the workers.
    pub(crate) has_writes: bool,
    /// Whether the frame is the picture that was asked for.
    pub(crate) is_picture: bool,
    pub(crate) divisor: u32,
    pub(crate) samples: u32,
    pub(crate) is_final: bool,
}
