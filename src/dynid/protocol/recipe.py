"""A recipe: the variables of a data package, in order, packed and unpacked."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynid.protocol.fields import TYPES, DataType
from dynid.protocol.framing import HEADER, Kind, ProtocolError

Value = bool | int | float | Sequence[float] | Sequence[int]
"""One variable: a number, or a sequence of three or six of them."""
Numbers = tuple[float | int | bool, ...]
"""The numbers of a whole package, vectors laid out flat."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """The layout of the data packages of one connection.

    Protocol 2 puts the recipe's number before the values; protocol 1 does so for inputs alone.
    """

    names: tuple[str, ...]
    """Variables, in the order of the package; a name may stand there twice."""
    types: tuple[DataType, ...]
    """Their types."""
    number: int | None = 1
    """The recipe's number on the wire; None where the packages carry none."""
    layout: struct.Struct = field(init=False, compare=False, repr=False)
    """The values alone, big-endian."""

    def __post_init__(self) -> None:
        codes = "".join(f"{kind.count}{kind.code}" for kind in self.types)
        object.__setattr__(self, "layout", struct.Struct(">" + codes))

    @classmethod
    def of(cls, names: Iterable[str], types: Iterable[str], number: int | None = 1) -> Recipe:
        """A recipe from the names asked for and the types answered.

        Raises:
            ProtocolError: A type that is none (`NOT_FOUND`, `IN_USE`), or not one for each name.
        """
        names, types = tuple(names), tuple(types)
        if len(names) != len(types):
            raise ProtocolError(
                "the controller's answer does not name one type for each variable",
                value=f"{len(types)} types",
                limit=f"{len(names)} variables",
            )
        bad = [
            f"{name} {kind}" for name, kind in zip(names, types, strict=True) if kind not in TYPES
        ]
        if bad:
            raise ProtocolError(
                "the controller refuses variables",
                value=", ".join(bad),
                next_step="NOT_FOUND: its software has no such variable; "
                "IN_USE: another client writes it",
            )
        return cls(names, tuple(TYPES[kind] for kind in types), number)

    @property
    def size(self) -> int:
        """Bytes of a payload."""
        return self.layout.size + (self.number is not None)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """A packed NumPy record of the values alone, big-endian, one entry a variable.

        Raises:
            ProtocolError: A name stands in the recipe twice.
        """
        if len(set(self.names)) != len(self.names):
            raise ProtocolError("a recipe with a repeated variable has no table", value=self.names)
        return np.dtype(
            [
                (name, f">{kind.code}", (kind.count,) if kind.count > 1 else ())
                for name, kind in zip(self.names, self.types, strict=True)
            ]
        )

    def pack(self, values: Mapping[str, Value]) -> bytes:
        """The payload of a data package, from one value a name."""
        numbers: list[float | int | bool] = []
        for name, kind in zip(self.names, self.types, strict=True):
            value = values[name]
            numbers.extend(value) if kind.count > 1 else numbers.append(value)  # pyright: ignore
        return self.pack_numbers(numbers)

    def pack_numbers(self, numbers: Iterable[float | int | bool]) -> bytes:
        """The payload of a data package, from its numbers laid out flat.

        Raises:
            ProtocolError: Too few or too many numbers, or one that its type cannot hold.
        """
        try:
            body = self.layout.pack(*numbers)
        except struct.error as error:
            raise ProtocolError(f"the numbers do not fit the recipe ({error})") from error
        return body if self.number is None else bytes((self.number,)) + body

    def packet(self, numbers: Iterable[float | int | bool]) -> bytes:
        """A whole data package with its header."""
        return HEADER.pack(HEADER.size + self.size, Kind.DATA_PACKAGE) + self.pack_numbers(numbers)

    def numbers(self, payload: bytes) -> Numbers:
        """The numbers of a payload, laid out flat.

        Raises:
            ProtocolError: A payload of another size or another recipe.
        """
        self._check(payload)
        return self.layout.unpack_from(payload, self.number is not None)

    def unpack(self, payload: bytes) -> dict[str, Value]:
        """The values of a payload by name; vectors are tuples.

        Raises:
            ProtocolError: A payload of another size or another recipe.
        """
        numbers = self.numbers(payload)
        values: dict[str, Value] = {}
        start = 0
        for name, kind in zip(self.names, self.types, strict=True):
            end = start + kind.count
            values[name] = numbers[start:end] if kind.count > 1 else numbers[start]
            start = end
        return values

    def table(self, payloads: Sequence[bytes]) -> NDArray[np.void]:
        """Many payloads as one structured array of `dtype`, in native byte order.

        Raises:
            ProtocolError: A payload of another size or another recipe.
        """
        for payload in payloads:
            self._check(payload)
        skip = self.number is not None
        rows = np.frombuffer(b"".join(payload[skip:] for payload in payloads), dtype=self.dtype)
        return rows.astype(self.dtype.newbyteorder("="))

    def _check(self, payload: bytes) -> None:
        if len(payload) != self.size:
            raise ProtocolError(
                "a data package has not the size of its recipe",
                value=f"{len(payload)} bytes",
                limit=f"{self.size} bytes",
            )
        if self.number is not None and payload[0] != self.number:
            raise ProtocolError(
                "a data package belongs to another recipe", value=payload[0], limit=self.number
            )
