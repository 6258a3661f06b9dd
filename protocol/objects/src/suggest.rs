//! The most similar of some names, for error messages.

use strsim::generic_levenshtein;

/// Longer names get no suggestion.
const MAX_CHARS: usize = 64;

/// The candidate of the smallest edit distance, upper and lower case being equal. `None` if all differ by more than a third of the
/// name, and by more than two characters.
pub(crate) fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    nearest_few(name, candidates, 1).first().copied()
}

/// The same of at most `count` candidates, the nearest first.
pub(crate) fn nearest_few<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>, count: usize) -> Vec<&'a str> {
    let name = folded(name);
    if name.len() > MAX_CHARS {
        return Vec::new();
    }
    let limit = (name.len() / 3).max(2);
    let distance = |candidate: &'a str| {
        let folded = folded(candidate);
        let is_near = folded.len().abs_diff(name.len()) <= limit;
        is_near.then(|| (generic_levenshtein(&name, &folded), candidate)).filter(|(distance, _)| *distance <= limit)
    };
    let mut near: Vec<(usize, &str)> = candidates.into_iter().filter_map(distance).collect();
    near.sort_by_key(|(distance, _)| *distance);
    near.into_iter().take(count).map(|(_, candidate)| candidate).collect()
}

fn folded(name: &str) -> Vec<char> {
    name.chars().flat_map(char::to_lowercase).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_similar_names_are_suggested() {
        let names = ["yearOfConstruction", "height", "kind"];
        assert_eq!(nearest("YearOfConstuction", names), Some("yearOfConstruction"));
        assert_eq!(nearest("hieght", names), Some("height"));
        assert_eq!((nearest("owner", names), nearest(&"x".repeat(65), names), nearest("", [])), (None, None, None));
    }
}
