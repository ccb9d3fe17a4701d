"""A local page: the arm in 3D, design, live run, results."""

from dynid.studio.server import Served, serve

__all__ = [
    "Served",
    "serve",
]
