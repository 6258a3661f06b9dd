"""CityGML 1.0, 2.0 and 3.0, as a tree in memory (lxml)."""
import gzip, pathlib, re, zipfile
from collections import defaultdict
import numpy as np
from lxml import etree
from .levels import choose
from .shapes import CityObject, triangulate

HREF = "{http://www.w3.org/1999/xlink}href"
POLYGONS = {"Polygon", "PolygonPatch", "Triangle", "Rectangle"}
KINDS = {
    "Building": "Building", "BuildingPart": "BuildingPart", "BuildingInstallation": "Building",
    "BuildingConstructiveElement": "Building", "Bridge": "Bridge", "BridgePart": "Bridge", "BridgeInstallation": "Bridge",
    "BridgeConstructionElement": "Bridge", "BridgeConstructiveElement": "Bridge", "Tunnel": "Tunnel", "TunnelPart": "Tunnel",
    "TunnelInstallation": "Tunnel", "TunnelConstructiveElement": "Tunnel", "Road": "Road", "Track": "Road", "Square": "Road",
    "TransportationComplex": "Road", "Railway": "Rail", "Waterway": "Water", "WaterBody": "Water",
    "SolitaryVegetationObject": "Vegetation", "PlantCover": "Vegetation", "LandUse": "LandUse", "CityFurniture": "Furniture",
    "TINRelief": "Relief", "GenericCityObject": "Generic", "GenericOccupiedSpace": "Generic",
    "GenericUnoccupiedSpace": "Generic", "GenericLogicalSpace": "Generic", "GenericThematicSurface": "Generic",
    "OtherConstruction": "Generic",
}
# Everything inside of a building, and spaces that are not built.
INTERIOR = {
    "Room", "BuildingRoom", "BuildingFurniture", "IntBuildingInstallation", "BridgeRoom", "BridgeFurniture",
    "IntBridgeInstallation", "HollowSpace", "TunnelFurniture", "IntTunnelInstallation", "InteriorWallSurface", "FloorSurface",
    "CeilingSurface", "BuildingUnit", "Storey",
}
# Objects that only hold others.
GROUPS = {"CityObjectGroup", "ReliefFeature"}
LEVEL = re.compile(r"lod([0-4])(.+)")
NO_SURFACES = ("TerrainIntersection", "MultiCurve", "PointCloud", "Network", "Point")


def local(element):
    return etree.QName(element).localname if isinstance(element.tag, str) else ""


def is_citygml(element):
    """Whether an element is of CityGML, or of the planning objects of PLATEAU."""
    space = etree.QName(element).namespace or "" if isinstance(element.tag, str) else ""
    return "citygml" in space or "iur/urf" in space


def open_tree(path):
    data = pathlib.Path(path).read_bytes()
    if path.lower().endswith(".gz"):
        data = gzip.decompress(data)
    return etree.fromstring(data, etree.XMLParser(huge_tree=True, recover=True, resolve_entities=False)), path


def trees(path):
    if not path.lower().endswith(".zip"):
        return [open_tree(path)]
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.lower().endswith((".gml", ".citygml"))]
        parser = lambda: etree.XMLParser(huge_tree=True, recover=True, resolve_entities=False)
        return [(etree.fromstring(archive.read(name), parser()), name) for name in names]


class Document:
    def __init__(self, root, target):
        self.root, self.target = root, target
        self.by_id = {}
        for element in root.iter(etree.Element):
            for name, value in element.attrib.items():
                if name == "id" or name.endswith("}id"):
                    self.by_id.setdefault(value, element)
        self.city_crs = next((e.get("srsName") for e in root.iter("{*}Envelope") if e.get("srsName")), None)
        # Nearest object of each feature, then its surfaces by level.
        self.surfaces = defaultdict(lambda: defaultdict(dict))
        self.objects, self.parents = {}, defaultdict(list)

    def linked(self, element):
        href = element.get(HREF)
        return self.by_id.get(href[1:]) if href and href.startswith("#") else None

    def inherited(self, element, name):
        while element is not None:
            if element.get(name):
                return element.get(name)
            element = element.getparent()
        return None

    def visit(self, element, owner, is_member=False):
        """Finds the geometries of `element` and of what is in it; `owner` is the nearest object."""
        name = local(element)
        if name in INTERIOR:
            return
        if (name in KINDS or is_member and name not in GROUPS) and is_citygml(element):
            ids = [value for key, value in element.attrib.items() if key.endswith("}id") or key == "id"]
            key = ids[0] if ids else f"{name} {len(self.objects)}"
            while key in self.objects:
                key += "'"
            self.objects[key] = element
            if owner is not None:
                self.parents[key].append(owner)
            owner = key
        for child in element:
            found = LEVEL.fullmatch(local(child))
            if owner is not None and is_citygml(child) and found:
                if not found[2].startswith(NO_SURFACES):
                    self.collect(child, self.surfaces[owner][int(found[1])])
            elif owner is not None and local(child) == "tin":
                self.collect(child, self.surfaces[owner][int(self.level_of(element))])
            elif local(child) not in ("boundedBy", "appearance", "appearanceMember") or len(child) and is_citygml(child):
                self.visit(child, owner)

    @staticmethod
    def level_of(element):
        return next((child.text for child in element if local(child) == "lod"), "1")

    def collect(self, element, found, matrix=None, crs_of=None, seen=()):
        """Adds all polygons of a geometry, each once, with the matrix of an implicit geometry."""
        name = local(element)
        if name in POLYGONS:
            place = None if matrix is None else matrix.tobytes()
            found[element, place] = (element, matrix, crs_of)
            return
        if name == "ImplicitGeometry":
            matrix, crs_of = self.matrix_of(element), element
        target = self.linked(element)
        if target is not None and target not in seen:
            self.collect(target, found, matrix, crs_of, (*seen, target))
        for child in element:
            if local(child) not in ("referencePoint", "transformationMatrix", "appearance"):
                self.collect(child, found, matrix, crs_of, seen)

    @staticmethod
    def matrix_of(element):
        matrix = np.eye(4)
        for child in element.iter("{*}transformationMatrix"):
            values = np.array((child.text or "").split(), dtype=float)
            if len(values) == 16:
                matrix = values.reshape(4, 4)
        for child in element.iter("{*}referencePoint"):
            texts = [pos.text or "" for pos in child.iter("{*}pos", "{*}coordinates")]
            point = np.array([float(v) for text in texts for v in re.split(r"[\s,]+", text.strip()) if v])
            # Some writers have the place twice.
            if len(point) == 3 and not np.allclose(matrix[:3, 3], point, atol=1e-3):
                matrix[:3, 3] += point
        return matrix

    def ring(self, element):
        values = []
        for part in element.iter("{*}posList", "{*}pos", "{*}coordinates"):
            numbers = np.array([float(v) for v in re.split(r"[\s,]+", (part.text or "").strip()) if v])
            size = int(self.inherited(part, "srsDimension") or 3)
            if len(numbers) % size:
                size = 5 - size
            points = numbers[:len(numbers) // size * size].reshape(-1, size)
            values.append(np.column_stack([points, np.zeros(len(points))])[:, :3] if size == 2 else points)
        return np.concatenate(values) if values else np.zeros((0, 3))

    def triangles(self, surface):
        polygon, matrix, crs_of = surface
        rings = [self.ring(ring) for ring in polygon.iter("{*}LinearRing", "{*}Ring")]
        crs = self.inherited(polygon if crs_of is None else crs_of, "srsName") or self.city_crs
        if matrix is not None:
            rings = [ring @ matrix[:3, :3].T + matrix[:3, 3] for ring in rings]
        return triangulate([self.target.place(ring, crs, authority_order=True) for ring in rings])

    def read(self):
        for member in self.root.iter("{*}cityObjectMember", "{*}featureMember", "{*}groupMember", "{*}reliefComponent"):
            if local(member) == "reliefComponent" or member.getparent() is None:
                continue
            for feature in member:
                self.visit(feature, None, is_member=True)
        levels = {key: {level: found for level, found in of.items() if found} for key, of in self.surfaces.items()}
        best = {key: max(of) for key, of in levels.items() if of}
        out = choose(best, self.parents, lambda key: local(self.objects[key]).endswith("Part"))
        # Beams and columns are hidden in most buildings: they are drawn only where there is nothing else.
        out |= {key for key in best if local(self.objects[key]) == "BuildingConstructiveElement"
                and any(above in best for above in self.parents[key])}
        for key, level in best.items():
            if key in out:
                continue
            made = CityObject(key, KINDS.get(local(self.objects[key]), "Generic"), lod=level)
            made.triangles = [t for t in map(self.triangles, levels[key][level].values()) if len(t)]
            if made.triangles:
                yield made


def read(path, target, options):
    for root, _ in trees(path):
        yield from Document(root, target).read()
