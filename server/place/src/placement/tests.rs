//! Tests of placements. Expected positions are of pyproj 3.7.2 (PROJ 9.5.1); the call is beside each.

use super::{AxisOrders, FirstShape, Placement, World};
use crate::PlacingOptions;
use insula_source::error::InputError;
use insula_source::object::{AxisOrder, CrsReference};
use insula_source::problems::{EITHER_ORDER, OUTSIDE, SWAPPED};
use insula_source::units::HeightUnit;
use std::path::PathBuf;

fn reference(name: &str, order: AxisOrder) -> CrsReference {
    CrsReference { name: name.to_owned(), order, height_unit_m: None }
}

fn east_first(name: &str) -> CrsReference {
    reference(name, AxisOrder::EastFirst)
}

fn world(target: &str) -> World {
    World::new(Some(target), None).unwrap()
}

fn place(target: &str, source: &str, p: [f64; 3]) -> [f64; 3] {
    let placement = world(target).place("file", &east_first(source)).unwrap();
    placement.position(p).unwrap_or_else(|| panic!("{source} to {target}"))
}

#[track_caller]
fn assert_near(actual: [f64; 3], expected: [f64; 3], tolerance_m: f64) {
    let is_near = actual.iter().zip(expected).all(|(a, e)| (a - e).abs() <= tolerance_m);
    assert!(is_near, "{actual:?}, not {expected:?}");
}

#[test]
fn positions_are_projected_like_proj() {
    // pyproj.Transformer.from_crs(source, target, always_xy=True).transform(x, y)
    for (source, target, [x, y], [east, north], tolerance_m) in [
        ("EPSG:6668", "EPSG:6677", [139.75, 35.69], [-7542.1830, -34389.7611], 1e-3),
        ("EPSG:6668", "EPSG:32654", [139.75, 35.69], [386898.3201, 3950285.6460], 1e-3),
        ("EPSG:4326", "EPSG:25832", [9.99, 53.55], [565590.9407, 5933912.1654], 1e-3),
        ("EPSG:3857", "EPSG:32631", [545000.0, 6868000.0], [629056.1277, 5804307.4447], 1e-3),
        ("EPSG:3035", "EPSG:25832", [4321000.0, 3210000.0], [568649.7049, 5761510.3164], 1e-3),
        ("EPSG:2180", "EPSG:32634", [637000.0, 487000.0], [500457.8579, 5786839.9333], 1e-3),
        ("EPSG:2193", "EPSG:32760", [1748000.0, 5428000.0], [313042.3341, 5427102.3566], 1e-3),
        ("EPSG:2056", "EPSG:32632", [2683000.0, 1247000.0], [465081.1291, 5246231.8431], 1e-3),
        // With newer parameters of the shift.
        ("EPSG:4326", "EPSG:28992", [4.9, 52.37], [121819.3652, 487013.7615], 0.3),
        ("EPSG:31467", "EPSG:25832", [3566000.0, 5935000.0], [565903.4012, 5933065.2919], 5.0),
        ("EPSG:27700", "EPSG:32630", [530000.0, 180000.0], [699292.6820, 5709783.2103], 3.0),
        // From GDA94 to GDA2020 by the parameters of EPSG (8048), computed by hand.
        ("EPSG:28355", "EPSG:7855", [321000.0, 5812000.0], [321000.4906, 5812001.4720], 1e-2),
        ("EPSG:5514", "EPSG:32633", [-743000.0, -1043000.0], [458407.9908, 5548504.2371], 1.0),
    ] {
        assert_near(place(target, source, [x, y, 7.5]), [east, north, 7.5], tolerance_m);
    }
    // from_crs("+proj=tmerc +lat_0=0 +lon_0=9 +k=1 +x_0=3500000 +y_0=0 +ellps=bessel
    // +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7 +units=m +type=crs", 25832, always_xy=True): the same
    // parameters.
    let same = place("EPSG:25832", "EPSG:31467", [3566000.0, 5935000.0, 0.0]);
    assert_near(same, [565902.5742, 5933065.0257, 0.0], 1e-3);
    // from_crs(4326, "+proj=sterea +lat_0=52.15616055555555 +lon_0=5.38763888888889 +k=0.9999079 +x_0=155000
    // +y_0=463000 +ellps=bessel +towgs84=565.2369,50.0087,465.658,-0.406857,0.350733,-1.87035,4.0812 +units=m
    // +type=crs", always_xy=True)
    assert_near(place("EPSG:28992", "EPSG:4326", [4.9, 52.37, 0.0]), [121819.3606, 487013.7614, 0.0], 1e-3);
}

#[test]
fn the_order_of_axes_goes_by_the_registry_for_gml_only() {
    let expected = [-7542.1830, -34389.7611, 12.0];
    for (name, order, p) in [
        ("EPSG:6697", AxisOrder::Authority, [35.69, 139.75, 12.0]),
        ("http://www.opengis.net/def/crs/EPSG/0/6697", AxisOrder::Authority, [35.69, 139.75, 12.0]),
        ("EPSG:6697", AxisOrder::EastFirst, [139.75, 35.69, 12.0]),
        ("urn:ogc:def:crs:OGC:1.3:CRS84", AxisOrder::Authority, [139.75, 35.69, 12.0]),
        ("EPSG:6677", AxisOrder::Authority, [-34389.7611, -7542.1830, 12.0]),
        ("EPSG:6677", AxisOrder::EastFirst, [-7542.1830, -34389.7611, 12.0]),
    ] {
        let placement = world("EPSG:6677").place("file", &reference(name, order)).unwrap();
        assert_near(placement.position(p).unwrap(), expected, 1e-3);
    }
}

#[test]
fn the_same_system_passes_bit_by_bit() {
    let p = [121819.3606 + 1e-10, 487013.7614, -0.1 + 0.3];
    let mut world = World::new(None, None).unwrap();
    let first = world.place("a", &east_first("EPSG:7415")).unwrap();
    assert_eq!((world.horizontal().as_deref(), world.vertical().as_deref()), (Some("EPSG:28992"), Some("EPSG:5709")));
    assert_eq!((world.crs_name().as_deref(), world.geoid()), (Some("EPSG:7415"), None));
    let second = world.place("b", &east_first("urn:ogc:def:crs:EPSG::28992")).unwrap();
    for placement in [&first, &second, &Placement::Unknown] {
        assert_eq!(placement.position(p).unwrap().map(f64::to_bits), p.map(f64::to_bits));
        assert!(placement.warnings().is_empty() && !placement.needs_world());
    }
    assert!(first.is_of(&east_first("EPSG:7415")) && !first.is_of(&east_first("EPSG:28992")));
    assert!(!first.is_of(&reference("EPSG:7415", AxisOrder::Authority)));
    assert_eq!(first.source_crs(), Some("EPSG:7415"));
    assert_eq!(Placement::Unknown.source_crs(), None);
    // Systems of modern datums with one projection are the same.
    let placement = self::world("EPSG:32632").place("c", &east_first("EPSG:25832")).unwrap();
    assert_eq!(placement.position([565931.1, 5934222.2, 3.3]), Some([565931.1, 5934222.2, 3.3]));
    assert!(placement.warnings().is_empty());
}

#[test]
fn positions_that_are_no_places_are_refused() {
    let mut world = world("EPSG:25832");
    let degrees = world.place("a", &east_first("EPSG:4326")).unwrap();
    let metres = world.place("b", &east_first("EPSG:25832")).unwrap();
    let space = world.place("c", &east_first("ECEF")).unwrap();
    for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300] {
        for placement in [&degrees, &metres, &space, &Placement::Unknown] {
            assert_eq!(placement.position([bad, 53.0, 0.0]), None);
            assert_eq!(placement.position([9.0, bad, 0.0]), None);
            assert_eq!(placement.position([9.0, 53.0, bad]), None);
        }
    }
    assert_eq!(degrees.position([9.0, 91.0, 0.0]), None);
    assert_eq!(degrees.position([5934222.0, 565931.0, 0.0]), None);
    assert_eq!(space.position([0.0, 0.0, 0.0]), None);
}

#[test]
fn the_first_position_chooses_a_zone_of_utm() {
    for (first, expected) in [
        ([15.0, 0.0], "EPSG:32633"),
        ([15.0, -45.0], "EPSG:32733"),
        ([180.0, 10.0], "EPSG:32660"),
        ([-180.0, 10.0], "EPSG:32601"),
        ([139.75, 35.69], "EPSG:32654"),
        ([5.3, 60.4], "EPSG:32632"),
        ([15.6, 78.2], "EPSG:32633"),
    ] {
        let mut world = World::new(None, None).unwrap();
        let mut placement = world.place("a", &east_first("OGC:CRS84")).unwrap();
        assert!(placement.needs_world() && !world.is_settled());
        assert_eq!(placement.position([first[0], first[1], 0.0]), None);
        placement.settle(&mut world, "a", [first[0], first[1], 0.0]).unwrap();
        placement.settle(&mut world, "a", [0.0, 0.0, 0.0]).unwrap();
        assert!(!placement.needs_world() && world.is_settled());
        assert_eq!(world.horizontal().as_deref(), Some(expected));
        assert_eq!((world.crs_name().as_deref(), world.vertical()), (Some(expected), None));
    }
    // Web Mercator is no world, and there is no UTM at the poles.
    let mut world = World::new(None, None).unwrap();
    let mut placement = world.place("a", &east_first("EPSG:3857")).unwrap();
    placement.settle(&mut world, "a", [0.0, 3e7, 0.0]).unwrap();
    assert!(placement.needs_world());
    placement.settle(&mut world, "a", [545000.0, 6868000.0, 0.0]).unwrap();
    assert_eq!(world.horizontal().as_deref(), Some("EPSG:32631"));
    assert_near(placement.position([545000.0, 6868000.0, 2.0]).unwrap(), [629056.1277, 5804307.4447, 2.0], 1e-3);
    // A placement that waits takes the system that another source gave the world.
    let mut world = World::new(None, None).unwrap();
    let mut waiting = world.place("a", &east_first("EPSG:4326")).unwrap();
    world.place("b", &east_first("EPSG:25832")).unwrap();
    waiting.settle(&mut world, "a", [9.99, 53.55, 0.0]).unwrap();
    assert_near(waiting.position([9.99, 53.55, 0.0]).unwrap(), [565590.9407, 5933912.1654, 0.0], 1e-3);
}

#[test]
fn heights_above_the_ellipsoid_go_through_the_geoid() {
    // Transformer.from_crs(4979, 4978, always_xy=True).transform(139.75, 35.69, 50.0); the geoid of the bundled grid
    // there by +proj=vgridshift is 36.532421875.
    let centre = [-3958262.2721600425, 3350916.3629888208, 3700339.0154466815];
    let expected = [-7542.1830, -34389.7611, 50.0 - 36.532421875];
    let mut world = world("EPSG:6677");
    for (name, p) in [
        ("ECEF", centre),
        ("EPSG:4978", centre),
        ("EPSG:4979", [139.75, 35.69, 50.0]),
        ("OGC:CRS84h", [139.75, 35.69, 50.0]),
        ("EPSG:6667", [139.75, 35.69, 50.0]),
    ] {
        let placement = world.place("a", &east_first(name)).unwrap();
        assert_near(placement.position(p).unwrap(), expected, 1e-3);
        let warnings = placement.warnings();
        if name == "ECEF" {
            assert!(warnings.len() == 1 && warnings[0].contains("jp_gsi_gsigeo2011.tif"), "{warnings:?}");
        } else {
            assert!(warnings.is_empty(), "one warning is enough: {warnings:?}");
        }
    }
    assert_eq!((world.vertical().as_deref(), world.geoid().as_deref()), (Some("EPSG:6695"), Some("EGM96")));
    // Heights above sea level do not change.
    let placement = world.place("a", &east_first("EPSG:6697")).unwrap();
    assert_near(placement.position([139.75, 35.69, 50.0]).unwrap(), [-7542.1830, -34389.7611, 50.0], 1e-3);
}

#[test]
fn local_metres_turn_around_their_origin() {
    // +proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lon_0=140.11458539 +lat_0=35.61016729 +h_0=(3 + geoid)
    // +step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg, then from_crs(4326, 32654), of
    // (1500, -2500, 40); the height less the geoid there.
    let mut world = World::new(None, None).unwrap();
    let mut placement = world.place("a", &east_first("ENU:140.11458539,35.61016729,3")).unwrap();
    assert!(placement.needs_world());
    placement.settle(&mut world, "a", [0.0, 0.0, 0.0]).unwrap();
    assert_eq!(world.horizontal().as_deref(), Some("EPSG:32654"));
    let expected = [421284.7154, 3938559.9637, 43.868710592586];
    assert_near(placement.position([1500.0, -2500.0, 40.0]).unwrap(), expected, 1e-4);
    let origin = placement.position([0.0, 0.0, 0.0]).unwrap();
    assert!((origin[2] - 3.0).abs() < 1e-6, "{origin:?}");
    // The geoid is some 35 m above the ellipsoid there.
    let mut placement = world.place("b", &east_first("ENU:140.11458539,35.61016729,0,ellipsoid")).unwrap();
    placement.settle(&mut world, "b", [0.0, 0.0, 0.0]).unwrap();
    let on_ellipsoid = placement.position([0.0, 0.0, 0.0]).unwrap();
    assert!(
        (-40.0..-30.0).contains(&on_ellipsoid[2]) && (on_ellipsoid[0] - origin[0]).abs() < 1e-3,
        "{on_ellipsoid:?}"
    );
    assert!(placement.warnings().iter().any(|warning| warning.contains("0 above the ellipsoid")));
}

#[test]
fn units_become_metres() {
    // A world in feet is the same projection in metres, which the registry has: EPSG:32118 is EPSG:2263 in metres.
    let mut world = World::new(None, None).unwrap();
    let placement = world.place("a", &east_first("EPSG:2263")).unwrap();
    assert_eq!(world.horizontal().as_deref(), Some("EPSG:32118"));
    let foot = 1200.0 / 3937.0;
    // from_crs(2263, 32118, always_xy=True).transform(987000, 211000)
    let expected = [300838.2017, 64312.9286, 100.0 * foot];
    assert_near(placement.position([987000.0, 211000.0, 100.0]).unwrap(), expected, 1e-3);
    assert_eq!(placement.warnings().len(), 1);
    // NAVD88 in feet.
    let placement = world.place("a", &east_first("EPSG:2263+6360")).unwrap();
    assert_near(placement.position([987000.0, 211000.0, 100.0]).unwrap(), expected, 1e-3);
    assert_eq!(world.vertical().as_deref(), Some("EPSG:5703"), "NAVD88 in metres");
    // A map in feet with heights in metres, by the system, by the user, and by the file.
    let in_metres = [expected[0], expected[1], 100.0];
    let placement = world.place("a", &east_first("EPSG:2263+5703")).unwrap();
    assert_near(placement.position([987000.0, 211000.0, 100.0]).unwrap(), in_metres, 1e-3);
    let mut by_hand = World::new(None, None).unwrap().with_options(&PlacingOptions::default(), Some(HeightUnit::Metre));
    let placement = by_hand.place("a", &east_first("EPSG:2263")).unwrap();
    assert_near(placement.position([987000.0, 211000.0, 100.0]).unwrap(), in_metres, 1e-3);
    let told = CrsReference { height_unit_m: Some(1.0), ..east_first("EPSG:2263") };
    let placement = world.place("a", &told).unwrap();
    assert_near(placement.position([987000.0, 211000.0, 100.0]).unwrap(), in_metres, 1e-3);
    // And the other way round.
    let told = CrsReference { height_unit_m: Some(foot), ..east_first("EPSG:32118") };
    let placement = world.place("a", &told).unwrap();
    assert_near(placement.position([300838.2017, 64312.9286, 100.0]).unwrap(), expected, 1e-3);
}

#[test]
fn metres_are_degrees_on_the_ellipsoid() {
    // pyproj.Geod(ellps="WGS84").fwd(11.5, 48.13, azimuth, 1.0)
    let [east, north] = super::degrees_per_metre(48.13);
    assert!((east - 1.343_405_7e-5).abs() < 1e-11 && (north - 8.993_384e-6).abs() < 1e-11, "{east} {north}");
}

#[test]
fn habits_of_publishers_are_understood() {
    let german = place("EPSG:25832", "urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH", [32565931.5, 5934222.25, 4.0]);
    assert_eq!(german, [565931.5, 5934222.25, 4.0]);
    for p in [[19406.2, 3572920.1, 4.0], [-19406.2, -3572920.1, 4.0]] {
        assert_eq!(place("EPSG:2048", "EPSG:2048", p), [-19406.2, -3572920.1, 4.0]);
    }
    // Transformer.from_crs(29377, 32733, always_xy=True).transform(-8000, 62000). The origin is in the middle of Namibia: signs do not
    // show the direction of the axes.
    let namibia = place("EPSG:32733", "EPSG:29377", [-8000.0, 62000.0, 4.0]);
    assert_near(namibia, [713563.6895, 7503666.4859, 4.0], 1.0);
    for [x, y] in [[1043000.5, 743000.25], [743000.25, 1043000.5]] {
        for p in [[x, y, 4.0], [-x, -y, 4.0]] {
            assert_eq!(place("EPSG:5514", "EPSG:5514", p), [-743000.25, -1043000.5, 4.0]);
        }
    }
}

#[test]
fn doubtful_accuracy_is_told() {
    let mut world = world("EPSG:25832");
    let warnings = |world: &mut World, name: &str| {
        let placement = world.place("a", &east_first(name)).unwrap();
        placement.warnings().join("; ")
    };
    assert!(
        warnings(&mut world, "EPSG:31467").contains("DHDN is shifted without its grid: expect an error of up to 5 m")
    );
    assert!(warnings(&mut world, "EPSG:2370").contains("is not known: positions can be off by hundreds of metres"));
    let mut own = World::new(Some("EPSG:2370"), None).unwrap();
    assert!(warnings(&mut own, "EPSG:2370").contains("the city can be hundreds of metres away from its place"));
    assert_eq!(warnings(&mut world, "EPSG:4258"), "");
    assert_eq!(warnings(&mut world, "EPSG:25832+7837"), "");
    assert!(warnings(&mut world, "EPSG:25832+5783").contains("heights are above DHHN92 (EPSG:5783)"));
    assert_eq!(world.vertical().as_deref(), Some("EPSG:7837"));
}

#[test]
fn unknown_systems_are_errors_with_advice() {
    let error = |world: &mut World, name: &str| world.place("a.gml", &east_first(name)).unwrap_err().to_string();
    let mut open = World::new(None, None).unwrap();
    for name in ["", "Amersfoort", "EPSG:1", "EPSG:5709", "LOCAL_CS[\"x\"]", "PROJCS[", "{", "ENU:1,2", "urn:adv:crs:X"]
    {
        let message = error(&mut open, name);
        assert!(message.contains("is not known") && message.contains("ogr2ogr -t_srs"), "{name}: {message}");
    }
    // The New Zealand Map Grid.
    assert!(error(&mut open, "EPSG:27200").contains("is not supported"));
    assert!(error(&mut world("EPSG:25832"), "EPSG:27200").contains("is not supported"));
    assert!(!open.is_settled());
    let long = format!("PROJCS[\"{}\"", "x".repeat(5000));
    assert!(error(&mut open, &long).len() < 900);
    // With --crs, a source whose system is not understood is assumed to be in that system.
    let placement = world("EPSG:25832").place("a", &east_first("LOCAL_CS[\"x\"]")).unwrap();
    assert_eq!(placement.position([565931.0, 5934222.0, 3.0]), Some([565931.0, 5934222.0, 3.0]));
    assert!(placement.warnings()[0].contains("taken to be EPSG:25832"));
    assert!(placement.is_of(&east_first("LOCAL_CS[\"x\"]")));
    // Also if the target is a text.
    let text = r#"PROJCS["Site",GEOGCS["WGS 84",DATUM["D_WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["G",0],
        UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["central_meridian",7.25],UNIT["m",1]]"#;
    let placement = world(text).place("a", &east_first("LOCAL_CS[\"x\"]")).unwrap();
    assert_eq!(placement.position([5.0, 4.0, 3.0]), Some([5.0, 4.0, 3.0]));
    assert!(world(text).horizontal().unwrap().starts_with("+proj=tmerc +lon_0=7.25"));
}

#[test]
fn targets_must_be_maps_with_true_lengths() {
    for name in ["EPSG:4326", "EPSG:3857", "EPSG:4978", "ECEF", "EPSG:8857", "nonsense", "EPSG:99999"] {
        assert!(matches!(World::new(Some(name), None), Err(InputError::Misplaced { .. })), "{name}");
    }
    assert!(World::new(None, Some(PathBuf::from("/no such folder"))).is_err());
    let world = world("EPSG:7415");
    assert_eq!((world.vertical().as_deref(), world.crs_name().as_deref()), (Some("EPSG:5709"), Some("EPSG:7415")));
}

#[test]
fn worlds_and_placements_can_cross_threads() {
    fn check<T: Send + Sync + Clone + std::fmt::Debug>() {}
    check::<World>();
    check::<Placement>();
}

/// Longitude and latitude of the first position of a source, and the kind of what was found of its order.
fn found(
    placing: &PlacingOptions,
    name: &str,
    order: AxisOrder,
    first: [f64; 2],
) -> Result<([f64; 2], &'static str), String> {
    let mut world = World::new(placing.crs.as_deref(), None).unwrap().with_options(placing, None);
    let mut placement = world.place("a.gml", &reference(name, order)).unwrap();
    let shape = FirstShape::at(first, Some([1e-4; 2]));
    placement.settle(&mut world, "a.gml", shape).map_err(|error| error.to_string())?;
    let Placement::Known(placed) = &placement else { panic!("{name}") };
    assert!(placement.position([first[0], first[1], 5.0]).is_some(), "{name}");
    Ok((placed.input.degrees([first[0], first[1], 0.0]).unwrap(), placement.finding().map_or("", |(kind, _)| *kind)))
}

#[test]
fn coordinates_are_read_in_the_order_that_fits_the_area_of_use() {
    let (registry, mostly, fixed) = (AxisOrder::Authority, AxisOrder::MostlyEastFirst, AxisOrder::EastFirst);
    for (name, order, first, [lon, lat], finding) in [
        ("EPSG:31256", registry, [2814.28, 341_289.39], [16.3701, 48.21], SWAPPED),
        ("EPSG:31256", registry, [341_289.39, 2814.28], [16.3701, 48.21], ""),
        ("EPSG:31256", mostly, [2814.28, 341_289.39], [16.3701, 48.21], ""),
        ("EPSG:31256", mostly, [341_289.39, 2814.28], [16.3701, 48.21], SWAPPED),
        ("EPSG:31468", registry, [4_468_105.75, 5_333_641.64], [11.57, 48.14], SWAPPED),
        ("EPSG:3346", registry, [582_544.32, 6_061_147.77], [25.28, 54.68], SWAPPED),
        ("EPSG:3006", registry, [674_647.88, 6_580_824.58], [18.07, 59.33], SWAPPED),
        // Both are in Europe, one at sea.
        ("EPSG:3035", registry, [4_107_390.02, 3_096_506.83], [6.96, 50.94], SWAPPED),
        ("EPSG:3035", registry, [3_096_506.83, 4_107_390.02], [6.96, 50.94], ""),
        // Poland and Japan have both.
        ("EPSG:2180", registry, [637_231.09, 486_786.39], [18.80, 53.59], EITHER_ORDER),
        // Only the other one is in its area of use, not just near it.
        ("EPSG:2180", registry, [926_000.0, 210_000.0], [24.8997, 49.6068], SWAPPED),
        ("EPSG:2451", registry, [-6637.95, -35_499.9], [139.44, 35.94], EITHER_ORDER),
        ("EPSG:6677", mostly, [-35_499.9, -6637.95], [139.44, 35.94], EITHER_ORDER),
        ("EPSG:6677", fixed, [-6637.95, -35_499.9], [139.76, 35.68], ""),
        ("EPSG:4326", registry, [139.76, 35.68], [139.76, 35.68], SWAPPED),
        ("EPSG:6697", registry, [35.68, 139.76], [139.76, 35.68], ""),
        ("EPSG:4979", registry, [-122.5034, 37.7294], [-122.5034, 37.7294], SWAPPED),
        ("OGC:CRS84", fixed, [35.68, 139.76], [139.76, 35.68], SWAPPED),
        ("OGC:CRS84", fixed, [16.37, 48.21], [16.37, 48.21], ""),
        ("EPSG:4326", registry, [48.21, 16.37], [16.37, 48.21], EITHER_ORDER),
        // The other place is at sea, but for formats that leave no doubt.
        ("EPSG:4326", registry, [4.36, 52.01], [4.36, 52.01], SWAPPED),
        ("EPSG:4979", registry, [52.01, 4.36], [4.36, 52.01], ""),
        ("OGC:CRS84", mostly, [52.01, 4.36], [4.36, 52.01], SWAPPED),
        ("OGC:CRS84", fixed, [52.01, 4.36], [52.01, 4.36], ""),
        // Islands are land.
        ("OGC:CRS84", mostly, [55.45, -4.62], [55.45, -4.62], EITHER_ORDER),
        ("OGC:CRS84", mostly, [15.64, 78.22], [15.64, 78.22], EITHER_ORDER),
        ("EPSG:25832", fixed, [691_000.0, 5_334_000.0], [11.57, 48.13], ""),
    ] {
        let (place, kind) = found(&PlacingOptions::default(), name, order, first).unwrap();
        assert_eq!(kind, finding, "{name} {first:?}");
        let is_near = (place[0] - lon).abs() < 0.02 && (place[1] - lat).abs() < 0.02;
        assert!(is_near, "{name} {first:?}: {place:?}");
    }
    // What the user wants decides, and so do other inputs.
    let with = |crs: Option<&str>, bbox_deg, rules: &[&str]| {
        let axis_orders = AxisOrders::new(rules.iter().map(|rule| rule.parse().unwrap()));
        PlacingOptions { crs: crs.map(str::to_owned), bbox_deg, axis_orders, ..PlacingOptions::default() }
    };
    let tokyo = [-6637.95, -35_499.9];
    for placing in [with(None, None, &["en"]), with(None, None, &["ne", "*.gml=en"])] {
        let (place, kind) = found(&placing, "EPSG:2451", registry, tokyo).unwrap();
        assert!((place[0] - 139.76).abs() < 0.01 && kind.is_empty(), "{place:?} {kind}");
    }
    let vienna = with(Some("EPSG:31256"), None, &[]);
    let (place, kind) = found(&vienna, "EPSG:4326", registry, [16.37, 48.21]).unwrap();
    assert!((place[0] - 16.37).abs() < 1e-9 && kind == SWAPPED, "{place:?} {kind}");
    let wanted = with(None, Some([16.0, 48.0, 17.0, 49.0]), &[]);
    assert_eq!(found(&wanted, "EPSG:4326", registry, [48.21, 16.37]).unwrap().1, "");
}

#[test]
fn coordinates_that_contradict_their_system_are_errors() {
    let placing = PlacingOptions::default();
    let error = found(&placing, "EPSG:4326", AxisOrder::Authority, [412_345.5, 1_432_100.25]).unwrap_err();
    for part in ["EPSG:4326", "412345.5, 1432100.25", "zone of UTM"] {
        assert!(error.contains(part), "{error}");
    }
    let error = found(&placing, "OGC:CRS84", AxisOrder::EastFirst, [85_000.0, 446_000.0]).unwrap_err();
    assert!(error.contains("EPSG:28992"), "{error}");
    let error = found(&placing, "EPSG:25832", AxisOrder::EastFirst, [11.57, 48.14]).unwrap_err();
    assert!(error.contains("EPSG:25832") && error.contains("likely EPSG:4326"), "{error}");
    let (_, kind) = found(&placing, "EPSG:31468", AxisOrder::EastFirst, [2_568_105.75, 5_633_641.64]).unwrap();
    assert_eq!(kind, OUTSIDE);
    // Five degrees north of the Netherlands, and east of a zone of UTM.
    for (name, first, is_outside) in [
        ("EPSG:28992", [155_000.0, 1_200_000.0], true),
        ("EPSG:25832", [1_300_000.0, 5_600_000.0], true),
        ("EPSG:25832", [930_000.0, 5_680_000.0], false),
    ] {
        let (place, kind) = found(&placing, name, AxisOrder::EastFirst, first).unwrap();
        assert_eq!(kind == OUTSIDE, is_outside, "{name} {place:?}");
    }
}

#[test]
fn systems_of_sources_that_name_none_are_guessed() {
    let world = world("EPSG:28992");
    let guess = |world: &World, x, y, size| world.guess(&FirstShape::at([x, y], Some([size; 2])));
    let (reference, text) = guess(&world, -122.5, 37.7, 1e-4);
    let reference = reference.unwrap();
    assert!(
        reference.name == "OGC:CRS84" && text.contains("-122.5, 37.7") && text.contains("longitude first"),
        "{text}"
    );
    let (reference, text) = guess(&world, 35.6, 139.7, 1e-4);
    assert!(reference.unwrap().order == AxisOrder::Authority && text.contains("latitude first"), "{text}");
    let (reference, text) = guess(&world, 85_000.0, 446_000.0, 10.0);
    assert!(reference.unwrap().name == "EPSG:28992" && text.contains("--crs"), "{text}");
    let (reference, text) = guess(&World::new(None, None).unwrap(), 10.0, 10.0, 10.0);
    assert!(reference.is_none() && text.contains("10, 10 are taken as metres of an unknown place"), "{text}");
    let found = PlacingOptions { is_crs_found: true, ..PlacingOptions::default() };
    let (reference, text) = guess(&world.with_options(&found, None), 85_000.0, 446_000.0, 10.0);
    assert!(reference.is_none() && text.contains("taken in EPSG:28992, that of the city"), "{text}");
}
