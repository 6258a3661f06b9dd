//! The log of a program on standard error.

use insula_protocol::text::{printable, without_users};
use std::env;
use std::io::{self, IsTerminal, Write};
use tracing_subscriber::field::MakeExt;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::{FormatFields, format};
use tracing_subscriber::prelude::*;

/// Starts logging with the levels of `RUST_LOG` (`warn,insula_server=debug`: a level for all, and for targets), else with
/// those of `levels`, as text or JSON lines. Further calls have no effect. Only programs call this: in a library it would
/// override the choice of the program that embeds it.
pub fn start(levels: &str, json: bool) {
    let chosen = env::var("RUST_LOG").ok().filter(|text| !text.is_empty()).and_then(|text| text.parse().ok());
    let filter: Targets = chosen.or_else(|| levels.parse().ok()).unwrap_or_default();
    let (registry, lines) = (
        tracing_subscriber::registry(),
        tracing_subscriber::fmt::layer().with_writer(|| WithoutUsers(std::io::stderr())),
    );
    let _ = if json {
        let lines = lines.json().flatten_event(true).with_current_span(false).with_span_list(false);
        registry.with(lines.with_filter(filter)).try_init()
    } else {
        let lines = lines.fmt_fields(printable_fields()).with_ansi(std::io::stderr().is_terminal());
        registry.with(lines.with_filter(filter)).try_init()
    };
}

/// Writes lines, which come as a whole, without users and passwords of addresses.
struct WithoutUsers<W>(W);

impl<W: Write> Write for WithoutUsers<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write_all(without_users(&String::from_utf8_lossy(bytes)).as_bytes())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Writes fields as tracing does, but on one line and without anything that a terminal obeys: errors quote what is in files.
fn printable_fields() -> impl for<'writer> FormatFields<'writer> + Send + Sync + 'static {
    let fields = format::debug_fn(|writer, field, value| match field.name() {
        "message" => write!(writer, "{}", printable(&format!("{value:?}"))),
        name => write!(writer, "{name}={}", printable(&format!("{value:?}"))),
    });
    fields.delimited(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    #[derive(Clone, Default)]
    struct Log(Arc<Mutex<Vec<u8>>>);

    impl Write for Log {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn outside_text_stays_on_its_line_and_controls_no_terminal() {
        let log = Log::default();
        let writer = log.clone();
        let subscriber = tracing_subscriber::fmt().fmt_fields(printable_fields()).with_ansi(false);
        let subscriber = subscriber.with_writer(move || writer.clone()).finish();
        let evil = "a\u{1b}[2J\u{9b}31m\nERROR forged\u{202e}";
        tracing::subscriber::with_default(subscriber, || {
            tracing::error!(error = %evil, name = evil, "cannot open {evil}");
        });
        let text = String::from_utf8(log.0.lock().unwrap().clone()).unwrap();
        let line = text.strip_suffix('\n').unwrap();
        assert_eq!(printable(line), line);
        assert!(line.contains("cannot open a\\u{1b}[2J\\u{9b}31m ERROR forged\\u{202e} error=a\\u{1b}"), "{line}");
    }
    #[test]
    fn no_line_has_the_password_of_an_address() {
        let log = Log::default();
        let writer = log.clone();
        let subscriber = tracing_subscriber::fmt().json().with_writer(move || WithoutUsers(writer.clone())).finish();
        tracing::subscriber::with_default(subscriber, || {
            tracing::error!(place = "https://me:secret@h/city", "cannot read http://me:secret@h");
        });
        let text = String::from_utf8(log.0.lock().unwrap().clone()).unwrap();
        assert!(text.contains("\"https://h/city\"") && !text.contains("secret"), "{text}");
    }
}
