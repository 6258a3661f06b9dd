"""The package with the programs, on a part of the bundled map of Monaco. Without the programs, the tests are skipped."""

import os
import tempfile
import unittest
import urllib.request
import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import insula
from insula._programs import find

MAP = Path(__file__).resolve().parents[2] / "demo" / "monaco" / "monaco.osm.pbf"
BBOX = (7.4195, 43.7305, 7.4225, 43.7325)
SIZE = (160, 90)


def has_programs() -> bool:
    try:
        return all(map(find, ("insula", "insula-server")))
    except insula.Error:
        return False


def needs(*modules: str):
    missing = [module for module in modules if find_spec(module) is None]
    return unittest.skipIf(missing, f"{', '.join(missing)} is not installed")


@unittest.skipUnless(has_programs(), "the programs are absent: INSULA_PROGRAMS_DIR names their folder")
class Monaco(unittest.TestCase):
    city: insula.City

    @classmethod
    def setUpClass(cls):
        os.environ.setdefault("INSULA_ADAPTER", "cpu")
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            cls.city = insula.bake(MAP, cls.folder / "monaco", bbox=BBOX, cell=3, title="Old Monaco", views=32)

    def test_a_city_says_what_it_is(self):
        self.assertEqual((self.city.name, self.city.title, self.city.cell_m), ("monaco", "Old Monaco", 3))
        self.assertTrue(self.city.crs.startswith("EPSG:"), self.city.crs)
        low, high = self.city.bounds
        self.assertTrue(all(a < b for a, b in zip(low, high)))
        self.assertIn("OpenStreetMap", self.city.attribution[0]["text"])
        self.assertIn("name", [attribute["name"] for attribute in self.city.attributes()])

    def test_what_is_no_city_is_an_error(self):
        with self.assertRaisesRegex(insula.Error, "no baked city"):
            insula.open(self.folder)
        with self.assertRaisesRegex(insula.Error, "--rule"):
            self.city.sun_hours("nowhere")

    def test_objects_are_records(self):
        rows = self.city.objects("records", filter="kind == 'building'")
        self.assertGreater(len(rows), 10)
        self.assertEqual({row["kind"] for row in rows}, {"building"})
        self.assertEqual(rows[0]["geometry"]["type"][-7:], "Polygon")
        known = self.city.describe([rows[0]["object"], rows[1]["object"]])
        self.assertEqual([row["identifier"] for row in rows[:2]], [row["identifier"] for row in known])

    @needs("geopandas", "pyarrow")
    def test_objects_are_frames_in_metres(self):
        frame = self.city.objects()
        self.assertEqual(frame.crs.to_epsg(), int(self.city.crs.removeprefix("EPSG:")))
        west, south, east, north = frame.total_bounds
        (x0, y0, _), (x1, y1, _) = self.city.bounds
        self.assertTrue(x0 - 1 <= west < east <= x1 + 1 and y0 - 1 <= south < north <= y1 + 1)
        table = self.city.objects("arrow")
        self.assertEqual(table.num_rows, len(frame))

    def earlier(self) -> Path:
        """A release without the houses north of a line, as a folder."""
        folder = self.folder / "earlier"
        if not folder.exists():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                insula.bake(MAP, folder, bbox=(*BBOX[:3], 43.7315), cell=3, views=32)
        return folder

    def test_changes_are_records(self):
        rows = insula.changes(self.earlier(), self.city, "records")
        built = [row for row in rows if row["change"] == "built"]
        self.assertGreater(len(built), 10)
        known = {row["object"]: row["identifier"] for row in self.city.objects("records", filter="kind == 'building'")}
        self.assertTrue(all(known[row["object_after"]] == row["identifier_after"] for row in built))
        self.assertEqual(built[0]["geometry"]["type"][-7:], "Polygon")
        self.assertGreater(len(insula.changes(self.earlier(), self.city, "records", all=True)), len(rows))
        with self.assertRaisesRegex(insula.Error, "--attribute nothing"):
            insula.changes(self.earlier(), self.city, attribute="nothing")

    @needs("geopandas", "pyarrow")
    def test_changes_are_frames_in_metres(self):
        frame = insula.changes(self.city, self.earlier(), bbox_metres=self.area())
        self.assertEqual(frame.crs.to_epsg(), int(self.city.crs.removeprefix("EPSG:")))
        self.assertIn("demolished", set(frame.change))

    def area(self) -> tuple[float, float, float, float]:
        """The northern half of the city."""
        (west, south, _), (east, north, _) = self.city.bounds
        return west, (south + north) / 2, east, north

    def test_a_picture_has_distances_and_objects(self):
        picture = self.city.render(size=SIZE, distance=True, objects=True)
        self.assertEqual((picture.shape, picture.distance.shape, picture.objects.shape), ((90, 160, 3), (90, 160), (90, 160)))
        self.assertGreater(len(np.unique(picture.reshape(-1, 3), axis=0)), 50)
        hit = picture.objects != insula.NO_OBJECT
        self.assertTrue(np.isfinite(picture.distance[hit]).all())
        self.assertEqual(picture.seen[0]["pixels"], (picture.objects == picture.seen[0]["id"]).sum())

    def test_cameras_are_texts_files_and_places(self):
        (x0, y0, _), (x1, y1, z1) = self.city.bounds
        middle = [(x0 + x1) / 2, (y0 + y1) / 2]
        text = f"camera={middle[0]},{middle[1]},{z1 + 300},0,-90,60"
        down = self.city.render(text, size=SIZE, distance=True)
        camera = {"position": [*middle, z1 + 300], "target": [*middle, z1], "up": [0, 1, 0], "fov_y_deg": 60}
        same = self.city.render(camera, size=SIZE, distance=True)
        near = np.isfinite(down.distance) & np.isfinite(same.distance)
        self.assertLess(np.abs(down.distance[near] - same.distance[near]).mean(), 1)
        self.assertGreater(near.mean(), 0.5)
        typed = self.city.render("7.421,43.732,400,0,-90", size=SIZE, distance=True)
        self.assertGreater(np.isfinite(typed.distance).mean(), 0.5)
        street = self.city.render(at_street=(7.421, 43.7315, 90), size=SIZE, time="2024-06-21T17:00", look="paper")
        self.assertEqual(street.shape, (90, 160, 3))

    def test_heights_are_a_raster(self):
        path = self.folder / "heights.tif"
        raster = self.city.heights(out=path)
        self.assertEqual((raster.cell_m, raster.crs, raster.array.dtype), (3, self.city.crs, np.float32))
        west, south, east, north = raster.bounds
        (x0, y0, z0), (x1, y1, z1) = self.city.bounds
        self.assertTrue(west < x1 and x0 < east and south < y1 and y0 < north)
        values = raster.values
        self.assertTrue(z0 - 5 <= np.nanmin(values) and np.nanmax(values) <= z1 + 5)
        self.assertIn("OpenStreetMap", raster.attribution)
        part = self.city.heights(bbox_metres=(west + 30, south + 30, west + 90, south + 60))
        self.assertEqual(part.shape, (10, 20))
        content = path.read_bytes()
        for length in range(0, len(content), 997):
            path.write_bytes(content[:length])
            with self.assertRaises(insula.Error):
                insula.Raster.read(path)

    @needs("rasterio", "xarray")
    def test_rasters_are_those_that_gdal_reads(self):
        import rasterio

        path = self.folder / "sky.tif"
        raster = self.city.sky_view(out=path)
        with rasterio.open(path) as file:
            np.testing.assert_array_equal(file.read(1), raster.array)
            self.assertEqual((tuple(file.transform)[:6], file.nodata), (raster.transform, raster.nodata))
            self.assertEqual(file.crs.to_epsg(), int(raster.crs.removeprefix("EPSG:")))
        copy = self.folder / "copy.tif"
        with rasterio.open(copy, "w", **raster.to_rasterio_profile()) as file:
            file.write(raster.array, 1)
        array = raster.to_xarray()
        self.assertEqual((array.shape, array.attrs["attribution"]), (raster.shape, raster.attribution))
        self.assertLess(float(array.max()), 1.01)

    def test_analyses_have_tables_of_buildings(self):
        sun = self.city.sun_hours("en-17037", buildings=True)
        self.assertGreater(np.nanmax(sun.values), 1)
        self.assertGreater(len(sun.buildings), 10)
        self.assertIsInstance(sun.buildings[0]["identifier"], str)
        self.assertTrue(any(isinstance(value, float) for value in sun.buildings[0].values()))
        shade = self.city.shadow("2025-12-21T10:00+01:00")
        self.assertEqual(set(np.unique(shade.array[shade.array != np.float32(shade.nodata)])), {0, 1})
        seen = self.city.view((7.421, 43.7315, 2))
        self.assertTrue(0 < np.nanmean(seen.values) < 1)

    def test_a_served_city_is_drawn_as_that_of_the_folder(self):
        with insula.serve(self.city) as server:
            for address in (server.url, f"{server.url}/v1/cities/monaco", f"{server.url}/cities/monaco"):
                city = insula.open(address)
                self.assertEqual(city.manifest["version"], self.city.manifest["version"])
            np.testing.assert_array_equal(city.render(size=SIZE), self.city.render(size=SIZE))
            with self.assertRaisesRegex(insula.Error, "another machine"):
                city.objects()
            self.assertEqual(urllib.request.urlopen(f"{server.url}/healthz").status, 200)
        with self.assertRaises(insula.Error):
            insula.open(server.url)

    @needs("anywidget")
    def test_a_widget_answers_for_its_server(self):
        from insula import _http, _map

        try:
            widget = insula.Map(self.city, height=300)
        except insula.Error as error:
            self.assertIn("no viewer", str(error))
            self.skipTest("the programs have no viewer for browsers")
        self.addCleanup(widget.close)
        sent = []
        widget.send = lambda content, buffers: sent.append((content, buffers))
        widget._answer({"id": 1, "path": widget._assets + "insula_web_bg.wasm"})
        widget._answer({"id": 2, "path": "/v1/cities/monaco"})
        widget._answer({"id": 3, "path": "/metrics"})
        self.assertEqual([content.get("status") for content, _ in sent], [200, 200, None])
        self.assertEqual(sent[0][0]["headers"]["content-encoding"], "gzip")
        self.assertIsNone(_map._PATHS.fullmatch("/v1/@elsewhere"))
        # Any page of the browser reaches the server, and has no token.
        address = widget._address + "/v1/cities/monaco"
        self.assertEqual([_http.get(address).status, _http.get(address, widget._headers).status], [401, 200])
        folder = Path(widget._folder.name)
        widget.close()
        self.assertFalse(folder.exists())


if __name__ == "__main__":
    unittest.main()
