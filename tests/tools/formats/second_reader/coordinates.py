"""Coordinates of a source in the city's coordinate system, by pyproj, and geoid grids, by rasterio.

Heights of the city are those above the geoid. Heights of a source are kept, unless they are above the ellipsoid.
"""
import functools, json, re
import numpy as np
import pyproj
import rasterio

ECEF = "EPSG:4978"
# Names of the surveying agencies of Germany (AdV): the number of the UTM zone or of the Gauss-Krueger strip.
ADV = re.compile(r"urn:adv:crs:(ETRS89_UTM|DE_DHDN_3GK)(\d+)", re.I)


class Geoid:
    """Height of the geoid above the ellipsoid, bilinear between the points of a GeoTIFF grid."""

    def __init__(self, path):
        with rasterio.open(path) as grid:
            self.values = grid.read(1).astype(float)
            self.values[self.values == grid.nodata] = np.nan
            self.columns_of = ~grid.transform
            self.west, self.east = grid.bounds.left, grid.bounds.right

    def __call__(self, lon, lat):
        lon = np.asarray(lon, dtype=float)
        turns = np.where(lon < self.west, 360.0, np.where(lon > self.east, -360.0, 0.0))
        column, row = self.columns_of * (lon + turns, np.asarray(lat, dtype=float))
        # The grid's points are in the middle of its pixels.
        column, row = column - 0.5, row - 0.5
        height, width = self.values.shape
        x0 = np.floor(column).astype(int)
        y0 = np.clip(np.floor(row).astype(int), 0, height - 2)
        if (x0 < -1).any() or (x0 > width - 1).any():
            raise ValueError("a position is outside of the geoid grid")
        fx, fy = column - x0, row - y0
        # A grid around the Earth continues at its other side.
        left, right = x0 % width, (x0 + 1) % width
        top = self.values[y0, left] * (1 - fx) + self.values[y0, right] * fx
        low = self.values[y0 + 1, left] * (1 - fx) + self.values[y0 + 1, right] * fx
        return top * (1 - fy) + low * fy


@functools.lru_cache
def parse_crs(name):
    """The system that a name means: EPSG:n, URN, URL, WKT, PROJJSON or a name of the AdV."""
    text = name.strip()
    found = ADV.match(text)
    if found:
        of_strip = {"2": 31466, "3": 31467, "4": 31468, "5": 31469}
        is_utm = found[1].upper() == "ETRS89_UTM"
        return pyproj.CRS.from_epsg(25800 + int(found[2]) if is_utm else of_strip[found[2][0]])
    if text.startswith("{"):
        return pyproj.CRS.from_json_dict(json.loads(text))
    if re.match(r"[A-Z_0-9]+\[", text):
        return pyproj.CRS.from_wkt(text)
    codes = re.findall(r"(?:EPSG|epsg)(?::|/|#|\.xml#)+(?:[\d.]+(?::|/))?:*(\d{4,6})", text)
    if "CRS84" in text and not codes:
        return pyproj.CRS.from_epsg(4326)
    if not codes:
        return pyproj.CRS.from_user_input(text)
    return pyproj.CRS.from_epsg(int(codes[0]))


def horizontal(crs):
    """The part of a system that places points on the map."""
    if crs.is_compound:
        return crs.sub_crs_list[0]
    return crs.to_2d() if crs.is_geographic else crs


def is_ellipsoidal(crs):
    """Whether heights are above the ellipsoid: a geographic system with three axes."""
    return crs.is_geographic and not crs.is_compound and len(crs.axis_info) == 3


def is_north_first(crs):
    """Whether the registry's first axis is the northing or the latitude."""
    axes = horizontal(crs).axis_info
    return bool(axes) and axes[0].direction in ("north", "south")


class Target:
    """The coordinate system of the city, in metres, with the geoid that ellipsoidal heights need."""

    def __init__(self, name, geoid_path=None):
        self.crs = horizontal(parse_crs(name))
        self.geoid = Geoid(geoid_path) if geoid_path else None
        self.sources = {}

    def source(self, name):
        """What is needed of a source's system: whether its first axis is the northing, whether its heights are above the
        ellipsoid, and the transformer to the city's; `None` if its map is the city's."""
        if name not in self.sources:
            crs = parse_crs(name)
            flat = horizontal(crs)
            moves = None if flat == self.crs else pyproj.Transformer.from_crs(flat, self.crs, always_xy=True)
            # The agencies of Germany write the easting first, whatever the registry says.
            self.sources[name] = is_north_first(crs) and not ADV.match(name), is_ellipsoidal(crs), moves
        return self.sources[name]

    def place(self, points, name, authority_order=False):
        """World positions of (n, 3) source positions in the system `name`; `None` for a system that is the city's."""
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        if name is None or not len(points):
            return points
        if name == "ECEF":
            return self.from_ecef(points)
        north_first, ellipsoidal, moves = self.source(name)
        x, y, z = points.T
        if authority_order and north_first:
            x, y = y, x
        if ellipsoidal:
            return self.from_degrees(x, y, z)
        if moves:
            x, y = moves.transform(x, y)
        return np.stack([x, y, z], axis=1)

    def from_ecef(self, points):
        if ECEF not in self.sources:
            self.sources[ECEF] = pyproj.Transformer.from_crs(ECEF, "EPSG:4979", always_xy=True)
        to_degrees = self.sources[ECEF]
        return self.from_degrees(*to_degrees.transform(*points.T))

    def from_degrees(self, lon, lat, ellipsoidal_m):
        """World positions of degrees of WGS84 with heights above the ellipsoid."""
        if self.geoid is None:
            raise ValueError("the source has heights above the ellipsoid: --geoid GRID.tif is needed")
        x, y = self.source("EPSG:4326")[2].transform(lon, lat)
        return np.stack([x, y, ellipsoidal_m - self.geoid(lon, lat)], axis=1)
