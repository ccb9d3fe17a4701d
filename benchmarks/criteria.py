"""What designs buy: torque errors on held-out motions of an independent plant.

The plant is pinocchio's regressor on the UR5's kinematics and masses, with Gaussian torque noise
and weighted least squares; its base parameters are found here by a QR decomposition of their own.
Torques are linear in the parameters, so the deviation of a prediction follows from the covariance
C of the estimate, sqrt(mean Y C Y'), without sampling. Held-out motions: 10 of the whole workspace
and 10 pick-and-place motions, all safe; no design sees them.

    python benchmarks/criteria.py [--seeds 10] [--starts 4] [--only A B] [--no-collision]
    python benchmarks/criteria.py crowded [--seeds 1]

The columns of the table are means over the seeds:
  held-out   deviation of the predicted torque over the joint's noise, averaged over joints
  friction   the same where the plant has Stribeck and load friction that the model lacks
  worst      largest standard deviation of a base parameter (DH frames, first-come, SI units)

`crowded`: a table and a wall, three boxes, a tool with a payload, for three arms; beside
designs without a scene, on held-out motions of the whole workspace and those that keep the scene.

Exits with 1 where an asked figure is missed. Needs pinocchio: pip install 'dynid[dev]'.
"""

import itertools
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from shared.measuring import asked, run
from shared.pinocchio_arm import Array, PinocchioArm

from dynid import DesignSettings, ExcitationDesign, design, load_robot, random_excitation
from dynid.constraints import MotionConstraints, safe_constraints, scene_from_json
from dynid.core import JsonFields, one_thread
from dynid.excitation import assumed_noise
from dynid.robot import with_tool
from dynid.trajectory import JointMotion, Quintic

NOISE = np.array([2.0, 2.5, 1.5, 0.4, 0.4, 0.3])
COULOMB = np.array([9.8, 10.7, 10.5, 1.7, 1.6, 1.6])
STRIBECK, STRIBECK_SPEED, LOAD = 0.15, 0.06, 0.03
"""Breakaway over Coulomb friction, its speed [rad/s], friction over load: as the simulated UR5."""
RATE_HZ = 125.0
HOME = np.array([0.0, -1.5, 1.5, -1.5, -1.5, 0.0])
REACH = np.array([0.9, 0.4, 0.5, 0.4, 0.3, 1.5])
FOURIER = "prediction, 13.3 s"
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
    "20 points": {"trajectory": "points", "harmonics": 20, "period_s": 13.33},
    FOURIER: {"period_s": 13.33},
}
REACH_M = {"ur3": 0.5, "ur5": 0.85, "ur10e": 1.3}
TOOL, PAYLOAD = (0.0, 0.0, 0.15), (1.0, 0.0, 0.0, 0.08)


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

    def judge(self, motion: JointMotion) -> dict[str, float]:
        """The figures of a motion."""
        noise, rows = self.plant.noise, self.plant.base_rows(motion)
        q, r = np.linalg.qr((rows / noise[:, None]).reshape(-1, rows.shape[2]))
        root = np.linalg.inv(r)
        bias = root @ (q.T @ (self.plant.more_friction(motion) / noise).ravel())
        # (20, n) mean squares of the predicted torques' errors [N.m^2].
        random = [np.square(held @ root).sum(axis=2).mean(axis=0) for held in self.rows]
        wrong = [
            np.square(held @ bias - extra).mean(axis=0)
            for held, extra in zip(self.rows, self.friction, strict=True)
        ]

        def deviation(variances: Array) -> float:
            return float(np.mean(np.sqrt(variances.mean(axis=0)) / noise))

        return {
            "held-out": deviation(np.array(random)),
            "friction": deviation(np.add(random, wrong)),
            "worst": float(np.linalg.norm(root, axis=1).max()),
            "cond": float(np.linalg.cond(rows.reshape(-1, len(root)))),
            "cpu": 0.0,
        }

    def design(self, found: ExcitationDesign) -> dict[str, float]:
        """The figures of one period of a design."""
        times = np.arange(round(found.trajectory.duration * RATE_HZ)) / RATE_HZ
        return self.judge(found.trajectory.evaluate(times))


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


def criteria(seeds: int, starts: int, only: tuple[str, ...], collision: bool) -> bool:
    """Print a row a criterion; true if an asked figure is missed."""
    plant = Plant()
    limits = safe_constraints(plant.robot, collision=collision)
    judge = Judge(plant, limits)
    print(f"{'criterion':26} held-out (min .. max)       friction  worst   cond  CPU s")
    random = [judge.judge(motion) for motion in _whole_workspace(plant, limits, 40)]
    _print("random, best cond of 40", [min(random, key=lambda row: row["cond"])])
    means: dict[str, dict[str, float]] = {}
    for name, words in CRITERIA.items():
        if only and name not in only:
            continue
        rows = []
        for seed in range(seeds):
            began = time.process_time()
            settings = DesignSettings(
                seed=seed,
                starts=starts if words.get("method") != "ga" else None,
                noise=None if words.get("purpose") == "cond" else tuple(NOISE),
                collision=collision,
                **words,
            )
            found = design("ur5", settings)
            assert found.feasible
            row = judge.design(found)
            rows.append(row | {"cpu": time.process_time() - began})
        means[name] = _print(name, rows)
    missed = False

    def over(what: str, key: str, first: str, second: str, most: float) -> bool:
        if not {first, second} <= {*means}:
            return False
        return asked(what, means[first][key] / means[second][key], most=most)

    missed |= over("held-out, prediction over cond", "held-out", "prediction", "cond", 0.75)
    missed |= over("worst, prediction over cond", "worst", "prediction", "cond", 1.3)
    missed |= over("held-out, points over a series", "held-out", "20 points", FOURIER, 1.5)
    if "prediction" in means:
        short = [row for name, row in means.items() if "period_s" not in CRITERIA[name]]
        least = min(row["friction"] for row in short)
        ratio = means["prediction"]["friction"] / least
        missed |= asked("friction, prediction over the best", ratio, most=1.03)
    return missed


def _print(name: str, rows: list[dict[str, float]]) -> dict[str, float]:
    held = [row["held-out"] for row in rows]
    mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    print(
        f"{name:26} {mean['held-out']:.4f} ({min(held):.4f} .. {max(held):.4f})  "
        f"{mean['friction']:.4f} {mean['worst']:6.3f} {mean['cond']:6.0f} {mean['cpu']:6.1f}",
        flush=True,
    )
    return mean


def scenes(reach: float) -> dict[str, dict[str, object]]:
    """Crowded places for an arm of this reach [m]."""
    floor = {"type": "floor", "height": -0.75}
    table = {"type": "table", "size": [1.2, 0.8], "position": [0, 0, 0]}
    wall = {"type": "wall", "point": [0, 0.5 * reach, 0], "normal": [0, -1, 0]}
    boxes = [
        {
            "type": "box",
            "size": [0.25 * reach, 0.25 * reach, 2 * reach * place[2]],
            "position": [reach * x for x in place],
        }
        for place in ([0.6, 0.5, 0.2], [-0.6, 0.4, 0.3], [0.2, -0.7, 0.25])
    ]
    carried = {"type": "box", "size": [0.08, 0.08, 0.15], "position": [0, 0, 0.1]}
    return {
        "table and wall": {"shapes": [floor, table, wall]},
        "three boxes": {"shapes": boxes},
        "tool and payload": {"shapes": [floor, table], "payload": [carried]},
    }


def crowded(seeds: int) -> bool:
    """Three scenes for three arms; true if an asked figure is missed."""
    worst, most_s, certified = 0.0, 0.0, True
    for name, reach in REACH_M.items():
        robot = load_robot(name)
        noise = assumed_noise(robot)
        plant = Plant(name, noise)
        anywhere = Judge(plant, safe_constraints(robot))
        words = {"noise": tuple(noise)}
        free = [design(name, DesignSettings(seed=seed, **words)) for seed in range(seeds)]
        for what, scene in scenes(reach).items():
            more = {"tool": TOOL, "payload": PAYLOAD} if what.startswith("tool") else {}
            equipped = with_tool(robot, tcp=more.get("tool"), payload=more.get("payload"))
            kept = scene_from_json(JsonFields(scene), what)
            inside = Judge(plant, safe_constraints(equipped, kept))
            for seed, without in enumerate(free):
                with tempfile.TemporaryDirectory() as folder:
                    file = Path(folder) / "scene.json"
                    file.write_text(json.dumps(scene))
                    began = time.process_time()
                    settings = DesignSettings(seed=seed, scene=str(file), **words, **more)
                    found = design(name, settings)
                    cpu = time.process_time() - began
                ratios = [
                    judge.design(found)["held-out"] / judge.design(without)["held-out"]
                    for judge in (anywhere, inside)
                ]
                print(
                    f"{name:6} {what:17} seed {seed}: {found.certificate.verdict}, "
                    f"{ratios[0]:.2f} x anywhere, {ratios[1]:.2f} x in the scene, {cpu:.1f} s CPU",
                    flush=True,
                )
                worst, most_s = max(worst, *ratios), max(most_s, cpu)
                certified &= found.feasible
    missed = asked("deviation over that without a scene", worst, most=2)
    return asked("s of CPU of a design", most_s, most=60) or missed or not certified


@one_thread()
def main(
    what: str = "criteria",
    /,
    seeds: int = 0,
    starts: int = 4,
    only: tuple[str, ...] = (),
    no_collision: bool = False,
) -> bool:
    if what == "crowded":
        return crowded(seeds or 1)
    return criteria(seeds or 10, starts, only, not no_collision)


if __name__ == "__main__":
    run(main)
