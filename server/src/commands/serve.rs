//! `serve`: cities on a port until a signal.
//!
//! In: folders, an address. Out: one line on standard output when connections are accepted; then HTTP. Next: clients.

use super::{error::CommandError, output::print};
use crate::{
    args::ServeArgs,
    config::{LogFormat, ServeConfig},
    http::HttpServer,
    store::Store,
    telemetry,
};
use std::sync::Arc;
use tokio::{net::TcpListener, sync::Notify};

pub(super) fn run(args: &ServeArgs) -> Result<(), CommandError> {
    let listen = args.listen.iter().map(|listen| format!("listen={listen}"));
    let settings: Vec<String> = args.set.iter().cloned().chain(listen).collect();
    // What is no text is no setting of ours.
    let environment = std::env::vars_os().filter_map(|(k, v)| Some((k.into_string().ok()?, v.into_string().ok()?)));
    let config = ServeConfig::new(args.config.as_deref(), environment, &settings)?;
    if args.print_config {
        print(&config.to_toml());
        return Ok(());
    }
    telemetry::start("info", config.log.format == LogFormat::Json);
    let system = |what| move |source| CommandError::System { what, source };
    // It accepts connections and looks after cities; `http::worker` has threads of its own.
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(system("start threads"))?;
    runtime.block_on(async {
        // Before the line is printed, so that whoever reads it can already stop the server.
        let signals = ShutdownSignals::new().map_err(system("watch for signals"))?;
        let store = Store::open_anywhere(&args.cities, &config.cache).await?;
        let refused = |source| CommandError::Listen { address: config.listen.clone(), source };
        let listener = TcpListener::bind(&config.listen).await.map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        tracing::info!(cities = store.cities().len(), threads = config.worker_threads(), "serving");
        let server = HttpServer::new(store, &config)?;
        print(&format!("listening on {}://{address}\n", server.scheme()));
        let end = signals.first(server.look());
        server.run(listener, end).await.map_err(CommandError::from)
    })
}

#[cfg(unix)]
struct ShutdownSignals {
    terminate: tokio::signal::unix::Signal,
    interrupt: tokio::signal::unix::Signal,
    hang_up: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl ShutdownSignals {
    fn new() -> std::io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        let [terminate, interrupt, hang_up] =
            [SignalKind::terminate(), SignalKind::interrupt(), SignalKind::hangup()].map(signal);
        Ok(Self { terminate: terminate?, interrupt: interrupt?, hang_up: hang_up? })
    }

    /// Ends at the first that asks for an end; SIGHUP asks for a look.
    async fn first(mut self, look: Arc<Notify>) {
        loop {
            tokio::select! {
                _ = self.terminate.recv() => return,
                _ = self.interrupt.recv() => return,
                _ = self.hang_up.recv() => look.notify_one(),
            }
        }
    }
}

#[cfg(not(unix))]
struct ShutdownSignals;

#[cfg(not(unix))]
impl ShutdownSignals {
    fn new() -> std::io::Result<Self> {
        Ok(Self)
    }

    async fn first(self, _look: Arc<Notify>) {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}
