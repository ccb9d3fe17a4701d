"""Named arrays that nobody maps: what their paths say of quantities and units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dynid.core import Array, RecordError
from dynid.recording.headers import match_headers
from dynid.recording.layout import suggest_columns
from dynid.recording.naming import parse_name, says_degrees
from dynid.recording.table import ANGLES, plain

SLICE = re.compile(r"(.+?)\[(?::\s*,)?\s*([\d:+]+)\s*\]")
"""A variable and some of its columns: `data[:,1:7]`."""
_FEWEST = 24
"""Shorter arrays are no signals."""


def unit_of(quantity: str, path: str) -> str:
    """The unit that a variable's name gives: `vel_rpm`, `rec.act_pos_mot_deg`.

    Args:
        quantity: What the variable holds.
        path: Its path, with or without a choice of columns.
    """
    match = SLICE.fullmatch(path)
    name = parse_name(match.group(1) if match else path)
    # The last word counts: a struct may be called after a pose, `at_30_deg.q`.
    if not name.unit and quantity in ANGLES and says_degrees(name.base):
        return {"q": "deg", "target_q": "deg"}.get(
            quantity, "deg/s^2" if quantity.endswith("qdd") else "deg/s"
        )
    return name.unit


def guess_variables(
    variables: Mapping[str, Array], where: str, joints: Sequence[str]
) -> tuple[dict[str, Array], dict[str, str], list[str]]:
    """Find the quantities by the paths of the variables.

    Args:
        variables: Path to array.
        where: The file, for messages.
        joints: The robot's joint names; empty if it is not known.

    Returns:
        Quantity to array, quantity to path, and choices in words.

    Raises:
        RecordError: The paths do not say what the arrays are, or several could be it.
    """
    # Parameters and settings stand beside the signals.
    paths = [
        path for path, value in variables.items() if path and max(value.shape, default=0) >= _FEWEST
    ]
    paths = paths or list(variables)
    try:
        match = match_headers(paths, where, joints)
        arrays: dict[str, Array] = {}
        labels: dict[str, str] = {}
        for quantity, numbers in match.columns.items():
            if quantity == "t":
                continue
            parts = [variables[paths[k]] for k in numbers]
            labels[quantity] = paths[numbers[0]]
            arrays[quantity] = parts[0]
            if len(parts) > 1:
                if len({part.size for part in parts}) > 1:
                    raise RecordError(
                        f"the variables of {quantity} are of different lengths",
                        where=where,
                        value=[f"{paths[k]} {variables[paths[k]].shape}" for k in numbers],
                    )
                # One vector a joint.
                arrays[quantity] = np.column_stack([part.ravel() for part in parts])
    except RecordError as error:
        raise RecordError(
            f"the variables do not say what they are: {error.what}"
            + (
                f" ({plain(str(error.value), 200)})"
                if error.value and "no col" not in error.what
                else ""
            ),
            where=where,
            value="; ".join(f"{p} {variables[p].shape}" for p in paths[:25]),
            next_step=_by_numbers(variables, joints)
            or "Name them with --columns, for example t=rec.time,q=rec.pos,effort=rec.tau.",
        ) from error
    clocks = [clock for clock in match.clocks if len(clock.columns) == 1]
    longest = max(arrays["q"].shape)
    for clock in clocks:
        path = paths[clock.columns[0]]
        if variables[path].size == longest:
            arrays["t"], labels["t"] = variables[path], path
            break
    return arrays, labels, list(match.notes)


def _by_numbers(variables: Mapping[str, Array], joints: Sequence[str]) -> str:
    """What the numbers of one wide matrix tell of its columns; nothing where there are more."""
    matrices = [value for value in variables.values() if value.ndim == 2]
    if len(matrices) != 1:
        return ""
    tall = matrices[0] if matrices[0].shape[0] >= matrices[0].shape[1] else matrices[0].T
    return suggest_columns(tall, len(joints) or None)
