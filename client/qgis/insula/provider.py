"""The provider: the algorithms of Insula in the Processing toolbox."""

import os

from qgis.core import QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from . import setting
from .analysis_algorithms import ShadowAlgorithm, SkyAlgorithm, SolarAlgorithm, SunAlgorithm, ViewAlgorithm
from .bake_algorithm import BakeAlgorithm
from .export_algorithms import HeightsAlgorithm, ModelAlgorithm, ObjectsAlgorithm, TilesAlgorithm


class InsulaProvider(QgsProcessingProvider):
    """All algorithms, with one setting: where the program is."""

    def id(self):
        return "insula"

    def name(self):
        return "Insula"

    def icon(self):
        return QIcon(os.path.join(os.path.dirname(__file__), "icon.svg"))

    def load(self):
        setting.add(self.name(), self.icon())
        self.refreshAlgorithms()
        return True

    def unload(self):
        setting.remove()

    def loadAlgorithms(self):
        for algorithm in (
            BakeAlgorithm,
            SunAlgorithm,
            SkyAlgorithm,
            SolarAlgorithm,
            ShadowAlgorithm,
            ViewAlgorithm,
            ObjectsAlgorithm,
            HeightsAlgorithm,
            TilesAlgorithm,
            ModelAlgorithm,
        ):
            self.addAlgorithm(algorithm())

    def supportedOutputVectorLayerExtensions(self):
        return ["fgb", "geojson", "csv", "parquet"]

    def supportedOutputRasterLayerExtensions(self):
        return ["tif"]

    def supportsNonFileBasedOutput(self):
        return False

    def defaultVectorFileExtension(self, hasGeometry=True):
        return "fgb"

    def defaultRasterFileExtension(self):
        return "tif"
