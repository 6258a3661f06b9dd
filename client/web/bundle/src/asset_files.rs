//! The files of the page by name, and the hash of all of them.

use crate::error::BundleError;
use std::{collections::BTreeMap, fs, path::Path};

/// Content by name. All files share one folder, so that relative imports work.
pub(crate) type AssetFiles = BTreeMap<String, Vec<u8>>;

/// Digits of the hash in addresses.
const HASH_DIGITS: usize = 16;

/// Reads the files of a folder. Hidden ones are left out.
pub(crate) fn read_page(folder: &Path) -> Result<AssetFiles, BundleError> {
    let mut files = AssetFiles::new();
    for entry in fs::read_dir(folder).map_err(BundleError::io(folder))? {
        let path = entry.map_err(BundleError::io(folder))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_file() && !name.starts_with('.') {
            let content = fs::read(&path).map_err(BundleError::io(&path))?;
            add(&mut files, name, content)?;
        }
    }
    Ok(files)
}

/// Adds a file. Fails if its name is taken, or cannot be part of an address.
pub(crate) fn add(files: &mut AssetFiles, name: String, content: Vec<u8>) -> Result<(), BundleError> {
    let is_allowed = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"._-".contains(&byte);
    let is_name = name.len() <= 64 && !name.starts_with('.') && name.bytes().all(is_allowed);
    let is_compressed = name.ends_with(".br") || name.ends_with(".gz");
    if !is_name || is_compressed {
        let rule = "use at most 64 of a-z, 0-9, ., _ and -, and no .br or .gz at the end";
        return Err(BundleError::Asset(format!("{name:?} cannot be the name of an asset: {rule}")));
    }
    if files.contains_key(&name) {
        return Err(BundleError::Asset(format!("{name} comes from the module and from the page: rename one")));
    }
    files.insert(name, content);
    Ok(())
}

/// 16 hexadecimal digits that change with any name or content.
pub(crate) fn hash(files: &AssetFiles) -> String {
    let mut hasher = blake3::Hasher::new();
    for (name, content) in files {
        for part in [name.as_bytes(), content] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part);
        }
    }
    hasher.finalize().to_hex()[..HASH_DIGITS].to_owned()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may panic")]
mod tests {
    use super::*;

    fn files(list: &[(&str, &str)]) -> AssetFiles {
        list.iter().map(|(name, content)| ((*name).to_owned(), content.as_bytes().to_vec())).collect()
    }

    #[test]
    fn hash_changes_with_names_and_contents() {
        let hashes = [&[("a", "b")][..], &[("a", "c")], &[("ab", "")], &[("a", ""), ("b", "")], &[]].map(files);
        let distinct: std::collections::BTreeSet<_> = hashes.iter().map(hash).collect();
        assert_eq!(distinct.len(), hashes.len());
        assert!(distinct.iter().all(|hash| hash.len() == 16 && hash.bytes().all(|digit| digit.is_ascii_hexdigit())));
    }

    #[test]
    fn only_names_that_addresses_can_have_are_taken() {
        for name in ["A.js", "a b", "../a", ".hidden", "a.br", "a.js.gz", &"a".repeat(65)] {
            assert!(add(&mut AssetFiles::new(), name.to_owned(), Vec::new()).is_err(), "{name}");
        }
        let mut files = files(&[("app.js", "")]);
        assert!(add(&mut files, "insula_web_bg.wasm".into(), Vec::new()).is_ok());
        assert!(add(&mut files, "app.js".into(), Vec::new()).is_err());
    }
}
