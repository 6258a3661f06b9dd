//! What an office sets of its pages: name, logo, colour, imprint and first views.

use insula_protocol::name::is_name;
use std::path::PathBuf;

const MAX_TEXT_BYTES: usize = 512;
const CAMERA_NUMBERS: usize = 6;

/// The looks of the pages. `keys` documents each setting.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SiteConfig {
    pub title: String,
    pub logo: Option<PathBuf>,
    pub accent: String,
    pub imprint: String,
    pub start: Vec<String>,
    pub proposals: Option<PathBuf>,
}

impl SiteConfig {
    /// The cities that have a first view.
    pub fn cities(&self) -> impl Iterator<Item = &str> {
        self.start.iter().filter_map(|view| view.split_once('=')).map(|(name, _)| name)
    }

    /// The camera with which the page of a city begins, if one is set.
    pub fn start_of(&self, city: &str) -> Option<&str> {
        self.start.iter().filter_map(|view| view.split_once('=')).find(|(name, _)| *name == city).map(|(_, view)| view)
    }
}

pub(super) fn check_title(text: &str) -> Result<(), String> {
    let is_valid = text.len() <= MAX_TEXT_BYTES && !text.chars().any(char::is_control);
    if is_valid { Ok(()) } else { Err(format!("a title has one line of at most {MAX_TEXT_BYTES} bytes")) }
}

pub(super) fn check_accent(text: &str) -> Result<(), String> {
    let digits = text.strip_prefix('#').unwrap_or_default();
    let is_valid = text.is_empty() || digits.len() == 6 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    if is_valid { Ok(()) } else { Err(format!("{text:?} is not a colour such as \"#0b57a4\"")) }
}

pub(super) fn check_imprint(text: &str) -> Result<(), String> {
    let is_web = text.starts_with("https://") || text.starts_with("http://");
    let is_plain = text.len() <= MAX_TEXT_BYTES && text.bytes().all(|byte| byte.is_ascii_graphic());
    if text.is_empty() || is_web && is_plain {
        Ok(())
    } else {
        Err(format!("{text:?} is not an address such as \"https://example.org/imprint\""))
    }
}

pub(super) fn checked_views(views: &[String]) -> Result<Vec<String>, String> {
    let is_view = |view: &&String| {
        let Some((name, camera)) = view.split_once('=') else { return false };
        let numbers: Vec<_> = camera.split(',').map(|number| number.trim().parse::<f64>()).collect();
        let are_finite = numbers.iter().all(|number| number.as_ref().is_ok_and(|number| number.is_finite()));
        is_name(name) && numbers.len() == CAMERA_NUMBERS && are_finite
    };
    match views.iter().find(|view| !is_view(view)) {
        Some(invalid) => Err(format!("{invalid:?} is not CITY=X,Y,Z,AZIMUTH,PITCH,FOV, as links to views have it")),
        None => Ok(views.to_vec()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_pages_show_is_checked() {
        for (check, valid, invalid) in [
            (check_title as fn(&str) -> Result<(), String>, "Stadt Ober-Ünder <3D>", "a\nb"),
            (check_accent, "#0B57a4", "red;}"),
            (check_imprint, "https://example.org/a?b=c", "javascript:alert(1)"),
        ] {
            assert!(check("").is_ok() && check(valid).is_ok() && check(invalid).is_err(), "{valid} {invalid}");
        }
        let views = |view: &str| checked_views(&[view.to_owned()]);
        assert!(views("delft=84000,447000,300,10,-20,60").is_ok());
        for invalid in
            ["delft", "delft=1,2,3", "Delft=1,2,3,4,5,6", "delft=1,2,3,4,5,inf", "delft=1,2,3,4,5,\"", "=1,2,3,4,5,6"]
        {
            assert!(views(invalid).is_err(), "{invalid}");
        }
        let site = SiteConfig { start: vec!["a=1,2,3,4,5,6".into()], ..SiteConfig::default() };
        assert_eq!((site.start_of("a"), site.start_of("b")), (Some("1,2,3,4,5,6"), None));
    }
}
