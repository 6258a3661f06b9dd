//! The cities that are served, with their encoded documents and access rules.

use super::access_control::{AccessControl, Credentials};
use super::city_documents::CityDocuments;
use crate::share_link::ShareGrant;
use crate::store::Store;
use std::sync::Arc;

/// Open cities, their documents and their access rules; replaced as one value.
#[derive(Debug)]
pub struct Catalog {
    store: Store,
    pub(super) documents: Arc<CityDocuments>,
    pub(super) access: Arc<AccessControl>,
}

impl Catalog {
    pub(super) fn new(store: Store, access: AccessControl) -> Self {
        let documents = Arc::new(CityDocuments::new(&store, &access, None));
        Self { store, documents, access: Arc::new(access) }
    }

    /// The same cities with other tokens and keys.
    pub(super) fn with_access(&self, access: AccessControl) -> Self {
        Self { store: self.store.clone(), documents: self.documents.clone(), access: Arc::new(access) }
    }

    /// Other cities with the same access rules. `documents` are those of `store`.
    pub(super) fn with_cities(&self, store: Store, documents: Arc<CityDocuments>) -> Self {
        Self { store, documents, access: self.access.clone() }
    }

    /// The open cities.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// What the request's share link opens in lists, if it has a valid one: not the present version of a city if it is for another one.
    pub(super) fn shared(&self, credentials: Credentials<'_>) -> Option<ShareGrant> {
        let grant = self.access.shared(credentials)?;
        let city = self.store.city(&grant.city)?;
        grant.admits_version(&city.manifest().version).then_some(grant)
    }
}
