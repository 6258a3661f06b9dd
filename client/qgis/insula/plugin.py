"""Registers the provider while the plugin is on."""

from qgis.core import QgsApplication

from .provider import InsulaProvider


class InsulaPlugin:
    """What QGIS loads and unloads."""

    def __init__(self):
        self.provider = None

    def initProcessing(self):
        """Called alone by qgis_process, which has no window."""
        self.provider = InsulaProvider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self):
        self.initProcessing()

    def unload(self):
        if self.provider is not None:
            QgsApplication.processingRegistry().removeProvider(self.provider)
            self.provider = None
