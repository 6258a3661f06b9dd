//! Coordinate systems and units.

use super::super::super::facts::RasterCrs;
use super::file::{TestCloud, TestPoint};
use super::{open, read};

const METRES: &str = concat!(
    r#"PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["European_Terrestrial_Reference_System_1989","#,
    r#"SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],"#,
    r#"PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],"#,
    r#"PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],"#,
    r#"UNIT["metre",1],AUTHORITY["EPSG","25832"]]"#
);
const EARTH_CENTRED: &str = concat!(
    r#"GEOCCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],"#,
    r#"UNIT["metre",1],AUTHORITY["EPSG","4978"]]"#
);
const MODEL: u16 = 1024;
const GEOGRAPHIC: u16 = 2048;
const PROJECTED: u16 = 3072;
const VERTICAL: u16 = 4096;
const VERTICAL_UNIT: u16 = 4099;

/// 8 x 8 points on the ground, at a distance of 1, with a height of 10.
fn cloud() -> TestCloud {
    let points = (0..64).map(|i| TestPoint::ground(f64::from(i % 8) + 0.5, f64::from(i / 8) + 0.5, 10.0));
    TestCloud::new(points.collect())
}

fn crs_of(cloud: &TestCloud) -> RasterCrs {
    open(&cloud.bytes()).unwrap().1.crs
}

#[test]
fn well_known_text() {
    let crs = crs_of(&cloud().wkt(METRES));
    assert_eq!((crs.horizontal.as_deref(), crs.vertical, crs.height_unit_m), (Some(METRES), None, Some(1.0)));
    // Behind the points.
    let mut late = cloud().format(6);
    late.late_records.push(("other", 2112, b"GEOGCS[]".to_vec()));
    late.late_records.push(("LASF_Projection", 2112, METRES.as_bytes().to_vec()));
    assert_eq!(crs_of(&late).horizontal.as_deref(), Some(METRES));
    assert_eq!(crs_of(&cloud().wkt("''")), RasterCrs::default());
    assert_eq!(crs_of(&cloud()), RasterCrs::default());
}

#[test]
fn text_and_keys() {
    let keys = [[MODEL, 1], [PROJECTED, 28992]];
    let both = cloud().wkt(METRES).keys(&keys);
    assert_eq!(crs_of(&both).horizontal.as_deref(), Some(METRES));
    let without_flag = TestCloud { has_wkt_flag: false, ..both.clone() };
    assert_eq!(crs_of(&without_flag).horizontal.as_deref(), Some("EPSG:28992"));
    // New formats have text.
    assert_eq!(crs_of(&without_flag.format(6)).horizontal.as_deref(), Some(METRES));
    // The one that is understood counts.
    let keys = cloud().wkt("PROJCS[1]").keys(&keys);
    assert_eq!(crs_of(&keys).horizontal.as_deref(), Some("EPSG:28992"));
    assert_eq!(crs_of(&cloud().wkt("PROJCS[1]")).horizontal.as_deref(), Some("PROJCS[1]"));
}

#[test]
fn vertical_systems() {
    let keys = |more: &[[u16; 2]]| cloud().keys(&[&[[MODEL, 1], [PROJECTED, 28992]], more].concat());
    let crs = crs_of(&keys(&[[VERTICAL, 5709]]));
    assert_eq!((crs.vertical.as_deref(), crs.height_unit_m), (Some("EPSG:5709"), Some(1.0)));
    assert!(crs_of(&keys(&[[VERTICAL, 5030]])).is_ellipsoidal);
}

#[test]
fn heights_are_in_the_unit_of_the_system() {
    let height = |keys: &[[u16; 2]]| {
        let (facts, heights) = read(&cloud().keys(keys).bytes());
        (facts.crs.vertical, facts.crs.height_unit_m, heights[0])
    };
    let survey_foot = 1200.0 / 3937.0;
    // New Mexico in feet; NAVD88 as GeoTIFF 1.0 had it, which is in metres, but the heights are in feet.
    let keys = [[MODEL, 1], [PROJECTED, 2903], [VERTICAL, 5103], [VERTICAL_UNIT, 9003]];
    let (vertical, unit, first) = height(&keys);
    assert_eq!((vertical.as_deref(), unit), (Some("EPSG:5703"), Some(1.0)));
    assert!((f64::from(first) - 10.0 * survey_foot).abs() < 1e-6);
    // NAVD88 in feet.
    let (vertical, unit, first) = height(&[[MODEL, 1], [PROJECTED, 2903], [VERTICAL, 6360], [VERTICAL_UNIT, 9003]]);
    assert_eq!((vertical.as_deref(), first), (Some("EPSG:6360"), 10.0));
    assert!((unit.unwrap() - survey_foot).abs() < 1e-9);
    // No vertical system: the unit of the map.
    let (vertical, unit, first) = height(&[[MODEL, 1], [PROJECTED, 2903]]);
    assert_eq!((vertical, first), (None, 10.0));
    assert!((unit.unwrap() - survey_foot).abs() < 1e-9);
    let (_, unit, first) = height(&[[MODEL, 1], [PROJECTED, 28992], [VERTICAL_UNIT, 9002]]);
    assert_eq!((unit, first), (Some(1.0), 3.048));
}

#[test]
fn cells_in_other_units() {
    // Distances of two feet.
    let mut feet = cloud().keys(&[[MODEL, 1], [PROJECTED, 2903]]);
    feet.scale = [0.02, 0.02, 0.01];
    let step = read(&feet.bytes()).0.place.unwrap().column[0];
    assert!((step * 1200.0 / 3937.0 - 0.5).abs() < 1e-9, "{step}");
    // About a metre in degrees, at 60 degrees of latitude.
    let mut geographic = cloud().keys(&[[MODEL, 2], [GEOGRAPHIC, 4326]]);
    geographic.scale = [0.9e-7, 0.9e-7, 0.01];
    geographic.offset = [5.0, 60.0, 0.0];
    let place = read(&geographic.bytes()).0.place.unwrap();
    let metres = [place.column[0] / 2.0 * 111_319.5, place.row[1] * 111_319.5];
    assert!((metres[0] - 1.0).abs() < 1e-4 && (metres[1] + 1.0).abs() < 1e-4, "{metres:?}");
    assert!((place.origin[1] - 60.0).abs() < 1e-4 && (place.origin[0] - 5.0).abs() < 1e-4);
}

#[test]
fn positions_from_the_centre_of_the_earth() {
    let error = open(&cloud().wkt(EARTH_CENTRED).bytes()).err().unwrap();
    assert!(error.to_string().contains("centre of the Earth"), "{error}");
}
