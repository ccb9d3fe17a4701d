"""Trends over time with temperature and motion regressed out, alarms at a stated rate.

The model of a series is a constant, a polynomial in temperature, an offset of each motion that is
repeated, and perhaps one step at an unknown time. The statistic is the largest share of the
residual sum of squares that a step at any admitted time takes away. Its distribution without a
step comes from permutations of the residuals over time (Freedman and Lane 1983), which need not be
normal; the family of all series tested together is corrected by Holm's method. A slow drift raises
the statistic as a step does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynid.core import Array, Indices, Value, scipy_part

LEAST_RECORDINGS = 8
"""Fewer recordings have no trend."""
LINEAR_FROM_K, SQUARE_FROM_K = 1.0, 6.0
"""Spread of temperature from which a slope, and from which a curvature too, is regressed out."""
PERMUTATIONS, BATCH, ENOUGH = 9999, 1000, 20
"""At most so many, in batches, until so many have reached the statistic."""
ROUNDS = 30
"""Of the variance between recordings."""
SEED = 20
SAME_MOTION = 0.02
"""Recordings whose mean joint speeds differ by no more than this share of the fastest joint's
repeat one motion: the speed of a joint at rest is noise."""
MOST_STEPS = 60
"""Times of a step that are tried, evenly taken from all."""
SEGMENT = 3
"""Recordings on either side of a step, at least ..."""
SEGMENT_SHARE = 0.05
"""... and at least this share of them."""
CONFIDENCE = 1.96
"""Standard deviations either side of a 95 % interval."""
DAY_S = 86400.0
YEAR_DAYS = 365.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend(Value):
    """A series of one joint over its recordings; without any where there are too few."""

    time_s: Array = field(default_factory=lambda: np.full(1, np.nan))
    """(R) when each recording was made, ascending [s]."""
    at_reference: Array = field(default_factory=lambda: np.full(1, np.nan))
    """(R) values less the effect of temperature."""
    std: Array = field(default_factory=lambda: np.full(1, np.nan))
    """(R) standard deviation of each, the scatter between recordings included."""
    reference_degC: float = np.nan
    """Temperature of `at_reference`; NaN where no temperatures are known."""
    per_kelvin: float = np.nan
    """Slope over temperature there; 0 where none was regressed out."""
    level: float = np.nan
    """Mean at the reference temperature, without a step."""
    level_std: float = np.nan
    step_at: int = 0
    """The first recording after the step that fits best."""
    before: float = np.nan
    """Mean at the reference temperature before that step."""
    change: float = np.nan
    """Height of that step."""
    change_std: float = np.nan
    after_std: float = np.nan
    """Standard deviation of the mean after that step."""
    slope_per_year: float = np.nan
    """Of a straight line in place of the step."""
    slope_std: float = np.nan
    p_value: float = 1.0
    """Probability of a step statistic as large without any change."""

    @property
    def known(self) -> bool:
        """Whether there were enough recordings."""
        return bool(np.isfinite(self.level))


def repeated_motions(speed: Array) -> Indices:
    """(R) number of the motion of each recording; -1 where fewer than `SEGMENT` repeat it.

    Told apart by the mean speed of each joint (R, n). What the model gets wrong depends on the
    motion, so a new program looks like new friction.
    """
    labels = np.full(len(speed), -1)
    left = np.arange(len(speed))
    while len(left):
        first = speed[left[0]]
        # The first of them is the same as itself, whatever its speeds.
        same = np.atleast_1d((np.abs(speed[left] - first) <= SAME_MOTION * first.max()).all(axis=1))
        if same.sum() >= SEGMENT:
            labels[left[same]] = labels.max() + 1
        left = left[~same]
    return labels


def trend(
    time_s: Array,
    values: Array,
    std: Array,
    temperature_degC: Array,
    reference_degC: float,
    *,
    motion: Indices | None = None,
    permutations: int = PERMUTATIONS,
) -> Trend:
    """Regress temperature and motion out of a series, and look for a change.

    Errors of recordings are exchangeable over time once divided by their deviations: the given
    ones, and one between recordings that is estimated.

    Args:
        time_s: (R) when each recording was made, ascending [s].
        values: (R) the values.
        std: (R) their standard deviations.
        temperature_degC: (R) temperatures; NaN in all where none are known.
        reference_degC: Temperature to refer to.
        motion: (R) number of the motion as of `repeated_motions`; None for one motion.
        permutations: At most so many; the smallest p value is one over them.

    Returns:
        The trend; not known with fewer than `LEAST_RECORDINGS` recordings, or equal times.
    """
    count = len(values)
    steps = _steps(time_s)
    if count < LEAST_RECORDINGS or not len(steps):
        return Trend()
    design = _temperature_columns(temperature_degC, reference_degC)
    warm = design.shape[1] > 1
    if motion is not None:
        design = _with_motions(design, motion)
    after = (np.arange(count)[:, None] >= steps).astype(np.float64)
    own = np.maximum(std, 1e-9 * max(float(np.abs(values).max()), 1e-12))
    # The test is one of no step, so its weights are those without one.
    spread = _spread(design, values, own)
    p_value, best = _tested(design, after, values / spread, spread, permutations)
    full = np.column_stack([design, after[:, best]])
    spread = _spread(full, values, own)
    line = np.column_stack([design, (time_s - time_s[0]) / (YEAR_DAYS * DAY_S)])
    (fitted, covariance, noise), (plain, steady, _), (sloped, drift, _) = (
        _fitted(columns, values, spread) for columns in (full, design, line)
    )
    effect = design[:, 1:] @ fitted[1 : design.shape[1]]
    blur = np.einsum("ij,jk,ik->i", design[:, 1:], covariance[1:-1, 1:-1], design[:, 1:])
    ends = np.zeros(len(fitted))
    ends[[0, -1]] = 1.0
    return Trend(
        time_s=time_s,
        at_reference=values - effect,
        std=np.sqrt(noise * np.square(spread) + blur),
        reference_degC=reference_degC,
        per_kelvin=float(fitted[1]) / 10.0 if warm else 0.0,
        level=float(plain[0]),
        level_std=float(np.sqrt(steady[0, 0])),
        step_at=int(steps[best]),
        before=float(fitted[0]),
        change=float(fitted[-1]),
        change_std=float(np.sqrt(covariance[-1, -1])),
        after_std=float(np.sqrt(ends @ covariance @ ends)),
        slope_per_year=float(sloped[-1]),
        slope_std=float(np.sqrt(drift[-1, -1])),
        p_value=p_value,
    )


def _fitted(design: Array, values: Array, spread: Array) -> tuple[Array, Array, float]:
    """Coefficients of weighted least squares, their covariance, and the residual variance.

    `CONFIDENCE` deviations hold as much as Student's interval of so few recordings.
    """
    inverse = np.linalg.pinv(design / spread[:, None])
    found, freedom = inverse @ (values / spread), max(len(design) - design.shape[1], 1)
    noise = float(np.square((values - design @ found) / spread).sum()) / freedom
    wider = float(scipy_part("special").stdtrit(freedom, 0.975)) / CONFIDENCE
    return found, noise * wider**2 * inverse @ inverse.T, noise


def _spread(design: Array, values: Array, own: Array) -> Array:
    """(R) standard deviations: a recording's own, and one between recordings.

    The second is what the first does not explain: with it the weighted squares have the sum to
    expect (Paule and Mandel 1982), to which each recording contributes alike, noisy or not.
    """
    spread, between = np.ones(len(values)), 1.0
    for _ in range(ROUNDS):
        between *= _fitted(design, values, spread)[2]
        spread = np.sqrt(np.square(own) + between)
    return spread


def _steps(time_s: Array) -> Indices:
    """First recordings after a step: between different times, both sides long enough."""
    count = len(time_s)
    least = max(SEGMENT, int(np.ceil(SEGMENT_SHARE * count)))
    places = np.flatnonzero(np.diff(time_s) > 0) + 1
    places = places[(places >= least) & (places <= count - least)]
    if len(places) > MOST_STEPS:
        places = places[np.unique(np.linspace(0, len(places) - 1, MOST_STEPS).astype(int))]
    return places


def _temperature_columns(temperature_degC: Array, reference_degC: float) -> Array:
    """(R, c) a constant, and powers of the temperature as far as its spread tells of them."""
    one = np.ones(len(temperature_degC))
    spread = float(np.ptp(temperature_degC))
    if not spread >= LINEAR_FROM_K:
        return one[:, None]
    rise = (temperature_degC - reference_degC) / 10.0
    powers = [one, rise]
    if spread >= SQUARE_FROM_K and len(one) >= 2 * LEAST_RECORDINGS:
        powers.append(np.square(rise))
    return np.column_stack(powers)


def _with_motions(design: Array, motion: Indices) -> Array:
    """The design with an offset of each repeated motion but one; their mean is in the constant."""
    known = np.unique(motion)
    columns = [(motion == label).astype(np.float64) for label in known[1:]]
    if len(motion) - design.shape[1] - len(columns) <= LEAST_RECORDINGS // 2:
        return design
    return np.column_stack([design, *(column - column.mean() for column in columns)])


def _tested(
    design: Array, after: Array, values: Array, spread: Array, permutations: int
) -> tuple[float, int]:
    """Share of permutations that reach the statistic, and the step that has it.

    Sequential (Besag and Clifford 1991).
    """
    # An orthonormal basis of the design, and unit steps orthogonal to it.
    root = np.linalg.qr(design / spread[:, None])[0]
    steps = after / spread[:, None]
    steps = steps - root @ (root.T @ steps)
    size = np.linalg.norm(steps, axis=0)
    steps = np.where(size > 1e-6 * size.max(), steps / np.maximum(size, 1e-300), 0.0)
    error = values - root @ (root.T @ values)
    gains = np.square(steps.T @ error)
    best = int(np.argmax(gains))
    # What no more than rounding is left of has no step.
    if error @ error <= 1e-20 * (values @ values):
        return 1.0, best
    share = float(gains[best] / (error @ error))
    draw, reached, done = np.random.default_rng(SEED), 0, 0
    while done < permutations and reached < ENOUGH:
        mixed = draw.permuted(np.tile(error, (min(BATCH, permutations - done), 1)), axis=1)
        mixed = mixed - (mixed @ root) @ root.T
        most = np.square(mixed @ steps).max(axis=1) / np.square(mixed).sum(axis=1)
        reached += int((most >= share).sum())
        done += len(mixed)
    return (1.0 + reached) / (1.0 + done), best


def holm(p_values: Sequence[float]) -> Array:
    """P values corrected for a family of tests (Holm 1979).

    Rejecting those up to a level errs at all with at most that probability, however the tests
    depend on each other.
    """
    values = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(values)
    raised = np.minimum(values[order] * np.arange(len(values), 0, -1), 1.0)
    found = np.empty_like(values)
    found[order] = np.maximum.accumulate(raised) if len(raised) else raised
    return found


FRICTION_ALONE = 3.0
"""A drive gain that changes changes friction and control by the same share: from so many times the
control's, the friction itself has changed."""
FRICTION_BESIDE = 10.0
"""A load moves the controls of several joints, and friction by as much more as torques are larger:
from so many times another joint's control at that time, the friction itself has changed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointState:
    """A joint of one robot: its friction over time, and its inertias as a control."""

    robot: str
    joint: int
    """From 0."""
    name: str
    unit: str
    """Of the friction level."""
    reference_speed: float
    """Speed at which the friction level is taken [rad/s or m/s]."""
    friction: Trend
    """Of the friction level at that speed."""
    control: Trend
    """Of the torque scale: measured over predicted torque of the inertias."""
    friction_p: float = 1.0
    """P value corrected for the whole fleet."""
    control_p: float = 1.0
    alarm: str = ""
    """`friction_drift`; `torque_scale` where the control moved as well: drive gain, load or sensor,
    not friction alone; empty for none."""

    @property
    def change_percent(self) -> tuple[float, float, float]:
        """Step of the friction level, with its 95 % interval [%]; NaN without a trend."""
        size = 100.0 / max(abs(self.friction.before), 1e-12)
        step, width = size * self.friction.change, size * CONFIDENCE * self.friction.change_std
        return step, step - width, step + width

    @property
    def now(self) -> float:
        """Friction level at the reference temperature; after the step where there is an alarm."""
        one = self.friction
        return one.before + one.change if self.alarm else one.level

    @property
    def now_std(self) -> float:
        """Standard deviation of `now`."""
        return self.friction.after_std if self.alarm else self.friction.level_std


def judge(joints: Sequence[JointState], limit: float) -> tuple[tuple[JointState, ...], int]:
    """Raise alarms: all trends, of friction and of the control, are one family of tests.

    Of the joints of the whole fleet, with the probability `limit` of any false alarm. Returns
    them with corrected p values and alarms, and how many trends were tested.
    """
    tested = [
        (k, word)
        for word in ("friction", "control")
        for k, joint in enumerate(joints)
        if getattr(joint, word).known
    ]
    corrected = dict(
        zip(tested, holm([getattr(joints[k], word).p_value for k, word in tested]), strict=True)
    )
    moved = [joints[k] for k, word in tested if word == "control" and corrected[k, word] <= limit]
    judged: list[JointState] = []
    for k, joint in enumerate(joints):
        friction = float(corrected.get((k, "friction"), 1.0))
        control = float(corrected.get((k, "control"), 1.0))
        alarm = "torque_scale" if min(friction, control) <= limit else ""
        if friction <= limit and _friction_alone(joint, moved):
            alarm = "friction_drift"
        judged.append(replace(joint, friction_p=friction, control_p=control, alarm=alarm))
    return tuple(judged), len(tested)


def _friction_alone(joint: JointState, moved: Sequence[JointState]) -> bool:
    """Whether no gain, and no load that moved other joints' controls with it, explains a change."""
    friction = joint.friction
    size = abs(friction.change / friction.before)
    for one in moved:
        control = one.control
        if one.robot != joint.robot:
            continue
        if one is not joint and abs(control.step_at - friction.step_at) >= SEGMENT:
            continue
        times = FRICTION_ALONE if one is joint else FRICTION_BESIDE
        if size <= times * abs(control.change / control.before):
            return False
    return True
