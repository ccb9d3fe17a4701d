"""A small sample of the scoreboard: clean recordings stay clean, planted faults are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynid.bench import (
    Case,
    Judged,
    Plant,
    Recorded,
    arm,
    motion,
    plant,
    recorded,
    run_verdicts,
    summarise,
)
from dynid.core import Array
from dynid.diagnosis import Recording, findings_of, link_prior
from dynid.diagnosis.diagnose import recording_of
from dynid.diagnosis.hypotheses import hypotheses
from dynid.diagnosis.residual import fits, presliding_of, reference
from dynid.diagnosis.whole_signals import whole_signals
from dynid.recording import ExperimentRecord
from dynid.robot import RobotModel
from dynid.signals import process

GRID_DECADES = 0.3
"""Distances that are tried are half a decade apart."""
SAME_SIZE = 0.02
"""Shares of torque or radians to which noise lets two motions tell a size."""
TURNED_RAD = 0.2
"""Standard deviation of the angles between real axes of inertia and published ones."""
MOST_LEFT = 2.8
"""Error over noise; with one distance for all joints it is 2.9 at least, from filtered positions
3.8 with the right ones."""
CLEAN = (
    Case(arm="sliding", motion="fourier", rate_hz=125.0, duration_s=10.0, seed=1),
    Case(arm="ur3", motion="waypoints", rate_hz=125.0, duration_s=10.0, seed=2),
    Case(arm="seven", motion="teach", rate_hz=1000.0, duration_s=15.0, seed=961818018),
    # The clocks seem 60 ms apart, and 48 ms of that a delay the other way.
    Case(arm="ur5", motion="teach", rate_hz=125.0, duration_s=10.0, seed=775454470),
    # Two or three ways, which a spring, another order, another zero and a payload fit as well.
    Case(arm="heavy", motion="teach", rate_hz=250.0, duration_s=12.0, seed=17868355),
    Case(arm="seven", motion="teach", rate_hz=250.0, duration_s=12.0, seed=685732222),
    Case(arm="ur10e", motion="teach", rate_hz=125.0, duration_s=10.0, seed=51209129),
    Case(arm="ur3", motion="teach", rate_hz=125.0, duration_s=15.0, seed=785306333),
    # Behind a low-pass the slide moves before its friction turns: a body that comes and goes.
    Case(arm="sliding", motion="teach", rate_hz=125.0, duration_s=12.0, seed=591222803),
)
SLOW_CLEAN = (
    # All rows show a coupled motor clearly, fast ones do not.
    Case(arm="seven", motion="teach", rate_hz=500.0, duration_s=15.0, seed=463829848),
    # Joints of a taught motion rest, and their friction holds more or less: nobody pushed.
    Case(arm="ur3", motion="teach", rate_hz=250.0, duration_s=15.0, seed=965532469),
    # A share of their friction is not known, though two joints show as little at once.
    Case(arm="ur10e", motion="teach", rate_hz=1000.0, duration_s=15.0, seed=853771561),
    # All rows show a wrist that is a quarter turn off, fast ones do not.
    Case(arm="ur5", motion="teach", rate_hz=125.0, duration_s=10.0, seed=861373046),
)
PLANTED = (
    ("sliding", "teach", 125.0, 10.0, 514993393, "clock", "large"),
    ("sliding", "fourier", 1000.0, 15.0, 767711293, "contact", "medium"),
    # What a joint leaves swings with its fault, which must not hide it.
    ("ur5", "teach", 125.0, 20.0, 503451217, "spring", "large"),
    # As likely as a delay of all joints: the second of the two names.
    ("heavy", "teach", 500.0, 15.0, 212820168, "joint_delay", "large"),
    # Accelerations from noisy positions beside torques without any.
    ("seven", "waypoints", 125.0, 20.0, 413048803, "commanded", "large"),
    # The four joints that a plain model explains must not hide two without any error.
    ("ur3", "fourier", 125.0, 20.0, 948220267, "commanded", "large"),
    # What is left of friction is half of the wrists' torque.
    ("ur5", "fourier", 125.0, 10.0, 1, "friction_compensated", "large"),
    # Not all torques are larger: those of a body near the flange are.
    ("sliding", "fourier", 250.0, 15.0, 1032575860, "payload", "medium"),
    # The model has taken a part of it where the motion dwells.
    ("ur3", "waypoints", 250.0, 15.0, 509501052, "ripple", "large"),
    # Two thirds of all torques: no payload, which would leave the last link a negative mass.
    ("sliding", "fourier", 125.0, 20.0, 911654613, "gains", "large"),
    # In their wrong order the wrists leave a ninth of their torque.
    ("ur5", "waypoints", 125.0, 20.0, 360084776, "exchanged", "large"),
    # Dry friction would drive its slide one way, though all of it brakes both.
    ("sliding", "waypoints", 100.0, 30.0, 723269726, "gravity_compensated", "large"),
    # Surely and evidently in both fits, though blocks left out are not predicted better.
    ("ur10e", "teach", 125.0, 30.0, 67384537, "payload", "medium"),
    # Two ways show both, though each of them counts as one error.
    ("ur5", "teach", 125.0, 12.0, 78712262, "payload", "large"),
    ("heavy", "teach", 125.0, 8.0, 510099293, "gain", "large"),
    # Two moves: all joints show it together, none alone.
    ("ur10e", "teach", 250.0, 15.0, 622673233, "friction_drift", "large"),
    # Each way shows another part of it.
    ("ur5", "waypoints", 500.0, 15.0, 282437653, "spring", "large"),
    # A spring, found first, is none beside it.
    ("seven", "teach", 125.0, 10.0, 117912028, "friction_drift", "large"),
    # Nearly all of its torque is friction, which drives where the sign is wrong.
    ("ur5", "waypoints", 250.0, 15.0, 809182549, "reversed", "large"),
    # Three other kinds explain it better, by a plain model.
    ("heavy", "teach", 250.0, 15.0, 913451964, "gravity_compensated", "large"),
    # One joint alone shows it, as it moves: half of its friction would have gone.
    ("heavy", "fourier", 125.0, 10.0, 619081743, "contact", "medium"),
)
SLOW = (
    # The information is in few stretches: fits without one of them still agree on it.
    ("ur10e", "teach", 250.0, 20.0, 954789563, "gain", "medium"),
    # A payload, of more sizes, leaves as little.
    ("ur5", "fourier", 250.0, 15.0, 314265696, "quarter_turn", "large"),
    # Friction that builds up over a tenth of the usual distance hides it.
    ("ur3", "teach", 250.0, 15.0, 1000052415, "tilt", "medium"),
    # Other recordings with these faults are above.
    ("ur5", "fourier", 500.0, 15.0, 864229114, "gains", "medium"),
    ("ur5", "waypoints", 125.0, 10.0, 570712269, "joint_delay", "large"),
    # What stops at a limit is no contact.
    ("ur3", "waypoints", 125.0, 120.0, 450961392, "saturated", "large"),
    ("ur5", "fourier", 1000.0, 15.0, 523289140, "gain", "large"),
    ("ur5", "fourier", 125.0, 20.0, 317888587, "payload", "medium"),
    # Of its ten sizes the centre is sure, the mass is not.
    ("heavy", "fourier", 125.0, 20.0, 957102595, "payload", "large"),
    # Friction that drives.
    ("ur5", "teach", 100.0, 20.0, 761903882, "reversed", "large"),
    # It is not left of friction at rest: no pushes against joints that stand.
    ("ur10e", "teach", 100.0, 30.0, 0, "friction_compensated", "large"),
    # Where the motion dwells, a large wave spreads over all orders.
    ("ur5", "fourier", 125.0, 20.0, 1041449482, "ripple", "large"),
    # Light wrists: little is left in their wrong order, but by links that are not this arm's.
    ("ur3", "fourier", 125.0, 20.0, 4, "exchanged", "large"),
    # Friction near reversals hides it: fast rows show it clearly, all rows lean to it.
    ("ur3", "teach", 100.0, 20.0, 463936486, "delay", "medium"),
    # A body of usual size, not all torques larger.
    ("ur10e", "waypoints", 500.0, 15.0, 749940876, "payload", "large"),
)


def judge(made: Recorded) -> Judged:
    """The diagnosis alone: nothing is identified or predicted."""
    return Judged(
        findings=findings_of(made.record, made.robot),
        level="usable",
        t=made.validation.t,
        predicted=made.clean,
    )


def as_recording(made: Recorded, block: int) -> Recording:
    samples = process(made.record, made.robot)
    names = ("t", "q", "dq", "ddq", "friction_q", "tau")
    parts = {name: np.array(getattr(samples, name)) for name in names}
    return Recording(robot=made.robot, block=block, **parts)


@pytest.mark.parametrize(
    "case",
    [*CLEAN, *(pytest.param(case, marks=pytest.mark.long) for case in SLOW_CLEAN)],
    ids=lambda case: f"{case.arm}-{case.motion}",
)
def test_clean_recordings_raise_nothing(case: Case) -> None:
    (row,) = run_verdicts(judge, [case])
    assert row.kinds == ()
    assert row.error_percent < 1e-6


@pytest.mark.parametrize(
    ("name", "motion", "scale"),
    [
        ("ur5", "fourier", 1.0),
        ("ur3", "teach", 0.0),
        *(
            pytest.param(name, motion, scale, marks=pytest.mark.long)
            for name, motion, scale in (
                ("ur5", "fourier", 0.15),
                ("ur5", "fourier", 0.0),
                ("ur3", "teach", 1.0),
                ("ur3", "teach", 0.15),
            )
        ),
    ],
)
def test_an_arm_with_little_friction_is_not_one_whose_friction_was_compensated(
    monkeypatch: pytest.MonkeyPatch, name: str, motion: str, scale: float
) -> None:
    """As much is left of friction that a controller takes off, but not near reversals."""

    def smooth(robot: RobotModel, seed: int) -> Plant:
        real = plant(robot, seed)
        parts = {part: scale * getattr(real, part) for part in ("coulomb", "viscous", "load")}
        return replace(real, **parts)

    monkeypatch.setattr("dynid.bench.verdicts.plant", smooth)
    made = recorded(Case(arm=name, motion=motion, rate_hz=125.0, duration_s=10.0, seed=7))
    found = findings_of(made.record, made.robot)
    assert "friction_compensated" not in {f.kind for f in found}
    told = {f.severity for f in found if f.kind == "hardly_any_friction"}
    assert told == ({"info"} if scale < 1.0 else set())


def test_rows_that_are_sampled_early_or_late_are_no_slow_clock() -> None:
    """Their accelerations are mostly noise, of which a slower clock leaves less."""
    made = recorded(Case(arm="ur5", motion="fourier", rate_hz=50.0, duration_s=10.0, seed=1))
    t, draw = made.record.t, np.random.default_rng(1)
    sampled = t + 0.3 * 0.02 * draw.normal(size=len(t))
    signals = {
        name: np.column_stack([np.interp(sampled, t, column) for column in value.T])
        for name, value in made.record.signals.items()
    }
    found = findings_of(ExperimentRecord(t=t, signals=signals), made.robot)
    assert not {f.kind for f in found if f.severity != "info"}
    # Between gaps nothing is left by a narrower filter.
    kept = t % 2.0 < 1.7
    parts = {name: value[kept] for name, value in signals.items()}
    assert findings_of(ExperimentRecord(t=t[kept], signals=parts), made.robot) is not None


@pytest.mark.parametrize(("of", "ramp"), [("seven", 0.08), ("ur10e", 0.04)])
def test_where_joints_jog_at_one_speed_no_friction_drives(of: str, ramp: float) -> None:
    """Columns that are alike there cancel each other; together they brake.

    Positions are half a sample early: a delay too short for a finding leaves torques where joints
    start.
    """
    real = plant(arm(of), 4)
    n, step = real.robot.joints, 0.008
    legs = np.arange(6 * n)
    s = np.arange(250) / 250
    shape = np.clip(np.minimum(s, 0.8 - s) / ramp, 0.0, 1.0)
    shape = shape**2 * (3 - 2 * shape)
    speed = 0.2 * real.robot.limits.velocity
    to = np.eye(n)[legs % n] * np.where(legs // n % 2, -speed[legs % n], speed[legs % n])[:, None]
    dq = (to[:, None] * shape[:, None]).reshape(-1, n)
    q = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0])[:n] + np.cumsum(dq, axis=0) * step
    found = findings_of(_measured(real, q, dq, step), real.robot)
    assert "friction_compensated" not in {f.kind for f in found}


def test_what_a_joint_shows_once_is_explained() -> None:
    """Joints jog in any order: a part that is left out has all that one of them shows."""
    real = plant(arm("sliding"), 3)
    n, step = real.robot.joints, 0.008
    legs = np.random.default_rng(3).integers(n, size=2 * n)
    turns = (np.eye(n)[legs].cumsum(axis=0)[np.arange(2 * n), legs]) % 2
    s = np.arange(250) / 250
    shape = np.clip(np.minimum(s, 0.8 - s) / 0.08, 0.0, 1.0)
    speed = 0.06 * real.robot.limits.velocity[legs] * np.where(turns, 1, -1)
    to = np.eye(n)[legs] * speed[:, None]
    dq = (to[:, None] * (shape**2 * (3 - 2 * shape))[:, None]).reshape(-1, n)
    q = np.array([0.0, 0.0, 0.0, -1.5]) + (np.cumsum(dq, axis=0) - dq / 2) * step
    assert findings_of(_measured(real, q, dq, step), real.robot) == ()


def test_of_noise_no_friction_drives() -> None:
    """Joints without friction: what is left of their torques is noise."""
    real = plant(arm("heavy"), 52)
    none = np.zeros(real.robot.joints)
    real = replace(real, coulomb=none, viscous=none, load=none)
    path = motion(real.robot, "teach", 2, 125.0, 10.0)
    found = findings_of(_measured(real, path.q, path.dq, 0.008), real.robot)
    assert {f.kind for f in found if f.severity != "info"} == set()


def test_of_a_joint_whose_torque_is_lost_no_friction_drives() -> None:
    made = recorded(Case(arm="ur5", motion="fourier", rate_hz=125.0, duration_s=20.0, seed=3))
    effort = made.record.signals["effort"].copy()
    effort[:, 2] = 0.0
    lost = replace(made.record, signals={**made.record.signals, "effort": effort})
    assert "friction_compensated" not in {f.kind for f in findings_of(lost, made.robot)}


@pytest.mark.parametrize("seed", [202, 254])
def test_a_cable_is_no_object_that_is_picked_up(seed: int) -> None:
    """It loads a slide on one side: with changes of a payload at any price it looks like one."""
    real = plant(arm("sliding"), seed)
    path = motion(real.robot, "teach", seed, 125.0, 20.0)
    record = _measured(real, path.q, path.dq, 0.008)
    effort, away = record.signals["effort"].copy(), path.q[:, 2] - path.q[:, 2].mean()
    size = 0.45 * np.sqrt(np.square(effort[:, 2]).mean())
    effort[:, 2] += size * np.maximum(away, 0.0) / np.abs(away).max()
    (found,) = findings_of(
        replace(record, signals={**record.signals, "effort": effort}), real.robot
    )
    assert (found.kind, found.joints) == ("spring", (2,))


@pytest.mark.parametrize(("alternating", "told"), [(False, 2), (True, 3)])
def test_changes_of_a_payload_that_come_back_count_once(alternating: bool, told: int) -> None:
    """An object in the same part of each repetition, and one in every other of them."""
    real = plant(arm("sliding"), 4)
    path = motion(real.robot, "fourier", 4, 125.0, 40.0)
    there = (path.t // 10.0) % 2 == 1 if alternating else (path.t % 10.0 > 2) & (path.t % 10.0 < 6)
    parts = (real, real.with_payload(1.0, real.robot.flange[:3, 3]))
    empty, full = (_measured(one, path.q, path.dq, 0.008) for one in parts)
    effort = np.where(there[:, None], full.signals["effort"], empty.signals["effort"])
    made = process(replace(full, signals={**full.signals, "effort": effort}), real.robot)
    ref = reference(recording_of(real.robot, made), link_prior(real.robot))
    (change,) = (h for h in hypotheses(ref, fits(ref)[1]) if h.kind == "payload_change")
    assert (len(change.changes_s), change.told) == (3 if alternating else 8, told)


def _measured(real: Plant, q: Array, dq: Array, step_s: float) -> ExperimentRecord:
    rigid = real.torque(q, dq, np.gradient(dq, step_s, axis=0))
    draw = np.random.default_rng(1)
    noise = real.torque_noise * draw.normal(size=q.shape)
    torque = rigid + real.friction(dq, rigid, step_s) + noise
    signals = {"q": q, "qd": dq + 1e-3 * draw.normal(size=q.shape), "effort": torque}
    return ExperimentRecord(t=np.arange(len(q)) * step_s, signals=signals)


@pytest.mark.parametrize(("fault", "seed"), [("flexibility", 1), ("payload", 7)])
def test_small_and_large_arms_are_judged_alike(fault: str, seed: int) -> None:
    """Masses and torques of another unit: the same findings, their values in that unit."""
    motion = "fourier" if fault == "flexibility" else "waypoints"
    case = Case(
        arm="ur5", motion=motion, rate_hz=125.0, duration_s=10.0,
        seed=seed, fault=fault, size="large",
    )  # fmt: skip
    made, values = recorded(case), []
    for unit in (1.0, 1e-3, 1e3):
        limits = replace(made.robot.limits, torque=unit * made.robot.limits.torque)
        robot = replace(made.robot, inertias=unit * made.robot.inertias, limits=limits)
        signals = made.record.signals | {"effort": unit * made.record.signals["effort"]}
        (found,) = findings_of(replace(made.record, signals=signals), robot)
        assert found.kind == fault
        values.append(found.value * (unit if fault == "flexibility" else 1 / unit))
    np.testing.assert_allclose(values, values[0], rtol=1e-3)


def test_the_unit_of_a_slide_is_not_the_error_of_the_others() -> None:
    def shrunk(made: Recorded) -> Judged:
        factor = np.where(made.robot.prismatic, 1.0, 0.9)
        return replace(judge(made), predicted=made.clean * factor)

    case = Case(arm="sliding", motion="waypoints", rate_hz=100.0, duration_s=10.0, seed=1)
    (row,) = run_verdicts(shrunk, [case])
    assert row.error_percent == pytest.approx(10.0, rel=1e-6)


def test_links_that_were_published_roughly_are_no_fault() -> None:
    """Masses off by up to 20 %, centres by up to 20 mm."""
    case = Case(arm="ur10e", motion="fourier", rate_hz=100.0, duration_s=10.0, seed=5)
    made, draw = recorded(case), np.random.default_rng(5)
    n = made.robot.joints
    rough = made.robot.inertias * draw.uniform(0.8, 1.2, n)[:, None]
    rough[:, 1:4] += rough[:, :1] * draw.uniform(-0.02, 0.02, (n, 3))
    assert findings_of(made.record, replace(made.robot, inertias=rough)) == ()


@pytest.mark.parametrize(("name", "seed"), [("ur10e", 2), ("heavy", 12)])
def test_tensors_that_are_turned_are_no_fault(name: str, seed: int) -> None:
    """Published axes of inertia are those of drawings: a spring or another length fits as well."""
    real, draw = plant(arm(name), seed), np.random.default_rng(seed)
    half = np.cross(np.eye(3), TURNED_RAD * draw.normal(size=(len(real.mass), 1, 3))) / 2
    turn = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
    real = replace(real, second=turn @ real.second @ turn.swapaxes(1, 2))
    path = motion(real.robot, "fourier", seed, 125.0, 20.0)
    made = _measured(real, path.q, path.dq, 1 / 125.0)
    assert [f for f in findings_of(made, real.robot) if f.severity != "info"] == []


@pytest.mark.parametrize(
    "planted",
    [
        pytest.param(
            planted,
            id=f"{planted[5]}-{planted[6]}",
            marks=[pytest.mark.long] if planted in SLOW else [],
        )
        for planted in (*PLANTED, *SLOW)
    ],
)
def test_planted_faults_are_named(
    planted: tuple[str, str, float, float, int, str, str],
) -> None:
    arm, motion, rate_hz, duration_s, seed, fault, size = planted
    case = Case(
        arm=arm, motion=motion, rate_hz=rate_hz, duration_s=duration_s, seed=seed, fault=fault,
        size=size,
    )  # fmt: skip
    rows = run_verdicts(judge, [case])
    assert rows[0].named, rows[0].kinds
    (told,) = summarise(rows)["faults"]
    assert (told["cases"], told["named"]) == (1, 1)


@pytest.mark.parametrize(
    ("factor", "level", "misled"), [(1.1, "usable", 1), (1.01, "usable", 0), (1.1, "care", 0)]
)
def test_a_model_that_is_called_usable_and_errs_misleads(
    factor: float, level: str, misled: int
) -> None:
    def trust(made: Recorded) -> Judged:
        return Judged(findings=(), level=level, t=made.validation.t, predicted=factor * made.clean)

    case = Case(arm="ur3", motion="fourier", rate_hz=100.0, duration_s=2.0, seed=1, fault="delay")
    (told,) = summarise(run_verdicts(trust, [case]))["faults"]
    assert told["misled"] == misled


@pytest.mark.parametrize(
    ("fault", "own"), [("spring", True), ("ripple", True), ("gain", False), ("contact", False)]
)
def test_springs_and_ripples_are_torques_of_the_arm(fault: str, own: bool) -> None:
    case = Case(arm="ur3", motion="fourier", rate_hz=100.0, duration_s=2.0, seed=1, size="large")
    plain, made = (recorded(replace(case, fault=kind)) for kind in (None, fault))
    differs = (plain.clean != made.clean).any(axis=0)
    assert np.flatnonzero(differs).tolist() == ([made.joint] if own else [])


def test_light_links_of_an_unpublished_arm_are_fitted_as_well_as_heavy_ones() -> None:
    """Of a hundredth of the torques, 12 to 32 times as much was left of four joints."""
    made = recorded(Case(arm="ur10e", motion="fourier", rate_hz=125.0, duration_s=10.0, seed=1))
    unknown = replace(made.robot, inertias=np.full_like(made.robot.inertias, np.nan))
    rec, prior = as_recording(replace(made, robot=unknown), block=1), link_prior(unknown)
    left: list[np.ndarray] = []
    for lighter in (1.0, 0.01):
        ref = reference(replace(rec, tau=lighter * rec.tau), prior)
        _, values = fits(ref)
        left.append(np.square(ref.left(values)).mean(axis=1) / lighter**2)
    np.testing.assert_allclose(left[1], left[0], rtol=1e-3)


@pytest.mark.parametrize("fault", [pytest.param(None, marks=pytest.mark.long), "joint_delay"])
def test_friction_builds_up_over_the_distance_that_it_did(fault: str | None) -> None:
    """A torque that is late looks like a longer distance; what is left out counts for none."""
    case = Case(
        arm="heavy", motion="waypoints", rate_hz=500.0, duration_s=20.0, seed=10, fault=fault,
        size="large",
    )  # fmt: skip
    made, real = recorded(case), plant(arm(case.arm), case.seed)
    rec, prior = as_recording(made, block=5), link_prior(made.robot)
    # Without a quarter of the rows any distance of two joints leaves their noise alone.
    for one, untold in ((rec, 0), (rec.without(rec.t % 4.0 < 1.0), 2)):
        ref = reference(one, prior)
        sums, values = fits(ref)
        shares = presliding_of(ref, values, sums.counts)
        decades = np.abs(np.log10(shares * np.ptp(rec.q, axis=0) / real.presliding))
        assert np.sort(decades)[-1 - untold] < GRID_DECADES
        ref = reference(replace(one, presliding=shares), prior)
        left = np.sqrt(np.square(ref.left(fits(ref)[1])).mean(axis=1) * one.block)
        assert (left / real.torque_noise).max() < MOST_LEFT


def test_torques_without_any_error_need_nothing_put_right() -> None:
    """A normal matrix is nearly singular then, and errors of 1e-8 tell rivals apart."""
    (case,) = [
        Case(
            arm=arm, motion=motion, rate_hz=rate_hz, duration_s=s, seed=seed, fault=fault, size=size
        )
        for arm, motion, rate_hz, s, seed, fault, size in PLANTED
        if (arm, fault) == ("ur3", "commanded")
    ]
    made = recorded(case)
    prior = link_prior(made.robot)
    ref = reference(as_recording(made, block=1), prior)
    assert whole_signals(ref, *fits(ref), prior) == []


def test_a_seed_gives_the_same_recording() -> None:
    first, again = recorded(CLEAN[0]), recorded(CLEAN[0])
    assert (first.record.signals["effort"] == again.record.signals["effort"]).all()


@pytest.mark.parametrize("fault", ["gain", "gains", "encoder_zero", "quarter_turn"])
def test_both_motions_have_the_same_fault(fault: str) -> None:
    """Its sign is drawn once for an arm."""
    for seed in range(3):
        case = Case(
            arm="ur3", motion="fourier", rate_hz=100.0, duration_s=10.0, seed=seed, fault=fault,
            size="large",
        )  # fmt: skip
        # What is left of the same draws where nothing is planted: signs move those of the noise.
        made, clean = recorded(case), recorded(replace(case, fault=None))
        signal = "q" if fault in ("encoder_zero", "quarter_turn") else "effort"
        sizes: list[np.ndarray] = []
        for one, other in ((made.record, clean.record), (made.validation, clean.validation)):
            with_fault, without = one.signals[signal], other.signals[signal]
            if signal == "q":
                sizes.append((with_fault - without).mean(axis=0))
            else:
                sizes.append((with_fault * without).sum(axis=0) / np.square(without).sum(axis=0))
        assert np.abs(sizes[0] - (signal == "effort")).max() > 0.1
        np.testing.assert_allclose(*sizes, atol=SAME_SIZE)
