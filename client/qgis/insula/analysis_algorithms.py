"""Analyses: hours of sun, sky, solar energy, shadows and views, as rasters and tables of buildings with colours."""

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsProcessingParameterDateTime,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterNumber,
    QgsProcessingParameterPoint,
    QgsProcessingParameterRasterDestination,
    QgsProcessingParameterString,
    QgsProcessingParameterVectorDestination,
)

from . import answers, commands
from .algorithm import BUILDINGS, DEGREES, OUTPUT, PROPOSAL, InsulaAlgorithm, make_folder_of
from .styles import BuildingStyle, RasterStyle, use_style

RULE, RULE_FILE, TURBIDITY, WEATHER, TIME, TIME_ZONE = "RULE", "RULE_FILE", "TURBIDITY", "WEATHER", "TIME", "TIME_ZONE"
EYE, EYE_HEIGHT, TARGET_HEIGHT = "EYE", "EYE_HEIGHT", "TARGET_HEIGHT"


class AnalysisAlgorithm(InsulaAlgorithm):
    """An analysis of a city. WHAT is its name in the program."""

    GROUP = "Analysis"
    WHAT = ""
    HAS_BUILDINGS = True

    def initAlgorithm(self, config=None):
        self.add_city()
        self.add_parameters()
        self.add_extent()
        proposal = QgsProcessingParameterFile(PROPOSAL, "Proposal, for what it changes", optional=True, extension="toml")
        self.addParameter(proposal)
        self.add_more()
        self.addParameter(QgsProcessingParameterRasterDestination(OUTPUT, self.TITLE))
        if self.HAS_BUILDINGS:
            table = QgsProcessingParameterVectorDestination(BUILDINGS, "Buildings", optional=True, createByDefault=False)
            self.addParameter(table)

    def add_parameters(self):
        """Adds those that only this analysis has."""

    def words(self, parameters, context, city, out, shared):
        """The words of the program. `shared` are the options that all analyses have."""
        raise NotImplementedError

    def processAlgorithm(self, parameters, context, feedback):
        out = make_folder_of(self.parameterAsOutputLayer(parameters, OUTPUT, context))
        table = self.parameterAsOutputLayer(parameters, BUILDINGS, context) if parameters.get(BUILDINGS) else ""
        proposal = self.parameterAsFile(parameters, PROPOSAL, context)
        shared = {
            "bbox": self.bbox(parameters, context),
            "proposal": proposal,
            "more": self.more(parameters, context),
        }
        if self.HAS_BUILDINGS and table:
            shared["buildings"] = make_folder_of(table)
        city = self.city(parameters, context)
        (answer,) = self.run_program(lambda: self.words(parameters, context, city, out, shared), feedback)
        values = answers.value_range(answer) or (0.0, 1.0)
        use_style(context, out, RasterStyle(self.WHAT, values, bool(proposal), answer["unit"]), f"{self.TITLE}: {answer['title']}")
        results = {OUTPUT: out}
        if table:
            use_style(context, table, BuildingStyle(f"roof_{answer['unit']}_mean", values, bool(proposal)), f"Buildings: {self.TITLE}")
            results[BUILDINGS] = table
        return results


class SunAlgorithm(AnalysisAlgorithm):
    NAME, TITLE, WHAT = "sun", "Hours of sun", "sun"
    HELP = (
        "Hours of sun on the ground and on roofs by a rule: on which days, at which hours and how high the sun must stand. The table has "
        "roofs and walls of each building. With a proposal, values are those after it less those before."
    )

    def add_parameters(self):
        self.addParameter(QgsProcessingParameterEnum(RULE, "Rule", commands.RULES, defaultValue=0))
        self.addParameter(QgsProcessingParameterFile(RULE_FILE, "Or a rule of your own", optional=True, extension="toml"))

    def words(self, parameters, context, city, out, shared):
        rule = commands.RULES[self.parameterAsEnum(parameters, RULE, context)]
        own = self.parameterAsFile(parameters, RULE_FILE, context)
        return commands.sun(city, out, rule=own or rule, **shared)


class SkyAlgorithm(AnalysisAlgorithm):
    NAME, TITLE, WHAT = "sky", "Sky view factor", "sky"
    HELP = (
        "The share of an even sky's light that a level surface gets: 1 in the open. The table has vertical sky components of walls, in "
        "percent."
    )

    def words(self, parameters, context, city, out, shared):
        return commands.sky(city, out, **shared)


class SolarAlgorithm(AnalysisAlgorithm):
    NAME, TITLE, WHAT = "solar", "Solar energy of a year", "solar"
    HELP = (
        "Energy of sun and sky in a year without clouds, in kWh/m2 of each surface as it is inclined: the most that a place can have. The "
        "table sums it up over each roof. With a weather file (EPW), it is that of a usual year with its clouds."
    )

    def add_parameters(self):
        number = QgsProcessingParameterNumber(
            TURBIDITY, "Turbidity of the air (Linke): 2 is very clear, 5 is haze", QgsProcessingParameterNumber.Double, 3.0, minValue=1, maxValue=20
        )
        self.addParameter(number)
        self.addParameter(QgsProcessingParameterFile(WEATHER, "Or the weather of a year, with its clouds", optional=True, extension="epw"))

    def words(self, parameters, context, city, out, shared):
        turbidity = self.parameterAsDouble(parameters, TURBIDITY, context)
        return commands.solar(city, out, turbidity=turbidity, weather=self.parameterAsFile(parameters, WEATHER, context), **shared)


class ShadowAlgorithm(AnalysisAlgorithm):
    NAME, TITLE, WHAT = "shadow", "Shadows at a time", "shadow"
    HELP = "1 where shadow lies at a time, 0 in the sun. Without a time zone, the time is mean solar time."
    HAS_BUILDINGS = False

    def add_parameters(self):
        self.addParameter(QgsProcessingParameterDateTime(TIME, "Time"))
        self.addParameter(QgsProcessingParameterString(TIME_ZONE, "Time zone, such as Europe/Paris, or true-solar", optional=True))

    def words(self, parameters, context, city, out, shared):
        time = self.parameterAsDateTime(parameters, TIME, context).toString("yyyy-MM-dd'T'HH:mm")
        zone = self.parameterAsString(parameters, TIME_ZONE, context)
        return commands.shadow(city, out, time=time, time_zone=zone, **shared)


class ViewAlgorithm(AnalysisAlgorithm):
    NAME, TITLE, WHAT = "view", "View from a point", "view"
    HELP = (
        "1 where the top of a cell is visible from an eye above the ground or roof at a point, 0 elsewhere. With a height of targets of "
        "1.6 m it is where people can be seen, and can see the point."
    )
    HAS_BUILDINGS = False

    def add_parameters(self):
        real = QgsProcessingParameterNumber.Double
        self.addParameter(QgsProcessingParameterPoint(EYE, "Place of the eye"))
        self.addParameter(QgsProcessingParameterNumber(EYE_HEIGHT, "Its height above the ground or roof, in metres", real, 1.6, minValue=0))
        self.addParameter(QgsProcessingParameterNumber(TARGET_HEIGHT, "Height of targets, in metres", real, 0.0, minValue=0, maxValue=1000))

    def words(self, parameters, context, city, out, shared):
        point = self.parameterAsPoint(parameters, EYE, context, QgsCoordinateReferenceSystem(DEGREES))
        return commands.view(
            city,
            out,
            eye=(point.x(), point.y()),
            eye_height_m=self.parameterAsDouble(parameters, EYE_HEIGHT, context),
            target_height_m=self.parameterAsDouble(parameters, TARGET_HEIGHT, context),
            **shared,
        )
