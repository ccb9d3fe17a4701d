"""How near `dynid fit` comes to the true torque of an arm that it does not know, from one CSV file.

The arms, their friction and their torques share no code with the identified model (see
`dynid.bench.plants`); the URDF states other inertias than the arm has.
"""

import csv
import tempfile
import textwrap
from pathlib import Path

import numpy as np

import dynid
from dynid.bench import plants

ARMS = ("seven", "heavy", "sliding")
SEEDS = range(1, 6)
RATE_HZ, DURATION_S = 250.0, 30.0


def recorded(arm: plants.Plant, kind: str, seed: int) -> tuple[plants.Motion, np.ndarray]:
    """A motion and its true torques (N, n), without noise."""
    moved = plants.motion(arm.robot, kind, seed, RATE_HZ, DURATION_S)
    rigid = arm.torque(moved.q, moved.dq, moved.ddq)
    rotors = arm.friction(moved.dq, rigid, 1 / RATE_HZ)
    return moved, rigid + rotors


def write_csv(path: Path, arm: plants.Plant, seed: int) -> None:
    """What a lab's logger writes: time, positions and torques with their noise."""
    moved, torque = recorded(arm, "fourier", seed)
    noise = np.random.default_rng(seed).normal(size=torque.shape) * arm.torque_noise
    q = np.round(moved.q / arm.position_step) * arm.position_step
    sliding = arm.robot.prismatic
    head = ["time [s]"]
    head += [f"q{k + 1} [{'m' if s else 'rad'}]" for k, s in enumerate(sliding)]
    head += [f"torque{k + 1} [{'N' if s else 'Nm'}]" for k, s in enumerate(sliding)]
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(head)
        rows.writerows(np.column_stack([moved.t, q, torque + noise]).tolist())


def error_percent(name: str, seed: int) -> float:
    """Error of the model against the true torque of another motion, mean of the joints [%]."""
    arm = plants.plant(plants.arm(name), seed)
    with tempfile.TemporaryDirectory() as folder:
        urdf, log = Path(folder) / f"{name}.urdf", Path(folder) / "log.csv"
        urdf.write_text(plants.urdf(name), encoding="utf-8")
        write_csv(log, arm, seed)
        found = dynid.fit(urdf, log, Path(folder) / "fitted")
    moved, truth = recorded(arm, "fourier", 100 + seed)
    estimate = found.identification.estimate
    state = estimate.model.friction_state(moved.q)
    told = estimate.predict(moved.q, moved.dq, moved.ddq, state)
    moving = np.abs(moved.dq).max(axis=1) > 0
    size = np.linalg.norm(truth[moving], axis=0)
    return float(100 * np.mean(np.linalg.norm((told - truth)[moving], axis=0) / size))


def claim() -> str:
    """The README's sentence."""
    errors = sorted(error_percent(name, seed) for name in ARMS for seed in SEEDS)
    middle, least, most = np.median(errors), errors[0], errors[-1]
    told = (
        f"From one CSV file of {DURATION_S:.0f} s, the model's torques on another motion of its "
        f"kind are within {middle:.1f} % of the true ones (median; {len(ARMS)} simulated arms with "
        f"{len(SEEDS)} draws of unknown links and friction each: {least:.1f} to {most:.1f} %; "
        "[benchmarks/readme/claim.py](benchmarks/readme/claim.py))."
    )
    return textwrap.fill(told, 118, break_on_hyphens=False)


if __name__ == "__main__":
    print(claim())
