"""Record while a robot moves: what was appended a second ago survives a crash or power cut."""

import json
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, Finding, InputError, JobError, RecordError, free_name, require_absent
from dynid.recording import content, records, store

_FLUSH_S = 0.5
_FLUSH_ROWS = 4096
_SPARE_BYTES = 32 << 20
"""Room that must be left whatever the recording takes."""


class RecordWriter:
    """Appends samples to a recording; a context manager.

    Rows go to `PATH.partial` at least twice a second, pushed to the disk from a second thread
    so that the control loop never waits for it. Closing turns them into the Parquet file and
    removes the partial file; after a crash `read_record(PATH)` reads the partial file.

    A finding `aborted`, reported or left by an exception inside the context, makes it a recording
    that was stopped: it keeps the finding, and never takes the place of another recording but is
    written beside it.

    Args:
        path: The Parquet file to make.
        joint_names: One name a joint, in column order.
        quantities: The signals that every row brings; `q` among them.
        metadata: Where the recording comes from; `joint_names` are filled in.
        channels: Names of scalar columns that every row brings.
        force: Whether a recording that stands there may be replaced, by one that was not stopped.
        expected_samples: Rows to come, for which the disk must have room; None if not known.

    Raises:
        RecordError: Unknown quantities, no joints, another writer on the same file, or a file
            that stands there.
        JobError: The file cannot be written, or the disk has no room for it.
    """

    def __init__(
        self,
        path: str | Path,
        joint_names: Sequence[str],
        quantities: Sequence[str],
        metadata: records.RecordMetadata | None = None,
        *,
        channels: Sequence[str] = (),
        force: bool = False,
        expected_samples: int | None = None,
    ) -> None:
        self.path = Path(path)
        self.record_path: Path = store.partial_path(self.path)
        """Where the rows are: the partial file, and the recording once it is closed."""
        self._force = force
        self._aborted = False
        require_absent(self.path, force=force)
        self._quantities = records.check_quantities(quantities)
        self._channels = tuple(channels)
        self._joints = len(joint_names)
        if self._joints == 0 or len(set(self._channels)) != len(self._channels):
            what = "a recording needs joints, and channels of different names"
            raise RecordError(what, value=(tuple(joint_names), self._channels))
        self._width = 1 + self._joints * len(self._quantities) + len(self._channels)
        _require_space(self.path, self._width, expected_samples)
        self._buffer: list[Array] = []
        self._last_t = -np.inf
        self._flushed = time.monotonic()
        self._samples = self._saved = self._end = 0
        self._sync: Future[None] | None = None
        metadata = replace(metadata or records.RecordMetadata(), joint_names=tuple(joint_names))
        description = {
            "quantities": list(self._quantities),
            "joints": self._joints,
            "channels": list(self._channels),
            "metadata": records.metadata_to_json(metadata),
        }
        self._partial = store.partial_path(self.path)
        self._file: int | None
        self.left: Path | None
        """Where the rows of an earlier run are that was interrupted; None if there was none."""
        self._file, self.left = store.create_partial(self._partial)
        self._disk = ThreadPoolExecutor(1, thread_name_prefix="dynid-record")
        try:
            self._write(store.MARK + store.pack(b"H", json.dumps(description).encode()))
        except JobError:
            # Nothing was recorded: nothing is left, least of all the lock on it.
            os.close(self._file)
            self._partial.unlink(missing_ok=True)
            raise

    @property
    def samples(self) -> int:
        """Rows appended so far."""
        return self._samples

    @property
    def saved_samples(self) -> int:
        """Rows in the file: fewer than were appended where the disk refused some."""
        return self._saved

    def append(
        self,
        t: float,
        signals: Mapping[str, ArrayLike],
        channels: Mapping[str, float] | None = None,
    ) -> None:
        """Append one sample.

        Args:
            t: Time [s], larger than the sample before.
            signals: Every quantity of this recording to (n) values, SI units.
            channels: Every channel to its value.

        Raises:
            RecordError: Missing or extra signals, wrong shapes, values that are not finite, or
                time that does not increase. Nothing is appended then.
            JobError: The disk refuses the rows.
        """
        channels = channels or {}
        if set(signals) != set(self._quantities) or set(channels) != set(self._channels):
            raise RecordError(
                "a sample must have exactly the signals of the recording",
                value=(*signals, *channels),
                limit=(*self._quantities, *self._channels),
            )
        if not np.isfinite(t) or t <= self._last_t:
            raise RecordError("time must increase", value=t, limit=f"above {self._last_t}")
        row = np.empty(self._width)
        row[0], at = t, 1
        for name in self._quantities:
            try:
                value = np.asarray(signals[name], dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise RecordError(f"{name} must be numbers", value=signals[name]) from error
            if value.shape != (self._joints,) or not np.isfinite(value).all():
                what = f"{name} must be {self._joints} finite numbers"
                raise RecordError(what, value=value.tolist())
            row[at : at + self._joints] = value
            at += self._joints
        row[at:] = [channels[name] for name in self._channels]
        if self._file is None:
            raise RecordError("the recording is closed", where=str(self.path))
        self._buffer.append(row)
        self._last_t = float(t)
        self._samples += 1
        waited = time.monotonic() - self._flushed
        recorded = t - float(self._buffer[0][0])
        if max(waited, recorded) >= _FLUSH_S or len(self._buffer) >= _FLUSH_ROWS:
            self.flush()

    def report(self, problem: Finding) -> None:
        """Add to the recording's problems: a gap, a stop, a late robot.

        Raises:
            JobError: The disk refuses it.
        """
        self._aborted = self._aborted or problem.kind == "aborted"
        self._write(store.pack(b"N", json.dumps(problem.to_json()).encode()))

    def flush(self) -> None:
        """Hand all rows to the operating system now, and to the disk soon.

        Raises:
            JobError: The disk refused this write, or an earlier one.
        """
        self._flushed = time.monotonic()
        if self._buffer:
            rows, self._buffer = self._buffer, []
            self._write(store.pack(b"R", np.stack(rows).astype("<f8").tobytes()))
            self._saved += len(rows)
        if self._file is not None and (self._sync is None or self._sync.done()):
            self._raise_sync()
            self._sync = self._disk.submit(os.fsync, self._file)

    def close(self) -> None:
        """Turn the rows into the Parquet file.

        Raises:
            RecordError: Fewer than two samples; nothing stays.
            JobError: The file cannot be written; the partial file stays.
        """
        if self._file is None:
            return
        try:
            self.flush()
            self._disk.shutdown(wait=True)
            self._raise_sync()
            # Read from the open file: the rows are there even if its name or folder was removed.
            record = store.recover(self._partial, self._file, finished=True)
            if self._aborted and all(problem.kind != "aborted" for problem in record.problems):
                text = f"the recording was stopped after {record.samples} samples: disk error"
                record = replace(record, problems=(*record.problems, Finding("aborted", text)))
        finally:
            self._disk.shutdown(wait=True)
            os.close(self._file)
            self._file = None
            if self._saved < 2:
                # One row is no recording.
                self._partial.unlink(missing_ok=True)
        stands = self.path.exists() and (self._aborted or not self._force)
        why = "aborted" if self._aborted else "new"
        beside = free_name(self.path, f"{self.path.stem}.{why}-", self.path.suffix)
        target = beside if stands else self.path
        with suppress(OSError):
            target.parent.mkdir(parents=True, exist_ok=True)
        store.write_record(record, target, force=True)
        self._partial.unlink(missing_ok=True)
        self.record_path, self._saved = target, record.samples

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        # A disk that takes no more; what it has is closed all the same.
        with suppress(JobError):
            if error is not None and self._file is not None and not self._aborted:
                self.report(Finding("aborted", f"the recording was stopped: {content.said(error)}"))
        try:
            self.close()
        except (InputError, JobError):
            # The rows stay readable in the partial file; the first error is the one to show.
            if error is None:
                raise

    def _write(self, data: bytes) -> None:
        if self._file is None:
            raise RecordError("the recording is closed", where=str(self.path))
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._file, view) :]
        except OSError as error:
            # Rows are missing: this recording takes no other's place.
            self._aborted = True
            with suppress(OSError):
                # Half a segment would hide all that may still follow.
                os.ftruncate(self._file, self._end)
                os.lseek(self._file, self._end, os.SEEK_SET)
            raise self._unwritten(str(error.strerror)) from error
        self._end += len(data)

    def _raise_sync(self) -> None:
        if self._sync is not None and self._sync.done() and (error := self._sync.exception()):
            self._aborted = True
            raise self._unwritten(str(error)) from error

    def _unwritten(self, why: str) -> JobError:
        return JobError(
            f"the recording cannot be written; {self._saved} samples are on the disk",
            where=str(self._partial),
            value=why,
            next_step=store.read_partial(self._partial) if self._saved else None,
        )


def _require_space(path: Path, width: int, samples: int | None) -> None:
    """Refuse to start a recording for which the disk has no room.

    Raises:
        JobError: It has not.
    """
    # Rows are there twice while the Parquet file is made of the partial one.
    needed = _SPARE_BYTES + 2 * 8 * width * (samples or 0)
    try:
        free = shutil.disk_usage(path.parent).free
    except OSError:
        # Creating the file says what is wrong with the place.
        return
    if free < needed:
        raise JobError(
            "the disk has no room for the recording",
            where=str(path.parent),
            value=f"{free >> 20} MB free",
            limit=f"{needed >> 20} MB needed",
            next_step="Free some space, or record to another disk.",
        )
