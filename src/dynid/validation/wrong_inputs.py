"""Inputs that do not fit a record, in words."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate
from dynid.signals.samples import Samples
from dynid.validation.profile import Inputs, across
from dynid.validation.suspects import Suspicion, suspects

REVERSED = "only when reversed"


def suspicious_inputs(estimate: Estimate, samples: Samples) -> tuple[Notice, ...]:
    """`suspects` in words."""
    names, mount = estimate.model.robot.joint_names, estimate.model.robot.mount
    axes = estimate.model.robot.gravity
    return tuple(_words(found, names, mount, axes) for found in suspects(estimate, samples))


def _words(found: Suspicion, names: tuple[str, ...], mount: str, gravity: Array) -> Notice:
    if found.kind == "mounting":
        fits = " ".join(f"{x:.2f}" for x in gravity_of(found.inputs, gravity))
        text = (
            f"gravity fits the torques better when it stands {found.value:.1f} +- {found.std:.1f} "
            f"deg off the mounting ({mount}): [{fits}] m/s^2 in the base frame; level the base, or "
            "write it into the robot file ([mount] gravity)"
        )
        return Notice("unit_suspect", text)
    name = "" if found.joint is None else names[found.joint]
    if found.kind == "sign":
        text = f"the torques of {name} fit those of the other joints {REVERSED}: check "
        return Notice("unit_suspect", text + "the signs of its torque or current and position")
    others = ", ".join(f"{names[j]} {x:.3g} times" for j, x in found.others)
    text = (
        f"the torques of {name} are {found.value:.3g} +- {found.std:.2g} times as large as those "
        "of the other joints let expect"
        + (f" (nearly as likely: {others})" if others else "")
        + ": check its drive gain; its share of the parameters is scaled by it"
    )
    return Notice("unit_suspect", text)


def gravity_of(inputs: Inputs, gravity: Array) -> Array:
    """(3) gravity in the base frame [m/s^2] that inputs stand for, as strong as the robot's."""
    size = float(np.linalg.norm(gravity))
    turned = gravity + size * inputs.tilt @ across(gravity)
    return np.asarray(turned * (size / np.linalg.norm(turned)), dtype=np.float64)
