"""What a built-in function is: its parameters by name, and whether it takes time."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

Function = Callable[..., Any]


class Kind(Enum):
    """How a built-in runs."""

    PURE = "arithmetic alone"
    INSTANT = "asks or changes the controller, within the cycle"
    BLOCKING = "a generator: one yield a control cycle"


@dataclass(frozen=True, slots=True)
class Builtin:
    """A function that every script knows."""

    name: str
    function: Function
    """Takes the controller first, unless it is pure."""
    kind: Kind
    parameters: tuple[str, ...]
    """Names of its arguments in a script."""
    defaults: tuple[Any, ...]
    """Values of the last of them, where they are not given."""
    weight: int
    """What a call costs, in operations (about 0.1 us each)."""

    @property
    def required(self) -> int:
        """How many arguments it needs."""
        return len(self.parameters) - len(self.defaults)


def builtin(function: Function, kind: Kind, *, name: str | None = None, weight: int = 5) -> Builtin:
    """A built-in whose arguments are those of a Python function.

    Args:
        function: The function; instant and blocking ones take the controller first.
        kind: How it runs.
        name: Its name in scripts, if it is not the function's.
        weight: What a call costs, in operations.
    """
    parameters = list(inspect.signature(function).parameters.values())
    own = parameters if kind == Kind.PURE else parameters[1:]
    empty = inspect.Parameter.empty
    return Builtin(
        name=name or function.__name__,
        function=function,
        kind=kind,
        parameters=tuple(item.name for item in own),
        defaults=tuple(item.default for item in own if item.default is not empty),
        weight=weight,
    )


def table(*groups: Iterable[Builtin]) -> dict[str, Builtin]:
    """Built-ins by name."""
    return {item.name: item for group in groups for item in group}
