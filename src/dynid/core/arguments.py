"""Arguments of the public verbs: of the kind that their annotation says, or refused by name."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from dynid.core.errors import InputError

_WORDS = {NoneType: "None", int: "a whole number, 0 or more", float: "a number"}
_UNIONS = (Union, UnionType)
_FAILURES = (AttributeError, LookupError, TypeError, ValueError)


def checked(verb: Callable[..., Any]) -> Callable[..., Any]:
    """A verb that fails on an argument of a wrong kind by naming it.

    Calls that work are left alone, and so are errors where all arguments are of the right kind.
    """
    signature, kinds = inspect.signature(verb), get_type_hints(verb)

    @wraps(verb)
    def call(*args: Any, **named: Any) -> Any:
        try:
            return verb(*args, **named)
        except _FAILURES as error:
            try:
                given = signature.bind(*args, **named)
            except TypeError:
                raise error from None
            for name, value in given.arguments.items():
                if not _fits(value, kinds[name]):
                    raise InputError(
                        f"the argument '{name}' of dynid.{verb.__name__}",
                        value=value if isinstance(value, Real) else type(value).__name__,
                        limit=" or ".join(dict.fromkeys(_words(kinds[name]))),
                    ) from error
            raise

    return call


def _fits(value: Any, kind: Any) -> bool:
    origin = get_origin(kind)
    if origin in _UNIONS:
        return any(_fits(value, one) for one in get_args(kind))
    if origin is Callable:
        return callable(value)
    if origin is Sequence:
        return hasattr(value, "__getitem__") and not isinstance(value, str | bytes | Mapping)
    if origin in (Mapping, tuple):
        return isinstance(value, origin)
    # Other generic classes, and protocols, are those of arrays.
    if (
        kind is Any
        or origin is not None
        or not isinstance(kind, type)
        or getattr(kind, "_is_protocol", False)
    ):
        return True
    if kind in (int, float):
        whole = isinstance(value, Integral) and float(value) >= 0
        return not isinstance(value, bool) and (whole if kind is int else isinstance(value, Real))
    return isinstance(value, kind)


def _words(kind: Any) -> list[str]:
    origin = get_origin(kind)
    if origin in _UNIONS:
        return [word for one in get_args(kind) for word in _words(one)]
    name = str(getattr(origin or kind, "__name__", kind))
    return [_WORDS.get(kind, name if origin is None else f"a {name.lower()}")]
