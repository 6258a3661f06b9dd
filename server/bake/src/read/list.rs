//! The sources among the inputs: files, folders, archives, patterns and lists of them.

use super::bad_inputs::BadInputs;
use super::context::ReadOptions;
use insula_archive::places::canonical;
use insula_protocol::route::without_secrets;
use insula_protocol::text::count;
use insula_source::address_reader::AddressReader;
use insula_source::archive::{ZipFiles, is_archive};
use insula_source::bucket::{self, BucketFiles, BucketInput};
use insula_source::error::InputError;
use insula_source::files::{FileRoots, FolderFiles};
use insula_source::input::SourceFiles;
use insula_source::name_level::finest_first;
use insula_source::source::{CitySource, kind_by_name, read_file};
use insula_source::{remote, unread_formats};
use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;

/// Folders in folders beyond this depth are left out.
const MAX_DEPTH: usize = 24;
/// Larger lists are refused.
const MAX_LIST_BYTES: u64 = 64 << 20;
/// End of the name of a folder that is a database of Esri.
const DATABASE: &str = ".gdb";
/// Files that are a whole city together with all others in their folder and below.
const WHOLE_FOLDERS: [&str; 3] = ["tileset.json", "3dSceneLayer.json", "3dSceneLayer.json.gz"];

/// The sources of the inputs, and the files that no reader takes.
pub(super) struct SourceList<'a> {
    /// In the order of the inputs, those of a folder by name, the finest level first. A file that is given twice is in it once.
    pub(super) sources: Vec<CitySource<'a>>,
    /// Files in folders and archives whose format is known and not read, one line for each format.
    pub(super) unread: Vec<String>,
}

/// Files in a folder or an archive, by their names within it.
#[derive(Default)]
struct SelectedFiles {
    names: Vec<String>,
    /// The first of each format that is not read, with the number of them.
    unread: Vec<(&'static str, String, u64)>,
}

/// Lists the sources of the inputs. An input is a file, a folder, an archive, a pattern with `*` and `?`, a list of inputs
/// (`@FILE`, one a line), or an address of a web server or a bucket. Fails if an input cannot be read, has no known name or is a folder without a
/// city file, unless `bad` skips it.
///
/// Textures and material libraries are read from a source's folder and below, and from the options' roots.
pub(super) fn list(
    inputs: &[PathBuf],
    options: &ReadOptions,
    bad: &mut BadInputs,
) -> Result<SourceList<'static>, InputError> {
    let mut lister = Lister::new(options)?;
    lister.add_inputs(inputs, bad)?;
    let of_city = lister.list.sources.len();
    // A model may show the city's own ground, too.
    lister.seen.clear();
    lister.add_inputs(&options.surroundings.files, bad)?;
    lister.list.sources[of_city..].iter_mut().for_each(|source| source.is_surroundings = true);
    let of_model = lister.list.sources.len();
    // The city may be of the same file, read with other kinds.
    lister.seen.clear();
    lister.add_inputs(&options.streets, bad)?;
    lister.list.sources[of_model..].iter_mut().for_each(|source| source.is_streets = true);
    Ok(lister.list)
}

/// Lists the sources of meshes, without those of the city's surroundings. Fails as [`list`].
pub(super) fn list_mesh(
    meshes: &[PathBuf],
    options: &ReadOptions,
    bad: &mut BadInputs,
) -> Result<SourceList<'static>, InputError> {
    let mut lister = Lister::new(options)?;
    lister.add_inputs(meshes, bad)?;
    Ok(lister.list)
}

/// The paths that an input names on this machine, a list itself among them. A pattern or a list that cannot be read stands for itself.
pub fn named_paths(input: &Path) -> Vec<PathBuf> {
    let list = input.to_str().and_then(|text| text.strip_prefix('@')).map(PathBuf::from);
    list.into_iter().chain(expand(input).unwrap_or_else(|_| vec![input.to_owned()])).collect()
}

/// The folder in which a pattern searches: what comes before its first word with a wildcard.
fn pattern_folder(pattern: &str) -> PathBuf {
    let has_wildcard = |component: &Component<'_>| component.as_os_str().to_string_lossy().contains(['*', '?', '[']);
    Path::new(pattern).components().take_while(|component| !has_wildcard(component)).collect()
}

/// The paths that an input stands for: the lines of a list, the matches of a pattern, else itself.
fn expand(input: &Path) -> Result<Vec<PathBuf>, InputError> {
    let label = input.display().to_string();
    if let Some(list) = label.strip_prefix('@') {
        return read_list(Path::new(list));
    }
    if remote::is_address(&label) || input.exists() || !label.contains(['*', '?', '[']) {
        return Ok(vec![input.to_owned()]);
    }
    let no_pattern = |error: glob::PatternError| InputError::unsupported(&label, format!("no pattern: {error}"));
    let mut paths: Vec<PathBuf> = glob::glob(&label).map_err(no_pattern)?.filter_map(Result::ok).collect();
    paths.sort();
    if paths.is_empty() { Err(InputError::no_source(input)) } else { Ok(paths) }
}

/// The paths in a list, relative to its folder, and addresses. Empty lines and those that begin with `#` are left out.
fn read_list(path: &Path) -> Result<Vec<PathBuf>, InputError> {
    let bytes = read_file(path, MAX_LIST_BYTES)?;
    let text = String::from_utf8_lossy(&bytes);
    let folder = path.parent().unwrap_or(Path::new(""));
    let lines = text.trim_start_matches('\u{feff}').lines().map(str::trim);
    let path_of = |line: &str| if remote::is_address(line) { line.into() } else { folder.join(line) };
    let paths: Vec<PathBuf> = lines.filter(|line| !line.is_empty() && !line.starts_with('#')).map(path_of).collect();
    if paths.is_empty() { Err(InputError::no_source(path)) } else { Ok(paths) }
}

struct Lister {
    roots: Rc<FileRoots>,
    follow_links: bool,
    addresses: Option<&'static dyn AddressReader>,
    seen: HashSet<PathBuf>,
    list: SourceList<'static>,
}

impl Lister {
    /// Fails if a folder from which textures may be read does not exist.
    fn new(options: &ReadOptions) -> Result<Self, InputError> {
        let roots = options.texture_roots.iter().map(|root| {
            let label = root.display().to_string();
            fs::canonicalize(root).map_err(|cause| InputError::io(&label, cause))
        });
        let list = SourceList { sources: Vec::new(), unread: Vec::new() };
        let roots = Rc::new(FileRoots::new(roots.collect::<Result<_, _>>()?));
        let follow_links = options.follow_links;
        Ok(Self { roots, follow_links, addresses: options.addresses, seen: HashSet::new(), list })
    }

    /// Adds the sources of all that the inputs stand for. Fails if one has none, unless `bad` skips it.
    fn add_inputs(&mut self, inputs: &[PathBuf], bad: &mut BadInputs) -> Result<(), InputError> {
        for input in inputs {
            let expanded = expand(input);
            let text = input.to_string_lossy();
            let is_pattern = !text.starts_with('@') && !remote::is_address(&text) && !input.exists();
            let folder = is_pattern.then(|| pattern_folder(&text));
            for path in bad.skip(&without_secrets(&input.to_string_lossy()), expanded)?.unwrap_or_default() {
                let text = path.display().to_string();
                let label = without_secrets(&text);
                if folder.as_ref().is_some_and(|folder| self.is_refused_link(folder, &path)) {
                    continue;
                }
                let added = match remote::is_address(&text) {
                    true => self.add_address(&text),
                    false => self.add(&path, bad),
                };
                bad.skip(&label, added)?;
            }
        }
        Ok(())
    }

    /// Adds the sources of an address. Fails if there is none, or addresses are not read here.
    fn add_address(&mut self, address: &str) -> Result<(), InputError> {
        let Some(reader) = self.addresses else {
            return Err(InputError::unsupported(&without_secrets(address), "this program reads no addresses"));
        };
        if !address.starts_with("s3://") {
            self.list.sources.push(remote::source(address, reader)?);
            return Ok(());
        }
        match bucket::open(address, reader)? {
            BucketInput::File(source) => {
                if self.is_new(Path::new(address)) {
                    self.list.sources.push(source);
                }
            }
            BucketInput::Folder { files, objects, refused } => {
                if let Some(first) = refused.first() {
                    let count = refused.len();
                    let line = format!("{}{first}: {count} names of objects that are no paths: not read", files.folder);
                    self.list.unread.push(line);
                }
                let sizes: BTreeMap<String, u64> =
                    objects.into_iter().map(|object| (object.name, object.bytes)).collect();
                let selection = select(sizes.keys().cloned().collect());
                self.check_selection(Path::new(address), &selection)?;
                for name in selection.names {
                    let label = format!("{}{name}", files.folder);
                    if self.is_new(Path::new(&label)) {
                        let bytes = sizes.get(&name).copied().unwrap_or(0);
                        let files = Rc::<BucketFiles>::clone(&files);
                        self.list
                            .sources
                            .push(CitySource { found: true, ..CitySource::new(label, name, files, bytes) });
                    }
                }
            }
        }
        Ok(())
    }

    /// Adds the sources of a path. Fails if there is none.
    fn add(&mut self, path: &Path, bad: &mut BadInputs) -> Result<(), InputError> {
        let label = path.display().to_string();
        let meta = fs::metadata(path).map_err(|cause| InputError::io(&label, cause))?;
        let folder = label.trim_end_matches('/');
        if meta.is_dir() && folder.to_ascii_lowercase().ends_with(DATABASE) {
            return Err(unread_formats::refusal(folder));
        }
        let is_packed = meta.is_file() && is_archive(&label);
        if !meta.is_dir() && !is_packed {
            return self.add_file(path);
        }
        if is_packed {
            return self.add_archive(path, bad);
        }
        let mut paths = BTreeMap::new();
        walk(path, "", 0, &mut paths)?;
        let all = paths.len();
        // Folders that are links are not in the list.
        paths.retain(|_, file| !file.is_symlink() || !self.is_refused_link(path, file));
        if paths.is_empty() && all > 0 {
            let what = "all its files are links that lead out of it: give --follow-links to read them";
            return Err(InputError::unsupported(&label, what));
        }
        let archives: Vec<PathBuf> =
            paths.iter().filter(|(name, _)| is_archive(name)).map(|(_, path)| path.clone()).collect();
        let selection = select(paths.keys().filter(|name| !is_archive(name)).cloned().collect());
        if archives.is_empty() || !selection.names.is_empty() {
            self.check_selection(path, &selection)?;
        }
        for name in selection.names {
            let file = paths.remove(&name).unwrap_or_else(|| path.join(&name));
            if self.is_new(&file) {
                let roots = Rc::clone(&self.roots);
                let files = FolderFiles::of_file(path.to_owned(), name.clone(), file.clone(), roots);
                let source = source_of(files, name, file.display().to_string(), true);
                self.list.sources.extend(bad.skip(&file.display().to_string(), source)?);
            }
        }
        let (before, mut not_read) = (self.list.sources.len(), None);
        for archive in &archives {
            match self.add_archive(archive, bad) {
                // Archives of other things lie in any folder.
                Err(
                    InputError::NoSource { .. } | InputError::UnknownFormat { .. } | InputError::Unsupported { .. },
                ) => {}
                Err(error @ InputError::NotRead { .. }) => {
                    self.list.unread.push(error.to_string());
                    not_read.get_or_insert(error);
                }
                added => {
                    bad.skip(&archive.display().to_string(), added)?;
                }
            }
        }
        self.list.sources[before..].iter_mut().for_each(|source| source.found = true);
        if self.list.sources.is_empty() && !archives.is_empty() {
            return Err(not_read.unwrap_or_else(|| InputError::no_source(path)));
        }
        Ok(())
    }

    /// Adds the sources in an archive. Fails if there is none.
    fn add_archive(&mut self, path: &Path, bad: &mut BadInputs) -> Result<(), InputError> {
        let label = path.display().to_string();
        if !self.is_new(path) {
            return Ok(());
        }
        let files = ZipFiles::new(path)?;
        let selection = select(files.names().map(str::to_owned).collect());
        self.check_selection(path, &selection)?;
        if !files.refused.is_empty() {
            let line = format!("{label}: {} names of entries that lead out of it: not read", files.refused.len());
            self.list.unread.push(line);
        }
        let files = Rc::new(files);
        for name in selection.names {
            let source = archived_source(&label, name, Rc::clone(&files));
            let label = source.as_ref().map_or(label.clone(), |source| source.label.clone());
            self.list.sources.extend(bad.skip(&label, source)?);
        }
        Ok(())
    }

    fn add_file(&mut self, path: &Path) -> Result<(), InputError> {
        let label = path.display().to_string();
        // Bytes of a name that are not UTF-8 are shown as replacement characters.
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if kind_by_name(&name).is_none() {
            return Err(unread_formats::refusal_of_file(path));
        }
        if !self.is_new(path) {
            return Ok(());
        }
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let files = FolderFiles::of_file(folder, name.clone(), path.to_owned(), Rc::clone(&self.roots));
        self.list.sources.push(source_of(files, name, label, false)?);
        Ok(())
    }

    /// Whether a file in a folder is, or lies behind, a link that leads out of it and is not followed, which is noted then.
    fn is_refused_link(&mut self, folder: &Path, file: &Path) -> bool {
        if self.follow_links {
            return false;
        }
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let leads_out = !canonical(file).starts_with(canonical(folder));
        if leads_out {
            let line =
                format!("{}: a link that leads out of the folder: not read; --follow-links reads it", file.display());
            self.list.unread.push(line);
        }
        leads_out
    }

    fn is_new(&mut self, path: &Path) -> bool {
        self.seen.insert(fs::canonicalize(path).unwrap_or_else(|_| path.to_owned()))
    }

    /// Notes the files that no reader takes. Fails if there is no source.
    fn check_selection(&mut self, path: &Path, selection: &SelectedFiles) -> Result<(), InputError> {
        let refusal = |name: &str| match path.is_file() {
            true => unread_formats::refusal_in_archive(&path.display().to_string(), name),
            false => unread_formats::refusal(&path.join(name).display().to_string()),
        };
        if selection.names.is_empty() {
            let first = selection.unread.first();
            return Err(first.map_or_else(|| InputError::no_source(path), |(_, first, _)| refusal(first)));
        }
        let lines = selection.unread.iter().map(|(_, first, files)| {
            let more = if *files > 1 { format!(" (and {})", count(files - 1, "more file")) } else { String::new() };
            format!("{}{more}", refusal(first))
        });
        self.list.unread.extend(lines);
        Ok(())
    }
}

fn source_of(files: FolderFiles, name: String, label: String, found: bool) -> Result<CitySource<'static>, InputError> {
    let bytes = files.len(&name).map_err(|cause| InputError::io(&label, cause))?;
    Ok(CitySource { found, ..CitySource::new(label, name, Rc::new(files), bytes) })
}

fn archived_source(archive: &str, name: String, files: Rc<ZipFiles>) -> Result<CitySource<'static>, InputError> {
    let label = format!("{archive}/{name}");
    let bytes = files.len(&name).map_err(|cause| InputError::io(&label, cause))?;
    Ok(CitySource { found: true, ..CitySource::new(label, name, files, bytes) })
}

/// Adds the paths of all plain files in a folder and below by their names, relative to the first. Hidden ones, and
/// links to folders, are left out. Fails if the folder cannot be read.
fn walk(folder: &Path, prefix: &str, depth: usize, paths: &mut BTreeMap<String, PathBuf>) -> Result<(), InputError> {
    let fail = |cause| InputError::io(&folder.display().to_string(), cause);
    let mut folders = Vec::new();
    for entry in fs::read_dir(folder).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        // Bytes of a name that are not UTF-8 are shown as replacement characters.
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = entry.path();
        if name.starts_with('.') || name == "__MACOSX" {
            continue;
        }
        if entry.file_type().map_err(fail)?.is_dir() {
            folders.push((path, name));
        } else if path.is_file() {
            paths.insert(format!("{prefix}{name}"), path);
        }
    }
    for (path, name) in folders {
        if depth < MAX_DEPTH {
            walk(&path, &format!("{prefix}{name}/"), depth + 1, paths)?;
        }
    }
    Ok(())
}

/// The sources among the names of files.
fn select(mut names: Vec<String>) -> SelectedFiles {
    for name in &mut names {
        if let Some(at) = name.to_ascii_lowercase().find(".gdb/") {
            name.truncate(at + DATABASE.len());
        }
    }
    names.sort();
    names.dedup();
    let split = |name: &str| {
        name.rsplit_once('/').map_or((String::new(), name.to_owned()), |(a, b)| (format!("{a}/"), b.to_owned()))
    };
    let mut wholes: Vec<String> = Vec::new();
    let mut selection = SelectedFiles::default();
    for name in &names {
        let (folder, file) = split(name);
        if WHOLE_FOLDERS.contains(&file.as_str()) && !wholes.iter().any(|whole| folder.starts_with(whole.as_str())) {
            wholes.push(folder);
        }
    }
    // The outermost folders only.
    let all = wholes.clone();
    wholes.retain(|whole| !all.iter().any(|other| other != whole && whole.starts_with(other.as_str())));
    for name in names {
        let (folder, file) = split(&name);
        let is_hidden = name.split('/').any(|part| part.starts_with('.') || part == "__MACOSX");
        let whole = wholes.iter().find(|whole| folder.starts_with(whole.as_str()));
        let is_whole = whole.is_some_and(|whole| *whole == folder && WHOLE_FOLDERS.contains(&file.as_str()));
        if is_whole || !is_hidden && whole.is_none() && kind_by_name(&name).is_some() {
            selection.names.push(name);
        } else if !is_hidden
            && whole.is_none()
            && let Some(format) = unread_formats::format_of(&name)
        {
            match selection.unread.iter_mut().find(|(known, ..)| *known == format) {
                Some((.., count)) => *count += 1,
                None => selection.unread.push((format, name, 1)),
            }
        }
    }
    finest_first(&mut selection.names);
    selection
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::source::read_sibling;
    use std::io;

    fn selected(names: &[&str]) -> Vec<String> {
        select(names.iter().map(|name| (*name).to_owned()).collect()).names
    }

    #[test]
    fn tilesets_and_hidden_files_are_not_taken_apart() {
        let names = ["b/tileset.json", "b/0/0.glb", "b/0/tileset.json", "a.gml", "c/d.fgb", "c/.e.fgb", "c/f.png"];
        assert_eq!(selected(&names), ["a.gml", "b/tileset.json", "c/d.fgb"]);
        assert_eq!(selected(&["tileset.json", "x.json"]), ["tileset.json"]);
        let unread = select(vec!["a.ifc".to_owned(), "b/c.ifc".to_owned(), "d.json".to_owned()]).unread;
        assert_eq!(unread, [("IFC", "a.ifc".to_owned(), 2)]);
        let unread = select(["d/a.gdb/a01.gdbtable", "d/a.gdb/a02.spx"].map(str::to_owned).to_vec()).unread;
        assert_eq!(unread, [("Esri geodatabase", "d/a.gdb".to_owned(), 1)]);
    }

    #[test]
    fn files_of_other_names_are_told_by_their_content() {
        let folder = insula_test_support::folder::TestFolder::new("wrong-names");
        fs::create_dir_all(folder.path.join("town.gdb")).unwrap();
        fs::write(folder.path.join("town.gdb/a00000001.gdbtable"), "x").unwrap();
        fs::write(folder.path.join("town"), r#"{"type": "FeatureCollection", "features": []}"#).unwrap();
        for (name, end) in [("town", "GeoJSON: not read; rename"), ("town.gdb", "geodatabase: not read; convert")] {
            let found = list(&[folder.path.join(name)], &ReadOptions::default(), &mut BadInputs::new(false));
            let error = found.err().unwrap().to_string();
            assert!(error.contains(end), "{error}");
        }
    }

    /// A ZIP archive of empty files.
    fn empty_entries(names: &[&str]) -> Vec<u8> {
        let (mut bytes, mut directory) = (Vec::new(), Vec::new());
        for name in names {
            let length = [name.len() as u8, 0, 0, 0];
            directory.extend([b"PK\x01\x02\x14\0\x14\0".as_slice(), &[0; 20], &length, &[0; 10]].concat());
            directory.extend((bytes.len() as u32).to_le_bytes());
            directory.extend(name.as_bytes());
            bytes.extend([b"PK\x03\x04\x14\0".as_slice(), &[0; 20], &length, name.as_bytes()].concat());
        }
        let count = (names.len() as u16).to_le_bytes();
        let places = [directory.len() as u32, bytes.len() as u32].map(u32::to_le_bytes).concat();
        [bytes, directory, [b"PK\x05\x06\0\0\0\0".as_slice(), &count, &count, &places, &[0; 2]].concat()].concat()
    }

    #[test]
    fn archives_in_archives_and_their_other_formats_are_named() {
        let folder = insula_test_support::folder::TestFolder::new("nested-archives");
        let path = |name: &str| folder.path.join(name);
        fs::create_dir_all(path("in")).unwrap();
        let pack = |archive: &str, names: &[&str]| fs::write(path(archive), empty_entries(names)).unwrap();
        pack("in/outer.zip", &["inner.zip"]);
        pack("in/doc.zip", &["doc.kml"]);
        let found = |inputs: &[PathBuf]| list(inputs, &ReadOptions::default(), &mut BadInputs::new(false));
        let error = |input: &str| found(&[path(input)]).err().unwrap().to_string();
        assert!(error("in/outer.zip").ends_with(
            "outer.zip/inner.zip: an archive inside an archive: not read; unpack the outer archive and give its files"
        ));
        assert!(error("in/doc.zip").ends_with("convert it with: ogr2ogr -f GPKG doc.gpkg doc.kml"));
        assert!(error("in").contains("doc.kml: KML: not read"));
        pack("in/both.zip", &["a.obj", "more.zip"]);
        let listed = found(&[path("in")]).unwrap();
        assert_eq!((listed.sources.len(), listed.unread.len()), (1, 3), "{:?}", listed.unread);
        assert!(
            found(&[path("in/both.zip")]).unwrap().unread[0]
                .contains("more.zip: an archive inside an archive: not read")
        );
    }

    #[test]
    fn folders_patterns_and_lists_give_each_file_once() {
        let folder = insula_test_support::folder::TestFolder::new("lists");
        let path = |name: &str| folder.path.join(name);
        fs::create_dir_all(path("in/deep")).unwrap();
        for name in ["in/a.obj", "in/deep/b.gml", "in/notes.md", "in/c.ifc"] {
            fs::write(path(name), "x").unwrap();
        }
        fs::write(path("list.txt"), "# comment\n\nin/deep\nin/a.obj\n").unwrap();
        let found = |inputs: &[PathBuf]| {
            let listed = list(inputs, &ReadOptions::default(), &mut BadInputs::new(false))?;
            let strip = |label: &str| label.replace(&folder.path.display().to_string(), "").replace('\\', "/");
            Ok::<_, InputError>(listed.sources.iter().map(|source| strip(&source.label)).collect::<Vec<_>>())
        };
        assert_eq!(found(&[path("in"), path("in/a.obj")]).unwrap(), ["/in/a.obj", "/in/deep/b.gml"]);
        assert_eq!(found(&[path("in/*.obj")]).unwrap(), ["/in/a.obj"]);
        let at_list = PathBuf::from(format!("@{}", path("list.txt").display()));
        assert_eq!(found(&[at_list]).unwrap(), ["/in/deep/b.gml", "/in/a.obj"]);
        assert!(matches!(found(&[path("none*.obj")]), Err(InputError::NoSource { .. })));
        let listed = list(&[path("in")], &ReadOptions::default(), &mut BadInputs::new(false)).unwrap();
        assert!(
            listed.unread.len() == 1 && listed.unread[0].contains("c.ifc: IFC: not read; convert it with: IfcConvert "),
            "{:?}",
            listed.unread
        );
    }

    #[test]
    #[cfg(unix)]
    fn files_beside_a_source_are_read_from_its_folder_and_the_roots_only() {
        use std::os::unix::fs::symlink;
        let folder = insula_test_support::folder::TestFolder::new("siblings");
        let path = |name: &str| folder.path.join(name);
        for name in ["in/sub", "private", "shared"] {
            fs::create_dir_all(path(name)).unwrap();
        }
        for name in ["in/a.obj", "in/own.png", "in/sub/b.png", "private/photo.png", "shared/c.png"] {
            fs::write(path(name), name).unwrap();
        }
        symlink(path("private/photo.png"), path("in/link.png")).unwrap();
        symlink(path("private"), path("in/dir")).unwrap();
        symlink(path("in/a.obj"), path("in/linked.obj")).unwrap();
        let private = path("private/photo.png").display().to_string();
        let shared = path("shared/c.png").display().to_string();
        for (roots, source) in [(vec![], "in/a.obj"), (vec![path("shared")], "in/linked.obj")] {
            let options = ReadOptions { texture_roots: roots.clone(), ..ReadOptions::default() };
            let sources = list(&[path(source)], &options, &mut BadInputs::new(false)).unwrap().sources;
            let read = |name: &str| read_sibling(&*sources[0].files, name, 99);
            assert_eq!(read("own.png").unwrap(), b"in/own.png");
            for name in ["sub/../sub/b.png", "SUB/B.png", "Sub/../sub/B.PNG"] {
                assert_eq!(read(name).unwrap(), b"in/sub/b.png", "{name}");
            }
            assert_eq!(read(&sources[0].name).unwrap(), b"in/a.obj");
            for name in ["../private/photo.png", "link.png", "dir/photo.png", &private] {
                assert_eq!(read(name).unwrap_err().kind(), io::ErrorKind::PermissionDenied, "{name}");
            }
            for name in ["../shared/c.png", &shared] {
                assert_eq!(read(name).is_ok(), !roots.is_empty(), "{name}");
            }
            assert_eq!(read("c.png").is_ok(), !roots.is_empty());
            assert_eq!(read("none.png").unwrap_err().kind(), io::ErrorKind::NotFound);
        }
        let options = ReadOptions { texture_roots: vec![path("none")], ..ReadOptions::default() };
        assert!(list(&[path("in/a.obj")], &options, &mut BadInputs::new(true)).is_err());
    }

    #[test]
    #[cfg(unix)]
    fn links_are_followed_inside_of_the_folder_only() {
        use std::os::unix::fs::symlink;
        let folder = insula_test_support::folder::TestFolder::new("input-links");
        let path = |name: &str| folder.path.join(name);
        fs::create_dir_all(path("in")).unwrap();
        fs::create_dir_all(path("private")).unwrap();
        for name in ["in/a.obj", "private/secret.obj"] {
            fs::write(path(name), name).unwrap();
        }
        symlink(path("private/secret.obj"), path("in/out.obj")).unwrap();
        symlink(path("in/a.obj"), path("in/inside.obj")).unwrap();
        for (input, follow_links) in [("in", false), ("in", true), ("in/*.obj", false), ("in/*.obj", true)] {
            let options = ReadOptions { follow_links, ..ReadOptions::default() };
            let listed = list(&[path(input)], &options, &mut BadInputs::new(false)).unwrap();
            let is_read = listed.sources.iter().any(|source| source.label.ends_with("out.obj"));
            assert_eq!((is_read, listed.sources.len()), (follow_links, 1 + usize::from(follow_links)), "{input}");
            assert_eq!(listed.unread.iter().any(|line| line.contains("out.obj: a link")), !follow_links, "{input}");
        }
        // A pattern goes through folders that are links.
        fs::create_dir_all(path("in/deep")).unwrap();
        fs::write(path("in/deep/b.obj"), "b").unwrap();
        symlink(path("private"), path("in/linked")).unwrap();
        for (input, follow_links, count) in [("in/*/*.obj", false, 1), ("in/*/*.obj", true, 2)] {
            let options = ReadOptions { follow_links, ..ReadOptions::default() };
            let listed = list(&[path(input)], &options, &mut BadInputs::new(false)).unwrap();
            assert_eq!((listed.sources.len(), listed.unread.len()), (count, 2 - count), "{:?}", listed.unread);
        }
        // Who names a link means its file.
        assert_eq!(
            list(&[path("in/out.obj")], &ReadOptions::default(), &mut BadInputs::new(false)).unwrap().sources.len(),
            1
        );
    }
}
