//! Links that open a view: `insula://host:port/v1/cities/NAME?camera=X,Y,Z,AZIMUTH,PITCH,FOV&time=...`.
//!
//! In: a link that anyone may have made, or a view. Out: [`Link`], or text. Next: `commands::view`, the clipboard.

use crate::{
    commands::connect::Place,
    error::{ClientError, Result},
};
use glam::DVec3;
use insula_viewer::{
    camera::Camera,
    sun::{Daylight, SunTime, parse_time},
};

/// How links begin; others are plain addresses.
const SCHEME: &str = "insula://";
/// Longest link that is read.
const MOST_BYTES: usize = 2048;
/// Farthest coordinate.
const MOST_M: f64 = 1e10;

/// What a link or an address asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// An address, as `commands::connect` takes it.
    pub address: String,
    /// Where to look from.
    pub camera: Option<Camera>,
    /// The light.
    pub time: Option<SunTime>,
}

impl Link {
    /// Reads a link; what does not begin with `insula://` is an address without a view, and not looked at.
    pub fn parse(text: &str) -> Result<Self> {
        if !text.get(..SCHEME.len()).is_some_and(|scheme| scheme.eq_ignore_ascii_case(SCHEME)) {
            return Ok(Self { address: text.to_owned(), camera: None, time: None });
        }
        let wrong = |why: &str| {
            // A link from elsewhere may hold anything: only its beginning is repeated, and nothing that moves a cursor.
            let shown: String = text.chars().take(80).filter(|c| !c.is_control()).collect();
            ClientError::Usage(format!(
                "{shown}: not a link ({why}): write insula://host:port/v1/cities/NAME?camera=..."
            ))
        };
        if text.len() > MOST_BYTES {
            return Err(wrong("too long"));
        }
        if text[SCHEME.len()..].starts_with('/') {
            return Err(wrong("no host"));
        }
        // As http its host is checked by the rules of the web.
        let url = url::Url::parse(&format!("http://{}", &text[SCHEME.len()..])).map_err(|e| wrong(&e.to_string()))?;
        if !url.username().is_empty() || url.password().is_some() {
            return Err(wrong("it names a user"));
        }
        let host = url.host_str().filter(|host| !host.is_empty()).ok_or_else(|| wrong("no host"))?;
        // Neither steps up nor hidden letters: where a link leads is what one reads.
        let typed = text.split('?').next().unwrap_or_default();
        if typed.contains("..") || typed.contains('%') {
            return Err(wrong("its path is not plain"));
        }
        let mut link = Self { address: String::new(), camera: None, time: None };
        let mut scheme = "http";
        for (name, value) in url.query_pairs() {
            match &*name {
                "camera" => link.camera = Some(camera(&value).ok_or_else(|| wrong("camera"))?),
                "time" => link.time = Some(parse_time(&value).map_err(|e| wrong(&e))?),
                "tls" => scheme = if value == "1" { "https" } else { "http" },
                _ => {}
            }
        }
        let port = url.port().map(|port| format!(":{port}")).unwrap_or_default();
        link.address = format!("{scheme}://{host}{port}{}", url.path());
        match Place::parse(&link.address) {
            Ok(Place::Server { .. } | Place::Web(_)) => {}
            _ => return Err(wrong("its path names no city")),
        }
        Ok(link)
    }
}

/// The link that opens a view of a city at `address` (`http://host:port/v1/cities/NAME`, or of a folder on a plain host); none
/// for a city of this machine.
pub fn link(address: &str, camera: &Camera, daylight: &Daylight) -> Option<String> {
    let (host, tls) = match (address.strip_prefix("http://"), address.strip_prefix("https://")) {
        (Some(host), _) => (host, ""),
        (None, Some(host)) => (host, "&tls=1"),
        _ => return None,
    };
    let p = camera.position;
    let (yaw, pitch) = camera.angles();
    let azimuth = (90.0 - yaw.to_degrees()).rem_euclid(360.0);
    let time = match daylight.fixed_bearing {
        Some(_) => String::new(),
        None => format!("&time={}", daylight.time_text()),
    };
    Some(format!(
        "{SCHEME}{host}?camera={:.3},{:.3},{:.3},{azimuth:.4},{:.4},{:.3}{time}{tls}",
        p.x,
        p.y,
        p.z,
        pitch.to_degrees(),
        camera.fov_y_rad.to_degrees(),
    ))
}

fn camera(text: &str) -> Option<Camera> {
    let numbers: Vec<f64> = text.split(',').map(|n| n.trim().parse().ok()).collect::<Option<_>>()?;
    let [x, y, z, azimuth, pitch, fov] = numbers[..] else { return None };
    let near = [x, y, z].iter().all(|v| v.abs() < MOST_M);
    if !near || !azimuth.is_finite() || !(-90.0..=90.0).contains(&pitch) || !(1.0..=170.0).contains(&fov) {
        return None;
    }
    let yaw = (90.0 - azimuth).to_radians();
    Some(Camera::from_angles(DVec3::new(x, y, z), yaw, pitch.to_radians(), fov.to_radians()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_viewer::sun::SunOptions;

    fn daylight(args: &SunOptions) -> Daylight {
        Daylight::new(args, &insula_viewer::test_support::manifest(0))
    }

    #[test]
    fn a_copied_link_opens_the_same_view() {
        let light =
            daylight(&SunOptions { time: Some(parse_time("2024-06-21T17:00").unwrap()), ..SunOptions::default() });
        for (yaw, pitch) in [(0.0, 0.0), (3.0, -1.5), (-2.5, 0.7), (1.6, 1.55)] {
            let camera = Camera::from_angles(DVec3::new(386_495.204, -3_947_101.5, 60.25), yaw, pitch, 1.1);
            for base in ["http://h.example:7700", "https://h.example", "http://[::1]:7700"] {
                let link = Link::parse(&link(&format!("{base}/v1/cities/tokyo"), &camera, &light).unwrap()).unwrap();
                assert_eq!(link.address, format!("{base}/v1/cities/tokyo"));
                assert_eq!(link.time, Some(parse_time("2024-06-21T17:00").unwrap()));
                let back = link.camera.unwrap();
                assert!((back.position - camera.position).length() < 2e-3, "{back:?}");
                assert!((back.forward - camera.forward).length() < 1e-5 && (back.up - camera.up).length() < 1e-5);
                assert!((back.fov_y_rad - camera.fov_y_rad).abs() < 1e-4);
            }
        }
        let camera = Camera::from_angles(DVec3::ZERO, 0.0, 0.0, 1.0);
        assert_eq!(link("", &camera, &light), None);
        let fixed = daylight(&SunOptions {
            bearing: Some(insula_viewer::sun::parse_bearing("1,2").unwrap()),
            ..SunOptions::default()
        });
        assert!(!link("http://h/v1/cities/a", &camera, &fixed).unwrap().contains("time"));
    }

    #[test]
    fn links_that_mean_no_good_are_refused() {
        let long = format!("insula://h/v1/cities/a?x={}", "y".repeat(4000));
        for wrong in [
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
            &long,
        ] {
            let error = Link::parse(wrong).unwrap_err();
            assert!(error.exit_code() == 2 && error.to_string().len() < 400, "{wrong}");
        }
        let told = Link::parse("insula://h\u{1b}[2J/x").unwrap_err().to_string();
        assert!(!told.contains('\u{1b}'));
    }

    #[test]
    fn addresses_are_left_alone_and_links_may_say_less() {
        let plain = Link::parse("http://h:1/v1/cities/a").unwrap();
        assert_eq!((plain.address.as_str(), plain.camera), ("http://h:1/v1/cities/a", None));
        let bare = Link::parse("INSULA://h:1/v1/cities/a?colour=blue").unwrap();
        assert_eq!((bare.address.as_str(), bare.camera, bare.time), ("http://h:1/v1/cities/a", None, None));
        let files = Link::parse("insula://h/maps/delft/?tls=1").unwrap();
        assert_eq!(files.address, "https://h/maps/delft/");
    }
}
