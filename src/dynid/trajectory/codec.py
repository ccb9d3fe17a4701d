"""Trajectories of every kind as JSON objects, and back."""

from __future__ import annotations

from typing import Any

from dynid.core.errors import InputError
from dynid.trajectory.bspline import BSpline
from dynid.trajectory.fourier import FourierSeries
from dynid.trajectory.fourier_quintic import FourierQuintic
from dynid.trajectory.json_fields import JsonFields
from dynid.trajectory.quintic import Quintic
from dynid.trajectory.sequence import MotionSequence, Repetition
from dynid.trajectory.trajectory import Trajectory

_DEEPEST = 8
"""Levels of sequences within sequences that a file may have."""


def trajectory_to_json(trajectory: Trajectory) -> dict[str, Any]:
    """A JSON object, `type` first, from which the trajectory can be read back exactly.

    Args:
        trajectory: Any trajectory of this package.

    Raises:
        InputError: A trajectory of another kind.
    """
    match trajectory:
        case FourierSeries():
            return {
                "type": "fourier",
                "period": trajectory.period,
                "offset": trajectory.offset.tolist(),
                "a": trajectory.a.tolist(),
                "b": trajectory.b.tolist(),
            }
        case FourierQuintic():
            return {
                "type": "fourier-quintic",
                "period": trajectory.period,
                "start": trajectory.start.tolist(),
                "goal": trajectory.goal.tolist(),
                "a": trajectory.a.tolist(),
                "b": trajectory.b.tolist(),
            }
        case BSpline():
            return {
                "type": "bspline",
                "travel_time": trajectory.travel_time,
                "degree": trajectory.degree,
                "control": trajectory.control.tolist(),
            }
        case Quintic():
            return {
                "type": "quintic",
                "travel_time": trajectory.travel_time,
                "start": trajectory.start.tolist(),
                "goal": trajectory.goal.tolist(),
            }
        case MotionSequence():
            return {
                "type": "sequence",
                "parts": [trajectory_to_json(part) for part in trajectory.parts],
            }
        case Repetition():
            return {
                "type": "repetition",
                "times": trajectory.times,
                "part": trajectory_to_json(trajectory.part),
            }
        case _:
            raise InputError("no file form for this trajectory", value=type(trajectory).__name__)


def trajectory_from_json(fields: JsonFields, *, depth: int = 0) -> Trajectory:
    """The trajectory of a JSON object that `trajectory_to_json` made.

    Args:
        fields: The object.
        depth: How many sequences it stands in.

    Raises:
        InputError: An unknown type, or numbers that are not a trajectory of it.
    """
    if depth > _DEEPEST:
        raise InputError("sequences within sequences", value=depth, limit=_DEEPEST)
    kind = fields.text("type")
    match kind:
        case "fourier":
            return FourierSeries(
                period=fields.number("period"),
                offset=fields.vector("offset"),
                a=fields.matrix("a"),
                b=fields.matrix("b"),
            )
        case "fourier-quintic":
            return FourierQuintic(
                period=fields.number("period"),
                start=fields.vector("start"),
                goal=fields.vector("goal"),
                a=fields.matrix("a"),
                b=fields.matrix("b"),
            )
        case "bspline":
            return BSpline(
                travel_time=fields.number("travel_time"),
                degree=fields.whole("degree"),
                control=fields.matrix("control"),
            )
        case "quintic":
            return Quintic(
                travel_time=fields.number("travel_time"),
                start=fields.vector("start"),
                goal=fields.vector("goal"),
            )
        case "sequence":
            parts = fields.objects("parts")
            return MotionSequence(
                parts=tuple(trajectory_from_json(part, depth=depth + 1) for part in parts)
            )
        case "repetition":
            return Repetition(
                part=trajectory_from_json(fields.object("part"), depth=depth + 1),
                times=fields.whole("times"),
            )
        case _:
            raise InputError(f"{fields.prefix}type is no kind of trajectory", value=kind)
