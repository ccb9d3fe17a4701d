"""From standard to base parameters: rank, regrouping, classes."""
