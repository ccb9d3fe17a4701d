"""Second designs, motions through points, and crowded places, judged on an independent plant.

The plant and its noise are those of `criteria.py`: pinocchio's regressor, weighted least squares,
held-out motions that no design sees. All designs are safe ones with collisions, `--for prediction`.

    python benchmarks/experiments.py previous [--seeds 3]   second designs made with --previous
        beside second designs made alone, after recordings of several lengths; friction is that of
        its own day. Asked: a variance of the predicted torque at least 25 % lower.
    python benchmarks/experiments.py [points] [--seeds 5]   20 points beside a Fourier series of as
        many seconds. Asked: at most 1.5 times the deviation.
    python benchmarks/experiments.py crowded [--seeds 1]    a table and a wall, three boxes, a tool
        with a payload, for three arms. Asked: certified, at most twice the deviation without a
        scene, on held-out motions of the whole workspace and on those that keep the scene; at most
        60 s of CPU.

Exits with 1 where an asked figure is missed. Needs pinocchio: pip install 'dynid[dev]'.
"""

import itertools
import json
import tempfile
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from criteria import NOISE, RATE_HZ, Judge, Plant
from shared.measuring import run
from shared.pinocchio_arm import Array

from dynid import DesignSettings, ExcitationDesign, ExperimentRecord, design
from dynid.constraints import safe_constraints, scene_from_json
from dynid.core import JsonFields, Mask, one_thread
from dynid.excitation import assumed_noise
from dynid.recording import write_record
from dynid.robot import load_robot, with_tool
from dynid.trajectory import JointMotion

POINTS, FEW = 20, 6
REACH_M = {"ur3": 0.5, "ur5": 0.85, "ur10e": 1.3}
TOOL, PAYLOAD = (0.0, 0.0, 0.15), (1.0, 0.0, 0.0, 0.08)


def sampled(found: ExcitationDesign, periods: int = 1) -> JointMotion:
    """Some periods of a design."""
    count = round(found.trajectory.duration * RATE_HZ)
    one = found.trajectory.evaluate(np.arange(count) / RATE_HZ)
    q, dq, ddq = (np.tile(part, (periods, 1)) for part in (one.q, one.dq, one.ddq))
    return JointMotion(t=np.arange(len(q)) / RATE_HZ, q=q, dq=dq, ddq=ddq)


def information(plant: Plant, motion: JointMotion) -> Array:
    """(b, b) of the base parameters."""
    w = plant.over_noise(motion)
    return w.T @ w


def deviation(judge: Judge, found: ExcitationDesign) -> float:
    """Held-out deviation over noise, averaged over the joints."""
    covariance = np.linalg.inv(information(judge.plant, sampled(found)))
    return float(np.sqrt(judge.variance(covariance)).mean())


def lasting(gram: Array, own: Mask) -> Array:
    """What an earlier recording says, of which some parameters (b), its friction, are its own."""
    across = gram[np.ix_(~own, own)]
    out = np.zeros_like(gram)
    out[np.ix_(~own, ~own)] = gram[np.ix_(~own, ~own)] - across @ np.linalg.solve(
        gram[np.ix_(own, own)], across.T
    )
    return out


def previous(seeds: int) -> bool:
    """Second designs made with --previous beside second designs made alone."""
    plant = Plant()
    judge = Judge(plant, safe_constraints(plant.robot))
    # Coulomb and viscous friction; the motor inertias behind them last.
    n = plant.robot.joints
    own = (plant.base >= 10 * n) & (plant.base < 12 * n)

    usual = DesignSettings(noise=tuple(NOISE))
    short = replace(usual, period_s=4.0)
    few = replace(short, trajectory="points", harmonics=FEW)
    pairs = (
        ("10 s after 10 s", 1, usual, usual),
        ("10 s after 100 s", 10, usual, usual),
        ("4 s after 100 s", 10, usual, short),
        ("4 s after 4 s", 1, short, short),
        (f"{FEW} points after {FEW}", 1, few, few),
    )
    ratios = defaultdict[str, list[float]](list)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "first.parquet"
        for seed, (what, periods, first, second) in itertools.product(range(seeds), pairs):
            motion = sampled(design("ur5", replace(first, seed=seed)), periods)
            signals = {"q": motion.q, "effort": np.zeros_like(motion.q)}
            write_record(ExperimentRecord(t=motion.t, signals=signals), file, force=True)
            known, values = lasting(information(plant, motion), own), []
            for more in ({}, {"previous": (str(file),)}):
                found = design("ur5", replace(second, seed=seeds + seed, **more))
                gram = known + information(plant, sampled(found))
                values.append(float(judge.variance(np.linalg.inv(gram)).mean()))
            ratios[what].append(values[1] / values[0])
            print(f"seed {seed}, {what}: variance {values[0]:.5f} alone, {values[1]:.5f} with "
                  f"--previous: {ratios[what][-1]:.2f}", flush=True)  # fmt: skip
    for what, found in ratios.items():
        print(f"{what}: {np.mean(found):.2f} ({min(found):.2f} to {max(found):.2f}) of the "
              "variance alone (asked: 0.75)")  # fmt: skip
    return all(np.mean(found) <= 0.75 for found in ratios.values())


def points(seeds: int) -> bool:
    """Points beside a Fourier series of as many seconds."""
    plant = Plant()
    judge = Judge(plant, safe_constraints(plant.robot))
    ratios = []
    for seed in range(seeds):
        asked = DesignSettings(
            noise=tuple(NOISE), seed=seed, trajectory="points", harmonics=POINTS,
            period_s=round(POINTS / 1.5, 2),
        )  # fmt: skip
        values = []
        for one in (asked, replace(asked, trajectory="fourier", harmonics=None)):
            found = design("ur5", one)
            assert found.feasible
            values.append(deviation(judge, found))
        ratios.append(values[0] / values[1])
        print(f"seed {seed}: {POINTS} points {values[0]:.4f}, Fourier {values[1]:.4f}: "
              f"{ratios[-1]:.2f}", flush=True)  # fmt: skip
    print(f"points over Fourier: {min(ratios):.2f} to {max(ratios):.2f} (asked: 1.5 at most)")
    return max(ratios) <= 1.5


def scenes(reach: float) -> dict[str, dict[str, object]]:
    """Crowded places for an arm of this reach [m]."""
    floor = {"type": "floor", "height": -0.75}
    table = {"type": "table", "size": [1.2, 0.8], "position": [0, 0, 0]}
    wall = {"type": "wall", "point": [0, 0.5 * reach, 0], "normal": [0, -1, 0]}
    places = ([0.6, 0.5, 0.2], [-0.6, 0.4, 0.3], [0.2, -0.7, 0.25])
    boxes = [
        {"type": "box", "size": [0.25 * reach, 0.25 * reach, 2 * reach * place[2]],
         "position": [reach * x for x in place]}
        for place in places
    ]  # fmt: skip
    carried = {"type": "box", "size": [0.08, 0.08, 0.15], "position": [0, 0, 0.1]}
    return {
        "table and wall": {"shapes": [floor, table, wall]},
        "three boxes": {"shapes": boxes},
        "tool and payload": {"shapes": [floor, table], "payload": [carried]},
    }


def crowded(seeds: int) -> bool:
    """Three scenes for three arms."""
    good = True
    for name, reach in REACH_M.items():
        robot = load_robot(name)
        noise = assumed_noise(robot)
        plant = Plant(name, noise)
        anywhere = Judge(plant, safe_constraints(robot))
        settings = [DesignSettings(noise=tuple(noise), seed=seed) for seed in range(seeds)]
        free = [design(name, one) for one in settings]
        for what, scene in scenes(reach).items():
            more = {"tool": TOOL, "payload": PAYLOAD} if what.startswith("tool") else {}
            equipped = with_tool(robot, tcp=more.get("tool"), payload=more.get("payload"))
            kept = scene_from_json(JsonFields(scene), what)
            inside = Judge(plant, safe_constraints(equipped, kept))
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "scene.json"
                file.write_text(json.dumps(scene))
                for one, without in zip(settings, free, strict=True):
                    began = time.process_time()
                    found = design(name, replace(one, scene=str(file), **more))
                    cpu = time.process_time() - began
                    ratios = [deviation(x, found) / deviation(x, without)
                              for x in (anywhere, inside)]  # fmt: skip
                    good &= found.feasible and max(ratios) <= 2.0 and cpu <= 60.0
                    print(f"{name:6} {what:17} seed {one.seed}: {found.certificate.verdict}, "
                          f"{ratios[0]:.2f} x anywhere, {ratios[1]:.2f} x in the scene, "
                          f"{cpu:.1f} s CPU", flush=True)  # fmt: skip
    return good


@one_thread()
def main(what: str = "points", /, seeds: int = 0) -> bool:
    """One of them; true if its figure is missed."""
    kinds = {"previous": (previous, 3), "points": (points, 5), "crowded": (crowded, 1)}
    measure, usual = kinds[what]
    return not measure(seeds or usual)


if __name__ == "__main__":
    run(main)
