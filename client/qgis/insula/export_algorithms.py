"""Exports: objects, heights and surfaces of a city as layers, and the city as a 3D model."""

import os

from qgis.core import (
    QgsProcessingContext,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterRasterDestination,
    QgsProcessingParameterString,
    QgsProcessingParameterVectorDestination,
)

from . import commands
from .algorithm import OUTPUT, InsulaAlgorithm, make_folder_of
from .styles import KindStyle, use_style

try:
    from qgis.core import QgsTiledSceneLayer
except ImportError:  # before QGIS 3.34
    QgsTiledSceneLayer = None

WHERE, PARTS, LOAD = "FILTER", "PARTS", "LOAD"
# Formats of tables by the end of a file's name.
TABLES = {"fgb": "flatgeobuf", "geojson": "geojson", "csv": "csv", "parquet": "geoparquet"}


class ExportAlgorithm(InsulaAlgorithm):
    """An export. Subclasses add the destination."""

    GROUP = "Export"

    def initAlgorithm(self, config=None):
        self.add_city()
        self.add_parameters()
        self.add_extent()
        self.add_more()
        self.addParameter(self.destination())

    def add_parameters(self):
        """Adds those that only this export has."""

    def destination(self):
        raise NotImplementedError

    def export(self, parameters, context, feedback, out, form, **options):
        """Runs the program."""
        make_folder_of(out)
        city, bbox, more = self.city(parameters, context), self.bbox(parameters, context), self.more(parameters, context)
        self.run_program(lambda: commands.export(city, out, form, bbox=bbox, more=more, **options), feedback)
        return {OUTPUT: out}


class ObjectsAlgorithm(ExportAlgorithm):
    NAME, TITLE = "objects", "Objects as a layer"
    HELP = (
        "Footprints of buildings and other objects with heights and all attributes. A filter is as in Insula's search panel: height > 20, "
        "or kind == \"bridge\"."
    )

    def add_parameters(self):
        self.addParameter(QgsProcessingParameterString(WHERE, "Filter", optional=True))
        self.addParameter(QgsProcessingParameterBoolean(PARTS, "A row for each part of a building", defaultValue=False))

    def destination(self):
        return QgsProcessingParameterVectorDestination(OUTPUT, "Objects")

    def processAlgorithm(self, parameters, context, feedback):
        out = self.parameterAsOutputLayer(parameters, OUTPUT, context)
        form = TABLES.get(out.rsplit(".", 1)[-1].lower(), "flatgeobuf")
        where = self.parameterAsString(parameters, WHERE, context)
        parts = self.parameterAsBool(parameters, PARTS, context)
        results = self.export(parameters, context, feedback, out, form, where=where, parts=parts)
        use_style(context, out, KindStyle(), "Objects")
        return results


class HeightsAlgorithm(ExportAlgorithm):
    NAME, TITLE = "heights", "Heights as a raster"
    HELP = "The height of the highest surface of each cell above sea level: ground, roofs and bridges."

    def destination(self):
        return QgsProcessingParameterRasterDestination(OUTPUT, "Heights")

    def processAlgorithm(self, parameters, context, feedback):
        out = self.parameterAsOutputLayer(parameters, OUTPUT, context)
        return self.export(parameters, context, feedback, out, "geotiff")


class TilesAlgorithm(ExportAlgorithm):
    NAME, TITLE = "tiles", "3D Tiles as a layer"
    HELP = (
        "All surfaces as 3D Tiles in a folder, opened as a tiled scene layer, which a 3D map view shows. QGIS before 3.34 has no such "
        "layers."
    )

    # The tileset that becomes a layer.
    tileset = None

    def add_parameters(self):
        self.addParameter(QgsProcessingParameterBoolean(LOAD, "Open as a layer", defaultValue=True))

    def destination(self):
        return QgsProcessingParameterFolderDestination(OUTPUT, "Folder of the tiles")

    def processAlgorithm(self, parameters, context, feedback):
        out = self.parameterAsFileOutput(parameters, OUTPUT, context)
        results = self.export(parameters, context, feedback, out, "3dtiles", plain=True)
        if self.parameterAsBool(parameters, LOAD, context):
            self.tileset = os.path.join(out, "tileset.json")
        return results

    def postProcessAlgorithm(self, context, feedback):
        """Opens the layer here, in the thread of the window: Processing loads no tiled scenes from the names of files."""
        if self.tileset is None or context.project() is None:
            return {}
        if QgsTiledSceneLayer is None:
            feedback.pushWarning("this QGIS has no tiled scene layers: open the folder in QGIS 3.34 or later")
            return {}
        name = os.path.basename(os.path.dirname(self.tileset))
        layer = QgsTiledSceneLayer(self.tileset, name, "cesiumtiles")
        if not layer.isValid():
            feedback.pushWarning(f"QGIS does not open {self.tileset}")
            return {}
        context.temporaryLayerStore().addMapLayer(layer)
        context.addLayerToLoadOnCompletion(layer.id(), QgsProcessingContext.LayerDetails(name, context.project(), OUTPUT))
        return {}


class ModelAlgorithm(ExportAlgorithm):
    NAME, TITLE = "model", "3D model (glTF)"
    HELP = "Surfaces of a part of a city as one GLB file, for Blender and other programs of 3D models. Choose a small area."

    def destination(self):
        return QgsProcessingParameterFileDestination(OUTPUT, "Model", "glTF (*.glb)")

    def processAlgorithm(self, parameters, context, feedback):
        out = self.parameterAsFileOutput(parameters, OUTPUT, context)
        return self.export(parameters, context, feedback, out, "glb")
