"""Draw the README's picture: a real UR5, identified from one motion, predicted on another."""

from pathlib import Path

import numpy as np

import dynid
from dynid.figures import Axis, Band, Figure, Line, Panel, axis_around, write_figure

ROOT = Path(__file__).parents[2]
DATA = ROOT / "examples" / "data"
JOINTS = (1, 2)
"""Shoulder lift and elbow carry the largest torques."""
LEVEL = 0.9


def picture() -> Figure:
    """Measured and predicted torques of the other motion, with the interval of each prediction."""
    result = dynid.identify([DATA / "ur5_no6.csv.gz"], "ur5", validation=DATA / "ur5_no5.csv.gz")
    shown, estimate = result.validation, result.estimate
    if shown is None:
        raise SystemExit("the other motion was not predicted")
    time, step = shown.t, float(np.median(np.diff(shown.t)))
    robot = dynid.load_robot("ur5")
    learned, record = (
        dynid.read_recording(DATA / f"ur5_{name}.csv.gz", robot=robot) for name in ("no6", "no5")
    )
    position = np.column_stack([np.interp(time, record.t, q) for q in record.signals["q"].T])
    acceleration = np.gradient(shown.dq, step, axis=0)
    width = estimate.half_width(position, shown.dq, acceleration, level=LEVEL)
    panels: list[Panel] = []
    for j in JOINTS:
        measured, predicted = shown.measured[:, j], shown.predicted[:, j]
        panels.append(
            Panel(
                title=estimate.model.robot.joint_names[j].replace("_", " ").capitalize(),
                y=axis_around(measured, predicted, label="torque [N.m]", zero=True),
                marks=(
                    Band(
                        time, predicted - width[:, j], predicted + width[:, j], name="90 % interval"
                    ),
                    Line(time, measured, "measured", "measured", 2.4),
                    Line(time, predicted, "predicted", "predicted", 1.4),
                ),
                height=150,
            )
        )
    return Figure(
        title=f"A real UR5, identified from a log of {learned.t[-1]:.0f} s, on another motion",
        x=Axis(low=float(time[0]), high=float(time[-1]), label="time [s]"),
        panels=tuple(panels),
    )


def draw() -> None:
    """Write docs/figures/prediction.svg."""
    write_figure(picture(), ROOT / "docs" / "figures" / "prediction.svg")


if __name__ == "__main__":
    draw()
