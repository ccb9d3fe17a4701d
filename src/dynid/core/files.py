"""Files written whole or not at all, and where a result comes from."""

import errno
import hashlib
import itertools
import json
import os
import platform
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from dynid.core.errors import DynidError, InputError, JobError

_NO_SUCH_PLACE = frozenset(
    {
        errno.ENOENT,
        errno.ENOTDIR,
        errno.EISDIR,
        errno.EEXIST,
        errno.EACCES,
        errno.EPERM,
        errno.EROFS,
        errno.ENAMETOOLONG,
        errno.ELOOP,
    }
)
"""What systems say of a place that the caller chose badly."""


def cannot_write(path: Path, error: OSError | ValueError) -> DynidError:
    """The error to raise where a file cannot be written: the caller's fault or the disk's.

    It follows from what the system said; a ValueError where the name is none for a file.
    """
    if isinstance(error, ValueError) or error.errno in _NO_SUCH_PLACE:
        return InputError(
            "the file cannot be written",
            where=str(path),
            value=getattr(error, "strerror", None) or str(error),
            next_step="Name a file in a folder that exists and may be written to.",
        )
    return JobError(
        "the file cannot be written", where=str(path), value=error.strerror or str(error)
    )


def file_behind(path: Path) -> Path:
    """The file that a name stands for: a link stays a link, what it points to is written.

    Raises:
        InputError: A device or a pipe: a rename would put a file in its place. Or the root folder.
    """
    try:
        target = Path(os.path.realpath(path))
        special = target.exists() and not (target.is_file() or (target.is_dir() and target.name))
    except (OSError, ValueError) as error:
        # A name that is too long shows when it is looked for.
        raise cannot_write(path, error) from error
    if special:
        raise InputError(
            "this is no ordinary file", where=str(path), next_step="Name a file that can be kept."
        )
    return target


def require_absent(*paths: Path, force: bool) -> None:
    """Refuse to write where a file stands, unless `force` says that it may be replaced.

    Raises:
        InputError: A file stands there.
    """
    # os.path says False where Path raises, as for names that no file can have.
    there = None if force else next((path for path in paths if os.path.exists(path)), None)
    if there is not None:
        raise InputError(
            "the file exists, and nothing is replaced unasked",
            where=str(there),
            next_step="Name another file, or pass --force.",
        )
    for path in map(str, paths):
        (_ABSENT.discard if force else _ABSENT.add)(os.path.realpath(path))


_ABSENT: set[str] = set()
"""Files that were not there and must not be replaced, until this process has written them."""


def free_name(path: Path, before: str, behind: str = "") -> Path:
    """A free name beside a file that must stay: the first free number between two texts."""
    names = (path.with_name(f"{before}{number}{behind}") for number in itertools.count(1))
    return next(name for name in names if not name.exists())


def make_folder(path: str | Path) -> Path:
    """A folder, made where it is missing.

    Raises:
        InputError: A place where no folder can be.
        JobError: The disk does not take it.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise cannot_write(folder, error) from error
    return folder


@contextmanager
def in_one_piece(path: Path, suffix: str = ".part") -> Generator[Path]:
    """Write a file whole or not at all: an interrupt leaves the old file.

    A file that `require_absent` did not find and that is there now stays as well: the new one is
    written beside it.

    Yields:
        The draft to write, whose name ends as told and which is renamed to the file at the end.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it, or another program has written such a file.
    """
    # Beside the file: only within one folder does a rename happen in one piece.
    path = file_behind(path)
    part = path.with_name(f".{path.name}.{os.getpid()}{suffix}")
    try:
        try:
            yield part
            _publish(part, path)
        finally:
            part.unlink(missing_ok=True)
    except (OSError, UnicodeError) as error:
        raise cannot_write(path, error) from error


def _publish(part: Path, path: Path) -> None:
    if str(path) not in _ABSENT:
        part.replace(path)
        return
    if _moved(part, path):
        _ABSENT.discard(str(path))
        return
    beside = path
    while not _moved(part, beside):
        beside = free_name(path, f"{path.stem}.new-", path.suffix)
    raise JobError(
        f"the file appeared while this was at work, and stays; the result is in {beside}",
        where=str(path),
        next_step="Rename one of the two, or pass --force next time.",
    )


def _moved(part: Path, path: Path) -> bool:
    """Give a draft its name, unless a file has it: a link, unlike a rename, replaces nothing."""
    try:
        os.link(part, path)
    except FileExistsError:
        return False
    except OSError:
        # A file system without links.
        if os.path.exists(path):
            return False
        part.replace(path)
    return True


def write_text(path: Path, text: str) -> None:
    """Write a file in one piece.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    with in_one_piece(path) as part:
        part.write_text(text, encoding="utf-8")


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a JSON object in one piece.

    Raises:
        InputError: Something that JSON cannot hold, as NaN, or a place where no such file can be.
        JobError: The disk does not take it.
    """
    try:
        text = json.dumps(data, indent=1, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            "only JSON values can be kept in a file", where=str(path), value=str(error)
        ) from error
    write_text(path, text + "\n")


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What is needed to make a result again."""

    created: str
    """UTC time, ISO 8601."""
    versions: Mapping[str, str]
    """Package name to version; `python` included."""
    inputs: Mapping[str, str] = field(default_factory=dict[str, str])
    """Input path to SHA-256 of its bytes."""
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Settings as given, JSON values only."""
    seed: int | None = None
    """The seed, where randomness was used."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {item.name: getattr(self, item.name) for item in fields(self)}


def provenance(
    inputs: Mapping[str, str] | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int | None = None,
) -> Provenance:
    """A provenance stamped now."""
    packages = ("dynid", "numpy", "scipy", "numba")
    return Provenance(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        versions={"python": platform.python_version(), **{p: _version_of(p) for p in packages}},
        inputs=dict(inputs or {}),
        settings=dict(settings or {}),
        seed=seed,
    )


def dynid_version() -> str:
    """The version of this package; `unknown` where it is not installed."""
    return _version_of("dynid")


def _version_of(package: str) -> str:
    # Loaded here: it brings the parser of e-mails, a sixth of the start of a command.
    from importlib import metadata

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def content_hash(value: object, digits: int = 17) -> str:
    """SHA-256 of JSON values, as hex; the order of keys and the type of a number do not count.

    Args:
        value: Mappings, sequences, texts, numbers, truth values and None.
        digits: Of a number; fewer leave room for the rounding of other machines.
    """
    text = json.dumps(_canonical(value, digits), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _canonical(value: object, digits: int) -> object:
    if isinstance(value, Mapping):
        items = cast("Mapping[str, object]", value).items()
        return {str(key): _canonical(item, digits) for key, item in items}
    if isinstance(value, list | tuple):
        return [_canonical(item, digits) for item in cast("list[object]", value)]
    if isinstance(value, int | float) and not isinstance(value, bool):
        # Adding zero makes no difference between 0 and -0.
        return f"{value + 0.0:.{digits}g}" if abs(value) < 1e300 else repr(value)
    return value


def file_hash(path: Path) -> str:
    """SHA-256 of a file, as hex."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while chunk := stream.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()
