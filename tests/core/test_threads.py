"""The threads of linear algebra."""

import json
import os
import subprocess
import sys

SEVERAL = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "2")
CODE = """
import json, numpy, threadpoolctl
from dynid.core import one_thread, upper_triangle
with one_thread():
    upper_triangle(numpy.eye(3))
    found = threadpoolctl.threadpool_info()
print(json.dumps([one["num_threads"] for one in found if one["user_api"] == "blas"]))
"""


def test_one_thread_holds_for_the_blas_that_scipy_brings_later_too() -> None:
    words = [sys.executable, "-c", CODE]
    told = subprocess.check_output(words, env=os.environ | SEVERAL, text=True)
    assert set(json.loads(told)) == {1}


OVERLAPPING = """
import json, numpy, threadpoolctl
from dynid.core import one_thread, upper_triangle
def threads():
    found = threadpoolctl.threadpool_info()
    return sorted({one["num_threads"] for one in found if one["user_api"] == "blas"})
upper_triangle(numpy.eye(3))
first, second = one_thread(), one_thread()
told = [threads()]
for step in (first.__enter__, second.__enter__, first.__exit__, second.__exit__):
    step(*(None, None, None) if step.__name__ == "__exit__" else ())
    told.append(threads())
print(json.dumps(told))
"""


def test_the_threads_are_restored_where_two_identifications_overlap() -> None:
    words = [sys.executable, "-c", OVERLAPPING]
    told = json.loads(subprocess.check_output(words, env=os.environ | SEVERAL, text=True))
    assert told == [[2], [1], [1], [1], [2]]
