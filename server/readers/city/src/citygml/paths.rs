//! Paths of files that a CityGML file names.

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

/// Text with `%20` and the like as what they stand for. Anything that is no such code stays.
fn percent_decoded(text: &str) -> String {
    if !text.contains('%') {
        return text.to_owned();
    }
    let bytes = text.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut index = 0;
    while let Some(byte) = bytes.get(index) {
        let code =
            bytes.get(index + 1..index + 3).filter(|code| *byte == b'%' && code.iter().all(u8::is_ascii_hexdigit));
        let code = code.and_then(|code| std::str::from_utf8(code).ok());
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => {
                decoded.push(byte);
                index += 3;
            }
            None => {
                decoded.push(*byte);
                index += 1;
            }
        }
    }
    String::from_utf8(decoded).unwrap_or_else(|_| text.to_owned())
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

    #[test]
    fn decodes_percent_codes() {
        assert_eq!(percent_decoded("%E6%A8%AA%"), "横%");
        assert_eq!(percent_decoded("100%zz"), "100%zz");
        assert_eq!(percent_decoded("%FF"), "%FF");
    }
}
