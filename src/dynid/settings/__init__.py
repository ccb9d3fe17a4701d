"""What can be asked for: the settings of the verbs, and their options."""

from dynid.settings.options import FINITE as FINITE
from dynid.settings.options import Option as Option
from dynid.settings.options import numbers as numbers
from dynid.settings.options import options_of as options_of
from dynid.settings.options import word_of as word_of
from dynid.settings.verbs import LONGEST_S as LONGEST_S
from dynid.settings.verbs import DesignSettings as DesignSettings
from dynid.settings.verbs import FleetSettings as FleetSettings
from dynid.settings.verbs import IdentifySettings as IdentifySettings
from dynid.settings.verbs import ImportOptions as ImportOptions
from dynid.settings.verbs import LimitSettings as LimitSettings
from dynid.settings.verbs import RunSettings as RunSettings
from dynid.settings.verbs import SceneSettings as SceneSettings
from dynid.settings.verbs import parse_thermal as parse_thermal
