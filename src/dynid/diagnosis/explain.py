"""Which faults explain what the reference model leaves of a recording: the best, and its rivals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array
from dynid.diagnosis.hypotheses import Hypothesis, Scored, hypotheses, scores
from dynid.diagnosis.residual import Fits, Recording, Reference, fits, inertial_prior, reference
from dynid.diagnosis.whole_signals import whole_signals

LIKELY = 14.0
"""Drop of the left-out negative log likelihood that an explanation needs [nats]."""
WORTH_A_LOOK, LOOKS = 4.0, 4
"""Score with the noise of the reference from which a rival gets its own fit, and how many do."""
WHOLE_LIKELY, OFFSET_LIKELY = 24.0, 40.0
"""... of a signal that is reversed or exchanged: there are hundreds to choose from; and of one that
was shifted in time, which short motions without repetition bear better [nats]."""
CERTAIN = 4.0
"""... and its size over the standard deviation, from leaving blocks out."""
EQUAL = 0.8
"""Share of the best explanation's score from which another cannot be told from it."""
ROUNDS = 6
"""Passes: a large fault takes two or three until it is undone."""
MOST = 3
"""Faults that are looked for one after the other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """One fault that a recording shows."""

    kind: str
    """A kind of finding."""
    joints: tuple[int, ...]
    """Empty for the arm as a whole."""
    value: float
    std: float
    unit: str
    score: float
    """Drop of the negative log likelihood [nats]."""
    rivals: tuple[tuple[str, tuple[int, ...], float], ...] = ()
    """Kind, joints and value of explanations that cannot be told from it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explained:
    """What was found in a recording, and what is left of it."""

    found: tuple[Explanation, ...]
    reference: Reference
    """With all that was found undone."""
    values: Array
    """(p) its parameters."""
    left: Array
    """(n) RMS error that it leaves in blocks left out [N.m or N]."""


def explain(recording: Recording) -> Explained:
    """Look for faults one after the other; each is undone before the next is looked for."""
    prior = inertial_prior(recording)
    n = recording.robot.joints
    found: list[Explanation] = []
    added: list[Hypothesis] = []
    ref, sums, values = _fitted(recording, prior, added, prior[0])
    best_drop, start = 0.0, (ref, sums, values)
    for whole in whole_signals(ref, sums, values, prior):
        other = _fitted(whole.recording, prior, added, prior[0])
        drop = _drop(start, other)
        least = OFFSET_LIKELY if whole.kind == "clock_offset" else WHOLE_LIKELY
        if drop > max(best_drop, least):
            best_drop, recording, values = drop, whole.recording, other[2]
            found = [
                Explanation(
                    kind=whole.kind, joints=whole.joints, value=whole.value, std=0.0,
                    unit=whole.unit, score=drop,
                )
            ]  # fmt: skip
    rounds = 0
    while True:
        ref, _, values = _fitted(recording, prior, added, values[: 10 * n])
        rivals = hypotheses(ref, values)
        sums, _ = fits(ref, np.concatenate([rival.columns for rival in rivals]))
        scored, errors = scores(sums, rivals)
        worth = [s.hypothesis for s in scored if s.score > WORTH_A_LOOK][:LOOKS]
        admitted = [s for s in (_alone(ref, rival) for rival in worth) if _admitted(s)]
        admitted.sort(key=lambda s: -s.score)
        if not admitted:
            break
        best = admitted[0].hypothesis
        before = next((e for e in found if _same(e, best)), None)
        if before is None and len(found) == MOST:
            break
        rounds += 1
        if rounds > ROUNDS or (before is not None and best.undo is None):
            break
        if before is not None:
            found.remove(before)
        found.append(_explanation(admitted[0], admitted[1:], before))
        if best.undo is None:
            added.append(best)
        else:
            recording = best.undo(recording, admitted[0].values)
    left = np.sqrt(errors / sums.rows)
    return Explained(found=tuple(found), reference=ref, values=values, left=left)


_Fitted = tuple[Reference, Fits, Array]


def _drop(one: _Fitted, other: _Fitted) -> float:
    """Drop of the negative log likelihood and prior from one fit to another [nats].

    All joints count alike: an exchange must not gain from joints that count differently.
    """
    count = float(np.median(other[1].counts))

    def cost(ref: Reference, sums: Fits, values: Array) -> float:
        error = ref.torque - np.tensordot(values, ref.columns, axes=1)
        left = np.square(error).mean(axis=1) + 1e-18
        return 0.5 * count * float(np.log(left).sum()) + sums.penalty(values)

    return cost(*one) - cost(*other)


def _alone(ref: Reference, rival: Hypothesis) -> Scored:
    """A rival with the noise that is left where it is true, not where it is not."""
    p, m = len(ref.columns), len(rival.columns)
    precision = np.zeros((p + m, p + m))
    precision[:p, :p] = ref.precision
    precision[range(p, p + m), range(p, p + m)] = 1 / np.square(rival.width)
    widened = replace(
        ref,
        columns=np.concatenate([ref.columns, rival.columns]),
        mean=np.concatenate([ref.mean, np.zeros(m)]),
        precision=precision,
    )
    sums, _ = fits(widened, np.zeros((0, *ref.torque.shape)))
    sums = replace(sums, own=p, mean=ref.mean, precision=ref.precision)
    return scores(sums, [rival])[0][0]


def _same(found: Explanation, now: Hypothesis) -> bool:
    """Whether a fault adds to one that was found before."""
    if found.kind == "clock_offset":
        return now.kind == "delay" and len(now.joints) > 1
    return (found.kind, found.joints) == (now.kind, now.joints)


def _fitted(
    recording: Recording, prior: tuple[Array, Array], added: list[Hypothesis], inertial: Array
) -> _Fitted:
    columns = np.concatenate([h.columns for h in added]) if added else None
    spread = np.concatenate([h.width for h in added]) if added else None
    ref = reference(recording, prior, inertial, columns, spread)
    sums, values = fits(ref, np.zeros((0, *ref.torque.shape)))
    return ref, sums, values


def _admitted(scored: Scored) -> bool:
    size = abs(scored.value)
    return scored.score > LIKELY and size > CERTAIN * scored.std and size > scored.hypothesis.least


def _explanation(best: Scored, others: list[Scored], before: Explanation | None) -> Explanation:
    known, value = best.hypothesis, best.value
    now = Explanation(
        kind=known.kind,
        joints=known.joints,
        value=value,
        std=best.std,
        unit=known.unit,
        score=best.score,
        rivals=tuple(
            (s.hypothesis.kind, s.hypothesis.joints, s.value)
            for s in others
            if s.score > EQUAL * best.score
        ),
    )
    if before is None:
        return now
    gain = known.kind in ("drive_gain", "gain_all")
    value = (1 + before.value) * (1 + value) - 1 if gain else before.value + value
    return replace(before, value=value, std=best.std, score=before.score + best.score)
