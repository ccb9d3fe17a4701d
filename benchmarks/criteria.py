"""What each design criterion buys: torque errors on held-out motions of an independent plant.

The plant is pinocchio's regressor on the UR5's kinematics and masses, with Gaussian torque noise
and weighted least squares; its base parameters are found here by an SVD and a QR of their own.
Torques are linear in the parameters, so the deviation of a prediction follows from the covariance
C of the estimate, sqrt(mean Y C Y'), without sampling; `--monte-carlo` samples it as well. Held-out
motions: 10 of the whole workspace and 10 pick-and-place motions, all safe; no design sees them.

The columns of the table are means over the seeds:
  held-out   deviation of the predicted torque over the joint's noise, averaged over joints
  friction   the same where the plant has Stribeck and load friction that the model lacks
  worst      largest standard deviation of a base parameter (DH frames, first-come, SI units)

Needs pinocchio: pip install 'dynid[dev]'. Options: --seeds N (10), --starts N (4), --only A;B,
--no-collision, --paper, --monte-carlo N; --motions DIR judges motions that another program planned
(npz files of q, dq, ddq at 125 Hz) in place of designs.
"""

from __future__ import annotations

import argparse
import itertools
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dynid import DesignSettings, design, load_robot, random_excitation
from dynid.constraints import MotionConstraints, paper_constraints, safe_constraints
from dynid.trajectory import JointMotion, Quintic

Array = NDArray[np.float64]
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


class Plant:
    """Pinocchio's arm with the paper's friction columns.

    Args:
        name: A UR arm.
        noise: Standard deviation of each joint's torque [N.m].
    """

    def __init__(self, name: str = "ur5", noise: Array = NOISE) -> None:
        self.robot = load_robot(name)
        self.noise = noise
        n = self.robot.joints
        self.model = pin.Model()
        parent = 0
        for k in range(n):
            joint = pin.JointModelRevoluteUnaligned(self.robot.axes[k])
            parent = self.model.addJoint(parent, joint, pin.SE3(self.robot.placements[k]), f"j{k}")
            mass = float(self.robot.inertias[k, 0])
            body = pin.Inertia(mass, self.robot.inertias[k, 1:4] / mass, mass * 0.004 * np.eye(3))
            self.model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        self.model.gravity.linear = np.array(self.robot.gravity)
        self.data = self.model.createData()
        self.frames = [_frame_map(frame) for frame in self.robot.parameter_frames["dh"]]
        random = np.random.default_rng(1)
        w = self.rows(*random.uniform(-3, 3, (3, 60, n))).reshape(60 * n, -1)
        norms = np.linalg.norm(w, axis=0)
        scaled = w[:, norms > 0] / norms[norms > 0]
        pivots = np.abs(np.diag(np.linalg.qr(scaled, mode="r")))
        self.base = np.flatnonzero(norms > 0)[pivots > 1e-8]
        assert len(self.base) == np.linalg.matrix_rank(scaled, 1e-8)

    def rows(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(N, n, 13 n) regressor: inertial columns in DH frames, Coulomb, viscous, motor."""
        n, own = self.robot.joints, np.arange(self.robot.joints)
        out = np.zeros((len(q), n, 13 * n))
        for k in range(len(q)):
            out[k, :, : 10 * n] = pin.computeJointTorqueRegressor(
                self.model, self.data, q[k], dq[k], ddq[k]
            )
        for k, turn in enumerate(self.frames):
            out[..., 10 * k : 10 * k + 10] = out[..., 10 * k : 10 * k + 10] @ turn
        out[:, own, 10 * n + own] = np.tanh(dq / 0.001)
        out[:, own, 11 * n + own] = dq
        out[:, own, 12 * n + own] = ddq
        return out

    def over_noise(self, motion: JointMotion) -> Array:
        """(n N, b) rows of the base parameters over the noise of their joint."""
        w = self.rows(motion.q, motion.dq, motion.ddq)[:, :, self.base] / self.noise[:, None]
        return w.reshape(-1, len(self.base))

    def more_friction(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(N, n) Stribeck and load friction, which the model does not have [N.m]."""
        load = np.array([pin.rnea(self.model, self.data, *x) for x in zip(q, dq, ddq, strict=True)])
        dry = STRIBECK * COULOMB * np.exp(-np.square(dq / STRIBECK_SPEED)) + LOAD * np.abs(load)
        return dry * np.tanh(dq / 0.001)


class Judge:
    """Held-out motions, and what an estimate from a design is worth on them."""

    def __init__(self, plant: Plant, limits: MotionConstraints) -> None:
        self.plant = plant
        motions = [*_whole_workspace(plant, limits, 10), *_task(plant, limits, 10)]
        self.rows = [plant.rows(m.q, m.dq, m.ddq)[:, :, plant.base] for m in motions]
        self.friction = [plant.more_friction(m.q, m.dq, m.ddq) for m in motions]

    def variance(self, covariance: Array) -> Array:
        """(n) variance of the predicted torques over that of the noise, for (b, b)."""
        root = np.linalg.cholesky(covariance)
        found = [np.square(rows @ root).sum(axis=2).mean(axis=0) for rows in self.rows]
        return np.mean(found, axis=0) / np.square(self.plant.noise)

    def judge(self, motion: JointMotion, draws: int = 0) -> dict[str, float]:
        """The figures of a design."""
        plant = self.plant
        q, r = np.linalg.qr(plant.over_noise(motion))
        root = np.linalg.inv(r)
        friction = plant.more_friction(motion.q, motion.dq, motion.ddq) / plant.noise
        bias = root @ (q.T @ friction.ravel())
        noise, rich = [], []
        for rows, extra in zip(self.rows, self.friction, strict=True):
            variance = np.square(rows @ root).sum(axis=2).mean(axis=0)
            noise.append(variance)
            rich.append(variance + np.square(rows @ bias - extra).mean(axis=0))
        found = {
            "held-out": float(np.mean(np.sqrt(np.mean(noise, axis=0)) / plant.noise)),
            "whole": float(np.mean(np.sqrt(np.mean(noise[:10], axis=0)) / plant.noise)),
            "task": float(np.mean(np.sqrt(np.mean(noise[10:], axis=0)) / plant.noise)),
            "friction": float(np.mean(np.sqrt(np.mean(rich, axis=0)) / plant.noise)),
            "worst": float(np.linalg.norm(root, axis=1).max()),
        }
        if draws:
            random, squares = np.random.default_rng(2), []
            for _ in range(draws):
                error = root @ (q.T @ random.standard_normal(len(q)))
                squares.append(np.mean([np.square(x @ error).mean(0) for x in self.rows], axis=0))
            found["monte carlo"] = float(np.mean(np.sqrt(np.mean(squares, axis=0)) / plant.noise))
        return found


def _frame_map(frame: Array) -> Array:
    """(10, 10) from ours in a DH frame to pinocchio's parameters in the joint's frame."""
    out = np.zeros((10, 10))
    for k in range(10):
        m, mx, my, mz, xx, yy, zz, yz, xz, xy = np.eye(10)[k]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        pseudo = np.zeros((4, 4))
        pseudo[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
        pseudo[:3, 3] = pseudo[3, :3] = (mx, my, mz)
        pseudo[3, 3] = m
        moved = frame @ pseudo @ frame.T
        s = moved[:3, :3]
        i = np.trace(s) * np.eye(3) - s
        order = (i[0, 0], i[0, 1], i[1, 1], i[0, 2], i[1, 2], i[2, 2])
        out[:, k] = (moved[3, 3], *moved[:3, 3], *order)
    return out


def _whole_workspace(plant: Plant, limits: MotionConstraints, count: int) -> list[JointMotion]:
    found: list[JointMotion] = []
    seed = 1000
    while len(found) < count:
        series = random_excitation(plant.robot.limits, seed=seed, acceleration=15.0)
        for share in 0.8 ** np.arange(8):
            motion = series.evaluate(np.arange(round(10 * RATE_HZ)) / RATE_HZ)
            q = series.offset + share * (motion.q - series.offset)
            smaller = JointMotion(t=motion.t, q=q, dq=share * motion.dq, ddq=share * motion.ddq)
            if _safe(limits, smaller):
                found.append(smaller)
                break
        seed += 1
    return found


def _task(plant: Plant, limits: MotionConstraints, count: int) -> list[JointMotion]:
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--starts", type=int, default=4)
    parser.add_argument("--only", default="")
    parser.add_argument("--no-collision", action="store_true")
    parser.add_argument("--paper", action="store_true")
    parser.add_argument("--monte-carlo", type=int, default=0)
    parser.add_argument("--motions", type=Path)
    options = parser.parse_args()
    plant = Plant()
    robot = plant.robot
    limits = (
        paper_constraints(robot)
        if options.paper
        else safe_constraints(robot, collision=not options.no_collision)
    )
    judge = Judge(plant, limits)
    only = [name for name in options.only.split(";") if name]
    print(f"{'criterion':26} held-out (min .. max)      whole  task  friction  worst   cond  CPU s")
    if options.motions is not None:
        found = [np.load(file) for file in sorted(options.motions.glob("*.npz"))]
        motions = [JointMotion(t=np.arange(len(x["q"])) / RATE_HZ, **x) for x in found]
        _print(str(options.motions), [_judged(judge, motion) for motion in motions])
        return
    best = _best_random(judge, robot, limits)
    _print("random, best cond of 40", [best])
    for name, words in CRITERIA.items():
        if only and name not in only:
            continue
        rows = []
        for seed in range(options.seeds):
            began = time.process_time()
            settings = DesignSettings(
                seed=seed,
                starts=options.starts if words.get("method") != "ga" else None,
                noise=None if words.get("purpose") == "cond" else tuple(NOISE),
                collision=not options.no_collision,
                limits="paper" if options.paper else "safe",
                **words,
            )
            found = design("ur5", settings)
            assert found.feasible
            times = np.arange(round(found.trajectory.duration * RATE_HZ)) / RATE_HZ
            row = judge.judge(found.trajectory.evaluate(times), options.monte_carlo)
            cpu = time.process_time() - began
            rows.append(row | {"cond": found.condition_number, "cpu": cpu})
        _print(name, rows)


def _best_random(judge: Judge, robot, limits: MotionConstraints) -> dict[str, float]:
    rows = [_judged(judge, motion) for motion in _whole_workspace(judge.plant, limits, 40)]
    return min(rows, key=lambda row: row["cond"])


def _judged(judge: Judge, motion: JointMotion) -> dict[str, float]:
    plant = judge.plant
    w = plant.rows(motion.q, motion.dq, motion.ddq)[:, :, plant.base]
    cond = float(np.linalg.cond(w.reshape(-1, len(plant.base))))
    return judge.judge(motion) | {"cond": cond, "cpu": 0.0}


def _print(name: str, rows: list[dict[str, float]]) -> None:
    held = [row["held-out"] for row in rows]
    mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    sampled = f"  monte carlo {mean['monte carlo']:.4f}" if "monte carlo" in mean else ""
    print(
        f"{name:26} {mean['held-out']:.4f} ({min(held):.4f} .. {max(held):.4f})  "
        f"{mean['whole']:.4f} {mean['task']:.4f} {mean['friction']:.4f} {mean['worst']:6.3f} "
        f"{mean['cond']:6.0f} {mean['cpu']:6.1f}{sampled}",
        flush=True,
    )


if __name__ == "__main__":
    main()
