//! The page of a city on a real server: its picture, and the effects of mouse, keys and touch.

use super::browser;
use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;
use insula_bake::BakeOptions;
use insula_protocol::manifest::Attribution;
use insula_test_support::tier;
use insula_tests::browser::city_page::{CityPage, colours};
use insula_tests::browser::page_log::Request;
use insula_tests::browser::same_picture::{self, share_of_same};
use insula_tests::browser::{Button, Page, PageOptions};
use insula_tests::fixtures;
use insula_tests::programs::{ServerProcess, program};
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Fewest colours of a small picture that shows a city: sky, or the background of an element that draws nothing, has half as many.
pub(super) const CITY_COLOURS: usize = 24;
/// Smallest share of equal pixels of two pictures of a view: at edges, other tiles may be resident.
const SAME_VIEW: f64 = 0.97;
/// Longest wait for a reaction of the page.
pub(super) const REACTION: Duration = Duration::from_secs(60);
/// Size of pictures that are compared.
pub(super) const PICTURE: [u32; 2] = [320, 200];
/// A place of a page of the default size where no control or notice is.
pub(super) const FREE: [f64; 2] = [240.0, 220.0];
/// Page and program as they are distributed. `client/web/build --quick` makes larger ones for the quick tier.
const PROGRAM_BYTES: u64 = 385_000;
const QUICK_PROGRAM_BYTES: u64 = 650_000;
pub(super) const DESKTOP: [u32; 2] = [1440, 900];
pub(super) const PHONE: [u32; 2] = [390, 844];

/// The bundled city on a server.
pub(super) fn serve() -> Result<ServerProcess> {
    ServerProcess::serve(&fixtures::baked_chiba()?, "127.0.0.1:0")
}

/// The page of the bundled city.
pub(super) fn url(server: &ServerProcess) -> String {
    format!("http://{}/cities/chiba", server.address)
}

/// Opens the page of the bundled city, and waits for its final picture.
pub(super) fn open(server: &ServerProcess) -> Result<CityPage> {
    open_url(&url(server))
}

/// The same for any page.
pub(super) fn open_url(url: &str) -> Result<CityPage> {
    let page = CityPage::open(browser(false)?.as_ref(), PageOptions::default(), url)?;
    page.wait_until_final(0)?;
    Ok(page)
}

/// Views of the bundled city, of which the last is near to its houses.
pub(super) fn cameras() -> Result<Vec<String>> {
    let manifest = serde_json::from_slice(&std::fs::read(fixtures::baked_chiba()?.join("city.json"))?)?;
    same_picture::cameras(&manifest)
}

/// A view that needs other tiles than the first one.
pub(super) fn near_camera() -> Result<String> {
    cameras()?.pop().context("no camera")
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

/// Waits until the middle of the page shows a city: the screen gets a picture after the page has drawn it.
pub(super) fn ensure_city_is_visible(page: &CityPage) -> Result<()> {
    let begin = Instant::now();
    loop {
        let found = colours(&page.middle()?);
        if found >= CITY_COLOURS {
            return Ok(());
        }
        if begin.elapsed() > REACTION {
            keep(page, "no-city")?;
            bail!("{found} colours in the middle of the page: no-city.png");
        }
    }
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

/// A city, the adapter's name, no error, no other host, few bytes.
fn ensure_page_shows_city(options: PageOptions) -> Result<()> {
    let (server, browser) = (serve()?, browser(false)?);
    let page = CityPage::open(&browser, options, &url(&server))?;
    let ready_s = page.last_event(0, "ready")?["firstMs"].as_f64().context("no time")? / 1000.0;
    page.wait_until_final(0)?;
    // How many tiles have arrived by then depends on the machine.
    let is_program = |request: &&Request| {
        !request.url.contains("/v1/cities/") && request.end_s.is_some_and(|end_s| end_s <= ready_s)
    };
    let bytes: u64 = page.page.requests()?.iter().filter(is_program).map(|request| request.bytes).sum();
    let most = if tier::is_full() { PROGRAM_BYTES } else { QUICK_PROGRAM_BYTES };
    ensure!((50_000..=most).contains(&bytes), "{bytes} bytes of the program before the first picture");
    let unneeded = [
        ("/shaders.txt", "a GPU"),
        ("/insula_web_gpu.js", "a GPU"),
        ("/insula_web_gpu_bg.wasm", "a GPU"),
        ("/insula_web_objects.js", "questions about objects"),
        ("/insula_web_objects_bg.wasm", "questions about objects"),
    ];
    for (file, user) in unneeded {
        let fetched = page.page.requests()?.into_iter().find(|request| request.url.ends_with(file));
        ensure!(fetched.is_none(), "a page without {user} fetched {fetched:?}");
    }
    ensure_city_is_visible(&page)?;
    let ([width, height], scheme) = (options.size, if options.dark { "dark" } else { "light" });
    let name = format!("city-{width}x{height}-{scheme}");
    let picture = keep(&page, &name)?;
    println!("{name}: {bytes} bytes of the program, {} colours", colours(&picture));
    let cpu = "(({ kind, why }) => kind === 'cpu' && why !== '')";
    page.page.wait_for(&format!("{cpu}({}.insulaSeen.adapter.detail)", CityPage::element(0)), REACTION)?;
    ensure!(hosts(&page)? == BTreeSet::from([server.address.to_string()]), "{:?}", hosts(&page)?);
    let in_vain = page.page.console_messages()?.into_iter().find(|message| message.text.contains("preload"));
    ensure!(in_vain.is_none(), "{in_vain:?}");
    ensure_no_problems(&page)
}

pub(super) fn phones_show_the_city() -> Result<()> {
    ensure_page_shows_city(PageOptions { size: PHONE, dark: false, touch: true })
}

pub(super) fn dark_phones_show_the_city() -> Result<()> {
    ensure_page_shows_city(PageOptions { size: PHONE, dark: true, touch: true })
}

pub(super) fn desktops_show_the_city() -> Result<()> {
    ensure_page_shows_city(PageOptions { size: DESKTOP, dark: false, touch: false })
}

pub(super) fn dark_desktops_show_the_city() -> Result<()> {
    ensure_page_shows_city(PageOptions { size: DESKTOP, dark: true, touch: false })
}

/// With one city, `/` is its page.
pub(super) fn a_single_city_is_the_root() -> Result<()> {
    let server = serve()?;
    let page = open_url(&format!("http://{}/", server.address))?;
    ensure_city_is_visible(&page)?;
    ensure_no_problems(&page)
}

/// Title and sources are part of the page that the server sends.
pub(super) fn a_page_without_scripts_lists_the_city() -> Result<()> {
    let (server, browser) = (serve()?, browser(false)?);
    let page = CityPage::new(&browser, PageOptions::default())?;
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
    let server = serve()?;
    let page = open(&server)?;
    let moves_by = |what: &str, action: &dyn Fn(&Page) -> Result<()>| -> Result<()> {
        page.moves_by(what, 0, action)?;
        page.wait_until_final(0)
    };
    let [x, y] = FREE;
    moves_by("dragging", &|page| page.drag(Button::Left, FREE, [x + 60.0, y]))?;
    moves_by("dragging with the right button", &|page| page.drag(Button::Right, FREE, [x, y + 30.0]))?;
    moves_by("the wheel", &|page| page.wheel(FREE, -240.0))?;
    for key in ["w", "PageUp", "ArrowLeft"] {
        page.moves_by(key, 0, |page| page.key_down(key))?;
        page.page.key_up(key)?;
        // It rests again.
        page.wait_until_final(0)?;
    }
    moves_by("a double click", &|page| page.click(FREE, 2))?;
    keep(&page, "moved")?;
    // The address is the link to this view.
    let camera = page.camera(0)?;
    page.page.wait_for(&format!("decodeURIComponent(location.hash).includes('camera={camera}')"), REACTION)?;
    moves_by("h", &|page| page.press("h"))?;
    ensure_city_is_visible(&page)?;
    ensure_no_problems(&page)
}

pub(super) fn touch_moves_the_camera() -> Result<()> {
    let (server, browser) = (serve()?, browser(false)?);
    let options = PageOptions { size: PHONE, touch: true, ..PageOptions::default() };
    let page = CityPage::open(&browser, options, &url(&server))?;
    let moves_by = |what: &str, fingers: &[[[f64; 2]; 2]]| -> Result<()> {
        page.wait_until_final(0)?;
        page.moves_by(what, 0, |page| page.touch(fingers))
    };
    moves_by("a finger", &[[[195.0, 420.0], [260.0, 440.0]]])?;
    let two = |shift: [[f64; 2]; 2]| {
        let (a, b) = ([140.0, 420.0], [250.0, 420.0]);
        [[a, [a[0] + shift[0][0], a[1] + shift[0][1]]], [b, [b[0] + shift[1][0], b[1] + shift[1][1]]]]
    };
    moves_by("two fingers apart", &two([[-60.0, 0.0], [60.0, 0.0]]))?;
    moves_by("two fingers aside", &two([[50.0, 0.0], [50.0, 0.0]]))?;
    moves_by("two fingers down", &two([[0.0, 80.0], [0.0, 80.0]]))?;
    moves_by("two fingers turning", &two([[0.0, 70.0], [0.0, -70.0]]))?;
    ensure!(page.page.evaluate("visualViewport.scale")? == 1, "the page itself was scaled");
    ensure_no_problems(&page)
}

/// The camera in the address is the first view, and a new address another. Each page ends before the next begins, because pages
/// beside one another take each other's processors.
pub(super) fn a_link_opens_its_view() -> Result<()> {
    let (server, camera) = (serve()?, near_camera()?);
    let page = CityPage::open(browser(false)?.as_ref(), PageOptions::default(), &url(&server))?;
    page.page.evaluate(&format!("location.hash = 'camera={camera}'"))?;
    page.wait_for_view(0, &camera)?;
    page.wait_until_final(0)?;
    let (camera, shown) = (page.camera(0)?, page.picture(0, PICTURE)?);
    drop(page);
    let page = open_url(&format!("{}#camera={camera}", url(&server)))?;
    ensure!(page.camera(0)? == camera, "{} instead of {camera}", page.camera(0)?);
    ensure_same_view(&shown, &page.picture(0, PICTURE)?)?;
    // A flight ends with a picture from where it ends.
    let flight = "async city => {
        const there = city.view.camera.split(',').map(Number);
        there[0] += 20;
        await city.flyTo(there.join(), { seconds: 0.3 });
        return city.view.position[0] - there[0];
    }";
    let rest_m = page.page.evaluate(&format!("({flight})({})", CityPage::element(0)))?.as_f64();
    ensure!(rest_m.is_some_and(|rest_m| rest_m.abs() < 0.1), "{rest_m:?} m from where it ends");
    drop(page);
    // A hostile address is ignored.
    let hostile = format!("{}#camera=1,2,<img src=x>,NaN,1e999,0&time=never", url(&server));
    let page = CityPage::open(browser(false)?.as_ref(), PageOptions::default(), &hostile)?;
    ensure_city_is_visible(&page)?;
    ensure_no_problems(&page)?;
    drop(page);
    // Nothing of the city is in view, which is a picture, too.
    let sky = open_url(&format!("{}#camera=0,0,100,0,60,40", url(&server)))?;
    ensure!(colours(&sky.picture(0, PICTURE)?) > 1, "the sky has one colour");
    ensure_no_problems(&sky)
}

pub(super) fn a_click_picks_a_point() -> Result<()> {
    let server = serve()?;
    let page = open(&server)?;
    page.page.click(FREE, 1)?;
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
    let server = serve()?;
    let page = open(&server)?;
    page.page.evaluate(
        "(() => { const [first] = document.getElementsByTagName('insula-city');
            const second = document.createElement('insula-city');
            second.setAttribute('src', first.getAttribute('src'));
            Object.assign(second.style, { position: 'fixed', left: '10px', top: '120px', width: '160px', height: '130px' });
            document.body.append(second); })()",
    )?;
    page.wait_until_ready(1)?;
    page.wait_until_final(0)?;
    page.wait_until_final(1)?;
    let first = page.camera(0)?;
    page.moves_by("dragging", 1, |page| page.drag(Button::Left, [60.0, 180.0], [110.0, 190.0]))?;
    page.wait_until_final(1)?;
    page.wait_until_final(0)?;
    ensure!(page.camera(0)? == first, "the other viewer moved, too");
    for number in 0..2 {
        let picture = page.picture(number, PICTURE)?;
        ensure!(colours(&picture) >= CITY_COLOURS, "viewer {number}: {} colours", colours(&picture));
    }
    keep(&page, "two-viewers")?;
    // A viewer that is removed ends; the other one stays.
    page.page.evaluate(&format!("{}.remove()", CityPage::element(1)))?;
    page.moves_by("dragging", 0, |page| page.drag(Button::Left, [300.0, 220.0], [350.0, 220.0]))?;
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
    let page = open_url(&format!("http://{}/cities/hostile", server.address))?;
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
    ensure_no_problems(&page)?;
    // Long words are broken.
    page.page.set_viewport([320, 568], 1.0, false)?;
    page.page.set_scripts(false)?;
    for path in ["", "cities/hostile"] {
        page.page.navigate(&format!("http://{}/{path}", server.address))?;
        let width = page.page.evaluate("document.documentElement.scrollWidth")?;
        ensure!(width == 320, "/{path} is {width} pixels wide");
    }
    Ok(())
}
