"""How many planted faults could be seen at all, and how many of these the diagnosis names.

    python benchmarks/visible_faults.py [--seed S] [--clean N] [--each N] [--small]

The cases are those of `dynid bench verdicts`; only the diagnosis is run. Beside it stands an
observer that knows what no user does: the shape of each joint's friction (Stribeck curve,
presliding state, load), the noise, and the joint and kind of the fault. What it does not know are
the inertias (as published, with their spread) and the amounts of friction. A fault whose size is
less than `SEEN` of its standard deviations changes torques that far less than they are known:
nobody can name it.
"""

import sys
from collections import Counter
from dataclasses import replace
from time import process_time

import numpy as np
from shared.measuring import run

from dynid.bench import cases, recorded
from dynid.bench.plants import plant
from dynid.bench.verdicts import FAULTS, SAME, SIZES, Case, Judged, Recorded, run_verdicts
from dynid.core import Array, one_thread
from dynid.diagnosis import findings_of, link_prior
from dynid.diagnosis.diagnose import recording_of
from dynid.diagnosis.hypotheses import hypotheses
from dynid.diagnosis.residual import Recording, Reference
from dynid.signals import ProcessingSettings, process

SEEN = 4.0
PLAIN = {"ripple", "contact"}
"""Faults with no parameter of the arm beside them: these are always counted as visible."""


def standing_out(case: Case, joint: int | None) -> float:
    """Size of a fault over the standard deviation that the observer would have of it."""
    made = recorded(replace(case, fault=None))
    robot, n = made.robot, made.robot.joints
    rec = recording_of(robot, process(made.record, robot, ProcessingSettings()))
    real, step = plant(robot, case.seed), float(rec.t[1] - rec.t[0])
    dry = replace(real, load=0 * real.load, viscous=0 * real.viscous)
    loaded = replace(real, coulomb=0 * real.coulomb, viscous=0 * real.viscous)
    columns = np.zeros((14 * n, n, len(rec.t)))
    columns[: 12 * n] = rec.model.stack(rec.q, rec.dq, rec.ddq)
    for k, shape in enumerate((dry, loaded)):
        every = np.arange(n)
        columns[(12 + k) * n + every, every] = shape.friction(rec.dq, rec.tau, step).T
    columns = rec.average(columns)
    prior = link_prior(rec.robot)
    size = np.sqrt(np.square(rec.tau).mean(axis=0))
    tops = [np.maximum(np.abs(x).max(axis=0), 1e-6) for x in (rec.dq, rec.ddq)]
    spread = np.concatenate([*(3 * size / top for top in tops), np.full(2 * n, 2.0)])
    precision = np.zeros((14 * n, 14 * n))
    precision[: 10 * n, : 10 * n] = np.linalg.inv(prior[1])
    precision[range(10 * n, 14 * n), range(10 * n, 14 * n)] = 1 / np.square(spread)
    reference = Reference(
        recording=rec,
        columns=columns,
        torque=rec.average(rec.tau.T + rec.model.known_torque(rec.q).T),
        mean=np.concatenate([prior[0], np.zeros(4 * n)]),
        precision=precision,
        load=prior[0],
        shapes=slice(12 * n, 14 * n),
        period=0,
    )
    weights = rec.block / np.square(real.torque_noise)
    inner = np.einsum("pjt,qjt,j->pq", columns, columns, weights) + precision
    right = np.einsum("pjt,jt,j->p", columns, reference.torque, weights)
    values = np.linalg.solve(inner, right + precision @ reference.mean)
    change = _change(case, joint, rec, reference, values)
    mixed = np.einsum("pjt,jt,j->p", columns, change, weights)
    own = float(np.einsum("jt,jt,j->", change, change, weights))
    return float(np.sqrt(max(own - mixed @ np.linalg.solve(inner, mixed), 0.0)))


def _change(
    case: Case, joint: int | None, rec: Recording, reference: Reference, values: Array
) -> Array:
    """(n, T) what a fault adds to the torques, to first order in its size."""
    fault = case.fault or ""
    size, robot = FAULTS[fault] * SIZES[case.size], rec.robot
    if fault == "spring":
        assert joint is not None
        limit = np.where(np.isfinite(robot.limits.torque), robot.limits.torque, 50.0)
        torque = np.zeros(rec.q.shape)
        torque[:, joint] = size * limit[joint] * np.sin(1.3 * rec.q[:, joint] + 0.5)
        return rec.average(torque.T)
    kinds = SAME.get(fault, (fault,))
    whole = fault in ("gains", "delay", "clock", "tilt", "friction_drift")
    for rival in hypotheses(reference, values):
        own = fault == "payload" or rival.joints == (joint,)
        if rival.kind not in kinds or not (own or (whole and len(rival.joints) != 1)):
            continue
        sizes = np.zeros(len(rival.columns))
        if fault == "friction_drift":
            sizes[:] = size
        elif fault == "payload":
            sizes[:4] = size * np.array([1.0, 0.0, 0.0, 0.03])
        else:
            sizes[0] = np.radians(size) if fault == "tilt" else size
        return np.tensordot(sizes, rival.columns, axes=1)
    return np.zeros(reference.torque.shape)


@one_thread()
def main(seed: int = 0, clean: int = 4, each: int = 3, small: bool = False) -> None:
    """Print a line a case, of small faults too where asked, then the shares."""
    count: Counter[tuple[str, str]] = Counter()
    joints: list[int | None] = []

    def judge(made: Recorded) -> Judged:
        joints.append(made.joint)
        return Judged(
            findings=findings_of(made.record, made.robot),
            level="usable",
            t=made.validation.t,
            predicted=made.clean,
        )

    start = process_time()
    for case in cases(seed, clean, each):
        if case.fault and case.size == "small" and not small:
            continue
        (row,) = run_verdicts(judge, [case])
        size = case.size if case.fault else "clean"
        z = np.inf
        if case.fault in FAULTS and case.fault not in PLAIN:
            z = standing_out(case, joints[-1])
        print("ok   " if row.named else "wrong", case.label, f"{z:.1f}", *row.kinds, flush=True)
        count[size, "cases"] += 1
        count[size, "named"] += row.named
        count[size, "visible"] += z >= SEEN
        count[size, "visible and named"] += row.named and z >= SEEN
    for (size, what), number in sorted(count.items()):
        print(f"{size}: {what} {number}")
    print(f"{process_time() - start:.0f} s of CPU", file=sys.stderr)


if __name__ == "__main__":
    run(main)
