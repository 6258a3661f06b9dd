//! Files of the encoder of `tiff`, with each of its compressions.

use super::{assert_heights, colours, heights};
use std::io::Cursor;
use tiff::encoder::colortype::{ColorType, Gray16, Gray32Float, Gray64Float, GrayI16, GrayI32, RGB8};
use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, TiffValue};

const SIZE: u32 = 40;

/// A file of 40 x 40 pixels with strips of 7 rows.
fn encoded<C: ColorType>(values: &[C::Inner], compression: Compression, predictor: Predictor) -> Vec<u8>
where
    [C::Inner]: TiffValue,
{
    let mut bytes = Vec::new();
    let encoder = TiffEncoder::new(Cursor::new(&mut bytes)).unwrap();
    let mut encoder = encoder.with_compression(compression).with_predictor(predictor);
    let mut image = encoder.new_image::<C>(SIZE, SIZE).unwrap();
    image.rows_per_strip(7).unwrap();
    image.write_data(values).unwrap();
    bytes
}

fn check<C: ColorType>(number: impl Fn(u32) -> C::Inner, height: impl Fn(u32) -> f32)
where
    [C::Inner]: TiffValue,
{
    let values: Vec<C::Inner> = (0..SIZE * SIZE).map(number).collect();
    let expected: Vec<f32> = (0..SIZE * SIZE).map(height).collect();
    let deflate = Compression::Deflate(DeflateLevel::Balanced);
    for compression in [Compression::Uncompressed, Compression::Lzw, deflate, Compression::Packbits] {
        assert_heights(&heights(&encoded::<C>(&values, compression, Predictor::None), 0), &expected);
    }
}

#[test]
fn every_compression_with_every_type() {
    check::<Gray16>(|index| (index * 31) as u16, |index| f32::from((index * 31) as u16));
    check::<GrayI16>(|index| (index * 31) as i16, |index| f32::from((index * 31) as i16));
    check::<GrayI32>(|index| -(index as i32), |index| -(index as f32));
    check::<Gray32Float>(|index| index as f32 / 7.0, |index| index as f32 / 7.0);
    check::<Gray64Float>(|index| f64::from(index) / 8.0, |index| index as f32 / 8.0);
}

#[test]
fn differences_of_the_encoder() {
    let values: Vec<u16> = (0..SIZE * SIZE).map(|index| (index * 977) as u16).collect();
    let expected: Vec<f32> = values.iter().map(|value| f32::from(*value)).collect();
    assert_heights(&heights(&encoded::<Gray16>(&values, Compression::Lzw, Predictor::Horizontal), 0), &expected);
    let values: Vec<u8> = (0..SIZE * SIZE * 3).map(|index| (index * 7) as u8).collect();
    let pixels = colours(&encoded::<RGB8>(&values, Compression::Lzw, Predictor::Horizontal));
    let expected: Vec<[u8; 4]> = values.chunks_exact(3).map(|pixel| [pixel[0], pixel[1], pixel[2], 255]).collect();
    assert_eq!(pixels, expected);
}

#[test]
fn zstd_strips() {
    let values: Vec<u8> = (0..200).collect();
    let packed = zstd::encode_all(&values[..], 3).unwrap();
    let image = super::tiff_file::TestImage::new([20, 10], 1, [8, 1], packed).shorts(259, &[50000]);
    let expected: Vec<f32> = values.iter().map(|value| f32::from(*value)).collect();
    assert_heights(&heights(&image.file(), 0), &expected);
}
