import json
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dynid.core import InputError
from dynid.recording import ExperimentRecord
from dynid.regressor import friction_state
from dynid.robot import RobotModel, load_robot
from dynid.signals import (
    LongSignals,
    ProcessingSettings,
    Samples,
    delayed,
    process,
    samples_at_stamps,
    samples_from,
    survey,
    uniform_signals,
)
from dynid.signals.processing import BLOCK_RATE_HZ, MIN_SAMPLES, TIME_CONSTANTS

EXACT = 1e-9
MOTION = {"q": 1e-5, "dq": 1e-4, "ddq": 1e-3}
"""Of a motion of 1 rad, 4 rad/s and 16 rad/s^2, filtered at 15 Hz."""
AT_ENDS = {"q": 1e-3, "dq": 2e-2, "ddq": 1.0}
"""The same where the filter has just settled."""
SETTLED = 0.3
"""[s] from an end."""
MEGABYTE = 2**20
TURN = np.array([2.0, 3.0, 4.0])
"""[rad/s] of three joints, or of as many as there are."""


def _robot(joints: int) -> RobotModel:
    """The wrist of a UR5, which is all that signals ask of a robot."""
    whole = load_robot("ur5")
    return RobotModel(
        name="part",
        joint_names=whole.joint_names[:joints],
        joint_types=whole.joint_types[:joints],
        placements=whole.placements[:joints],
        axes=whole.axes[:joints],
        parameter_frames={"dh": whole.parameter_frames["dh"][:joints]},
        default_frames="dh",
        gravity=whole.gravity,
        limits=_cut(whole.limits, joints),
        drives=replace(
            whole.drives,
            gain=whole.drives.gain[:joints],
            gear_ratio=whole.drives.gear_ratio[:joints],
        ),
        inertias=whole.inertias[:joints],
    )


def _cut(limits: Any, joints: int) -> Any:
    names = ("lower", "upper", "velocity", "acceleration", "torque")
    return replace(limits, **{name: getattr(limits, name)[:joints] for name in names})


def _motion(t: np.ndarray, joints: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    turn = TURN[:joints]
    angle = np.outer(t, turn) + np.arange(joints)
    return np.sin(angle), turn * np.cos(angle), -(turn**2) * np.sin(angle)


def _assert_motion(samples: Samples, start: float = 0.0, scale: float = 1.0) -> None:
    from_end = np.minimum(samples.t - samples.t[0], samples.t[-1] - samples.t)
    inside = from_end > SETTLED
    assert inside.sum() > 100
    truth = _motion(start + samples.t, samples.joints)
    for (name, limit), expected in zip(MOTION.items(), truth, strict=True):
        error = np.abs(getattr(samples, name) - (expected if name == "q" else scale * expected))
        assert error[inside].max() < limit, name
        assert error.max() < scale * AT_ENDS[name], name


def _torque(t: np.ndarray, joints: int = 3) -> np.ndarray:
    return 5 * np.cos(np.outer(t, 1.5 * TURN[:joints]))


def _record(
    duration: float = 12.0,
    rate: float = 125.0,
    joints: int = 3,
    gap: tuple[float, float] | None = None,
    delays: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> ExperimentRecord:
    t = np.arange(int(duration * rate)) / rate
    if gap is not None:
        t = t[(t <= gap[0]) | (t >= gap[1])]
    q, dq, _ = _motion(t, joints)
    late = [_torque(t - delay, joints)[:, j] for j, delay in enumerate(delays[:joints])]
    return ExperimentRecord(t=100 + t, signals={"q": q, "qd": dq, "effort": np.column_stack(late)})


def _run(record: ExperimentRecord, **settings: Any) -> Samples:
    return process(record, _robot(record.joints), ProcessingSettings(**settings))


@pytest.mark.parametrize("derivative", ["central", "savgol"])
@pytest.mark.parametrize("velocity", ["position", "measured"])
@pytest.mark.parametrize(("joints", "rate"), [(1, 125.0), (3, 125.0), (3, 1000.0)])
def test_samples_are_the_motion_and_the_torque_untouched(
    joints: int, rate: float, velocity: str, derivative: str
) -> None:
    samples = _run(
        _record(rate=rate, joints=joints), cutoff_hz=15.0, velocity=velocity, derivative=derivative
    )
    _assert_motion(samples)
    np.testing.assert_allclose(samples.tau, _torque(samples.t, joints), rtol=0, atol=EXACT)
    assert samples.joints == joints
    assert (samples.rate_hz, samples.cutoff_hz, samples.block) == (pytest.approx(rate), 15.0, 1)


def test_measured_velocities_are_taken_at_their_word() -> None:
    record = _record()
    twice = replace(record, signals={**record.signals, "qd": 2 * record.signals["qd"]})
    _assert_motion(_run(twice, cutoff_hz=15.0, velocity="measured"), scale=2.0)
    _assert_motion(_run(twice, cutoff_hz=15.0, velocity="position"))
    without = replace(record, signals={k: v for k, v in record.signals.items() if k != "qd"})
    with pytest.raises(InputError, match="no velocities qd"):
        _run(without, velocity="measured")


@pytest.mark.parametrize("cutoff", [2.0, 10.0])
def test_five_time_constants_are_cut_from_both_ends(cutoff: float) -> None:
    samples = _run(_record(), cutoff_hz=cutoff, delays_s=(0.02, -0.03, 0.0))
    edge = np.ceil(TIME_CONSTANTS / (2 * np.pi * cutoff) * 125.0) + np.ceil(0.03 * 125.0)
    assert samples.t[0] == pytest.approx(edge / 125.0)
    assert samples.t[-1] == pytest.approx((1500 - 1 - edge) / 125.0)
    np.testing.assert_allclose(np.diff(samples.t), 1 / 125.0, rtol=1e-6, atol=0)


def test_a_window_is_processed_as_if_it_were_the_record() -> None:
    record = _record()
    part = _run(record, cutoff_hz=15.0, start_s=2.0, stop_s=8.0)
    cut = slice(250, 1000)
    alone = ExperimentRecord(
        t=record.t[cut], signals={name: value[cut] for name, value in record.signals.items()}
    )
    np.testing.assert_array_equal(part.q, _run(alone, cutoff_hz=15.0).q)
    _assert_motion(part, start=2.0)


@pytest.mark.parametrize("rate", [125.0, 500.0])
def test_a_known_delay_is_undone(rate: float) -> None:
    delays = (0.024, 0.003, -0.0117)
    late = _record(rate=rate, delays=delays)
    undone = _run(late, cutoff_hz=15.0, delays_s=delays)
    # Straight lines between samples: an eighth of the step squared times the curvature.
    straight = 5 * (6.0 / rate) ** 2 / 8
    np.testing.assert_allclose(undone.tau, _torque(undone.t), rtol=0, atol=straight + EXACT)
    left = _run(late, cutoff_hz=15.0)
    assert np.abs(left.tau - _torque(left.t))[:, 0].max() > 0.2


@pytest.mark.parametrize("start", [0.0, 12345.0, 1e6, 1.7e9])
def test_where_the_stamps_start_changes_nothing(start: float) -> None:
    """The rate is 100 Hz but for its last digits: a sample less at each end, another derivative."""
    record = _record(rate=100.0)
    shifted = replace(record, t=start + (record.t - record.t[0]))
    settings = {"cutoff_hz": 10.0, "derivative": "savgol", "delays_s": (0.02, 0.0, -0.02)}
    ours, theirs = _run(record, **settings), _run(shifted, **settings)
    assert len(ours.t) == len(theirs.t)
    np.testing.assert_allclose(theirs.ddq, ours.ddq, atol=1e-4)


def test_delays_go_round_a_period() -> None:
    t = np.arange(1000) / 100.0
    torque = np.column_stack([np.sin(2 * np.pi * t / 10), np.cos(4 * np.pi * t / 10)])
    late = np.column_stack([np.roll(torque[:, 0], 30), np.roll(torque[:, 1], -7)])
    ours = delayed(late, 100.0, (0.3, -0.07), circular=True)
    np.testing.assert_allclose(ours, torque, rtol=0, atol=EXACT)
    assert delayed(late, 100.0, None) is late
    assert delayed(late, 100.0, (0.0, 0.0)) is late
    with pytest.raises(InputError, match="one delay a joint; got 3; allowed: 2"):
        delayed(late, 100.0, (0.1, 0.1, 0.1))


@pytest.mark.parametrize("velocity", ["position", "measured"])
@pytest.mark.parametrize("stop", [5.4, 7.0])
def test_nothing_within_reach_of_a_gap_is_kept(stop: float, velocity: str) -> None:
    samples = _run(_record(gap=(5.0, stop)), cutoff_hz=10.0, velocity=velocity)
    reach = np.ceil(TIME_CONSTANTS / (2 * np.pi * 10.0) * 125.0) / 125.0
    inside = (samples.t > 5.0 - reach + 0.01) & (samples.t < stop + reach - 0.01)
    assert not inside.any()
    # And next to it nothing is lost, nor bent by what bridges the gap: it is as at the ends.
    near = (samples.t > 5.0 - reach - 0.05) & (samples.t < stop + reach + 0.05)
    assert near.sum() >= 8
    for name, truth in zip(AT_ENDS, _motion(samples.t), strict=True):
        found = getattr(samples, name)[near]
        np.testing.assert_allclose(found, truth[near], rtol=0, atol=AT_ENDS[name])


def _periodic(periods: int, rate: float = 100.0) -> ExperimentRecord:
    t = np.arange(int(periods * 2 * np.pi * rate / 2)) / rate
    scale = 2 * np.pi / 3.0
    q = np.column_stack([np.sin(scale * t), np.cos(2 * scale * t)])
    torque = np.column_stack([np.cos(scale * t), np.sin(3 * scale * t)])
    return ExperimentRecord(t=t, signals={"q": q, "effort": torque})


def test_a_periodic_record_is_differentiated_exactly_and_kept_whole() -> None:
    samples = _run(_periodic(3), cutoff_hz=5.0, period_s=3.0, delays_s=(0.3, 0.0))
    scale = 2 * np.pi / 3.0
    t = np.arange(300) / 100.0
    np.testing.assert_allclose(samples.t, t, rtol=0, atol=EXACT)
    q = np.column_stack([np.sin(scale * t), np.cos(2 * scale * t)])
    dq = np.column_stack([scale * np.cos(scale * t), -2 * scale * np.sin(2 * scale * t)])
    np.testing.assert_allclose(samples.q, q, rtol=0, atol=EXACT)
    np.testing.assert_allclose(samples.dq, dq, rtol=0, atol=EXACT)
    np.testing.assert_allclose(samples.ddq, -q * np.square([scale, 2 * scale]), rtol=0, atol=EXACT)
    np.testing.assert_allclose(samples.tau[:, 0], np.cos(scale * (t + 0.3)), rtol=0, atol=EXACT)
    assert samples.noise is not None
    np.testing.assert_allclose(samples.noise, 0, rtol=0, atol=EXACT)


def test_a_phase_that_no_repetition_saw_is_left_out_of_a_period() -> None:
    record = _periodic(3)
    signals = uniform_signals(record, _robot(2), ProcessingSettings())
    phase = np.arange(len(signals.t)) % 300
    torn = replace(signals, valid=np.where(phase < 5, 0.0, 1.0))
    samples = samples_from(torn, ProcessingSettings(cutoff_hz=5.0, period_s=3.0))
    edge = int(np.ceil(TIME_CONSTANTS / (2 * np.pi * 5.0) * 100.0))
    # The reach of the gap goes across the seam of the circle.
    expected = np.arange(5 + edge, 300 - edge)
    np.testing.assert_allclose(samples.t * 100.0, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("rate", "cutoff", "block"),
    [(125.0, 5.0, 1), (500.0, 5.0, 2), (5000.0, 5.0, 20), (5000.0, 25.0, 20)],
)
def test_blocks_are_as_long_whatever_the_cut_off(rate: float, cutoff: float, block: int) -> None:
    """Errors of means of more samples are smaller: a lower cut-off would look better for them."""
    record = _record(duration=4.0, rate=rate)
    samples = _run(record, cutoff_hz=cutoff, decimate=True)
    assert samples.block == block
    assert rate / block >= min(rate, BLOCK_RATE_HZ)
    assert _run(record, cutoff_hz=cutoff).block == 1


def test_a_record_at_5_khz_gives_the_same_motion() -> None:
    _assert_motion(_run(_record(duration=5.0, rate=5000.0), cutoff_hz=15.0))


@pytest.mark.parametrize("count", [32, 33, 40, 100])
def test_short_records_give_what_they_have(count: int) -> None:
    samples = _run(_record(duration=count / 125.0), cutoff_hz=1.0)
    # At most a quarter is cut from either end.
    assert samples.count == count - 2 * (count // 4)
    assert np.isfinite(samples.ddq).all()


def test_too_little_is_refused_with_what_to_do() -> None:
    with pytest.raises(InputError, match="the window holds too few samples"):
        _run(_record(duration=0.2))
    record = _record(duration=0.5, gap=(0.16, 0.3))
    with pytest.raises(InputError, match=f"at least {MIN_SAMPLES}. Use a longer window"):
        _run(record, cutoff_hz=5.0)


def test_a_robot_at_rest_has_no_speed() -> None:
    record = ExperimentRecord(
        t=np.arange(400) / 125.0,
        signals={"q": np.full((400, 2), 1.2), "effort": np.full((400, 2), 7.0)},
    )
    samples = _run(record)
    np.testing.assert_allclose(samples.q, 1.2, rtol=0, atol=EXACT)
    np.testing.assert_allclose(samples.dq, 0, rtol=0, atol=EXACT)
    np.testing.assert_allclose(samples.ddq, 0, rtol=0, atol=1e3 * EXACT)
    np.testing.assert_array_equal(samples.tau, 7.0)


def test_the_cut_off_comes_from_the_motion_and_stays_below_the_rate() -> None:
    # Ten times the joint in the middle, give or take what 20 s can tell apart.
    middle = TURN[1] / (2 * np.pi)
    assert 10 * middle <= _run(_record(duration=20.0)).cutoff_hz <= 10 * (middle + 3 / 20.0)
    assert _run(_record(), cutoff_hz=1e4).cutoff_hz == pytest.approx(0.8 * 62.5)


def test_five_minutes_at_500_hz_fit_in_little_memory() -> None:
    record = _record(duration=300.0, rate=500.0)
    tracemalloc.start()
    try:
        samples = _run(record, cutoff_hz=0.5)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert samples.count > 148000
    assert peak < 100 * MEGABYTE


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"cutoff_hz": 0.0}, "cutoff_hz: must be positive; got 0.0"),
        ({"cutoff_hz": float("nan")}, "cutoff_hz"),
        ({"velocity": "guess"}, "velocity source; got guess; allowed: .*position"),
        ({"derivative": "spline"}, "derivative; got spline"),
        ({"start_s": -1.0}, "start_s: must be a time after"),
        ({"stop_s": float("inf")}, "stop_s"),
        ({"start_s": 3.0, "stop_s": 3.0}, "stop_s: must be later than the start of"),
    ],
)
def test_settings_out_of_range_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ProcessingSettings(**values)


def test_settings_can_be_written_down() -> None:
    settings = ProcessingSettings(cutoff_hz=5.0, delays_s=(0.1, 0.0), period_s=2.0, decimate=True)
    again = json.loads(json.dumps(settings.to_json()))
    assert ProcessingSettings(**{**again, "delays_s": tuple(again["delays_s"])}) == settings


def test_samples_must_agree() -> None:
    fine = np.zeros((20, 2))
    whole = {"q": fine, "dq": fine, "ddq": fine, "tau": fine, "rate_hz": 1.0, "cutoff_hz": 1.0}
    samples = Samples(t=np.arange(20.0), **whole)
    assert (samples.count, samples.joints) == (20, 2)
    assert not samples.q.flags.writeable
    with pytest.raises(InputError, match="ddq has the wrong shape"):
        Samples(t=np.arange(20.0), **{**whole, "ddq": fine[:, :1]})
    with pytest.raises(InputError, match="tau is not finite"):
        Samples(t=np.arange(20.0), **{**whole, "tau": fine + np.nan})


OVER = np.array([1e-3])
"""Displacement over which friction builds up [rad]."""
STATE = 0.03
"""To which the state of friction is known, of 1; 0.2 to 0.9 from positions filtered at 5 Hz."""


def _moves_and_rests(step: float, moves: int) -> tuple[ExperimentRecord, np.ndarray]:
    """Moves of 1 s within 60 s, by an encoder of such steps [rad] and noise; and the true one."""
    t = np.arange(7500) / 125.0
    shares = [np.clip(t - start, 0.0, 1.0) for start in np.linspace(1.0, 58.0, moves)]
    ways = [0.3 * (-1) ** (k // 2) for k in range(moves)]
    q = sum(w * (3 * s**2 - 2 * s**3) for w, s in zip(ways, shares, strict=True))[:, None]
    seen = step * np.round(q / step + 0.5 * np.random.default_rng(0).normal(size=q.shape))
    return ExperimentRecord(t=t, signals={"q": seen, "effort": np.cos(q)}), q


@pytest.mark.parametrize(("step", "moves"), [(5e-6, 40), (1e-4, 3)])
def test_friction_follows_where_a_joint_starts_and_rests_in_the_noise_of_its_encoder(
    step: float, moves: int
) -> None:
    record, q = _moves_and_rests(step, moves)
    samples = _run(record, cutoff_hz=5.0)
    true = friction_state(q.T, OVER)[:, np.round(samples.t * 125.0).astype(int)]

    def error(positions: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.square(friction_state(positions.T, OVER) - true))))

    assert error(samples.friction_q) < STATE < error(samples.q) / 5
    # Neither late nor early: the mirror image of the motion reversed in time.
    signals = {name: values[::-1] for name, values in record.signals.items()}
    mirrored = _run(ExperimentRecord(t=record.t, signals=signals), cutoff_hz=5.0)
    np.testing.assert_allclose(mirrored.friction_q[::-1], samples.friction_q, rtol=0, atol=step)


def test_what_a_joint_does_in_motion_is_no_noise_of_its_encoder() -> None:
    """A servo swings at 20 Hz, which a low-pass takes away as well."""
    step = 5e-6
    record, q = _moves_and_rests(step, 30)
    swing = 1e-3 * np.gradient(q[:, 0], record.t) * np.sin(2 * np.pi * 20.0 * record.t)
    signals = {**record.signals, "q": record.signals["q"] + swing[:, None]}
    for one in (record, ExperimentRecord(t=record.t, signals=signals)):
        noise = _run(one, cutoff_hz=5.0).encoder_noise
        assert noise is not None
        assert 0.4 * step < noise[0] < step


def test_friction_follows_the_same_positions_at_the_stamps_and_in_parts() -> None:
    record, _ = _moves_and_rests(5e-6, 40)
    settings = ProcessingSettings(cutoff_hz=12.5)
    whole = process(record, _robot(1), settings)
    noise = whole.encoder_noise
    assert noise is not None
    at = samples_at_stamps(record, _robot(1), settings)
    rows = np.searchsorted(at.t, whole.t - 1e-6)
    np.testing.assert_allclose(at.friction_q[rows], whole.friction_q, rtol=0, atol=EXACT)
    long = LongSignals(
        recording=record,
        robot=_robot(1),
        settings=settings,
        grid=survey(record, settings.start_s, settings.stop_s),
        encoder_noise=noise,
    )
    parts = [long.samples(0, 3000), long.samples(3000, long.count)]
    found = np.concatenate([part.friction_q for part in parts])
    # Each part begins anew, within the noise.
    np.testing.assert_allclose(found, whole.friction_q, rtol=0, atol=8 * float(noise[0]))
    still = [(np.diff(positions, axis=0) == 0).mean() for positions in (found, whole.friction_q)]
    assert min(still) > 0.2
