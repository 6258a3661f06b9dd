//! Writes a GeoJSON file with N x N copies of another, side by side, to measure bakes of larger cities.
//!
//! `cargo run --release -p insula-measure --bin copies -- city.geojson 2 larger.geojson`

use std::{
    fs::File,
    io::{BufReader, BufWriter, Write},
};

use serde_json::{Value, json};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, n, output] = &arguments[..] else { return Err("usage: copies INPUT N OUTPUT".into()) };
    let n: u32 = n.parse()?;
    let city: Value = serde_json::from_reader(BufReader::new(File::open(input)?))?;
    let features = city["features"].as_array().ok_or("the input is not a FeatureCollection")?;
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for feature in features {
        for_each_position(&mut feature["geometry"]["coordinates"].clone(), &mut |p| {
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(p[axis]), high[axis].max(p[axis]));
            }
        });
    }
    let mut out = BufWriter::new(File::create(output)?);
    let mut separator = "{\"type\":\"FeatureCollection\",\"features\":[\n";
    for copy in 0..n * n {
        let offset = [copy % n, copy / n];
        for feature in features {
            let mut feature = feature.clone();
            for_each_position(&mut feature["geometry"]["coordinates"], &mut |p| {
                for axis in 0..2 {
                    p[axis] += f64::from(offset[axis]) * (high[axis] - low[axis]);
                }
            });
            if let Some(id) = feature["properties"]["id"].as_str().map(|id| format!("{id}-{copy}")) {
                feature["properties"]["id"] = json!(id);
            }
            write!(out, "{separator}{feature}")?;
            separator = ",\n";
        }
    }
    writeln!(out, "\n]}}")?;
    out.flush()?;
    Ok(())
}

/// Calls `visit` for every `[x, y, ...]` in nested arrays, and stores the changed position.
fn for_each_position(value: &mut Value, visit: &mut impl FnMut(&mut [f64; 2])) {
    let Value::Array(list) = value else { return };
    let numbers = (list.first().and_then(Value::as_f64), list.get(1).and_then(Value::as_f64));
    if let (Some(x), Some(y)) = numbers {
        let mut p = [x, y];
        visit(&mut p);
        (list[0], list[1]) = (json!(p[0]), json!(p[1]));
    } else {
        list.iter_mut().for_each(|inner| for_each_position(inner, visit));
    }
}
