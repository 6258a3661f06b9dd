//! Messages of the page to the viewer, as JSON. A command is an object whose only key is its name, with its values: enums with tags inside
//! take several times the code.

use insula_viewer::interaction::camera_control::{ControlMode, MoveDirection};
use insula_viewer::interaction::measure::MeasureKind;
use insula_viewer::objects::{FilteredOut, StyleRules};
use serde::Deserialize;

/// How a viewer begins.
#[derive(Debug, Deserialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
#[serde(rename_all = "camelCase")]
pub struct ViewerOptions {
    /// The text of the manifest, which the page has fetched.
    pub manifest: String,
    /// `http://host` of a server, or the URL of a baked city's folder.
    pub base: String,
    pub is_folder: bool,
    /// Appended to each address of a server: a share link, or empty.
    #[serde(default)]
    pub query: String,
    pub width: u32,
    pub height: u32,
    #[cfg_attr(test, ts(type = "number"))]
    pub cache_bytes: u64,
    pub tau: Option<f64>,
    pub camera: Option<String>,
    pub time: Option<String>,
}

/// A command without an answer.
#[derive(Debug, Deserialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
#[serde(rename_all = "camelCase")]
pub enum Command {
    Resize { width: u32, height: u32 },
    Move { direction: Direction, held: bool },
    Fast { held: bool },
    Release {},
    Drag { dx: f64, dy: f64 },
    Pan { dx: f64, dy: f64 },
    Zoom { factor: f64 },
    Wheel { steps: f64 },
    Turn { rad: f64 },
    Tilt { rad: f64 },
    Approach { x: f64, y: f64 },
    Mode { mode: Mode },
    North {},
    Home {},
    Collision { on: bool },
    Camera { camera: String, seconds: Option<f64> },
    Goto { position: [f64; 3], seconds: Option<f64> },
    Time { time: String },
    Day { running: bool },
    Options(OptionsCommand),
    Markers { points: Vec<[f64; 3]> },
    Lines { lines: Vec<Vec<[f64; 3]>> },
    Measure(MeasureCommand),
}

/// Options that change.
#[derive(Debug, Deserialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
#[serde(rename_all = "camelCase")]
pub struct OptionsCommand {
    pub tau: Option<f64>,
    pub fps: Option<f64>,
    pub distances: Option<String>,
    pub shadows: Option<bool>,
    pub shading: Option<usize>,
    pub look: Option<usize>,
}

/// How objects are coloured and filtered. What is left out asks for nothing.
#[derive(Debug, Default, Deserialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
#[serde(rename_all = "camelCase", default, deny_unknown_fields)]
pub struct ColorRules {
    /// An attribute, `height` or `kind`.
    attribute: String,
    palette: String,
    /// Values of the ends of the palette, if they are not those of the city. Dates are days since 1970-01-01.
    range: Option<[f64; 2]>,
    /// Objects that pass, as in `yearOfConstruction < 1900 && height > 20`.
    filter: String,
    others: Others,
    /// Objects with larger values of the attribute are hidden.
    up_to: Option<f64>,
}

impl From<ColorRules> for StyleRules {
    fn from(rules: ColorRules) -> Self {
        let ColorRules { attribute, palette, range, filter, others, up_to } = rules;
        Self { attribute, palette, range, filter, filtered_out: others.into(), up_to }
    }
}

/// What the measuring tool does.
#[derive(Debug, Deserialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
#[serde(rename_all = "camelCase")]
pub enum MeasureCommand {
    Start {},
    Stop {},
    Kind { kind: Kind },
    Click { x: f64, y: f64 },
    Undo {},
    Clear {},
}

/// Enums of the viewer, as messages have them.
macro_rules! values_of {
    ($($(#[$of_enum:meta])* $name:ident of $original:ident { $($(#[$of_value:meta])* $value:ident),+ })+) => {$(
        $(#[$of_enum])*
        #[derive(Debug, Clone, Copy, Deserialize)]
        #[cfg_attr(test, derive(ts_rs::TS))]
        #[serde(rename_all = "camelCase")]
        pub enum $name {
            $($(#[$of_value])* $value),+
        }

        impl From<$name> for $original {
            fn from(value: $name) -> Self {
                match value {
                    $($name::$value => Self::$value),+
                }
            }
        }
    )+};
}

values_of! {
    Direction of MoveDirection { Forward, Back, Left, Right, Up, Down }
    Mode of ControlMode { Orbit, Fly, Walk }
    Kind of MeasureKind { Line, Area, Height }
    /// How objects are drawn that do not pass a filter: pale, not at all, or as they are.
    #[derive(Default)]
    Others of FilteredOut { #[default] Ghost, Hide, Keep }
}
