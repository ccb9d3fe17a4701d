"""Can the result be trusted? Findings in words, with codes."""

from collections.abc import Iterator

import numpy as np

from dynid.core import Array, Finding
from dynid.identification.bayesian import symbol_of
from dynid.identification.estimate import Estimate
from dynid.identification.problem import ILL_CONDITIONED
from dynid.signals import Samples

SMALL_RANGE = {False: 0.1, True: 0.02}
"""A joint that moves less hardly shows its inertia [rad; m where it slides]."""
SLOW = {False: 0.05, True: 0.01}
"""A joint that never moves faster shows no viscous friction [rad/s; m/s]."""
ONE_WAY = 0.05
"""Share of the moving samples in the rarer direction; below it, friction and gravity mix."""
UNCERTAIN_SHARE = 0.75
"""Share of parameters with more than 100 % standard deviation that makes a record poor."""
_EXCITE = "record an optimised excitation trajectory before the result is used for other motions"
CORRELATED = 0.3
"""Autocorrelation of the residuals at one sample that is worth saying."""
POSES = 200
CERTAIN = 3.0
"""Standard deviations below zero from which a value is negative beyond doubt."""


def diagnose(estimate: Estimate, samples: Samples) -> tuple[Finding, ...]:
    """Warnings about an estimate and the samples that it was fitted to."""
    return (
        *ill_conditioned(estimate, samples),
        *low_excitation(estimate, samples),
        *not_physical(estimate, samples),
        *non_white(estimate),
    )


def ill_conditioned(estimate: Estimate, samples: Samples) -> Iterator[Finding]:
    """Whether directions of the parameters are nearly invisible in the data."""
    number = estimate.motion_condition_number
    one_way = one_way_joints(samples)
    text: list[str] = []
    if number > ILL_CONDITIONED:
        text.append(
            f"the condition number of the motion is {number:.3g}: errors of torque can grow by "
            f"this factor elsewhere (good motions stay below {ILL_CONDITIONED:.0f})"
        )
    if 2 * len(one_way) > samples.joints:
        text.append(
            f"{len(one_way)} of {samples.joints} joints never turn back, so that friction cannot "
            "be told from gravity and only noise keeps the condition number at "
            f"{estimate.condition_number:.1e}"
        )
    if text:
        yield Finding(
            "ill_conditioned",
            "; ".join(text) + ". Some combinations of parameters are poorly excited",
            severity="error",
            value=number,
            next_step=_EXCITE,
        )


def one_way_joints(samples: Samples) -> tuple[int, ...]:
    """Joints that move in one direction only."""
    found: list[int] = []
    for j, speed in enumerate(samples.dq.T):
        moving = speed[np.abs(speed) > max(0.1 * np.abs(speed).max(), 1e-9)]
        if len(moving) and min((moving > 0).mean(), (moving < 0).mean()) < ONE_WAY:
            found.append(j)
    return tuple(found)


def low_excitation(estimate: Estimate, samples: Samples) -> Iterator[Finding]:
    """Joints that move little, slowly or one way only; too many uncertain parameters."""
    one_way = one_way_joints(samples)
    found: list[str] = []
    for j, name in enumerate(estimate.model.robot.joint_names):
        fastest, reach = float(np.abs(samples.dq[:, j]).max()), float(np.ptp(samples.q[:, j]))
        slides = estimate.model.robot.prismatic[j]
        unit = "m" if slides else "rad"
        if reach < SMALL_RANGE[slides]:
            found.append(f"{name} moves only {reach:.3f} {unit}")
        elif fastest < SLOW[slides]:
            found.append(f"{name} never exceeds {fastest:.3f} {unit}/s")
        elif j in one_way:
            found.append(f"{name} moves in one direction only")
    with np.errstate(invalid="ignore"):
        uncertain = int((estimate.relative_std_percent > 100).sum())
    if uncertain > UNCERTAIN_SHARE * len(estimate.values):
        found.append(
            f"{uncertain} of {len(estimate.values)} parameters have standard deviations above 100 %"
        )
    if found:
        yield Finding(
            "low_excitation",
            "the motion excites too little: " + "; ".join(found[:8]),
            severity="error",
            next_step=_EXCITE,
        )


def not_physical(estimate: Estimate, samples: Samples) -> Iterator[Finding]:
    """Friction or motor inertia below zero beyond doubt, or an indefinite mass matrix."""
    found = [
        f"{name} = {value:.3g} +- {std:.2g} {unit}"
        for name, value, std, unit in zip(
            estimate.names, estimate.values, estimate.std, estimate.units, strict=True
        )
        if symbol_of(name) in ("Fc", "Fv", "Im") and value < -CERTAIN * std
    ]
    advice = (
        "do not simulate or invert this model; --estimator sdp fits physically consistent bodies"
    )
    if found:
        text = f"significantly negative: {', '.join(found)}"
        yield Finding("negative_friction", text, next_step=advice)
    steps = [k for k, name in enumerate(estimate.names) if symbol_of(name) == "Fc"]
    negative = [k for k in steps if estimate.values[k] < -CERTAIN * estimate.std[k]]
    if 2 * len(negative) > len(steps):
        joints = tuple(int(estimate.names[k][2:]) - 1 for k in negative)
        text = "the sign of the torques is probably reversed"
        yield Finding("reversed", text, joints=joints, value=-1.0)
    smallest, std = smallest_mass_eigenvalue(estimate, samples)
    if smallest < -CERTAIN * std:
        size = f"{smallest:.2g} +- {std:.1g}"
        text = f"the mass matrix is not positive at some poses (eigenvalue {size})"
        yield Finding("indefinite_mass", text, value=smallest, std=std, next_step=advice)


def smallest_mass_eigenvalue(estimate: Estimate, samples: Samples) -> tuple[float, float]:
    """The smallest eigenvalue of the mass matrix over poses of the record, and its deviation."""
    model = estimate.model
    q = samples.q[np.linspace(0, samples.count - 1, min(POSES, samples.count)).astype(int)]
    mass = model.mass_matrix(q, estimate.standard_parameters())
    sizes, axes = np.linalg.eigh((mass + mass.transpose(0, 2, 1)) / 2)
    worst = int(np.argmin(sizes[:, 0]))
    # The eigenvalue v' M v is linear in the parameters.
    pose, axis = q[worst : worst + 1], axes[worst, :, :1].T
    still = np.zeros_like(pose)
    moved = model.stack(pose, still, axis) - model.stack(pose, still, still)
    row = (moved[list(estimate.independent), :, 0]) @ axis[0]
    return float(sizes[worst, 0]), float(np.sqrt(max(row @ estimate.covariance @ row, 0.0)))


def non_white(estimate: Estimate) -> Iterator[Finding]:
    """Whether the residuals are correlated in time."""
    rho: Array = estimate.residual_autocorrelation
    if rho.max(initial=0.0) > CORRELATED:
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = float(np.nanmedian(estimate.std / estimate.naive_std))
        yield Finding(
            "non_white_residuals",
            f"residuals are correlated in time (up to {rho.max():.2f} from sample to sample): "
            f"the standard deviations given allow for it; naive ones would be {ratio:.1f} times "
            "smaller",
        )
