"""Matrices of a script: lists of rows of one length.

The products of two matrices and of a matrix with a list are those of algebra; all else goes
element by element (script manual, "Matrix and Array Expressions").
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from dynid.simulation.controller.urscript.builtin import Builtin, Kind, builtin
from dynid.simulation.controller.urscript.errors import ScriptFault
from dynid.simulation.controller.urscript.pose_functions import inverse_pose, matrix_of, numbers
from dynid.simulation.controller.urscript.values import Pose, Value, described, is_matrix

_WEIGHT = 400


def rows_of(value: Value) -> list[list[Any]]:
    """The rows of a matrix.

    Raises:
        ScriptFault: No matrix.
    """
    if not is_matrix(value):
        raise ScriptFault("a matrix expected", value=described(value))
    return cast("list[list[Any]]", value)


def _transpose(m: Value) -> Value:
    return [list(column) for column in zip(*rows_of(m), strict=True)]


def _inv(m: Value) -> Value:
    if isinstance(m, Pose):
        return inverse_pose(m)
    rows = rows_of(m)
    square = [numbers(row, len(rows), "a row of a square matrix") for row in rows]
    try:
        return np.linalg.inv(np.array(square, dtype=np.float64)).tolist()
    except np.linalg.LinAlgError as error:
        raise ScriptFault("a singular matrix has no inverse") from error


def _wrench_trans(T_from_to: Value, w_from: Value) -> Value:
    """A wrench in another frame: the force turned, the torque about the other origin."""
    frame, wrench = matrix_of(T_from_to), np.array(numbers(w_from, 6, "a wrench"))
    force = frame[:3, :3].T @ wrench[:3]
    moment = frame[:3, :3].T @ (wrench[3:] - np.cross(frame[:3, 3], wrench[:3]))
    return [*force.tolist(), *moment.tolist()]


MATRICES: list[Builtin] = [
    builtin(function, Kind.PURE, name=name, weight=_WEIGHT)
    for name, function in (
        ("transpose", _transpose),
        ("inv", _inv),
        ("wrench_trans", _wrench_trans),
    )
]
"""Built-ins for matrices, and for poses and wrenches as such."""
