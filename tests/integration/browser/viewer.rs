//! The page of a city on a real server: its picture, and the effects of mouse, keys and touch.

use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;
use insula_bake::BakeOptions;
use insula_protocol::manifest::Attribution;
use insula_tests::{
    browser::{
        Browser, BrowserOptions, Button,
        city_page::{CityPage, colours},
        same_picture::share_of_same,
    },
    fixtures,
    programs::{ServerProcess, program},
};
use std::{
    collections::BTreeSet,
    io::{Read, Write},
    net::TcpStream,
    path::Path,
    process::Command,
    time::Duration,
};

/// Fewest colours of a picture that shows a city.
pub(super) const CITY_COLOURS: usize = 40;
/// Smallest share of equal pixels of two pictures of a view: at edges, other tiles may be resident.
const SAME_VIEW: f64 = 0.97;
/// Longest wait for a reaction of the page.
pub(super) const REACTION: Duration = Duration::from_secs(15);
/// Page, program and tiles before the first picture.
const FIRST_BYTES: u64 = 680_000;
const DESKTOP: [u32; 2] = [1440, 900];
const PHONE: [u32; 2] = [390, 844];

/// The bundled city on a server.
pub(super) fn serve() -> Result<ServerProcess> {
    ServerProcess::serve(&fixtures::baked_chiba()?, "127.0.0.1:0")
}

/// The page of the bundled city.
pub(super) fn url(server: &ServerProcess) -> String {
    format!("http://{}/cities/chiba", server.address)
}

/// Whether the server's pages have a viewer.
pub(super) fn is_served() -> Result<bool> {
    let server = serve()?;
    let mut stream = TcpStream::connect(server.address)?;
    write!(stream, "GET /cities/chiba HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", server.address)?;
    let mut response = String::new();
    stream.read_to_string(&mut response)?;
    Ok(response.contains("<insula-city"))
}

/// Keeps a screenshot for people to look at.
pub(super) fn keep(page: &CityPage, name: &str) -> Result<RgbImage> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("browser");
    std::fs::create_dir_all(&folder)?;
    let png = page.page.screenshot_png()?;
    std::fs::write(folder.join(format!("{name}.png")), &png)?;
    Ok(image::load_from_memory(&png)?.to_rgb8())
}

/// Fails if the page reported an error.
pub(super) fn ensure_no_problems(page: &CityPage) -> Result<()> {
    let problems = page.page.problems()?;
    ensure!(problems.is_empty(), "{problems:?}");
    Ok(())
}

/// Fails if the middle of the page shows no city.
pub(super) fn ensure_city_is_visible(page: &CityPage) -> Result<()> {
    let found = colours(&page.middle()?);
    if found < CITY_COLOURS {
        keep(page, "no-city")?;
        bail!("{found} colours in the middle of the page: no-city.png");
    }
    Ok(())
}

/// Fails if a picture shows no city, or the other another view.
pub(super) fn ensure_same_view(expected: &RgbImage, drawn: &RgbImage) -> Result<()> {
    let same = share_of_same(expected, drawn)?;
    println!("{:.3}% of the pixels are the same", same * 100.0);
    ensure!(colours(expected) >= CITY_COLOURS, "{} colours", colours(expected));
    ensure!(same >= SAME_VIEW, "only {:.3}% of the pixels are the same", same * 100.0);
    Ok(())
}

/// Servers of all requests; those without one, such as data URLs, are left out.
pub(super) fn hosts(page: &CityPage) -> Result<BTreeSet<String>> {
    let requests = page.page.requests()?;
    let host = |url: &str| Some(url.split_once("://")?.1.split('/').next()?.to_owned());
    Ok(requests.iter().filter(|request| !request.url.starts_with("blob:")).filter_map(|r| host(&r.url)).collect())
}

/// In both sizes, dark and light: a city, the adapter's name, no error, no other host, few bytes.
pub(super) fn the_page_shows_the_city() -> Result<()> {
    let server = serve()?;
    for (size, touch) in [(DESKTOP, false), (PHONE, true)] {
        for dark in [false, true] {
            let browser = Browser::launch(BrowserOptions { gpu: false, size, dark, touch })?;
            let page = CityPage::open(&browser, &url(&server))?;
            let ready_ms = page.last_event(0, "ready")?["firstMs"].as_f64().context("no time")?;
            let bytes = page.page.bytes_until(ready_ms / 1000.0)?;
            ensure!((50_000..=FIRST_BYTES).contains(&bytes), "{bytes} bytes before the first picture");
            page.wait_until_final(0)?;
            ensure_city_is_visible(&page)?;
            let name = format!("city-{}x{}-{}", size[0], size[1], if dark { "dark" } else { "light" });
            let picture = keep(&page, &name)?;
            println!("{name}: {bytes} bytes before the first picture, {} colours", colours(&picture));
            let adapter = page.last_event(0, "adapter")?["detail"].clone();
            let why = adapter["why"].as_str().unwrap_or_default();
            ensure!(adapter["kind"] == "cpu" && !why.is_empty(), "{adapter}");
            ensure!(hosts(&page)? == BTreeSet::from([server.address.to_string()]), "{:?}", hosts(&page)?);
            ensure_no_problems(&page)?;
        }
    }
    Ok(())
}

/// With one city, `/` is its page.
pub(super) fn a_single_city_is_the_root() -> Result<()> {
    let (server, browser) = (serve()?, Browser::launch(BrowserOptions::default())?);
    let page = CityPage::open(&browser, &format!("http://{}/", server.address))?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)?;
    ensure_no_problems(&page)
}

/// Title and sources are part of the page that the server sends.
pub(super) fn a_page_without_scripts_lists_the_city() -> Result<()> {
    let (server, browser) = (serve()?, Browser::launch(BrowserOptions::default())?);
    let page = CityPage::new(&browser)?;
    page.page.set_scripts(false)?;
    page.page.navigate(&url(&server))?;
    let text = page.page.evaluate("document.body.innerText")?;
    let text = text.as_str().unwrap_or_default();
    ensure!(text.contains("Chiba") || text.contains("chiba"), "{text}");
    ensure!(text.contains("insula view") || text.contains("insula://"), "no command: {text}");
    ensure!(page.page.evaluate("document.title")?.as_str().is_some_and(|title| !title.is_empty()));
    ensure!(page.page.evaluate("document.querySelector('meta[property=\"og:title\"]') !== null")? == true);
    ensure_no_problems(&page)
}

pub(super) fn keys_and_mouse_move_the_camera() -> Result<()> {
    let (server, browser) = (serve()?, Browser::launch(BrowserOptions::default())?);
    let page = CityPage::open(&browser, &url(&server))?;
    page.wait_until_final(0)?;
    let middle = [480.0, 300.0];
    page.moves_by("dragging", 0, |page| page.drag(Button::Left, middle, [600.0, 300.0]))?;
    page.moves_by("dragging with the right button", 0, |page| page.drag(Button::Right, middle, [480.0, 380.0]))?;
    page.moves_by("the wheel", 0, |page| page.wheel(middle, -240.0))?;
    for key in ["w", "PageUp", "ArrowLeft"] {
        page.moves_by(key, 0, |page| page.hold(key, Duration::from_millis(300)))?;
    }
    page.moves_by("a double click", 0, |page| page.click(middle, 2))?;
    page.wait_until_final(0)?;
    keep(&page, "moved")?;
    // The address is the link to this view.
    let camera = page.camera(0)?;
    page.page.wait_for(&format!("decodeURIComponent(location.hash).includes('camera={camera}')"), REACTION)?;
    page.moves_by("h", 0, |page| page.press("h"))?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)?;
    ensure_no_problems(&page)
}

pub(super) fn touch_moves_the_camera() -> Result<()> {
    let options = BrowserOptions { size: PHONE, touch: true, ..BrowserOptions::default() };
    let (server, browser) = (serve()?, Browser::launch(options)?);
    let page = CityPage::open(&browser, &url(&server))?;
    page.wait_until_final(0)?;
    let from = [195.0, 420.0];
    page.moves_by("a finger", 0, |page| page.touch(&[[from, [260.0, 440.0]]]))?;
    let two = |shift: [[f64; 2]; 2]| {
        let (a, b) = ([140.0, 420.0], [250.0, 420.0]);
        [[a, [a[0] + shift[0][0], a[1] + shift[0][1]]], [b, [b[0] + shift[1][0], b[1] + shift[1][1]]]]
    };
    page.moves_by("two fingers apart", 0, |page| page.touch(&two([[-60.0, 0.0], [60.0, 0.0]])))?;
    page.moves_by("two fingers aside", 0, |page| page.touch(&two([[50.0, 0.0], [50.0, 0.0]])))?;
    page.moves_by("two fingers down", 0, |page| page.touch(&two([[0.0, 80.0], [0.0, 80.0]])))?;
    page.moves_by("two fingers turning", 0, |page| page.touch(&two([[0.0, 70.0], [0.0, -70.0]])))?;
    ensure!(page.page.evaluate("visualViewport.scale")? == 1, "the page itself was scaled");
    ensure_no_problems(&page)
}

/// The camera in the address is the first view, and a new address another.
pub(super) fn a_link_opens_its_view() -> Result<()> {
    let (server, browser) = (serve()?, Browser::launch(BrowserOptions::default())?);
    let page = CityPage::open(&browser, &url(&server))?;
    page.moves_by("dragging", 0, |page| page.drag(Button::Left, [480.0, 300.0], [300.0, 320.0]))?;
    page.wait_until_final(0)?;
    let (camera, shown) = (page.camera(0)?, page.picture(0, [320, 200])?);
    let other = CityPage::open(&browser, &format!("{}#camera={camera}", url(&server)))?;
    other.wait_until_final(0)?;
    ensure!(other.camera(0)? == camera, "{} instead of {camera}", other.camera(0)?);
    ensure_same_view(&shown, &other.picture(0, [320, 200])?)?;
    // A hostile address is ignored.
    let hostile = format!("{}#camera=1,2,<img src=x>,NaN,1e999,0&time=never", url(&server));
    let page = CityPage::open(&browser, &hostile)?;
    page.wait_until_final(0)?;
    ensure_city_is_visible(&page)?;
    ensure_no_problems(&page)
}

pub(super) fn a_click_picks_a_point() -> Result<()> {
    let (server, browser) = (serve()?, Browser::launch(BrowserOptions::default())?);
    let page = CityPage::open(&browser, &url(&server))?;
    page.wait_until_final(0)?;
    page.page.click([480.0, 320.0], 1)?;
    page.page.wait_for(&format!("{}.insulaSeen.pick", CityPage::element(0)), REACTION)?;
    let picked = page.last_event(0, "pick")?["detail"].clone();
    let bounds = page.page.evaluate(&format!("{}.manifest.bounds", CityPage::element(0)))?;
    for k in 0..3 {
        let [at, low, high] = [&picked["position"][k], &bounds[0][k], &bounds[1][k]].map(|n| n.as_f64());
        let at = at.context("no position")?;
        ensure!(
            low.is_some_and(|low| at >= low - 1.0) && high.is_some_and(|high| at <= high + 1.0),
            "{picked} {bounds}"
        );
    }
    ensure!(picked["distance"].as_f64().is_some_and(|distance| distance > 1.0), "{picked}");
    ensure_no_problems(&page)
}

/// A second element in the same page: both draw, and each has a camera of its own.
pub(super) fn two_viewers_share_a_page() -> Result<()> {
    let (server, browser) = (serve()?, Browser::launch(BrowserOptions::default())?);
    let page = CityPage::open(&browser, &url(&server))?;
    page.page.evaluate(
        "(() => { const [first] = document.getElementsByTagName('insula-city');
            const second = document.createElement('insula-city');
            second.setAttribute('src', first.getAttribute('src'));
            Object.assign(second.style, { position: 'fixed', left: '10px', top: '10px', width: '320px', height: '240px' });
            document.body.append(second); })()",
    )?;
    page.wait_until_ready(1)?;
    page.wait_until_final(0)?;
    page.wait_until_final(1)?;
    let first = page.camera(0)?;
    page.moves_by("dragging", 1, |page| page.drag(Button::Left, [100.0, 100.0], [200.0, 120.0]))?;
    page.wait_until_final(1)?;
    ensure!(page.camera(0)? == first, "the other viewer moved, too");
    for number in 0..2 {
        let picture = page.picture(number, [320, 200])?;
        ensure!(colours(&picture) >= CITY_COLOURS, "viewer {number}: {} colours", colours(&picture));
    }
    keep(&page, "two-viewers")?;
    // A viewer that is removed ends; the other one stays.
    page.page.evaluate(&format!("{}.remove()", CityPage::element(1)))?;
    page.moves_by("dragging", 0, |page| page.drag(Button::Left, [600.0, 400.0], [700.0, 400.0]))?;
    page.wait_until_final(0)?;
    ensure_no_problems(&page)
}

/// Title and sources of a city come from anybody.
pub(super) fn hostile_names_are_text() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let title = "<img src=x onerror=\"window.hacked=1\">&amp;</title></script><script>window.hacked=1</script>\u{202e}";
    let attribution = Attribution {
        text: "<b id=hacked>source</b>".into(),
        licence: Some("<svg onload=window.hacked=1>".into()),
        url: Some("javascript:window.hacked=1".into()),
    };
    let city = fixtures::baked(
        "hostile",
        &BakeOptions {
            inputs: vec![fixtures::write_city_json(folder.path(), 3)?],
            title: Some(title.into()),
            attribution: vec![attribution],
            ..BakeOptions::default()
        },
    )?;
    let chiba = fixtures::baked_chiba()?;
    let mut command = Command::new(program("insula-server")?);
    let server = ServerProcess::start_with(&mut command, &[&city, &chiba], "127.0.0.1:0", &[])?;
    let browser = Browser::launch(BrowserOptions::default())?;
    let page = CityPage::open(&browser, &format!("http://{}/cities/hostile", server.address))?;
    page.wait_until_final(0)?;
    let is_clean = "(() => { const all = root => [...root.querySelectorAll('*')].flatMap(e => [e, ...(e.shadowRoot ? all(e.shadowRoot) : [])]);
        const found = all(document).filter(e => e.id === 'hacked' || e.hasAttribute('onerror') || e.hasAttribute('onload')
            || /^javascript:/i.test(e.getAttribute('href') ?? ''));
        return window.hacked === undefined && found.length === 0; })()";
    ensure!(page.page.evaluate(is_clean)? == true, "the page of the city has foreign markup");
    let title = page.page.evaluate("document.title")?;
    ensure!(title.as_str().is_some_and(|title| title.contains("<img src=x")), "{title}");
    ensure_no_problems(&page)?;
    // With two cities, the root is the list.
    page.page.navigate(&format!("http://{}/", server.address))?;
    ensure!(page.page.evaluate(is_clean)? == true, "the list has foreign markup");
    ensure!(
        page.page.evaluate("document.body.innerText.includes('<img src=x')")? == true,
        "the title is not in the list"
    );
    ensure_no_problems(&page)
}
