//! Names of cities, which stand in addresses and are those of folders.

/// Whether `name` is valid in URLs and as a folder name: 1 to 64 characters of a-z, 0-9, `_` and `-`.
pub fn is_name(name: &str) -> bool {
    (1..=64).contains(&name.len())
        && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_' || b == b'-')
}

/// Turns any text into a name that [`is_name`] accepts. Texts of other alphabets end with a number of their own, so that two cities keep
/// two names.
pub fn to_name(text: &str) -> String {
    /// Latin letters end here, of which enough is left to tell names apart.
    const END_OF_LATIN: char = '\u{24f}';
    let is_foreign = text.chars().any(|c| c.is_alphanumeric() && c > END_OF_LATIN);
    if !is_foreign {
        return plain_name(text);
    }
    // FNV-1a.
    let hash = text.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    let plain = plain_name(text);
    format!("{}-{hash:08x}", plain[..plain.len().min(55)].trim_end_matches('-'))
}

/// The letters and digits of ASCII, or `city` without any.
fn plain_name(text: &str) -> String {
    let mut name: String = text
        .to_lowercase()
        .chars()
        .map(|c| if c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' { c } else { '-' })
        .take(64)
        .collect();
    while name.contains("--") {
        name = name.replace("--", "-");
    }
    let name = name.trim_matches('-').to_owned();
    if name.is_empty() { "city".into() } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_text_has_a_name_and_other_alphabets_have_different_ones() {
        assert_eq!(["Den Haag", "", "..", "K\u{f6}ln"].map(to_name), ["den-haag", "city", "city", "k-ln"]);
        let [tokyo, osaka, both] = ["\u{6771}\u{4eac}", "\u{5927}\u{962a}", "Tokyo \u{6771}\u{4eac}"].map(to_name);
        assert!(tokyo.starts_with("city-") && both.starts_with("tokyo-") && tokyo != osaka, "{tokyo} {osaka} {both}");
        let long = to_name(&"\u{6771}x".repeat(500));
        assert!([tokyo, osaka, both, long].iter().all(|name| is_name(name)));
    }
}
