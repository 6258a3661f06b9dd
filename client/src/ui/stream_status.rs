//! The state of streaming as the user sees it.

use crate::session::Session;
use insula_protocol::text::printable;
use std::time::Duration;

/// The user is informed after the server has not responded for this time.
const SILENCE: Duration = Duration::from_millis(700);

/// State of streaming.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StreamStatus {
    /// The city is shown, and the server responds or is not needed.
    Ready,
    /// Nothing can be drawn yet.
    Loading,
    /// Tiles are missing and the server does not respond.
    Reconnecting,
    /// The city cannot be shown.
    Failed,
}

impl StreamStatus {
    /// Status of a session after its last selection.
    pub fn of(session: &Session) -> Self {
        // A frame that lacks no tiles needs no server.
        let failing_for = session.failing_for().filter(|_| session.lacks_tiles());
        match session.check(Duration::MAX) {
            Err(_) => Self::Failed,
            Ok(()) if failing_for.is_some_and(|time| time > SILENCE) => Self::Reconnecting,
            Ok(()) if !session.has_frame() => Self::Loading,
            Ok(()) => Self::Ready,
        }
    }

    /// Text for the user; `None` if all is well.
    pub fn text(self, session: &Session) -> Option<String> {
        match self {
            Self::Ready => None,
            Self::Loading => Some(format!("loading {}", session.tree().manifest().name)),
            Self::Reconnecting => {
                let secs = session.failing_for().map_or(0, |time| time.as_secs());
                let error = session.downloads().last_error();
                Some(format!("reconnecting: the server has not responded for {secs} s ({error}); retrying"))
            }
            Self::Failed => session.check(Duration::MAX).err().map(|error| printable(&error.to_string()).into_owned()),
        }
    }
}
