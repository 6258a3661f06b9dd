//! Times two axonometric views of a part of a baked city: the first, which sorts the part, and a second one that only walks through it,
//! beside the second view of a part of its own. Without the time of writing files; medians of rounds in turn.

use anyhow::{Result, ensure};
use clap::Parser;
use insula_draw::view::DrawView;
use insula_draw::{DrawRequest, DrawnPart, draw_part};
use insula_export::selection::ObjectSelection;
use insula_server::store::{CityStore, StoredCity};
use std::path::PathBuf;
use std::time::Instant;

#[derive(Debug, Parser)]
struct Args {
    /// Folder of a baked city.
    city: PathBuf,
    /// Azimuth and elevation of the first view, in degrees.
    #[arg(long, value_delimiter = ',', num_args = 2, default_values_t = [30.0, 35.0])]
    first: Vec<f64>,
    /// Azimuth and elevation of the second view, in degrees.
    #[arg(long, value_delimiter = ',', num_args = 2, default_values_t = [210.0, 35.0])]
    second: Vec<f64>,
    /// West, south, east and north end of the part, in metres of the city's system.
    #[arg(long, value_delimiter = ',', num_args = 4)]
    bbox_metres: Option<Vec<f64>>,
    #[arg(long, default_value_t = 3)]
    rounds: usize,
}

fn median(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_by(f64::total_cmp);
    seconds[seconds.len() / 2]
}

fn main() -> Result<()> {
    let args = Args::parse();
    ensure!(args.rounds > 0, "--rounds is 0");
    let city = CityStore::open(&args.city)?;
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::open(city.manifest(), &read)?;
    let bbox = args.bbox_metres.as_ref().map(|ends| [[ends[0], ends[1]], [ends[2], ends[3]]]);
    let request = |view: &[f64]| DrawRequest {
        view: DrawView::Axonometric { azimuth_deg: view[0], elevation_deg: view[1] },
        selection: ObjectSelection { bbox, ..ObjectSelection::default() },
        ..DrawRequest::default()
    };
    let (first, second) = (request(&args.first), request(&args.second));
    let mut seconds = [const { Vec::new() }; 3];
    let mut report = String::new();
    for _ in 0..args.rounds {
        let begin = Instant::now();
        let part = DrawnPart::read(&source, &first, &|_, _| true)?;
        let drawn = draw_part(&source, &part, &first, &|_, _| true)?;
        seconds[0].push(begin.elapsed().as_secs_f64());
        let begin = Instant::now();
        let shared = draw_part(&source, &part, &second, &|_, _| true)?;
        seconds[1].push(begin.elapsed().as_secs_f64());
        let begin = Instant::now();
        let own = DrawnPart::read(&source, &second, &|_, _| true)?;
        let alone = draw_part(&source, &own, &second, &|_, _| true)?;
        seconds[2].push(begin.elapsed().as_secs_f64());
        ensure!(shared == alone, "the second view differs from that of a part of its own");
        let mebibytes = part.byte_len() as f64 / f64::from(1 << 20);
        report = format!("{} objects, a part of {mebibytes:.1} MiB", drawn.objects.len());
    }
    let [first_s, second_s, alone_s] = seconds.map(median);
    println!(
        "{report}: first view {first_s:.2} s, second {second_s:.2} s, alone {alone_s:.2} s: {:.2}",
        second_s / alone_s
    );
    Ok(())
}
