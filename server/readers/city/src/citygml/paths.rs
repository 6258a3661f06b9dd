//! Paths of files that a CityGML file names.

use insula_source::file_names::percent_decoded;

/// A path of a file that the source names, relative to the same folder as the source's own name: with `/`, without
/// percent encoding, and without `..` as far as possible.
pub(super) fn relative_to(source_name: &str, uri: &str) -> String {
    let path = percent_decoded(uri.trim().trim_start_matches("file://")).replace('\\', "/");
    let folder = source_name.rsplit_once('/').map_or("", |(folder, _)| folder);
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    let is_absolute = path.starts_with('/');
    if is_absolute {
        return path;
    }
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." if parts.last().is_some_and(|last| *last != "..") => {
                parts.pop();
            }
            part => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_relative_to_the_source() {
        assert_eq!(relative_to("a.gml", "tex/b.jpg"), "tex/b.jpg");
        assert_eq!(relative_to("udx/bldg/a.gml", "tex\\b%20c.jpg"), "udx/bldg/tex/b c.jpg");
        assert_eq!(relative_to("udx/bldg/a.gml", "../../codelists/x.xml"), "codelists/x.xml");
        assert_eq!(relative_to("a.gml", "./../../codelists/x.xml"), "../../codelists/x.xml");
        assert_eq!(relative_to("a.gml", "/etc/passwd"), "/etc/passwd");
    }
}
