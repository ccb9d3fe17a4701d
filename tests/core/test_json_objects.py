"""What JSON objects become, by the annotations of fields."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from dynid.core import Array, InputError, JsonFields, Value, plain


@dataclass(frozen=True, slots=True, kw_only=True)
class Inner(Value):
    values: Array
    name: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Outer(Value):
    inner: Inner
    height: float | str
    pair: tuple[float, float]
    parts: tuple[Inner, ...] = ()
    known: Mapping[str, float] = field(default_factory=dict[str, float])
    done: bool = False


def test_what_was_written_by_fields_is_read_by_their_annotations() -> None:
    inner = Inner(values=np.array([[1.0, np.nan], [2.0, 3.0]]))
    for height in (0.5, "mount"):
        value = Outer(
            inner=inner,
            height=height,
            pair=(1.0, math.nan),
            parts=(inner, Inner(values=np.zeros(0), name="x")),
            known={"a": 1.0},
            done=True,
        )
        assert JsonFields(json.loads(json.dumps(plain(value)))).made(Outer) == value


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"inner": 1}, "f.inner must be a JSON object"),
        ({"inner": {}}, "f.inner.values is missing"),
        ({"inner": {"values": [[1], [1, 2]]}}, "f.inner.values must have rows of one length"),
        ({"inner": {"values": [1], "name": 2}}, "f.inner.name must be a text"),
        ({"height": []}, "f.height must be a text"),
        ({"pair": [1]}, "f.pair: another number of values"),
        ({"parts": [1]}, "f.parts must be a JSON object"),
        ({"known": {"a": True}}, "f.known.a must be a number"),
        ({"done": 1}, "f.done must be true or false"),
    ],
)
def test_a_field_that_is_none_is_named(change: dict[str, Any], said: str) -> None:
    good: dict[str, Any] = {"inner": {"values": [1]}, "height": 1, "pair": [1, 2]}
    assert JsonFields(good).made(Outer).parts == ()
    with pytest.raises(InputError, match=re.escape(said)):
        JsonFields(good | change, "f.").made(Outer)
