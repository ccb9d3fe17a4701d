"""What a bag holds: its topics, how their messages are defined, and which of them are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from dynid.core import Finding

JOINT_STATE_TYPES = frozenset({"sensor_msgs/msg/JointState", "sensor_msgs/JointState"})
Message = tuple[str, int, bytes]
"""Topic, receive time [ns], bytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One topic of a bag."""

    name: str
    kind: str
    """The type of its messages, as the bag names it."""
    encoding: str
    """How messages are written: `ros1` or `cdr`."""
    definition: str = ""
    """The definition of the type and of all that it needs; empty where the bag has none."""

    @property
    def is_joint_state(self) -> bool:
        """Whether its messages are `sensor_msgs/JointState`."""
        return self.kind in JOINT_STATE_TYPES


def joint_states(topic: Topic) -> bool:
    """Whether a topic is one of JointState messages."""
    return topic.is_joint_state


@dataclass(slots=True)
class Catalog:
    """The topics of a bag's files, and what is found while they are read."""

    wanted: Callable[[Topic], bool] = joint_states
    """Whose messages are yielded."""
    topics: dict[str, Topic] = field(default_factory=dict[str, Topic])
    findings: list[Finding] = field(default_factory=list[Finding])
    """A notice for each kind of damage."""

    def add(self, topic: Topic) -> bool:
        """Take a topic in; tell whether its messages are wanted."""
        known = self.topics.get(topic.name)
        if known is None or (not known.definition and topic.definition):
            self.topics[topic.name] = topic
        return self.wanted(topic)

    def report(self, code: str, message: str) -> None:
        """Tell of damage."""
        self.findings.append(Finding(code, message))

    def described(self) -> list[str]:
        """Topics with their types, for messages."""
        return [f"{topic.name} ({topic.kind})" for topic in self.topics.values()]
