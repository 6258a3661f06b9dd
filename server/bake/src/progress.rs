//! How a bake tells where it is.
//!
//! In: stages and steps from `pipeline`. Out: calls of [`Progress`]. Next: a progress bar, or nothing.

/// Told what is being done, from several threads at once.
pub trait Progress: Sync {
    /// A stage begins: `read`, `partition`, `sample`, `level N`, `write`. It has `total` steps, 0 if that is not known.
    fn stage(&self, name: &str, total: u64);
    /// `n` more steps of the stage are done.
    fn advance(&self, n: u64);
}

/// Says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str, _total: u64) {}
    fn advance(&self, _n: u64) {}
}
