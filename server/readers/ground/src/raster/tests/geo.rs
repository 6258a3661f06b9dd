//! Places and coordinate systems.

use super::super::{GeoPlace, RasterCrs};
use super::open;
use super::tiff_file::{TestForm, TestImage, Values, file};
use insula_place::crs::{CrsError, resolve};

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
    let odd = crs_of(&keys(&[[1024, 1], [3072, 28992], [4099, 9999]]), "").other_unit;
    assert!(odd.is_some_and(|text| text.contains("heights has the number 9999")));
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
    let [datum, method] = [[2048, 0, 1, 4326], [3075, 0, 1, 1]];
    let feet = own_crs(&[datum, method, [3076, 0, 1, 9002], [3082, 34736, 1, 0], [4096, 0, 1, 6360]], &[1000.0]);
    assert_eq!(feet.horizontal.as_deref(), Some("+proj=tmerc +datum=WGS84 +to_meter=0.3048 +x_0=304.8"));
    assert!((feet.height_unit_m.unwrap() - 1200.0 / 3937.0).abs() < 1e-12, "of its vertical system");
    let unknown = own_crs(&[datum, method, [3076, 0, 1, 32767]], &[0.0]);
    assert_eq!(unknown.horizontal, None);
    assert!(matches!(resolve(&unknown.citation.unwrap()), Err(CrsError::Unsupported(_))), "not as if it had no system");
    let links = own_crs(&[datum, method, [3076, 0, 1, 32767], [3077, 34736, 1, 0]], &[0.201168]);
    assert_eq!(links.horizontal.as_deref(), Some("+proj=tmerc +datum=WGS84 +to_meter=0.201168"));
    // Only the ellipsoid is known.
    let own = [2048, 0, 1, 32767];
    let by_code = own_crs(&[own, [2056, 0, 1, 7019], method], &[0.0]);
    assert_eq!(by_code.horizontal.as_deref(), Some("+proj=tmerc +ellps=GRS80 +units=m"));
    let radii = [[2057, 34736, 1, 0], [2059, 34736, 1, 1], [2061, 34736, 1, 2]];
    let by_radii = |meridian| own_crs(&[own, radii[0], radii[1], radii[2], method], &[6378137.0, 298.25, meridian]);
    assert_eq!(by_radii(0.0).horizontal.as_deref(), Some("+proj=tmerc +a=6378137 +rf=298.25 +units=m"));
    let from_paris = by_radii(2.3).horizontal;
    assert_eq!(from_paris.as_deref(), Some("+proj=tmerc +a=6378137 +rf=298.25 +pm=2.3 +units=m"));
    let shifted = [own, radii[0], radii[1], [2062, 34736, 3, 2], method];
    let shifted = own_crs(&shifted, &[6377397.155, 299.15, 598.1, 73.7, 418.2]).horizontal;
    assert_eq!(shifted.as_deref(), Some("+proj=tmerc +a=6377397.155 +rf=299.15 +towgs84=598.1,73.7,418.2 +units=m"));
    // The datum of a base by its number, and by that of the datum.
    for base in [[[2048, 0, 1, 4230]; 2], [own, [2050, 0, 1, 6230]]] {
        let crs = own_crs(&[base[0], base[1], method], &[0.0]).horizontal.unwrap();
        assert!(crs.starts_with("+proj=tmerc +ellps=intl"), "{crs}");
    }
    let unknown = own_crs(&[[2048, 0, 1, 4320], method], &[0.0]);
    assert_eq!(unknown.citation.as_deref(), Some("+proj=tmerc +datum=EPSG:4320 +units=m"));
}

/// The system of keys that do not tell a code.
fn own_crs(own: &[[u16; 4]], reals: &[f64]) -> RasterCrs {
    let of_all = [[1, 1, 0, own.len() as u16 + 1], [1024, 0, 1, 1]];
    let keys: Vec<u16> = of_all.iter().chain(own).flatten().copied().collect();
    let file = image().shorts(KEYS, &keys).tag(34736, Values::Doubles(reals.to_vec())).file();
    open(&file).unwrap().facts().crs.clone()
}

#[test]
fn projections_by_their_methods() {
    let system = |key: u16, number: u16, keys: &[u16], reals: &[f64]| {
        let mut own = vec![[2048, 0, 1, 4326], [key, 0, 1, number]];
        own.extend(keys.iter().zip(0..).map(|(key, index)| [*key, 34736, 1, index]));
        own_crs(&own, reals)
    };
    for (number, keys, reals, expected) in [
        (3, &[3088, 3089, 3094][..], &[11.0, 48.0, 30.0][..], "omerc|+lat_0=48 +lonc=11 +alpha=30 +no_uoff"),
        (7, &[3078, 3080], &[40.0, 11.0], "merc|+lon_0=11 +lat_ts=40"),
        (9, &[3080, 3081, 3092], &[11.0, 48.0, 0.9999], "lcc|+lat_0=48 +lat_1=48 +lon_0=11 +k_0=0.9999"),
        (12, &[3088, 3089], &[11.5, 48.1], "aeqd|+lat_0=48.1 +lon_0=11.5"),
        (13, &[3078, 3079, 3080, 3081], &[47.0, 49.0, 11.0, 48.0], "eqdc|+lat_0=48 +lon_0=11 +lat_1=47 +lat_2=49"),
        (15, &[3081, 3092, 3095], &[70.0, 1.0, -45.0], "stere|+lat_0=90 +lat_ts=70 +lon_0=-45 +k_0=1"),
        (15, &[3081, 3095], &[-71.0, 0.0], "stere|+lat_0=-90 +lat_ts=-71 +lon_0=0"),
        (17, &[3078, 3088, 3089], &[48.0, 11.0, 0.0], "eqc|+lat_0=0 +lon_0=11 +lat_ts=48"),
        (18, &[3080, 3081], &[11.0, 48.0], "cass|+lat_0=48 +lon_0=11"),
        (22, &[3080, 3081], &[11.0, 48.0], "poly|+lat_0=48 +lon_0=11"),
        (9815, &[3088, 3089, 3094, 3096], &[11.0, 48.0, 30.0, 30.0], "omerc|+lat_0=48 +lonc=11 +alpha=30 +gamma=30"),
        (
            9815,
            &[3088, 3089, 3094, 3096],
            &[7.4, 46.9, 90.0, 90.0],
            "somerc|+lat_0=46.9 +lon_0=7.4 +alpha=90 +gamma=90",
        ),
    ] {
        let found = system(3075, number, keys, reals).horizontal.unwrap();
        let (method, rest) = expected.split_once('|').unwrap();
        assert_eq!(found, format!("+proj={method} +datum=WGS84 +units=m {rest}"));
    }
    // Zones of UTM.
    for (number, expected) in [(16_001, "zone=1"), (16_032, "zone=32"), (16_132, "zone=32 +south")] {
        let found = system(3074, number, &[], &[0.0]).horizontal;
        assert_eq!(found, Some(format!("+proj=utm +{expected} +datum=WGS84 +units=m")));
    }
    for (key, number, name) in
        [(3075, 20, "miller"), (3075, 26, "nzmg"), (3075, 99, "method_99_of_GeoTIFF"), (3074, 13_701, "EPSG_13701")]
    {
        let refused = system(key, number, &[], &[0.0]);
        assert_eq!(refused.horizontal, None);
        match resolve(&refused.citation.unwrap()) {
            Err(CrsError::Unsupported(why)) => assert!(why.contains(name), "{why}"),
            other => panic!("{number}: {other:?}"),
        }
    }
}

#[test]
fn systems_of_esri() {
    let [user, code] = [keys(&[[1024, 32767]]), keys(&[[1024, 32767], [3072, 32633]])];
    assert_eq!(crs_of(&code, "").horizontal.as_deref(), Some("EPSG:32633"));
    assert_eq!(crs_of(&user, "").horizontal, None);
    let own = |text: &'static str| {
        let length = text.len() as u16;
        crs_of(&[1, 1, 0, 3, 1024, 0, 1, 32767, 3072, 0, 1, 32767, 3073, TEXTS, length, 0], text).horizontal
    };
    let text = concat!(
        r#"ESRI PE String = PROJCS["Own",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,"#,
        r#"298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],"#,
        r#"PARAMETER["Central_Meridian",11.5],PARAMETER["Scale_Factor",1.0],UNIT["Meter",1.0]]|"#
    );
    assert_eq!(own(text).unwrap(), text.trim_start_matches("ESRI PE String = ").trim_end_matches('|'));
    assert_eq!(own("ESRI PE String = PROJCS[1]|"), None);
}
