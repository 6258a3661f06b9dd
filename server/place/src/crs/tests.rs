//! Tests of names of coordinate systems.

use super::*;

fn codes(name: &str) -> (Option<u32>, Option<u32>) {
    let crs = resolve(name).unwrap_or_else(|error| panic!("{name}: {error:?}"));
    let vertical = match crs.vertical {
        Vertical::Orthometric(datum) => datum.code,
        _ => None,
    };
    (crs.horizontal.code, vertical)
}

#[test]
fn codes_are_found_in_every_spelling() {
    for name in [
        "EPSG:25832",
        "epsg:25832",
        "EPSG::25832",
        "25832",
        " EPSG:25832\n",
        "urn:ogc:def:crs:EPSG::25832",
        "urn:ogc:def:crs:EPSG:9.9:25832",
        "urn:x-ogc:def:crs:EPSG:25832",
        "http://www.opengis.net/def/crs/EPSG/0/25832",
        "https://www.opengis.net/def/crs/EPSG/0/25832",
        "http://www.opengis.net/def/crs/EPSG/9.9.1/25832",
        "http://www.opengis.net/gml/srs/epsg.xml#25832",
        "urn:adv:crs:ETRS89_UTM32",
    ] {
        assert_eq!(codes(name), (Some(25832), None), "{name}");
    }
    for name in [
        "urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::7837",
        "urn:ogc:def:crs,crs:EPSG:6.12:25832,crs:EPSG:6.12:7837",
        "EPSG:25832+7837",
        "EPSG:25832+EPSG:7837",
        "http://www.opengis.net/def/crs-compound?1=http://www.opengis.net/def/crs/EPSG/0/25832&2=http://www.opengis.net/def/crs/EPSG/0/7837",
        "urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH*GCG2016",
        "urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH",
    ] {
        assert_eq!(codes(name), (Some(25832), Some(7837)), "{name}");
        assert_eq!(resolve(name).unwrap().name, "EPSG:25832+7837");
    }
    assert_eq!(codes("urn:adv:crs:DE_DHDN_3GK3*DE_DHHN92_NH"), (Some(31467), Some(5783)));
    assert_eq!(codes("IGNF:LAMB93"), (Some(2154), None));
    for name in ["EPSG:3857", "EPSG:900913", "ESRI:102100", "EPSG:3785"] {
        assert_eq!(codes(name), (Some(3857), None), "{name}");
    }
    assert_eq!(codes("ESRI:26918"), (Some(26918), None));
    assert_eq!(codes("EPSG:3587"), (Some(3587), None), "Michigan Central, not Web Mercator");
}

#[test]
fn systems_are_known_by_plain_names() {
    for (name, code) in [
        ("WGS 84 / UTM zone 32N", 32632),
        ("WGS_1984_UTM_Zone_32S", 32732),
        ("ETRS89 / UTM zone 33N", 25833),
        ("ETRS89_UTM32", 25832),
        ("Amersfoort / RD New", 28992),
        ("RGF93 / Lambert-93", 2154),
        ("OSGB 1936 / British National Grid", 27700),
        ("DHDN / 3-degree Gauss-Kr\u{fc}ger zone 4", 31468),
        ("CH1903+ / LV95", 2056),
        ("JGD2011 / Japan Plane Rectangular CS IX", 6677),
        ("ETRS89 / TM35FIN(E,N)", 3067),
        ("WGS 84", 4326),
        ("https://epsg.io/25832", 25832),
        ("srid:25832", 25832),
    ] {
        assert_eq!(codes(name), (Some(code), None), "{name}");
    }
    assert_eq!(codes("ETRS89 / UTM zone 32N + DHHN2016 height"), (Some(25832), Some(7837)));
    for name in ["UTM zone 32N", "WGS 84 / UTM zone 61N", "ETRS89 / UTM zone 32S", "WGS 84 + some height", "local"] {
        assert_eq!(resolve(name), Err(CrsError::Unknown), "{name}");
    }
}

#[test]
fn compound_systems_have_two_parts() {
    for (code, horizontal, vertical) in [
        (7415, 28992, 5709),
        (6697, 6668, 6695),
        (5554, 25831, 5783),
        (5555, 25832, 5783),
        (5556, 25833, 5783),
        (7405, 27700, 5701),
        (5698, 2154, 5720),
        (9518, 4326, 3855),
    ] {
        assert_eq!(codes(&format!("EPSG:{code}")), (Some(horizontal), Some(vertical)));
    }
}

#[test]
fn heights_of_three_dimensional_systems_are_above_the_ellipsoid() {
    for name in ["EPSG:4979", "EPSG:6667", "EPSG:4937", "EPSG:7843", "EPSG:4978", "ECEF", "OGC:CRS84h", "ENU:1,2,3"] {
        assert_eq!(resolve(name).unwrap().vertical, Vertical::Ellipsoidal { unit_m: 1.0 }, "{name}");
    }
    // GDAL names a system of three dimensions as the vertical one.
    let vertical = r#"VERT_CS["WGS 84",VERT_DATUM["WGS 84",2002],UNIT["metre",1],AUTHORITY["EPSG","4979"]]"#;
    let horizontal = r#"PROJCS["x",GEOGCS["ETRS89",DATUM["ETRS89",SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],UNIT["metre",1],AUTHORITY["EPSG","25832"]]"#;
    for name in [
        "EPSG:25832+4979",
        "urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::4979",
        &format!(r#"COMPD_CS["x",{horizontal},{vertical}]"#),
    ] {
        assert_eq!(resolve(name).unwrap().vertical, Vertical::Ellipsoidal { unit_m: 1.0 }, "{name}");
    }
    for name in ["EPSG:4326", "EPSG:6668", "OGC:CRS84", "EPSG:25832"] {
        assert_eq!(resolve(name).unwrap().vertical, Vertical::Unknown, "{name}");
    }
    let local = resolve("ENU:140.5,-35.25,12.5").unwrap();
    let origin = LocalOrigin { longitude_deg: 140.5, latitude_deg: -35.25, height_m: 12.5, is_ellipsoidal: false };
    assert_eq!(local.horizontal.system, System::Local(origin));
    let local = resolve("ENU:140.5,-35.25,12.5,ellipsoid").unwrap();
    assert_eq!(local.horizontal.system, System::Local(LocalOrigin { is_ellipsoidal: true, ..origin }));
}

#[test]
fn axes_are_those_of_the_registry() {
    let axes = |name: &str| resolve(name).unwrap().horizontal.axes;
    let letters = |letters| Axes::from_letters(letters).unwrap();
    for (expected, names) in [
        (
            "ne",
            &["EPSG:4326", "EPSG:6697", "EPSG:4979", "EPSG:6677", "EPSG:2451", "EPSG:2180", "EPSG:31467", "EPSG:3035"]
                [..],
        ),
        ("ne", &["EPSG:2193", "EPSG:3044", "EPSG:5048"]),
        (
            "en",
            &[
                "EPSG:25832", "EPSG:4647", "EPSG:28992", "EPSG:27700", "EPSG:2056", "EPSG:5514", "EPSG:3857",
                "OGC:CRS84",
            ],
        ),
        ("ws", &["EPSG:2048", "EPSG:2055"]),
        ("sw", &["EPSG:5513", "EPSG:2065"]),
    ] {
        for name in names {
            assert_eq!(axes(name), letters(expected), "{name}");
        }
    }
    assert_eq!(axes("urn:adv:crs:DE_DHDN_3GK3"), Axes::EAST_NORTH);
    assert_eq!(letters("ws").east_north([1.0, 2.0]), [-1.0, -2.0]);
    assert_eq!(letters("sw").east_north([1.0, 2.0]), [-2.0, -1.0]);
    assert_eq!(letters("nw").east_north([1.0, 2.0]), [-2.0, 1.0]);
    assert_eq!(Axes::from_letters("ns"), None);
}

const ESRI_UTM: &str = r#"PROJCS["ETRS_1989_UTM_Zone_32N",GEOGCS["GCS_ETRS_1989",DATUM["D_ETRS_1989",SPHEROID["GRS_1980",
    6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],
    PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",9.0],
    PARAMETER["Scale_Factor",0.9996],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]"#;
const ESRI_RD: &str = r#"PROJCS["RD_New",GEOGCS["GCS_Amersfoort",DATUM["D_Amersfoort",SPHEROID["Bessel_1841",6377397.155,
    299.1528128]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Double_Stereographic"],
    PARAMETER["False_Easting",155000.0],PARAMETER["False_Northing",463000.0],PARAMETER["Central_Meridian",5.38763888888889],
    PARAMETER["Scale_Factor",0.9999079],PARAMETER["Latitude_Of_Origin",52.15616055555555],UNIT["Meter",1.0]],
    VERTCS["Normaal_Amsterdams_Peil",VDATUM["Normaal_Amsterdams_Peil"],PARAMETER["Vertical_Shift",0.0],
    PARAMETER["Direction",1.0],UNIT["Meter",1.0]]"#;
const ESRI_NEW_YORK: &str = r#"PROJCS["NAD_1983_StatePlane_New_York_Long_Island_FIPS_3104_Feet",GEOGCS["GCS_North_American_1983",
    DATUM["D_North_American_1983",SPHEROID["GRS_1980",6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],
    UNIT["Degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic"],PARAMETER["False_Easting",984250.0],
    PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",-74.0],PARAMETER["Standard_Parallel_1",40.66666666666666],
    PARAMETER["Standard_Parallel_2",41.03333333333333],PARAMETER["Latitude_Of_Origin",40.16666666666666],
    UNIT["Foot_US",0.3048006096012192]]"#;
const ESRI_WEB_MERCATOR: &str = r#"PROJCS["WGS_1984_Web_Mercator_Auxiliary_Sphere",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",
    SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],
    PROJECTION["Mercator_Auxiliary_Sphere"],PARAMETER["False_Easting",0.0],PARAMETER["False_Northing",0.0],
    PARAMETER["Central_Meridian",0.0],PARAMETER["Standard_Parallel_1",0.0],PARAMETER["Auxiliary_Sphere_Type",0.0],
    UNIT["Meter",1.0]]"#;
const WKT2_JAPAN: &str = r#"COMPOUNDCRS["Japan",PROJCRS["JGD2011 / Japan Plane Rectangular CS IX",BASEGEOGCRS["JGD2011",
    DATUM["Japanese Geodetic Datum 2011",ELLIPSOID["GRS 1980",6378137,298.257222101,LENGTHUNIT["metre",1]]],
    PRIMEM["Greenwich",0,ANGLEUNIT["degree",0.0174532925199433]]],CONVERSION["Japan Plane Rectangular CS zone IX",
    METHOD["Transverse Mercator"],PARAMETER["Latitude of natural origin",36,ANGLEUNIT["degree",0.0174532925199433]],
    PARAMETER["Longitude of natural origin",139.833333333333,ANGLEUNIT["degree",0.0174532925199433]],
    PARAMETER["Scale factor at natural origin",0.9999,SCALEUNIT["unity",1]],PARAMETER["False easting",0,
    LENGTHUNIT["metre",1]],PARAMETER["False northing",0,LENGTHUNIT["metre",1]]],CS[Cartesian,2],AXIS["northing (X)",north,
    ORDER[1],LENGTHUNIT["metre",1]],AXIS["easting (Y)",east,ORDER[2],LENGTHUNIT["metre",1]]],
    VERTCRS["JGD2011 (vertical) height",VDATUM["JGD2011 (vertical)"],CS[vertical,1],AXIS["gravity-related height (H)",up,
    LENGTHUNIT["metre",1]]]]"#;

#[test]
fn well_known_text_without_codes_is_matched_by_its_parameters() {
    assert_eq!(codes(ESRI_UTM), (Some(25832), None));
    assert_eq!(codes(ESRI_RD), (Some(28992), Some(5709)));
    assert_eq!(codes(ESRI_NEW_YORK), (Some(2263), None));
    assert_eq!(codes(ESRI_WEB_MERCATOR), (Some(3857), None));
    assert_eq!(codes(WKT2_JAPAN), (Some(6677), Some(6695)));
    // Without the name of the datum: the definition itself.
    let unnamed = ESRI_UTM.replace("D_ETRS_1989", "D_Unheard_Of");
    let crs = resolve(&unnamed).unwrap();
    assert_eq!(crs.horizontal.code, None);
    let known = resolve("EPSG:25832").unwrap();
    let (found, known) = (crs.horizontal.definition().unwrap(), known.horizontal.definition().unwrap());
    assert!(found.is_same_projection(known) && found.has_same_shift(known));
    // Other parameters are another system.
    for (from, to) in
        [("\"Central_Meridian\",9.0", "\"Central_Meridian\",9.001"), ("0.9996", "0.9997"), ("500000.0", "500001.0")]
    {
        assert_eq!(codes(&ESRI_UTM.replace(from, to)), (None, None), "{to}");
    }
}

#[test]
fn codes_in_well_known_text_count_first() {
    let wkt1 = r#"COMPD_CS["x",PROJCS["y",GEOGCS["z",DATUM["d",SPHEROID["s",6378137,298.25]],UNIT["degree",0.0174]],
        PROJECTION["Nonsense"],UNIT["metre",1],AUTHORITY["EPSG","28992"]],VERT_CS["v",VERT_DATUM["v",2005],UNIT["metre",1],
        AUTHORITY["EPSG","5709"]]]"#;
    assert_eq!(codes(wkt1), (Some(28992), Some(5709)));
    assert_eq!(codes(&wkt1.replace("5709\"]]]", "5709\"]],AUTHORITY[\"EPSG\",\"7415\"]]")), (Some(28992), Some(5709)));
    let wkt2 = r#"GEOGCRS["WGS 84",DATUM["World Geodetic System 1984",ELLIPSOID["WGS 84",6378137,298.257223563]],
        CS[ellipsoidal,3],AXIS["lat",north],AXIS["lon",east],AXIS["h",up,LENGTHUNIT["metre",1]],ID["EPSG",4979]]"#;
    assert_eq!(resolve(wkt2).unwrap().vertical, Vertical::Ellipsoidal { unit_m: 1.0 });
    assert_eq!(
        resolve(&wkt2.replace(",ID[\"EPSG\",4979]", "")).unwrap().vertical,
        Vertical::Ellipsoidal { unit_m: 1.0 }
    );
}

const PROJJSON: &str = r#"{"type": "ProjectedCRS", "name": "NAD83 / UTM zone 18N", "base_crs": {"name": "NAD83", "datum": {
    "type": "GeodeticReferenceFrame", "name": "North American Datum 1983", "ellipsoid": {"name": "GRS 1980",
    "semi_major_axis": 6378137, "inverse_flattening": 298.257222101}}}, "conversion": {"name": "UTM zone 18N", "method": {
    "name": "Transverse Mercator"}, "parameters": [{"name": "Latitude of natural origin", "value": 0, "unit": "degree"},
    {"name": "Longitude of natural origin", "value": -75, "unit": "degree"}, {"name": "Scale factor at natural origin",
    "value": 0.9996, "unit": "unity"}, {"name": "False easting", "value": 500000, "unit": "metre"},
    {"name": "False northing", "value": 0, "unit": "metre"}]}, "coordinate_system": {"subtype": "Cartesian", "axis": [
    {"name": "Easting", "abbreviation": "E", "direction": "east", "unit": "metre"}, {"name": "Northing",
    "abbreviation": "N", "direction": "north", "unit": "metre"}]}, "id": {"authority": "EPSG", "code": 26918}}"#;

#[test]
fn projjson_is_read_by_code_and_by_parameters() {
    assert_eq!(codes(PROJJSON), (Some(26918), None));
    assert_eq!(codes(&PROJJSON.replace("\"EPSG\"", "\"other\"")), (Some(26918), None));
    let bound = |part: &str| format!(r#"{{"type": "BoundCRS", "source_crs": {part}, "transformation": {{}}}}"#);
    let height = r#"{"type": "VerticalCRS", "name": "x", "id": {"authority": "EPSG", "code": 5703}}"#;
    let parts =
        format!(r#"{{"type": "CompoundCRS", "name": "x", "components": [{}, {}]}}"#, bound(PROJJSON), bound(height));
    assert_eq!(codes(&parts), (Some(26918), Some(5703)));
    assert_eq!(codes(&PROJJSON.replace("\"EPSG\"", "\"other\"").replace("-75", "-75.5")), (None, None));
    let crs84 = r#"{"type": "GeographicCRS", "name": "WGS 84 (CRS84)", "datum_ensemble": {"name":
        "World Geodetic System 1984 ensemble", "ellipsoid": {"semi_major_axis": 6378137, "inverse_flattening": 298.257223563}},
        "coordinate_system": {"subtype": "ellipsoidal", "axis": [{"direction": "east", "unit": "degree"},
        {"direction": "north", "unit": "degree"}]}, "id": {"authority": "OGC", "code": "CRS84"}}"#;
    assert_eq!(codes(crs84), (Some(4326), None));
}

#[test]
fn strings_for_proj_are_systems_too() {
    let unit_m = |rest: &str| match resolve(&format!("+proj=utm +zone=32 +ellps=GRS80 {rest}")).unwrap().vertical {
        Vertical::Orthometric(datum) => Some(datum.unit_m),
        _ => None,
    };
    assert_eq!((unit_m("+units=m +vunits=us-ft"), unit_m("+vto_meter=0.5")), (Some(1200.0 / 3937.0), Some(0.5)));
    assert_eq!((unit_m("+units=us-ft +vunits=m"), unit_m("+units=m +vunits=m"), unit_m("")), (Some(1.0), None, None));
    assert!(resolve("+proj=utm +zone=32 +vunits=cubit").is_err());
    let crs = resolve("+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs").unwrap();
    let known = resolve("EPSG:25832").unwrap();
    assert!(crs.horizontal.definition().unwrap().is_same_projection(known.horizontal.definition().unwrap()));
    // The label of a system without a code names the same system.
    let text = crs.horizontal.definition().unwrap().text();
    assert_eq!(resolve(&text).unwrap().horizontal.definition().unwrap().text(), text);
    for text in ["+proj=utm +zone=61", "+proj=utm", "+proj=nonsense", "+proj=lcc +lat_1=x", "+proj=tmerc +towgs84=1,2"]
    {
        assert!(matches!(resolve(text), Err(CrsError::Unsupported(_))), "{text}");
    }
    // Grid files are not opened.
    assert!(
        !resolve("+proj=tmerc +nadgrids=/etc/hostname")
            .unwrap()
            .horizontal
            .definition()
            .unwrap()
            .text()
            .contains("etc")
    );
}

#[test]
fn every_definition_of_the_registry_can_be_projected() {
    let (mut projected, mut unsupported) = (0, 0);
    for (code, ..) in registry::projected_codes() {
        match resolve(&format!("EPSG:{code}")) {
            Ok(_) => projected += 1,
            Err(CrsError::Unsupported(_)) => unsupported += 1,
            Err(CrsError::Unknown) => panic!("EPSG:{code}"),
        }
    }
    assert!(projected > 5200 && unsupported < 70, "{projected} {unsupported}");
}

#[test]
fn cities_are_on_land_and_most_are_at_sea_with_latitude_for_longitude() {
    let cities =
        [[-0.12, 51.5], [2.35, 48.86], [11.6, 48.1], [-46.6, -23.5], [139.76, 35.68], [-157.86, 21.3], [7.42, 43.73]];
    for [lon, lat] in cities {
        assert!(is_near_land([lon, lat]) && is_near_land([lon - 360.0, lat]), "{lon} {lat}");
    }
    for [lon, lat] in &cities[..4] {
        assert!(!is_near_land([*lat, *lon]), "{lat} {lon}");
    }
    assert!(!is_near_land([0.0, -90.0]) && !is_near_land([f64::NAN, 0.0]) && !is_near_land([0.0, 1e9]));
}

#[test]
fn systems_that_are_not_known_are_told_from_others() {
    let gdal = r#"LOCAL_CS["Undefined SRS",LOCAL_DATUM["unknown",32767],UNIT["unknown",0],AXIS["Easting",EAST]]"#;
    let wkt2 = r#"ENGCRS["Unknown engineering CRS",EDATUM["Unknown engineering datum"],CS[Cartesian,2]]"#;
    let json = r#"{"type": "EngineeringCRS", "name": "Undefined SRS", "datum": {}}"#;
    for name in [gdal, wkt2, json, "undefined", " Unknown ", "unnamed", "NONE", ""] {
        assert!(is_undefined(name), "{name}");
    }
    for name in [
        "EPSG:28992",
        r#"LOCAL_CS["Site grid",UNIT["metre",1]]"#,
        r#"GEOGCS["unknown",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],UNIT["degree",0.0174532925199433]]"#,
        r#"{"type": "ProjectedCRS", "name": "unknown"}"#,
        "{",
    ] {
        assert!(!is_undefined(name), "{name}");
    }
}

#[test]
fn damaged_texts_give_errors() {
    for text in [ESRI_UTM, ESRI_RD, WKT2_JAPAN, PROJJSON] {
        for length in 0..text.len() {
            // RD_New is complete without its vertical system.
            let is_whole = resolve(&text[..length]).is_ok();
            assert!(!is_whole || text == ESRI_RD && length >= text.find("VERTCS").unwrap() - 6, "{}", &text[..length]);
        }
    }
    let deep = format!("PROJCS{}", "[A".repeat(100_000));
    assert_eq!(resolve(&deep), Err(CrsError::Unknown));
    let deep_json = "[".repeat(100_000);
    assert_eq!(resolve(&format!("{{\"a\":{deep_json}")), Err(CrsError::Unknown));
    for text in [
        "GEOGCS[]", "GEOGCS[\"x\"]", "EPSG:", "EPSG:99999999999999", "EPSG:4326+5773+5709", "ENU:nan,0,0",
        "urn:ogc:def:crs:",
    ] {
        assert!(resolve(text).is_err(), "{text}");
    }
    let odd = ESRI_UTM.replace("6378137.0", "-1").replace("ETRS", "X");
    assert!(resolve(&odd).is_err());
    for number in ["1e400", "0", "1e-300", "-0.5", "nan"] {
        let _ = resolve(&ESRI_NEW_YORK.replace("0.3048006096012192", number));
        let _ = resolve(&ESRI_UTM.replace("298.257222101", number));
        let _ = resolve(&ESRI_NEW_YORK.replace("41.03333333333333", number));
    }
}

#[test]
fn geographic_systems_are_known_in_every_spelling() {
    for name in ["urn:ogc:def:crs:EPSG::4979", "http://www.opengis.net/def/crs/EPSG/0/6697/", "EPSG:4326", "OGC:CRS84"]
    {
        assert!(is_geographic(name), "{name}");
    }
    assert!(!is_geographic("EPSG:7415") && !is_geographic("") && !is_geographic("ECEF"));
}

#[test]
fn names_of_esri_are_understood() {
    let text = |datum: &str, spheroid: &str, projection: &str| {
        format!(
            r#"PROJCS["a",GEOGCS["GCS",DATUM["{datum}",SPHEROID[{spheroid}]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],{projection},UNIT["Meter",1.0]]"#
        )
    };
    let stereo = r#"PROJECTION["Double_Stereographic"],PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",500000.0],PARAMETER["Central_Meridian",25.0],PARAMETER["Scale_Factor",0.99975],PARAMETER["Latitude_Of_Origin",46.0]"#;
    let romania = resolve(&text("D_Dealul_Piscului_1970", r#""Krasovsky_1940",6378245.0,298.3"#, stereo)).unwrap();
    assert_eq!(romania.horizontal.code, Some(3844));
    // The rotation of the oblique Mercator.
    let oblique = r#"PROJECTION["Rectified_Skew_Orthomorphic_Natural_Origin"],PARAMETER["False_Easting",804671.0],PARAMETER["False_Northing",0.0],PARAMETER["Scale_Factor",0.99984],PARAMETER["Azimuth",-36.9742035333334],PARAMETER["Longitude_Of_Center",102.25],PARAMETER["Latitude_Of_Center",4.0],PARAMETER["XY_Plane_Rotation",-36.8698976388889]"#;
    let malaysia = resolve(&text("D_GDM_2000", r#""GRS_1980",6378137.0,298.257222101"#, oblique)).unwrap();
    let definition = malaysia.horizontal.definition().unwrap().text();
    assert!(malaysia.horizontal.code == Some(3375) || definition.contains("+gamma=-36.869"), "{definition}");
}

#[test]
fn areas_may_cross_the_antimeridian() {
    let fiji = Area::new([176.0, -21.0, 182.0, -12.0]);
    assert!(fiji.contains([179.0, -18.0], 0.0) && fiji.contains([-179.0, -18.0], 0.0));
    assert!(!fiji.contains([-177.0, -18.0], 0.5) && fiji.contains([-177.0, -18.0], 1.5));
    assert!(!fiji.contains([179.0, 18.0], 1.0));
}

#[test]
fn utm_and_degrees_are_known_by_their_lines() {
    let text = |projection: &str, datum: &str, units: &str, rest: &str| {
        format!(
            "Projection    {projection}\r\nDatum  {datum}\nSpheroid GRS80\nUnits {units}\nZunits NO\n{rest}\nParameters \n"
        )
    };
    let code = |text: &str| resolve(text).map(|crs| crs.horizontal.code.unwrap_or_default());
    for (projection, datum, units, rest, expected) in [
        ("UTM", "WGS84", "METERS", "Zone 32", 32_632),
        ("utm", "WGS84", "meters", "zone -19", 32_719),
        ("UTM", "NAD83", "METERS", "Zone 18\nXshift 0.0", 26_918),
        ("UTM", "ETRS89", "METERS", "Zone 32", 25_832),
        ("UTM", "NONE", "METERS", "Zone 32", 32_632),
        ("GEOGRAPHIC", "WGS84", "DD", "", 4326),
    ] {
        assert_eq!(code(&text(projection, datum, units, rest)), Ok(expected), "{projection} {datum} {rest}");
    }
    let reason = |text: &str| match code(text) {
        Err(CrsError::Unsupported(reason)) => reason,
        other => panic!("{other:?}"),
    };
    assert_eq!(reason(&text("ALBERS", "NAD83", "METERS", "")), "its projection is ALBERS");
    assert_eq!(reason(&text("UTM", "NAD83", "FEET", "Zone 18")), "its units is FEET");
    assert_eq!(reason(&text("UTM", "NAD83", "METERS", "Zone 99")), "its zone is 99");
    assert_eq!(reason(&text("UTM", "NAD83", "METERS", "Zone 18\nYshift 5")), "its yshift is 5");
    assert_eq!(reason(&text("UTM", "CAPE", "METERS", "Zone 35")), "its datum is CAPE");
}
