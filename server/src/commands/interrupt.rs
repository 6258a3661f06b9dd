//! A clock and the signals that end the program, on a thread of their own.

use std::time::Duration;

/// Calls `tick` at each `interval`, if there is one. At the first signal that asks the program to end, calls `farewell` and
/// ends the program as the signal would have. Without a thread to do so, signals end it as usual.
pub(super) fn watch(
    interval: Option<Duration>,
    tick: impl Fn() + Send + 'static,
    farewell: impl FnOnce() + Send + 'static,
) {
    let run = move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else { return };
        let number = runtime.block_on(async {
            let Ok(mut signals) = EndSignals::register() else { return None };
            let never = Duration::from_secs(u64::from(u32::MAX));
            loop {
                tokio::select! {
                    number = signals.next() => return Some(number),
                    () = tokio::time::sleep(interval.unwrap_or(never)) => tick(),
                }
            }
        });
        if let Some(number) = number {
            farewell();
            insula_source::temporary::remove_all();
            end_by(number);
        }
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
