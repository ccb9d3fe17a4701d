"""From standard to base parameters: rank, regrouping, classes, non-zero columns."""

from dynid.reduction.base import BaseParametrization as BaseParametrization
from dynid.reduction.base import GramLayout as GramLayout
from dynid.reduction.base import acting_joints as acting_joints
from dynid.reduction.base import gram_layout as gram_layout
from dynid.reduction.base import random_states as random_states
from dynid.reduction.base import reduce_model as reduce_model
