"""Styles of results, which Processing sets when it loads them as layers."""

from qgis.core import (
    QgsCategorizedSymbolRenderer,
    QgsColorRampShader,
    QgsFillSymbol,
    QgsGraduatedSymbolRenderer,
    QgsProcessingLayerPostProcessorInterface,
    QgsRasterShader,
    QgsRendererCategory,
    QgsRendererRange,
    QgsSingleBandPseudoColorRenderer,
)
from qgis.PyQt.QtGui import QColor

from . import answers, colours

# Processing keeps no reference to what it calls later.
_KEPT = []


def use_style(context, path, style, name):
    """Has a layer get a style and a name as soon as it is loaded, if it will be."""
    if not context.willLoadLayerOnCompletion(path):
        return
    details = context.layerToLoadOnCompletionDetails(path)
    details.name = name
    _KEPT.append(style)
    details.setPostProcessor(style)


class Style(QgsProcessingLayerPostProcessorInterface):
    """A style for one layer."""

    def postProcessLayer(self, layer, context, feedback):
        if layer is None or not layer.isValid():
            return
        self.apply(layer)
        layer.triggerRepaint()

    def apply(self, layer):
        raise NotImplementedError


class RasterStyle(Style):
    """Colours of the values of an analysis."""

    def __init__(self, what, values, is_change, unit):
        super().__init__()
        self.what, self.values, self.is_change, self.unit = what, values, is_change, colours.unit(unit)

    def apply(self, layer):
        stops = colours.stops(self.what, self.values, self.is_change)
        ramp = QgsColorRampShader(stops[0][0], stops[-1][0])
        is_discrete = colours.is_discrete(self.what, self.is_change)
        ramp.setColorRampType(QgsColorRampShader.Exact if is_discrete else QgsColorRampShader.Interpolated)
        suffix = f" {self.unit}" if self.unit else ""
        ramp.setColorRampItemList([QgsColorRampShader.ColorRampItem(value, QColor(colour), label + suffix) for value, colour, label in stops])
        shader = QgsRasterShader()
        shader.setRasterShaderFunction(ramp)
        layer.setRenderer(QgsSingleBandPseudoColorRenderer(layer.dataProvider(), 1, shader))


class BuildingStyle(Style):
    """Colours of buildings by a column of numbers."""

    def __init__(self, column, values, is_change):
        super().__init__()
        self.column, self.values, self.is_change = column, values, is_change

    def apply(self, layer):
        if layer.fields().indexFromName(self.column) < 0:
            return
        stops = colours.stops("", self.values, self.is_change)
        ranges = []
        for (low, _, _), (high, colour, _) in zip(stops, stops[1:]):
            ranges.append(QgsRendererRange(low, high, _fill(colour), f"{answers.number(low)} to {answers.number(high)}"))
        layer.setRenderer(QgsGraduatedSymbolRenderer(self.column, ranges))


class KindStyle(Style):
    """Colours of objects by their kinds."""

    def apply(self, layer):
        if layer.fields().indexFromName("kind") < 0:
            return
        categories = [QgsRendererCategory(kind, _fill(colour), kind) for kind, colour in colours.KINDS.items()]
        layer.setRenderer(QgsCategorizedSymbolRenderer("kind", categories))


def _fill(colour):
    return QgsFillSymbol.createSimple({"color": colour, "outline_color": "#4d4d4d", "outline_width": "0.1"})
