//! Draws a baked city and prints what it took: `draw_city CITY OUT [plan|AZ,EL|CAM.json] [west,south,east,north|-] [PAPER] [SCALE|-] [STYLE.toml]`.
//!
//! With `SECOND=plan|AZ,EL|CAM.json`, draws this view as well: of the same part, which the first view has sorted, and of a part of its own.

use insula_draw::{
    DrawLimits, DrawRequest, DrawnPart, draw_part,
    error::DrawStep,
    file::{DrawingFormat, write_drawing},
    sheet::Paper,
    style::Stylesheet,
    view::DrawView,
};
use insula_export::{selection::ObjectSelection, source::ExportSource};
use insula_objects::ColorBy;
use insula_server::store::{CityStore, StoredCity};
use std::{error::Error, path::Path, time::Instant};

fn numbers(text: &str) -> Result<Vec<f64>, std::num::ParseFloatError> {
    text.split(',').map(str::parse).collect()
}

fn view(text: &str) -> Result<DrawView, Box<dyn Error>> {
    if text == "plan" {
        return Ok(DrawView::Plan);
    }
    if text.ends_with(".json") {
        let camera: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(text)?)?;
        let point = |name: &str| [0, 1, 2].map(|k| camera[name][k].as_f64().unwrap_or(if k == 2 { 1.0 } else { 0.0 }));
        let fov_y_deg = camera["fov_y_deg"].as_f64().unwrap_or(60.0);
        return Ok(DrawView::Perspective {
            position: point("position"),
            target: point("target"),
            up: point("up"),
            fov_y_deg,
        });
    }
    let angles = numbers(text)?;
    Ok(DrawView::Axonometric { azimuth_deg: angles[0], elevation_deg: angles[1] })
}

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let arg = |k: usize, default: &str| args.get(k).cloned().unwrap_or_else(|| default.to_owned());
    let [city, out] = args.get(..2).ok_or("a city and an output")? else { return Ok(()) };
    let city = CityStore::open(Path::new(city))?;
    let read = |kind, id| city.tile(kind, id);
    let schema = StoredCity::read_schema(&read)?;
    let source = StoredCity::new(city.manifest(), &schema, &read);
    let bbox = Some(arg(3, "-")).filter(|text| text != "-").map(|text| numbers(&text)).transpose()?;
    let paper = arg(4, "A3");
    let style = match args.get(6) {
        Some(path) => Stylesheet::parse(&std::fs::read_to_string(path)?)?,
        None => Stylesheet::default(),
    };
    let color_by = std::env::var("COLOR_BY").ok().map(|text| ColorBy::parse(&text, &schema));
    let request = DrawRequest {
        view: view(&arg(2, "plan"))?,
        selection: ObjectSelection { bbox: bbox.map(|b| [[b[0], b[1]], [b[2], b[3]]]), ..ObjectSelection::default() },
        paper: Paper::parse(paper.trim_end_matches("-bare"))?,
        scale: Some(arg(5, "-")).filter(|text| text != "-").map(|text| text.parse()).transpose()?,
        is_bare: paper.ends_with("-bare"),
        title: None,
        style,
        is_checked: std::env::var_os("OVERLAP").is_some(),
        is_sheet: false,
        date: String::new(),
        note: String::new(),
        color_by: color_by.transpose()?,
        limits: DrawLimits::default(),
    };
    let started = Instant::now();
    let progress = |step: DrawStep, share: f64| {
        if std::env::var_os("VERBOSE").is_some() {
            eprintln!("{:7.2} s {} {:.0}%", started.elapsed().as_secs_f64(), step.word(), share * 100.0);
        }
        true
    };
    let part = DrawnPart::read(&source, &request, &progress)?;
    let drawing = draw_part(&source, &part, &request, &progress)?;
    let drawn = started.elapsed();
    let bytes = write_drawing(&drawing, DrawingFormat::of(Path::new(out))?, Path::new(out))?;
    if let Some(largest) = drawing.largest_overlap {
        println!("two parts overlap by at most {largest:.2e}, all shapes by {:.2e} of the page", drawing.overlap());
    }
    let c = drawing.counts;
    println!(
        "{} objects, {} triangles read, {} with terrain for the view, {} in view, {} after splits, {} parts; {:.2} s, {} bytes",
        drawing.objects.len(),
        c.read,
        c.triangles,
        c.facing,
        c.sorted,
        c.parts,
        drawn.as_secs_f64(),
        bytes
    );
    if let Ok(text) = std::env::var("SECOND") {
        measure_second(&source, &part, &DrawRequest { view: view(&text)?, ..request })?;
    }
    Ok(())
}

/// Draws a second view of a part, and of a part of its own.
fn measure_second(source: &dyn ExportSource, part: &DrawnPart, request: &DrawRequest) -> Result<(), Box<dyn Error>> {
    let divisions = part.divisions();
    let started = Instant::now();
    let second = draw_part(source, part, request, &|_, _| true)?;
    let of_same = started.elapsed().as_secs_f64();
    let started = Instant::now();
    let own = DrawnPart::read(source, request, &|_, _| true)?;
    let first = draw_part(source, &own, request, &|_, _| true)?;
    let of_own = started.elapsed().as_secs_f64();
    println!(
        "a second view: {of_same:.2} s and {} of {divisions} sets divided; with a part of its own {of_own:.2} s and {}: {:.2} of its time, {}",
        part.divisions() - divisions,
        own.divisions(),
        of_same / of_own,
        if second == first { "equal" } else { "different" }
    );
    println!("the part has {:.1} MiB", part.byte_len() as f64 / f64::from(1 << 20));
    Ok(())
}
