//! Rasters of a small city, read back with the crate `tiff`.

use super::*;
use crate::file::export;
use crate::format::{Format, Projections};
use crate::selection::ObjectSelection;
use crate::table::test_city::{COURT, ORIGIN, TestCity, manifest};
use crate::table::{ExportError, ExportReport, TableOptions};
use ::tiff::decoder::{Decoder, DecodingResult};
use ::tiff::tags::Tag;
use insula_protocol::TileId;
use insula_protocol::blockmap::NodeGround;
use std::fs::File;

struct Raster {
    report: ExportReport,
    size: [u32; 2],
    heights: Vec<f32>,
    decoder: Decoder<File>,
}

impl Raster {
    /// The height at a place in metres from the city's corner.
    fn at(&mut self, x: f64, y: f64) -> f32 {
        let tie = self.decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
        let column = ((ORIGIN[0] + x - tie[3]) / 0.5) as usize;
        let row = ((tie[4] - ORIGIN[1] - y) / 0.5) as usize;
        self.heights[row * self.size[0] as usize + column]
    }
}

fn read(selection: &ObjectSelection) -> Result<Raster, ExportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let projections = Projections { epsg: Some(28992), ..Projections::default() };
    let report =
        export(&TestCity::new(true), Format::GeoTiff, selection, &projections, TableOptions::default(), &path)?;
    let mut decoder = Decoder::new(File::open(&path).unwrap()).unwrap();
    let (width, height) = decoder.dimensions().unwrap();
    let DecodingResult::F32(heights) = decoder.read_image().unwrap() else { panic!("not floats") };
    Ok(Raster { report, size: [width, height], heights, decoder })
}

#[test]
fn heights_are_where_they_belong() {
    let mut raster = read(&ObjectSelection::default()).unwrap();
    assert_eq!(raster.size, [256, 256]);
    let places = [
        (4.1, 4.1, 9.0),
        (13.9, 11.9, 9.0),
        (35.9, 5.0, 6.0),
        (36.1, 5.0, 12.0),
        (77.9, 50.1, 15.0),
        (119.0, 93.0, 6.0),
    ];
    for (x, y, z) in places {
        assert_eq!(raster.at(x, y), z, "{x} {y}");
    }
    assert_eq!([(3.9, 4.1), (14.1, 5.0), (64.0, 64.0), (0.1, 127.9)].map(|(x, y)| raster.at(x, y)), [NODATA; 4]);
    let decoder = &mut raster.decoder;
    assert_eq!(decoder.chunk_dimensions(), (256, 256));
    assert_eq!(decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap(), [0.5, 0.5, 0.0]);
    assert_eq!(decoder.get_tag_ascii_string(Tag::Unknown(33432)).unwrap(), raster.report.attribution);
    assert_eq!(decoder.get_tag_ascii_string(Tag::GdalNodata).unwrap(), "-9999");
    let keys = decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap();
    assert!(
        keys.chunks(4).any(|key| key == [3072, 0, 1, 28992]) && keys.chunks(4).any(|key| key == [4096, 0, 1, 5709])
    );
    assert!(keys.chunks(4).skip(1).is_sorted_by_key(|key| key[0]));
}

#[test]
fn selections_crop_and_mask() {
    let [x, y, _] = ORIGIN;
    let bbox = Some([[x + 10.0, y + 5.2], [x + 60.0, y + 55.0]]);
    let mut raster = read(&ObjectSelection { bbox, ..ObjectSelection::default() }).unwrap();
    assert_eq!(raster.size, [100, 100]);
    // The middle of the southernmost cells is in the box, of others it would not be.
    assert_eq!((raster.at(10.1, 5.3), raster.at(59.9, 54.9), raster.at(40.0, 5.3)), (9.0, 15.0, 12.0));
    let objects = Some([COURT].into_iter().collect());
    let mut raster = read(&ObjectSelection { bbox, objects, ..ObjectSelection::default() }).unwrap();
    assert_eq!((raster.at(10.1, 5.3), raster.at(59.9, 54.9)), (NODATA, 15.0));
    let polygons = Some(crate::selection::SelectedArea::new(vec![vec![vec![[x, y], [x + 20.0, y], [x, y + 20.0]]]]));
    let mut raster = read(&ObjectSelection { polygons, ..ObjectSelection::default() }).unwrap();
    assert_eq!((raster.size, raster.at(4.1, 4.1), raster.at(13.9, 11.9)), ([40, 40], 9.0, NODATA));
    let nowhere = Some([[x - 9.0, y], [x - 8.0, y + 9.0]]);
    assert!(matches!(
        read(&ObjectSelection { bbox: nowhere, ..ObjectSelection::default() }),
        Err(ExportError::ObjectSelection(_))
    ));
}

#[test]
fn ground_that_the_source_does_not_have_is_marked() {
    let mut map = BlockMap::empty(TileId::ROOT, 0.5, 0, 0);
    map.flags[7] = flag::OCCUPIED;
    map.z_max[7] = 400;
    map.ground = Some(Box::new(NodeGround { squares: u64::MAX, ..NodeGround::default() }));
    let tops = node_tops(&manifest(2), map);
    let marks: Vec<bool> = tops.iter().flatten().map(|top| top.is_generated).collect();
    let given: Vec<usize> = (0..marks.len()).filter(|cell| !marks[*cell]).collect();
    assert_eq!((marks.len(), given), (COLUMNS, vec![7]));
}
