"""What all algorithms share: parameters that several have, and the run of the program."""

import os

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterExtent,
    QgsProcessingParameterFile,
    QgsProcessingParameterString,
)

from . import answers, commands, program
from .setting import find_program

DEGREES = "EPSG:4326"
CITY, EXTENT, OUTPUT, BUILDINGS, PROPOSAL, MORE = "CITY", "EXTENT", "OUTPUT", "BUILDINGS", "PROPOSAL", "MORE"


class InsulaAlgorithm(QgsProcessingAlgorithm):
    """An algorithm that runs insula-server. NAME, TITLE, GROUP and HELP are those of a subclass."""

    NAME = TITLE = GROUP = HELP = ""

    def name(self):
        return self.NAME

    def displayName(self):
        return self.TITLE

    def group(self):
        return self.GROUP

    def groupId(self):
        return self.GROUP.lower()

    def shortHelpString(self):
        return self.HELP

    def createInstance(self):
        return type(self)()

    def canExecute(self):
        try:
            find_program()
        except program.ProgramError as error:
            return False, str(error)
        return True, ""

    # Parameters.

    def add_city(self):
        self.addParameter(QgsProcessingParameterFile(CITY, "City (a baked folder)", behavior=QgsProcessingParameterFile.Folder))

    def add_extent(self):
        self.addParameter(QgsProcessingParameterExtent(EXTENT, "Only this area", optional=True))

    def add_more(self):
        parameter = QgsProcessingParameterString(MORE, "Further options of the program, as on a command line", optional=True)
        parameter.setFlags(parameter.flags() | QgsProcessingParameterDefinition.FlagAdvanced)
        self.addParameter(parameter)

    # Values.

    def city(self, parameters, context):
        return self.parameterAsFile(parameters, CITY, context)

    def more(self, parameters, context):
        return self.parameterAsString(parameters, MORE, context)

    def bbox(self, parameters, context):
        """West, south, east and north in degrees; None without an area."""
        if not parameters.get(EXTENT):
            return None
        area = self.parameterAsExtent(parameters, EXTENT, context, QgsCoordinateReferenceSystem(DEGREES))
        return None if area.isNull() else (area.xMinimum(), area.yMinimum(), area.xMaximum(), area.yMaximum())

    # The run.

    def run_program(self, make_words, feedback):
        """Runs the program with the words that `make_words` gives, and returns its answers."""
        try:
            command = [find_program(), *make_words()]
            feedback.pushCommandInfo(" ".join(command))
            found = program.run(command, lambda line: tell(line, feedback), feedback.isCanceled)
        except program.Cancelled:
            raise QgsProcessingException("cancelled") from None
        except (commands.UsageError, program.ProgramError) as error:
            raise QgsProcessingException(str(error)) from error
        for answer in found:
            for sentence in answers.sentences(answer):
                feedback.pushInfo(sentence)
        return found


def tell(line, feedback):
    """Shows a line of standard error where it belongs."""
    progress = answers.progress(line)
    if progress is not None:
        if progress.percent is not None:
            feedback.setProgress(progress.percent)
        feedback.setProgressText(progress.text)
        return
    kind, text = answers.level(line)
    if kind == "warning":
        feedback.pushWarning(text)
    else:
        feedback.pushInfo(text)


def make_folder_of(path):
    """Creates the folder of an output: those of temporary ones may not exist yet."""
    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
    return path
