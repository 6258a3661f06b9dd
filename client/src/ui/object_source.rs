//! The reader of a city's objects, which the panels share. The thread that needs it first opens it.

use crate::{error::Result, objects::ObjectLookup};
use std::sync::{Arc, Mutex, PoisonError};

/// Opens the reader of a city's objects.
pub(super) type OpenObjectsFn = Box<dyn FnOnce() -> Result<ObjectLookup> + Send>;

/// A reader before and after it is opened.
enum LazyLookup {
    Closed(OpenObjectsFn),
    Open(ObjectLookup),
    Failed(String),
}

/// The reader.
#[derive(Clone)]
pub(super) struct SharedLookup(Arc<Mutex<LazyLookup>>);

impl SharedLookup {
    /// Opens nothing yet.
    pub(super) fn new(open: OpenObjectsFn) -> Self {
        Self(Arc::new(Mutex::new(LazyLookup::Closed(open))))
    }

    /// Calls `read` with the reader. Waits for other threads that read. Fails with a text if the city has no objects, or if they
    /// cannot be fetched.
    pub(super) fn read<T>(&self, read: impl FnOnce(&ObjectLookup) -> Result<T>) -> std::result::Result<T, String> {
        let mut lookup = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if matches!(*lookup, LazyLookup::Closed(_))
            && let LazyLookup::Closed(open) = std::mem::replace(&mut *lookup, LazyLookup::Failed(String::new()))
        {
            *lookup = open().map_or_else(|error| LazyLookup::Failed(error.to_string()), LazyLookup::Open);
        }
        match &*lookup {
            LazyLookup::Open(objects) => read(objects).map_err(|error| error.to_string()),
            LazyLookup::Failed(reason) => Err(reason.clone()),
            LazyLookup::Closed(_) => Err("the objects are not open".to_owned()),
        }
    }
}
