"""What holds for all tests."""

import os

# Two workers on two cores: threads of a linear algebra library would wait for each other, which
# costs small matrices more than half of their time. Set before NumPy is imported; children take
# it over.
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
