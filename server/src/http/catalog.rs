//! The cities that are served, with their encoded documents and access rules.

use super::{access_control::AccessControl, city_documents::CityDocuments};
use crate::store::Store;

/// Open cities, their documents and their access rules; replaced as one value.
#[derive(Debug)]
pub struct Catalog {
    store: Store,
    documents: CityDocuments,
    access: AccessControl,
}

impl Catalog {
    pub(super) fn new(store: Store, access: AccessControl) -> Self {
        Self { documents: CityDocuments::new(&store, &access), store, access }
    }

    /// The open cities.
    pub fn store(&self) -> &Store {
        &self.store
    }

    pub(super) fn documents(&self) -> &CityDocuments {
        &self.documents
    }

    pub(super) fn access(&self) -> &AccessControl {
        &self.access
    }
}
