//! The state of streaming in words.

use crate::session::Session;
use insula_protocol::text::{count, printable};
use insula_viewer::streamer::StreamStatus;
use std::time::Duration;

/// What is said while tiles are missing, to developers with their number; `None` without any.
pub fn loading_text(missing: usize, is_developer: bool) -> Option<String> {
    match missing {
        0 => None,
        _ if is_developer => Some(count(missing as u64, "tile") + " missing"),
        _ => Some("loading …".to_owned()),
    }
}

/// The error of a request in plain words. Unknown errors stay as they are.
fn plain_words(error: &str) -> &str {
    const CAUSES: [(&[&str], &str); 4] = [
        (&["refused"], "it refuses connections, perhaps it does not run"),
        (&["timed out", "timeout"], "no answer in time"),
        (&["dns error", "failed to lookup", "name resolution"], "its name is unknown, or there is no network"),
        (&["unreachable", "reset by peer", "closed before"], "the connection was lost"),
    ];
    let lower = error.to_lowercase();
    let known = CAUSES.iter().find(|(signs, _)| signs.iter().any(|sign| lower.contains(sign)));
    known.map_or(error, |(_, words)| words)
}

/// Text about a status for the user; `None` if all is well.
pub fn status_text(status: StreamStatus, session: &Session) -> Option<String> {
    match status {
        StreamStatus::Ready => None,
        StreamStatus::Loading => Some(format!("loading {}", session.tree().manifest().name)),
        StreamStatus::Reconnecting => {
            let secs = session.failing_for().map_or(0, |time| time.as_secs());
            let error = printable(plain_words(session.downloads().last_error()));
            Some(format!("reconnecting: the server has not answered for {secs} s ({error}); trying again"))
        }
        StreamStatus::Failed => {
            session.check(Duration::MAX).err().map(|error| printable(&error.to_string()).into_owned())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_plain_words() {
        assert_eq!(loading_text(0, true), None);
        assert_eq!(loading_text(14, false).unwrap(), "loading …");
        assert_eq!(loading_text(14, true).unwrap(), "14 tiles missing");
        assert!(plain_words("tcp connect error: Connection refused (os error 111)").contains("does not run"));
        assert_eq!(plain_words("operation timed out"), "no answer in time");
        assert_eq!(plain_words("status 503"), "status 503");
    }
}
