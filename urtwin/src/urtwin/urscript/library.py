"""Built-in functions without a robot: mathematics, poses, matrices.

The products of two matrices and of a matrix with a list are those of algebra; all else goes
element by element (script manual, "Matrix and Array Expressions").
"""

import math
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from dynid import core, robot
from urtwin.kinematics import rotation_matrix, rotation_vector, to_matrix, to_pose
from urtwin.urscript import values


def _norm(a: values.Value) -> float:
    if isinstance(a, list):
        return math.sqrt(sum(values.number(item) ** 2 for item in cast("list[Any]", a)))
    return abs(values.number(a))


def _normalize(a: values.Value) -> list[float]:
    scale = _norm(a)
    return [values.number(item) / scale for item in a]


def _length(v: values.Value) -> int:
    if isinstance(v, list | str):
        return len(cast("list[Any]", v))
    raise values.ScriptFault("length needs a list or a string")


def _make_list(
    length: values.Value, initial_value: values.Value, capacity: values.Value = 0
) -> list[values.Value]:
    return [initial_value] * values.whole("length of a list", length, 0, values.MAX_LENGTH)


def _whole(value: values.Value) -> int:
    if value.__class__ is not int:
        raise values.ScriptFault("a whole number expected", value=value)
    return value


def _binary_list_to_integer(l: values.Value) -> int:  # noqa: E741 - its name in URScript
    bits = sum(1 << k for k, bit in enumerate(l[:32]) if values.truth(bit))
    return bits - 2**32 if bits >= 2**31 else bits


def _text(value: values.Value) -> str:
    if value.__class__ is not str:
        raise values.ScriptFault("a string expected", value=value)
    return value


def _to_num(str: values.Value) -> values.Value:
    text = _text(str).strip()
    return int(text) if text.lstrip("+-").isdigit() and len(text) < 10 else float(text)


def _str_at(src: values.Value, index: values.Value) -> str:
    text = _text(src)
    return text[values.whole("no such character", index, 0, len(text) - 1)]


def _str_find(src: values.Value, target: values.Value, start_from: values.Value = 0) -> int:
    return _text(src).find(_text(target), max(_whole(start_from), 0))


def _str_sub(src: values.Value, index: values.Value, len: values.Value = -1) -> str:
    text, place, count = _text(src), _whole(index), _whole(len)
    return text[place:] if count < 0 else text[place : place + count]


def _real(function: Any) -> Any:
    def apply(f: values.Value) -> float:
        return function(values.number(f))

    return apply


_REAL = "acos asin atan ceil cos floor sin sqrt tan"
_OF_ONE: dict[str, Callable[[values.Value], values.Value]] = {
    **{name: _real(getattr(math, name)) for name in _REAL.split()},
    "d2r": _real(math.radians),
    "r2d": _real(math.degrees),
    "length": _length,
    "get_list_length": _length,
    "size": _length,
    "norm": _norm,
    "normalize": _normalize,
    "integer_to_binary_list": lambda x: [bool(_whole(x) >> k & 1) for k in range(32)],
    "binary_list_to_integer": _binary_list_to_integer,
    "str_empty": lambda str: _text(str) == "",
    "str_len": lambda str: len(_text(str)),
    "to_num": _to_num,
    "to_str": lambda val: values.limited(values.shown(val)),
}
_OF_TWO: dict[str, Callable[[values.Value, values.Value], values.Value]] = {
    # Named as in URScript's manual, where the first argument is the ordinate.
    "atan2": lambda x, y: math.atan2(values.number(x), values.number(y)),
    "log": lambda b, f: math.log(values.number(f), values.number(b)),
    "pow": lambda base, exponent: math.pow(values.number(base), values.number(exponent)),
    "str_at": _str_at,
    "str_cat": lambda op1, op2: values.limited(values.shown(op1) + values.shown(op2)),
}


def matrix_of(pose: values.Value) -> core.Array:
    """(4, 4) the transform of a script's pose; `ScriptFault` if it is none."""
    return to_matrix(numbers(pose, 6, "a pose"))


def numbers(value: values.Value, count: int, what: str) -> list[float]:
    """A list of so many numbers; `ScriptFault` if it is none."""
    items = cast("list[Any]", value) if isinstance(value, list) else []
    if len(items) != count:
        raise values.ScriptFault(
            f"{what} of {count} numbers expected", value=values.described(value)
        )
    return [float(values.number(item)) for item in items]


def pose_of(matrix: core.Array) -> values.Pose:
    """The script's pose of a transform (4, 4)."""
    return values.Pose(to_pose(matrix))


def _pose_inv(p_from: values.Value) -> values.Pose:
    return pose_of(robot.inverse(matrix_of(p_from)))


def _pose_add(p_1: values.Value, p_2: values.Value) -> values.Pose:
    first, second = matrix_of(p_1), matrix_of(p_2)
    return _apart(first[:3, 3] + second[:3, 3], first[:3, :3] @ second[:3, :3])


def _pose_sub(p_to: values.Value, p_from: values.Value) -> values.Pose:
    goal, start = matrix_of(p_to), matrix_of(p_from)
    return _apart(goal[:3, 3] - start[:3, 3], goal[:3, :3] @ start[:3, :3].T)


def _point(pose: values.Value) -> list[float]:
    return numbers(pose, 6, "a pose")[:3]


def _interpolate_pose(p_from: values.Value, p_to: values.Value, alpha: values.Value) -> values.Pose:
    start, goal, share = matrix_of(p_from), matrix_of(p_to), values.number(alpha)
    turn = share * rotation_vector(goal[:3, :3] @ start[:3, :3].T)
    place = start[:3, 3] + share * (goal[:3, 3] - start[:3, 3])
    return _apart(place, rotation_matrix(turn) @ start[:3, :3])


def _rpy2rotvec(rpy_vector: values.Value) -> values.Value:
    turned = robot.from_xyz_rpy((0.0, 0.0, 0.0), numbers(rpy_vector, 3, "angles"))
    return rotation_vector(turned[:3, :3]).tolist()


def _rotvec2rpy(rotation_vector: values.Value) -> values.Value:
    matrix = rotation_matrix(numbers(rotation_vector, 3, "a rotation vector"))
    level = math.hypot(matrix[0, 0], matrix[1, 0])
    if level < 1e-9:
        # Roll and yaw turn about the same axis: all of it is called roll.
        turn = math.atan2(-matrix[1, 2], matrix[1, 1])
        return [turn, math.atan2(-matrix[2, 0], level), 0.0]
    return [
        math.atan2(matrix[2, 1], matrix[2, 2]),
        math.atan2(-matrix[2, 0], level),
        math.atan2(matrix[1, 0], matrix[0, 0]),
    ]


def _apart(place: core.Array, rotation: core.Array) -> values.Pose:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return pose_of(matrix)


_OF_TWO_POSES: dict[str, Callable[[values.Value, values.Value], values.Value]] = {
    "pose_trans": lambda p_from, p_from_to: pose_of(matrix_of(p_from) @ matrix_of(p_from_to)),
    "pose_add": _pose_add,
    "pose_sub": _pose_sub,
    "pose_dist": lambda p_from, p_to: math.sqrt(sum(d * d for d in _pose_sub(p_to, p_from))),
    "point_dist": lambda p_from, p_to: math.dist(_point(p_from), _point(p_to)),
}


def _rows(value: values.Value) -> list[list[Any]]:
    if not values.is_matrix(value):
        raise values.ScriptFault("a matrix expected", value=values.described(value))
    return cast("list[list[Any]]", value)


def _transpose(m: values.Value) -> values.Value:
    return [list(column) for column in zip(*_rows(m), strict=True)]


def _inv(m: values.Value) -> values.Value:
    if isinstance(m, values.Pose):
        return _pose_inv(m)
    rows = _rows(m)
    square = [numbers(row, len(rows), "a row of a square matrix") for row in rows]
    try:
        return np.linalg.inv(np.array(square, dtype=np.float64)).tolist()
    except np.linalg.LinAlgError as error:
        raise values.ScriptFault("a singular matrix has no inverse") from error


def _wrench_trans(T_from_to: values.Value, w_from: values.Value) -> values.Value:
    """A wrench in another frame: the force turned, the torque about the other origin."""
    frame, wrench = matrix_of(T_from_to), np.array(numbers(w_from, 6, "a wrench"))
    force = frame[:3, :3].T @ wrench[:3]
    moment = frame[:3, :3].T @ (wrench[3:] - np.cross(frame[:3, 3], wrench[:3]))
    return [*force.tolist(), *moment.tolist()]


LIBRARY: dict[str, Any] = {
    **_OF_ONE,
    **_OF_TWO,
    **_OF_TWO_POSES,
    "make_list": _make_list,
    "str_find": _str_find,
    "str_sub": _str_sub,
    "pose_inv": _pose_inv,
    "interpolate_pose": _interpolate_pose,
    "rpy2rotvec": _rpy2rotvec,
    "rotvec2rpy": _rotvec2rpy,
    "transpose": _transpose,
    "inv": _inv,
    "wrench_trans": _wrench_trans,
}
"""Built-ins that only compute."""
