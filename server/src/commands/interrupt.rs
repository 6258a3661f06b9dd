//! A clock and the signals that end the program, on a thread of their own.

use std::time::Duration;

/// Calls `tick` at each `interval`, if there is one. At the first signal that asks the program to end, calls `farewell` and
/// ends the program as the signal would have. From the return on, no signal is missed. Without a thread or handlers, signals
/// end the program as usual.
pub(super) fn watch(
    interval: Option<Duration>,
    tick: impl Fn() + Send + 'static,
    farewell: impl FnOnce() + Send + 'static,
) {
    let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else { return };
    // Not on the thread, which may start after the first temporary file is written.
    let registered = {
        let _context = runtime.enter();
        EndSignals::register()
    };
    let Ok(mut signals) = registered else { return };
    let run = move || {
        let never = Duration::from_secs(u64::from(u32::MAX));
        let number = runtime.block_on(async {
            loop {
                tokio::select! {
                    number = signals.next() => return number,
                    () = tokio::time::sleep(interval.unwrap_or(never)) => tick(),
                }
            }
        });
        farewell();
        insula_source::temporary::remove_all();
        end_by(number);
    };
    // The thread ends with the process.
    let _ = std::thread::Builder::new().name("interrupt".into()).spawn(run);
}

/// The signals of Ctrl-C and of `kill`.
struct EndSignals {
    #[cfg(unix)]
    signals: [tokio::signal::unix::Signal; 2],
}

#[cfg(unix)]
impl EndSignals {
    fn register() -> std::io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self { signals: [signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?] })
    }

    /// The number of the next signal.
    async fn next(&mut self) -> i32 {
        use tokio::signal::unix::SignalKind;
        let [interrupt, terminate] = &mut self.signals;
        tokio::select! {
            _ = interrupt.recv() => SignalKind::interrupt().as_raw_value(),
            _ = terminate.recv() => SignalKind::terminate().as_raw_value(),
        }
    }
}

/// Ends the process by the signal's default action: a shell then knows that it was interrupted, and ends its loop too.
#[cfg(unix)]
fn end_by(number: i32) -> ! {
    /// `SIG_DFL` of every Unix.
    const DEFAULT_ACTION: usize = 0;
    unsafe extern "C" {
        fn signal(number: i32, action: usize) -> usize;
        fn raise(number: i32) -> i32;
    }
    // SAFETY: the number is that of a signal that was caught, and its default action is no function of this program.
    unsafe {
        signal(number, DEFAULT_ACTION);
        raise(number);
    }
    std::process::exit(128 + number)
}

#[cfg(not(unix))]
impl EndSignals {
    fn register() -> std::io::Result<Self> {
        Ok(Self {})
    }

    /// The number of Ctrl-C.
    async fn next(&mut self) -> i32 {
        match tokio::signal::ctrl_c().await {
            Ok(()) => 2,
            Err(_) => std::future::pending().await,
        }
    }
}

#[cfg(not(unix))]
fn end_by(number: i32) -> ! {
    std::process::exit(128 + number)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    #[test]
    fn signals_are_caught_as_soon_as_they_are_watched() {
        super::watch(None, || {}, || {});
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap();
        let caught = u64::from_str_radix(caught.trim(), 16).unwrap();
        // Interrupt (2) and terminate (15), as bits from 1.
        assert_eq!(caught >> 1 & 1, 1);
        assert_eq!(caught >> 14 & 1, 1);
    }
}
