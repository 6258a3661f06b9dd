//! URIs of tiles, as names of files within the source.

use base64::Engine;
use base64::engine::general_purpose::{STANDARD, STANDARD_NO_PAD};
use insula_source::file_names::percent_decoded;

/// The name of the file that `uri` means in a document of the folder `folder` (empty, or without a `/` at the end).
///
/// The result is percent-decoded, with `/` and without `.` and `..`. Queries belong to names only on remote hosts
/// (`is_remote`); a leading `/` means the root of the files, on remote hosts the root of the host and is kept.
/// Fails if the URI names another host or leads out of the files.
pub(crate) fn resolve(folder: &str, uri: &str, is_remote: bool) -> Result<String, &'static str> {
    let uri = uri.trim().split('#').next().unwrap_or_default();
    let (path, query) = uri.split_once('?').map_or((uri, None), |(path, query)| (path, Some(query)));
    let path = path.replace('\\', "/");
    if path.starts_with("//") || has_scheme(&path) {
        return Err("URI names another host");
    }
    let mut name = join(folder, &percent_decoded(&path))?;
    if is_remote {
        if path.starts_with('/') {
            name.insert(0, '/');
        }
        if let Some(query) = query {
            name.push('?');
            name.push_str(query);
        }
    }
    Ok(name)
}

/// The name of the file at a path, which is decoded already, seen from the folder `folder`. Fails as [`resolve`].
pub(crate) fn join(folder: &str, path: &str) -> Result<String, &'static str> {
    if path.contains('\0') || matches!(path.rsplit('/').next(), None | Some("" | "." | "..")) {
        return Err("URI is malformed");
    }
    if path.contains("://") {
        return Err("URI names another host");
    }
    let is_absolute = path.starts_with('/');
    let mut parts: Vec<&str> = if is_absolute { Vec::new() } else { folder.split('/').collect() };
    parts.retain(|part| !part.is_empty());
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop().ok_or("URI leads out of the source's folder")?;
            }
            part => parts.push(part),
        }
    }
    Ok(parts.join("/"))
}

/// Whether a path starts with a scheme, such as `https:`, or with the letter of a drive.
fn has_scheme(path: &str) -> bool {
    let Some((scheme, _)) = path.split_once(':') else { return false };
    scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'))
}

/// The bytes of a `data:` URI; `None` for other URIs. Fails if it is malformed.
pub(crate) fn data_of(uri: &str) -> Option<Result<Vec<u8>, &'static str>> {
    let (kind, data) = uri.trim().strip_prefix("data:")?.split_once(',')?;
    if !kind.ends_with(";base64") {
        return Some(Ok(percent_decoded(data).into_bytes()));
    }
    let data: Vec<u8> = data.bytes().filter(|byte| !byte.is_ascii_whitespace()).collect();
    let decoded = STANDARD.decode(&data).or_else(|_| STANDARD_NO_PAD.decode(&data));
    Some(decoded.map_err(|_| "URI is malformed"))
}

/// The folder of a file, without a `/` at the end; empty for a file at the root.
pub(crate) fn folder_of(name: &str) -> &str {
    let path = name.split('?').next().unwrap_or_default();
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// The path of the file `name` as seen from the folder `folder`.
pub(crate) fn relative_to(folder: &str, name: &str) -> String {
    let parts = |path: &'_ str| path.split('/').filter(|part| !part.is_empty()).map(str::to_owned).collect::<Vec<_>>();
    let (from, to) = (parts(folder), parts(name));
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count().min(to.len().saturating_sub(1));
    let up = std::iter::repeat_n("..", from.len() - common);
    up.chain(to.iter().skip(common).map(String::as_str)).collect::<Vec<_>>().join("/")
}

/// The last part of a name without query and extension.
pub(crate) fn stem(name: &str) -> &str {
    let path = name.split('?').next().unwrap_or_default();
    let last = path.rsplit('/').next().unwrap_or_default();
    last.split_once('.').map_or(last, |(stem, _)| if stem.is_empty() { last } else { stem })
}

/// The extension of a name in lower case, without query and without `.gz`; empty if there is none.
pub(crate) fn extension(name: &str) -> String {
    let path = name.split(['?', '#']).next().unwrap_or_default().to_ascii_lowercase();
    let path = path.strip_suffix(".gz").unwrap_or(&path);
    let last = path.rsplit('/').next().unwrap_or_default();
    last.rsplit_once('.').map_or(String::new(), |(_, extension)| extension.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_relative_decoded_and_normal() {
        let cases = [
            ("", "a.b3dm", "a.b3dm"),
            ("x/y", "../a%20b/./c.glb?v=1#f", "x/a b/c.glb"),
            ("x", "/t/c.glb", "t/c.glb"),
            ("x", "tiles\\1.glb", "x/tiles/1.glb"),
            ("x", "%zz%2", "x/%zz%2"),
            ("x", "%ff.glb", "x/%ff.glb"),
        ];
        for (folder, uri, expected) in cases {
            assert_eq!(resolve(folder, uri, false).as_deref(), Ok(expected), "{uri}");
        }
        assert_eq!(resolve("x", "a.glb?key=%20", true).as_deref(), Ok("x/a.glb?key=%20"));
        assert_eq!(resolve("x", "/v1/a.glb", true).as_deref(), Ok("/v1/a.glb"));
    }

    #[test]
    fn names_outside_of_the_files_are_refused() {
        let uris = [
            "../../a", "..%2F..%2Fa", "https://example.org/a", "//host/a", "file:///etc/passwd", "C:\\a", "", ".",
            "..", "?", "a%00b",
        ];
        for uri in uris {
            assert!(resolve("x", uri, false).is_err(), "{uri}");
        }
    }

    #[test]
    fn data_uris_are_unpacked() {
        assert_eq!(data_of("data:application/octet-stream;base64,AQID"), Some(Ok(vec![1, 2, 3])));
        assert_eq!(data_of("data:text/plain,a%20b"), Some(Ok(b"a b".to_vec())));
        assert_eq!(data_of("data:;base64,AQI"), Some(Ok(vec![1, 2])));
        assert!(matches!(data_of("data:;base64,*"), Some(Err(_))));
        assert_eq!(data_of("a.glb"), None);
    }

    #[test]
    fn parts_of_names() {
        assert_eq!(folder_of("a/b/c.glb?x=/y"), "a/b");
        assert_eq!(folder_of("c.glb"), "");
        assert_eq!(relative_to("a/b", "a/b/c.png"), "c.png");
        assert_eq!(relative_to("a/b", "a/x/c.png"), "../x/c.png");
        assert_eq!(relative_to("", "a/c.png"), "a/c.png");
        assert_eq!(relative_to("a", "a"), "../a");
        assert_eq!(stem("x/data68.b3dm?q"), "data68");
        assert_eq!(extension("x/T.B3DM.gz"), "b3dm");
        assert_eq!(extension("x.y/tile?a.json"), "");
    }
}
