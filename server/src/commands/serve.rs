//! `serve`: cities on a port until a signal.
//!
//! In: folders, an address. Out: one line on standard output when connections are accepted; then HTTP. Next: clients.

use super::{CommandError, print};
use crate::{args::ServeArgs, config::Config, http, store::Store};
use tokio::net::TcpListener;

pub(super) fn run(args: &ServeArgs) -> Result<(), CommandError> {
    let config = Config::new(args.config.as_deref(), args.listen.as_deref())?;
    let store = Store::open(&args.cities)?;
    let system = |what| move |source| CommandError::System { what, source };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().map_err(system("start threads"))?;
    runtime.block_on(async {
        // Before the line is printed, so that whoever reads it can already stop the server.
        let signals = Signals::new().map_err(system("watch for signals"))?;
        let refused = |source| CommandError::Listen { address: config.listen.clone(), source };
        let listener = TcpListener::bind(&config.listen).await.map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        tracing::info!(cities = store.cities().len(), max_in_flight = config.max_in_flight, "serving");
        print(&format!("listening on http://{address}\n"));
        http::serve(listener, store, &config, signals.first()).await.map_err(system("serve"))
    })
}

#[cfg(unix)]
struct Signals {
    terminate: tokio::signal::unix::Signal,
    interrupt: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl Signals {
    fn new() -> std::io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self { terminate: signal(SignalKind::terminate())?, interrupt: signal(SignalKind::interrupt())? })
    }

    async fn first(mut self) {
        tokio::select! {
            _ = self.terminate.recv() => {}
            _ = self.interrupt.recv() => {}
        }
    }
}

#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    fn new() -> std::io::Result<Self> {
        Ok(Self)
    }

    async fn first(self) {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}
