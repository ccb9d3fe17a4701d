"""A local page: the arm in 3D, design, live run, results."""

from dynid.studio.server import Served as Served
from dynid.studio.server import serve as serve
