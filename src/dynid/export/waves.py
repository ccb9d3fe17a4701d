"""Torque ripple as a list of waves, which is what generated code adds up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynid.export.model import ExportModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Wave:
    """C(s) cos(number q) + S(s) sin(number q), polynomials of s = clip(dq / speed, -1, 1)."""

    joint: int
    """In whose torque it is, from 0."""
    gear: int
    """The joint of q and dq, from 0."""
    speed: float
    """[rad/s or m/s]"""
    number: float
    """Periods a turn of q."""
    cosine: tuple[float, ...]
    """Coefficients of C by the power of s, from 0, `Fw` included [N.m or N]."""
    sine: tuple[float, ...]
    """Those of S."""


def ripple_waves(model: ExportModel) -> tuple[Wave, ...]:
    """The waves of a model; none where `Fw` is zero."""
    return tuple(_waves(model))


def _waves(model: ExportModel) -> Iterator[Wave]:
    for ripple in model.ripples:
        factor = float(model.terms["Fw"][ripple.joint])
        if not factor:
            continue
        left = factor * np.array(ripple.coefficients)
        for gear in ripple.gears:
            own, left = left[: gear.size], left[gear.size :]
            pairs = own.reshape(len(gear.waves), gear.powers, 2).tolist()
            for number, rows in zip(gear.waves, pairs, strict=True):
                yield Wave(
                    joint=ripple.joint,
                    gear=gear.joint,
                    speed=gear.speed,
                    number=number,
                    cosine=tuple(row[0] for row in rows),
                    sine=tuple(row[1] for row in rows),
                )
