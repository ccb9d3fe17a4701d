"""Shared inertias and laws of friction: an estimate for any joint temperatures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate
from dynid.identification.temperature import JointTemperatureLaw

BEYOND_K = 2.0
"""How far outside the records' temperatures a friction may be asked for without a word [K]."""
CHOICE = "friction at "
"""How the choice of temperatures begins, among an estimate's choices."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureModel:
    """What is needed to give an estimate for any temperatures; `write_temperature` keeps it."""

    estimate: Estimate
    """One estimate with the shared inertias; its friction is of no account."""
    laws: tuple[JointTemperatureLaw, ...]
    """One a joint."""
    temperature_degC: Array
    """(R, n) mean joint temperatures of the records [degC]."""
    places: tuple[tuple[int, ...], ...]
    """For each joint, which base parameters are its friction, in its law's order."""
    seen: tuple[tuple[int, ...], ...]
    """For each joint, where the records' friction stands in the covariance, record by record."""
    order: tuple[int, ...]
    """(r) where the base parameters stand in the covariance."""
    covariance: Array
    """(P, P) of the inertias and of every record's own parameters."""
    naive: Array
    """(P, P) the same as if residuals were not correlated in time."""
    warnings: tuple[Notice, ...] = ()

    @property
    def reference_degC(self) -> Array:
        """(n) temperatures in the middle of the records [degC]."""
        return np.array([law.reference_degC for law in self.laws])

    def estimate_at(self, temperature_degC: ArrayLike) -> Estimate:
        """The estimate for joint temperatures: it predicts, validates and exports as any other.

        Args:
            temperature_degC: One temperature, or (n) one a joint [degC].

        Raises:
            InputError: Another number of joints, or temperatures that are no numbers.
        """
        joints = len(self.laws)
        wanted = np.asarray(temperature_degC, dtype=np.float64)
        if wanted.shape not in ((), (joints,)) or not np.isfinite(wanted).all():
            raise InputError(
                "needs one temperature, or one a joint",
                value=temperature_degC,
                limit=f"{joints} joints",
            )
        wanted = np.broadcast_to(wanted, (joints,))
        known = self.estimate
        values, turn = known.values.copy(), np.zeros((len(self.order), len(self.covariance)))
        turn[np.arange(len(self.order)), self.order] = 1.0
        for degC, law, places, seen in zip(
            wanted.tolist(), self.laws, self.places, self.seen, strict=True
        ):
            values[list(places)] = law.at(degC)
            turn[list(places)] = 0.0
            turn[np.ix_(places, seen)] = law.sensitivity(degC) @ law.gain
        covariance, naive = (turn @ c @ turn.T for c in (self.covariance, self.naive))
        choices = [choice for choice in known.choices if not choice.startswith(CHOICE)]
        return replace(
            known,
            values=values,
            covariance=covariance,
            naive_std=np.sqrt(np.maximum(np.diag(naive), 0.0)),
            choices=(*choices, f"{CHOICE}{' '.join(f'{x:.3g}' for x in wanted)} degC"),
            warnings=beyond(self.laws, wanted.tolist()),
        )


def beyond(laws: Sequence[JointTemperatureLaw], wanted: Sequence[float]) -> tuple[Notice, ...]:
    """A word about temperatures [degC] that the records did not have; nothing if they had."""
    far = [
        f"joint {j + 1} at {degC:.3g} degC (records: {law.range_degC[0]:.3g} to "
        f"{law.range_degC[1]:.3g})"
        for j, (degC, law) in enumerate(zip(wanted, laws, strict=True))
        if not law.range_degC[0] - BEYOND_K <= degC <= law.range_degC[1] + BEYOND_K
    ]
    if not far:
        return ()
    return (Notice("extrapolated", f"temperatures beyond the records: {', '.join(far)}"),)
