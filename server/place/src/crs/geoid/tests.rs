//! Tests of geoid grids. Grids are made here with the encoder of `tiff`, or are the bundled one.

use super::grid::{Grid, Table};
use super::{EGM96_BYTES, EGM96_FILE, Geoid, GridFolder, geotiff};
use std::io::Cursor;
use tiff::encoder::{TiffEncoder, colortype};
use tiff::tags::Tag;

const POINT_KEYS: [u16; 12] = [1, 1, 0, 2, 1024, 0, 1, 2, 1025, 0, 1, 2];
const AREA_KEYS: [u16; 12] = [1, 1, 0, 2, 1024, 0, 1, 2, 1025, 0, 1, 1];

/// A grid of 4 columns from 10 degrees east and 3 rows from 50 degrees north, half a degree apart: value = column + 10
/// row.
fn grid_bytes(keys: &[u16], missing: &[usize]) -> Vec<u8> {
    let mut values: Vec<f32> = (0..12).map(|cell| (cell % 4 + 10 * (cell / 4)) as f32).collect();
    missing.iter().for_each(|cell| values[*cell] = -9999.0);
    let mut bytes = Vec::new();
    let mut encoder = TiffEncoder::new(Cursor::new(&mut bytes)).unwrap();
    let mut image = encoder.new_image::<colortype::Gray32Float>(4, 3).unwrap();
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[0.5, 0.5, 0.0][..]).unwrap();
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, 10.0, 50.0, 0.0][..]).unwrap();
    tags.write_tag(Tag::GeoKeyDirectoryTag, keys).unwrap();
    tags.write_tag(Tag::GdalNodata, "-9999").unwrap();
    image.write_data(&values).unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<Grid, String> {
    geotiff::read(Cursor::new(bytes))
}

#[test]
fn values_between_nodes_are_interpolated() {
    let grid = read(&grid_bytes(&POINT_KEYS, &[])).unwrap();
    for (longitude, latitude, expected) in
        [(10.0, 50.0, 0.0), (11.5, 49.0, 23.0), (10.25, 50.0, 0.5), (10.25, 49.75, 5.5), (11.4, 49.1, 20.8)]
    {
        let value = grid.undulation_m(longitude, latitude).unwrap();
        assert!((value - expected).abs() < 1e-9, "{longitude} {latitude}: {value}");
        assert_eq!(grid.undulation_m(longitude + 360.0, latitude).map(|v| (v - expected).abs() < 1e-9), Some(true));
    }
    for (longitude, latitude) in [(9.99, 49.5), (11.51, 49.5), (11.0, 50.01), (11.0, 48.99), (f64::NAN, 49.5)] {
        assert_eq!(grid.undulation_m(longitude, latitude), None);
    }
}

#[test]
fn pixels_as_areas_have_their_values_in_the_middle() {
    let grid = read(&grid_bytes(&AREA_KEYS, &[])).unwrap();
    assert_eq!(grid.undulation_m(10.25, 49.75), Some(0.0));
    assert_eq!(grid.undulation_m(10.0, 50.0), None);
}

#[test]
fn missing_values_leave_their_weight_to_others() {
    let grid = read(&grid_bytes(&POINT_KEYS, &[0, 1, 4])).unwrap();
    // Of the four corners only the value 11 is left.
    assert_eq!(grid.undulation_m(10.1, 49.9), Some(11.0));
    let empty = read(&grid_bytes(&POINT_KEYS, &[0, 1, 4, 5])).unwrap();
    assert_eq!(empty.undulation_m(10.1, 49.9), None);
}

#[test]
fn longitudes_wrap_around_a_world() {
    let values_m = (0..8).map(|cell| cell as f32).collect();
    let (west_deg, north_deg, step) = (-180.0, 45.0, 90.0);
    let table = Table { west_deg, north_deg, step_lon_deg: step, step_lat_deg: step, width: 4, height: 2, values_m };
    let grid = Grid::new(vec![table]);
    // Between the last column (3 at 90 degrees) and the first (0 at 180).
    assert_eq!(grid.undulation_m(135.0, 45.0), Some(1.5));
    assert_eq!(grid.undulation_m(-225.0, 45.0), Some(1.5));
    assert_eq!(grid.undulation_m(180.0, 45.0), Some(0.0));
}

#[test]
fn finer_tables_come_first() {
    let table = |step: f64, value: f32| Table {
        west_deg: 0.0,
        north_deg: 10.0,
        step_lon_deg: step,
        step_lat_deg: step,
        width: 3,
        height: 3,
        values_m: vec![value; 9],
    };
    let grid = Grid::new(vec![table(4.0, 1.0), table(1.0, 2.0)]);
    assert_eq!(grid.undulation_m(1.0, 9.0), Some(2.0));
    assert_eq!(grid.undulation_m(5.0, 5.0), Some(1.0));
}

#[test]
fn damaged_grids_are_refused() {
    let bytes = grid_bytes(&POINT_KEYS, &[]);
    let mut complete = 0;
    for length in 0..bytes.len() {
        complete += usize::from(read(&bytes[..length]).is_ok());
    }
    // Only what the encoder pads at the end may be missing.
    assert!(complete <= 4, "{complete}");
    // One byte changed at a time: no panic, no endless loop.
    for index in 0..bytes.len() {
        for value in [0, 0xff] {
            let mut changed = bytes.clone();
            changed[index] = value;
            let _ = read(&changed).map(|grid| grid.undulation_m(10.1, 49.9));
        }
    }
    assert!(read(b"").is_err());
    let projected = [1, 1, 0, 1, 1024, 0, 1, 1];
    assert_eq!(read(&grid_bytes(&projected, &[])), Err("its positions are not degrees".to_owned()));
}

#[test]
fn bundled_egm96_equals_proj() {
    let grid = geotiff::read(Cursor::new(EGM96_BYTES)).unwrap();
    // pyproj.Transformer.from_pipeline("+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step
    // +proj=vgridshift +grids=egm96_15.tif +multiplier=1").transform(longitude, latitude, 0)[2]
    for (longitude, latitude, expected) in [
        (4.9, 52.37, 42.94261718749999),
        (139.75, 35.69, 36.53242187499996),
        (179.9, -10.0, 35.30175781250002),
        (-179.99, 60.1, 0.6980703124999854),
        (0.0, 90.0, 13.6064453125),
        (10.0, -89.99, -29.5361328125),
    ] {
        let value = grid.undulation_m(longitude, latitude).unwrap();
        assert!((value - expected).abs() < 1e-9, "{longitude} {latitude}: {value}");
    }
    // Values of NGA's program F477 (PROJ's us_nga_egm96_15.tif has the same): the bundled grid is rounded to a
    // millimetre.
    let value = grid.undulation_m(4.9, 52.37).unwrap();
    assert!((value - 42.94252874755857).abs() < 1e-3, "{value}");
}

#[test]
fn grids_are_found_in_folders_by_name() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("nl_nsgi")).unwrap();
    std::fs::write(folder.path().join("nl_nsgi/NL_nsgi_nlgeo2018.tif"), grid_bytes(&POINT_KEYS, &[])).unwrap();
    std::fs::write(folder.path().join("broken.tif"), b"II*").unwrap();
    let grids = GridFolder::open(folder.path()).unwrap();
    let files = ["nl_nsgi_other.tif", "nl_nsgi_nlgeo2018.tif"];
    let geoid = Geoid::from_folder(&grids, &files).unwrap().unwrap();
    assert_eq!((geoid.name.as_str(), geoid.undulation_m(10.5, 50.0)), ("nl_nsgi_nlgeo2018.tif", Some(1.0)));
    // EGM96 outside of its area.
    let egm96 = Geoid::egm96(Some(&grids)).unwrap();
    assert_eq!(geoid.undulation_m(4.9, 52.37), egm96.undulation_m(4.9, 52.37));
    assert!(Geoid::from_folder(&grids, &["broken.tif"]).is_err());
    assert!(Geoid::from_folder(&grids, &[EGM96_FILE]).unwrap().is_none());
    assert!(GridFolder::open(&folder.path().join("missing")).is_err());
}
