//! Places and coordinate systems.

use super::super::{GeoPlace, RasterCrs};
use super::open;
use super::tiff_file::{TestForm, TestImage, Values, file};

const SCALE: u16 = 33550;
const TIE_POINT: u16 = 33922;
const TRANSFORMATION: u16 = 34264;
const KEYS: u16 = 34735;
const TEXTS: u16 = 34737;

fn image() -> TestImage {
    TestImage::new([4, 2], 1, [8, 1], vec![0; 8])
}

fn place_of(image: &TestImage) -> Option<GeoPlace> {
    open(&image.file()).unwrap().facts().place
}

/// Keys with their values.
fn keys(keys: &[[u16; 2]]) -> Vec<u16> {
    let entries = keys.iter().flat_map(|[key, value]| [*key, 0, 1, *value]);
    [1, 1, 0, keys.len() as u16].into_iter().chain(entries).collect()
}

fn crs_of(directory: &[u16], text: &'static str) -> RasterCrs {
    open(&image().shorts(KEYS, directory).tag(TEXTS, Values::Text(text)).file()).unwrap().facts().crs.clone()
}

#[test]
fn pixels_as_areas_and_as_points() {
    let image = image().tag(SCALE, Values::Doubles(vec![2.0, 4.0, 0.0]));
    let image = image.tag(TIE_POINT, Values::Doubles(vec![1.0, 0.0, 0.0, 100.0, 50.0, 0.0]));
    let place = place_of(&image).unwrap();
    assert_eq!((place.origin, place.column, place.row), ([99.0, 48.0], [2.0, 0.0], [0.0, -4.0]));
    let place = place_of(&image.clone().shorts(KEYS, &keys(&[[1025, 2]]))).unwrap();
    assert_eq!(place.origin, [98.0, 50.0]);
    assert_eq!(place.position(3.0, 1.0), [104.0, 46.0]);
    assert_eq!(place.pixel([104.0, 46.0]), [3.0, 1.0]);
    for scale in [vec![2.0], vec![0.0, 4.0, 0.0], vec![f64::NAN, 4.0, 0.0], vec![1e300, 4.0, 0.0]] {
        assert_eq!(place_of(&image.clone().tag(SCALE, Values::Doubles(scale))), None);
    }
}

#[test]
fn turned_rasters() {
    let mut matrix = vec![0.0; 16];
    (matrix[0], matrix[1], matrix[3], matrix[4], matrix[5], matrix[7]) = (0.0, 2.0, 10.0, 3.0, 0.0, 20.0);
    let image = image().tag(TRANSFORMATION, Values::Doubles(matrix));
    let place = place_of(&image).unwrap();
    assert_eq!((place.origin, place.column, place.row), ([11.0, 21.5], [0.0, 3.0], [2.0, 0.0]));
    assert_eq!(place.pixel(place.position(2.0, -7.0)), [2.0, -7.0]);
}

#[test]
fn smaller_copies_cover_the_same_area() {
    let image = image().tag(SCALE, Values::Doubles(vec![1.0, 1.0, 0.0]));
    let image = image.tag(TIE_POINT, Values::Doubles(vec![0.0, 0.0, 0.0, 0.0, 2.0, 0.0]));
    let small = TestImage::new([2, 1], 1, [8, 1], vec![0; 2]).shorts(254, &[1]);
    let bytes = file(TestForm::default(), &[image, small]);
    let place = open(&bytes).unwrap().facts().place_of_level(1).unwrap();
    assert_eq!((place.origin, place.column, place.row), ([1.0, 1.0], [2.0, 0.0], [0.0, -2.0]));
    assert_eq!(open(&bytes).unwrap().facts().place_of_level(2), None);
}

#[test]
fn coordinate_systems() {
    let crs = crs_of(&keys(&[[1024, 1], [3072, 28992], [4096, 5709], [4099, 9001]]), "");
    assert_eq!(crs.horizontal.as_deref(), Some("EPSG:28992"));
    assert_eq!((crs.vertical.as_deref(), crs.height_unit_m), (Some("EPSG:5709"), Some(1.0)));
    let crs = crs_of(&keys(&[[1024, 2], [2048, 4326], [4096, 5030], [4099, 9003]]), "");
    assert_eq!((crs.horizontal.as_deref(), crs.vertical, crs.is_ellipsoidal), (Some("EPSG:4326"), None, true));
    assert_eq!(crs.height_unit_m, Some(1200.0 / 3937.0));
    // The unit of a system with a code, and another one.
    let own = crs_of(&keys(&[[1024, 1], [3072, 2263], [3076, 9003]]), "");
    assert_eq!((own.horizontal.as_deref(), own.other_unit), (Some("EPSG:2263"), None));
    let other = crs_of(&keys(&[[1024, 1], [3072, 2263], [3076, 9001]]), "").other_unit.unwrap();
    assert!(other.contains("is 1 m by its key, but 0.3048"), "{other}");
    // A projection that the file defines itself is not its geographic system.
    let directory = [1, 1, 0, 4, 1024, 0, 1, 1, 2048, 0, 1, 4326, 3072, 0, 1, 32767, 3073, TEXTS, 8, 3];
    let crs = crs_of(&directory, "xx|My grid|");
    assert_eq!((crs.horizontal, crs.citation.as_deref()), (None, Some("My grid")));
    // Texts that are not there.
    for directory in [vec![1, 1, 0, 1, 1026, TEXTS, 9, 9000], vec![1, 1, 0, 9, 1026], vec![1, 1], vec![]] {
        assert_eq!(crs_of(&directory, "text"), RasterCrs::default());
    }
}

#[test]
fn world_files() {
    let place = GeoPlace::from_world_file("0.5\n0.0\n0.0\n-0.25\n1000.25\n1999,875\n").unwrap();
    assert_eq!(place.origin, [1000.25, 1999.875]);
    assert_eq!((place.column, place.row), ([0.5, 0.0], [0.0, -0.25]));
    for text in ["", "1 2 3 4 5", "1 0 0 x 0 0", "0 0 0 0 1 1", "1 0 0 inf 0 0", "1 0 0 -1 nan 0"] {
        assert!(GeoPlace::from_world_file(text).is_err(), "{text}");
    }
}

#[test]
fn projections_that_the_file_defines() {
    // South Africa's Lo19: transverse Mercator at 19 degrees east, with numbers among the real ones.
    let keys = [1, 1, 0, 5, 1024, 0, 1, 1, 2048, 0, 1, 4326, 3072, 0, 1, 32767, 3075, 0, 1, 1, 3080, 34736, 1, 0];
    let file = image().shorts(KEYS, &keys).tag(34736, Values::Doubles(vec![19.0])).file();
    let crs = open(&file).unwrap().facts().crs.clone();
    assert_eq!(crs.horizontal.as_deref(), Some("+proj=tmerc +datum=WGS84 +units=m +lon_0=19"));
    let crs_of = |own: &[[u16; 4]], reals: &[f64]| {
        let of_all = [[1, 1, 0, own.len() as u16 + 1], [1024, 0, 1, 1]];
        let keys: Vec<u16> = of_all.iter().chain(own).flatten().copied().collect();
        let file = image().shorts(KEYS, &keys).tag(34736, Values::Doubles(reals.to_vec())).file();
        open(&file).unwrap().facts().crs.clone()
    };
    let [datum, method] = [[2048, 0, 1, 4326], [3075, 0, 1, 1]];
    let feet = crs_of(&[datum, method, [3076, 0, 1, 9002], [3082, 34736, 1, 0], [4096, 0, 1, 6360]], &[1000.0]);
    assert_eq!(feet.horizontal.as_deref(), Some("+proj=tmerc +datum=WGS84 +to_meter=0.3048 +x_0=304.8"));
    assert!((feet.height_unit_m.unwrap() - 1200.0 / 3937.0).abs() < 1e-12, "of its vertical system");
    assert_eq!(crs_of(&[datum, method, [3076, 0, 1, 32767]], &[0.0]).horizontal, None);
    // Only the ellipsoid is known.
    let own = [2048, 0, 1, 32767];
    let by_code = crs_of(&[own, [2056, 0, 1, 7019], method], &[0.0]);
    assert_eq!(by_code.horizontal.as_deref(), Some("+proj=tmerc +ellps=GRS80 +units=m"));
    let radii = [[2057, 34736, 1, 0], [2059, 34736, 1, 1], [2061, 34736, 1, 2]];
    let by_radii = |meridian| crs_of(&[own, radii[0], radii[1], radii[2], method], &[6378137.0, 298.25, meridian]);
    assert_eq!(by_radii(0.0).horizontal.as_deref(), Some("+proj=tmerc +a=6378137 +rf=298.25 +units=m"));
    assert_eq!(by_radii(2.3).horizontal, None, "another prime meridian");
}
