//! `serve`: serves cities on a port until a signal.

use super::error::CommandError;
use super::output::print;
use crate::args::ServeArgs;
use crate::config::{LogFormat, ServeConfig, environment};
use crate::http::HttpServer;
use crate::store::Store;
use insula_archive::open_files::set_most_open_files;
use insula_archive::resident_directories::set_most_directory_bytes;
use insula_command_line::log;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::Notify;

/// Files of cities that are open at the same time, where the system sets no lower limit.
const MOST_CITY_FILES: usize = 1 << 16;

/// Runs `serve`, which prints one line on standard output once connections are accepted. Fails if a setting is invalid, no city
/// can be opened (with `--strict`: one of them), or the address cannot be bound.
pub(super) fn run(args: &ServeArgs) -> Result<(), CommandError> {
    let listen = args.listen.iter().map(|listen| format!("listen={listen}"));
    let metrics = args.metrics_address.iter().map(|address| format!("metrics_address={address}"));
    let drawings = args.drawings.iter().map(|drawings| format!("drawings.at_once={drawings}"));
    let analyses = args.analyses.iter().map(|analyses| format!("analyses.at_once={analyses}"));
    let proposals = args.proposals.iter().map(|folder| format!("site.proposals={}", folder.display()));
    let url = args.public_url.iter().map(|url| format!("public_url={}", url.as_str()));
    let own = listen.chain(metrics).chain(drawings).chain(analyses).chain(proposals).chain(url);
    let settings: Vec<String> = args.set.iter().cloned().chain(own).collect();
    let config = ServeConfig::load(args.config.as_deref(), environment(), &settings)?;
    if args.print_config {
        print(&config.to_toml());
        return Ok(());
    }
    // tiny-skia warns of shapes without an area, which Insula handles.
    log::start("info,tiny_skia=error", config.log.format == LogFormat::Json);
    let system_error = |what| move |source| CommandError::System { what, source };
    raise_file_limit();
    // This thread accepts connections and reloads cities; the workers have threads of their own.
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(system_error("start threads"))?;
    let result = runtime.block_on(async {
        // Registered before the line is printed, so that its reader can stop the server at once.
        let signals = ShutdownSignals::register().map_err(system_error("register signal handlers"))?;
        let opened = Store::start(&args.cities, &config.cache).await?;
        let store = if args.strict { opened.complete() } else { opened.usable() }?;
        set_most_directory_bytes(config.directory_bytes(store.metrics().is_some()));
        let listen_error = |source| CommandError::Listen { address: config.listen.clone(), source };
        let listener = TcpListener::bind(&config.listen).await.map_err(listen_error)?;
        let address = listener.local_addr().map_err(listen_error)?;
        for (setting, city) in config.unknown_cities(|name| store.city(name).is_some()) {
            tracing::warn!(setting, city, "no city of this name is served: check its spelling");
        }
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

/// Asks the system for as many open files as it allows. Files of cities get half of them, connections the rest.
#[cfg(unix)]
fn raise_file_limit() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    let raised = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, maximum: limit.maximum });
    let files = if raised.is_ok() { limit.maximum } else { limit.current };
    set_most_open_files(files.map_or(MOST_CITY_FILES, |files| (files as usize / 2).min(MOST_CITY_FILES)));
}

#[cfg(not(unix))]
fn raise_file_limit() {
    set_most_open_files(MOST_CITY_FILES);
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
