"""From a recording to samples: uniform time, filters, derivatives, periods, torques."""

from dynid.signals.filters import NYQUIST_SHARE as NYQUIST_SHARE
from dynid.signals.filters import ORDERS as ORDERS
from dynid.signals.filters import TorqueFilter as TorqueFilter
from dynid.signals.filters import default_cutoff as default_cutoff
from dynid.signals.filters import derivative as derivative
from dynid.signals.filters import low_pass as low_pass
from dynid.signals.filters import motion_bandwidth as motion_bandwidth
from dynid.signals.filters import torque_end as torque_end
from dynid.signals.filters import was_smoothed as was_smoothed
from dynid.signals.parts import LongSignals as LongSignals
from dynid.signals.parts import StreamGrid as StreamGrid
from dynid.signals.parts import rows_of as rows_of
from dynid.signals.parts import survey as survey
from dynid.signals.process import delayed as delayed
from dynid.signals.process import process as process
from dynid.signals.process import samples_at_stamps as samples_at_stamps
from dynid.signals.process import samples_from as samples_from
from dynid.signals.process import uniform_signals as uniform_signals
from dynid.signals.resample import UniformSignals as UniformSignals
from dynid.signals.resample import find_period as find_period
from dynid.signals.resample import fold_periods as fold_periods
from dynid.signals.resample import window as window
from dynid.signals.samples import ProcessingSettings as ProcessingSettings
from dynid.signals.samples import Samples as Samples
from dynid.signals.samples import joined as joined
from dynid.signals.samples import measured_torque as measured_torque
