"""A small arm as a robot file, whose designs take a fraction of a second."""

from __future__ import annotations

from pathlib import Path

ARM = """
name = "small"
joint_names = ["one", "two", "three"]
[dh]
convention = "standard"
a = [0.0, 0.4, 0.3]
d = [0.2, 0.0, 0.1]
alpha = [1.5707963267948966, 0.0, 0.0]
[limits]
lower = [-3.0, -2.0, -2.5]
upper = [3.0, {upper}, 2.5]
velocity = [2.0, 2.0, 2.5]
acceleration = [10.0, 10.0, 10.0]
torque = [{torque}, {torque}, {torque}]
[safety]
tcp_speed = 1.0
[inertia]
frames = "dh"
mass = [4.0, 6.0, 2.0]
com = [[0.0, 0.0, 0.0], [-0.2, 0.0, 0.0], [-0.1, 0.0, 0.0]]
[[capsule]]
name = "column"
link = "base"
start = [0.0, 0.0, 0.0]
end = [0.0, 0.0, 0.1]
radius = 0.05
[[capsule]]
name = "tool"
link = "three"
start = [-0.2, 0.0, 0.0]
end = [0.0, 0.0, 0.0]
radius = 0.04
"""


REST = """
[[capsule]]
name = "shoulder"
link = "one"
start = [0.0, 0.0, 0.16]
end = [0.0, 0.0, 0.2]
radius = 0.03
[[capsule]]
name = "upper arm"
link = "two"
start = [0.1, 0.0, 0.0]
end = [0.35, 0.0, 0.0]
radius = 0.04
"""
"""Bodies of the other links: without them nothing is certified."""


def written_arm(
    folder: Path, *, torque: float = 80.0, upper: float = 2.5, whole: bool = False
) -> Path:
    """The robot file; with bodies of all links if it is `whole`."""
    path = folder / "small.toml"
    text = ARM.format(torque=torque, upper=upper) + (REST if whole else "")
    path.write_text(text, encoding="utf-8")
    return path
