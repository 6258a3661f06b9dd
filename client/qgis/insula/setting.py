"""Where the program is: a setting of Processing, a variable, or as installed."""

from . import program

# Name of the setting with the path of the program.
SETTING = "INSULA_SERVER"


def find_program():
    """The path of the program. Raises program.ProgramError if there is none."""
    return program.find(_chosen())


def add(group, icon):
    """Adds the setting to the options of Processing, if there are any."""
    config = _config()
    if config is None:
        return
    what = f"Path of {program.NAME} (empty: that of the variable {program.VARIABLE}, or the installed one)"
    config.ProcessingConfig.settingIcons[group] = icon
    config.ProcessingConfig.addSetting(config.Setting(group, SETTING, what, "", valuetype=config.Setting.FILE))
    config.ProcessingConfig.readSettings()


def remove():
    """Takes it out of the options."""
    config = _config()
    if config is not None:
        config.ProcessingConfig.removeSetting(SETTING)


def _chosen():
    config = _config()
    return "" if config is None else config.ProcessingConfig.getSetting(SETTING) or ""


def _config():
    try:
        from processing.core import ProcessingConfig
    except ImportError:
        return None
    return ProcessingConfig
