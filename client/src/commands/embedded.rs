//! Baking into a cache folder and serving in this process, for `open` and `demo`.

use super::FindPlace;
use crate::error::{ClientError, Result};
use crate::ui::connector::StartStatus;
use insula_bake::read::{FACADE_ALGORITHM, FacadeOption, Palette, PlacingOptions, ReadOptions};
use insula_bake::sample::SampleSettings;
use insula_bake::{BakeError, BakeOptions, GroundOption, Progress, remove_damaged_city};
use insula_protocol::manifest::Attribution;
use insula_protocol::name::to_name;
use insula_protocol::text::printable;
use insula_server::config::{CorsPolicy, ServeConfig};
use insula_server::http;
use insula_server::store::Store;
use std::collections::hash_map::DefaultHasher;
use std::fs;
use std::hash::{Hash, Hasher};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// Most files and folders below an input folder.
const MAX_INPUT_FILES: usize = 1 << 20;

#[derive(Debug, Clone, Default)]
pub(super) struct BakeJob {
    /// City files or folders.
    pub(super) inputs: Vec<PathBuf>,
    /// Side of the finest column.
    pub(super) cell_m: f64,
    /// Name in URLs; that of the first input if `None`.
    pub(super) name: Option<String>,
    /// Displayed title; that of the source if `None`.
    pub(super) title: Option<String>,
    /// Attribution; that of the sources if empty.
    pub(super) attribution: Vec<Attribution>,
    /// Colours for surfaces without any.
    pub(super) palette: Palette,
    /// What walls without a texture get.
    pub(super) facades: FacadeOption,
    /// West, south, east and north in degrees: what lies outside is left out.
    pub(super) bbox_deg: Option<[f64; 4]>,
    /// Directions from which light is measured; the usual number if `None`.
    pub(super) views: Option<u32>,
    /// Hash of everything that the baked city depends on.
    pub(super) cache_key: u64,
}

/// Where baked cities are kept: this program's folder in the user's cache folder. If that cannot be written, a temporary
/// folder that ends with the last clone of this value.
#[derive(Clone)]
pub(super) struct CacheRoot {
    path: PathBuf,
    _temporary: Option<Arc<tempfile::TempDir>>,
}

impl CacheRoot {
    /// Prints a warning if cities cannot be kept. Fails if there is no temporary folder either.
    pub(super) fn open() -> Result<Self> {
        let folders = directories::ProjectDirs::from("", "", "insula");
        Self::at(folders.as_ref().map(directories::ProjectDirs::cache_dir))
    }

    /// In a folder, if it can be written. Fails as [`Self::open`].
    pub(super) fn at(folder: Option<&Path>) -> Result<Self> {
        const ADVICE: &str = "set XDG_CACHE_HOME to a folder that can be written";
        let reason = match folder {
            None => "there is no home folder".to_owned(),
            Some(path) => match fs::create_dir_all(path).and_then(|()| tempfile::tempfile_in(path)) {
                Ok(_) => return Ok(Self { path: path.to_owned(), _temporary: None }),
                Err(error) => format!("{}: {error}", path.display()),
            },
        };
        let temporary = tempfile::Builder::new().prefix("insula-").tempdir().map_err(|error| {
            ClientError::Failed(format!("{reason}, and there is no temporary folder ({error}): {ADVICE}"))
        })?;
        eprintln!("warning: the baked city is not kept: {}; {ADVICE}", printable(&reason));
        Ok(Self { path: temporary.path().to_owned(), _temporary: Some(Arc::new(temporary)) })
    }

    /// The folder of that name in it, created if missing.
    pub(super) fn folder(&self, name: &str) -> Result<PathBuf> {
        let folder = self.path.join(name);
        fs::create_dir_all(&folder).map_err(ClientError::file(&folder))?;
        Ok(folder)
    }
}

/// Versions that a cached city depends on: another version of the program may bake another city.
pub(super) const VERSIONS: (&str, u16, [u32; 3]) = (
    env!("CARGO_PKG_VERSION"),
    insula_protocol::tile::VERSION,
    [insula_bake::ALGORITHM, insula_bake::MESH_ALGORITHM, insula_bake::GROUND_ALGORITHM],
);

/// A hash of the settings and of each file's path, size and modification time. Fails if a file cannot be read.
pub(super) fn cache_key(inputs: &[PathBuf], palette: &Palette, facades: FacadeOption, cell_m: f64) -> Result<u64> {
    let mut hasher = DefaultHasher::new();
    let facades = (facades == FacadeOption::Windows).then_some(FACADE_ALGORITHM);
    (VERSIONS, palette, cell_m.to_bits(), facades).hash(&mut hasher);
    for path in inputs {
        hash_path(path, &mut hasher)?;
    }
    Ok(hasher.finish())
}

/// Hashes a file, or all files below a folder. Links to folders are not followed below the input: one may lead to a folder
/// above it, or out of it. Fails if a file cannot be read, or if there are too many.
fn hash_path(input: &Path, hasher: &mut DefaultHasher) -> Result<()> {
    if !input.exists() {
        return Err(ClientError::Usage(format!(
            "{}: there is no such file or folder: check the path",
            input.display()
        )));
    }
    let input = input.canonicalize().map_err(ClientError::file(input))?;
    let mut waiting = vec![input.clone()];
    let mut count = 0usize;
    while let Some(path) = waiting.pop() {
        count += 1;
        if count > MAX_INPUT_FILES {
            let (input, limit) = (input.display(), MAX_INPUT_FILES);
            return Err(ClientError::Usage(format!(
                "{input}: more than {limit} files: name the city files themselves"
            )));
        }
        path.hash(hasher);
        let is_link = path.is_symlink();
        let metadata = match fs::metadata(&path) {
            // A link that leads nowhere is no input.
            Err(_) if is_link => continue,
            metadata => metadata.map_err(ClientError::file(&path))?,
        };
        if metadata.is_dir() && is_link {
            fs::read_link(&path).map_err(ClientError::file(&path))?.hash(hasher);
        } else if metadata.is_dir() {
            let entries: std::io::Result<Vec<_>> = fs::read_dir(&path).and_then(Iterator::collect);
            let mut paths: Vec<PathBuf> = entries.map_err(ClientError::file(&path))?.iter().map(|e| e.path()).collect();
            paths.sort();
            waiting.extend(paths.into_iter().rev());
        } else {
            let modified = metadata.modified().ok().and_then(|t| t.duration_since(SystemTime::UNIX_EPOCH).ok());
            (metadata.len(), modified).hash(hasher);
        }
    }
    Ok(())
}

/// The folder of the baked city: from the cache, or baked now. Reports the progress to `status` and to the terminal. Fails if the
/// bake fails.
pub(super) fn bake_cached(job: &BakeJob, cache: &CacheRoot, status: Option<&StartStatus>) -> Result<PathBuf> {
    let first = job.inputs.first().and_then(|path| path.file_name()).unwrap_or_default().to_string_lossy();
    let first = first.split('.').next().unwrap_or_default();
    let name = to_name(job.name.as_deref().unwrap_or(first));
    let out = cache.folder("cities")?.join(format!("{name}-{:016x}", job.cache_key));
    // A city that cannot be opened is incomplete or from an older version: it is baked again.
    if Store::open(&[&out]).is_ok() {
        return Ok(out);
    }
    // A bake does not replace a city whose manifest it cannot read.
    remove_damaged_city(&out).map_err(|error| ClientError::Failed(error.to_string()))?;
    eprintln!("{}", printable(&format!("baking {name} into {} (once)", out.display())));
    let options = BakeOptions {
        inputs: job.inputs.clone(),
        out: out.clone(),
        cell_m: job.cell_m,
        resume: true,
        name: Some(name),
        title: job.title.clone(),
        place: Some(first.to_owned()).filter(|first| !first.is_empty()),
        attribution: job.attribution.clone(),
        read: ReadOptions {
            palette: job.palette.clone(),
            facades: job.facades,
            placing: PlacingOptions { bbox_deg: job.bbox_deg, ..PlacingOptions::default() },
            ..ReadOptions::default()
        },
        sample: job.views.map_or_else(SampleSettings::default, SampleSettings::with_views),
        ground: GroundOption::Auto,
        ..BakeOptions::default()
    };
    let progress =
        BakeProgress { name: to_name(job.name.as_deref().unwrap_or(first)), status, stage: Mutex::default() };
    let baked = insula_bake::bake(&options, &progress);
    progress.clear();
    baked.map_err(|error| match error {
        BakeError::Option { .. } => ClientError::Usage(error.to_string()),
        error => ClientError::Failed(error.to_string()),
    })?;
    Ok(out)
}

/// Shows the progress of a bake in the window, and prints it to standard error if that is a terminal.
struct BakeProgress<'a> {
    name: String,
    status: Option<&'a StartStatus>,
    stage: Mutex<StageProgress>,
}

#[derive(Default)]
struct StageProgress {
    stage: String,
    total: u64,
    done: u64,
    shown_percent: Option<u64>,
}

impl BakeProgress<'_> {
    fn clear(&self) {
        if std::io::stderr().is_terminal() {
            eprint!("\r\x1b[K");
        }
    }
}

impl Progress for BakeProgress<'_> {
    fn stage(&self, name: &str, total: u64) {
        if let Ok(mut progress) = self.stage.lock() {
            *progress = StageProgress { stage: name.to_owned(), total, ..StageProgress::default() };
        }
        self.advance(0);
    }

    fn warn(&self, message: &str) {
        self.clear();
        eprintln!("warning: {}", printable(message));
    }

    fn advance(&self, n: u64) {
        let Ok(mut progress) = self.stage.lock() else { return };
        progress.done += n;
        let percent = (progress.done * 100).checked_div(progress.total).unwrap_or(0);
        if progress.shown_percent == Some(percent) {
            return;
        }
        progress.shown_percent = Some(percent);
        let text = format!("{} {percent}%", progress.stage);
        if let Some(status) = self.status {
            status.set(format!("baking {} (once): {text}", self.name));
        }
        if std::io::stderr().is_terminal() {
            eprint!("\r\x1b[K{}", printable(&text));
        }
    }
}

/// Bakes and serves the city of `job` when the window asks for its place.
pub(super) fn find_baked(job: BakeJob, cache: CacheRoot) -> FindPlace {
    let server: Mutex<Option<EmbeddedServer>> = Mutex::new(None);
    Box::new(move |status| {
        let mut server = server.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(server) = &*server {
            return Ok(server.url.clone().into());
        }
        let started = serve(&bake_cached(&job, &cache, Some(status))?)?;
        status.set("loading".into());
        Ok(server.insert(started).url.clone().into())
    })
}

/// A server in this process. Ends when dropped.
pub(super) struct EmbeddedServer {
    /// `http://127.0.0.1:PORT`.
    pub(super) url: String,
    runtime: Option<tokio::runtime::Runtime>,
}

/// Serves the baked city in `folder` on a free port of the loopback interface. Fails if the folder holds no valid city.
pub(super) fn serve(folder: &Path) -> Result<EmbeddedServer> {
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
        // Only programs of this machine may read the city: no page of a browser, under whatever name it reaches the loopback.
        let mut config = ServeConfig::default();
        config.access.cors = CorsPolicy::None;
        config.access.hosts = vec!["127.0.0.1".into()];
        if let Err(error) = http::serve(listener, store, &config, std::future::pending::<()>()).await {
            tracing::error!("the embedded server ended: {error}");
        }
    });
    Ok(EmbeddedServer { url, runtime: Some(runtime) })
}

impl Drop for EmbeddedServer {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_timeout(Duration::from_millis(200));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cache_folder_that_cannot_be_written_is_replaced_for_this_run() {
        let folder = tempfile::tempdir().unwrap();
        let writable = folder.path().join("a/b");
        assert_eq!(CacheRoot::at(Some(&writable)).unwrap().folder("cities").unwrap(), writable.join("cities"));
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        for unusable in [None, Some(file.join("insula"))] {
            let root = CacheRoot::at(unusable.as_deref()).unwrap();
            let cities = root.folder("cities").unwrap();
            fs::write(cities.join("x"), "x").unwrap();
            drop(root);
            assert!(!cities.exists(), "{}", cities.display());
        }
    }

    #[cfg(unix)]
    #[test]
    fn folders_that_link_to_themselves_or_nest_deeply_are_hashed() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let city = folder.path().join("city");
        let deepest = (0..300).fold(city.clone(), |path, _| path.join("d"));
        fs::create_dir_all(&deepest).unwrap();
        for (link, target) in [
            ("self", city.as_path()),
            ("above", folder.path()),
            ("circle", Path::new("circle")),
            ("all", Path::new("/")),
        ] {
            symlink(target, city.join(link)).unwrap();
        }
        symlink(&city, deepest.join("top")).unwrap();
        fs::write(deepest.join("a.obj"), "v 0 0 0").unwrap();
        let key = || cache_key(std::slice::from_ref(&city), &Palette::default(), FacadeOption::Plain, 1.0).unwrap();
        let before = key();
        assert_eq!(key(), before);
        fs::write(deepest.join("a.obj"), "v 0 0 0\nv 1 1 1").unwrap();
        assert_ne!(key(), before, "a file below has changed");
        // An input that is a link itself is followed.
        let inputs = [folder.path().join("link")];
        symlink(&city, &inputs[0]).unwrap();
        assert_eq!(cache_key(&inputs, &Palette::default(), FacadeOption::Plain, 1.0).unwrap(), key());
    }

    #[test]
    fn an_input_that_is_missing_is_a_wrong_argument() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("nope.gml");
        let error = cache_key(&[missing], &Palette::default(), FacadeOption::default(), 1.0).unwrap_err();
        assert_eq!(error.exit_code(), 2, "{error}");
        assert!(error.to_string().contains("nope.gml: there is no such file or folder"), "{error}");
    }
}
