//! View links: `insula://host:port/v1/cities/NAME?camera=X,Y,Z,AZIMUTH,PITCH,FOV&time=...&look=...&object=ID`.
//!
//! A link may come from anybody, so it is checked strictly.

use crate::error::{ClientError, Result};
use crate::stream::location::CityLocation;
use insula_shaders::look::Look;
use insula_viewer::camera::Camera;
use insula_viewer::camera_text;
use insula_viewer::sun::{Daylight, SunTime, parse_time};
use std::borrow::Cow;
use std::ffi::OsStr;

/// Prefix of view links. Any other text is a plain city location.
const SCHEME: &str = "insula://";
/// Length of the longest accepted link.
const MAX_BYTES: usize = 2048;

/// A city, and optionally a view of it.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewLink {
    pub location: CityLocation,
    pub camera: Option<Camera>,
    pub time: Option<SunTime>,
    /// How the city is shown.
    pub look: Option<Look>,
    /// Number of the object that is selected.
    pub object: Option<u32>,
}

impl ViewLink {
    /// Parses a place as any command takes it: a view link, or the location of a city. Fails if a link is malformed or names a
    /// user, or if the place cannot be a city.
    pub fn parse(place: impl AsRef<OsStr>) -> Result<Self> {
        let place = place.as_ref();
        let text = &*place.to_string_lossy();
        if !text.get(..SCHEME.len()).is_some_and(|scheme| scheme.eq_ignore_ascii_case(SCHEME)) {
            return Self::of_address(place);
        }
        let invalid = |why: &str| {
            // The link may be hostile: only its beginning is printed, without control characters.
            let shown: String = text.chars().take(80).filter(|c| !c.is_control()).collect();
            ClientError::Usage(format!(
                "{shown}: not a view link ({why}): write insula://host:port/v1/cities/NAME?camera=..."
            ))
        };
        let url = parse_url(text).map_err(|why| invalid(&why))?;
        let host = url.host_str().filter(|host| !host.is_empty()).ok_or_else(|| invalid("no host"))?;
        let scheme =
            if url.query_pairs().any(|(name, value)| name == "tls" && value == "1") { "https" } else { "http" };
        let port = url.port().map(|port| format!(":{port}")).unwrap_or_default();
        let location = CityLocation::parse(format!("{scheme}://{host}{port}{}", url.path()))
            .map_err(|_| invalid("its path names no city"))?;
        Self::at(location).with_view(url.query_pairs()).map_err(|why| invalid(&why))
    }

    fn at(location: CityLocation) -> Self {
        Self { location, camera: None, time: None, look: None, object: None }
    }

    /// The location of a city, or the address of a page as browsers show it: its hash has the view, of which the page leaves out what is
    /// malformed.
    fn of_address(place: &OsStr) -> Result<Self> {
        let text = place.to_string_lossy();
        match text.split_once('#') {
            Some((address, view)) if address.contains("://") => {
                let plain = Self::at(CityLocation::parse(address)?);
                Ok(plain.clone().with_view(url::form_urlencoded::parse(view.as_bytes())).unwrap_or(plain))
            }
            _ => Ok(Self::at(CityLocation::parse(place)?)),
        }
    }

    /// With the view of a query. Fails with the reason if a value is malformed.
    fn with_view<'a>(
        mut self,
        query: impl Iterator<Item = (Cow<'a, str>, Cow<'a, str>)>,
    ) -> std::result::Result<Self, String> {
        for (name, value) in query {
            match &*name {
                "camera" => self.camera = Some(camera_text::parse(&value).ok_or("invalid camera")?),
                "time" => self.time = Some(parse_time(&value)?),
                "look" => self.look = Some(Look::of_word(&value).ok_or("invalid look")?),
                "object" => self.object = Some(value.parse().map_err(|_| "invalid object")?),
                _ => {}
            }
        }
        Ok(self)
    }
}

/// The link as an HTTP URL, whose host follows the rules of the web. Fails with a reason.
fn parse_url(link: &str) -> std::result::Result<url::Url, String> {
    if link.len() > MAX_BYTES {
        return Err("too long".into());
    }
    if link[SCHEME.len()..].starts_with('/') {
        return Err("no host".into());
    }
    let url = url::Url::parse(&format!("http://{}", &link[SCHEME.len()..])).map_err(|e| e.to_string())?;
    if !url.username().is_empty() || url.password().is_some() {
        return Err("it names a user".into());
    }
    // Without parent folders and escapes, the link leads where its text says.
    let path = link.split('?').next().unwrap_or_default();
    if path.contains("..") || path.contains('%') {
        return Err("its path contains .. or %".into());
    }
    Ok(url)
}

/// The link to a view of the city at `address`, with an object selected (`http://host:port/v1/cities/NAME`, or the URL of a web folder). `None` for a
/// city on this machine.
pub fn format_link(address: &str, camera: &Camera, daylight: &Daylight, object: Option<u32>) -> Option<String> {
    let (host, tls) = match (address.strip_prefix("http://"), address.strip_prefix("https://")) {
        (Some(host), _) => (host, ""),
        (None, Some(host)) => (host, "&tls=1"),
        _ => return None,
    };
    let time = match daylight.fixed_bearing {
        Some(_) => String::new(),
        None => format!("&time={}", daylight.time_text()),
    };
    let look = if daylight.look == Look::default() { "".into() } else { format!("&look={}", daylight.look.word()) };
    let object = object.map(|id| format!("&object={id}")).unwrap_or_default();
    Some(format!("{SCHEME}{host}?camera={}{time}{look}{object}{tls}", camera_text::format(camera)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use insula_viewer::sun::SunOptions;

    fn daylight(options: &SunOptions) -> Daylight {
        Daylight::new(options, &insula_test_support::small_city::empty_manifest(0))
    }

    #[test]
    fn a_formatted_link_parses_to_the_same_view() {
        let light = daylight(&SunOptions {
            time: Some(parse_time("2024-06-21T17:00").unwrap()),
            look: Look::Paper,
            ..SunOptions::default()
        });
        for (yaw, pitch) in [(0.0, 0.0), (3.0, -1.5), (-2.5, 0.7), (1.6, 1.55)] {
            let camera = Camera::from_angles(DVec3::new(386_495.204, -3_947_101.5, 60.25), yaw, pitch, 1.1);
            for base in ["http://h.example:7700", "https://h.example", "http://[::1]:7700"] {
                let text = format_link(&format!("{base}/v1/cities/tokyo"), &camera, &light, Some(7)).unwrap();
                let link = ViewLink::parse(&text).unwrap();
                assert_eq!(link.location.to_string(), format!("{base}/v1/cities/tokyo"));
                assert_eq!(link.time, Some(parse_time("2024-06-21T17:00").unwrap()));
                assert_eq!((link.object, link.look), (Some(7), Some(Look::Paper)));
                let parsed = link.camera.unwrap();
                assert!((parsed.position - camera.position).length() < 2e-3, "{parsed:?}");
                assert!((parsed.forward - camera.forward).length() < 1e-5 && (parsed.up - camera.up).length() < 1e-5);
                assert!((parsed.fov_y_rad - camera.fov_y_rad).abs() < 1e-4);
            }
        }
        let camera = Camera::from_angles(DVec3::ZERO, 0.0, 0.0, 1.0);
        assert_eq!(format_link("", &camera, &light, None), None);
        let fixed = daylight(&SunOptions {
            bearing: Some(insula_viewer::sun::parse_bearing("1,2").unwrap()),
            ..SunOptions::default()
        });
        assert!(!format_link("http://h/v1/cities/a", &camera, &fixed, None).unwrap().contains("time"));
    }

    #[test]
    fn malformed_and_hostile_links_are_refused() {
        let long = format!("insula://h/v1/cities/a?x={}", "y".repeat(4000));
        for invalid in [
            "insula://",
            "insula:///v1/cities/a",
            "insula://user:secret@h/v1/cities/a",
            "insula://h/v1/cities/../../etc/passwd",
            "insula://h/v1/cities/a/b",
            "insula://h/v1/cities/%2e%2e",
            "insula://h:99999/v1/cities/a",
            "insula://h h/v1/cities/a",
            "insula://h/v1/cities/a?camera=1,2,3",
            "insula://h/v1/cities/a?camera=NaN,2,3,0,0,60",
            "insula://h/v1/cities/a?camera=1,2,inf,0,0,60",
            "insula://h/v1/cities/a?camera=1,2,3,0,91,60",
            "insula://h/v1/cities/a?camera=1,2,3,0,0,0",
            "insula://h/v1/cities/a?camera=1,2,3,0,0,60,7",
            "insula://h/v1/cities/a?time=then",
            "insula://h/v1/cities/a?object=-1",
            &long,
        ] {
            let error = ViewLink::parse(invalid).unwrap_err();
            assert!(error.exit_code() == 2 && error.to_string().len() < 400, "{invalid}");
        }
        let message = ViewLink::parse("insula://h\u{1b}[2J/x").unwrap_err().to_string();
        assert!(!message.contains('\u{1b}'));
    }

    #[test]
    fn plain_addresses_are_unchanged_and_a_view_is_optional() {
        let plain = ViewLink::parse("http://h:1/v1/cities/a").unwrap();
        assert_eq!((plain.location.to_string().as_str(), plain.camera), ("http://h:1/v1/cities/a", None));
        let bare = ViewLink::parse("INSULA://h:1/v1/cities/a?colour=blue").unwrap();
        assert_eq!((&bare.location, bare.camera, bare.time), (&plain.location, None, None));
        // As a browser shows a page. What is malformed in its hash is left out.
        let page = ViewLink::parse("http://h:1/cities/a#camera=1,2,3,0,0,60&time=2024-06-21T17:00").unwrap();
        assert_eq!(page.location, CityLocation::WebFolder("http://h:1/cities/a".into()));
        assert!(page.camera.is_some() && page.time.is_some());
        assert_eq!(ViewLink::parse("http://h:1/v1/cities/a#camera=1,2").unwrap(), plain);
        let folder = ViewLink::parse("insula://h/maps/delft/?tls=1").unwrap();
        assert_eq!(folder.location, CityLocation::WebFolder("https://h/maps/delft".into()));
    }
}
