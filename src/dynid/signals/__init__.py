"""From recorded signals to samples: torque, grid, filters, derivatives, periods."""
