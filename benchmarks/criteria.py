"""What each design criterion buys: torque errors on held-out motions of an independent plant.

The plant is pinocchio's regressor on the UR5's kinematics and masses, with Gaussian torque noise
and weighted least squares; its base parameters are found here by a QR decomposition of their own.
Torques are linear in the parameters, so the deviation of a prediction follows from the covariance
C of the estimate, sqrt(mean Y C Y'), without sampling. Held-out motions: 10 of the whole workspace
and 10 pick-and-place motions, all safe; no design sees them.

The columns of the table are means over the seeds:
  held-out   deviation of the predicted torque over the joint's noise, averaged over joints
  friction   the same where the plant has Stribeck and load friction that the model lacks
  worst      largest standard deviation of a base parameter (DH frames, first-come, SI units)

Needs pinocchio: pip install 'dynid[dev]'. Options: --seeds N (10), --starts N (4), --only A;B,
--no-collision.
"""

import itertools
import time

import numpy as np
from shared.measuring import run
from shared.pinocchio_arm import Array, PinocchioArm

from dynid import DesignSettings, design, load_robot, random_excitation
from dynid.constraints import MotionConstraints, safe_constraints
from dynid.core import one_thread
from dynid.trajectory import JointMotion, Quintic

NOISE = np.array([2.0, 2.5, 1.5, 0.4, 0.4, 0.3])
COULOMB = np.array([9.8, 10.7, 10.5, 1.7, 1.6, 1.6])
STRIBECK, STRIBECK_SPEED, LOAD = 0.15, 0.06, 0.03
"""Breakaway over Coulomb friction, its speed [rad/s], friction over load: as the simulated UR5."""
RATE_HZ = 125.0
HOME = np.array([0.0, -1.5, 1.5, -1.5, -1.5, 0.0])
REACH = np.array([0.9, 0.4, 0.5, 0.4, 0.3, 1.5])
CRITERIA: dict[str, dict[str, object]] = {
    "cond": {"purpose": "cond"},
    "cond, 10 harmonics": {"purpose": "cond", "harmonics": 10},
    "prediction": {},
    "prediction, 5 harmonics": {"harmonics": 5},
    "parameters": {"purpose": "parameters", "harmonics": 5},
    "d-opt": {"criterion": "d-opt", "harmonics": 5},
    "e-opt": {"criterion": "e-opt", "harmonics": 5},
    "cond+sigma": {"criterion": "cond+sigma", "harmonics": 5},
    "ga": {"purpose": "cond", "method": "ga"},
}


class Plant(PinocchioArm):
    """Pinocchio's arm with the paper's friction columns.

    Args:
        name: A UR arm.
        noise: Standard deviation of each joint's torque [N.m].
    """

    def __init__(self, name: str = "ur5", noise: Array = NOISE) -> None:
        super().__init__(load_robot(name))
        self.noise, n = noise, self.robot.joints
        random = np.random.default_rng(1)
        w = self.rows(*random.uniform(-3, 3, (3, 60, n))).reshape(60 * n, -1)
        norms = np.linalg.norm(w, axis=0)
        scaled = w[:, norms > 0] / norms[norms > 0]
        pivots = np.abs(np.diag(np.linalg.qr(scaled, mode="r")))
        self.base = np.flatnonzero(norms > 0)[pivots > 1e-8]
        assert len(self.base) == np.linalg.matrix_rank(scaled, 1e-8)

    def base_rows(self, motion: JointMotion) -> Array:
        """(N, n, b) rows of the base parameters."""
        return self.rows(motion.q, motion.dq, motion.ddq)[:, :, self.base]

    def over_noise(self, motion: JointMotion) -> Array:
        """(n N, b) rows of the base parameters over the noise of their joint."""
        return (self.base_rows(motion) / self.noise[:, None]).reshape(-1, len(self.base))

    def more_friction(self, motion: JointMotion) -> Array:
        """(N, n) Stribeck and load friction, which the model does not have [N.m]."""
        load, dq = self.rigid(motion.q, motion.dq, motion.ddq), motion.dq
        dry = STRIBECK * COULOMB * np.exp(-np.square(dq / STRIBECK_SPEED)) + LOAD * np.abs(load)
        return dry * np.tanh(dq / 0.001)


class Judge:
    """Held-out motions, and what an estimate from a design is worth on them."""

    def __init__(self, plant: Plant, limits: MotionConstraints) -> None:
        self.plant = plant
        motions = [*_whole_workspace(plant, limits, 10), *_task(limits, 10)]
        self.rows = [plant.base_rows(motion) for motion in motions]
        self.friction = [plant.more_friction(motion) for motion in motions]

    def variances(self, root: Array) -> Array:
        """(20, n) variance of the predicted torques [N.m^2], for a root (b, b) of a covariance."""
        return np.array([np.square(rows @ root).sum(axis=2).mean(axis=0) for rows in self.rows])

    def variance(self, covariance: Array) -> Array:
        """(n) variance of the predicted torques over that of the noise, for (b, b)."""
        found = self.variances(np.linalg.cholesky(covariance))
        return found.mean(axis=0) / np.square(self.plant.noise)

    def judge(self, motion: JointMotion) -> dict[str, float]:
        """The figures of a motion."""
        plant = self.plant
        q, r = np.linalg.qr(plant.over_noise(motion))
        root = np.linalg.inv(r)
        bias = root @ (q.T @ (plant.more_friction(motion) / plant.noise).ravel())
        noise = self.variances(root)
        wrong = np.array(
            [
                np.square(rows @ bias - extra).mean(axis=0)
                for rows, extra in zip(self.rows, self.friction, strict=True)
            ]
        )

        def deviation(variances: Array) -> float:
            return float(np.mean(np.sqrt(variances.mean(axis=0)) / plant.noise))

        return {
            "held-out": deviation(noise),
            "whole": deviation(noise[:10]),
            "task": deviation(noise[10:]),
            "friction": deviation(noise + wrong),
            "worst": float(np.linalg.norm(root, axis=1).max()),
            "cond": float(np.linalg.cond(plant.base_rows(motion).reshape(-1, len(root)))),
            "cpu": 0.0,
        }


def _whole_workspace(plant: Plant, limits: MotionConstraints, count: int) -> list[JointMotion]:
    found: list[JointMotion] = []
    for seed in itertools.count(1000):
        series = random_excitation(plant.robot.limits, seed=seed, acceleration=15.0)
        motion = series.evaluate(np.arange(round(10 * RATE_HZ)) / RATE_HZ)
        for share in 0.8 ** np.arange(8):
            q = series.offset + share * (motion.q - series.offset)
            smaller = JointMotion(t=motion.t, q=q, dq=share * motion.dq, ddq=share * motion.ddq)
            if _safe(limits, smaller):
                found.append(smaller)
                break
        if len(found) == count:
            break
    return found


def _task(limits: MotionConstraints, count: int) -> list[JointMotion]:
    found: list[JointMotion] = []
    random = np.random.default_rng(77)
    while len(found) < count:
        poses = HOME + random.uniform(-1, 1, (7, 6)) * REACH
        legs = []
        for start, goal in itertools.pairwise(poses):
            leg = Quintic(start=start, goal=goal, travel_time=1.6)
            legs.append(leg.evaluate(np.arange(200) / RATE_HZ))
        q, dq, ddq = (np.vstack([getattr(x, k) for x in legs]) for k in ("q", "dq", "ddq"))
        motion = JointMotion(t=np.arange(len(q)) / RATE_HZ, q=q, dq=dq, ddq=ddq)
        if _safe(limits, motion):
            found.append(motion)
    return found


def _safe(limits: MotionConstraints, motion: JointMotion) -> bool:
    part = slice(None, None, 5)
    return limits.violation(motion.q[part], motion.dq[part], motion.ddq[part])[0] == 0.0


@one_thread()
def main(seeds: int = 10, starts: int = 4, only: str = "", no_collision: bool = False) -> None:
    plant = Plant()
    limits = safe_constraints(plant.robot, collision=not no_collision)
    judge = Judge(plant, limits)
    print(f"{'criterion':26} held-out (min .. max)      whole  task  friction  worst   cond  CPU s")
    random = [judge.judge(motion) for motion in _whole_workspace(plant, limits, 40)]
    _print("random, best cond of 40", [min(random, key=lambda row: row["cond"])])
    for name, words in CRITERIA.items():
        if only and name not in only.split(";"):
            continue
        rows = []
        for seed in range(seeds):
            began = time.process_time()
            settings = DesignSettings(
                seed=seed,
                starts=starts if words.get("method") != "ga" else None,
                noise=None if words.get("purpose") == "cond" else tuple(NOISE),
                collision=not no_collision,
                **words,
            )
            found = design("ur5", settings)
            assert found.feasible
            times = np.arange(round(found.trajectory.duration * RATE_HZ)) / RATE_HZ
            row = judge.judge(found.trajectory.evaluate(times))
            row |= {"cond": found.condition_number, "cpu": time.process_time() - began}
            rows.append(row)
        _print(name, rows)


def _print(name: str, rows: list[dict[str, float]]) -> None:
    held = [row["held-out"] for row in rows]
    mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    print(
        f"{name:26} {mean['held-out']:.4f} ({min(held):.4f} .. {max(held):.4f})  "
        f"{mean['whole']:.4f} {mean['task']:.4f} {mean['friction']:.4f} {mean['worst']:6.3f} "
        f"{mean['cond']:6.0f} {mean['cpu']:6.1f}",
        flush=True,
    )


if __name__ == "__main__":
    run(main)
