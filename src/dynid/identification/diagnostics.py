"""Can the result be trusted? Findings in words, with codes.

Whether the identified gravity looks like that of the masses that are known.
"""

from __future__ import annotations

import numpy as np

from dynid.constraints import prior_dynamics
from dynid.core import Array, Finding
from dynid.identification.bayesian import symbol_of
from dynid.identification.estimate import Estimate
from dynid.identification.problem import ILL_CONDITIONED
from dynid.signals import Samples

GRAVITY_POSES = 200
SEED = 0
LEAST_TORQUE = 0.02
"""Gravity below this share of the largest joint's says nothing about a joint's gain."""
WRONG_GAIN = 1.5
"""Gravity this many times too large or too small is no matter of masses that differ a little."""
UNLIKE = 0.5
"""Correlation below which the gravity is another one: of another mounting, or other joints."""


def implausible_gravity(estimate: Estimate) -> tuple[Finding, ...]:
    """Compare identified gravity torques with those of the robot's known masses.

    A wrong drive gain scales a joint's torques and leaves the fit perfect; only known masses can
    tell. A wrong mounting turns gravity.

    Args:
        estimate: The estimate.

    Returns:
        Nothing where masses are not known, or all is plausible.
    """
    robot = estimate.model.robot
    prior = prior_dynamics(robot)
    if prior is None:
        return ()
    reach = estimate.motion.upper - estimate.motion.lower
    numbers = np.random.default_rng(SEED)
    q = estimate.motion.lower + reach * numbers.random((GRAVITY_POSES, robot.joints))
    rest = np.zeros_like(q)
    known = prior.model.inverse_dynamics(q, rest, rest, prior.parameters)
    parameters = np.array(estimate.standard_parameters())
    parameters[10 * robot.joints :] = 0.0
    found = estimate.model.inverse_dynamics(q, rest, rest, parameters)
    size = np.sqrt(np.square(known).mean(axis=0))
    heavy = [int(j) for j in np.flatnonzero(size > LEAST_TORQUE * max(float(size.max()), 1e-9))]
    turned: list[str] = []
    scaled: list[str] = []
    for j in heavy:
        product = float(known[:, j] @ found[:, j])
        ratio = product / float(known[:, j] @ known[:, j])
        norm = float(np.linalg.norm(known[:, j]) * np.linalg.norm(found[:, j]))
        name = robot.joint_names[j]
        if norm == 0 or product / norm < UNLIKE:
            turned.append(name)
        elif not 1 / WRONG_GAIN < ratio < WRONG_GAIN:
            scaled.append(f"{name} {ratio:.2g} times")
    notices: list[Finding] = []
    if len(turned) > len(heavy) / 2:
        notices.append(
            Finding(
                "not_physical",
                f"gravity as identified is not that of the known masses ({', '.join(turned[:4])}): "
                f"check the mounting ({robot.mount}), the joint order and signs",
            )
        )
    if scaled:
        notices.append(
            Finding(
                "unit_suspect",
                "gravity torques differ from those of the known masses: "
                f"{', '.join(scaled[:4])} as large; check the drive gains, the mounting "
                f"({robot.mount}) and what the robot carries",
            )
        )
    return tuple(notices)


SMALL_RANGE = 0.1
"""[rad or m] a joint that moves less hardly shows its inertia."""
SLOW = 0.05
"""[rad/s or m/s] a joint that never moves faster shows no viscous friction."""
ONE_WAY = 0.05
"""Share of the moving samples in the rarer direction; below it, friction and gravity mix."""
UNCERTAIN_SHARE = 0.75
"""Share of parameters with more than 100 % standard deviation that makes a record poor."""
CORRELATED = 0.3
"""Autocorrelation of the residuals at one sample that is worth saying."""
POSES = 200


def diagnose(estimate: Estimate, samples: Samples) -> tuple[Finding, ...]:
    """Warnings about an estimate and the samples that it was fitted to."""
    return (
        *ill_conditioned(estimate, samples),
        *low_excitation(estimate, samples),
        *not_physical(estimate, samples),
        *non_white(estimate),
    )


def ill_conditioned(estimate: Estimate, samples: Samples) -> tuple[Finding, ...]:
    """Whether directions of the parameters are nearly invisible in the data."""
    number = estimate.motion_condition_number
    one_way = one_way_joints(samples)
    text: list[str] = []
    if number > ILL_CONDITIONED:
        text.append(
            f"the condition number is {estimate.condition_number:.1e} (of the motion alone, "
            f"columns scaled: {number:.0f}; good motions stay below {ILL_CONDITIONED:.0f})"
        )
    if 2 * len(one_way) > samples.joints:
        text.append(
            f"{len(one_way)} of {samples.joints} joints never turn back, so that friction cannot "
            "be told from gravity and only noise keeps the condition number at "
            f"{estimate.condition_number:.1e}"
        )
    if not text:
        return ()
    return (
        Finding(
            "ill_conditioned",
            "; ".join(text) + ". This motion hardly shows some combinations of parameters: "
            "it must not be used on other motions",
            severity="error",
            value=number,
            next_step="record an optimised excitation trajectory",
        ),
    )


def one_way_joints(samples: Samples) -> tuple[int, ...]:
    """Joints that move in one direction only."""
    found: list[int] = []
    for j, speed in enumerate(samples.dq.T):
        moving = speed[np.abs(speed) > max(0.1 * np.abs(speed).max(), 1e-9)]
        if len(moving) and min((moving > 0).mean(), (moving < 0).mean()) < ONE_WAY:
            found.append(j)
    return tuple(found)


def low_excitation(estimate: Estimate, samples: Samples) -> tuple[Finding, ...]:
    """Joints that move little, slowly or one way only; too many uncertain parameters."""
    one_way = one_way_joints(samples)
    found: list[str] = []
    for j, name in enumerate(estimate.model.robot.joint_names):
        fastest, reach = float(np.abs(samples.dq[:, j]).max()), float(np.ptp(samples.q[:, j]))
        if reach < SMALL_RANGE:
            found.append(f"{name} moves only {reach:.3f} rad or m")
        elif fastest < SLOW:
            found.append(f"{name} never exceeds {fastest:.3f} rad/s or m/s")
        elif j in one_way:
            found.append(f"{name} moves in one direction only")
    with np.errstate(invalid="ignore"):
        uncertain = int((estimate.relative_std_percent > 100).sum())
    if uncertain > UNCERTAIN_SHARE * len(estimate.values):
        found.append(
            f"{uncertain} of {len(estimate.values)} parameters have standard deviations above 100 %"
        )
    if not found:
        return ()
    return (
        Finding(
            "low_excitation",
            "the motion excites too little, and the result must not be used for other motions: "
            + "; ".join(found[:8]),
            severity="error",
        ),
    )


def not_physical(estimate: Estimate, samples: Samples) -> tuple[Finding, ...]:
    """Friction or motor inertia below zero beyond doubt, or an indefinite mass matrix."""
    found = [
        f"{name} = {value:.3g} +- {std:.2g} {unit}"
        for name, value, std, unit in zip(
            estimate.names, estimate.values, estimate.std, estimate.units, strict=True
        )
        if symbol_of(name) in ("Fc", "Fv", "Im") and value < -3 * std
    ]
    advice = (
        "do not simulate or invert this model; --estimator sdp fits physically consistent bodies"
    )
    told: list[Finding] = []
    if found:
        text = f"below zero beyond doubt: {', '.join(found)}"
        told.append(Finding("negative_friction", text, next_step=advice))
    steps = [
        k for k, name in enumerate(estimate.names) if name.startswith("Fc") and name[2:].isdigit()
    ]
    negative = [k for k in steps if estimate.values[k] < -3 * estimate.std[k]]
    if 2 * len(negative) > len(steps):
        joints = tuple(int(estimate.names[k][2:]) - 1 for k in negative)
        told.append(
            Finding("reversed", "the sign of the torques looks reversed", joints=joints, value=-1.0)
        )
    smallest = smallest_mass_eigenvalue(estimate, samples)
    if smallest < 0:
        text = f"the mass matrix is not positive at some poses (eigenvalue {smallest:.2g})"
        told.append(Finding("indefinite_mass", text, value=smallest, next_step=advice))
    return tuple(told)


def smallest_mass_eigenvalue(estimate: Estimate, samples: Samples) -> float:
    """The smallest eigenvalue of the mass matrix over poses of the record."""
    n = samples.joints
    q = samples.q[np.linspace(0, samples.count - 1, min(POSES, samples.count)).astype(int)]
    rest = np.zeros_like(q)
    gravity = estimate.predict(q, rest, rest)
    mass = np.empty((len(q), n, n))
    for k in range(n):
        unit = rest.copy()
        unit[:, k] = 1.0
        mass[:, :, k] = estimate.predict(q, rest, unit) - gravity
    return float(np.linalg.eigvalsh((mass + mass.transpose(0, 2, 1)) / 2).min())


def non_white(estimate: Estimate) -> tuple[Finding, ...]:
    """Whether the residuals are correlated in time."""
    rho: Array = estimate.residual_autocorrelation
    if rho.max(initial=0.0) <= CORRELATED:
        return ()
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(np.nanmedian(estimate.std / estimate.naive_std))
    return (
        Finding(
            "non_white_residuals",
            f"residuals are correlated in time (up to {rho.max():.2f} from sample to sample): "
            f"the standard deviations given allow for it; naive ones would be {ratio:.1f} times "
            "smaller",
        ),
    )
