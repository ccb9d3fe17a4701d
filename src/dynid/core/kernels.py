"""Compiled kernels: where Numba keeps them, and when it compiles them again.

Numba compares the file of a function alone. Kernels and numbers of other files are compiled into
it, and those of before an upgrade or a `git pull` would stay: distances without the correction of
the function that they call.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from stat import S_ISDIR
from tempfile import gettempdir
from typing import Any, TypeVar

_F = TypeVar("_F", bound=Callable[..., Any])
_SOURCES: dict[int, str] = {}
"""Digests of what kernels are compiled from, by `id`: modules keep their kernels."""


def compiled(*, cache: bool = True, **options: Any) -> Callable[[_F], _F]:
    """Compile a function by Numba, and keep it until its file or what it uses of others changes.

    Args:
        cache: Whether it is kept; not where it only becomes part of others.
        options: Further ones of `numba.njit`.
    """
    place_compiled()
    from numba import njit

    def decorate(function: _F) -> _F:
        kernel: Any = njit(cache=cache, **options)(function)
        digest = hashlib.sha256(Path(function.__code__.co_filename).read_bytes())
        for value in function.__globals__.values():
            used = value if isinstance(value, (int, float)) else _SOURCES.get(id(value))
            digest.update(repr(used).encode())
        _SOURCES[id(kernel)] = digest.hexdigest()
        if cache and kernel is not function:  # NUMBA_DISABLE_JIT compiles nothing.
            # Numba has no public way to name what else a kernel depends on.
            kernel._cache._cache_file._source_stamp = digest.hexdigest()
        return kernel

    return decorate


def place_compiled() -> None:
    """Name a place for compiled kernels where Numba has none: sources and home are read-only.

    It is this account's alone: what is read from there is run.
    """
    sources = os.path.dirname(__file__)
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    while not os.path.exists(home) and home != os.path.dirname(home):
        home = os.path.dirname(home)
    if "NUMBA_CACHE_DIR" in os.environ or any(os.access(at, os.W_OK) for at in (sources, home)):
        return
    place = os.path.join(gettempdir(), f"dynid-{os.getuid()}")
    try:
        os.makedirs(place, mode=0o700, exist_ok=True)
        found = os.lstat(place)
    except OSError:
        return
    if S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o77:
        os.environ["NUMBA_CACHE_DIR"] = place
