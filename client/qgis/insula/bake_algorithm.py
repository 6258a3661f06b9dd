"""Bake: from city files to a city."""

from qgis.core import (
    QgsProcessing,
    QgsProcessingOutputNumber,
    QgsProcessingParameterCrs,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterString,
)

from . import commands
from .algorithm import OUTPUT, InsulaAlgorithm

FILES, FOLDER, CRS, CELL, NAME_OF_CITY, HEIGHT_FIELD, MODE = "FILES", "FOLDER", "CRS", "CELL", "TITLE", "HEIGHT_FIELD", "MODE"
MODES = ["", "update", "resume"]


class BakeAlgorithm(InsulaAlgorithm):
    """Makes the city that all other algorithms read."""

    NAME, TITLE, GROUP = "bake", "Bake a city", "City"
    HELP = (
        "Makes a city from files of city models (CityGML, CityJSON, glTF, 3D Tiles, I3S), maps (OpenStreetMap), footprints with "
        "heights (GeoJSON, GeoPackage, Shapefile, FlatGeobuf, GeoParquet) and elevation models. All others of Insula's algorithms read "
        "the folder that this one writes. A bake that is cancelled keeps its finished work: run it again with 'continue'."
    )

    def initAlgorithm(self, config=None):
        files = QgsProcessingParameterMultipleLayers(FILES, "Files", QgsProcessing.TypeFile, optional=True)
        self.addParameter(files)
        folder = QgsProcessingParameterFile(FOLDER, "Folder of files", behavior=QgsProcessingParameterFile.Folder, optional=True)
        self.addParameter(folder)
        self.addParameter(QgsProcessingParameterCrs(CRS, "Coordinate system of the city (empty: that of the files)", optional=True))
        self.add_extent()
        number = QgsProcessingParameterNumber(
            CELL, "Finest detail for views from afar, in metres", QgsProcessingParameterNumber.Double, 1.0, minValue=0.01, maxValue=1000
        )
        self.addParameter(number)
        self.addParameter(QgsProcessingParameterString(NAME_OF_CITY, "Title", optional=True))
        self.addParameter(QgsProcessingParameterString(HEIGHT_FIELD, "Attribute with heights of footprints", optional=True))
        modes = ["replace it", "bake only what has changed", "continue an interrupted bake"]
        self.addParameter(QgsProcessingParameterEnum(MODE, "If there is a city in the folder", modes, defaultValue=0))
        self.add_more()
        self.addParameter(QgsProcessingParameterFolderDestination(OUTPUT, "City"))
        self.addOutput(QgsProcessingOutputNumber("BUILDINGS", "Number of buildings"))
        self.addOutput(QgsProcessingOutputNumber("OBJECTS", "Number of objects"))

    def processAlgorithm(self, parameters, context, feedback):
        out = self.parameterAsFileOutput(parameters, OUTPUT, context)
        folder = self.parameterAsFile(parameters, FOLDER, context)
        inputs = self.parameterAsFileList(parameters, FILES, context) if parameters.get(FILES) else []
        inputs = [path for path in inputs if path] + ([folder] if folder else [])
        crs = self.parameterAsCrs(parameters, CRS, context)

        def words():
            return commands.bake(
                inputs,
                out,
                crs=crs.authid() if crs.isValid() else "",
                bbox=self.bbox(parameters, context),
                cell_m=self.parameterAsDouble(parameters, CELL, context),
                title=self.parameterAsString(parameters, NAME_OF_CITY, context),
                height_field=self.parameterAsString(parameters, HEIGHT_FIELD, context),
                mode=MODES[self.parameterAsEnum(parameters, MODE, context)],
                more=self.more(parameters, context),
            )

        (report,) = self.run_program(words, feedback)
        feedback.pushInfo(f"{report['name']}: {report['size']}")
        return {OUTPUT: out, "BUILDINGS": report.get("buildings") or 0, "OBJECTS": report.get("objects") or 0}
