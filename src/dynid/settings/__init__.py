"""What can be asked for: the settings of the verbs, and their options."""

from dynid.settings.options import FINITE, Option, numbers, options_of
from dynid.settings.verbs import (
    LONGEST_S,
    DesignSettings,
    FleetSettings,
    IdentifySettings,
    ImportOptions,
    LimitSettings,
    RunSettings,
    SceneSettings,
    parse_thermal,
)

__all__ = [
    "FINITE",
    "LONGEST_S",
    "DesignSettings",
    "FleetSettings",
    "IdentifySettings",
    "ImportOptions",
    "LimitSettings",
    "Option",
    "RunSettings",
    "SceneSettings",
    "numbers",
    "options_of",
    "parse_thermal",
]
