//! Colours and textures.

use super::*;
use insula_source::object::{SourceImage, SourceMaterial, SourceTexture, Wrap};
use insula_source::problems::{TEXTURE_NOT_MAPPED, TEXTURE_ON_THE_WEB};

const TEXTURE: &str = r##"<app:appearanceMember><app:Appearance><app:theme>photo</app:theme><app:surfaceDataMember>
<app:ParameterizedTexture><app:imageURI>a%20b\c.jpg</app:imageURI><app:wrapMode>clamp</app:wrapMode><app:target uri="#p1"><app:TexCoordList>
<app:textureCoordinates ring="#p1_r">0 0 1 0 1 0.5 0 0</app:textureCoordinates></app:TexCoordList></app:target></app:ParameterizedTexture>
</app:surfaceDataMember></app:Appearance></app:appearanceMember>"##;

fn texture() -> SourceMaterial {
    let texture = SourceTexture { image: SourceImage::File("a b/c.jpg".into()), wrap: Wrap::Clamp };
    SourceMaterial { texture: Some(texture), ..SourceMaterial::default() }
}

#[test]
fn texture_after_the_objects() {
    let geometry = multi_surface(&[polygon("p1", 1), polygon("p2", 2)]);
    let sink = read_2(&(building("b", &geometry) + TEXTURE));
    let [textured, plain] = polygons(&sink.objects[0]) else { panic!("{:?}", sink.objects) };
    assert_eq!((textured.material, &textured.uv[..]), (Some(0), &[[0.0, 0.0], [1.0, 0.0], [1.0, 0.5]][..]));
    assert_eq!((plain.material, plain.uv.len()), (None, 0));
    assert_eq!(sink.materials, [texture()]);
}

#[test]
fn texture_of_version_3_and_of_a_triangle() {
    let texture = TEXTURE
        .replace("surfaceDataMember", "surfaceData")
        .replace(r##"<app:target uri="#p1">"##, "<app:textureParameterization><app:TextureAssociation><app:target>#p1</app:target><app:textureParameterization>")
        .replace(r##" ring="#p1_r""##, "")
        .replace("</app:textureCoordinates>", "</app:textureCoordinates><app:ring>#p1_r</app:ring>")
        .replace("</app:TexCoordList></app:target>", "</app:TexCoordList></app:textureParameterization></app:TextureAssociation></app:textureParameterization>");
    let triangle = polygon("p1", 1).replace("Polygon", "Triangle");
    let tin = format!(
        "<gml:TriangulatedSurface><gml:trianglePatches>{triangle}</gml:trianglePatches></gml:TriangulatedSurface>"
    );
    let sink = read_2(&(building("b", &tin) + &texture));
    assert_eq!(polygons(&sink.objects[0])[0].uv.len(), 3, "{:?} {:?}", sink.objects, sink.problems);
}

#[test]
fn material_of_a_surface_and_of_its_parent() {
    let material = |content: &str, target: &str| {
        format!(
            "<app:surfaceDataMember><app:X3DMaterial>{content}<app:target>#{target}</app:target></app:X3DMaterial></app:surfaceDataMember>"
        )
    };
    let appearance = format!(
        "<app:appearance><app:Appearance>{}{}{}</app:Appearance></app:appearance>",
        material("<app:diffuseColor>1 0 0</app:diffuseColor><app:transparency>0.25</app:transparency>", "m"),
        material("<app:diffuseColor>0 1 0</app:diffuseColor>", "p2"),
        material("<app:isFront>false</app:isFront><app:diffuseColor>0 0 1</app:diffuseColor>", "p1"),
    );
    let geometry = multi_surface(&[polygon("p1", 1), polygon("p2", 2)])
        .replacen("<gml:MultiSurface>", "<gml:MultiSurface gml:id='m'>", 1);
    let members = building("b", &geometry).replacen("<bldg:lod2", &format!("{appearance}<bldg:lod2"), 1);
    let sink = read_2(&members);
    let colours: Vec<_> = polygons(&sink.objects[0])
        .iter()
        .map(|surface| sink.materials[surface.material.unwrap() as usize].rgb)
        .collect();
    assert_eq!(colours, [Some([255, 0, 0]), Some([0, 255, 0])]);
    assert_eq!(sink.materials[0].opacity, 0.75);
}

#[test]
fn misfits_are_problems_and_leave_the_surface() {
    let short = TEXTURE.replace("0 0 1 0 1 0.5 0 0", "0 0 1 0");
    let sink = read_2(&(building("b", &multi_surface(&[polygon("p1", 1)])) + &short));
    assert_eq!((polygons(&sink.objects[0])[0].material, polygons(&sink.objects[0])[0].uv.len()), (None, 0));
    assert_eq!(sink.problems, [("texture coordinates do not fit the ring", "b".into())]);
    let matrix = TEXTURE.replace("TexCoordList", "TexCoordGen");
    let sink = read_2(&(building("b", &multi_surface(&[polygon("p1", 1)])) + &matrix));
    assert_eq!(sink.problems, [(TEXTURE_NOT_MAPPED, "a%20b\\c.jpg: texture coordinates by a matrix".into())]);
    let placed = TEXTURE.replace("ParameterizedTexture", "GeoreferencedTexture");
    let on_the_web = TEXTURE.replace("a%20b\\c.jpg", "https://example.org/a.jpg");
    for (texture, kind) in [(placed, TEXTURE_NOT_MAPPED), (on_the_web, TEXTURE_ON_THE_WEB)] {
        let sink = read_2(&(building("b", &multi_surface(&[polygon("p1", 1)])) + &texture));
        assert_eq!(sink.problems.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [kind]);
    }
}
