//! Damaged files: they give an error, never a panic, and never more memory than the limits allow.

use super::super::{RasterError, Window};
use super::open;
use super::tiff_file::{TestForm, TestImage, Values, file};

/// Opens a file and reads what it has. Only panics matter.
fn try_all(bytes: &[u8]) {
    let Ok(mut raster) = open(bytes) else { return };
    for level in 0..raster.facts().levels.len() {
        let window = Window::all_of(raster.facts().levels[level]);
        let _ = raster.read_heights(window, level);
        let _ = raster.read_colours(window, level);
        let _ = raster.read_colours(Window { x: 0, y: 0, width: 1, height: 1 }, level);
        let _ = raster.facts().place_of_level(level);
    }
}

/// A file with copies, masks, tiles, places and texts.
fn rich_file(form: TestForm) -> Vec<u8> {
    let main = TestImage::new([5, 3], 2, [16, 1], vec![]).tiles([4, 2], vec![vec![1; 32]; 4]).shorts(317, &[2]);
    let main = main.shorts(338, &[2]).shorts(34735, &[1, 1, 0, 1, 1026, 34737, 3, 0]);
    let main = main.tag(33550, Values::Doubles(vec![1.0, 1.0, 0.0])).tag(34737, Values::Text("abc|"));
    let main = main.tag(33922, Values::Doubles(vec![0.0; 6])).tag(42113, Values::Text("7"));
    let copy = TestImage::new([2, 1], 2, [16, 1], vec![9; 8]).shorts(254, &[1]);
    let mask = TestImage::new([5, 3], 1, [1, 1], vec![0xff; 3]).shorts(254, &[4]);
    file(form, &[main, copy, mask])
}

fn samples() -> Vec<Vec<u8>> {
    let big = TestForm { is_big_endian: true, is_big_tiff: true };
    vec![
        rich_file(TestForm::default()),
        rich_file(big),
        include_bytes!("data/jpeg.tif").to_vec(),
        include_bytes!("data/webp.tif").to_vec(),
    ]
}

#[test]
fn files_that_end_early() {
    for bytes in samples() {
        for end in 0..bytes.len() {
            try_all(&bytes[..end]);
        }
    }
    let picture = include_bytes!("data/picture.jp2");
    for end in (0..picture.len()).step_by(13) {
        try_all(&picture[..end]);
    }
}

#[test]
fn files_with_other_bytes() {
    for bytes in samples() {
        for place in 0..bytes.len() {
            for value in [0, 1, 0x7f, 0xff] {
                let mut bytes = bytes.clone();
                bytes[place] = value;
                try_all(&bytes);
            }
            // Numbers of 32 bits, such as counts and offsets.
            let mut bytes = bytes.clone();
            let end = bytes.len().min(place + 4);
            bytes[place..end].fill(0xff);
            try_all(&bytes);
        }
    }
    let picture = include_bytes!("data/picture.jp2");
    for place in (0..picture.len()).step_by(7) {
        let mut bytes = picture.to_vec();
        bytes[place] ^= 0x55;
        try_all(&bytes);
    }
}

#[test]
fn sizes_beyond_the_limits() {
    let pixel = Window { x: 0, y: 0, width: 1, height: 1 };
    let huge = |tag| TestImage::new([9, 9], 1, [32, 3], vec![0; 9]).tag(tag, Values::Long(1 << 29)).shorts(259, &[8]);
    // A strip of 2^29 columns, tiles of 2^29 columns, and more bytes than the file has.
    let mut raster = open(&huge(256).file()).unwrap();
    assert!(matches!(raster.read_heights(pixel, 0), Err(RasterError::TooLarge { .. })));
    assert!(matches!(raster.read_heights(Window { width: 1 << 29, ..pixel }, 0), Err(RasterError::TooLarge { .. })));
    let tiles = TestImage::new([9, 9], 1, [32, 3], vec![]).tiles([9, 9], vec![vec![0; 9]]).shorts(259, &[8]);
    let mut raster = open(&tiles.tag(322, Values::Long(1 << 29)).file()).unwrap();
    assert!(matches!(raster.read_heights(pixel, 0), Err(RasterError::TooLarge { .. })));
    for (tag, value) in [(256, 0), (257, u32::MAX), (277, 0), (277, 70_000), (258, 65), (339, 6), (322, 0)] {
        let image = TestImage::new([9, 9], 1, [32, 3], vec![]).tiles([16, 16], vec![vec![0; 1024]]);
        assert!(open(&image.tag(tag, Values::Long(value)).file()).is_err(), "{tag}");
    }
    // Fewer tiles than the size needs.
    let image = TestImage::new([99, 99], 1, [8, 1], vec![]).tiles([16, 16], vec![vec![0; 256]; 48]);
    assert!(matches!(open(&image.file()), Err(RasterError::Damaged(_))));
}

#[test]
fn many_pixels_in_tiles_that_share_a_place_are_refused() {
    // 256 or 64 tiles of 1024 x 1024 pixels: four times the limit, or the limit.
    let image = |side: u16, tile: Vec<u8>| {
        let tiles = usize::from(side / 1024).pow(2);
        TestImage::new([side, side], 1, [8, 1], vec![]).tiles([1024, 1024], vec![tile; tiles]).shorts(259, &[8])
    };
    let read = open(&image(16_384, vec![1; 99]).shared().file());
    assert!(matches!(read, Err(RasterError::TooLarge { limit: 67_108_864, .. })));
    assert!(open(&image(8192, vec![1; 99]).shared().file()).is_ok());
    assert!(open(&image(16_384, vec![1; 99]).file()).is_ok(), "each tile has a place of its own");
    assert!(open(&image(16_384, vec![]).file()).is_ok(), "all tiles are left out");
    let mut long = image(16_384, vec![1; 99]).shared().file();
    long.resize(1 << 24, 0);
    // Its tiles have fewer bytes than the file then, and it has a byte for 16 pixels.
    assert!(open(&long).is_ok());
    // A smaller copy counts as the image itself does.
    let copy = image(16_384, vec![1; 99]).shared().shorts(254, &[1]);
    let read = open(&file(TestForm::default(), &[image(20_480, vec![1; 9]), copy]));
    assert!(matches!(read, Err(RasterError::TooLarge { limit: 67_108_864, .. })));
}

#[test]
fn little_packed_data_that_claims_to_be_much() {
    // Each strip claims to have 1 MB.
    for compression in [5, 7, 8, 32773, 50000, 50001, 34887, 99] {
        for packed in [vec![0; 20], vec![0xff; 20], vec![0x80, 0x0f], vec![0x78, 0x9c, 1], vec![0x81, 7]] {
            let image = TestImage::new([1000, 1000], 1, [8, 1], packed).shorts(259, &[compression]);
            let mut raster = open(&image.file()).unwrap();
            let read = raster.read_heights(Window { x: 0, y: 0, width: 1, height: 1 }, 0);
            assert!(matches!(read, Err(RasterError::Damaged(_) | RasterError::Unsupported(_))), "{compression}");
        }
    }
}

#[test]
fn other_compressions_are_refused_with_a_command() {
    let lerc = TestImage::new([2, 1], 1, [8, 1], vec![0; 20]).shorts(259, &[34887]);
    let read = open(&lerc.file()).unwrap().read_heights(Window { x: 0, y: 0, width: 2, height: 1 }, 0);
    let error = read.unwrap_err().to_string();
    assert!(error.contains("LERC") && error.contains("gdal_translate -co COMPRESS=DEFLATE"), "{error}");
}

#[test]
fn circles_of_directories() {
    let mut bytes = rich_file(TestForm::default());
    // The link of the last directory, at the end of the file, is set to the first directory.
    let first: [u8; 4] = bytes[4..8].try_into().unwrap();
    let end = bytes.len() - 4;
    bytes[end..].copy_from_slice(&first);
    assert!(matches!(open(&bytes), Err(RasterError::Damaged(_))));
}
