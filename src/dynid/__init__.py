"""dynid identifies the dynamics of a robot arm."""

__version__ = "0.1.0"
