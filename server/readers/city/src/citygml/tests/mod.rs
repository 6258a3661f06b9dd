//! Tests of the whole reader with small files.

mod appearances;
mod attributes;
mod geometry;
mod hostile;

use super::read;
use insula_source::error::InputError;
use insula_source::files::EmbeddedFiles;
use insula_source::input::Input;
use insula_source::object::{Shape, SourceObject, Surface};
use insula_source::problems::ENCODING_GUESSED;
use insula_source::testing::{TestSink, gzip};

/// Start of a file of CityGML 2.0, up to its objects.
const HEAD_2: &str = r##"<?xml version="1.0" encoding="UTF-8"?>
<core:CityModel xmlns:core="http://www.opengis.net/citygml/2.0" xmlns:bldg="http://www.opengis.net/citygml/building/2.0"
 xmlns:gen="http://www.opengis.net/citygml/generics/2.0" xmlns:app="http://www.opengis.net/citygml/appearance/2.0"
 xmlns:gml="http://www.opengis.net/gml" xmlns:dem="http://www.opengis.net/citygml/relief/2.0"
 xmlns:tran="http://www.opengis.net/citygml/transportation/2.0" xmlns:veg="http://www.opengis.net/citygml/vegetation/2.0"
 xmlns:grp="http://www.opengis.net/citygml/cityobjectgroup/2.0" xmlns:uro="https://www.geospatial.jp/iur/uro/2.0"
 xmlns:urf="https://www.geospatial.jp/iur/urf/2.0" xmlns:xAL="urn:oasis:names:tc:ciq:xsdschema:xAL:2.0"
 xmlns:xlink="http://www.w3.org/1999/xlink">"##;
const TAIL: &str = "</core:CityModel>";

fn read_files(name: &str, files: &[(&str, &[u8])]) -> (TestSink, Result<(), InputError>) {
    let files = EmbeddedFiles { files };
    let input = Input::new(name, name, &files, 1 << 30);
    let mut sink = TestSink::default();
    let result = read(&input, &mut sink);
    (sink, result)
}

fn read_bytes(bytes: &[u8]) -> (TestSink, Result<(), InputError>) {
    read_files("a.gml", &[("a.gml", bytes)])
}

/// Reads the members of a model of CityGML 2.0.
fn read_2(members: &str) -> TestSink {
    let (sink, result) = read_bytes(format!("{HEAD_2}{members}{TAIL}").as_bytes());
    result.unwrap();
    sink
}

/// Reads the content of one building of CityGML 2.0.
fn read_building(content: &str) -> TestSink {
    read_2(&member(&format!(r#"<bldg:Building gml:id="b">{content}</bldg:Building>"#)))
}

fn building(id: &str, geometry: &str) -> String {
    member(&format!(
        "<bldg:Building gml:id='{id}'><bldg:lod2MultiSurface>{geometry}</bldg:lod2MultiSurface></bldg:Building>"
    ))
}

fn member(object: &str) -> String {
    format!("<core:cityObjectMember>{object}</core:cityObjectMember>")
}

/// A polygon whose first corner is at x = `x`.
fn polygon(id: &str, x: u32) -> String {
    let ring = format!("{x} 0 0 {} 0 0 {} 1 0 {x} 0 0", x + 1, x + 1);
    format!(
        r#"<gml:Polygon gml:id="{id}"><gml:exterior><gml:LinearRing gml:id="{id}_r"><gml:posList>{ring}</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon>"#
    )
}

fn surface_members(members: &[String]) -> String {
    members.iter().map(|member| format!("<gml:surfaceMember>{member}</gml:surfaceMember>")).collect()
}

fn multi_surface(members: &[String]) -> String {
    format!("<gml:MultiSurface>{}</gml:MultiSurface>", surface_members(members))
}

fn solid(members: &[String]) -> String {
    let surfaces = surface_members(members);
    format!(
        "<gml:Solid><gml:exterior><gml:CompositeSurface>{surfaces}</gml:CompositeSurface></gml:exterior></gml:Solid>"
    )
}

/// A solid made of references.
fn solid_of(ids: &[&str]) -> String {
    let members: String = ids.iter().map(|id| format!(r##"<gml:surfaceMember xlink:href="#{id}"/>"##)).collect();
    format!(
        "<gml:Solid><gml:exterior><gml:CompositeSurface>{members}</gml:CompositeSurface></gml:exterior></gml:Solid>"
    )
}

fn bounded_by(surface: &str, geometry: &str) -> String {
    format!(
        "<bldg:boundedBy><bldg:{surface}><bldg:lod2MultiSurface>{geometry}</bldg:lod2MultiSurface></bldg:{surface}></bldg:boundedBy>"
    )
}

fn polygons(object: &SourceObject) -> &[Surface] {
    match &object.shape {
        Shape::Surfaces { polygons, .. } => polygons,
        _ => &[],
    }
}

/// The x of the first corner of each polygon, sorted.
fn corners(object: &SourceObject) -> Vec<f64> {
    let mut corners: Vec<_> = polygons(object).iter().map(|surface| surface.points[0][0]).collect();
    corners.sort_by(f64::total_cmp);
    corners
}

#[test]
fn texts_that_are_not_in_utf8_as_declared_are_guessed() {
    let object = member("<bldg:Building gml:id='b'><bldg:class>Stra\u{df}e in K\u{f6}ln</bldg:class></bldg:Building>");
    // Letters of Latin-1 have the numbers of Unicode.
    let bytes: Vec<u8> = format!("{HEAD_2}{object}{TAIL}").chars().map(|letter| letter as u8).collect();
    let (sink, result) = read_bytes(&bytes);
    result.unwrap();
    assert_eq!(sink.objects[0].attributes.get("class").map(ToString::to_string).as_deref(), Some("Straße in Köln"));
    assert!(sink.problems.iter().any(|(kind, _)| *kind == ENCODING_GUESSED), "{:?}", sink.problems);
}

#[test]
fn reads_gzip_and_reports_progress() {
    let text = format!(
        "{HEAD_2}{}{TAIL}",
        member(&format!(
            "<bldg:Building><bldg:lod1Solid>{}</bldg:lod1Solid></bldg:Building>",
            solid(&[polygon("p", 3)])
        ))
    );
    let (sink, result) = read_files("a.gml.gz", &[("a.gml.gz", &gzip(text.as_bytes()))]);
    result.unwrap();
    assert_eq!(sink.objects.len(), 1);
    assert_eq!(sink.objects[0].id, "Building 1");
    assert!(sink.bytes_done > 0);
}
