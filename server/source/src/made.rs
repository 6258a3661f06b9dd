//! Reports of what no source of a city has: generated facades, and the changes of a proposal.

use serde::{Deserialize, Serialize};

/// The generated facades of a city.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FacadeReport {
    /// Always true: no source has these windows.
    pub generated: bool,
    /// Objects with a generated facade.
    pub objects: u64,
    /// Parts of walls, each with whole bays and storeys.
    pub walls: u64,
    pub windows: u64,
    pub textures: u64,
}

/// What a proposal changed in a city.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProposalReport {
    /// Title for people.
    pub title: String,
    /// Objects with triangles that are left out.
    pub removed: u64,
    /// Objects with triangles that are added.
    pub added: u64,
    /// Identifiers of buildings that are to be removed, and are not there.
    pub missing: Vec<String>,
}
