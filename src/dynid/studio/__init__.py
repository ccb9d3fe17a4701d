"""A local page: the arm in 3D, design, live run, results."""
