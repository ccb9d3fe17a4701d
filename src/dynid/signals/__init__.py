"""From a recording to samples: uniform time, filters, derivatives, periods, torques."""
