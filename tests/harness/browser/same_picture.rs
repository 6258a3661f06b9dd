//! The same view drawn by the native client and by a browser.

use super::city_page::CityPage;
use super::{Browser, PageOptions};
use crate::programs::{program, run};
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use image::RgbImage;
use insula_protocol::Manifest;
use insula_viewer::camera::Camera;
use insula_viewer::camera_text;
use std::net::SocketAddr;
use std::path::Path;
use std::process::Command;

/// Greatest difference of a channel of two equal pixels.
const SAME_COLOUR: u8 = 2;
/// Without doubt about the day's light.
pub const TIME: &str = "2024-06-21T14:00";

/// A view of a city on a server.
#[derive(Debug, Clone)]
pub struct SharedView {
    pub server: SocketAddr,
    /// The city's name in URLs.
    pub city: String,
    /// `X,Y,Z,AZIMUTH,PITCH,FOV`.
    pub camera: String,
    pub size_px: [u32; 2],
}

/// Four cameras over the part of a city where most of it stands: high and far, low and near.
pub fn cameras(manifest: &Manifest) -> Result<Vec<String>> {
    let [low, high] = manifest.focus.map(|[x, y]| DVec3::new(x, y, manifest.ground_z_m));
    let (middle, size) = ((low + high) / 2.0, (high - low).truncate());
    let place = |(turn, away, up): (f64, f64, f64)| {
        let angle = turn * std::f64::consts::TAU;
        let position =
            middle + DVec3::new(angle.cos() * away * size.x, angle.sin() * away * size.y, up * size.max_element());
        let camera = Camera::look_at(position, middle, DVec3::Z, 50f64.to_radians());
        camera.map(|camera| camera_text::format(&camera)).context("no direction")
    };
    [(0.8, 0.8, 0.5), (0.15, 0.6, 0.25), (0.4, 0.35, 0.18), (0.65, 0.2, 0.12)].into_iter().map(place).collect()
}

/// The native picture by the CPU, without a caption.
pub fn native(view: &SharedView, folder: &Path) -> Result<RgbImage> {
    native_with(view, folder, &[])
}

/// The same with options of `insula snapshot`.
pub fn native_with(view: &SharedView, folder: &Path, options: &[&str]) -> Result<RgbImage> {
    let out = folder.join("native.png");
    let [width, height] = view.size_px;
    let place = format!("insula://{}/v1/cities/{}?camera={}&time={TIME}", view.server, view.city, view.camera);
    let mut command = Command::new(program("insula")?);
    command.args(["snapshot", "--adapter", "cpu", "--no-caption", "--server", &place]);
    command
        .args(options)
        .args(["--size", &format!("{width}x{height}"), "--out"])
        .arg(&out)
        .env("XDG_CACHE_HOME", folder);
    let output = run(&mut command)?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(image::open(out)?.to_rgb8())
}

/// The browser's picture by an adapter, `cpu` or `gpu`, in a page of its size. Fails if the page draws with the other one only.
pub fn in_browser(browser: &Browser, view: &SharedView, adapter: &str) -> Result<RgbImage> {
    let options = PageOptions { size: view.size_px, ..PageOptions::default() };
    let url = format!("http://{}/cities/{}", view.server, view.city);
    let attributes = [("camera", view.camera.as_str()), ("time", TIME), ("adapter", adapter)];
    let page = CityPage::open_with(browser, options, &url, &attributes)?;
    page.wait_for_adapter(0, adapter)?;
    page.wait_until_final(0)?;
    let drawn = page.camera(0)?;
    ensure!(is_same_view(&drawn, &view.camera), "the page shows {drawn}, {} was asked for", view.camera);
    let picture = page.picture(0, view.size_px)?;
    let problems = page.page.problems()?;
    ensure!(problems.is_empty(), "{problems:?}");
    Ok(picture)
}

/// Whether two texts are the same camera, up to their last digits.
fn is_same_view(a: &str, b: &str) -> bool {
    let numbers = |text: &str| text.split(',').map(|n| n.parse().unwrap_or(f64::NAN)).collect::<Vec<f64>>();
    numbers(a).iter().zip(numbers(b)).all(|(a, b)| (a - b).abs() < 0.01)
}

/// Share of pixels that are the same in both. Fails if the pictures have different sizes.
pub fn share_of_same(a: &RgbImage, b: &RgbImage) -> Result<f64> {
    ensure!(a.dimensions() == b.dimensions(), "{:?} and {:?} pixels", a.dimensions(), b.dimensions());
    let is_same =
        |(a, b): &(&image::Rgb<u8>, &image::Rgb<u8>)| a.0.iter().zip(b.0).all(|(a, b)| a.abs_diff(b) <= SAME_COLOUR);
    Ok(a.pixels().zip(b.pixels()).filter(is_same).count() as f64 / f64::from(a.width() * a.height()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_other_pixel_is_counted() {
        let grey = RgbImage::from_pixel(10, 10, image::Rgb([100; 3]));
        let mut other = grey.clone();
        other.put_pixel(3, 4, image::Rgb([100, 102, 98]));
        assert_eq!(share_of_same(&grey, &other).unwrap(), 1.0);
        other.put_pixel(3, 4, image::Rgb([100, 103, 100]));
        assert_eq!(share_of_same(&grey, &other).unwrap(), 0.99);
        assert!(share_of_same(&grey, &RgbImage::new(10, 9)).is_err());
    }
}
