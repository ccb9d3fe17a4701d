"""Recordings of hours: choices on a part of them, one pass over everything, constant memory."""

import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from dynid import core, identification, signals, validation
from dynid.recording import AnyRecording, ExperimentRecord, checked_records, fingerprint
from dynid.robot import RobotModel
from dynid.settings import IdentifySettings
from dynid.workflow.choosing import made_from, prepare, require_cutoff, require_torques

CHOOSING_ROWS = 90_000
"""Rows that choices are made on: three minutes at 500 Hz."""
FEWEST_PIECES, MOST_PIECES = 12, 36
"""Stretches of the recordings that these rows are taken from."""
CANDIDATES = 4
"""Places where a stretch may be taken: the one where the arm moves most."""
LOOKED_AT_ROWS = 60_000
"""Rows in a row that faults are looked for in."""
MOST_LEFT_OUT = 64
"""Recordings that are left out one by one; of more, neighbours together."""
PART = 1 << 16
"""Samples that are summed at a time."""
SAVE_S = 5.0
"""How often the sums are kept [s]."""
CHOOSING_SHARE = 0.3
"""Of the progress."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """An estimate, and the recordings that are looked at for faults."""

    estimate: identification.Estimate
    training: validation.ValidationResult
    records: tuple[ExperimentRecord, ...]
    window: signals.ProcessingSettings
    """Which window of these recordings."""


def fit_long(
    recordings: Sequence[AnyRecording],
    robot: RobotModel,
    settings: IdentifySettings,
    *,
    partial: Path | None = None,
    beside: core.Workers | None = None,
    progress: core.Progress | None = None,
) -> Looked:
    """Choose on a part of the recordings, then fit all of their rows; see `identify`.

    The file `partial` keeps the sums while the pass runs.

    Raises:
        InputError: An estimator that needs all rows at once, or a recording given twice.
    """
    tell = progress or core.silent
    tell("looking at the recordings", 0.0)
    if len({fingerprint(recording) for recording in recordings}) < len(recordings):
        raise core.InputError("a recording is given twice", value=f"{len(recordings)} recordings")
    grids = [
        signals.survey(recording, settings.start_s, settings.stop_s) for recording in recordings
    ]
    require_cutoff(min(grid.rate_hz for grid in grids), settings.cutoff_hz)
    pieces, origins, stretch = _subset(recordings, grids)
    for _, own in groupby(zip(origins, pieces, strict=True), key=lambda pair: pair[0][0]):
        require_torques([piece for _, piece in own], robot)
    looked_at = checked_records([stretch])[0]
    processing = signals.ProcessingSettings(cutoff_hz=settings.cutoff_hz, decimate=True)
    if settings.preset != "best" and settings.cutoff_hz is None:
        # One for all, which suits the fastest piece.
        uniform = [signals.uniform_signals(piece, robot, processing) for piece in pieces]
        cutoff = max(signals.default_cutoff(found.q, found.rate_hz) for found in uniform)
        processing = replace(processing, cutoff_hz=cutoff)
    found = prepare(
        pieces,
        robot,
        settings,
        processing,
        made_from(recordings, settings),
        lambda what, share: tell(what, CHOOSING_SHARE * share),
    )
    estimator = found.estimator
    if not estimator.by_factors:
        raise core.InputError(
            "this estimator needs all rows at once, and the recordings are too long for that",
            where="--estimator",
            value=estimator.name,
            next_step="Take ols, wls, tls or sdp, or a window with --from and --to.",
        )
    settled = replace(
        found.source.settings,
        cutoff_hz=found.samples.cutoff_hz,
        start_s=settings.start_s,
        stop_s=settings.stop_s,
    )
    everything = [
        signals.LongSignals(
            recording=recording,
            robot=robot,
            settings=settled,
            grid=grid,
            encoder_noise=found.samples.encoder_noise,
        )
        for recording, grid in zip(recordings, grids, strict=True)
    ]
    rows = sum(map(_rows, everything))
    halves: list[tuple[int, bool]] = []
    if len(recordings) > 1:
        halves = [(_group(k, len(recordings)), later) for k, later in origins]
    planned = identification.plan_pass(found, rows, halves)
    sums = _run_pass(
        everything,
        planned.plan,
        beside=beside or core.Workers(),
        partial=partial,
        tell=lambda what, share: tell(what, CHOOSING_SHARE + (1 - CHOOSING_SHARE) * share),
    )
    method = "factors" if planned.plan.factors else "products"
    duration = np.median([piece.duration_s for piece in pieces])
    words = (
        f"long recordings: choices from {len(pieces)} stretches of {duration:.3g} s, fit of "
        f"all {rows} rows by {method}"
    )
    source = replace(found.source, choices=(*found.source.choices, words))
    estimate = identification.fit_estimate(
        replace(found, source=source), replace(planned, sums=sums)
    )
    return Looked(
        estimate=replace(estimate, settings=settled),
        training=validation.reproduce(estimate, looked_at),
        records=(looked_at,),
        window=signals.ProcessingSettings(),
    )


def _subset(
    recordings: Sequence[AnyRecording], grids: Sequence[signals.StreamGrid]
) -> tuple[list[ExperimentRecord], list[tuple[int, bool]], ExperimentRecord]:
    """Pieces spread evenly over the windows of the recordings, where the arm moves most.

    With the number of the recording that each is of, whether it is in its later half, and a longer
    stretch about the piece in which the arm moves most.
    """
    counts = np.array([grid.last_row - grid.first_row for grid in grids])
    ends = np.cumsum(counts)
    number = int(np.clip(len(recordings), FEWEST_PIECES, MOST_PIECES))
    length = min(CHOOSING_ROWS // number, int(ends[-1]) // number)
    best: list[tuple[float, int, int, int]] = []
    for piece in range(number):
        begin, end = piece * int(ends[-1]) // number, (piece + 1) * int(ends[-1]) // number
        tried: list[tuple[float, int, int, int]] = []
        for k in range(CANDIDATES):
            place = begin + k * max(end - length - begin, 0) // (CANDIDATES - 1)
            source = int(np.searchsorted(ends, place, side="right"))
            own, grid = int(counts[source]), grids[source]
            offset = place - int(ends[source]) + own
            first = grid.first_row + min(offset, max(own - length, 0))
            last = min(first + length, grid.last_row)
            moved = signals.rows_of(recordings[source], first, last, positions=True).signals["q"]
            tried.append((float(np.abs(np.diff(moved, axis=0)).sum()), source, first, last))
        best.append(max(tried, key=lambda one: one[0]))
    _, source, first, last = max(best, key=lambda one: one[0])
    grid, half = grids[source], LOOKED_AT_ROWS // 2
    middle = min(max((first + last) // 2, grid.first_row + half), grid.last_row - half)
    begin, end = max(middle - half, grid.first_row), min(middle + half, grid.last_row)
    pieces = [signals.rows_of(recordings[k], a, b) for _, k, a, b in best]
    origins = [(k, a + b > grids[k].first_row + grids[k].last_row) for _, k, a, b in best]
    return pieces, origins, signals.rows_of(recordings[source], begin, end)


@dataclass(frozen=True, slots=True, kw_only=True)
class _PassPart:
    """Some samples of one recording, for a worker."""

    whole: signals.LongSignals
    plan: identification.PassPlan
    first: int
    last: int
    rows_before: int
    rows: int
    """Of all recordings."""
    left_out_with: int


def _sum_part(part: _PassPart) -> identification.RowSums:
    """The sums of a part, in any process."""
    whole, passed = part.whole, part.whole.settings.torque_filter
    reach = 0 if passed is None else passed.reach(whole.grid.rate_hz)
    wide = max(part.first - reach, 0)
    samples = whole.samples(wide, min(part.last + reach, whole.count))
    inner = slice(part.first - wide, part.last - wide)
    panels = identification.PanelRows(part.plan.base)
    return identification.sum_rows(
        panels, part.plan, samples, inner, part.rows_before, part.rows, part.left_out_with
    )


def _run_pass(
    everything: Sequence[signals.LongSignals],
    plan: identification.PassPlan,
    *,
    beside: core.Workers,
    partial: Path | None,
    tell: core.Progress,
) -> identification.RowSums:
    """Sum all rows, from where the interrupted pass of the file `partial` stopped."""
    parts = list(_parts(everything, plan))
    sums = identification.no_sums(everything[0].robot.joints, plan.base.rank)
    done, key = 0, _key(parts)
    if partial is not None:
        done, sums = _kept(partial, key, sums)
    waiting: dict[int, identification.RowSums] = {}
    saved = time.monotonic()
    offset, todo = done, parts[done:]
    words = "summing all rows" if done == 0 else "summing the rows that an interrupted pass left"
    for number, found in core.each(_sum_part, todo, beside):
        # In their order, whoever was first: the same result to the last bit.
        waiting[offset + number] = found
        while done in waiting:
            sums.add(waiting.pop(done))
            done += 1
        tell(words, done / len(parts))
        if partial is not None and time.monotonic() - saved > SAVE_S:
            # A disk without room for it costs an interrupted pass, not this one.
            with suppress(core.DynidError):
                core.write_arrays(partial, {"key": key, "done": done, **sums.arrays()})
            saved = time.monotonic()
    if partial is not None:
        partial.unlink(missing_ok=True)
    return sums


def _group(recording: int, recordings: int) -> int:
    """The recordings that one is left out with."""
    return recording * min(recordings, MOST_LEFT_OUT) // recordings


def _rows(whole: signals.LongSignals) -> int:
    return (whole.used.stop - whole.used.start) // whole.block


def _parts(
    everything: Sequence[signals.LongSignals], plan: identification.PassPlan
) -> Iterator[_PassPart]:
    rows = sum(map(_rows, everything))
    before = 0
    for recording, whole in enumerate(everything):
        start, count = whole.used.start, _rows(whole) * whole.block
        step = max(1, PART // whole.block) * whole.block
        for first in range(start, start + count, step):
            last = min(first + step, start + count)
            yield _PassPart(
                whole=whole,
                plan=plan,
                first=first,
                last=last,
                rows_before=before + (first - start) // whole.block,
                rows=rows,
                left_out_with=plan.left_out_with(
                    _group(recording, len(everything)), 2 * (first - start) >= count
                ),
            )
        before += _rows(whole)


def _key(parts: Sequence[_PassPart]) -> str:
    """What tells a pass from every other: its recordings, its plan, its parts."""
    plan = parts[0].plan
    digest = hashlib.sha256()
    for part in parts:
        if part.first == part.whole.used.start:
            settings = json.dumps(part.whole.settings.to_json(), sort_keys=True)
            digest.update(f"{fingerprint(part.whole.recording)} {settings}".encode())
    for values in (plan.values, plan.weights, np.array([plan.lag, len(parts), parts[0].rows])):
        digest.update(np.asarray(values, dtype=np.float64).tobytes())
    told = plan.base.model.friction, plan.base.independent, plan.factors, plan.halved
    digest.update(repr(told).encode())
    return digest.hexdigest()


def _kept(
    path: Path, key: str, nothing: identification.RowSums
) -> tuple[int, identification.RowSums]:
    """Parts done and their sums; none where the file is another pass's, or damaged."""
    arrays = core.read_arrays(path)
    if str(arrays.pop("key", "")) != key:
        return 0, nothing
    return int(arrays.pop("done")), identification.sums_from(arrays)
