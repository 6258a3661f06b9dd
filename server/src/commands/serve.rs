//! `serve`: serves cities on a port until a signal.

use super::{error::CommandError, output::print};
use crate::{
    args::ServeArgs,
    config::{LogFormat, ServeConfig, environment},
    http::HttpServer,
    store::Store,
};
use insula_command_line::log;
use std::sync::Arc;
use tokio::{net::TcpListener, sync::Notify};

/// Runs `serve`, which prints one line on standard output once connections are accepted. Fails if a setting is invalid, a city
/// cannot be opened, or the address cannot be bound.
pub(super) fn run(args: &ServeArgs) -> Result<(), CommandError> {
    let listen = args.listen.iter().map(|listen| format!("listen={listen}"));
    let metrics = args.metrics_address.iter().map(|address| format!("metrics_address={address}"));
    let drawings = args.drawings.iter().map(|drawings| format!("drawings.at_once={drawings}"));
    let settings: Vec<String> = args.set.iter().cloned().chain(listen).chain(metrics).chain(drawings).collect();
    let config = ServeConfig::load(args.config.as_deref(), environment(), &settings)?;
    if args.print_config {
        print(&config.to_toml());
        return Ok(());
    }
    // tiny-skia warns of shapes without an area, which Insula handles.
    log::start("info,tiny_skia=error", config.log.format == LogFormat::Json);
    let system_error = |what| move |source| CommandError::System { what, source };
    // This thread accepts connections and reloads cities; the workers have threads of their own.
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(system_error("start threads"))?;
    let result = runtime.block_on(async {
        // Registered before the line is printed, so that its reader can stop the server at once.
        let signals = ShutdownSignals::register().map_err(system_error("register signal handlers"))?;
        let store = Store::open_anywhere(&args.cities, &config.cache).await?;
        let listen_error = |source| CommandError::Listen { address: config.listen.clone(), source };
        let listener = TcpListener::bind(&config.listen).await.map_err(listen_error)?;
        let address = listener.local_addr().map_err(listen_error)?;
        tracing::info!(cities = store.cities().len(), threads = config.worker_threads(), "serving");
        let server = HttpServer::new(store, &config)?;
        if let Some(address) = server.metrics_address() {
            tracing::info!(%address, "serving health and metrics");
        }
        print(&format!("listening on {}://{address}\n", server.scheme()));
        let shutdown = signals.wait(server.reload_signal());
        server.run(listener, shutdown).await.map_err(CommandError::from)
    });
    // Blocking work may wait for a disk that does not respond.
    runtime.shutdown_background();
    result
}

/// Registered handlers of the signals that end the server or reload its cities.
struct ShutdownSignals {
    #[cfg(unix)]
    terminate: tokio::signal::unix::Signal,
    #[cfg(unix)]
    interrupt: tokio::signal::unix::Signal,
    #[cfg(unix)]
    hang_up: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl ShutdownSignals {
    fn register() -> std::io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        let [terminate, interrupt, hang_up] =
            [SignalKind::terminate(), SignalKind::interrupt(), SignalKind::hangup()].map(signal);
        Ok(Self { terminate: terminate?, interrupt: interrupt?, hang_up: hang_up? })
    }

    /// Completes at the first SIGTERM or SIGINT. Notifies `reload` at each SIGHUP.
    async fn wait(mut self, reload: Arc<Notify>) {
        loop {
            tokio::select! {
                _ = self.terminate.recv() => return,
                _ = self.interrupt.recv() => return,
                _ = self.hang_up.recv() => reload.notify_one(),
            }
        }
    }
}

#[cfg(not(unix))]
impl ShutdownSignals {
    fn register() -> std::io::Result<Self> {
        Ok(Self {})
    }

    /// Completes at the first Ctrl-C.
    async fn wait(self, _reload: Arc<Notify>) {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}
