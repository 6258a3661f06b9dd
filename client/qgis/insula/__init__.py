"""The plugin of QGIS. Modules that need no QGIS: commands, answers, program, colours."""


def classFactory(iface):  # pylint: disable=invalid-name
    """Called by QGIS with its interface, which this plugin does not need."""
    from .plugin import InsulaPlugin

    return InsulaPlugin()
