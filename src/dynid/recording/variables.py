"""Recordings made of named arrays (`.mat`, `.npz`): choose them, and turn them upright."""

import re
from collections import Counter
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, Finding, RecordError, UnclearRecordError, printable
from dynid.recording import headers, table
from dynid.recording.cells import factors_of, is_missing, past_midnight, stamp, taken_as_it_is
from dynid.recording.columns import conversions, select
from dynid.recording.names import parse_name, says_degrees

SLICE = re.compile(r"(.+?)\[(?::\s*,)?\s*([\d:+]+)\s*\]")
"""A variable and some of its columns: `data[:,1:7]`."""
_FEWEST = 24
"""Shorter arrays are no signals."""


def _unit_of(quantity: str, path: str) -> str:
    """The unit that a variable's path gives: `vel_rpm`, `rec.act_pos_mot_deg`."""
    match = SLICE.fullmatch(path)
    name = parse_name(match.group(1) if match else path)
    # The last word counts: a struct may be called after a pose, `at_30_deg.q`.
    if not name.unit and quantity in table.ANGLES and says_degrees(name.base):
        per_time = {"q": "", "qd": "/s", "qdd": "/s^2"}
        return "deg" + per_time[quantity.removeprefix("target_")]
    return name.unit


def _guess_variables(
    variables: Mapping[str, Array], joints: Sequence[str]
) -> tuple[dict[str, Array], dict[str, str], headers.Match]:
    """Quantity to array, quantity to path, and what the paths of the variables say.

    Raises:
        RecordError: The paths do not say what the arrays are, or several could be it.
    """
    # Parameters and settings stand beside the signals.
    paths = [path for path, x in variables.items() if path and max(x.shape, default=0) >= _FEWEST]
    paths = paths or list(variables)
    arrays: dict[str, Array] = {}
    labels: dict[str, str] = {}
    with _by_names(variables, paths):
        match = headers.match_headers(paths, joints)
    found = {name: [paths[k] for k in numbers] for name, numbers in match.columns.items()}
    _require_one_set(variables, found)
    with _by_names(variables, paths):
        for quantity, numbers in match.columns.items():
            if quantity == "t":
                continue
            parts = [variables[paths[k]] for k in numbers]
            labels[quantity] = paths[numbers[0]]
            arrays[quantity] = parts[0]
            if len(parts) > 1:
                if len({part.size for part in parts}) > 1 or len({*match.factors[quantity]}) > 1:
                    raise RecordError(
                        f"the variables of {quantity} are of different lengths or units",
                        value=[f"{paths[k]} {variables[paths[k]].shape}" for k in numbers],
                    )
                # One vector a joint.
                arrays[quantity] = np.column_stack([part.ravel() for part in parts])
    longest = max(arrays["q"].shape)
    for clock in match.clocks:
        if all(variables[paths[k]].size == longest for k in clock.columns):
            # Whole seconds and nanoseconds are two variables.
            arrays["t"] = table.stamps_of((clock,), lambda k: variables[paths[k]].ravel())["t"]
            labels["t"] = paths[clock.columns[0]]
            break
    return arrays, labels, match


@contextmanager
def _by_names(variables: Mapping[str, Array], paths: Sequence[str]) -> Generator[None]:
    """The variables in an error about their names."""
    try:
        yield
    except RecordError as error:
        known = error.value and not isinstance(error, headers.NotRecognised)
        shown = f" ({printable(str(error.value), 200)})" if known else ""
        raise UnclearRecordError(
            f"the variables cannot be recognised by their names: {error.what}{shown}",
            value="; ".join(f"{p} {variables[p].shape}" for p in paths[:25]),
            next_step="Name them with --columns, for example t=rec.time,q=rec.pos,effort=rec.tau, "
            "or t=0,q=1:7,effort=7:13 of the only matrix, of six joints.",
        ) from error


def _bare(path: str) -> str:
    """A path without the unit that HDF5 attributes add."""
    return path.partition(" [")[0]


def _require_one_set(variables: Mapping[str, Array], paths: Mapping[str, list[str]]) -> None:
    """Refuse several matrices of positions, as of two runs: one vector each would be a joint's.

    Raises:
        RecordError: There are several.
    """
    shapes = [variables[path].shape for path in paths["q"]]
    if len(shapes) > 1 and any(len(shape) == 2 and min(shape) > 1 for shape in shapes):
        # The time of one run may look like that of one joint: `trial_1.t`.
        stem = paths["q"][0].rpartition(".")[0]
        own = [path for path in variables if path.rpartition(".")[0] == stem]
        clocks = table.find_clocks([parse_name(path) for path in own], own, stem)
        chosen = {"t": [clocks[0].label]} | dict(paths) if clocks else paths
        columns = ",".join(f"{name}={_bare(found[0])}" for name, found in chosen.items())
        raise UnclearRecordError(
            f"{len(shapes)} sets of variables can be q",
            value=", ".join(paths["q"][:20]),
            next_step=f"Choose with --columns, for those of {paths['q'][0]}: --columns {columns}",
        )


_COLUMNS = re.compile(r"[\d:+]+")


def numbers_of(value: Any) -> Array | None:
    """A value as float64 array of one or two axes; None where it is none.

    Axes of length one, as Simulink and MATLAB have them, do not count, nor do imaginary parts.
    Dates, also in words, are in seconds since 1970, times of day and spans of time in seconds.
    """
    array: NDArray[Any] = np.asarray(value).squeeze()
    if array.dtype.kind == "U":
        return moments_of(array.ravel().tolist())
    if array.dtype.kind in "mM":
        array = (array - np.zeros((), array.dtype)) / np.timedelta64(1, "s")
    if array.ndim > 2 or array.dtype.kind not in "fiubc":
        return None
    with np.errstate(all="ignore"):
        return np.atleast_1d(np.asarray(np.real(array), dtype=np.float64))


def moments_of(cells: Iterable[str]) -> Array | None:
    """Seconds (N) of dates with a time, or of times of day, in words; None where they are none."""
    try:
        found = np.array([np.nan if is_missing(cell) else stamp(cell) for cell in cells])
    except ValueError:
        return None
    return past_midnight(found) if np.isfinite(found).any() else None


def table_of(
    variables: Mapping[str, Array],
    options: table.ReadOptions,
    names: Mapping[str, tuple[str, ...]],
) -> table.RawTable:
    """A raw table from named arrays.

    Arrays may be (N, n), (n, N) or flat (N n, sample after sample): the length of the time
    vector and the number of joints say which.

    Args:
        variables: Path (`rec.act_pos`) to array.
        options: Columns say quantity to variable path, `path[1:7]` for some columns of a
            matrix, or column numbers where there is one matrix only; None to go by the names.
        names: Path to the joint names that stand there; those beside the positions count.

    Raises:
        RecordError: No variable at all, one that is not there, or shapes that do not fit together.
    """
    if not variables:
        raise RecordError("there are no arrays of numbers")
    match = headers.Match(columns={}, clocks=())
    joints = len(options.joints) or None
    if options.columns is None:
        arrays, paths, match = _guess_variables(variables, options.joints)
    else:
        # HDF5 attributes add a unit to a path, which a user need not write.
        marked = {_bare(path): path for path in variables}
        paths = {
            name: marked.get(path)
            or SLICE.sub(lambda part: f"{marked.get(part[1], part[1])}[{part[2]}]", path)
            for name, path in options.columns.items()
        }
        arrays = {name: _pick(variables, name, path) for name, path in paths.items()}
    notes = list(match.notes)
    beside = _names_beside(variables, paths["q"], names) if "q" in paths else ()
    beside = match.joint_names or beside
    if beside and (joints is None or len(beside) > joints):
        joints = len(beside)
    if clock := _leading_clock(arrays, joints):
        arrays = {name: _whole(value)[:, 1:] for name, value in arrays.items() if name != "t"}
        arrays["t"], paths["t"] = clock
        notes.append("the first column (or row) of each array is the time")
    length = _length(arrays, joints)
    width = joints if joints is not None else _width(arrays, length)
    said = {name: unit for name, path in paths.items() if (unit := _unit_of(name, path))}
    factors: dict[str, tuple[float, ...]] = {}
    signals: dict[str, Array] = {}
    notices: list[Finding] = []
    for name, value in arrays.items():
        if name == "t":
            continue
        factors[name], unknown = factors_of(name, [said.get(name, "")])
        if name in match.said:
            # Of one vector a joint, whose name the path has beside the unit.
            factors[name], unknown = match.factors[name][:1], None
        if unknown is not None:
            notices.append(taken_as_it_is(name, paths[name], said.pop(name)))
        signals[name] = _upright(value, length, width, f"{name}={paths[name]}") * factors[name]
    rows = len(signals["q"])
    t = arrays["t"].ravel() if "t" in arrays else None
    if t is not None and len(t) != rows:
        raise RecordError(
            f"t={paths['t']} has {len(t)} values but q has {rows} samples", value=signals["q"].shape
        )
    notes.extend(conversions(factors))
    return table.RawTable(
        rows=np.arange(1, rows + 1, dtype=np.int64),
        row_word="sample",
        signals=signals,
        t=t,
        time_scale=parse_name(paths["t"]).time_scale if "t" in paths else None,
        labels={name: (path,) * signals["q"].shape[1] for name, path in paths.items()},
        said=match.said | frozenset(said),
        joint_names=beside if len(beside) == signals["q"].shape[1] else (),
        notes=tuple(notes),
        notices=tuple(notices),
    )


def _names_beside(
    variables: Mapping[str, Array], path: str, names: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """The joint names of a whole matrix of positions: those in its struct, or the only ones."""
    if path not in variables or variables[path].ndim < 2:
        return ()
    stem = path.rpartition(".")[0]
    near = [found for where, found in names.items() if where.rpartition(".")[0] == stem]
    found = near or list(names.values())
    return found[0] if len(found) == 1 and len(found[0]) in variables[path].shape else ()


def _leading_clock(arrays: Mapping[str, Array], joints: int | None) -> tuple[Array, str] | None:
    """The time that Simulink's To File puts before each signal; with a name for it.

    Where the number of joints is not known, only what several arrays share is a clock.
    """
    signals = [_whole(value) for name, value in arrays.items() if name != "t"]
    if not signals or any(value.ndim != 2 or value.shape[1] < 2 for value in signals):
        return None
    first = signals[0][:, 0]
    alike = all(np.array_equal(value[:, 0], first) for value in signals[1:])
    wide = joints is None or all(value.shape[1] == joints + 1 for value in signals)
    if not (alike and wide and (len(signals) > 1 or joints is not None)):
        return None
    return (first, "time") if table.rises(first) else None


def _whole(value: Array) -> Array:
    """A matrix with its samples down."""
    return value if value.ndim != 2 or value.shape[0] >= value.shape[1] else value.T


def _pick(variables: Mapping[str, Array], quantity: str, selector: str) -> Array:
    path, part = selector, None
    if selector not in variables and (match := SLICE.fullmatch(selector)):
        path, part = match.group(1).strip(), match.group(2)
    elif selector not in variables and _COLUMNS.fullmatch(selector):
        matrices = [name for name, value in variables.items() if min(value.shape, default=0) > 1]
        if len(matrices) != 1:
            what = f"columns: item '{quantity}={selector}' needs a variable name"
            raise RecordError(what, value=matrices[:20], next_step="Write it like q=data[1:7].")
        path, part = matrices[0], selector
    if path not in variables:
        raise RecordError(
            f"columns: item '{quantity}={selector}': there is no such variable of numbers",
            limit=", ".join(f"{p} {v.shape}" for p, v in list(variables.items())[:25]),
        )
    value = variables[path]
    if part is None:
        return value
    if value.ndim != 2:
        text = f"columns: item '{quantity}={selector}': {path} is no matrix"
        raise RecordError(text, value=value.shape)
    value = _whole(value)
    return value[:, select(quantity, part, value.shape[1], None)]


def _length(arrays: Mapping[str, Array], joints: int | None) -> int | None:
    """Number of samples N: the time vector's length, or what two or more arrays share."""
    if "t" in arrays:
        t = arrays["t"]
        if t.size != max(t.shape, default=0):
            raise RecordError("the time must be a vector", value=t.shape)
        return t.size
    axes = [size for value in arrays.values() if value.ndim == 2 for size in value.shape]
    sizes = Counter(size for size in axes if size != joints and size > 1)
    return max(sizes, key=lambda size: (sizes[size], size)) if sizes else None


def _width(arrays: Mapping[str, Array], length: int | None) -> int | None:
    """Number of joints n: what most arrays have for each of N samples."""
    sizes = [value.size for name, value in arrays.items() if name != "t"]
    counts = Counter(size // length for size in sizes if length and size % length == 0)
    return max(counts, key=lambda n: counts[n]) if counts else None


def _upright(value: Array, length: int | None, width: int | None, item: str) -> Array:
    """The array as (N, n)."""
    if value.ndim == 2 and 1 not in value.shape:
        if length in value.shape:
            return value if len(value) == length else value.T
    # Flat arrays hold one sample after the other.
    elif width and value.size % width == 0 and length in (None, value.size // width):
        return value.reshape(-1, width)
    elif length and value.size % length == 0:
        return value.reshape(length, -1)
    raise RecordError(
        f"{item} does not fit the samples and joints",
        value=value.shape,
        limit=f"{length or 'N'} samples, {width or 'n'} joints",
        next_step="Map the time vector, or give the robot, to know how it is laid out.",
    )
