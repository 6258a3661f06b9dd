//! Baking into a cache folder and serving in this process.
//!
//! In: city files. Out: a baked folder, a server's URL. Next: `open`, `demo`.

use crate::error::{ClientError, Result};
use insula_bake::{BakeOptions, Progress, read::Palette};
use insula_protocol::manifest::{Attribution, to_name};
use insula_server::{config::ServeConfig, http, store::Store};
use std::{
    collections::hash_map::DefaultHasher,
    fs,
    hash::{Hash, Hasher},
    io::IsTerminal,
    path::{Path, PathBuf},
    sync::Mutex,
    time::{Duration, SystemTime},
};

/// What to bake.
#[derive(Debug, Clone, Default)]
pub(super) struct Recipe {
    /// City files or folders.
    pub(super) inputs: Vec<PathBuf>,
    /// Side of the finest column.
    pub(super) cell_m: f64,
    /// Name in URLs; the first input's if empty.
    pub(super) name: Option<String>,
    /// For people; the source's own if empty.
    pub(super) title: Option<String>,
    /// Who must be named; what the sources say if empty.
    pub(super) attribution: Vec<Attribution>,
    /// Colours of what has none.
    pub(super) palette: Palette,
    /// Bakes of other recipes have others.
    pub(super) key: u64,
}

/// A folder of this program's in the user's cache folder.
pub(super) fn cache_folder(name: &str) -> Result<PathBuf> {
    let folders = directories::ProjectDirs::from("", "", "insula")
        .ok_or_else(|| ClientError::Failed("there is no home folder to bake into: set HOME".into()))?;
    let folder = folders.cache_dir().join(name);
    fs::create_dir_all(&folder).map_err(ClientError::file(&folder))?;
    Ok(folder)
}

/// What a cached city depends on besides its sources: another version of the program may bake another one.
pub(super) const VERSIONS: (&str, u16, u32, u32) =
    (env!("CARGO_PKG_VERSION"), insula_protocol::tile::VERSION, insula_bake::ALGORITHM, insula_bake::MESH_ALGORITHM);

/// Differs if a file's path, size or time differs.
pub(super) fn key_of(inputs: &[PathBuf], palette: Option<&Path>, cell_m: f64) -> Result<u64> {
    let mut hasher = DefaultHasher::new();
    (VERSIONS, cell_m.to_bits()).hash(&mut hasher);
    for path in inputs.iter().map(PathBuf::as_path).chain(palette) {
        hash_path(path, &mut hasher)?;
    }
    Ok(hasher.finish())
}

fn hash_path(path: &Path, hasher: &mut DefaultHasher) -> Result<()> {
    let path = path.canonicalize().map_err(ClientError::file(path))?;
    let about = fs::metadata(&path).map_err(ClientError::file(&path))?;
    path.hash(hasher);
    if about.is_dir() {
        let entries: std::io::Result<Vec<_>> = fs::read_dir(&path).and_then(Iterator::collect);
        let mut paths: Vec<PathBuf> = entries.map_err(ClientError::file(&path))?.iter().map(|e| e.path()).collect();
        paths.sort();
        return paths.iter().try_for_each(|path| hash_path(path, hasher));
    }
    let time = about.modified().ok().and_then(|t| t.duration_since(SystemTime::UNIX_EPOCH).ok());
    (about.len(), time).hash(hasher);
    Ok(())
}

/// The baked city's folder: from the cache, or baked now.
pub(super) fn bake(recipe: &Recipe) -> Result<PathBuf> {
    let first = recipe.inputs.first().and_then(|path| path.file_name()).unwrap_or_default().to_string_lossy();
    let first = first.split('.').next().unwrap_or_default();
    let stem = to_name(recipe.name.as_deref().unwrap_or(first));
    let out = cache_folder("cities")?.join(format!("{stem}-{:016x}", recipe.key));
    // What cannot be opened, an older program left: it is baked again.
    if Store::open(&[&out]).is_ok() {
        return Ok(out);
    }
    eprintln!("baking {stem} into {} (once)", out.display());
    let options = BakeOptions {
        inputs: recipe.inputs.clone(),
        out: out.clone(),
        cell_m: recipe.cell_m,
        resume: true,
        name: Some(stem),
        title: recipe.title.clone(),
        attribution: recipe.attribution.clone(),
        palette: recipe.palette.clone(),
        ..BakeOptions::default()
    };
    let bar = Bar::default();
    let baked = insula_bake::bake(&options, &bar);
    bar.end();
    baked.map_err(|e| ClientError::Failed(e.to_string()))?;
    Ok(out)
}

/// Says on standard error, if somebody looks, how far it is.
#[derive(Default)]
struct Bar(Mutex<(String, u64, u64, u64)>);

impl Bar {
    fn end(&self) {
        if std::io::stderr().is_terminal() {
            eprint!("\r\x1b[K");
        }
    }
}

impl Progress for Bar {
    fn stage(&self, name: &str, total: u64) {
        if let Ok(mut now) = self.0.lock() {
            *now = (name.to_owned(), total, 0, u64::MAX);
        }
        self.advance(0);
    }

    fn advance(&self, n: u64) {
        let Ok(mut now) = self.0.lock() else { return };
        now.2 += n;
        let percent = (now.2 * 100).checked_div(now.1).unwrap_or(0);
        if percent != now.3 && std::io::stderr().is_terminal() {
            now.3 = percent;
            eprint!("\r\x1b[K{} {percent}%", now.0);
        }
    }
}

/// A server in this process; it ends with this value.
pub(super) struct Embedded {
    /// `http://127.0.0.1:PORT`.
    pub(super) url: String,
    runtime: Option<tokio::runtime::Runtime>,
}

/// Serves one city's folder on a free port of this machine only.
pub(super) fn serve(folder: &Path) -> Result<Embedded> {
    let failed = |e: &dyn std::fmt::Display| ClientError::Failed(format!("the city cannot be served: {e}"));
    let store = Store::open(&[folder]).map_err(|e| failed(&e))?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .thread_name("insula-serve")
        .enable_all()
        .build()
        .map_err(|e| failed(&e))?;
    let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).map_err(|e| failed(&e))?;
    let url = format!("http://{}", listener.local_addr().map_err(|e| failed(&e))?);
    runtime.spawn(async move {
        let config = ServeConfig::default();
        if let Err(error) = http::serve(listener, store, &config, std::future::pending::<()>()).await {
            tracing::error!("the embedded server ended: {error}");
        }
    });
    Ok(Embedded { url, runtime: Some(runtime) })
}

impl Drop for Embedded {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_timeout(Duration::from_millis(200));
        }
    }
}
