"""A simulated arm with known parameters, to test identification against."""
