//! Attributes, codelists and texts.

use super::*;
use insula_source::attributes::AttributeValue::{Date, Float, Integer, Text};
use insula_source::object::Description;

fn text(text: &str) -> insula_source::attributes::AttributeValue {
    Text(text.into())
}

#[test]
fn attributes_of_all_forms() {
    let sink = read_building(
        r#"<gml:name>Hôtel &amp; Bar &#228;</gml:name><core:creationDate>2020-02-29</core:creationDate>
        <bldg:function>1000</bldg:function><bldg:function>1010</bldg:function>
        <bldg:measuredHeight uom="urn:ogc:def:uom:UCUM::[ft_i]">10</bldg:measuredHeight><bldg:roofType/>
        <gen:stringAttribute name="Gemeinde schlüssel"><gen:value>05170004</gen:value></gen:stringAttribute>
        <gen:intAttribute name="n"><gen:value>7</gen:value></gen:intAttribute>
        <gen:measureAttribute name="area"><gen:value uom="m2">4.5</gen:value></gen:measureAttribute>
        <gen:genericAttributeSet name="set"><gen:dateAttribute name="d"><gen:value>2001-01-02</gen:value></gen:dateAttribute></gen:genericAttributeSet>
        <uro:buildingDetailAttribute><uro:BuildingDetailAttribute><uro:surveyYear>2016</uro:surveyYear></uro:BuildingDetailAttribute></uro:buildingDetailAttribute>
        <uro:buildingDetailAttribute><uro:BuildingDetailAttribute><uro:surveyYear>2017</uro:surveyYear></uro:BuildingDetailAttribute></uro:buildingDetailAttribute>
        <bldg:address><core:Address><core:xalAddress><xAL:AddressDetails><xAL:Country><xAL:CountryName>Japan</xAL:CountryName>
        <xAL:Locality Type="Town"><xAL:LocalityName>横須賀市</xAL:LocalityName><xAL:Thoroughfare><xAL:ThoroughfareName>Am Hang</xAL:ThoroughfareName>
        <xAL:ThoroughfareNumber>15</xAL:ThoroughfareNumber></xAL:Thoroughfare></xAL:Locality></xAL:Country></xAL:AddressDetails></core:xalAddress></core:Address></bldg:address>"#,
    );
    let expected = [
        ("name", text("Hôtel & Bar ä")),
        ("creationDate", Date { year: 2020, month: 2, day: 29 }),
        ("function", Integer(1000)),
        ("function.1", Integer(1010)),
        ("measuredHeight", Float(3.048)),
        ("Gemeinde schlüssel", text("05170004")),
        ("n", Integer(7)),
        ("area", Float(4.5)),
        ("area.uom", text("m2")),
        ("set.d", Date { year: 2001, month: 1, day: 2 }),
        ("buildingDetailAttribute.surveyYear", Integer(2016)),
        ("buildingDetailAttribute.1.surveyYear", Integer(2017)),
        ("address.country", text("Japan")),
        ("address.locality", text("横須賀市")),
        ("address.thoroughfare", text("Am Hang")),
        ("address.thoroughfareNumber", text("15")),
    ];
    let attributes: Vec<_> = sink.objects[0].attributes.iter().map(|(name, value)| (name, value.clone())).collect();
    assert_eq!(attributes, expected);
}

#[test]
fn attributes_of_version_3() {
    let text_3 = r#"<CityModel xmlns="http://www.opengis.net/citygml/3.0" xmlns:con="http://www.opengis.net/citygml/construction/3.0"
        xmlns:gen="http://www.opengis.net/citygml/generics/3.0" xmlns:b="http://www.opengis.net/citygml/building/3.0" xmlns:gml="http://www.opengis.net/gml/3.2">
        <cityObjectMember><b:Building><genericAttribute><gen:DoubleAttribute><gen:name>x</gen:name><gen:value>1</gen:value></gen:DoubleAttribute></genericAttribute>
        <con:height><con:Height><con:status>measured</con:status><con:value uom="m">8.5</con:value></con:Height></con:height></b:Building></cityObjectMember></CityModel>"#;
    let (sink, result) = read_bytes(text_3.as_bytes());
    result.unwrap();
    let attributes: Vec<_> = sink.objects[0].attributes.iter().map(|(name, value)| (name, value.clone())).collect();
    let expected = [
        ("x", Float(1.0)),
        ("height.status", text("measured")),
        ("height.value", Float(8.5)),
        ("measuredHeight", Float(8.5)),
    ];
    assert_eq!(attributes, expected);
    let (in_feet, _) = read_bytes(text_3.replace("uom=\"m\">8.5", "uom=\"ft\">10").as_bytes());
    assert_eq!(in_feet.objects[0].attributes.get("measuredHeight"), Some(&Float(3.048)));
}

#[test]
fn codes_become_names_by_their_codelist() {
    let list = "<gml:Dictionary xmlns:gml='http://www.opengis.net/gml'><gml:name>Building_usage</gml:name><gml:dictionaryEntry>\
        <gml:Definition><gml:description>住宅</gml:description><gml:name>411</gml:name></gml:Definition></gml:dictionaryEntry></gml:Dictionary>";
    let usage = |path: &str, code: u32| format!("<bldg:usage codeSpace='{path}'>{code}</bldg:usage>");
    let building = format!(
        "<bldg:Building>{}{}{}{}</bldg:Building>",
        usage("../../codelists/u.xml", 411),
        usage("../../codelists/u.xml", 412),
        usage("../../codelists/none.xml", 411),
        usage("http://www.sig3d.org/codelists/u.xml", 411),
    );
    let file = format!("{HEAD_2}{}{TAIL}", member(&building));
    let files = [("udx/bldg/a.gml", file.as_bytes()), ("codelists/u.xml", list.as_bytes())];
    let (sink, result) = read_files("udx/bldg/a.gml", &files);
    result.unwrap();
    let values: Vec<_> = sink.objects[0].attributes.iter().map(|(_, value)| value.clone()).collect();
    assert_eq!(values, [text("住宅"), text("412"), text("411"), text("411")]);
}

#[test]
fn title_and_encodings() {
    let file = "<?xml version='1.0' encoding='ISO-8859-1'?><CityModel xmlns='http://www.opengis.net/citygml/2.0' xmlns:gml='http://www.opengis.net/gml'>\
        <gml:name>Stra\u{DF}e</gml:name></CityModel>";
    let latin: Vec<u8> = file.chars().map(|c| c as u8).collect();
    let (sink, result) = read_bytes(&latin);
    result.unwrap();
    assert_eq!(sink.described, [(Description::Title, "Straße".into())]);
}
