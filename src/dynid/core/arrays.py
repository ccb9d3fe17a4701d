"""Read-only arrays with checked shapes, triangular factors, files of arrays; bounds of motions."""

import zlib
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from reprlib import Repr
from threading import Lock
from types import MappingProxyType
from typing import Any, cast
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.core.errors import InputError
from dynid.core.files import in_one_piece

Array = NDArray[np.float64]
"""A float64 array; shape and unit stand in each field's docstring."""
Indices = NDArray[np.intp]
"""An array of indices."""
Mask = NDArray[np.bool_]
"""An array of truth values."""


class _Short(Repr):
    """Values within a value by their type alone, arrays by their shape unless they are short."""

    def repr_ndarray(self, x: Array, level: int) -> str:
        few = x.ndim == 1 and x.size <= self.maxtuple
        return f"array({[float(f'{v:.6g}') for v in x]})" if few else f"array{x.shape}"

    def repr_mappingproxy(self, x: Mapping[str, Any], level: int) -> str:
        return self.repr_dict(dict(x), level)

    def repr_instance(self, x: Any, level: int) -> str:
        return f"{type(x).__name__}(...)" if is_dataclass(x) else super().repr_instance(x, level)


_SHORT = _Short()


def _same(a: Any, b: Any) -> bool:
    """Whether two values are equal, arrays within them by shape and numbers; NaN equals NaN."""
    if type(a) is not type(b):
        # NumPy would compare it with each item.
        array = isinstance(a, np.ndarray) or isinstance(b, np.ndarray)
        return not array and bool(a == b)
    if isinstance(a, np.ndarray):
        left, right = cast("Array", a), cast("Array", b)
        return np.array_equal(left, right, equal_nan=left.dtype.kind == right.dtype.kind == "f")
    if isinstance(a, tuple | list):
        items, others = cast("list[Any]", a), cast("list[Any]", b)
        return len(items) == len(others) and all(map(_same, items, others))
    if isinstance(a, Mapping):
        items, others = cast("Mapping[Any, Any]", a), cast("Mapping[Any, Any]", b)
        return items.keys() == others.keys() and all(_same(items[k], others[k]) for k in items)
    if is_dataclass(cast("object", a)):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b) or (a != a and b != b)


def _made(kind: type, given: dict[str, Any]) -> Any:
    return kind(**given)


class Value:
    """A dataclass with arrays: equal to one of its type where all fields are, shown in short.

    Copies, and those in other processes, are made anew: read-only, from mappings that can travel.
    """

    __slots__ = ()

    def __init_subclass__(cls) -> None:
        # In the class itself: a dataclass writes its own there otherwise, which fails on arrays.
        for name in {"__eq__", "__repr__"} - set(vars(cls)):
            setattr(cls, name, getattr(Value, name))

    def __eq__(self, other: object) -> bool:
        return _same(self, other) if type(self) is type(other) else NotImplemented

    def __repr__(self) -> str:
        shown = (f.name for f in fields(cast("Any", self)) if f.repr)
        items = (f"{name}={_SHORT.repr(getattr(self, name))}" for name in shown)
        return f"{type(self).__name__}({', '.join(items)})"

    def __reduce__(self) -> tuple[Any, ...]:
        given = {f.name: getattr(self, f.name) for f in fields(cast("Any", self)) if f.init}
        given |= {k: v.copy() for k, v in given.items() if isinstance(v, MappingProxyType)}
        return _made, (type(self), given)


def frozen(
    values: ArrayLike, *, shape: tuple[int | None, ...] | None, name: str, finite: bool = True
) -> Array:
    """A read-only float64 copy of `values`.

    Args:
        values: Anything array-like.
        shape: Expected shape; None lets an axis have any length, or all of it be any.
        name: The name used in the error.
        finite: Refuse NaN and infinity.

    Raises:
        InputError: Wrong shape, not real numbers, or not finite.
    """
    if np.ma.is_masked(values):
        raise InputError(f"{name} has masked values", next_step="Leave these rows out.")
    try:
        given = np.asarray(values)
        # NumPy would take the imaginary parts away, and count dates in units of their own.
        array = given if given.dtype.kind in "cmM" else np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be numbers", value=values) from error
    if array.dtype.kind in "mM":
        step = "Pass seconds: (values - values[0]) / np.timedelta64(1, 's')."
        raise InputError(f"{name} must be numbers, not dates or durations", next_step=step)
    if array.dtype.kind == "c":
        raise InputError(f"{name} must be real numbers", value="complex")
    fits = shape is None or (
        array.ndim == len(shape)
        and all(want is None or want == got for want, got in zip(shape, array.shape, strict=True))
    )
    if not fits:
        raise InputError(
            f"{name} has the wrong shape",
            value=array.shape,
            limit=str(shape).replace("None", "any"),
        )
    if finite and not np.isfinite(array).all():
        first = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name} is not finite at index {first}", value=float(array[first]))
    array.setflags(write=False)
    return array


def freeze(
    owner: object, label: str = "", /, *, finite: bool = True, **shapes: tuple[int | None, ...]
) -> None:
    """Put read-only copies of arrays in the fields of a frozen dataclass.

    Args:
        owner: The dataclass, in its `__post_init__`.
        label: What stands before the fields' names in errors.
        finite: Refuse NaN and infinity.
        **shapes: Field to expected shape, see `frozen`.

    Raises:
        InputError: As `frozen`.
    """
    for field, shape in shapes.items():
        name = f"{label} {field}".strip()
        value = frozen(getattr(owner, field), shape=shape, name=name, finite=finite)
        object.__setattr__(owner, field, value)


def read_only(array: Array) -> Array:
    """The same array, marked read-only without a copy."""
    array.setflags(write=False)
    return array


def scipy_part(name: str) -> Any:
    """A package of SciPy, such as `signal`, at its first use.

    Commands that need none of it would start two to three times as slowly.
    """
    return import_module(f"scipy.{name}")


@lru_cache(maxsize=1)
def _blas() -> Any:
    """What sets the threads of NumPy's BLAS and of SciPy's own; looking for both takes long."""
    scipy_part("linalg")
    return import_module("threadpoolctl").ThreadpoolController()


_limiting = Lock()
_limits: list[Any] = []
"""The limit of the process, once for each that is within `one_thread` now."""


@contextmanager
def one_thread() -> Generator[None]:
    """Matrices of fifty columns gain nothing from more threads, which only wait for each other.

    The number is the process's: the last of several threads of Python to leave restores it.
    """
    blas = _blas()
    with _limiting:
        _limits.append(_limits[0] if _limits else blas.limit(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _limiting:
            limit = _limits.pop()
            if not _limits:
                limit.restore_original_limits()


def upper_triangle(matrix: Array) -> Array:
    """The square upper triangle R of a QR of (M, k), zero rows added where M < k."""
    width = matrix.shape[1]
    factor = scipy_part("linalg").qr(matrix, mode="r", check_finite=False)
    upper = np.asarray(factor[0], dtype=np.float64)[:width]
    return np.vstack([upper, np.zeros((width - len(upper), width))])


def solve_upper(upper: Array, right: Array) -> Array:
    """Solve R x = b for upper triangular R (k, k) and b (k) or (k, m)."""
    solution = scipy_part("linalg").solve_triangular(upper, right)
    return np.asarray(solution, dtype=np.float64)


def inverse_upper(upper: Array) -> Array:
    """The inverse of an upper triangular (k, k) matrix."""
    return solve_upper(upper, np.eye(len(upper)))


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays under their names in one piece, compressed.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    with in_one_piece(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def read_arrays(path: Path) -> dict[str, Any]:
    """What `write_arrays` wrote; nothing where there is no such file, or a damaged one."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return dict(stored)
    # A damaged entry may ask for a password, or for a compression that does not exist.
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error, RuntimeError):
        return {}


SMALLEST = 1e-9
"""Of limits of speed and acceleration: with less, squares of what is used overflow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionBounds(Value):
    """Bounds of position, velocity and acceleration, one number a joint.

    Raises:
        InputError: Shapes that disagree, a lower limit above its upper one, one that is infinite
            beside one that is not, or another limit that is not positive.
    """

    lower: Array
    """(n) smallest positions [rad or m], NaN if unknown."""
    upper: Array
    """(n) largest positions [rad or m], NaN if unknown."""
    velocity: Array
    """(n) largest speeds [rad/s or m/s], NaN if unknown."""
    acceleration: Array
    """(n) largest accelerations [rad/s^2 or m/s^2], NaN if unknown."""

    def __post_init__(self) -> None:
        names = [item.name for item in fields(self)]
        freeze(self, "limit", finite=False, **dict.fromkeys(names, (np.size(self.lower),)))
        for name in names[2:]:
            value = getattr(self, name)
            if (value < SMALLEST).any():
                raise InputError(
                    f"the {name} limits must be positive",
                    value=value.tolist(),
                    limit=f"{SMALLEST:g} or more",
                )
        if (self.lower > self.upper).any():
            joint = int(np.argmax(self.lower > self.upper))
            raise InputError(
                f"joint {joint + 1}: lower position limit above the upper one",
                value=float(self.lower[joint]),
                limit=float(self.upper[joint]),
            )

        one_sided = np.isinf(self.lower) != np.isinf(self.upper)
        if one_sided.any():
            joint = int(np.argmax(one_sided))
            raise InputError(
                f"joint {joint + 1}: one position limit is infinite and the other is not",
                value=(float(self.lower[joint]), float(self.upper[joint])),
                limit="both, neither, or NaN for one that is unknown",
            )

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.lower)

    @property
    def motion(self) -> "MotionBounds":
        """These four bounds alone, without what limits that extend them know besides."""
        names = (item.name for item in fields(MotionBounds))
        return MotionBounds(**{name: getattr(self, name) for name in names})
