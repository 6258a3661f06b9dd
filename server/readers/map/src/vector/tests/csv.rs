//! Lines of values.

use super::{attack, attributes, read, rings, run, square, text};
use crate::vector::read_csv;
use insula_source::attributes::AttributeValue;
use insula_source::object::{Description, Shape};
use insula_source::problems::{ENCODING_GUESSED, MARK_GUESSED, NO_CRS};
use insula_source::testing::TestSink;

#[test]
fn values_are_typed_and_geometries_found() {
    let lines = "\u{feff}id,the_geom,height,built,note\r\n\
        1,\"POLYGON((10 10,\n 19 10,19 19,10 19,10 10))\",12.5,2001-02-03,\"a, \"\"b\"\"\"\r\n\
        2,,3,,\r\n\
        3,POLYGON(,3,,\r\n";
    let sink = read(read_csv, &[("a.csv", lines.as_bytes())]);
    let object = &sink.objects[0];
    assert_eq!(rings(&object.shape)[0].rings, [square(10.0, 10.0, 9.0)]);
    let date = AttributeValue::Date { year: 2001, month: 2, day: 3 };
    let expected = [
        ("id", AttributeValue::Integer(1)),
        ("height", AttributeValue::Float(12.5)),
        ("built", date),
        ("note", text("a, \"b\"")),
    ];
    assert_eq!(object.attributes, attributes(&expected));
    assert_eq!(sink.skipped, [("no geometry", "2".to_owned()), ("malformed geometry", "3".to_owned())]);
    assert!(sink.bytes_done > 0);
}

#[test]
fn delimiters_names_and_encodings() {
    for delimiter in [",", ";", "\t", "|"] {
        let lines = format!("nr{delimiter}ort{delimiter}form\n7{delimiter}Köln{delimiter}\"POINT (500 600)\"\n");
        let sink = read(read_csv, &[("a.tsv", lines.as_bytes())]);
        assert_eq!(sink.objects[0].attributes.get("ort"), Some(&text("Köln")), "found by its content");
    }
    for (line, delimiter) in [("sep=;\r\n", ";"), ("SEP=,\n", ","), ("sep=\t\n", "\t")] {
        let lines = format!("{line}nr{delimiter}form{delimiter}a,b;c,d\n7{delimiter}\"POINT (500 600)\"\n");
        assert_eq!(read(read_csv, &[("a.csv", lines.as_bytes())]).objects.len(), 1, "{line}");
    }
    let latin = read(read_csv, &[("a.csv", b"wkt;ort\nPOINT(500 600);K\xf6ln\n")]);
    assert_eq!(latin.objects[0].attributes.get("ort"), Some(&text("Köln")));
    let (japanese, ..) = encoding_rs::SHIFT_JIS.encode("wkt,高さ,表\nPOINT(500 600),12,東京\n");
    let japanese = read(read_csv, &[("a.csv", &*japanese)]);
    assert!(japanese.problems[0].1.contains("高さ, 表: taken as Shift_JIS"), "{:?}", japanese.problems);
    assert_eq!(japanese.objects[0].attributes.get("高さ"), Some(&AttributeValue::Integer(12)));
    assert_eq!(japanese.objects[0].attributes.get("表"), Some(&text("東京")));
    let (russian, ..) = encoding_rs::WINDOWS_1251.encode("wkt,высота\nPOINT(500 600),12\n");
    let russian = read(read_csv, &[("a.csv", &*russian)]);
    assert!(russian.problems[0].1.contains("высота: taken as windows-1251"), "{:?}", russian.problems);
    assert_eq!(russian.objects[0].attributes.get("высота"), Some(&AttributeValue::Integer(12)));
    let nameless = read(read_csv, &[("a.csv", b"POINT(500 600);x\nPOINT(500 700);y\n")]);
    assert_eq!(nameless.objects.len(), 2);
    assert_eq!(nameless.objects[1].attributes.get("column 2"), Some(&text("y")));
    let hex = read(read_csv, &[("a.csv", b"geom,n\n0101000020E6100000000000000000F03F0000000000000040,1\n")]);
    assert_eq!((hex.crs[0].name.as_str(), hex.objects.len()), ("EPSG:4326", 1));
    let codes = read(read_csv, &[("a.csv", b"wkt,epsg\nPOINT(1 2),EPSG:6677\nPOINT(1 2),28992\n")]);
    assert_eq!(codes.crs.iter().map(|crs| crs.name.as_str()).collect::<Vec<_>>(), ["EPSG:6677", "EPSG:28992"]);
    let beside = read(read_csv, &[("a.csv", b"wkt,n\nPOINT(1 2),7\n"), ("a.prj", b"PROJCS[\"x\"]")]);
    assert_eq!(beside.crs[0].name, "PROJCS[\"x\"]");
}

#[test]
fn the_system_of_a_line_before_is_none_of_its_own() {
    let lines = b"wkt,n\nSRID=28992;POINT(85000 446000),1\nPOINT(85010 446000),2\n";
    let names = |sink: &TestSink| sink.crs.iter().map(|crs| crs.name.clone()).collect::<Vec<_>>();
    let alone = read(read_csv, &[("t.csv", lines)]);
    assert_eq!(names(&alone), ["EPSG:28992"]);
    assert!(alone.problems.iter().any(|(kind, what)| *kind == NO_CRS && what.contains("that of the feature before")));
    let of_table = read(read_csv, &[("t.csv", lines), ("t.prj", b"PROJCS[\"x\"]")]);
    assert_eq!(names(&of_table), ["PROJCS[\"x\"]", "EPSG:28992", "PROJCS[\"x\"]"]);
    assert!(of_table.problems.iter().all(|(kind, _)| *kind != NO_CRS));
}

#[test]
fn an_attribution_beside_a_table_may_be_in_another_encoding() {
    let sink = read(read_csv, &[("a.csv", b"wkt,n\nPOINT(1 2),7\n"), ("a.csv.txt", b"Stadt K\xf6ln\n")]);
    assert_eq!(sink.described, [(Description::Attribution, "Stadt Köln".to_owned())]);
}

#[test]
fn the_encoding_may_be_told_far_from_the_beginning() {
    // Of a column of 10,000 lines, the last ones are beyond ASCII.
    let (russian, ..) = encoding_rs::WINDOWS_1251.encode("POINT(500 600),Жилой дом\nPOINT(500 600),Школа\n");
    let lines = [b"wkt,n\n".to_vec(), b"POINT(500 600),a\n".repeat(10_000), russian.into_owned()].concat();
    let sink = read(read_csv, &[("a.csv", &lines)]);
    let [.., first, second] = &sink.objects[..] else { panic!() };
    assert_eq!(
        (first.attributes.get("n"), second.attributes.get("n")),
        (Some(&text("Жилой дом")), Some(&text("Школа")))
    );
    assert_eq!(sink.problems.len(), 1);
    assert_eq!(sink.problems[0].0, ENCODING_GUESSED);
    // A line that is not in UTF-8, among others that are.
    let lines = [b"wkt,n\nPOINT(500 600),".to_vec(), "высота\n".into(), b"POINT(500 600),a\n".repeat(10_000)].concat();
    let lines = [&lines[..], b"POINT(500 600),K\xf6ln\n", "POINT(500 600),дом\n".as_bytes()].concat();
    let sink = read(read_csv, &[("a.csv", &lines)]);
    let [.., first, second] = &sink.objects[..] else { panic!() };
    assert_eq!((first.attributes.get("n"), second.attributes.get("n")), (Some(&text("Köln")), Some(&text("дом"))));
    assert_eq!(sink.problems.len(), 1, "{:?}", sink.problems);
}

#[test]
fn geometries_may_be_texts_of_geojson() {
    let shape = r#""{""type"": ""Polygon"", ""coordinates"": [[[10,10],[19,10],[19,19],[10,19],[10,10]]]}""#;
    let lines =
        format!("id;Geo Point;Geo Shape\n7;48.14, 11.57;{shape}\n8;48.14, 11.57;\n9;1, 2;\"{{ \"\"coordinates\"\"\"\n");
    let sink = read(read_csv, &[("a.csv", lines.as_bytes())]);
    assert_eq!(rings(&sink.objects[0].shape)[0].rings, [square(10.0, 10.0, 9.0)]);
    assert_eq!(sink.skipped, [("no geometry", "8".to_owned()), ("malformed geometry", "9".to_owned())]);
}

#[test]
fn quotation_marks_within_texts_may_be_behind_a_backslash() {
    let shape = r#"{\"type\": \"Polygon\", \"coordinates\": [[[10,10],[19,10],[19,19],[10,19],[10,10]]]}"#;
    let lines = format!("id,geom,note\n7,\"{shape}\",\"a \\\"b\\\"\"\n");
    let sink = read(read_csv, &[("a.csv", lines.as_bytes())]);
    assert_eq!(rings(&sink.objects[0].shape)[0].rings, [square(10.0, 10.0, 9.0)]);
    assert_eq!(sink.objects[0].attributes.get("note"), Some(&text("a \"b\"")));
}

#[test]
fn other_tables_are_refused() {
    for lines in [&b""[..], b"a,b\n1,2\n", b"\n\n\n", b"\xff\xfe\0"] {
        assert!(run(read_csv, &[("a.csv", lines)], None).0.is_err(), "{lines:?}");
    }
    let lines = b"wkt;n\n\"POLYGON((0 0,9 0,9 9,0 0))\";1\nPOINT(1 2);\"2\n";
    attack(read_csv, &[("a.csv", lines)], 1, 3);
}

#[test]
fn commas_in_numbers_are_before_decimals_or_between_groups() {
    let height = |lines: &str| {
        let sink = read(read_csv, &[("a.csv", lines.as_bytes())]);
        let guesses = sink.problems.iter().filter(|(kind, _)| *kind == MARK_GUESSED).count();
        (sink.objects[0].attributes.get("height").cloned(), guesses)
    };
    let (whole, float) = (AttributeValue::Integer, AttributeValue::Float);
    for (lines, expected, guesses) in [
        ("wkt;height\nPOINT(1 2);1,234\nPOINT(1 2);12,5\n", float(1.234), 0),
        ("wkt;height\nPOINT(1 2);1.234\nPOINT(1 2);950,5\n", whole(1234), 0),
        ("wkt;height\nPOINT(1 2);1,234\nPOINT(1 2);12.5\n", whole(1234), 0),
        ("wkt;height;area\nPOINT(1 2);1,234;20.5\n", whole(1234), 1),
        ("wkt;height\nPOINT(1 2);1,234\nPOINT(1 2);2,345\n", float(1.234), 1),
        ("wkt,height\nPOINT(1 2),\"1,234\"\n", whole(1234), 1),
        // Nothing to decide.
        ("wkt;height\nPOINT(1 2);12,5\n", text("12,5"), 0),
        ("wkt;height\nPOINT(1 2);1.234\n", float(1.234), 0),
    ] {
        assert_eq!(height(lines), (Some(expected), guesses), "{lines}");
    }
}

#[test]
fn points_may_be_in_columns_of_coordinates() {
    let place = |lines: &str| {
        let sink = read(read_csv, &[("trees.csv", lines.as_bytes())]);
        let Shape::Points(points) = &sink.objects[0].shape else { panic!("{lines}: {:?}", sink.objects[0].shape) };
        (sink.crs.first().map(|crs| crs.name.clone()), points[0].place[0], points[0].place[1])
    };
    let degrees = Some("OGC:CRS84".to_owned());
    for lines in [
        "name,Lat,Lon,height\nA,48.14,11.57,12\n",
        "longitude;latitude\n11,57;48,14\n",
        "id;geo_point_2d\n1;48.14, 11.57\n",
        "X,Y\n11.57,48.14\n",
    ] {
        assert_eq!(place(lines), (degrees.clone(), 11.57, 48.14), "{lines}");
    }
    assert_eq!(
        place("id;X_Coord;Y_Coord;EPSG\n1;691000,5;5334000;25832\n"),
        (Some("EPSG:25832".into()), 691_000.5, 5_334_000.0)
    );
    assert_eq!(place("Rechtswert\tHochwert\n691000.5\t5334000\n"), (None, 691_000.5, 5_334_000.0));
    let metres = (None, 91_000.0, 437_000.0);
    assert_eq!(place("X;Y\n91,000;437,000\n"), metres, "between groups");
    assert_eq!(place("X,Y\n\"91,000.0\",\"437,000.0\"\n"), metres);
    assert_eq!(place("X;Y\n91.000,0;437.000,0\n"), metres);
    assert_eq!(place("X;Y\n11,575;48\n"), (degrees.clone(), 11.575, 48.0), "before decimals");
    // A geometry counts before.
    assert_eq!(place("x,y,wkt\n1,2,POINT(500 600)\n").1, 500.0);
    let faults = read(read_csv, &[("trees.csv", b"id,lat,lon\na,,\nb,x,11\nc,48,11\n")]);
    let expected = [("no geometry", "a".to_owned()), ("coordinate not a number", "b".to_owned())];
    assert_eq!((faults.objects.len(), &faults.skipped[..]), (1, &expected[..]));
}
