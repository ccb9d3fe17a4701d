"""How well the delay of one joint can be known at all, for the cases of intervals.py.

    python benchmarks/delay_bound.py [--seed 1] [--count 40]

The Cramer-Rao bound of least squares that knows which joint is late and what white noise it has.
Inertias have the spread about published ones that the arms are drawn with, rotors are free.
`known`: friction is known; `amounts`: Coulomb, viscous and load friction of each joint are free;
`law`: so are breakaway, Stribeck velocity and presliding displacement. Standard deviations in ms.
Torques and their derivatives are MuJoCo's and the plant's, nothing of the identified model.
"""

import argparse
from dataclasses import replace

import numpy as np
from intervals import LateJoint, late_joint

from dynid.bench.plants import Plant
from dynid.core import Array

CONFIDENCE = 1.96
PERIOD_S = 10.0
STEP_S = 1e-3
"""Of the difference by the delay: a step of friction lies between two samples."""
SPREADS = {"mass": 0.1, "centre": 0.01, "second": 0.3}
"""Half widths of the uniform draws of `plant`: shares, and metres of the centre."""
AMOUNTS, SHAPES = ("coulomb", "viscous", "load"), ("stribeck", "stribeck_velocity", "presliding")
NO_PRESLIDING = 1e-5
"""Displacements below are none [rad]."""


def moved(values: Array, place: tuple[int, ...], step: float | Array) -> Array:
    """A copy with one entry changed."""
    out = values.copy()
    out[place] += step
    return out


def bounds(case: LateJoint) -> list[float]:
    """Deviations of the delay [ms]: `known`, `amounts`, `law`."""
    real, path, joint = case.real, case.path, case.joint
    n, count = real.robot.joints, round(PERIOD_S / float(path.t[1]))
    q, dq, ddq, t = (x[:count] for x in (path.q, path.dq, path.ddq, path.t))

    def torque(arm: Plant) -> Array:
        rigid = arm.torque(q, dq, ddq)
        # The second period: presliding has forgotten its start.
        friction = arm.friction(np.tile(dq, (2, 1)), np.tile(rigid, (2, 1)), float(t[1]))
        return rigid + friction[count:]

    def late(values: Array, by: float) -> Array:
        out = values.copy()
        out[:, joint] = np.interp(t - by, t, values[:, joint], period=PERIOD_S)
        return out

    whole, columns, spreads = torque(real), [], []

    def vary(name: str, values: Array, step: float, spread: float) -> None:
        change = torque(replace(real, **{name: values})) - whole
        columns.append(late(change / step, case.late_s))
        spreads.append(spread)

    for k in range(n):
        size, axes = np.linalg.eigh(real.second[k])
        vary("mass", moved(real.mass, (k,), 1e-4 * real.mass[k]), 1e-4, SPREADS["mass"])
        for a in range(3):
            vary("centre", moved(real.centre, (k, a), 1e-5), 1e-5, SPREADS["centre"])
            more = 1e-3 * size[a] * np.outer(axes[:, a], axes[:, a])
            vary("second", moved(real.second, (k,), more), 1e-3, SPREADS["second"])
        vary("armature", moved(real.armature, (k,), 1e-3), 1e-3, np.inf)
    ends = [len(columns)]
    for names in (AMOUNTS, SHAPES):
        for name in names:
            values = getattr(real, name)
            if name != "presliding" or values[joint] > NO_PRESLIDING:
                for j in range(n):
                    step = 1e-3 * max(float(values[j]), 1e-3)
                    vary(name, moved(values, (j,), step), step, np.inf)
        ends.append(len(columns))
    by_delay = (late(whole, case.late_s + STEP_S) - late(whole, case.late_s - STEP_S)) / 2 / STEP_S
    weight = np.sqrt(float(path.t[-1] + t[1]) / PERIOD_S) / real.torque_noise
    rows = np.array([(x * weight).ravel() for x in (by_delay, *columns)])
    # A uniform draw deviates by its half width over the root of three; what is free by anything.
    scale = np.array([np.inf, *spreads]) / np.sqrt(3)
    free = np.isinf(scale)
    scale[free] = 1 / np.maximum(np.linalg.norm(rows[free], axis=1), 1e-300)
    rows *= scale[:, None]
    inner = rows @ rows.T + np.diag(np.where(free, 1e-9, 1.0))
    return [1e3 * scale[0] * np.sqrt(np.linalg.inv(inner[: k + 1, : k + 1])[0, 0]) for k in ends]


def main() -> None:
    """Print a line a case, and how many delays can be known to 2 ms."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--count", type=int, default=40)
    words = asked.parse_args()
    found: list[list[float]] = []
    for seed in range(1000 * words.seed, 1000 * words.seed + words.count):
        case = late_joint(seed)
        found.append(bounds(case))
        cells = ", ".join(f"{std:.3f}" for std in found[-1])
        name = f"{seed} {case.real.robot.name} joint {case.joint + 1}, {1e3 * case.late_s:.1f} ms"
        print(f"{name}: known, amounts, law {cells}", flush=True)
    for name, stds in zip(("known", "amounts", "law"), np.array(found).T, strict=True):
        inside = int((CONFIDENCE * stds <= 2.0).sum())
        figures = f"median {np.median(stds):.2f} ms, largest {stds.max():.2f} ms"
        print(f"{name}: {inside} of {len(stds)} within 2 ms with 95 %, {figures}")


if __name__ == "__main__":
    main()
