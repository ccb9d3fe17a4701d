"""Which of a bag's JointState topics is the robot's."""

from __future__ import annotations

import re
from collections.abc import Mapping

from dynid.core import RecordError
from dynid.recording.bag.jointstates import Collector
from dynid.recording.vocabulary import TARGET


def choose_topic(
    topics: Mapping[str, Collector], wanted: str | None, joints: int, where: str
) -> str:
    """The topic that is asked for, or the one that must be the robot's.

    Args:
        topics: Topics of JointState and their messages.
        wanted: The topic that is asked for, if any.
        joints: Number of the robot's joints; 0 if it is not known.
        where: The bag, for messages.

    Raises:
        RecordError: It is not there, or several could be it, as of two arms.
    """
    if wanted is not None and wanted not in topics:
        raise RecordError(
            "no such JointState topic", where=where, value=wanted, limit=sorted(topics)
        )
    if not topics:
        raise RecordError(
            "the bag has no readable sensor_msgs/JointState message",
            where=where,
            next_step="Record the robot's /joint_states topic.",
        )
    if wanted is not None:
        return wanted
    ranked = sorted(topics, key=lambda name: (*_standing(name, topics[name], joints), name))
    best = ranked[-1]
    first = _standing(best, topics[best], joints)
    rivals = [
        name
        for name in ranked[:-1]
        if _standing(name, topics[name], joints)[:-1] == first[:-1]
        and 2 * topics[name].count > topics[best].count
        and not topics[name].says_the_same(topics[best])
    ]
    if rivals and first[0]:
        raise RecordError(
            f"{1 + len(rivals)} topics can be the robot's state",
            where=where,
            value=[best, *rivals],
            next_step=f"Say which, for example --topic {best}.",
        )
    return best


def _standing(name: str, collector: Collector, joints: int) -> tuple[bool, bool, bool, bool, int]:
    """Enough joints, measured not asked for, the usual name, and then the most messages."""
    words = set(re.split(r"[^a-z]+", name.lower()))
    most = max((len(names) for names in collector.groups), default=0)
    usual = name.endswith("joint_states")
    return (
        most >= max(joints, 1),
        not words & TARGET,
        name == "/joint_states",
        usual,
        collector.count,
    )
