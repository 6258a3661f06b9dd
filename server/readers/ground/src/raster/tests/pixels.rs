//! Numbers of TIFF files: types, orders of bytes, tiles and strips, missing values, copies and masks.

use super::super::{RasterSize, SampleKind, Window};
use super::tiff_file::{TestForm, TestImage, Values, file};
use super::{assert_heights, heights, open};

const FORMS: [TestForm; 4] = [
    TestForm { is_big_endian: false, is_big_tiff: false },
    TestForm { is_big_endian: true, is_big_tiff: false },
    TestForm { is_big_endian: false, is_big_tiff: true },
    TestForm { is_big_endian: true, is_big_tiff: true },
];

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn floats(values: &[f32]) -> TestImage {
    TestImage::new([values.len() as u16, 1], 1, [32, 3], bytes_of(values))
}

#[test]
fn all_types_in_both_orders_of_bytes() {
    let half: [u16; 2] = [0xc000, 0x3555];
    for (bits, format, numbers, expected) in [
        (8, 1, vec![1, 0xff], [1.0, 255.0]),
        (8, 2, vec![1, 0xff], [1.0, -1.0]),
        (16, 1, vec![1, 0xfffe], [1.0, 65534.0]),
        (16, 2, vec![1, 0xfffe], [1.0, -2.0]),
        (32, 1, vec![1, 0xffff_0000], [1.0, 4_294_901_760.0]),
        (32, 2, vec![1, 0xffff_fffd], [1.0, -3.0]),
        (64, 1, vec![1, 1 << 40], [1.0, (1u64 << 40) as f32]),
        (64, 2, vec![1, u64::MAX], [1.0, -1.0]),
        (16, 3, half.map(u64::from).to_vec(), [-2.0, 0.333_251_95]),
        (32, 3, [1.5f32, -2.25].map(|number| u64::from(number.to_bits())).to_vec(), [1.5, -2.25]),
        (64, 3, [1.5f64, -2.25].map(f64::to_bits).to_vec(), [1.5, -2.25]),
    ] {
        for form in FORMS {
            let size = usize::from(bits) / 8;
            let pixels = numbers.iter().flat_map(|number| {
                let bytes = number.to_le_bytes().into_iter().take(size);
                if form.is_big_endian { bytes.rev().collect::<Vec<_>>() } else { bytes.collect() }
            });
            let image = TestImage::new([2, 1], 1, [bits, format], pixels.collect());
            assert_heights(&heights(&file(form, &[image]), 0), &expected);
        }
    }
}

#[test]
fn numbers_of_few_bits() {
    // Two rows of three pixels; each row starts with a new byte.
    for (bits, pixels, expected) in [
        (1, vec![0b1010_0000, 0b0110_0000], [1.0, 0.0, 1.0, 0.0, 1.0, 1.0]),
        (4, vec![0x12, 0x30, 0x45, 0x60], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        (12, vec![0x12, 0x34, 0x56, 0x78, 0x90, 0, 0x01, 0, 0x20, 0], [291.0, 1110.0, 1929.0, 0.0, 256.0, 512.0]),
    ] {
        let image = TestImage::new([3, 2], 1, [bits, 1], pixels);
        assert_heights(&heights(&image.file(), 0), &expected);
    }
}

#[test]
fn windows_of_tiles_and_tiles_left_out() {
    // 3 x 3 pixels in tiles of 2 x 2: value = column + 10 row. The last tile is left out.
    let tile = |values: [f32; 4]| bytes_of(&values);
    let tiles =
        vec![tile([0.0, 1.0, 10.0, 11.0]), tile([2.0, 99.0, 12.0, 99.0]), tile([20.0, 21.0, 99.0, 99.0]), vec![]];
    let image = TestImage::new([3, 3], 1, [32, 3], vec![]).tiles([2, 2], tiles);
    assert_heights(&heights(&image.file(), 0), &[0.0, 1.0, 2.0, 10.0, 11.0, 12.0, 20.0, 21.0, 0.0]);
    let bytes = image.tag(42113, Values::Text("-9999")).file();
    let mut raster = open(&bytes).unwrap();
    let window = |x, y, width, height| Window { x, y, width, height };
    assert_heights(&raster.read_heights(window(1, 1, 2, 2), 0).unwrap(), &[11.0, 12.0, 21.0, f32::NAN]);
    assert_heights(&raster.read_heights(window(2, 0, 1, 1), 0).unwrap(), &[2.0]);
    for outside in [window(2, 0, 2, 1), window(0, 3, 1, 1), window(0, 0, 0, 1), window(u32::MAX, 0, 2, 1)] {
        assert!(raster.read_heights(outside, 0).is_err());
    }
    assert!(raster.read_heights(window(0, 0, 1, 1), 1).is_err());
}

#[test]
fn bands_beside_each_other_and_apart() {
    let together = TestImage::new([2, 1], 2, [8, 1], vec![1, 100, 2, 200]);
    let mut apart = TestImage::new([2, 1], 2, [8, 1], vec![1, 2]).shorts(284, &[2]);
    apart.chunks.push(vec![100, 200]);
    for image in [together, apart] {
        assert_heights(&heights(&image.file(), 0), &[1.0, 2.0]);
        // The second band is alpha: the height without it is missing.
        let mut image = image.shorts(338, &[2]);
        image.chunks.iter_mut().flatten().filter(|value| **value == 200).for_each(|value| *value = 0);
        assert_heights(&heights(&image.file(), 0), &[1.0, f32::NAN]);
    }
}

#[test]
fn alpha_that_no_file_declares_is_known_by_its_numbers() {
    let read = |numbers: [f32; 8]| {
        let bytes = TestImage::new([2, 2], 2, [32, 3], bytes_of(&numbers)).file();
        (heights(&bytes, 0), open(&bytes).unwrap().warning())
    };
    let (with_alpha, warning) = read([10.0, 255.0, 0.0, 0.0, 12.0, 255.0, 0.0, 0.0]);
    assert_heights(&with_alpha, &[10.0, f32::NAN, 12.0, f32::NAN]);
    assert!(warning.is_some_and(|text| text.contains("mark missing heights")));
    // Something else: other numbers, heights that differ where it is 0, nothing that is full.
    for numbers in [
        [10.0, 255.0, 0.0, 0.0, 12.0, 128.0, 0.0, 0.0],
        [10.0, 255.0, 3.0, 0.0, 12.0, 255.0, 0.0, 0.0],
        [10.0, 1.0, 0.0, 0.0, 12.0, 1.0, 0.0, 0.0],
        [10.0, 0.0, 10.0, 0.0, 10.0, 0.0, 10.0, 0.0],
    ] {
        let (all, warning) = read(numbers);
        assert_heights(&all, &[numbers[0], numbers[2], numbers[4], numbers[6]]);
        assert_eq!(warning, None, "{numbers:?}");
    }
}

#[test]
fn differences_between_neighbours() {
    let row = TestImage::new([3, 1], 1, [16, 2], vec![10, 0, 1, 0, 0xfe, 0xff]).shorts(317, &[2]);
    assert_heights(&heights(&row.file(), 0), &[10.0, 11.0, 9.0]);
    // Floating point: the high bytes of all numbers come first, each byte as a difference to the one before.
    let values = [1.5f32, -100.25, 3.0e9];
    let sorted: Vec<u8> = (0..4).flat_map(|place| values.map(|value| value.to_be_bytes()[place])).collect();
    let before = [0].into_iter().chain(sorted.iter().copied());
    let differences = sorted.iter().zip(before).map(|(byte, before)| byte.wrapping_sub(before)).collect();
    let image = TestImage::new([3, 1], 1, [32, 3], differences).shorts(317, &[3]);
    for form in FORMS {
        assert_heights(&heights(&file(form, std::slice::from_ref(&image)), 0), &values);
    }
    let image = image.shorts(317, &[7]);
    assert!(open(&image.file()).unwrap().read_heights(Window { x: 0, y: 0, width: 1, height: 1 }, 0).is_err());
}

#[test]
fn missing_values_and_scales() {
    for (text, missing) in [
        ("-9999", -9999.0),
        ("nan", f32::NAN),
        (" 3.4e38 ", 3.4e38),
        ("-3.40282346638529e+38", f32::MIN),
        ("-3.40282306e38", f32::MIN),
    ] {
        let image = floats(&[1.0, missing, f32::INFINITY, -9998.5]).tag(42113, Values::Text(text));
        assert_heights(&heights(&image.file(), 0), &[1.0, f32::NAN, f32::NAN, -9998.5]);
    }
    let metadata = "<GDALMetadata><Item name=\"SCALE\" sample=\"1\" role=\"scale\">7</Item>\
        <Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.5</Item>\
        <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">-10</Item>\
        <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">ft</Item></GDALMetadata>";
    let image = TestImage::new([3, 1], 1, [8, 1], vec![0, 1, 250]).tag(42112, Values::Text(metadata));
    let bytes = image.tag(42113, Values::Text("0")).file();
    assert_heights(&heights(&bytes, 0), &[f32::NAN, -9.5, 115.0]);
    let raster = open(&bytes).unwrap();
    assert_eq!((raster.facts().nodata, raster.facts().sample), (Some(0.0), SampleKind::U8));
    assert_eq!((raster.facts().crs.height_unit_m, raster.warning()), (Some(0.3048), None));
    assert_eq!(raster.facts().odd_number, None);
    let metadata = "<GDALMetadata><Item name=\"SCALE\" sample=\"0\" role=\"scale\">0,5</Item>\
        <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">abc</Item></GDALMetadata>";
    let bytes = TestImage::new([3, 1], 1, [8, 1], vec![0, 1, 250]).tag(42112, Values::Text(metadata)).file();
    assert_heights(&heights(&bytes, 0), &[0.0, 0.5, 125.0]);
    let odd = "its offset \"abc\" is no number and does not count";
    assert_eq!(open(&bytes).unwrap().facts().odd_number.as_deref(), Some(odd));
}

#[test]
fn scale_of_heights() {
    let image = |scale: f64| {
        let image = TestImage::new([2, 1], 1, [8, 1], vec![10, 250]).tag(33550, Values::Doubles(vec![1.0, 1.0, scale]));
        image.tag(33922, Values::Doubles(vec![0.0, 0.0, 10.0, 0.0, 0.0, 7.0]))
    };
    let bytes = image(0.1).file();
    assert_heights(&heights(&bytes, 0), &[7.0, 31.0]);
    assert_eq!(
        open(&bytes).unwrap().warning().as_deref(),
        Some("heights are taken as 0.1 times the numbers plus 6, by ModelPixelScale")
    );
    for (scale, metadata) in [(0.0, ""), (1.0, ""), (f64::NAN, ""), (0.1, "<Item sample=\"0\" role=\"scale\">1</Item>")]
    {
        let bytes = image(scale).tag(42112, Values::Text(metadata)).file();
        assert_heights(&heights(&bytes, 0), &[10.0, 250.0]);
        assert_eq!(open(&bytes).unwrap().warning(), None);
    }
}

#[test]
fn smaller_copies_and_masks() {
    let reduced = |values: &[f32], kind: u16| floats(values).shorts(254, &[kind]);
    let mask = |pixels: u8, width: u16, kind: u16| {
        TestImage::new([width, 1], 1, [1, 1], vec![pixels]).shorts(254, &[kind]).shorts(262, &[4])
    };
    let images = [
        floats(&[1.0, 2.0, 3.0, 4.0]),
        mask(0b1011_0000, 4, 4),
        reduced(&[8.0], 1),
        // Another page, which is no copy.
        reduced(&[5.0, 5.0, 5.0], 0),
        reduced(&[6.0, 7.0], 1),
        mask(0b0100_0000, 2, 5),
    ];
    let bytes = file(TestForm::default(), &images);
    let raster = open(&bytes).unwrap();
    let widths: Vec<u32> = raster.facts().levels.iter().map(|level| level.width).collect();
    assert_eq!((widths, raster.facts().has_mask), (vec![4, 2], true), "the smallest copy has no mask");
    assert_eq!(raster.facts().levels[1], RasterSize { width: 2, height: 1 });
    assert!(raster.warning().is_some_and(|text| text.contains("only the first of its images")));
    assert_heights(&heights(&bytes, 0), &[1.0, f32::NAN, 3.0, 4.0]);
    assert_heights(&heights(&bytes, 1), &[f32::NAN, 7.0]);
    assert_heights(&heights(&file(TestForm::default(), &[images[0].clone(), images[2].clone()]), 1), &[8.0]);
}

#[test]
fn masks_beside_a_raster_hide_pixels() {
    let copy = floats(&[6.0, 7.0]).shorts(254, &[1]);
    let bytes = file(TestForm::default(), &[floats(&[1.0, 2.0, 3.0, 4.0]), copy]);
    let mask = |pixels: &[u8]| TestImage::new([pixels.len() as u16, 1], 1, [8, 1], pixels.to_vec());
    let masked = |images: &[TestImage]| {
        let mut raster = open(&bytes).unwrap();
        let reader = std::io::Cursor::new(file(TestForm::default(), images));
        raster.set_mask(Box::new(reader)).map(|()| raster)
    };
    let window = |width| Window { x: 0, y: 0, width, height: 1 };
    let mut raster = masked(&[mask(&[255, 0, 255, 1])]).unwrap();
    assert_eq!(raster.facts().levels, [RasterSize { width: 4, height: 1 }], "no copy without a mask");
    assert_heights(&raster.read_heights(window(4), 0).unwrap(), &[1.0, f32::NAN, 3.0, 4.0]);
    let mut raster = masked(&[mask(&[255; 4]), mask(&[0, 255]).shorts(254, &[1])]).unwrap();
    assert_heights(&raster.read_heights(window(2), 1).unwrap(), &[f32::NAN, 7.0]);
    assert!(masked(&[mask(&[255, 0])]).is_err(), "of another size");
    // Pictures, too.
    let picture = TestImage::new([2, 1], 3, [8, 1], vec![9; 6]).shorts(262, &[2]).file();
    let mut raster = open(&picture).unwrap();
    raster.set_mask(Box::new(std::io::Cursor::new(mask(&[0, 255]).file()))).unwrap();
    assert_eq!(raster.read_colours(window(2), 0).unwrap(), [[9, 9, 9, 0], [9, 9, 9, 255]]);
}

#[test]
fn one_large_strip_is_read_in_pieces() {
    // Larger than the limit of a strip.
    let (width, height) = (1024u16, 1200u16);
    let pixels = (0..u32::from(width) * u32::from(height)).flat_map(|index| (index as f32).to_le_bytes()).collect();
    let bytes = TestImage::new([width, height], 1, [32, 3], pixels).file();
    let mut raster = open(&bytes).unwrap();
    let actual = raster.read_heights(Window { x: 7, y: 255, width: 2, height: 3 }, 0).unwrap();
    let expected: Vec<f32> = (255..258).flat_map(|y| [7, 8].map(|x| (y * 1024 + x) as f32)).collect();
    assert_heights(&actual, &expected);
    assert_heights(&raster.read_heights(Window { x: 1023, y: 1199, width: 1, height: 1 }, 0).unwrap(), &[1_228_799.0]);
}
