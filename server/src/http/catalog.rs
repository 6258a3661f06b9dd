//! The cities that are served, with their documents and who may see them.

use super::{access_control::AccessControl, city_documents::CityDocuments};
use crate::store::Store;

/// Cities with what is said of them and who may see them, swapped as one.
#[derive(Debug)]
pub struct Catalog {
    store: Store,
    manifests: CityDocuments,
    access: AccessControl,
}

impl Catalog {
    pub(super) fn new(store: Store, access: AccessControl) -> Self {
        Self { manifests: CityDocuments::new(&store, &access), store, access }
    }

    /// The opened cities.
    pub fn store(&self) -> &Store {
        &self.store
    }

    pub(super) fn manifests(&self) -> &CityDocuments {
        &self.manifests
    }

    pub(super) fn access(&self) -> &AccessControl {
        &self.access
    }
}
