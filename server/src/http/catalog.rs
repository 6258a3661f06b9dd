//! The cities that are served, with their documents and who may see them.

use super::{access_control::Access, city_documents::Manifests};
use crate::store::Store;

/// Cities with what is said of them and who may see them, swapped as one.
#[derive(Debug)]
pub struct Catalog {
    store: Store,
    manifests: Manifests,
    access: Access,
}

impl Catalog {
    pub(super) fn new(store: Store, access: Access) -> Self {
        Self { manifests: Manifests::new(&store, &access), store, access }
    }

    /// The opened cities.
    pub fn store(&self) -> &Store {
        &self.store
    }

    pub(super) fn manifests(&self) -> &Manifests {
        &self.manifests
    }

    pub(super) fn access(&self) -> &Access {
        &self.access
    }
}
