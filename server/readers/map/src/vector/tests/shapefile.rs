//! Shapefiles.

use super::{attack, attributes, read, rings, run, square, text};
use crate::vector::read_shapefile;
use insula_source::attributes::AttributeValue;
use insula_source::object::{FeatureKind, PointOnGround, Shape};
use insula_source::problems::{ENCODING_GUESSED, MARK_GUESSED, NO_MEMOS};
use insula_source::testing::TestSink;

type Positions<'a> = &'a [[f64; 3]];

fn shp(shapes: &[Vec<u8>]) -> Vec<u8> {
    let mut file = 9994_u32.to_be_bytes().to_vec();
    file.resize(100, 0);
    for (index, shape) in shapes.iter().enumerate() {
        file.extend((index as u32 + 1).to_be_bytes());
        file.extend((shape.len() as u32 / 2).to_be_bytes());
        file.extend(shape);
    }
    file
}

/// A line, polygon or multipatch of parts, each with what a multipatch says it is.
fn shape(code: u32, parts: &[(u32, Positions<'_>)]) -> Vec<u8> {
    let positions = || parts.iter().flat_map(|(_, part)| part.iter());
    let mut bytes = code.to_le_bytes().to_vec();
    bytes.resize(36, 0);
    bytes.extend((parts.len() as u32).to_le_bytes());
    bytes.extend((positions().count() as u32).to_le_bytes());
    let mut start = 0_u32;
    for (_, part) in parts {
        bytes.extend(start.to_le_bytes());
        start += part.len() as u32;
    }
    if code == 31 {
        parts.iter().for_each(|(kind, _)| bytes.extend(kind.to_le_bytes()));
    }
    for [x, y, _] in positions() {
        bytes.extend(x.to_le_bytes());
        bytes.extend(y.to_le_bytes());
    }
    if matches!(code, 13 | 15 | 31) {
        bytes.extend([0; 16]);
        positions().for_each(|[_, _, z]| bytes.extend(z.to_le_bytes()));
    }
    bytes
}

/// A table of columns (name, type, bytes, decimals) and rows.
fn dbf(language: u8, columns: &[(&str, u8, u8, u8)], rows: &[&[u8]]) -> Vec<u8> {
    let header = 32 * (columns.len() + 1) + 1;
    let row: usize = 1 + columns.iter().map(|column| usize::from(column.2)).sum::<usize>();
    let mut file = vec![3, 124, 1, 1];
    file.extend((rows.len() as u32).to_le_bytes());
    file.extend((header as u16).to_le_bytes());
    file.extend((row as u16).to_le_bytes());
    file.resize(32, 0);
    file[29] = language;
    for (name, kind, bytes, decimals) in columns {
        let mut column = [0; 32];
        column[..name.len()].copy_from_slice(name.as_bytes());
        (column[11], column[16], column[17]) = (*kind, *bytes, *decimals);
        file.extend(column);
    }
    file.push(0x0d);
    for cells in rows {
        assert_eq!(cells.len(), row);
        file.extend(*cells);
    }
    file.push(0x1a);
    file
}

fn ring(corners: &[[f64; 2]], z: f64) -> Vec<[f64; 3]> {
    corners.iter().rev().map(|[x, y]| [*x, *y, z]).collect()
}

#[test]
fn polygons_with_attributes_and_system() {
    let outer = ring(&square(0.0, 0.0, 9.0), 0.0);
    let hole: Vec<[f64; 3]> = ring(&square(1.0, 1.0, 2.0), 0.0).into_iter().rev().collect();
    let far = ring(&square(50.0, 0.0, 9.0), 0.0);
    let shapes = [shape(5, &[(0, &far), (0, &outer), (0, &hole)]), vec![0; 4], shape(5, &[(0, &outer)])];
    let columns =
        [("NAME", b'C', 6, 0), ("HEIGHT", b'N', 6, 2), ("NR", b'N', 4, 0), ("BUILT", b'D', 8, 0), ("OK", b'L', 1, 0)];
    let rows: [&[u8]; 3] =
        [b" K\xf6ln   12.50   720010203T", b"                           ", b"*abc    ******  8        ?"];
    let rows = [rows[0], &rows[1][..26], rows[2]];
    let files: [(&str, &[u8]); 4] = [
        ("Haus.SHP", &shp(&shapes)),
        ("Haus.DBF", &dbf(0x57, &columns, &rows)),
        ("Haus.prj", b"PROJCS[]"),
        ("Haus.x", b""),
    ];
    let sink = read(read_shapefile, &files);
    assert_eq!(sink.crs[0].name, "PROJCS[]");
    let of_qgis = [files[0], files[1], ("Haus.qpj", &b"PROJCS[qgis]"[..])];
    assert_eq!(read(read_shapefile, &of_qgis).crs[0].name, "PROJCS[qgis]");
    let footprints = rings(&sink.objects[0].shape);
    assert_eq!((footprints.len(), footprints[0].rings.len(), footprints[1].rings.len()), (2, 1, 2));
    let expected = [
        ("NAME", text("Köln")),
        ("HEIGHT", AttributeValue::Float(12.5)),
        ("NR", AttributeValue::Integer(7)),
        ("BUILT", AttributeValue::Date { year: 2001, month: 2, day: 3 }),
        ("OK", AttributeValue::Bool(true)),
    ];
    assert_eq!(sink.objects[0].attributes, attributes(&expected));
    let skipped = [("no geometry", "feature 2".to_owned()), ("deleted feature", "feature 3".to_owned())];
    assert_eq!((sink.objects.len(), sink.skipped), (1, skipped.to_vec()));
}

#[test]
fn code_page_files_name_the_encoding() {
    let shapes = shp(&[shape(5, &[(0, &ring(&square(0.0, 0.0, 9.0), 0.0))])]);
    let name = |language: u8, cpg: Option<&[u8]>, cell: &[u8]| {
        let row = [b" ", cell].concat();
        let table = dbf(language, &[("N", b'C', cell.len() as u8, 0)], &[&row]);
        let mut files: Vec<(&str, &[u8])> = vec![("a.shp", &shapes), ("a.dbf", &table)];
        files.extend(cpg.map(|cpg| ("a.cpg", cpg)));
        let sink = read(read_shapefile, &files);
        sink.objects[0].attributes.get("N").unwrap().to_string()
    };
    assert_eq!(name(0x57, Some(b"UTF-8"), "東京".as_bytes()), "東京");
    assert_eq!(name(0, None, "東京".as_bytes()), "東京");
    assert_eq!(name(0x13, None, b"\x93\x8c\x8b\x9e"), "東京");
    assert_eq!(name(0, Some(b"CP936\r\n"), b"\xb1\xb1\xbe\xa9"), "北京");
    assert_eq!(name(0, None, b"caf\xe9 "), "café");
    // ArcGIS tells the encoding of no country by this number.
    let (russian, ..) = encoding_rs::WINDOWS_1251.encode("Жилой дом");
    assert_eq!(name(0x57, None, &russian), "Жилой дом");
    assert_eq!(name(0x57, None, "東京".as_bytes()), "東京");
    assert_eq!(name(0, Some(b"1251"), &russian), "Жилой дом");
    assert_eq!(name(0, Some(b"UTF-8"), &russian), "Жилой дом");
    let table = dbf(0, &[("N", b'C', 3, 0)], &[b" \xb1\xb9\xbd"]);
    let sink = read(read_shapefile, &[("a.shp", &shapes), ("a.dbf", &table), ("a.cst", b"ISO-8859-2")]);
    assert_eq!(sink.objects[0].attributes, attributes(&[("N", text("ąš˝"))]));
}

#[test]
fn a_guess_of_the_encoding_is_reported_and_names_columns_too() {
    let shapes = shp(&[shape(5, &[(0, &ring(&square(0.0, 0.0, 9.0), 0.0))])]);
    let (name, ..) = encoding_rs::WINDOWS_1251.encode("ЭТАЖНОСТЬ");
    let mut table = dbf(0, &[("---------", b'C', 9, 0)], &[&[b" ", &*name].concat()]);
    table[32..41].copy_from_slice(&name);
    let sink = read(read_shapefile, &[("a.shp", &shapes), ("a.dbf", &table)]);
    assert_eq!(sink.objects[0].attributes, attributes(&[("ЭТАЖНОСТЬ", text("ЭТАЖНОСТЬ"))]));
    assert_eq!(sink.problems[0].0, ENCODING_GUESSED);
    assert!(sink.problems[0].1.contains("taken as windows-1251"), "{:?}", sink.problems);
}

#[test]
fn commas_in_numbers_are_before_decimals_or_between_groups() {
    let plan = shape(5, &[(0, &ring(&square(0.0, 0.0, 9.0), 0.0))]);
    let shapes = shp(&[plan.clone(), plan]);
    let read_rows = |columns: &[(&str, u8, u8, u8)], rows: [&[u8]; 2]| {
        read(read_shapefile, &[("a.shp", &shapes), ("a.dbf", &dbf(0, columns, &rows))])
    };
    let first = |sink: &TestSink| sink.objects[0].attributes.get("H").cloned();
    let text = [("H", b'C', 6, 0)];
    let certain = read_rows(&text, [b"  1,234", b"   12,5"]);
    assert_eq!((first(&certain), certain.problems.len()), (Some(AttributeValue::Float(1.234)), 0));
    let guessed = read_rows(&text, [b"  1,234", b"    950"]);
    assert_eq!(first(&guessed), Some(AttributeValue::Integer(1234)));
    let [(kind, detail)] = &guessed.problems[..] else { panic!("{:?}", guessed.problems) };
    assert!(*kind == MARK_GUESSED && detail.contains("H: numbers such as 1,234 are taken as 1234"), "{detail}");
    for (decimals, cell, expected) in [(0, b"  1,234", 1234.0), (3, b"  1,234", 1.234), (2, b"1,234.5", 1234.5)] {
        let sink = read_rows(&[("H", b'N', 7, decimals)], [&[b" ", &cell[..]].concat(), b"       1"]);
        assert_eq!(first(&sink), Some(AttributeValue::Float(expected)), "{decimals} decimals");
    }
}

/// A file of blocks of 64 bytes, with a memo in the second one, and what its header tells at a place.
fn memo_file(place: usize, told: [u8; 2], memo: &[u8]) -> Vec<u8> {
    let mut file = vec![0; 128];
    file[place..place + 2].copy_from_slice(&told);
    file.extend(memo);
    file
}

#[test]
fn memos_are_read_from_the_file_beside_the_table() {
    let shapes = shp(&[shape(5, &[(0, &ring(&square(0.0, 0.0, 9.0), 0.0))])]);
    let read_memo = |version: u8, cell: &[u8], name: &str, memos: Option<&[u8]>| {
        let mut table = dbf(0, &[("NOTE", b'M', cell.len() as u8, 0)], &[&[b" ", cell].concat()]);
        table[0] = version;
        let mut files: Vec<(&str, &[u8])> = vec![("a.shp", &shapes), ("a.dbf", &table)];
        files.extend(memos.map(|memos| (name, memos)));
        let sink = read(read_shapefile, &files);
        let note = sink.objects[0].attributes.get("NOTE").map(ToString::to_string);
        (note, sink.problems)
    };
    let text = b"Stra\xdfe, K\xf6ln";
    let block_2 = b"         2";
    let mut dbase_3 = vec![0; 1024];
    dbase_3.extend(b"Stra\xdfe,\x8d\nK\xf6ln\x1a\x1anext");
    let dbase_4 = [&[0xff_u8, 0xff, 8, 0][..], &(8 + text.len() as u32).to_le_bytes()[..], &text[..]].concat();
    let fox_pro = [&1_u32.to_be_bytes()[..], &(text.len() as u32).to_be_bytes()[..], &text[..]].concat();
    for (version, cell, name, memos) in [
        (0x83, &block_2[..], "a.dbt", dbase_3),
        (0x8b, block_2, "a.DBT", memo_file(20, [64, 0], &dbase_4)),
        (0xf5, block_2, "a.fpt", memo_file(6, [0, 64], &fox_pro)),
        (0x30, &[2, 0, 0, 0], "a.fpt", memo_file(6, [0, 64], &fox_pro)),
    ] {
        let (note, problems) = read_memo(version, cell, name, Some(&memos));
        assert_eq!((note.as_deref(), problems.len()), (Some("Straße, Köln"), 0), "{version} {problems:?}");
        for length in 0..memos.len() {
            let (note, problems) = read_memo(version, cell, name, Some(&memos[..length]));
            assert!(note.is_some() || problems[0].0 == NO_MEMOS, "{length} {problems:?}");
        }
        let (note, problems) =
            read_memo(version, if cell.len() == 4 { &[0; 4] } else { b"          " }, name, Some(&memos));
        assert_eq!((note, problems), (None, vec![]));
    }
    let expected = vec![(NO_MEMOS, "a.dbf: NOTE: no .dbt or .fpt file beside it".to_owned())];
    assert_eq!(read_memo(0x83, block_2, "", None), (None, expected));
    let far = read_memo(0x83, b"9999999999", "a.dbt", Some(&[0; 600]));
    assert_eq!(far, (None, vec![(NO_MEMOS, "feature 1: NOTE".to_owned())]));
}

#[test]
fn lines_points_and_heights() {
    let line = shape(13, &[(0, &[[0.0, 0.0, 1.0], [9.0, 0.0, 2.0]]), (0, &[[0.0, 5.0, 1.0], [9.0, 5.0, 2.0]])]);
    let point = [&11_u32.to_le_bytes()[..], &[4.0_f64, 5.0, 6.0, 0.0].map(f64::to_le_bytes).concat()].concat();
    let sink = read(read_shapefile, &[("gis_osm_roads_free_1.shp", &shp(&[line, point]))]);
    let Shape::Strips(strips) = &sink.objects[0].shape else { panic!() };
    assert_eq!((strips.len(), strips[1].points[1], sink.objects[0].kind), (2, [9.0, 5.0], FeatureKind::Road));
    assert_eq!(sink.objects[1].shape, Shape::Points(vec![PointOnGround { place: [4.0, 5.0], ground: Some(6.0) }]));
    assert_eq!(sink.problems[0].0, "no attributes");
    let wall = ring(&square(0.0, 0.0, 9.0), 0.0).iter().map(|[x, y, _]| [*x, 0.0, *y]).collect::<Vec<_>>();
    let sink = read(read_shapefile, &[("a.shp", &shp(&[shape(15, &[(0, &wall)])]))]);
    assert!(matches!(&sink.objects[0].shape, Shape::Surfaces { polygons, .. } if polygons[0].points.len() == 4));
}

#[test]
fn multipatches_are_surfaces_in_space() {
    let square = |z: f64, corners: [[f64; 2]; 4]| corners.map(|[x, y]| [x, y, z]);
    let base = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]];
    let top = ring(&base, 3.0);
    let hole = ring(&[[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]], 3.0);
    let strip = [[0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [9.0, 0.0, 0.0], [9.0, 0.0, 3.0]];
    let parts: [(u32, Positions<'_>); 7] =
        [(0, &strip), (1, &square(0.0, base)), (2, &top), (3, &hole), (6, &strip[..3]), (4, &top), (5, &hole)];
    let sink = read(read_shapefile, &[("a.shp", &shp(&[shape(31, &parts)]))]);
    let Shape::Surfaces { polygons, meshes } = &sink.objects[0].shape else { panic!() };
    assert_eq!(meshes.iter().map(|mesh| mesh.triangles.len()).collect::<Vec<_>>(), [2, 2, 1]);
    assert_eq!(polygons.iter().map(|polygon| polygon.hole_starts.as_slice()).collect::<Vec<_>>(), [&[4][..], &[4]]);
    // Clockwise from above in the file, so counter-clockwise here.
    assert_eq!(polygons[0].points[..2], [[0.0, 0.0, 3.0], [9.0, 0.0, 3.0]]);
    let few = shape(31, &[(0, &strip[..2]), (9, &strip), (2, &strip)]);
    let sink = read(read_shapefile, &[("a.shp", &shp(&[few]))]);
    let kinds: Vec<&str> = sink.problems.iter().map(|problem| problem.0).collect();
    assert_eq!(kinds, ["no attributes", "patch has fewer than three points", "patch of unknown type"]);
}

#[test]
fn hostile_files() {
    let outer = ring(&square(0.0, 0.0, 9.0), 1.0);
    let whole = shp(&[shape(15, &[(0, &outer), (0, &outer)]), shape(31, &[(2, &outer), (0, &outer)])]);
    let table = dbf(0, &[("A", b'N', 2, 0)], &[b"  1", b"  2"]);
    attack(read_shapefile, &[("a.shp", &whole), ("a.dbf", &table)], 3, 60);
    for length in 0..table.len() {
        let sink = read(read_shapefile, &[("a.shp", &whole), ("a.dbf", &table[..length])]);
        assert_eq!(sink.objects.len(), 2, "damaged attributes cost no shape");
    }
    let mut endless = whole.clone();
    endless[104..108].copy_from_slice(&u32::MAX.to_be_bytes());
    assert!(run(read_shapefile, &[("a.shp", &endless)], None).0.is_err());
    let mut counts = shape(5, &[(0, &outer)]);
    counts[36..44].fill(0xff);
    assert_eq!(read(read_shapefile, &[("a.shp", &shp(&[counts]))]).skipped[0].0, "malformed geometry");
    assert!(run(read_shapefile, &[("a.shp", &[0; 200])], None).0.is_err());
}
