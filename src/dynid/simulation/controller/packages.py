"""Data packages: what each recipe holds in this cycle, packed once for all who share it."""

from __future__ import annotations

from dynid.protocol import DataType, Recipe
from dynid.simulation.controller.machine import ControllerMachine

_Layout = tuple[tuple[str, ...], tuple[DataType, ...], int | None]


class Packer:
    """Packs the machine's outputs; clients with the same recipe share the work.

    Args:
        machine: The controller behind.
    """

    def __init__(self, machine: ControllerMachine) -> None:
        self._machine = machine
        self._packed: dict[_Layout, bytes] = {}

    def next_cycle(self) -> None:
        """Forget what was packed: the machine has moved on."""
        self._packed.clear()

    def package(self, recipe: Recipe) -> bytes:
        """The data package of a recipe in this cycle, with its header."""
        key = (recipe.names, recipe.types, recipe.number)
        packed = self._packed.get(key)
        if packed is None:
            packed = self._packed[key] = recipe.packet(self._numbers(recipe))
        return packed

    def _numbers(self, recipe: Recipe) -> list[float | int | bool]:
        numbers: list[float | int | bool] = []
        output = self._machine.output
        for name, kind in zip(recipe.names, recipe.types, strict=True):
            value = output(name)
            if isinstance(value, (bool, int, float)):
                numbers.append(value)
            else:
                numbers.extend(value[: kind.count])
        return numbers
