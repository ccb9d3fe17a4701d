"""Which faults explain what the reference model leaves of a recording: the best, and its rivals."""

from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, scipy_part
from dynid.diagnosis import events, residual, whole_signals
from dynid.diagnosis.evidence import Scored, drops, score
from dynid.diagnosis.hypotheses import COUPLED, Hypothesis, Undo, hypotheses
from dynid.diagnosis.prior import link_prior, with_payload
from dynid.diagnosis.residual import Fits, Recording, Reference

EVIDENT, BY_CHANCE = 5.0, 0.01
"""Log of the Bayes factor over none that an explanation needs [nats], and the chance (Student's t
of the blocks left out) by which one of its sizes is that large where there is none."""
LIKELY = 22.0
"""... and the drop of the left-out negative log likelihood where only one of two fits shows it
[nats]."""
LIKE_FRICTION = frozenset({"flexibility"})
"""Kinds with torques like those of friction that builds up: fast rows alone do not show them."""
WORTH_A_LOOK, LOOKS = 4.0, 8
"""Drop of the negative log likelihood from which a rival gets its own fit, and how many do."""
WHOLE_LIKELY, OFFSET_LIKELY = 24.0, 40.0
"""Drop that a signal needs that is reversed or exchanged: there are hundreds to choose from; and
one that was shifted in time, which short motions without repetition bear better, and motors that
are coupled, whose friction may take any shape [nats]."""
EQUAL = 0.8
"""Share of the best explanation's score from which another cannot be told from it."""
TURNS, FINEST_TURNS, MOST_STEPS = 0.1, 0.005, 16
"""First step of the search for a motor's turns with another joint, the step that ends it, and how
many are made."""
ALONE_SWEEPS = 4
"""Sweeps of such a fit, from where the reference ended."""
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
    rivals: tuple["Explanation", ...] = ()
    """Explanations that cannot be told from it, the best first."""
    changes_s: tuple[float, ...] = ()
    """When it begins and ends, from the record's start [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explained:
    """What was found in a recording, and what is left of it."""

    found: tuple[Explanation, ...]
    reference: Reference
    """With all that was found undone."""
    values: Array
    """(p) its parameters."""


def explain(
    recording: Recording, prior: tuple[Array, Array] | None = None, offsets: bool = True
) -> Explained:
    """Look for faults one after the other; each is undone before the next is looked for.

    Args:
        recording: The recording.
        prior: Of its robot, from `link_prior`; None to have it made.
        offsets: Whether clocks of torques and motion may be apart.
    """
    published = prior = link_prior(recording.robot) if prior is None else prior
    n = recording.robot.joints
    found: list[Explanation] = []
    added: list[Hypothesis] = []
    coupled: list[tuple[Undo, Array]] = []
    fitted = _fitted(recording, prior, added)
    recording = told = fitted[0].recording
    rounds, right = 0, False
    while True:
        ref, _, values = fitted
        links = values[: 10 * n]
        both = fitted, _fitted(recording.fast(), prior, added, links)
        admitted = _ranked(both, found)
        while admitted and not _confirmed(fitted, prior, added, admitted[0], found):
            admitted = admitted[1:]
        if not right and len(found) < MOST and whole_signals.doubtful(ref, values):
            whole = _whole(both, prior, added, admitted[:1], offsets and not found)
            if whole is not None:
                right = True
                found.append(whole[0])
                fitted = whole[1]
                recording = fitted[0].recording
                continue
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
        first = admitted[0]
        if best.kind in COUPLED:
            first = _turned(fitted, prior, added, first)
            if not right and any(e.kind not in COUPLED for e in found):
                # What was found without them may be an effect of theirs.
                recording, prior, added = told, published, []
                found = [e for e in found if e.kind in COUPLED]
                for undo, turns in coupled:
                    recording = undo(recording, turns)
            if best.undo is not None:
                coupled.append((best.undo, first.values))
        found.append(_explanation(first, admitted[1:], before))
        if best.kind == "payload":
            # Part of the last link: other faults and the load of friction know of it.
            width = best.holding(first.values)
            prior = with_payload(prior, recording.robot, first.values, width)
        elif best.undo is None:
            added.append(replace(best, width=best.holding(first.values)))
        else:
            recording = best.undo(recording, first.values)
        fitted = _fitted(recording, prior, added, None if best.kind == "payload" else links)
        for known in [one for one in added if not _same(found[-1], one)]:
            rest = [one for one in added if one is not known]
            others = [e for e in found if not _same(e, known)]
            if not _stands(recording, prior, rest, known, others):
                added, found = rest, others
                fitted = _fitted(recording, prior, added, links)
    if any(e.kind == "clock_offset" and abs(e.value) < whole_signals.STEP_S / 2 for e in found):
        # Corrected until nothing was left of it: it was none.
        return explain(told, published, offsets=False)
    # Turns about several axes do not add up.
    turn = whole_signals.angle_between(told.robot.gravity, ref.recording.robot.gravity)
    found = [replace(e, value=turn) if e.kind == "mounting" else e for e in found]
    return Explained(found=tuple(found), reference=ref, values=values)


_Fitted = tuple[Reference, Fits, Array]
"""A reference, its own sums, and (p) its parameters."""


def _whole(
    both: tuple[_Fitted, _Fitted],
    prior: tuple[Array, Array],
    added: list[Hypothesis],
    best: list[Scored],
    offsets: bool,
) -> tuple[Explanation, _Fitted] | None:
    """The signal that explains most when it is put right, and the fit then.

    Fast rows have to show it as well: way points are few, and friction about their stops is not.
    """
    ref, sums, values = both[0]
    n = ref.recording.robot.joints

    def drop(recording: Recording, added: list[Hypothesis]) -> tuple[float, _Fitted]:
        other = _fitted(recording, prior, added)
        fast = _fitted(other[0].recording.fast(), prior, added, other[2][: 10 * n])
        return min(_drop(both[0], other), _drop(both[1], fast)), other

    wholes = whole_signals.whole_signals(ref, sums, values, prior)
    wholes = [w for w in wholes if offsets or w.kind != "clock_offset"]
    most, out = 0.0, None
    # It has to explain more than a fault of some size does.
    for rival in best if wholes else ():
        known = rival.hypothesis
        undone = known.undo(ref.recording, rival.values) if known.undo else ref.recording
        most = max(0.0, drop(undone, added if known.undo else [*added, known])[0])
    for whole in wholes:
        score, other = drop(whole.recording, added)
        least = OFFSET_LIKELY if whole.kind == "clock_offset" else WHOLE_LIKELY
        if score > max(most, least):
            most = score
            now = Explanation(
                kind=whole.kind, joints=whole.joints, value=whole.value, std=0.0,
                unit=whole.unit, score=score,
            )  # fmt: skip
            out = now, other
    return out


def _ranked(both: tuple[_Fitted, _Fitted], found: list[Explanation]) -> list[Scored]:
    """Explanations of some size that are likely, the best first.

    Two fits judge, of all rows and of fast ones, and their scores add up: near reversals friction
    has parts that no column describes, which hide faults and look like others.
    """
    rivals = hypotheses(both[0][0], both[0][2])
    firsts = np.cumsum([len(both[0][0].columns), *(len(rival.columns) for rival in rivals)])
    every = [
        (ref, replace(own, sums=residual.sums_of(ref, *(rival.columns for rival in rivals))))
        for ref, own, _ in both
    ]

    def alone(fit: int, k: int) -> Scored:
        return _alone(every[fit][0], rivals[k], every[fit][1], int(firsts[k]))

    likely: list[dict[int, Scored]] = []
    for fit, (_, sums) in enumerate(every):
        ranked = sorted(zip(drops(sums, rivals), range(len(rivals)), strict=True), reverse=True)
        scored = {k: alone(fit, k) for drop, k in ranked[:LOOKS] if drop > WORTH_A_LOOK}
        likely.append({k: s for k, s in scored.items() if _admitted(s, found)})
    out: list[Scored] = []
    for k in likely[0] | likely[1]:
        whole, fast = (one[k] if k in one else alone(fit, k) for fit, one in enumerate(likely))
        shown = [_admitted(s, found) for s in (whole, fast)]
        one, other = (whole, fast) if shown[0] else (fast, whole)
        if all(shown) or _outweighs(one, other, by_all=shown[0]):
            size = min((whole, fast), key=lambda s: s.std)
            out.append(replace(size, score=whole.score + fast.score))
    return sorted(out, key=lambda s: -s.score)


def _stands(
    recording: Recording,
    prior: tuple[Array, Array],
    added: list[Hypothesis],
    known: Hypothesis,
    found: list[Explanation],
) -> bool:
    """Whether an explanation is still admitted beside the others that were found."""
    whole = _fitted(recording, prior, added)
    fast = _fitted(recording.fast(), prior, added, whole[2][: 10 * recording.robot.joints])
    shown = (one.hypothesis for one in _ranked((whole, fast), found))
    return any((one.kind, one.joints) == (known.kind, known.joints) for one in shown)


def _outweighs(one: Scored, other: Scored, *, by_all: bool) -> bool:
    """Whether one fit shows a fault so well that the other need only agree on its size.

    Few rows may be fast, which tell little then; all rows have to lean to a fault as well. The mass
    of a body that comes and goes, whose rows were chosen, has to be sure then.
    """
    kind = one.hypothesis.kind
    (size, std), (another, spread) = (s.combined(one.surest) for s in (one, other))
    agrees = abs(size - another) < 2 * np.hypot(std, spread)
    alone = by_all and kind not in COUPLED
    leans = abs(another) > spread and (by_all or kind not in LIKE_FRICTION)
    sure = not one.hypothesis.told or abs(one.value) > _by_chance(1) * one.std
    likely = one.score > LIKELY and sure
    return bool(likely and agrees and (alone or leans))


def _drop(one: _Fitted, other: _Fitted) -> float:
    """Drop of the negative log likelihood and prior from one fit to another [nats].

    All joints count alike: an exchange must not gain from joints that count differently; nor does
    a gain, by torques that are smaller.
    """
    count = float(np.median(other[1].counts)) * events.strokes(one[0].recording) / residual.BLOCKS

    def cost(ref: Reference, sums: Fits, values: Array) -> float:
        left = np.square(ref.left(values)).mean(axis=1) + 1e-18
        left = left / (np.square(ref.recording.tau).mean(axis=0) + 1e-18)
        driven = int((whole_signals.friction_power(ref, values) < whole_signals.DRIVES).sum())
        unlikely = sums.penalty(values) + whole_signals.IMPOSSIBLE * driven
        return 0.5 * count * float(np.log(left).sum()) + unlikely

    return cost(*one) - cost(*other)


def _alone(ref: Reference, rival: Hypothesis, sums: Fits, first: int) -> Scored:
    """A rival with the noise that is left where it is true, not where it is not.

    Its columns are among those of the sums from `first` on.
    """
    p, m = len(ref.columns), len(rival.columns)
    wide = np.diag(1 / np.square(rival.width))
    none = np.zeros((p, m))
    # Inertias as published: spreads that the fault has widened hold its torques.
    links = len(sums.inertial)
    known = sums.precision.copy()
    known[:links, :links] = sums.inertial
    widened = replace(
        ref,
        columns=np.concatenate([ref.columns, rival.columns]),
        mean=np.concatenate([ref.mean, np.zeros(m)]),
        precision=np.block([[ref.precision, none], [none.T, wide]]),
    )
    kept = [*range(p), *range(first, first + m), sums.sums.shape[-1] - 1]
    start = replace(
        sums,
        sums=sums.sums[np.ix_(*map(range, sums.sums.shape[:2]), kept, kept)],
        own=p + m,
        mean=widened.mean,
        precision=np.block([[known, none], [none.T, wide]]),
    )
    found, _ = residual.settled(widened, start, ALONE_SWEEPS)
    found = replace(found, own=p, mean=ref.mean, precision=found.precision[:p, :p])
    return score(found, rival, sums, events.strokes(ref.recording))


def _confirmed(
    start: _Fitted,
    prior: tuple[Array, Array],
    added: list[Hypothesis],
    best: Scored,
    found: list[Explanation],
) -> bool:
    """Whether a recording fits better once coupled motors are undone; other faults need no more."""
    known = best.hypothesis
    if known.undo is None or known.kind not in COUPLED:
        return True
    if any(_same(e, known) for e in found):
        # Its turns are those that fit best, unless others were found since.
        return not _same(found[-1], known)
    undone = _fitted(known.undo(start[0].recording, best.values), prior, added)
    return _drop(start, undone) > OFFSET_LIKELY


def _turned(
    start: _Fitted, prior: tuple[Array, Array], added: list[Hypothesis], found: Scored
) -> Scored:
    """Coupled motors with the turns that fit best.

    The column is the torque that the friction of a motor adds to the other joint; it leaves out
    that friction turns round with the motor.
    """
    undo, links = found.hypothesis.undo, start[2][: len(start[1].inertial)]
    if undo is None:
        return found

    def drop(turns: float) -> float:
        undone = undo(start[0].recording, np.array([turns]))
        return _drop(start, _fitted(undone, prior, added, links))

    step, turns = TURNS, found.value
    least = best = drop(turns)
    for _ in range(MOST_STEPS):
        beside = [(drop(turns - step), turns - step), (drop(turns + step), turns + step)]
        least = min(beside)[0]
        if max(beside)[0] > best:
            best, turns = max(beside)
        elif step < FINEST_TURNS:
            break
        else:
            step /= 3
    std = np.hypot(FINEST_TURNS, step / np.sqrt(max(2 * (best - least), 1.0)))
    return replace(found, value=turns, values=np.array([turns]), std=float(std))


def _same(found: Explanation, now: Hypothesis) -> bool:
    """Whether a fault adds to one that was found before."""
    if found.kind == "clock_offset":
        return now.kind == "delay" and len(now.joints) > 1
    return (found.kind, found.joints) == (now.kind, now.joints)


def _fitted(
    recording: Recording,
    prior: tuple[Array, Array],
    added: list[Hypothesis],
    inertial: Array | None = None,
) -> _Fitted:
    """A fit; without parameters (10 n) that the load is taken from, with those of a first one.

    So are the displacements over which friction builds up.
    """
    if inertial is None:
        ref, sums, first = _fitted(recording, prior, added, prior[0])
        inertial = first[: 10 * recording.robot.joints]
        recording = replace(recording, presliding=residual.presliding_of(ref, first, sums.counts))
    beside = [(h.columns, h.width) for h in added]
    ref = residual.reference(recording, prior, inertial, beside)
    sums, values = residual.fits(ref)
    return ref, sums, values


def _admitted(scored: Scored, found: list[Explanation]) -> bool:
    known, size = scored.hypothesis, abs(scored.value)
    # Motors that were found coupled are not coupled in another way as well.
    coupled = {e.kind for e in found if e.joints == known.joints} & COUPLED
    if known.kind in COUPLED and coupled - {known.kind}:
        return False
    # A size that was found before may be corrected downwards.
    physical = scored.value > known.lowest or any(_same(item, known) for item in found)
    # Friction of all joints falls as they warm up: their mean is one number.
    mean = known.kind == "friction_drift" and size > _by_chance(1) * scored.std
    # Of several sizes one is large by chance more often, and the one that is told may be none.
    sure = mean or scored.certainty > _by_chance(known.free)
    large = size > max(known.least, scored.std)
    return physical and sure and large and scored.evidence > EVIDENT


def _by_chance(sizes: int) -> float:
    """Standard deviations that one of so many sizes exceeds by chance."""
    return -float(scipy_part("special").stdtrit(residual.BLOCKS - 1, 0.5 * BY_CHANCE / sizes))


def _explanation(best: Scored, others: list[Scored], before: Explanation | None) -> Explanation:
    now, *rivals = (
        Explanation(
            kind=s.hypothesis.kind,
            joints=s.hypothesis.joints,
            value=s.value,
            std=s.std,
            unit=s.hypothesis.unit,
            score=s.score,
            changes_s=s.hypothesis.changes_s,
        )
        for s in (best, *(s for s in others if s.score >= EQUAL * best.score))
    )
    if before is None:
        return replace(now, rivals=tuple(rivals))
    gain = now.kind in ("drive_gain", "gain_all")
    value = (1 + before.value) * (1 + now.value) - 1 if gain else before.value + now.value
    return replace(before, value=value, std=now.std, score=before.score + now.score)
