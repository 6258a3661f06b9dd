//! Draws a baked city and prints what it took: `draw_city CITY OUT [plan|AZ,EL|CAM.json] [west,south,east,north|-] [PAPER] [SCALE|-] [STYLE.toml]`.
//!
//! With `SECOND=plan|AZ,EL|CAM.json`, draws this view as well: of the same part, which the first view has sorted, and of a part of its own.

use insula_archive::BakedCity;
use insula_draw::{
    DrawLimits, DrawRequest, DrawnPart, draw_part,
    error::DrawStep,
    file::{DrawingFormat, write_drawing},
    sheet::Paper,
    style::Stylesheet,
    view::DrawView,
};
use insula_export::{
    selection::ObjectSelection,
    source::{ExportSource, SourceError},
};
use insula_objects::{ColorBy, ObjectBlock, Schema};
use insula_protocol::{
    BlockMap, Manifest, MeshTile, Subtree, TileId, TileKind, mesh_tile,
    object_tile::{self, SCHEMA_ID, block_id},
};
use std::{error::Error, fmt::Display, path::Path, time::Instant};

struct Source {
    city: BakedCity,
    schema: Schema,
}

fn failed(what: &str, reason: &dyn Display) -> SourceError {
    SourceError { what: what.to_owned(), reason: reason.to_string() }
}

impl Source {
    fn open(folder: &Path) -> Result<Self, Box<dyn Error>> {
        let city = BakedCity::open(folder)?;
        let bytes = city.tile(TileKind::Objects, SCHEMA_ID)?.ok_or("the city has no objects")?;
        let schema = serde_json::from_slice(&object_tile::decode(SCHEMA_ID, &bytes)?)?;
        Ok(Self { city, schema })
    }

    fn read<T, E: Display>(
        &self,
        kind: TileKind,
        id: TileId,
        decode: impl Fn(&[u8]) -> Result<T, E>,
    ) -> Result<Option<T>, SourceError> {
        let bytes = self.city.tile(kind, id).map_err(|error| failed("a tile", &error))?;
        bytes.map(|bytes| decode(&bytes).map_err(|error| failed("a tile", &error))).transpose()
    }
}

impl ExportSource for Source {
    fn manifest(&self) -> &Manifest {
        self.city.manifest()
    }

    fn schema(&self) -> &Schema {
        &self.schema
    }

    fn objects(&self, block: u32) -> Result<Option<ObjectBlock>, SourceError> {
        let Some(id) = block_id(block) else { return Ok(None) };
        self.read(TileKind::Objects, id, |bytes| {
            object_tile::decode(id, bytes).and_then(|content| ObjectBlock::decode(block, &content, &self.schema))
        })
    }

    fn subtree(&self, root: TileId) -> Result<Option<Subtree>, SourceError> {
        self.read(TileKind::Subtree, root, Subtree::decode)
    }

    fn columns(&self, node: TileId) -> Result<Option<BlockMap>, SourceError> {
        self.read(TileKind::BlockMap, node, |bytes| BlockMap::decode(node, bytes))
    }

    fn mesh(&self, leaf: TileId, lod: u8) -> Result<Option<MeshTile>, SourceError> {
        let Some(place) = mesh_tile::archive_id(leaf, lod) else { return Ok(None) };
        self.read(TileKind::Mesh, place, |bytes| MeshTile::decode(leaf, lod, bytes))
    }
}

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
    let source = Source::open(Path::new(city))?;
    let bbox = Some(arg(3, "-")).filter(|text| text != "-").map(|text| numbers(&text)).transpose()?;
    let paper = arg(4, "A3");
    let style = match args.get(6) {
        Some(path) => Stylesheet::parse(&std::fs::read_to_string(path)?)?,
        None => Stylesheet::default(),
    };
    let color_by = std::env::var("COLOR_BY").ok().map(|text| ColorBy::parse(&text, &source.schema));
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
fn measure_second(source: &Source, part: &DrawnPart, request: &DrawRequest) -> Result<(), Box<dyn Error>> {
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
