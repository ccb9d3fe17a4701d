"""Which pairs of bodies can be judged at all: some are close together by construction."""

from __future__ import annotations

from dynid.constraints.shapes import Shape
from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.robot.capsule import Capsule
from dynid.robot.model import RobotModel

_NEAR = 2
"""Links this far apart, or from the base, may always be close together by construction."""
_MOSTLY = 0.5
"""Share of poses beyond which the capsules of near links say more of themselves than of the arm."""


def free_pairs(
    robot: RobotModel,
    pairs: list[tuple[int, int]],
    own: Array,
    capsules: tuple[Capsule, ...],
    clearance: float,
    notes: list[str],
) -> tuple[list[tuple[int, int]], bool]:
    """The pairs of capsules that can be judged, and whether some links are left out.

    Args:
        robot: The robot.
        pairs: Candidates (P).
        own: (N, P) their distances in poses all over [m].
        capsules: The robot's.
        clearance: What they must keep [m].
        notes: Told what is left out.
    """
    kept: list[tuple[int, int]] = []
    wide = _too_wide(robot, pairs, own, capsules, clearance, notes)
    for pair, far in zip(pairs, own.T, strict=True):
        a, b = (capsules[k] for k in pair)
        if (a.link, b.link) in wide:
            continue
        if abs(a.link - b.link) <= _NEAR and float(far.max()) < clearance:
            notes.append(f"{a.name} and {b.name} are never farther apart: not judged")
        else:
            kept.append(pair)
    return kept, bool(wide)


def free_holds(
    holds: list[tuple[int, int]],
    own: Array,
    capsules: tuple[Capsule, ...],
    carried: tuple[Shape, ...],
    last: int,
    clearance: float,
    notes: list[str],
) -> list[tuple[int, int]]:
    """The pairs of capsule and carried shape that can be judged; arguments as in `free_pairs`.

    Raises:
        InputError: A shape meets a link in every pose, beside the neighbour of the `last`.
    """
    kept: list[tuple[int, int]] = []
    for (a, s), far in zip(holds, own.T, strict=True):
        item, shape = capsules[a], carried[s]
        if float(far.max()) >= clearance:
            kept.append((a, s))
        elif item.link == last - 1:
            # The wrist in front of the flange: a tool may reach around it by construction.
            notes.append(f"{item.name} and {shape.name} are never farther apart: not judged")
        else:
            raise InputError(
                "the robot cannot carry this: it is in collision in every pose",
                where=f"{item.name} - {shape.name}",
                value=f"{float(far.max()):.3f} m",
                limit=f"{clearance:g} m",
                next_step="Sizes are in metres, places in the flange's frame.",
            )
    return kept


def _too_wide(
    robot: RobotModel,
    pairs: list[tuple[int, int]],
    own: Array,
    capsules: tuple[Capsule, ...],
    clearance: float,
    notes: list[str],
) -> set[tuple[int, int]]:
    """Links whose capsules overlap mostly, if near, or always: arms are not built like that."""
    links = [(capsules[a].link, capsules[b].link) for a, b in pairs]
    found: set[tuple[int, int]] = set()
    for two in sorted(set(links)):
        rows = [k for k, pair in enumerate(links) if pair == two]
        share = float((own[:, rows] < clearance).any(axis=1).mean())
        if share == 1.0 or (two[1] - two[0] <= _NEAR and share > _MOSTLY):
            names = " and ".join(("base", *robot.joint_names)[link] for link in two)
            notes.append(
                f"{names} are not judged against each other: their capsules overlap"
                f" in {share:.0%} of all poses (give better ones: [[capsule]] in a robot file)"
            )
            found.add(two)
    return found


def reachable(
    meetings: list[tuple[int, int]],
    around: Array,
    capsules: tuple[Capsule, ...],
    shapes: tuple[Shape, ...],
    clearance: float,
    notes: list[str],
) -> list[float]:
    """How much nearer than the clearance each pair of capsule and shape may be [m].

    Arguments as in `free_pairs`. Bodies beside the base that are near a shape and never touch it,
    such as the shoulder of an arm that stands on the floor, must keep half of their least distance.

    Raises:
        InputError: A capsule of a moving link is in a shape in every pose.
    """
    found: list[float] = []
    near: dict[tuple[str, str], float] = {}
    for (a, s), far in zip(meetings, around.T, strict=True):
        item, shape = capsules[a], shapes[s].name
        if float(far.max()) <= 0:
            raise InputError(
                f"the scene leaves the robot no room: {item.name} is in '{shape}' in every pose",
                where=shape,
                value=f"{float(far.max()):.3f} m",
                limit="0 m",
                next_step="Shapes are solid and stand in the robot's base frame; build a cell"
                " from walls.",
            )
        least = float(far.min())
        beside = item.link <= _NEAR and 0.0 < least < clearance
        found.append(clearance - least / 2 if beside else 0.0)
        if beside:
            part = (item.name.rsplit(" ", 1)[0], shape)
            near[part] = min(least, near.get(part, clearance))
    notes += [
        f"{part} is {least:.3f} m from '{shape}' whatever the arm does: held to half of that there"
        for (part, shape), least in near.items()
    ]
    return found
