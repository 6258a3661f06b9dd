//! SRTM tiles, ASCII grids, pictures and JPEG 2000.

use super::super::{RasterError, Window};
use super::{assert_heights, colours, heights, open, open_named};
use std::io::Cursor;

#[test]
fn srtm_tiles() {
    let mut bytes = vec![0; 1201 * 1201 * 2];
    bytes[2..6].copy_from_slice(&[0xff, 0xfe, 0x80, 0x00]);
    bytes[1201 * 2..1201 * 2 + 2].copy_from_slice(&[1, 2]);
    let mut raster = open_named(&bytes, "folder/s01w010.SRTMGL3.hgt").unwrap();
    let place = raster.facts().place.unwrap();
    assert_eq!(place.origin, [-10.0, 0.0]);
    let [east, south] = place.position(1200.0, 1200.0);
    assert!((east + 9.0).abs() < 1e-9 && (south + 1.0).abs() < 1e-9);
    let window = Window { x: 0, y: 0, width: 3, height: 2 };
    assert_heights(&raster.read_heights(window, 0).unwrap(), &[0.0, -2.0, f32::NAN, 258.0, 0.0, 0.0]);
    assert!(raster.read_colours(window, 0).is_err());
    for name in ["x01w010.hgt", "N1.hgt", ".hgt", "N91E000.hgt", "N10E0é0.hgt", "N-1E+10.hgt"] {
        assert!(matches!(open_named(&bytes, name), Err(RasterError::Damaged(_))), "{name}");
    }
    assert!(open_named(&bytes[2..], "N10E010.hgt").is_err());
}

#[test]
fn ascii_grids() {
    let text = "NCOLS 3\r\nnrows 2\r\nxllcorner 10\r\nyllcenter 5\r\n dx 2\r\ndy 4\r\nNODATA_value -9999\r\n\
        1 2,5\r\n-9999\r\n\t4e1 nan 6";
    let mut raster = open(text.as_bytes()).unwrap();
    assert_heights(
        &raster.read_heights(Window { x: 0, y: 0, width: 3, height: 2 }, 0).unwrap(),
        &[1.0, 2.5, f32::NAN, 40.0, f32::NAN, 6.0],
    );
    assert_heights(&raster.read_heights(Window { x: 2, y: 1, width: 1, height: 1 }, 0).unwrap(), &[6.0]);
    let facts = raster.facts();
    assert_eq!((facts.place.unwrap().origin, facts.nodata), ([11.0, 9.0], Some(-9999.0)));
    assert_eq!(facts.place.unwrap().row, [0.0, -4.0]);
    let short = "ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA -1\n-1 7";
    assert_heights(&heights(short.as_bytes(), 0), &[f32::NAN, 7.0]);
    let nowhere = open(b"ncols 2\nnrows 1\ncellsize 1\n1 7").unwrap();
    assert_eq!(nowhere.facts().place, None);
}

#[test]
fn ascii_grids_with_many_blocks_of_rows() {
    let rows = 900u32;
    let header = format!("ncols 1000\nnrows {rows}\nxllcenter 0\nyllcenter 0\ncellsize 1\n");
    let values = (0..rows * 1000).map(|index| format!("{index} ")).collect::<String>();
    let mut raster = open((header + &values).as_bytes()).unwrap();
    for (x, y) in [(0, 0), (999, 899), (500, 262), (0, 263)] {
        let height = raster.read_heights(Window { x, y, width: 1, height: 1 }, 0).unwrap();
        assert_eq!(height, [(y * 1000 + x) as f32]);
    }
}

#[test]
fn damaged_ascii_grids() {
    let whole = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3 4";
    assert_heights(&heights(whole.as_bytes(), 0), &[1.0, 2.0, 3.0, 4.0]);
    for end in 0..whole.len() {
        if let Ok(raster) = open(&whole.as_bytes()[..end]) {
            panic!("{:?}", raster.facts());
        }
    }
    let more = format!("{whole} 5");
    assert!(open(format!("{whole}\n\u{1a}").as_bytes()).is_ok(), "an end as DOS has it");
    let long = format!("ncols {}", "1".repeat(1000));
    for text in [
        "ncols 1000000000\nnrows 1000000000\ncellsize 1\n1",
        "ncols -1\nnrows 1\ncellsize 1\n1",
        "ncols 1.5\nnrows 1\ncellsize 1\n1",
        "ncols 1\nnrows nan\ncellsize 1\n1",
        "ncols 1\nnrows 1\nwhat 1\n1",
        "ncols 1\nnrows 1\ncellsize x\n1",
        &long,
        &more,
    ] {
        assert!(open(text.as_bytes()).is_err(), "{text}");
    }
    let not_text = open(b"ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 \xff\n");
    assert!(matches!(not_text, Err(RasterError::Damaged(_))));
    let mut raster = open(b"ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 0\n1x\n").unwrap();
    assert_eq!(raster.facts().place, None);
    assert!(raster.read_heights(Window { x: 0, y: 0, width: 1, height: 1 }, 0).is_err());
}

#[test]
fn plain_pictures() {
    let picture = image::RgbaImage::from_fn(3, 2, |x, y| image::Rgba([x as u8, y as u8, 7, 200]));
    for format in [image::ImageFormat::Png, image::ImageFormat::WebP] {
        let mut bytes = Vec::new();
        picture.write_to(&mut Cursor::new(&mut bytes), format).unwrap();
        let mut raster = open(&bytes).unwrap();
        assert_eq!((raster.facts().bands, raster.facts().size.width), (4, 3));
        let pixels = raster.read_colours(Window { x: 1, y: 1, width: 2, height: 1 }, 0).unwrap();
        assert_eq!(pixels, [[1, 1, 7, 200], [2, 1, 7, 200]]);
        assert_eq!(colours(&bytes).len(), 6);
        assert!(raster.read_heights(Window { x: 0, y: 0, width: 1, height: 1 }, 0).is_err());
    }
    // Too large: 2049 x 2048 pixels.
    let mut bytes = Vec::new();
    image::GrayImage::new(2049, 2048).write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    assert!(matches!(open(&bytes), Err(RasterError::TooLarge { .. })));
}

#[test]
fn jpeg_2000_has_its_place_in_a_box() {
    let raster = open(include_bytes!("data/picture.jp2")).unwrap();
    let place = raster.facts().place.unwrap();
    assert_eq!((place.origin, place.column, place.row), ([1001.0, 1999.0], [2.0, 0.0], [0.0, -2.0]));
    assert_eq!(raster.facts().crs.horizontal.as_deref(), Some("EPSG:28992"));
}

#[test]
fn other_files_are_not_rasters() {
    for bytes in [&b""[..], b"I", b"II*", b"hello world", b"ncol", &[0xff; 100]] {
        assert!(matches!(open(bytes), Err(RasterError::NotThisFormat)), "{bytes:?}");
    }
}
