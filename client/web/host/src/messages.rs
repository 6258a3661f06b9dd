//! Messages of the viewer to the page, as JSON.

use insula_objects::NamedValues;
use insula_viewer::objects::ObjectDescription;
use serde::Serialize;
use std::time::Duration;

/// What is over the picture that is on the screen. Places are pixels of the frame, from the upper left corner.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct FrameMessage {
    pub op: &'static str,
    /// `X,Y,Z,AZIMUTH,PITCH,FOV` in metres and degrees.
    pub camera: String,
    pub position: [f64; 3],
    /// Degrees clockwise from the grid's north.
    pub azimuth: f64,
    /// Degrees above the horizon.
    pub pitch: f64,
    pub mode: &'static str,
    /// Whether ground and buildings stop the camera.
    pub collides: bool,
    /// Solar time, `YYYY-MM-DDThh:mm`.
    pub time: String,
    /// At the surface in the middle of the view; `null` if there is none.
    pub meters_per_pixel: Option<f64>,
    /// Place of each marker, and whether nothing hides it.
    pub markers: Vec<(f64, f64, bool)>,
    /// The same of points along each line.
    pub lines: Vec<Vec<(f64, f64, bool)>>,
    pub measure: Option<MeasureMessage>,
    /// Edges of the boxes of nodes, with a shading that asks for them: x, y, x, y.
    pub boxes: Vec<[f64; 4]>,
    /// Tiles that the frame lacks.
    pub missing: usize,
    /// Whether nothing can improve the frame.
    pub is_settled: bool,
    /// Tiles that arrived so far.
    #[cfg_attr(test, ts(type = "number"))]
    pub tiles: u64,
}

/// The measured figure.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct MeasureMessage {
    pub kind: &'static str,
    /// The result as lengths and areas with their units, such as `13.00 m`; none before there is one.
    pub figures: Vec<String>,
    pub points: Vec<[f64; 2]>,
    /// Ends of each line: x, y, x, y.
    pub lines: Vec<[f64; 4]>,
    pub closed: bool,
}

/// The state of streaming.
#[derive(Debug, Serialize, PartialEq, Clone)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct StatusMessage {
    pub op: &'static str,
    /// `loading`, `offline`, `error`; `null` if all is well.
    pub kind: Option<&'static str>,
    pub text: String,
}

/// What is known of an object. Texts are of the city's source: show them as text.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct ObjectMessage {
    pub id: u32,
    pub identifier: String,
    /// Identifier of its parent.
    pub parent: Option<String>,
    pub kind: &'static str,
    /// By name, in the order in which they are shown. What the object lacks is from its parent. Dates are texts.
    #[cfg_attr(test, ts(type = "Record<string, string | number | boolean>"))]
    pub attributes: NamedValues,
    /// World coordinates of the middle of its box, or of its parts' if it has no shape.
    pub centre: Option<[f64; 3]>,
    /// Parts of an object without a shape.
    pub parts: Vec<u32>,
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
pub struct SchemaMessage {
    /// Number of objects.
    pub objects: u32,
    /// Names of attributes by which objects can be coloured.
    pub color_by: Vec<String>,
    pub palettes: Vec<&'static str>,
    /// The attributes as the schema of the city has them.
    #[cfg_attr(test, ts(type = "import('./insula-viewer.js').Attribute[]"))]
    pub attributes: serde_json::Value,
    /// What people read, by the name of the attribute.
    #[cfg_attr(test, ts(type = "Record<string, import('./insula-viewer.js').AttributeLabel>"))]
    pub labels: serde_json::Value,
}

/// The colours of objects.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct ColorsMessage {
    /// What explains the colours; `null` without an attribute.
    #[cfg_attr(test, ts(type = "import('./insula-viewer.js').Legend | null"))]
    pub legend: serde_json::Value,
    /// Number of objects that pass the filter.
    pub passing: usize,
}

/// What the engine does next.
#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct Step {
    /// `rows` of a frame on the CPU, a frame on the `gpu`, or `none`.
    pub action: &'static str,
    /// How long to wait for an arrival or a command before the next update.
    pub wait_ms: f64,
    pub width: u32,
    pub height: u32,
    /// The rows to draw.
    pub first: u32,
    pub end: u32,
    /// Whether the frame must be sent to the workers.
    pub is_new: bool,
    /// Whether writes to the atlas must be sent to the workers.
    pub has_writes: bool,
    /// Whether the frame is the picture that was asked for.
    pub is_picture: bool,
    pub divisor: u32,
    pub samples: u32,
    pub is_final: bool,
}

impl Step {
    /// Nothing to draw for this time.
    pub fn wait(time: Duration) -> Self {
        Self { action: "none", wait_ms: time.as_secs_f64() * 1e3, ..Self::default() }
    }
}

/// The JSON of a message. These have no maps and no fallible parts, so that it always is one.
pub fn json(message: &impl Serialize) -> String {
    serde_json::to_string(message).unwrap_or_default()
}
