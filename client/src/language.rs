//! The language of the reader, in which labels of attributes are shown.

/// Variables that name it, the first one that is set counts: POSIX.
const VARIABLES: [&str; 3] = ["LC_ALL", "LC_MESSAGES", "LANG"];

/// The code of the language that the environment asks for, such as `de_AT`; empty if it asks for none.
pub(crate) fn of_environment() -> String {
    let values = VARIABLES.iter().filter_map(|name| std::env::var(name).ok());
    code_of(values)
}

fn code_of(mut values: impl Iterator<Item = String>) -> String {
    let value = values.find(|value| !value.is_empty()).unwrap_or_default();
    let code = value.split(['.', '@']).next().unwrap_or_default();
    if matches!(code, "C" | "POSIX") { String::new() } else { code.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_variable_that_is_set_counts() {
        let code = |values: &[&str]| code_of(values.iter().map(|value| (*value).to_owned()));
        assert_eq!(code(&["", "de_AT.UTF-8", "fr_FR"]), "de_AT");
        assert_eq!((code(&["C.UTF-8"]), code(&["sr@latin"]), code(&[])), (String::new(), "sr".into(), String::new()));
    }
}
