//! How a bake reports its progress.

/// Receives a bake's progress, from several threads at once.
pub trait Progress: Sync {
    /// A stage begins: `read`, `partition`, `sample`, `level N`, `write` or `streets`. It has `total` steps, 0 if that is unknown.
    fn stage(&self, name: &str, total: u64);
    /// `n` more steps of the current stage are done.
    fn advance(&self, n: u64);
    /// `n` more steps are done without work, because their result exists: they say nothing of the speed of the others.
    fn skip(&self, n: u64) {
        self.advance(n);
    }
    /// Something that the user should know before the bake ends. One line.
    fn warn(&self, message: &str) {
        tracing::warn!("{message}");
    }
}

/// Ignores all progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str, _total: u64) {}
    fn advance(&self, _n: u64) {}
    fn warn(&self, _message: &str) {}
}
