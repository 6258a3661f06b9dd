//! Drawings with several translucent things, which are painted from the farthest to the nearest (Moldoveanu, "Algoritmul pictorului"), and
//! drawings of a server beside those of the command.

use anyhow::{Context, Result, ensure};
use insula_test_support::http;
use insula_test_support::programs::{ServerProcess, call, program};
use insula_tests::tests;
use insula_tests::trials::Trials;
use serde_json::json;
use std::fs;
use std::net::SocketAddr;
use std::process::Command;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        translucent_things_are_painted_from_the_farthest_to_the_nearest,
        a_server_draws_cameras_as_the_command_does
    ]);
}

/// Kinds and corners of blocks from south to north: two that are translucent and overlap in the picture, and a wall behind them.
const BLOCKS: [[f64; 6]; 3] =
    [[20.0, 0.0, 0.0, 60.0, 4.0, 20.0], [40.0, 30.0, 0.0, 80.0, 34.0, 30.0], [0.0, 60.0, 0.0, 100.0, 64.0, 40.0]];
const STYLE: &str = "fill = \"kind\"\n[colors]\nbridge = \"#ff0000\"\nwater = \"#0000ff\"\nbuilding = \"#ffffff\"\nrelief = \"#ffffff\"\n\
                     [opacity]\nbridge = 0.8\nwater = 0.5\n";

/// The blocks as CityJSON, of these types.
fn city(types: [&str; 3]) -> String {
    let mut objects = serde_json::Map::new();
    let mut vertices = Vec::new();
    for (kind, [west, south, low, east, north, high]) in types.into_iter().zip(BLOCKS) {
        let first = vertices.len();
        let corners = [[west, south], [east, south], [east, north], [west, north]];
        vertices.extend([low, high].iter().flat_map(|z| corners.map(|[x, y]| [x, y, *z])));
        let faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
        let shell = faces.map(|corners: [usize; 4]| [corners.map(|corner| first + corner)]);
        let solid = json!({ "type": "Solid", "lod": "2", "boundaries": [shell] });
        objects.insert(kind.to_owned(), json!({ "type": kind, "geometry": [solid] }));
    }
    let translate = [100_000, 450_000, 0];
    json!({
        "type": "CityJSON", "version": "1.1", "transform": { "scale": [1, 1, 1], "translate": translate },
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/28992" },
        "CityObjects": objects, "vertices": vertices
    })
    .to_string()
}

/// A filled shape of a drawing: its colour, its opacity, and its rings in micrometres.
struct Fill {
    color: String,
    opacity: f64,
    rings: Vec<Vec<[f64; 2]>>,
}

/// The fills of a drawing in the order in which they are painted.
fn fills(svg: &str) -> Result<Vec<Fill>> {
    let surfaces = svg.split_once("<g id=\"surfaces\"").context("no surfaces")?.1;
    let surfaces = surfaces.split_once("<g id=\"lines\"").context("no lines")?.0;
    let value = |path: &str, name: &str| {
        let (_, rest) = path.split_once(&format!(" {name}=\""))?;
        Some(rest.split_once('"')?.0.to_owned())
    };
    let fill = |path: &str| -> Result<Fill> {
        let path = format!(" {path}");
        let color = value(&path, "fill").context("no fill")?;
        let opacity = value(&path, "fill-opacity").map_or(Ok(1.0), |text| text.parse())?;
        let data = value(&path, "d").context("no data")?;
        let rings = data.split_terminator('z').map(ring).collect::<Result<_>>()?;
        Ok(Fill { color, opacity, rings })
    };
    surfaces.split("<path ").skip(1).map(fill).collect()
}

/// A ring of a path with one absolute start and relative steps.
fn ring(data: &str) -> Result<Vec<[f64; 2]>> {
    let mut ring: Vec<[f64; 2]> = Vec::new();
    for part in data.trim_start_matches('M').split('l') {
        let numbers: Vec<f64> = part.replace('-', " -").split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let [x, y] = numbers[..] else { anyhow::bail!("{part}: no point") };
        let before = ring.last().copied().unwrap_or_default();
        ring.push([before[0] + x, before[1] + y]);
    }
    Ok(ring)
}

impl Fill {
    fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let crosses = |ring: &Vec<[f64; 2]>| {
            let edges = ring.iter().zip(ring.iter().cycle().skip(1));
            let is_left = |([ax, ay], [bx, by]): &(&[f64; 2], &[f64; 2])| {
                (*ay > y) != (*by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax)
            };
            edges.filter(is_left).count()
        };
        self.rings.iter().map(crosses).sum::<usize>() % 2 == 1
    }
}

/// The colour of a place: that of the fills that contain it, over white paper.
fn painted(fills: &[Fill], at: [f64; 2]) -> Result<[u8; 3]> {
    let mut rgb = [255.0; 3];
    for fill in fills.iter().filter(|fill| fill.contains(at)) {
        for (k, channel) in rgb.iter_mut().enumerate() {
            let own = f64::from(u8::from_str_radix(&fill.color[1 + 2 * k..3 + 2 * k], 16)?);
            *channel += (own - *channel) * fill.opacity;
        }
    }
    Ok(rgb.map(|channel| channel.round() as u8))
}

fn translucent_things_are_painted_from_the_farthest_to_the_nearest() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    fs::write(folder.join("style.toml"), STYLE)?;
    // Red of 0.8 over blue of 0.5 over white, and blue over red.
    let (red_first, blue_first) = ([230, 26, 51], [128, 26, 153]);
    for (name, types, expected) in
        [("a", ["Bridge", "WaterBody", "Building"], red_first), ("b", ["WaterBody", "Bridge", "Building"], blue_first)]
    {
        fs::write(folder.join(format!("{name}.city.json")), city(types))?;
        let options = "--cell 1 --ground none --no-street-sets";
        call(folder, "insula-server", &format!("bake {name}.city.json {options} --out {name}"))?;
        for view in ["0,30", "15,10"] {
            let out = format!("{name}-{view}.svg");
            let options = "--style style.toml --bare --paper 200x200";
            call(folder, "insula", &format!("draw {name} --axonometric {view} {options} --out {out}"))?;
            let fills = fills(&fs::read_to_string(folder.join(&out))?)?;
            let covered = |at: [f64; 2], color: &str| fills.iter().any(|fill| fill.color == color && fill.contains(at));
            let mut found = 0;
            for (x, y) in (0..50).flat_map(|x| (0..50).map(move |y| (x, y))) {
                let at = [f64::from(x) * 4000.0 + 1.5, f64::from(y) * 4000.0 + 2.5];
                if covered(at, "#ff0000") && covered(at, "#0000ff") {
                    let rgb = painted(&fills, at)?;
                    ensure!(rgb == expected, "{out}: {rgb:?} at {at:?}, not {expected:?}");
                    found += 1;
                }
            }
            ensure!(found > 10, "{out}: the two overlap at {found} places");
        }
    }
    Ok(())
}

/// What a server answers to a body of JSON.
fn posted(address: SocketAddr, path: &str, body: &str) -> Result<Vec<u8>> {
    let length = body.len();
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Type: application/json\r\nContent-Length: {length}"
    );
    let mut response = http::exchange(address, format!("{head}\r\n\r\n{body}").as_bytes())?;
    let end = response.windows(4).position(|bytes| bytes == b"\r\n\r\n").context("no head")?;
    let content = response.split_off(end + 4);
    let is_made = response.starts_with(b"HTTP/1.1 200 ");
    ensure!(is_made, "{}{}", String::from_utf8_lossy(&response), String::from_utf8_lossy(&content));
    Ok(content)
}

/// Both take the numbers of a camera as they are, and lift it out of what it is inside of.
fn a_server_draws_cameras_as_the_command_does() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    fs::write(folder.join("a.city.json"), city(["Bridge", "WaterBody", "Building"]))?;
    call(folder, "insula-server", "bake a.city.json --cell 1 --ground none --no-street-sets --out a")?;
    let mut command = Command::new(program("insula-server")?);
    let server = ServerProcess::start(&mut command, folder.join("a"), "127.0.0.1:0", &["drawings.at_once=1"])?;
    let drawn = |name: &str, position: [f64; 3], is_kept: bool| -> Result<Vec<u8>> {
        let view = json!({ "position": position, "target": [100_047.1, 450_031.9, -9.7], "fov_y_deg": 57.3 });
        fs::write(folder.join("camera.json"), view.to_string())?;
        let (out, option) = (format!("{name}.svg"), if is_kept { "--keep-camera" } else { "" });
        call(folder, "insula", &format!("draw a --camera camera.json --paper A4 {option} --out {out}"))?;
        let options = json!({ "format": "svg", "paper": "A4", "view": view, "keep_camera": is_kept });
        let answer = posted(server.address, "/v1/cities/a/draw", &options.to_string())?;
        let file = fs::read(folder.join(out))?;
        ensure!(answer == file, "{name}: {} bytes of the server, {} of the command", answer.len(), file.len());
        Ok(answer)
    };
    drawn("outside", [100_013.7, 449_900.3, 61.1], false)?;
    // In the wall, which is 40 m high.
    let inside = [100_050.3, 450_062.1, 30.3];
    let (lifted, kept) = (drawn("lifted", inside, false)?, drawn("kept", inside, true)?);
    ensure!(lifted != kept, "the camera in the wall is lifted out");
    Ok(())
}
