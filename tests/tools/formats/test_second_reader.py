"""The second reader on small shapes whose triangles are known: python3 -m unittest discover tests/tools/formats"""
import json, pathlib, sys, tempfile, types, unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
try:
    import numpy as np
    from second_reader import citygml, cityjson, footprints, gltf, levels, shapes, tiles3d, vectors
    from second_reader.coordinates import Target, parse_crs
    from place import glb
    MISSING = None
except ModuleNotFoundError as error:
    MISSING = str(error)

OPTIONS = types.SimpleNamespace(at=None, up="z", source_crs=None, height_field=None)
SQUARE = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]
GML = """<core:CityModel xmlns:core="http://www.opengis.net/citygml/2.0" xmlns:bldg="http://www.opengis.net/citygml/building/2.0"
 xmlns:gml="http://www.opengis.net/gml" xmlns:xlink="http://www.w3.org/1999/xlink">
 <gml:boundedBy><gml:Envelope srsName="EPSG:25832"/></gml:boundedBy>
 <core:cityObjectMember><bldg:Building gml:id="b">
 <bldg:lod1Solid><gml:Solid><gml:exterior><gml:CompositeSurface><gml:surfaceMember><gml:Polygon><gml:exterior><gml:LinearRing>
 <gml:posList>0 0 9 1 0 9 1 1 9 0 0 9</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon></gml:surfaceMember>
 </gml:CompositeSurface></gml:exterior></gml:Solid></bldg:lod1Solid>
 <bldg:lod2Solid><gml:Solid><gml:exterior><gml:CompositeSurface><gml:surfaceMember xlink:href="#p"/></gml:CompositeSurface>
 </gml:exterior></gml:Solid></bldg:lod2Solid>
 <bldg:boundedBy><bldg:RoofSurface><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember>
 <gml:Polygon gml:id="p"><gml:exterior><gml:LinearRing><gml:posList>0 0 5 4 0 5 4 3 5 0 3 5 0 0 5</gml:posList></gml:LinearRing>
 </gml:exterior></gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:RoofSurface></bldg:boundedBy>
 </bldg:Building></core:cityObjectMember></core:CityModel>"""


def area(triangles):
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def volume(triangles):
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


@unittest.skipIf(MISSING, MISSING)
class SecondReader(unittest.TestCase):
    def read(self, reader, name, text, crs="EPSG:25832"):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, name)
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
            return list(reader.read(str(path), Target(crs), OPTIONS))

    def test_a_polygon_with_a_hole_has_the_area_of_both(self):
        wall = lambda ring: np.array([[0.0, x, y] for x, y in ring])
        hole = [[2, 2], [2, 4], [4, 4], [4, 2]]
        self.assertAlmostEqual(area(shapes.triangulate([wall(SQUARE), wall(hole)])), 96.0)
        self.assertEqual(len(shapes.triangulate([wall([[0, 0], [1, 1], [2, 2]])])), 0)

    def test_a_prism_is_closed_and_outward(self):
        rings = footprints.plan([SQUARE[::-1], [[2, 2], [4, 2], [4, 4], [2, 4], [2, 2]]])
        self.assertAlmostEqual(volume(footprints.prism(rings, 3.0, 8.0)), 480.0)

    def test_heights_follow_the_readme(self):
        for attributes, expected in [
            ({"height": "12,5 m"}, (0.0, 12.5)), ({"height": "40 ft", "min_height": 2}, (2.0, 12.192)),
            ({"height": 0, "levels": 2}, (0.0, 6.0)),
            ({"building:levels": "4", "roof:levels": 1, "min_level": 1}, (3.0, 15.0)),
            ({"min_height": 10}, (10.0, 16.0)), ({"height": 5, "min_height": 5}, (0.0, 5.0)), ({"height": "5-7"}, (0.0, 6.0)),
        ]:
            made = footprints.base_and_top(attributes)
            self.assertTrue(np.allclose(made, expected), f"{attributes}: {made}")

    def test_water_is_level_and_a_building_is_not_water(self):
        self.assertTrue(footprints.is_water({"natural": "water"}))
        self.assertFalse(footprints.is_water({"natural": "water", "building": "yes"}))
        self.assertFalse(footprints.is_water({"water": "no"}))

    def test_the_best_level_is_read_once_although_it_is_linked(self):
        made = self.read(citygml, "a.gml", GML)
        self.assertEqual([(item.id, item.lod) for item in made], [("b", 2)])
        self.assertAlmostEqual(area(made[0].all_triangles()), 12.0)

    def test_parts_replace_a_coarser_building_and_chimneys_do_not(self):
        chosen = lambda part: levels.choose({"b": 1, "p": 2}, {"p": ["b"]}, lambda name: part)
        self.assertEqual((chosen(True), chosen(False)), ({"b"}, set()))
        self.assertEqual(levels.choose({"b": 0, "p": 2}, {"p": ["b"]}, lambda name: False), {"b"})

    def test_cityjson_is_scaled_and_moved(self):
        geometry = {"type": "MultiSurface", "lod": "1", "boundaries": [[[0, 1, 2]]]}
        document = {
            "type": "CityJSON", "version": "2.0", "transform": {"scale": [0.5] * 3, "translate": [100, 200, 300]},
            "CityObjects": {"a": {"type": "Building", "geometry": [geometry]}},
            "vertices": [[0, 0, 0], [2, 0, 0], [0, 2, 4]],
        }
        made = self.read(cityjson, "a.city.json", json.dumps(document))
        self.assertEqual(made[0].all_triangles().max(axis=(0, 1)).tolist(), [101.0, 201.0, 302.0])

    def test_glb_is_turned_so_that_z_is_up(self):
        positions = np.array([[0, 0, 0], [1, 0, 0], [0, 5, -2]], dtype="<f4")
        (_, triangles), = gltf.Gltf(glb(positions), None).meshes()
        self.assertEqual(triangles[0].tolist(), [[0, 0, 0], [1, 0, 0], [0, 2, 5]])

    def test_names_of_systems_are_understood(self):
        for name, code in [("EPSG:7415", 7415), ("urn:ogc:def:crs:EPSG::25832", 25832),
                           ("urn:ogc:def:crs:EPSG:6.12:3068", 3068), ("http://www.opengis.net/def/crs/EPSG/0/6697", 6697),
                           ("urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH", 25832),
                           ("urn:ogc:def:crs,crs:EPSG:6.12:3068,crs:EPSG:6.12:5783", 3068),
                           ("http://www.opengis.net/gml/srs/epsg.xml#4326", 4326), ("urn:ogc:def:crs:OGC:1.3:CRS84", 4326)]:
            self.assertEqual(parse_crs(name).to_epsg(), code, name)

    def test_latitude_is_first_where_the_registry_says_so(self):
        target = Target("EPSG:32632")
        gml, wkb = (target.place([at], "EPSG:4326", order)[0] for at, order in (([50, 9, 7], True), ([9, 50, 7], False)))
        self.assertTrue(np.allclose(gml, wkb) and abs(wkb[0] - 500000) < 1e-6 and wkb[2] == 7, f"{gml} {wkb}")

    def test_octahedral_vectors_have_unit_length(self):
        up = tiles3d.octahedron(np.array([[32768, 32768], [65535, 32768], [32768, 0]], dtype=np.uint16))
        self.assertTrue(np.allclose(up, [[0, 0, 1], [1, 0, 0], [0, -1, 0]], atol=1e-4), up)

    def test_polygons_that_are_not_level_are_surfaces(self):
        flat, slope = [[np.array([[x, y, z * k] for (x, y), z in zip(SQUARE, range(5))])] for k in (0.0, 1.0)]
        self.assertEqual([vectors.is_in_space([rings], {}) for rings in (flat, slope)], [False, True])
        self.assertFalse(vectors.is_in_space([slope], {"height": 4}))


if __name__ == "__main__":
    unittest.main()
