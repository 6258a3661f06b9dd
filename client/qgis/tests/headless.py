#!/usr/bin/env python3
"""Runs the algorithms of the plugin in a real QGIS without a window, and checks the layers that they give.

It needs the Python modules of QGIS (on Debian and Ubuntu: python3-qgis), and insula-server, installed or named by INSULA_SERVER.
"""

import argparse
import os
import pathlib
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Places of the plugin `processing`, which is no module of Python's own folders.
PLUGINS = ["/usr/share/qgis/python/plugins", "/Applications/QGIS.app/Contents/Resources/python/plugins"]
# The old town of Monaco.
AREA = "7.418,7.424,43.730,43.734 [EPSG:4326]"


def start():
    """Starts QGIS with Processing and the provider. Returns the application and `processing.run`."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    sys.path[:0] = [str(ROOT), *filter(os.path.isdir, PLUGINS)]
    from qgis.core import QgsApplication

    application = QgsApplication([], False)
    application.initQgis()
    import processing
    from insula.plugin import InsulaPlugin
    from processing.core.Processing import Processing

    Processing.initialize()
    plugin = InsulaPlugin()
    plugin.initProcessing()
    return application, plugin, processing.run


def run_styled(run, name, parameters, keys):
    """Runs an algorithm as the toolbox does, and returns its outputs as layers with their styles."""
    from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProcessingOutputLayerDefinition, QgsProject

    project = QgsProject.instance()
    context, feedback = QgsProcessingContext(), QgsProcessingFeedback()
    context.setProject(project)
    parameters = dict(parameters)
    for key in keys:
        parameters[key] = QgsProcessingOutputLayerDefinition(parameters[key], project)
    results = run(f"insula:{name}", parameters, context=context, feedback=feedback, is_child_algorithm=False)
    layers = []
    for key in keys:
        path = results[key] if isinstance(results[key], str) else results[key].source()
        details = context.layerToLoadOnCompletionDetails(path)
        layer = load(path)
        assert layer.isValid(), f"{name}: {path} is no layer"
        details.postProcessor().postProcessLayer(layer, context, feedback)
        layers.append(layer)
    return layers


def load(path):
    from qgis.core import QgsRasterLayer, QgsVectorLayer

    return QgsRasterLayer(path, "raster") if path.endswith(".tif") else QgsVectorLayer(path, "table", "ogr")


def check(source, folder):
    """Bakes `source` and asks all questions about it."""
    application, plugin, run = start()
    from qgis.core import QgsTiledSceneLayer

    city = str(folder / "city")
    report = run("insula:bake", {"FILES": [source], "EXTENT": AREA, "CELL": 3, "MORE": "--views 32 --no-street-sets", "OUTPUT": city})
    assert report["BUILDINGS"] > 10, report
    at = {"CITY": city}
    eye = "7.4204,43.7312 [EPSG:4326]"
    for name, extra, with_table in (
        ("sun", {"RULE": 0}, True),
        ("sky", {}, True),
        ("solar", {"TURBIDITY": 3}, True),
        ("shadow", {"TIME": "2025-12-21T10:00:00", "TIME_ZONE": "Europe/Monaco"}, False),
        ("view", {"EYE": eye}, False),
    ):
        parameters = {**at, **extra, "OUTPUT": str(folder / f"{name}.tif")}
        if with_table:
            parameters["BUILDINGS"] = str(folder / f"{name}.fgb")
        layers = run_styled(run, name, parameters, ["OUTPUT", "BUILDINGS"] if with_table else ["OUTPUT"])
        raster = layers[0]
        assert raster.crs().isValid() and raster.renderer().type() == "singlebandpseudocolor", name
        if with_table:
            assert layers[1].featureCount() > 10 and layers[1].renderer().type() == "graduatedSymbol", name
        print(f"{name}: {raster.width()} x {raster.height()} cells")
    (objects,) = run_styled(run, "objects", {**at, "FILTER": "height > 10", "OUTPUT": str(folder / "objects.fgb")}, ["OUTPUT"])
    assert 0 < objects.featureCount() and objects.renderer().type() == "categorizedSymbol"
    heights = load(run("insula:heights", {**at, "OUTPUT": str(folder / "heights.tif")})["OUTPUT"])
    assert heights.isValid() and heights.crs().isValid()
    tiles = pathlib.Path(run("insula:tiles", {**at, "OUTPUT": str(folder / "tiles")})["OUTPUT"])
    scene = QgsTiledSceneLayer(str(tiles / "tileset.json"), "tiles", "cesiumtiles")
    assert scene.isValid() and scene.dataProvider().index().isValid(), "3D Tiles are no layer"
    model = run("insula:model", {**at, "EXTENT": AREA, "OUTPUT": str(folder / "model.glb")})["OUTPUT"]
    assert pathlib.Path(model).read_bytes()[:4] == b"glTF"
    plugin.unload()
    application.exitQgis()
    print("all algorithms gave what they should")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = ROOT.parent / "demo/monaco/monaco.osm.pbf"
    parser.add_argument("source", nargs="?", default=str(default), help="file to bake [default: the bundled map of Monaco]")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        check(arguments.source, pathlib.Path(folder))


if __name__ == "__main__":
    main()
