"""Faults planted in recordings of a pinocchio arm are named with their size; clean ones are not."""

from __future__ import annotations

import re
import sysconfig
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pinocchio_arm import NOISE, RATE, Wrong, arm, recording
from scipy.signal import butter, lfilter

from dynid import FourierSeries, identify, random_excitation, read_recording, simulate_recording
from dynid.core import Finding, RecordError
from dynid.diagnosis import (
    Explanation,
    Recording,
    contact_stretches,
    diagnose,
    explain,
    findings_of,
    link_prior,
)
from dynid.diagnosis.diagnose import finding_of, recording_of
from dynid.diagnosis.events import torque_deviations
from dynid.diagnosis.hypotheses import hypotheses
from dynid.diagnosis.residual import correlation_length, fits, reference
from dynid.recording import ExperimentRecord, RecordMetadata
from dynid.robot import from_body, load_robot, robot_from_chain, with_mount
from dynid.signals import ProcessingSettings, default_cutoff, process

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
MODELS = Path(sysconfig.get_path("purelib"), "cmeel.prefix/share/example-robot-data/robots")
SIGMAS, FEW_SIGMAS = 4.0, 1.5
EARLY_OR_LATE_S = 0.25
CLOCK_WITHIN = 0.002
"""Positions of rigid joints tell the clock of their velocities."""


def faults(folder: Path, wrong: Wrong) -> list[Finding]:
    found = findings_of(recording(wrong), arm(folder))
    return [finding for finding in found if finding.severity != "info"]


@pytest.mark.parametrize(
    "wrong",
    [
        Wrong(),
        pytest.param(Wrong(seed=1, load_friction=0.05), marks=pytest.mark.long),
        pytest.param(Wrong(seed=3, seconds=40.0), marks=pytest.mark.long),
        Wrong(seed=4, seconds=40.0, load_friction=0.05),
    ],
)
def test_clean_recordings_raise_no_finding(tmp_path: Path, wrong: Wrong) -> None:
    assert faults(tmp_path, wrong) == []


def test_one_limit_for_all_joints_tells_nothing_of_their_friction(tmp_path: Path) -> None:
    """Of 1000 N.m the friction is 0.2 %: it was called compensated."""
    robot = arm(tmp_path)
    limits = replace(robot.limits, torque=np.full(3, 1000.0))
    assert findings_of(recording(Wrong(friction=0.5)), replace(robot, limits=limits)) == ()


def test_noise_is_that_of_the_rows_that_count(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    rec = recording_of(robot, process(recording(Wrong()), robot, ProcessingSettings()))
    half = np.arange(len(rec.t)) % 2 == 0
    noise: list[np.ndarray] = []
    for one in (rec, rec.without(half)):
        found, _ = fits(reference(one, link_prior(robot)))
        noise.append(np.sqrt(found.counts / found.rows / found.weights))
    assert noise[1] == pytest.approx(noise[0], rel=0.1)


@pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings of ../shared/data are not here")
def test_fast_rows_of_a_real_arm_need_to_show_a_fault_clearly() -> None:
    """They show a spring in its wrist, a little, and all rows lean to it."""
    robot = load_robot(ROOT / "examples" / "robots" / "ur10_unisa.toml")
    bag = DATA / "ur10_unisa" / "ur10_exciting_trajectory.db3"
    assert findings_of(read_recording([bag], robot=robot), robot) == ()


@pytest.mark.long
@pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings of ../shared/data are not here")
def test_a_real_arm_whose_friction_is_hardly_seen_has_no_spring() -> None:
    """Its torques are those of links, and of one joint a tenth larger than published masses say."""
    robot = load_robot(ROOT / "examples" / "robots" / "panda.toml")
    parts = ("time", "positions", "velocity", "torques")
    record = read_recording(
        [DATA / "panda_gaz" / f"exciting_traj_{part}.txt" for part in parts],
        robot=robot,
        columns="t=0,q=1:8,qd=8:15,effort=15:22",
    )
    found = {(f.kind, f.joints) for f in findings_of(record, robot) if f.severity != "info"}
    assert found == {("drive_gain", (5,))}


@pytest.mark.skipif(not MODELS.is_dir(), reason="the package example-robot-data is not installed")
@pytest.mark.parametrize(
    ("name", "margin", "acceleration", "rate_hz", "seed"),
    [
        ("so_arm_description/urdf/so100", 0.7, 8.0, 125.0, 0),
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in (
                # A bend of a fraction of a milliradian under small torques.
                ("kinova_description/robots/kinova", 0.5, 5.0, 250.0, 11),
                # All rows show one of another size than fast ones.
                ("so_arm_description/urdf/so100", 0.7, 8.0, 125.0, 11),
                # Fast rows alone show a flexibility.
                ("panda_description/urdf/panda", 0.6, 3.0, 500.0, 12),
            )
        ),
    ],
)
def test_friction_near_reversals_is_no_fault(
    name: str, margin: float, acceleration: float, rate_hz: float, seed: int
) -> None:
    robot = load_robot(MODELS / f"{name}.urdf", collision=False)
    motion = random_excitation(
        robot.limits.motion, seed=seed, margin=margin, acceleration=acceleration
    )
    record = simulate_recording(robot, motion, periods=2, rate_hz=rate_hz, seed=seed)
    assert [finding.kind for finding in findings_of(record, robot)] == []


# What `dynid design` found for it once, in hundredths of radians.
KINOVA_AT = (-21, 257, 384, 53, 267, -25)
KINOVA_SINES = (
    [-14, 0, 1, -7, 0, -1, -1, -1, 1, 6],
    [-54, -10, 5, 5, -1, 2, 2, 2, -2, 2],
    [11, 4, 2, -3, -1, -2, 2, -1, 2, -2],
    [-23, 5, -4, 4, -2, -4, 1, 2, 2, 1],
    [7, -13, 15, -8, 2, -3, 2, 3, -2, 0],
    [25, -15, -8, 0, -1, 3, -1, 2, 2, -1],
)
KINOVA_COSINES = (
    [0, 4, 0, 0, 0, 4, 0, -1, 0, -1],
    [-17, -2, -3, 2, 2, 0, 1, -1, -1, 1],
    [49, -3, 1, -1, 0, 1, -3, -2, 2, 1],
    [74, -5, 0, 3, 2, -4, 2, -1, 0, -1],
    [25, 3, -4, -4, 3, -1, 2, 3, -3, -1],
    [43, -1, -3, 0, 2, -3, -2, 3, 1, -1],
)


@pytest.mark.skipif(not MODELS.is_dir(), reason="the package example-robot-data is not installed")
def test_servos_that_swing_where_friction_turns_round_are_no_fault() -> None:
    """Low-passed at ten times the motion's frequency, they left torques of gears that bend."""
    robot = load_robot(MODELS / "kinova_description/robots/kinova.urdf", collision=False)
    at, sines, cosines = (
        0.01 * np.array(x, dtype=float) for x in (KINOVA_AT, KINOVA_SINES, KINOVA_COSINES)
    )
    motion = FourierSeries(period=10.0, offset=at, a=sines, b=cosines)
    record = simulate_recording(robot, motion, periods=2, rate_hz=125.0, seed=0)
    assert [finding.kind for finding in findings_of(record, robot)] == []
    estimate = identify(record, robot).estimate
    assert estimate.settings.cutoff_hz is not None
    assert estimate.settings.cutoff_hz > default_cutoff(record.signals["q"], 125.0)


@pytest.mark.parametrize(
    ("wrong", "kinds"),
    [
        (Wrong(), []),
        (Wrong(seed=1, load_friction=0.05), []),
        # Another last link, of which nothing is known.
        (Wrong(carried=2.0), []),
        (Wrong(scales=(1.0, 0.8, 1.0)), ["drive_gain"]),
        (Wrong(scales=(1.0, -1.0, 1.0)), ["reversed"]),
        (Wrong(tilt_deg=3.0), ["mounting"]),
        (Wrong(warming=0.5), ["friction_drift"]),
    ],
)
def test_faults_are_named_where_no_inertias_are_published(
    tmp_path: Path, wrong: Wrong, kinds: list[str]
) -> None:
    robot = arm(tmp_path)
    unpublished = replace(robot, inertias=np.full_like(robot.inertias, np.nan))
    assert [f.kind for f in findings_of(recording(wrong), unpublished)] == kinds


@pytest.mark.parametrize(
    ("joint", "factor"),
    [
        (0, 0.8),
        (1, 1.9),
        *(pytest.param(*few, marks=pytest.mark.long) for few in ((1, 0.85), (2, 1.3))),
    ],
)
def test_a_wrong_gain_is_measured(tmp_path: Path, joint: int, factor: float) -> None:
    scales = [1.0, 1.0, 1.0]
    scales[joint] = factor
    found = faults(tmp_path, Wrong(scales=(scales[0], scales[1], scales[2])))[0]
    assert (found.kind, found.joints) == ("drive_gain", (joint,))
    assert found.value == pytest.approx(factor, abs=SIGMAS * (found.std or 0.0))


@pytest.mark.parametrize(("mass", "since"), [(1.0, 4.0), (0.4, 8.0)])
def test_a_payload_that_is_taken_up_on_the_way_is_named(
    tmp_path: Path, mass: float, since: float
) -> None:
    (found,) = faults(tmp_path, Wrong(carried=mass, carried_from=since))
    assert (found.kind, found.code) == ("payload_change", "payload")
    assert found.value == pytest.approx(mass, abs=SIGMAS * (found.std or 0.0))
    told = re.search(r"at about ([\d.]+) s", found.text)
    assert told is not None
    assert float(told[1]) == pytest.approx(since, abs=EARLY_OR_LATE_S)


@pytest.mark.parametrize(("seconds", "held", "changes"), [(12.0, 2.0, 6), (480.0, 4.0, 120)])
def test_objects_that_are_picked_up_and_put_down_are_named_with_their_mass(
    tmp_path: Path, seconds: float, held: float, changes: int
) -> None:
    """One change explains little; in the same place of each repetition none seems to be new."""
    wrong = Wrong(carried=0.5, carried_from=1.5, carried_for=held, seconds=seconds)
    (found,) = faults(tmp_path, wrong)
    assert (found.kind, found.code) == ("payload_change", "payload")
    assert found.value == pytest.approx(0.5, abs=SIGMAS * (found.std or 0.0))
    told = re.search(r"at about ([\d.]+) s, and back: (\d+) changes", found.text)
    assert told is not None
    assert float(told[1]) == pytest.approx(1.5, abs=EARLY_OR_LATE_S)
    assert int(told[2]) == changes


@pytest.mark.parametrize(("since", "held", "stop"), [(1.5, 2.0, 6.4), (6.5, 9.0, 8.0)])
def test_contacts_that_last_beyond_the_change_of_a_payload_are_named(
    tmp_path: Path, since: float, held: float, stop: float
) -> None:
    """A contact after a change, and one during which there is a change."""
    carried = Wrong(carried=0.5, carried_from=since, carried_for=held, seconds=14.0)
    found = faults(tmp_path, replace(carried, push=60.0, push_stop=stop))
    assert [f.kind for f in found] == ["payload_change", "contact"]
    assert found[1].value == pytest.approx(6.0, abs=EARLY_OR_LATE_S)


@pytest.mark.parametrize(
    ("side", "turns"),
    [
        pytest.param("friction", -0.5, marks=pytest.mark.long),
        pytest.param("torques", 1.0, marks=pytest.mark.long),
        ("motors", 1.0),
    ],
)
def test_motors_that_the_robot_file_does_not_couple_are_named(
    tmp_path: Path, side: str, turns: float
) -> None:
    (found,) = faults(tmp_path, Wrong(coupled=turns, side=side, seconds=24.0))
    assert (found.kind, found.joints) == (f"coupled_{side}", (1, 2))
    assert found.value == pytest.approx(turns, abs=0.01)
    assert found.value == pytest.approx(turns, abs=SIGMAS * (found.std or 0.0))
    turned = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, round(found.value or 0.0, 3), 1.0]]
    assert f"[drives] coupling = {turned}" in found.next_step
    assert ('torque_side = "motor"' in found.next_step) == (side != "friction")
    assert ('position_side = "motor"' in found.next_step) == (side == "motors")
    # Joint values of a robot whose file says so: nothing else is wrong.
    (tmp_path / "mended.toml").write_text(f'urdf = "arm.urdf"\n[drives]\ncoupling = {turned}\n')
    mended = load_robot(tmp_path / "mended.toml")
    again = findings_of(recording(Wrong(coupled=turns, seconds=24.0, seed=1)), mended)
    assert [f for f in again if f.severity != "info"] == []


def test_friction_of_a_coupled_motor_bends_no_gear(tmp_path: Path) -> None:
    """Two flexibilities were named on a clean arm: their columns held the motor's Coulomb step."""
    robot = arm(tmp_path)
    turns = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
    robot = replace(robot, drives=replace(robot.drives, coupling=turns))
    samples = process(recording(Wrong(coupled=1.0)), robot, ProcessingSettings())
    ref = reference(recording_of(robot, samples), link_prior(robot))
    names = ref.recording.model.names
    values = np.zeros(len(ref.columns))
    values[[names.index("Fcm3"), names.index("Fvm3")]] = 5.0
    rivals = hypotheses(ref, values)
    # Wrists have motors that turn with two joints before theirs.
    assert ("coupled_friction", (0, 2)) in {(rival.kind, rival.joints) for rival in rivals}
    for rival in rivals:
        if rival.kind in ("flexibility", "drive_gain", "encoder_zero"):
            np.testing.assert_array_equal(rival.columns, 0.0)
        if rival.kind == "delay" and rival.joints == (1,):
            motors = 5.0 * (ref.recording.ddq[:, 1] + ref.recording.ddq[:, 2])
            here = slice(5, -5)
            late = -ref.recording.average(motors[None])[0]
            np.testing.assert_allclose(rival.columns[0, 1, here], late[here], atol=0.5)


@pytest.mark.parametrize(
    "joint", [pytest.param(0, marks=pytest.mark.long), 1, pytest.param(2, marks=pytest.mark.long)]
)
def test_a_reversed_torque_is_named(tmp_path: Path, joint: int) -> None:
    scales = [1.0, 1.0, 1.0]
    scales[joint] = -1.0
    found = faults(tmp_path, Wrong(scales=(scales[0], scales[1], scales[2])))[0]
    assert (found.kind, found.joints, found.severity) == ("reversed", (joint,), "error")


@pytest.mark.parametrize("joint", [0, pytest.param(1, marks=pytest.mark.long), 2])
def test_a_reversed_torque_is_named_beside_an_unknown_payload(tmp_path: Path, joint: int) -> None:
    scales = [1.0, 1.0, 1.0]
    scales[joint] = -1.0
    found = faults(tmp_path, Wrong(scales=(scales[0], scales[1], scales[2]), carried=2.0))
    assert ("reversed", (joint,)) in {(f.kind, f.joints) for f in found}


def test_absolute_torques_are_no_reversed_ones(tmp_path: Path) -> None:
    record = recording(Wrong())
    absolute = {**record.signals, "effort": np.abs(record.signals["effort"])}
    (found,) = findings_of(replace(record, signals=absolute), arm(tmp_path))
    assert (found.kind, found.code, found.severity) == ("absolute_torque", "torque_kind", "error")


def test_slides_have_no_gears_whose_friction_could_be_missing() -> None:
    robot = robot_from_chain(
        placements=np.tile(np.eye(4), (3, 1, 1)),
        axes=np.eye(3),
        name="gantry",
        joint_types=["prismatic"] * 3,
    )
    random, t = np.random.default_rng(0), np.arange(2500) / 125.0
    rates = 2 * np.pi * np.array([[0.1, 0.3], [0.2, 0.5], [0.15, 0.4]])
    sizes = random.uniform(0.1, 0.3, (3, 2))
    angle = t[:, None, None] * rates
    q, dq, ddq = (
        (sizes * rates**k * wave(angle)).sum(axis=2)
        for k, wave in enumerate((np.sin, np.cos, lambda x: -np.sin(x)))
    )
    force = np.array([40.0, 20.0, 10.0]) * ddq + 1.0 * np.tanh(dq / 0.01)
    force[:, 2] += 8.0 * 9.80665
    force += random.normal(scale=0.5, size=force.shape)
    record = ExperimentRecord(
        t=t,
        signals={"q": q, "qd": dq, "effort": force},
        metadata=RecordMetadata(robot="gantry", joint_names=robot.joint_names),
    )
    assert "torque_kind" not in {finding.code for finding in findings_of(record, robot)}


@pytest.mark.parametrize(("mass", "lever", "inertia"), [(3.0, 0.3, 0.4), (1.0, 0.2, 0.05)])
@pytest.mark.parametrize("towards", [0.3, 2.0])
def test_gravity_of_one_link_of_unknown_size_is_no_spring(
    mass: float, lever: float, inertia: float, towards: float
) -> None:
    robot = robot_from_chain(
        placements=np.eye(4)[None],
        axes=np.array([[0.0, 1.0, 0.0]]),
        name="one",
        joint_types=["revolute"],
    )
    t = np.arange(2500) / 125.0
    rates, sizes = 2 * np.pi * np.array([0.1, 0.3, 0.7]), np.array([1.0, 0.5, 0.2])
    angle = t[:, None] * rates + np.arange(3)
    q = (sizes * np.sin(angle)).sum(axis=1)
    dq = (sizes * rates * np.cos(angle)).sum(axis=1)
    tau = -inertia * (sizes * rates**2 * np.sin(angle)).sum(axis=1)
    tau += 9.80665 * mass * lever * np.cos(q + towards) + np.tanh(dq / 0.01) + 0.5 * dq
    tau += np.random.default_rng(0).normal(scale=0.05, size=len(t))
    record = ExperimentRecord(
        t=t,
        signals={"q": q[:, None], "qd": dq[:, None], "effort": tau[:, None]},
        metadata=RecordMetadata(robot="one", joint_names=robot.joint_names),
    )
    assert findings_of(record, robot) == ()


@pytest.mark.parametrize(
    ("published", "factor", "late", "kinds"),
    [(True, 1.8, 0, ["gain_all"]), (True, 1.0, 4, ["delay"]), (False, 2.0, 0, [])],
)
def test_a_single_joint_is_not_measured_by_others(
    published: bool, factor: float, late: int, kinds: list[str]
) -> None:
    """Its gain was that which other joints let expect, its delay as likely as the same delay."""
    end = np.eye(4)
    end[0, 3] = 0.5
    robot = robot_from_chain(
        placements=np.eye(4)[None], axes=np.array([[0.0, 1.0, 0.0]]), flange=end
    )
    link = from_body(5.0, end[:3, 3], 0.02 * np.eye(3))
    if published:
        robot = replace(robot, inertias=link[None])
    sizes = 0.2 * np.array([[[2.0, 2.0, -1.0, 1.0, -0.5]], [[2.0, -2.0, 0.5, -1.0, 1.0]]])
    t = np.arange(2000) / RATE
    motion = FourierSeries(period=10.0, offset=np.zeros(1), a=sizes[0], b=sizes[1]).evaluate(t)
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    tau = factor * (link[5] * ddq - 9.80665 * link[1] * np.cos(q) + np.tanh(dq / 0.001) + dq)
    tau += np.random.default_rng(0).normal(scale=0.05, size=tau.shape)
    record = ExperimentRecord(t=t, signals={"q": q, "effort": np.roll(tau, late, axis=0)})
    assert [finding.kind for finding in findings_of(record, robot)] == kinds


@pytest.mark.parametrize("factor", [1e-3, 0.1, 10.0, 100.0])
def test_torques_in_another_unit_are_nothing_else(tmp_path: Path, factor: float) -> None:
    clean = recording(Wrong())
    signals = {**clean.signals, "effort": factor * clean.signals["effort"]}
    found = findings_of(replace(clean, signals=signals), arm(tmp_path))
    assert [f.kind for f in found if f.severity != "info"] == ["gain_all"]
    assert found[0].value == pytest.approx(factor, rel=0.1)


@pytest.mark.parametrize("degrees", [1.0, 2.0, 5.0])
def test_a_tilted_base_is_measured(tmp_path: Path, degrees: float) -> None:
    found = faults(tmp_path, Wrong(tilt_deg=degrees))[0]
    assert found.kind == "mounting"
    value, std = np.degrees([found.value or 0.0, found.std or 0.0])
    assert value == pytest.approx(degrees, abs=max(SIGMAS * std, 0.1))


@pytest.mark.parametrize("degrees", [40.0, pytest.param(130.0, marks=pytest.mark.long)])
def test_a_base_far_from_its_mounting_is_measured_and_its_gravity_is_named(
    tmp_path: Path, degrees: float
) -> None:
    # A coarse direction is found first, and then what it is off by, about another axis.
    found = next(f for f in faults(tmp_path, Wrong(tilt_deg=degrees)) if f.kind == "mounting")
    value, std = np.degrees([found.value or 0.0, found.std or 0.0])
    assert value == pytest.approx(degrees, abs=max(SIGMAS * std, 0.5))
    named = re.search(r"gravity = \[(.*?)\]", found.next_step)
    assert named is not None
    gravity = np.array([float(x) for x in named[1].split(",")])
    away = np.degrees(np.arccos(-gravity[2] / np.linalg.norm(gravity)))
    assert away == pytest.approx(degrees, abs=max(SIGMAS * std, 0.5))
    # No option turns the base about an axis that is not x.
    assert "--mount" not in found.next_step


def test_a_mounting_that_an_option_can_say_is_said_as_one(tmp_path: Path) -> None:
    tilted = with_mount(arm(tmp_path), "tilt:60")
    found = next(f for f in findings_of(recording(Wrong()), tilted) if f.kind == "mounting")
    named = re.search(r"--mount (tilt:\S+),", found.next_step)
    assert named is not None
    assert with_mount(tilted, named[1]).gravity == pytest.approx([0, 0, -9.80665], abs=0.1)


def test_a_base_on_the_wall_must_not_be_used(tmp_path: Path) -> None:
    found = faults(tmp_path, Wrong(tilt_deg=90.0))[0]
    # A quarter turn of the second joint turns its gravity all the same.
    assert (found.kind in ("mounting", "encoder_zero"), found.severity) == (True, "error")


@pytest.mark.parametrize(
    "late",
    [pytest.param(-40, marks=pytest.mark.long), pytest.param(25, marks=pytest.mark.long), 60],
)
def test_torques_of_another_clock_are_told_by_how_much(tmp_path: Path, late: int) -> None:
    found = faults(tmp_path, Wrong(late=late))[0]
    assert found.kind == "clock_offset"
    assert found.value == pytest.approx(late / RATE, abs=0.005)


def test_noise_is_no_offset_of_clocks(tmp_path: Path) -> None:
    """60 ms are 7.5 rows here: between two rows their noise averages out."""
    record = recording(Wrong(seed=1))
    noise = np.random.default_rng(1).normal(size=record.signals["effort"].shape)
    noisy = {**record.signals, "effort": record.signals["effort"] + 100 * NOISE * noise}
    assert findings_of(replace(record, signals=noisy), arm(tmp_path)) == ()


@pytest.mark.parametrize("late", [2, pytest.param(5, marks=pytest.mark.long)])
def test_a_common_delay_is_measured(tmp_path: Path, late: int) -> None:
    found = faults(tmp_path, Wrong(late=late, seconds=40.0))[0]
    assert (found.kind, found.joints) == ("delay", ())
    assert found.value == pytest.approx(late / RATE, abs=0.003)


@pytest.mark.parametrize(("share", "severity"), [(0.9, "info"), (0.0, "warning")])
def test_a_delay_that_the_model_takes_out_is_no_fault(
    tmp_path: Path, share: float, severity: str
) -> None:
    late = 5
    settings = ProcessingSettings(delays_s=(share * late / RATE,) * 6)
    found = diagnose([recording(Wrong(late=late, seconds=40.0))], arm(tmp_path), settings)
    assert {f.severity for f in found if f.kind == "delay" and f.value} == {severity}


def test_torques_of_one_joint_alone_do_not_lead(tmp_path: Path) -> None:
    record = recording(Wrong(seconds=40.0))
    effort = record.signals["effort"].copy()
    effort[:-5, 1] = effort[5:, 1]
    early = replace(record, signals={**record.signals, "effort": effort})
    assert ("delay", (1,)) not in {(f.kind, f.joints) for f in findings_of(early, arm(tmp_path))}


@pytest.mark.long
def test_exchanged_joints_are_named(tmp_path: Path) -> None:
    found = faults(tmp_path, Wrong(exchanged=True))[0]
    assert (found.kind, found.joints) == ("exchanged", (1, 2))


@pytest.mark.parametrize("share", [0.4, pytest.param(-0.4, marks=pytest.mark.long)])
def test_friction_that_drifts_is_told_with_its_sign(tmp_path: Path, share: float) -> None:
    found = faults(tmp_path, Wrong(warming=share, seconds=40.0))[0]
    assert found.kind == "friction_drift"
    # Only the viscous part of the friction drifts here.
    assert 0.2 * abs(share) < -np.sign(share) * (found.value or 0.0) < abs(share)


@pytest.mark.parametrize(
    ("stop", "carried"),
    [(6.4, 0.0), *(pytest.param(*few, marks=pytest.mark.long) for few in ((7.0, 0.0), (6.4, 2.0)))],
)
def test_a_push_is_found_where_it_was(tmp_path: Path, stop: float, carried: float) -> None:
    """Also of an arm that carries what the robot file does not know."""
    every = faults(tmp_path, Wrong(push=60.0, push_stop=stop, carried=carried))
    (found,) = [f for f in every if f.kind == "contact"]
    assert found.value == pytest.approx(6.0, abs=EARLY_OR_LATE_S)
    assert len(found.joints) > 1


@pytest.mark.parametrize(("repetitions", "found"), [((0, 1, 2), 0), ((1,), 1)])
def test_what_each_repetition_shows_is_no_contact(
    tmp_path: Path, repetitions: tuple[int, ...], found: int
) -> None:
    """Processing cuts the ends of a recording: the last repetition is incomplete."""
    period, rows = 8.0, round(3 * 8.0 * RATE) - 20
    t = np.arange(rows) / RATE
    dq = np.sin(2 * np.pi * np.outer(t, [1, 2, 3]) / period) * [0.5, 1.0, 1.5]
    error = 0.1 * np.random.default_rng(0).normal(size=dq.shape)
    for k in repetitions:
        error[round((k * period + 0.4) * RATE) :][: round(0.3 * RATE), 1] += 3.0
    contacts = contact_stretches(arm(tmp_path), t, dq, error, np.ones(3))
    assert len(contacts) == found


def test_torques_are_as_unsure_as_parameters_leave_them(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    samples = process(recording(Wrong()), robot)
    names = ("t", "q", "dq", "ddq", "friction_q", "tau")
    parts = {name: np.array(getattr(samples, name)) for name in names}
    ref = explain(Recording(robot=robot, block=1, **parts)).reference
    generator, ratios = np.random.default_rng(0), []
    turned = ref.columns / NOISE[:, None]
    matrix = np.tensordot(turned, turned, axes=((1, 2), (1, 2))) + ref.precision
    spread = np.linalg.cholesky(np.linalg.inv(ref.precision))
    for _ in range(12):
        truth = ref.mean + spread @ generator.normal(size=len(ref.mean))
        noise = NOISE[:, None] * generator.normal(size=ref.torque.shape)
        now = replace(ref, torque=np.tensordot(truth, ref.columns, axes=1) + noise)
        right = np.tensordot(turned, now.torque / NOISE[:, None], axes=((1, 2), (0, 1)))
        values = np.linalg.solve(matrix, right + ref.precision @ ref.mean)
        error = np.tensordot(values - truth, ref.columns, axes=1).T
        ratios.append(error / torque_deviations(now, values)[: len(error)])
    assert 0.7 < np.sqrt(np.square(ratios).mean()) < 1.2


@pytest.mark.parametrize(
    ("wrong", "kind", "size"),
    [
        (Wrong(carried=4.0, scales=(1.0, 1.2, 1.0)), "drive_gain", 1.2),
        (Wrong(carried=4.0, tilt_deg=2.0), "mounting", np.radians(2.0)),
        (Wrong(carried=4.0, coupled=0.5), "coupled_friction", 0.5),
    ],
)
def test_a_fault_beside_a_payload_has_its_own_size(
    tmp_path: Path, wrong: Wrong, kind: str, size: float
) -> None:
    found = {finding.kind: finding for finding in faults(tmp_path, wrong)}
    assert set(found) == {"payload", kind}
    assert found[kind].value == pytest.approx(size, rel=0.02)


@pytest.mark.parametrize(("systematic", "noise"), [(0.0, 1.0), (0.5, 1.0), (1.0, 0.3)])
def test_repetitions_average_noise_alone(systematic: float, noise: float) -> None:
    """What a model leaves in each repetition of a motion is not new evidence in the next."""
    period, repetitions, generator = 150, 10, np.random.default_rng(0)
    angle = 2 * np.pi * np.arange(period * repetitions) / period
    column, sizes, variances = np.sin(angle) + np.cos(3 * angle), [], []
    for _ in range(300):
        error = np.tile(systematic * generator.normal(size=period), repetitions)
        error += noise * generator.normal(size=error.shape)
        sizes.append(column @ error / (column @ column))
        length = correlation_length(error[None], period)[0]
        variances.append(np.square(error).mean() * length / (column @ column))
    assert np.mean(np.square(sizes)) == pytest.approx(np.mean(variances), rel=0.35)


@pytest.mark.parametrize(
    ("scale", "carried"),
    [
        (0.03, 2.0),
        pytest.param(1.0, 2.0, marks=pytest.mark.long),
        pytest.param(1.0, 4.0, marks=pytest.mark.long),
    ],
)
def test_an_unknown_payload_is_weighed(tmp_path: Path, scale: float, carried: float) -> None:
    """As well on an arm of 0.4 kg as on one of 13 kg; a large one is not taken for less."""
    robot, record = arm(tmp_path), recording(Wrong(carried=carried))
    light = replace(record, signals={**record.signals, "effort": scale * record.signals["effort"]})
    found = findings_of(light, replace(robot, inertias=scale * robot.inertias))[0]
    assert found.kind == "payload"
    assert found.value == pytest.approx(carried * scale, abs=FEW_SIGMAS * (found.std or 0.0))


def test_a_tool_that_the_robot_file_gives_is_no_unknown_payload(tmp_path: Path) -> None:
    arm(tmp_path)
    file, record = tmp_path / "arm.toml", recording(Wrong(carried=2.0))
    file.write_text('urdf = "arm.urdf"\n')
    named = [item for item in identify([record], file).warnings if item.kind == "payload"]
    assert ["[tool]" in item.next_step for item in named] == [True]
    file.write_text('urdf = "arm.urdf"\n[tool]\nmass = 2.0\ncom = [0.25, 0.02, 0.0]\n')
    found = identify([record], file)
    assert not [item for item in found.warnings if item.kind in ("payload", "gain_all")]
    # The published last link is that with the tool, once.
    published = found.estimate.model.robot
    assert published.inertias[-1, 0] == load_robot(file).inertias[-1, 0] + 2.0
    assert published.tool.mass == 0.0


def test_sizes_are_said_in_words_and_units(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    for kind, value, std, words in (
        ("link_length", -3e-5, 1e-5, "0.0 +- 0.0 mm shorter"),
        ("link_length", 0.0123, 0.002, "12.3 +- 2.0 mm longer"),
        ("payload", -3e-5, 1e-5, "3e-05 +- 1e-05 kg less"),
        ("payload", 0.5, 0.1, "0.5 +- 0.1 kg more"),
        ("delay", 0.008, 5e-4, "8.0 +- 0.5 ms late"),
        ("mounting", np.pi / 90, np.pi / 900, "2.00 +- 0.20 deg off"),
        ("friction_drift", -0.25, 0.05, "-25 +- 5 % along"),
        ("drive_gain", 0.1, 0.02, "1.1 +- 0.02 times"),
    ):
        item = Explanation(kind=kind, joints=(2,), value=value, std=std, unit="m", score=9.0)
        assert words in finding_of(item, robot, robot).text


@pytest.mark.parametrize("share", [0.4, pytest.param(0.6, marks=pytest.mark.long)])
def test_a_torque_that_stops_is_no_other_fault(tmp_path: Path, share: float) -> None:
    record = recording(Wrong())
    effort = record.signals["effort"].copy()
    top = share * np.abs(effort[:, 1]).max()
    effort[:, 1] = np.clip(effort[:, 1], -top, top)
    stopped = replace(record, signals={**record.signals, "effort": effort})
    found = [(f.kind, f.joints) for f in findings_of(stopped, arm(tmp_path))]
    assert found == [("saturated", (1,))]


def test_a_noisy_torque_that_stops_at_the_known_limit_is_told(tmp_path: Path) -> None:
    record, robot = recording(Wrong()), arm(tmp_path)
    clean = record.signals["effort"]
    top = 0.6 * np.abs(clean[:, 1]).max()
    limits = np.where(np.arange(robot.joints) == 1, top, robot.limits.torque)
    robot = replace(robot, limits=replace(robot.limits, torque=limits))
    effort = clean.copy()
    noise = np.random.default_rng(0).normal(0.0, 0.003 * top, len(effort))
    effort[:, 1] = np.clip(effort[:, 1], -top, top) + noise
    for values, told in ((effort, True), (0.99 * clean, False), (0.6 * clean, False)):
        seen = replace(record, signals={**record.signals, "effort": values})
        found = [(f.kind, f.joints) for f in findings_of(seen, robot)]
        assert (("saturated", (1,)) in found) == told


def test_a_torque_of_zero_is_no_number_that_cannot_be(tmp_path: Path) -> None:
    record = recording(Wrong())
    effort = record.signals["effort"].copy()
    effort[:, 0] = 0.0
    dead = replace(record, signals={**record.signals, "effort": effort})
    found = findings_of(dead, arm(tmp_path))
    assert found
    assert all(np.isfinite(f.value) for f in found if f.value is not None)


@pytest.mark.parametrize(("factor", "said"), [(1e155, "which no arm does"), (0.0, "same on every")])
def test_torques_that_cannot_be_are_refused(tmp_path: Path, factor: float, said: str) -> None:
    """1e155 N.m were a LinAlgError, and of zeros the richest model left inf %."""
    record = recording(Wrong())
    signals = {**record.signals, "effort": factor * record.signals["effort"]}
    with pytest.raises(RecordError, match=said):
        findings_of(replace(record, signals=signals), arm(tmp_path))


def test_of_torques_that_are_zero_in_a_window_nothing_is_unexplained(tmp_path: Path) -> None:
    record = recording(Wrong())
    off = record.t < record.t[0] + 6.0
    effort = np.where(off[:, None], 0.0, record.signals["effort"])
    dead = replace(record, signals={**record.signals, "effort": effort})
    found = diagnose([dead], arm(tmp_path), ProcessingSettings(stop_s=6.0))
    assert "unexplained" not in {f.kind for f in found}


def test_two_faults_are_told_apart(tmp_path: Path) -> None:
    found = faults(tmp_path, Wrong(scales=(1.0, 1.2, 1.0), tilt_deg=3.0, seconds=40.0))
    assert {f.kind for f in found[:2]} == {"drive_gain", "mounting"}


@pytest.mark.parametrize("scale", [1.0, 0.97])
def test_rows_that_are_lost_are_no_other_clock(tmp_path: Path, scale: float) -> None:
    """Velocities that were integrated across a gap had not gone as far as the joints had."""
    whole = recording(Wrong())
    at_hand = (whole.t < 4.0) | (whole.t > 4.5)
    signals = {name: values[at_hand] for name, values in whole.signals.items()}
    signals["qd"] = scale * np.gradient(whole.signals["q"], whole.t, axis=0)[at_hand]
    found = findings_of(ExperimentRecord(t=whole.t[at_hand], signals=signals), arm(tmp_path))
    told = [finding.value for finding in found if finding.kind == "clock_scale"]
    assert told == pytest.approx([scale] if scale != 1.0 else [], rel=CLOCK_WITHIN)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("scale", [1.0, 1.03])
def test_velocities_that_were_filtered_are_no_other_clock(
    tmp_path: Path, order: int, scale: float
) -> None:
    """In phase with the positions they are 0.99 times as large."""
    record = recording(Wrong())
    low, over = butter(order, 2.0, fs=RATE)
    filtered = scale * lfilter(low, over, np.gradient(record.signals["q"], record.t, axis=0), 0)
    seen = replace(record, signals={**record.signals, "qd": filtered})
    told = [f.value for f in findings_of(seen, arm(tmp_path)) if f.kind == "clock_scale"]
    assert told == pytest.approx([scale] if scale != 1.0 else [], rel=CLOCK_WITHIN)


def test_for_many_joints_it_is_said_that_nothing_was_looked_for(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{k}"/>' for k in range(14))
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for k in range(13)
    )
    path = tmp_path / "long.urdf"
    path.write_text(f'<robot name="long">{links}{joints}</robot>')
    (found,) = diagnose([], load_robot(path), ProcessingSettings())
    assert (found.kind, found.severity, found.value) == ("not_diagnosed", "info", 13)
