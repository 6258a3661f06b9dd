//! The reader of a city's objects, which the panels share, and threads that work with it.

use crate::error::Result;
use crate::objects::ObjectLookup;
use std::sync::{Arc, Mutex, PoisonError, mpsc};

/// Opens the reader of a city's objects.
pub(super) type OpenObjectsFn = Box<dyn Fn() -> Result<ObjectLookup> + Send>;

/// The reader. The thread that needs it first opens it.
#[derive(Clone)]
pub(super) struct SharedLookup(Arc<Mutex<LazyLookup>>);

struct LazyLookup {
    open: OpenObjectsFn,
    opened: Option<ObjectLookup>,
}

impl SharedLookup {
    /// Opens nothing yet.
    pub(super) fn new(open: OpenObjectsFn) -> Self {
        Self(Arc::new(Mutex::new(LazyLookup { open, opened: None })))
    }

    /// Opens the reader on a thread of its own, so that the first click need not wait for the schema. The first use reports a failure.
    pub(super) fn open_early(&self) {
        let objects = self.clone();
        let open = move || drop(objects.read(|_| Ok(())));
        if let Err(error) = std::thread::Builder::new().name("insula-objects".into()).spawn(open) {
            tracing::debug!("no thread for the objects: {error}");
        }
    }

    /// Calls `read` with the reader. Waits for other threads that read. Fails with a text if the city has no objects, or if they
    /// cannot be fetched; the next call tries again.
    pub(super) fn read<T>(&self, read: impl FnOnce(&ObjectLookup) -> Result<T>) -> std::result::Result<T, String> {
        let mut lookup = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let LazyLookup { open, opened } = &mut *lookup;
        let objects = match opened {
            Some(objects) => objects,
            None => opened.insert(open().map_err(|error| error.to_string())?),
        };
        read(objects).map_err(|error| error.to_string())
    }
}

/// Work with objects on a thread of its own, one piece at a time, so that the window never waits for the network.
pub(super) struct ObjectWorker<T> {
    objects: SharedLookup,
    answers: (mpsc::SyncSender<T>, mpsc::Receiver<T>),
    is_busy: bool,
}

impl<T: Send + 'static> ObjectWorker<T> {
    /// Does nothing yet.
    pub(super) fn new(objects: SharedLookup) -> Self {
        Self { objects, answers: mpsc::sync_channel(1), is_busy: false }
    }

    /// Whether an answer is on its way.
    pub(super) fn is_busy(&self) -> bool {
        self.is_busy
    }

    /// Starts `work`. To be called only if no other work is on its way. Fails with a text if there is no thread for it.
    pub(super) fn start(
        &mut self,
        work: impl FnOnce(&SharedLookup) -> T + Send + 'static,
    ) -> std::result::Result<(), String> {
        let (objects, sender) = (self.objects.clone(), self.answers.0.clone());
        let spawned = std::thread::Builder::new().name("insula-objects".into()).spawn(move || {
            // The window may be closed meanwhile.
            sender.send(work(&objects)).ok();
        });
        spawned.map_err(|error| format!("no thread for the objects: {error}: close other programs"))?;
        self.is_busy = true;
        Ok(())
    }

    /// The answer of the work, once.
    pub(super) fn take(&mut self) -> Option<T> {
        let answer = self.answers.1.try_recv().ok()?;
        self.is_busy = false;
        Some(answer)
    }
}
