//! GeoPackages.

use super::{attack, attributes, polygon_wkb, read, rings, run, square, text};
use crate::vector::read_geopackage;
use insula_source::attributes::AttributeValue;
use insula_source::object::Description;
use insula_source::problems::{COARSER_TABLE, ENCODING_GUESSED, UNSAVED};
use rusqlite::Connection;

const SCHEMA: &str = "
    CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT, srs_id INTEGER PRIMARY KEY, organization TEXT,
        organization_coordsys_id INTEGER, definition TEXT, description TEXT);
    CREATE TABLE gpkg_contents (table_name TEXT PRIMARY KEY, data_type TEXT, identifier TEXT, description TEXT, srs_id INTEGER);
    CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name TEXT, srs_id INTEGER);
    INSERT INTO gpkg_spatial_ref_sys VALUES
        ('a', 28992, 'epsg', 28992, 'PROJCS[]', ''), ('b', 99, 'ESRI', 102100, 'PROJCS[\"b\"]', ''), ('c', -1, 'NONE', -1, 'undefined', '');";

/// A geometry behind a header, with an extent if `extent`.
fn blob(wkb: &[u8], extent: Option<[f64; 4]>) -> Vec<u8> {
    let mut bytes = vec![b'G', b'P', 0, if extent.is_some() { 3 } else { 1 }, 0, 0, 0, 0];
    extent.iter().flatten().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes.extend(wkb);
    bytes
}

fn add_table(connection: &Connection, name: &str, srs_id: i64, columns: &str) {
    connection
        .execute_batch(&format!(
            "CREATE TABLE \"{}\" (fid INTEGER PRIMARY KEY, geom BLOB{columns})",
            name.replace('"', "\"\"")
        ))
        .unwrap();
    connection
        .execute("INSERT INTO gpkg_contents VALUES (?1, 'features', 'My ' || ?1, '', ?2)", (name, srs_id))
        .unwrap();
    connection.execute("INSERT INTO gpkg_geometry_columns VALUES (?1, 'GEOM', 'POLYGON', ?2)", (name, srs_id)).unwrap();
}

/// Bytes of a database that is made by `fill`.
fn database(fill: impl FnOnce(&Connection)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gpkg");
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch(SCHEMA).unwrap();
    fill(&connection);
    connection.close().unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn tables_of_features() {
    let plan = [square(0.0, 0.0, 9.0), square(1.0, 1.0, 2.0)];
    let bytes = database(|connection| {
        add_table(
            connection,
            "pand \"x\"",
            28992,
            ", name TEXT, height REAL, n INTEGER, ok BOOLEAN, built DATE, raw BLOB",
        );
        let insert = "INSERT INTO \"pand \"\"x\"\"\" VALUES (?1, ?2, 'Ä', 12.5, 7, 1, '2001-02-03', x'00')";
        connection.execute(insert, (5, blob(&polygon_wkb(&plan, None), Some([0.0, 9.0, 0.0, 9.0])))).unwrap();
        connection.execute(insert, (6, blob(&polygon_wkb(&plan, None)[..30], None))).unwrap();
        connection.execute("INSERT INTO \"pand \"\"x\"\"\" (fid) VALUES (7)", ()).unwrap();
        add_table(connection, "wegdeel", 99, "");
        connection.execute("INSERT INTO gpkg_contents VALUES ('photos', 'tiles', '', '', 0)", ()).unwrap();
        connection.execute("INSERT INTO gpkg_geometry_columns VALUES ('lost', 'geom', 'POLYGON', 0)", ()).unwrap();
    });
    let sink = read(read_geopackage, &[("a b.gpkg", &bytes)]);
    assert_eq!(sink.objects.len(), 1);
    let object = &sink.objects[0];
    assert_eq!((object.id.as_str(), object.source_type.as_str()), ("pand \"x\".5", "pand \"x\""));
    assert_eq!(rings(&object.shape)[0].rings, plan);
    let expected = [
        ("name", text("Ä")),
        ("height", AttributeValue::Float(12.5)),
        ("n", AttributeValue::Integer(7)),
        ("ok", AttributeValue::Bool(true)),
        ("built", AttributeValue::Date { year: 2001, month: 2, day: 3 }),
    ];
    assert_eq!(object.attributes, attributes(&expected));
    assert_eq!(
        sink.skipped,
        [("malformed geometry", "pand \"x\".6".to_owned()), ("no geometry", "pand \"x\".7".to_owned())]
    );
    let names: Vec<&str> = sink.crs.iter().map(|crs| crs.name.as_str()).collect();
    assert_eq!(names, ["EPSG:28992", "PROJCS[\"b\"]"]);
    let problems: Vec<&str> = sink.problems.iter().map(|problem| problem.1.as_str()).collect();
    assert_eq!(problems, ["lost", "photos"]);
    assert_eq!(sink.described[0], (Description::Title, "My pand \"x\"".to_owned()));
}

#[test]
fn of_tables_of_levels_the_finest_is_read() {
    let tables = ["pand", "lod12_2d", "lod12_3d", "lod22_2d", "lod22_3d", "wegdeel", "lod1_bridges"];
    let bytes = database(|connection| {
        for (number, name) in (0..).zip(tables) {
            add_table(connection, name, 28992, ", identificatie TEXT");
            let plan = blob(&polygon_wkb(&[square(f64::from(number) * 20.0, 0.0, 9.0)], Some(3.0)), None);
            connection.execute(&format!("INSERT INTO {name} VALUES (1, ?1, 'a')"), (plan,)).unwrap();
        }
    });
    let sink = read(read_geopackage, &[("a.gpkg", &bytes)]);
    let types: Vec<&str> = sink.objects.iter().map(|object| object.source_type.as_str()).collect();
    assert_eq!(types, ["lod22_3d", "wegdeel", "lod1_bridges"]);
    let left_out: Vec<&str> =
        sink.problems.iter().filter(|(kind, _)| *kind == COARSER_TABLE).map(|(_, name)| name.as_str()).collect();
    assert_eq!(left_out, ["pand", "lod12_2d", "lod12_3d", "lod22_2d"]);
}

#[test]
fn texts_that_are_not_in_utf8_are_guessed() {
    let bytes = database(|connection| {
        add_table(connection, "first", 28992, ", name TEXT");
        let insert = "INSERT INTO first VALUES (1, ?1, CAST(x'c6e8ebeee920e4eeec20ede020f3ebe8f6e5' AS TEXT))";
        connection.execute(insert, (blob(&polygon_wkb(&[square(0.0, 0.0, 9.0)], None), None),)).unwrap();
    });
    let sink = read(read_geopackage, &[("a.gpkg", &bytes)]);
    assert_eq!(sink.objects[0].attributes, attributes(&[("name", text("Жилой дом на улице"))]));
    let [(kind, detail)] = &sink.problems[..] else { panic!("{:?}", sink.problems) };
    assert!(*kind == ENCODING_GUESSED && detail.contains("windows-1251"), "{detail}");
}

#[test]
fn changes_beside_a_database_are_named() {
    let bytes = database(|connection| add_table(connection, "first", 28992, ""));
    let sink = read(read_geopackage, &[("a.gpkg", &bytes), ("a.gpkg-wal", b"frames")]);
    let [(kind, detail)] = &sink.problems[..] else { panic!("{:?}", sink.problems) };
    assert!(*kind == UNSAVED && detail.starts_with("6 bytes in a.gpkg-wal; "), "{detail}");
    assert!(read(read_geopackage, &[("a.gpkg", &bytes), ("a.gpkg-wal", b"")]).problems.is_empty());
}

#[test]
fn newer_definitions_tell_systems_that_older_ones_cannot() {
    let bytes = database(|connection| {
        let newer = "ALTER TABLE gpkg_spatial_ref_sys ADD COLUMN definition_12_063 TEXT;
            INSERT INTO gpkg_spatial_ref_sys VALUES ('d', 7, 'NONE', 7, 'undefined', '', 'PROJCRS[\"d\"]'),
                ('e', 8, 'NONE', 8, 'PROJCS[\"e\"]', '', 'PROJCRS[\"e\"]');";
        connection.execute_batch(newer).unwrap();
        add_table(connection, "first", 7, "");
        add_table(connection, "second", 8, "");
    });
    let sink = read(read_geopackage, &[("a.gpkg", &bytes)]);
    let names: Vec<&str> = sink.crs.iter().map(|crs| crs.name.as_str()).collect();
    assert_eq!(names, ["PROJCRS[\"d\"]", "PROJCS[\"e\"]"]);
}

#[test]
fn views_and_virtual_tables_are_not_read() {
    let bytes = database(|connection| {
        add_table(connection, "real", 28992, "");
        let endless = "CREATE VIEW endless AS WITH RECURSIVE n(fid) AS (SELECT 1 UNION ALL SELECT fid + 1 FROM n)
            SELECT fid, x'47500001' AS geom FROM n;
            CREATE VIRTUAL TABLE tree USING rtree(fid, a, b);
            INSERT INTO gpkg_geometry_columns VALUES ('endless', 'geom', 'POLYGON', 28992), ('tree', 'a', 'POLYGON', 28992);";
        connection.execute_batch(endless).unwrap();
    });
    let sink = read(read_geopackage, &[("a.gpkg", &bytes)]);
    assert_eq!(sink.problems.len(), 2, "{:?}", sink.problems);
    let endless_list = database(|connection| {
        let list = "DROP TABLE gpkg_contents; CREATE VIEW gpkg_contents AS WITH RECURSIVE n(i) AS
            (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS table_name, '' AS data_type, '' AS identifier, '' AS description FROM n";
        connection.execute_batch(list).unwrap();
    });
    assert!(run(read_geopackage, &[("a.gpkg", &endless_list)], None).0.is_err());
}

/// Ten houses that a small file has many times: by the name of their table, and by tables with the pages of another one.
#[test]
fn tables_and_rows_that_share_pages_are_refused() {
    let house = || blob(&polygon_wkb(&[square(1.0, 1.0, 2.0)], None), None);
    let add_houses = |connection: &Connection, columns: &str| {
        add_table(connection, "a", 28992, columns);
        for _ in 0..10 {
            connection.execute("INSERT INTO a (geom) VALUES (?1)", (house(),)).unwrap();
        }
    };
    let named_again = database(|connection| {
        add_houses(connection, "");
        for name in ["a", "A"] {
            connection
                .execute("INSERT INTO gpkg_geometry_columns VALUES (?1, 'geom', 'POLYGON', 28992)", (name,))
                .unwrap();
        }
    });
    let sink = read(read_geopackage, &[("a.gpkg", &named_again)]);
    assert_eq!((sink.objects.len(), sink.problems.len()), (10, 2), "{:?}", sink.problems);
    let same_pages = database(|connection| {
        add_houses(connection, ", note TEXT");
        connection.execute("UPDATE a SET note = ?1", ("x".repeat(100_000),)).unwrap();
        for table in 0..100 {
            add_table(connection, &format!("b{table}"), 28992, ", note TEXT");
        }
        let share = "PRAGMA writable_schema = ON;
            UPDATE sqlite_schema SET rootpage = (SELECT rootpage FROM sqlite_schema WHERE name = 'a') WHERE name LIKE 'b%';
            PRAGMA writable_schema = OFF;";
        connection.execute_batch(share).unwrap();
    });
    let (result, sink) = run(read_geopackage, &[("a.gpkg", &same_pages)], None);
    assert!(result.unwrap_err().to_string().contains("more rows than fit"), "{} objects", sink.objects.len());
    assert!(sink.objects.len() < 500, "{}", sink.objects.len());
}

#[test]
fn extents_filter_without_reading_geometries() {
    let bytes = database(|connection| {
        connection.execute("INSERT INTO gpkg_spatial_ref_sys VALUES ('d', 4326, 'EPSG', 4326, '', '')", ()).unwrap();
        add_table(connection, "a", 4326, "");
        let far = blob(b"no geometry", Some([4.0, 5.0, 52.0, 53.0]));
        let near = blob(&polygon_wkb(&[square(10.0, 50.0, 1.0)], None), Some([10.0, 11.0, 50.0, 51.0]));
        let unbounded = blob(&polygon_wkb(&[square(4.0, 52.0, 1.0)], None), None);
        for blob in [far, near, unbounded] {
            connection.execute("INSERT INTO a (geom) VALUES (?1)", (blob,)).unwrap();
        }
    });
    let (result, sink) = run(read_geopackage, &[("a.gpkg", &bytes)], Some([9.0, 49.0, 12.0, 52.0]));
    result.unwrap();
    assert_eq!((sink.objects.len(), sink.skipped.len(), sink.objects[0].id.as_str()), (1, 0, "2"));
}

#[test]
fn damaged_databases_end_with_an_error() {
    let bytes = database(|connection| {
        add_table(connection, "a", 28992, ", n TEXT");
        for n in 0..200 {
            let geometry = blob(&polygon_wkb(&[square(f64::from(n), 0.0, 1.0)], None), None);
            connection.execute("INSERT INTO a (geom, n) VALUES (?1, 'x')", (geometry,)).unwrap();
        }
    });
    assert_eq!(read(read_geopackage, &[("a.gpkg", &bytes)]).objects.len(), 200);
    assert!(run(read_geopackage, &[("a.gpkg", b"SQLite format 3")], None).0.is_err());
    assert!(run(read_geopackage, &[("a.gpkg", b"")], None).0.is_err());
    attack(read_geopackage, &[("a.gpkg", &bytes)], 509, bytes.len() / 4);
    let zipped = insula_source::testing::gzip(&bytes);
    assert_eq!(read(read_geopackage, &[("a.gpkg.gz", &zipped)]).objects.len(), 200);
}
