//! What can be wrong with a session.

/// Why a city cannot be shown.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// The root's tile or subtree is bad.
    #[error("the root tile of city {city} is missing or damaged: run insula-server verify on the city")]
    RootUnusable { city: String },
    /// The source will never serve the city.
    #[error("{0}")]
    Fatal(String),
}
