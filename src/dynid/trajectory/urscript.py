"""A URScript program that evaluates a motion on the controller of the robot."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, InputError, freeze, frozen
from dynid.trajectory import base, files, fourier, points, quintic


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """q = sum_k c_k s^k + sum_l a_l sin(2 pi l s) - b_l cos(2 pi l s), s = t / duration."""

    duration: float
    """Time that the formula holds, its own t running from 0 [s]."""
    polynomial: Array
    """(n, d + 1) c, ascending powers of s [rad or m]."""
    a: Array
    """(n, H) sine coefficients, H = 0 for a polynomial alone [rad or m]."""
    b: Array
    """(n, H) negated cosine coefficients [rad or m]."""

    def __post_init__(self) -> None:
        freeze(self, polynomial=(None, None))
        freeze(self, a=(len(self.polynomial), None))
        freeze(self, b=self.a.shape)

    @property
    def harmonics(self) -> int:
        """Number of harmonics H."""
        return self.a.shape[1]

    def values(self, s: Array) -> Array:
        """(N, n) q at (N) s [rad or m]."""
        powers: Array = np.power(s[:, None], np.arange(float(self.polynomial.shape[1])))
        waves = fourier.harmonic_basis(s, 1.0, self.harmonics)[0]
        return powers @ self.polynomial.T + waves @ np.hstack([self.a, self.b]).T

    def slope(self) -> "Piece":
        """The derivative by s, which is again of this form."""
        orders = np.arange(1.0, self.polynomial.shape[1])
        turns = 2.0 * np.pi * np.arange(1, self.harmonics + 1)
        polynomial = self.polynomial[:, 1:] * orders
        return replace(self, polynomial=polynomial, a=self.b * turns, b=-self.a * turns)


def pieces(trajectory: base.Trajectory) -> tuple[Piece, ...]:
    """The formulas of a trajectory, in their order; a Fourier series counts as one period.

    Raises:
        InputError: A trajectory of a kind that is not of this package.
    """
    # A class of one's own that builds on one of these may move otherwise.
    match trajectory if type(trajectory) in files.KINDS.values() else None:
        case fourier.FourierSeries(period=period, offset=offset, a=a, b=b):
            return (Piece(duration=period, polynomial=offset[:, None], a=a, b=b),)
        case quintic.FourierQuintic(period=period, a=a, b=b) as series:
            return (Piece(duration=period, polynomial=series.polynomial(), a=a, b=b),)
        case quintic.Quintic(start=start, goal=goal, travel_time=travel_time):
            way = np.outer(goal - start, quintic.STEP)
            way[:, 0] = start
            return (_polynomial(travel_time, way),)
        case points.PointToPoint() | quintic.BSpline() as curve:
            return tuple(_polynomial(*part) for part in curve.polynomials())
        case points.MotionSequence(parts=parts):
            return tuple(piece for part in parts for piece in pieces(part))
        case points.Repetition(part=part, times=times):
            return times * pieces(part)
        case _:
            raise InputError("no formula for this trajectory", value=type(trajectory).__name__)


def _polynomial(duration: float, coefficients: Array) -> Piece:
    none = np.zeros((len(coefficients), 0))
    return Piece(duration=duration, polynomial=coefficients, a=none, b=none)


_TERMS = 4
"""Harmonics in one statement, which keeps lines short."""
_LATE = 1e-9
"""Share of a cycle by which rounding may place the start of a piece too late."""


def decimal(value: float) -> str:
    """The number that reads back exactly, without an exponent and with a decimal point."""
    return np.format_float_positional(float(value), unique=True, trim="0")


def pose_list(pose: Array) -> str:
    """Joint positions (n) as a list."""
    return f"[{', '.join(decimal(value) for value in pose)}]"


def _variables(parts: Sequence[Piece]) -> list[str]:
    """The names that `_formula_lines` sets, all numbers."""
    joints = len(parts[0].polynomial)
    orders = range(1, max(part.harmonics for part in parts) + 1)
    return [
        "t",
        "s",
        *(f"{name}{order}" for name in "sc" for order in orders),
        *(f"q{joint}" for joint in range(1, joints + 1)),
    ]


def _formula_lines(parts: Sequence[Piece], rate_hz: float) -> list[str]:
    """Statements that set t, s and q1 to qn from `sample`, the number within the period."""
    lines = [f"t = sample/{decimal(rate_hz)}"]
    if len(parts) == 1:
        return [*lines, *_piece(parts[0], 0.0)]
    starts = np.concatenate([[0.0], np.cumsum([part.duration for part in parts])])
    for number, part in enumerate(parts):
        # Chosen by the whole number of the sample: no rounding decides it on the controller.
        until = math.ceil(starts[number + 1] * rate_hz - _LATE)
        word = "if" if number == 0 else "elif"
        last = number == len(parts) - 1
        lines.append("else:" if last else f"{word} sample < {until}:")
        lines += [f"  {line}" for line in _piece(part, float(starts[number]))]
    return [*lines, "end"]


def _piece(part: Piece, start: float) -> Iterable[str]:
    shift = f"(t - {decimal(start)})" if start else "t"
    if part.polynomial.shape[1] > 1:
        yield f"s = {shift}/{decimal(part.duration)}"
    if part.harmonics:
        fundamental = 2.0 * math.pi / part.duration
        for order in range(1, part.harmonics + 1):
            yield f"s{order} = sin({decimal(order * fundamental)}*{shift})"
            yield f"c{order} = cos({decimal(order * fundamental)}*{shift})"
    for joint, row in enumerate(part.polynomial, start=1):
        yield f"q{joint} = {_horner(row)}"
        terms = [
            f"{_signed(a)}*s{order} {_signed(-b)}*c{order}"
            for order, (a, b) in enumerate(
                zip(part.a[joint - 1], part.b[joint - 1], strict=True), start=1
            )
        ]
        for first in range(0, len(terms), _TERMS):
            yield f"q{joint} = q{joint} {' '.join(terms[first : first + _TERMS])}"


def _horner(coefficients: Array) -> str:
    """Ascending coefficients of s, the highest one innermost."""
    text = decimal(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        text = f"({text})*s {_signed(coefficient)}"
    return text


def _signed(value: float) -> str:
    """`+ 0.5` or `- 0.5`."""
    return f"{'-' if value < 0 else '+'} {decimal(abs(value))}"


_JOINTS = 6
_WHOLE = 1e-9
"""How far from a whole number of cycles a period may be, for rounding."""
_SERVO = "lookahead_time=0.03,gain=500.0"
"""Of `servoj`: what the paper takes."""
_SLOW = 0.5
"""Joint speed [rad/s] and acceleration [rad/s^2] of the way to the start, and of the stop."""
_DWELL_S = 1.0
"""Rest at the start, before the motion."""
_HELD_S = 0.2
"""Rest at the end, until the arm has caught up with its targets."""
_INDEX = "write_output_integer_register(24, {})"
"""The sample's number: -1 before the motion, then 0, 1, 2..."""
_STATE = "write_output_integer_register(25, {})"
"""0 on the way to the start, 1 in motion, 2 when done."""
_WATCHDOG = 'rtde_set_watchdog("input_int_register_24", 10.0, "stop")'
"""The program stops where the computer does not write to its register ten times a second."""


def ur_program(
    trajectory: base.Trajectory,
    *,
    rate_hz: float = 125.0,
    repeats: int = 1,
    settle: int = 0,
    via: Sequence[Array] = (),
    comment: str = "",
    fed: bool = True,
) -> str:
    """A complete program: way to the start, rest, periods, stop.

    Only scalar arithmetic, sin, cos, if and while are used, which CB-Series controllers know. The
    time is computed from the sample's number within its period, so all periods have exactly the
    same targets. Fourier series are evaluated as series; splines, poses and sequences as one
    polynomial a span (Horner), chosen by the sample's number.

    Args:
        trajectory: The motion of one period of a six-joint arm, at rest at both ends. With more
            than one period it must end where it starts.
        rate_hz: Control cycles a second: 125 on CB-Series, 500 on e-Series.
        repeats: Periods to record.
        settle: Periods before these, which let the arm and its tracking settle.
        via: Way points, each (6), at which it rests on its way to the start [rad].
        comment: Written into the program's head.
        fed: Whether it stops within 0.1 s where nobody writes its input register; else it runs
            alone.

    Returns:
        The URScript, one `def` that the controller runs as soon as it has it.

    Raises:
        InputError: Another number of joints, a motion that does not start and end at rest, a
            period that is no whole number of control cycles, or no period.
    """
    base.require_positive("the control rate", rate_hz)
    base.require_whole("repetitions", repeats, 1)
    base.require_whole("settling periods", settle, 0)
    if trajectory.joints != _JOINTS:
        raise InputError("joints of a UR robot", value=trajectory.joints, limit=_JOINTS)
    cycles = whole_cycles(trajectory.duration, rate_hz)
    total = (settle + repeats) * cycles
    if total > cycles:
        # Refuses a motion that does not end as it starts.
        points.Repetition(part=trajectory, times=2)
    ends = base.require_rest(trajectory)
    parts = pieces(trajectory)
    way = [*(frozen(pose, shape=(_JOINTS,), name="way point") for pose in via), ends.q[0]]
    servo = f"0, 0, t={decimal(1.0 / rate_hz)},{_SERVO}"
    inside = [
        *(f"# {line}" for line in _printable(comment)),
        f"# {settle} settling and {repeats} recorded periods of {cycles} cycles.",
        _STATE.format(0),
        _INDEX.format(-1),
        *([_WATCHDOG] if fed else []),
        *(f"movej({pose_list(pose)}, a={_SLOW}, v={_SLOW})" for pose in way),
        f"sleep({_DWELL_S})",
        "local index = 0",
        "local sample = 0",
        *(f"local {name} = 0.0" for name in _variables(parts)),
        _STATE.format(1),
        f"while index < {total}:",
        *(f"  {line}" for line in _formula_lines(parts, rate_hz)),
        f"  {_INDEX.format('index')}",
        f"  servoj([q1, q2, q3, q4, q5, q6], {servo})",
        "  index = index + 1",
        "  sample = sample + 1",
        f"  if sample >= {cycles}:",
        "    sample = 0",
        "  end",
        "end",
        # The arm lags behind its targets: it is held at the last pose until it is there.
        _INDEX.format(total),
        "sample = 0",
        f"while sample < {math.ceil(_HELD_S * rate_hz)}:",
        f"  servoj({pose_list(ends.q[1])}, {servo})",
        "  sample = sample + 1",
        "end",
        f"stopj({_SLOW})",
        _STATE.format(2),
    ]
    return "\n".join(["def dynid_excitation():", *(f"  {line}" for line in inside), "end"]) + "\n"


def whole_cycles(duration: float, rate_hz: float) -> int:
    """How many control cycles a period lasts, in s and Hz.

    Raises:
        InputError: Fewer than two, or no whole number of them.
    """
    exact = duration * rate_hz
    cycles = round(exact)
    if cycles < 2 or abs(exact - cycles) > _WHOLE * cycles:
        raise InputError(
            "a period must be a whole number of control cycles",
            value=f"{duration} s at {rate_hz:g} Hz",
            next_step=f"Design with a period of {max(cycles, 2) / rate_hz:.9g} s.",
        )
    return cycles


def _printable(comment: str) -> list[str]:
    lines = comment.splitlines()
    return ["".join(c if c.isascii() and c.isprintable() else "?" for c in line) for line in lines]
