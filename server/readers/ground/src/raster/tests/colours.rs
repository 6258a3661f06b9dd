//! Colours of TIFF files.

use super::super::Window;
use super::tiff_file::{TestForm, TestImage, Values, file};
use super::{colours, open};

/// Two pixels of bands of 8 bits.
fn pixels(bands: u16, photometric: u16, numbers: &[u8]) -> TestImage {
    TestImage::new([2, 1], bands, [8, 1], numbers.to_vec()).shorts(262, &[photometric])
}

#[test]
fn a_black_corner_of_a_picture_is_found() {
    let picture = |corner: u8| {
        let inner = |at: u32| if at % 16 < 8 && at / 16 < 8 { corner } else { 200 };
        let pixels = (0..16 * 16).flat_map(|at| [inner(at); 3]).collect();
        TestImage::new([16, 16], 3, [8, 1], pixels).shorts(262, &[2])
    };
    let is_found = |image: &TestImage| open(&image.file()).unwrap().has_black_corner();
    assert!(is_found(&picture(0)) && !is_found(&picture(1)));
    assert!(!is_found(&picture(0).tag(42113, Values::Text("0"))), "told");
    let mut raster = open(&picture(0).file()).unwrap();
    raster.set_missing_colour(0.0);
    assert!(!raster.has_black_corner(), "told beside the file");
    let window = Window { x: 7, y: 0, width: 2, height: 1 };
    assert_eq!(raster.read_colours(window, 0).unwrap(), [[0; 4], [200, 200, 200, 255]]);
}

#[test]
fn kinds_of_colours() {
    assert_eq!(colours(&pixels(1, 1, &[0, 7]).file()), [[0, 0, 0, 255], [7, 7, 7, 255]]);
    assert_eq!(colours(&pixels(1, 0, &[0, 7]).file()), [[255; 4], [248, 248, 248, 255]]);
    assert_eq!(colours(&pixels(3, 2, &[1, 2, 3, 4, 5, 6]).file()), [[1, 2, 3, 255], [4, 5, 6, 255]]);
    // Grey and two more bands, by writers that do not know of colours.
    assert_eq!(colours(&pixels(3, 1, &[1, 2, 3, 4, 5, 6]).file()), [[1, 2, 3, 255], [4, 5, 6, 255]]);
    assert_eq!(colours(&pixels(4, 5, &[0, 0, 0, 0, 0, 255, 0, 51]).file()), [[255; 4], [204, 0, 204, 255]]);
    // Infrared is no alpha.
    let infrared = pixels(4, 2, &[1, 2, 3, 0, 4, 5, 6, 9]).shorts(338, &[0]);
    assert_eq!(colours(&infrared.file()), [[1, 2, 3, 255], [4, 5, 6, 255]]);
    let mut map = vec![0; 768];
    (map[1], map[256 + 1], map[512 + 1]) = (0xff00, 0x8000, 0x0100);
    assert_eq!(colours(&pixels(1, 3, &[1, 200]).shorts(320, &map).file()), [[255, 128, 1, 255], [0, 0, 0, 255]]);
    assert_eq!(colours(&pixels(1, 3, &[1, 2]).file()), [[0, 0, 0, 255]; 2]);
    // The list was added to a grey image.
    let late = pixels(1, 1, &[1, 200]).shorts(320, &map);
    assert_eq!(colours(&late.file()), [[255, 128, 1, 255], [0, 0, 0, 255]]);
    assert_eq!(open(&late.file()).unwrap().is_picture("dgm.tif"), (true, None));
    let wide = TestImage::new([2, 1], 1, [16, 1], vec![0xff, 0xff, 0x00, 0x80]);
    assert_eq!(colours(&wide.file()), [[255; 4], [128, 128, 128, 255]]);
    let black_and_white = TestImage::new([2, 1], 1, [1, 1], vec![0b0100_0000]);
    assert_eq!(colours(&black_and_white.file()), [[0, 0, 0, 255], [255; 4]]);
}

#[test]
fn bands_with_names_of_colours() {
    const BGR: &str = concat!(
        "<GDALMetadata><Item name=\"COLORINTERP\" sample=\"0\" role=\"colorinterp\">Blue</Item>",
        "<Item name=\"COLORINTERP\" sample=\"1\" role=\"colorinterp\">Green</Item>",
        "<Item name=\"COLORINTERP\" sample=\"2\" role=\"colorinterp\">Red</Item></GDALMetadata>"
    );
    const INFRARED_FIRST: &str = concat!(
        "<GDALMetadata><Item name=\"COLORINTERP\" sample=\"0\" role=\"colorinterp\">Undefined</Item>",
        "<Item name=\"COLORINTERP\" sample=\"1\" role=\"colorinterp\">Red</Item>",
        "<Item name=\"COLORINTERP\" sample=\"2\" role=\"colorinterp\">Green</Item>",
        "<Item name=\"COLORINTERP\" sample=\"3\" role=\"colorinterp\">Blue</Item></GDALMetadata>"
    );
    let reversed = pixels(3, 2, &[1, 2, 3, 4, 5, 6]).tag(42112, Values::Text(BGR));
    assert_eq!(colours(&reversed.file()), [[3, 2, 1, 255], [6, 5, 4, 255]]);
    let transparent = pixels(4, 2, &[1, 2, 3, 255, 4, 5, 6, 0]).shorts(338, &[2]).tag(42112, Values::Text(BGR));
    assert_eq!(colours(&transparent.file()), [[3, 2, 1, 255], [6, 5, 4, 0]]);
    // The last band is said to be alpha by the format, but has the name of a colour.
    let infrared = pixels(4, 2, &[9, 1, 2, 3, 9, 4, 5, 6]).shorts(338, &[2]);
    let infrared = infrared.tag(42112, Values::Text(INFRARED_FIRST));
    assert_eq!(colours(&infrared.file()), [[1, 2, 3, 255], [4, 5, 6, 255]]);
    // Names of bands that are not there.
    let few = pixels(3, 2, &[1, 2, 3, 4, 5, 6]).tag(42112, Values::Text(INFRARED_FIRST));
    assert_eq!(colours(&few.file()), [[1, 2, 3, 255], [4, 5, 6, 255]]);
}

#[test]
fn one_band_of_bytes_is_a_picture_unless_something_tells_heights() {
    let grey = pixels(1, 1, &[0, 7]);
    let unit = "<GDALMetadata><Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">m</Item></GDALMetadata>";
    let in_metres = grey.clone().tag(42112, Values::Text(unit));
    let marked = grey.clone().tag(42113, Values::Text("0"));
    for (image, name, is_picture, is_guess) in [
        (&grey, "a/dem/photo.tif", true, true),
        (&grey, "dgm1_32.tif", false, true),
        (&marked, "photo.tif", true, true),
        (&in_metres, "a.tif", false, false),
        (&pixels(1, 3, &[1, 2]), "dem.tif", true, false),
        (&pixels(3, 2, &[0; 6]), "dem.tif", true, false),
        (&TestImage::new([2, 1], 1, [16, 2], vec![0; 4]), "a.tif", false, false),
    ] {
        let (found, guess) = open(&image.file()).unwrap().is_picture(name);
        assert_eq!((found, guess.is_some()), (is_picture, is_guess), "{name}");
    }
}

#[test]
fn colours_of_16_bits_may_have_fewer() {
    let wide = |numbers: [u16; 3]| {
        let bytes = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        TestImage::new([1, 1], 3, [16, 1], bytes).shorts(262, &[2])
    };
    let statistics = "<GDALMetadata><Item name=\"STATISTICS_MAXIMUM\" sample=\"0\">9000</Item></GDALMetadata>";
    for (image, expected, is_guess) in [
        (wide([4095, 0, 819]), [255, 0, 51], true),
        (wide([16_383, 0, 0]), [255, 0, 0], true),
        (wide([255, 0, 51]), [255, 0, 51], true),
        (wide([1000, 0, 0]), [249, 0, 0], true),
        (wide([2047, 0, 1024]), [255, 0, 128], true),
        (wide([65_535, 0, 13_107]), [255, 0, 51], false),
        (wide([4095, 0, 0]).tag(42112, Values::Text(statistics)), [64, 0, 0], true),
        (wide([1023, 0, 0]).shorts(281, &[1023; 3]), [255, 0, 0], false),
        (wide([0; 3]), [0; 3], false),
    ] {
        let bytes = image.file();
        assert_eq!(colours(&bytes), [[expected[0], expected[1], expected[2], 255]]);
        assert_eq!(open(&bytes).unwrap().warning().is_some(), is_guess, "{expected:?}");
    }
}

#[test]
fn transparent_pixels() {
    let alpha = pixels(4, 2, &[10, 20, 30, 255, 10, 20, 30, 51]);
    assert_eq!(colours(&alpha.clone().shorts(338, &[2]).file()), [[10, 20, 30, 255], [10, 20, 30, 51]]);
    assert_eq!(colours(&alpha.shorts(338, &[1]).file()), [[10, 20, 30, 255], [50, 100, 150, 51]]);
    let grey = pixels(2, 1, &[9, 255, 9, 0]).shorts(338, &[2]);
    assert_eq!(colours(&grey.file()), [[9, 9, 9, 255], [9, 9, 9, 0]]);
    // A pixel is missing if all of its colours are.
    let nodata = pixels(3, 2, &[0, 0, 1, 0, 0, 0]).tag(42113, Values::Text("0"));
    assert_eq!(colours(&nodata.file()), [[0, 0, 1, 255], [0, 0, 0, 0]]);
    let mask = TestImage::new([2, 1], 1, [1, 1], vec![0b0100_0000]).shorts(254, &[4]);
    let masked = file(TestForm::default(), &[pixels(1, 1, &[5, 6]), mask]);
    assert_eq!(colours(&masked), [[5, 5, 5, 0], [6, 6, 6, 255]]);
}

#[test]
fn numbers_without_colours_are_refused() {
    let window = Window { x: 0, y: 0, width: 1, height: 1 };
    for image in [
        TestImage::new([2, 1], 1, [32, 3], vec![0; 8]),
        TestImage::new([2, 1], 1, [16, 2], vec![0; 4]),
        pixels(1, 9, &[0, 0]),
        pixels(2, 2, &[0; 4]),
    ] {
        assert!(open(&image.file()).unwrap().read_colours(window, 0).is_err());
    }
}

/// 32 x 32 pixels of (8 x, 8 y, 255 - 4 x).
fn assert_gradient(pixels: &[[u8; 4]], tolerance: u8) {
    assert_eq!(pixels.len(), 32 * 32);
    for (index, pixel) in pixels.iter().enumerate() {
        let (x, y) = ((index % 32) as u8, (index / 32) as u8);
        let expected = [x * 8, y * 8, 255 - x * 4, 255];
        let is_near = pixel.iter().zip(expected).all(|(value, expected)| value.abs_diff(expected) <= tolerance);
        assert!(is_near, "{x} {y}: {pixel:?} is not {expected:?}");
    }
}

#[test]
fn pictures_of_gdal() {
    assert_gradient(&colours(include_bytes!("data/jpeg.tif")), 12);
    assert_gradient(&colours(include_bytes!("data/webp.tif")), 0);
    assert_gradient(&colours(include_bytes!("data/picture.jp2")), 0);
}
