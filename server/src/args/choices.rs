//! Options that take one of some words.

use clap::ValueEnum;

/// Unit of heights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LengthUnit {
    M,
    Dm,
    Cm,
    Mm,
    Ft,
}

/// Which of two equal objects is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Preference {
    /// The one of the better level of detail
    Lod,
}

/// Ground that a bake generates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GeneratedGround {
    /// Under the buildings, and around given terrain
    Auto,
    /// Only the terrain of the sources
    None,
}

/// Walls of which the inputs have no picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GeneratedFacades {
    /// Their colour
    Plain,
    /// Generated windows
    Windows,
}

/// Device that renders visibility maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum VisibilityRenderer {
    Cpu,
    Gpu,
}

/// Axis that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UpAxis {
    /// As in surveying
    Z,
    /// As in most modelling programs
    Y,
}
