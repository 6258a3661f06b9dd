//! What a proposal changes in a city that is baked.

use std::path::PathBuf;

/// Additions to a city, and objects that are left out of it. They were found in a city that was baked of the same inputs.
#[derive(Debug, Clone, Default)]
pub struct ProposalOptions {
    /// Title for people.
    pub title: String,
    /// In the order of the proposal.
    pub added: Vec<AddedInput>,
    /// The objects that are left out, with their parts.
    pub removed: Vec<RemovedObject>,
    /// Identifiers of buildings that are to be removed, and are not there.
    pub missing: Vec<String>,
    /// The files that it names: the bake replaces and removes none of them.
    pub files: Vec<PathBuf>,
}

/// What is added.
#[derive(Debug, Clone)]
pub struct AddedInput {
    pub file: PathBuf,
    pub content: AddedContent,
}

/// What is added of a file.
#[derive(Debug, Clone)]
pub enum AddedContent {
    /// All objects, where their coordinates say. Those without heights stand at `base_m`, a height in world metres.
    Model { base_m: f64 },
    /// A mesh without coordinates of a place: longitude and latitude of its origin in degrees, its height in metres, and by how much it is
    /// turned clockwise.
    PlacedModel { origin: [f64; 3], heading_deg: f64 },
    /// Triangles in world metres, seen from outside: the block over an outline.
    Block(Vec<[[f64; 3]; 3]>),
}

/// An object that is left out.
#[derive(Debug, Clone, PartialEq)]
pub struct RemovedObject {
    /// That of its source.
    pub identifier: String,
    /// Lowest and highest corner on the map, in world metres.
    pub bounds_m: [[f64; 2]; 2],
}
