"""Friction by load and torque ripple in generated files, against formulas written out here."""

import inspect
import runpy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from known_exports import (
    WIDE_TERMS,
    States,
    estimate_of,
    heavy_arm,
    load_bodies,
    mixed_chain,
    parameters_of,
    pinocchio_chain,
    random_motion,
    with_load,
    with_ripple,
)

from dynid.core import Array, JobError
from dynid.export import ExportModel, write_model, writing
from dynid.export.verification import c_compiler, c_torque
from dynid.identification import Estimate
from dynid.regressor import FrictionTerms, InverseDynamicModel, LoadFriction, parse_terms
from dynid.robot import RobotModel, load_robot, robot_from_chain

# The asked agreement of torques [N.m or N], for torques up to a few hundred.
EXACT = 1e-9
TX40 = Path(__file__).parents[2] / "examples" / "robots" / "tx40.toml"
PAPER = parse_terms("fc,fv,im", width=0.02)


def robot_called(name: str) -> RobotModel:
    match name:
        case "sliding":
            return mixed_chain()
        case "counterbalanced":
            return heavy_arm()
        case "tx40":
            return load_robot(str(TX40))
        case _:
            return load_robot(name)


def shaped(robot: RobotModel, terms: FrictionTerms = WIDE_TERMS, seed: int = 0) -> Estimate:
    whole = with_ripple(with_load(terms, robot.joints, seed), robot.joints, seed)
    return estimate_of(robot, parameters_of(robot, seed, whole), whole)


ROBOTS = ("ur10", "sliding", "tx40", "counterbalanced")


@pytest.mark.parametrize("to", ["json", "c", "python"])
@pytest.mark.parametrize("name", ROBOTS)
def test_code_has_our_torques(name: str, to: str, tmp_path: Path) -> None:
    done = write_model(shaped(robot_called(name)), tmp_path / "model", to)
    # The torques compared are of the size of an arm's: nothing else would be proof.
    assert done.verified.tolerance < 100 * EXACT
    assert done.verified.max_torque_difference is not None
    assert done.verified.max_torque_difference < EXACT
    assert done.left_out == ()


def formula(
    robot: RobotModel, terms: FrictionTerms, parameters: Array, states: States, seed: int
) -> Array:
    """(N, n) friction by load and ripple, the load by pinocchio."""
    assert terms.load is not None
    # Pinocchio divides by masses; torques are linear in bodies that it takes.
    more, less = (pinocchio_chain(robot, bodies) for bodies in load_bodies(robot.joints, seed))
    data, others = more.createData(), less.createData()
    shares = parameters[-(len(terms.load.joints) + len(terms.ripples)) :]
    torque = np.zeros(states.q.shape)
    for k, (q, dq, ddq) in enumerate(zip(states.q, states.dq, states.ddq, strict=True)):
        load = pin.rnea(more, data, q, dq, ddq) - pin.rnea(less, others, q, dq, ddq)
        for spring in robot.counterbalances:
            load[spring.joint] -= spring.torque(q[spring.joint])
        for share, j in zip(shares, terms.load.joints, strict=False):
            torque[k, j] += share * abs(load[j]) * np.tanh(dq[j] / 0.02)
        for share, ripple in zip(shares[len(terms.load.joints) :], terms.ripples, strict=True):
            left = iter(ripple.coefficients)
            for gear in ripple.gears:
                s = min(1.0, max(-1.0, dq[gear.joint] / gear.speed))
                for wave in gear.waves:
                    for power in range(gear.powers):
                        for turn in (np.cos, np.sin):
                            part = next(left) * s**power * turn(wave * q[gear.joint])
                            torque[k, ripple.joint] += share * part
    return torque


@pytest.mark.parametrize("seed", [0, 7])
@pytest.mark.parametrize("name", ROBOTS)
def test_parts_of_python_are_their_formulas_and_add_up(
    name: str, seed: int, tmp_path: Path
) -> None:
    robot = robot_called(name)
    terms = with_ripple(with_load(PAPER, robot.joints, seed), robot.joints, seed)
    parameters = parameters_of(robot, seed, terms)
    write_model(estimate_of(robot, parameters, terms), tmp_path / "arm.py", "python")
    arm = runpy.run_path(str(tmp_path / "arm.py"))
    states = random_motion(robot, 30)
    q, dq, ddq = states.q, states.dq, states.ddq
    friction = arm["friction"](q, dq, ddq)
    shape = friction - arm["speed_friction"](dq)
    np.testing.assert_allclose(
        shape, formula(robot, terms, parameters, states, seed), rtol=0, atol=EXACT
    )
    np.testing.assert_allclose(
        shape, arm["load_friction"](q, dq, ddq) + arm["ripple"](q, dq), rtol=0, atol=EXACT
    )
    mass = np.einsum("kij,kj->ki", arm["mass_matrix"](q), ddq)
    whole = mass + arm["coriolis"](q, dq) + arm["gravity"](q) + friction
    np.testing.assert_allclose(arm["inverse_dynamics"](q, dq, ddq), whole, rtol=0, atol=EXACT)
    model = InverseDynamicModel(robot=robot, friction=terms)
    truth = model.inverse_dynamics(q, dq, ddq, parameters) - model.known_torque(q)
    np.testing.assert_allclose(whole, truth, rtol=0, atol=EXACT)
    one = arm["friction"](q[3].tolist(), dq[3].tolist(), ddq[3].tolist())
    np.testing.assert_allclose(one, friction[3], rtol=0, atol=EXACT)


_WHOLE = """
#define PART_JOINTS UR5_JOINTS
static void part_inverse_dynamics(const double *q, const double *dq, const double *ddq, double *x)
{
    double mass[6][6], other[6];
    int i, j;
    ur5_friction(q, dq, ddq, x);
    if (PART == 0) return;
    ur5_coriolis(q, dq, other);
    for (i = 0; i < 6; ++i) x[i] += other[i];
    ur5_gravity(q, other);
    for (i = 0; i < 6; ++i) x[i] += other[i];
    ur5_mass_matrix(q, mass);
    for (i = 0; i < 6; ++i)
        for (j = 0; j < 6; ++j) x[i] += mass[i][j] * ddq[j];
}
"""


@pytest.mark.skipif(c_compiler() is None, reason="no C compiler")
def test_parts_of_c_are_those_of_python_and_add_up(tmp_path: Path) -> None:
    estimate = shaped(heavy_arm())
    write_model(estimate, tmp_path / "arm.h", "c")
    write_model(estimate, tmp_path / "arm.py", "python")
    arm = runpy.run_path(str(tmp_path / "arm.py"))
    states = random_motion(heavy_arm())
    text = (tmp_path / "arm.h").read_text()
    assert "alloc" not in text.replace("no allocation", "")
    given = (states.q, states.dq, states.ddq)
    for part, expected in enumerate((arm["friction"](*given), arm["inverse_dynamics"](*given))):
        (tmp_path / "part.h").write_text(f"{text}\n#define PART {part}\n{_WHOLE}")
        got, _ = c_torque(tmp_path / "part.h", "part", states)
        np.testing.assert_allclose(got, expected, rtol=0, atol=EXACT)


@pytest.mark.parametrize(
    ("load", "ripple", "arguments", "functions"),
    [
        (False, False, ["dq"], set[str]()),
        (True, False, ["q", "dq", "ddq"], {"speed_friction", "load_friction"}),
        (False, True, ["q", "dq", "ddq"], {"speed_friction", "ripple"}),
        (True, True, ["q", "dq", "ddq"], {"speed_friction", "load_friction", "ripple"}),
    ],
)
def test_what_friction_takes(
    load: bool, ripple: bool, arguments: list[str], functions: set[str], tmp_path: Path
) -> None:
    robot, terms = load_robot("ur5"), PAPER
    terms = with_load(terms, 6) if load else terms
    terms = with_ripple(terms, 6) if ripple else terms
    estimate = estimate_of(robot, parameters_of(robot, 0, terms), terms)
    for to in ("c", "python"):
        assert write_model(estimate, tmp_path / to, to).verified.passed
    header, code = (tmp_path / "c").read_text(), (tmp_path / "python").read_text()
    arm: dict[str, Any] = runpy.run_path(str(tmp_path / "python"))
    assert list(inspect.signature(arm["friction"]).parameters) == arguments
    assert {"speed_friction", "load_friction", "ripple"} & set(arm) == functions
    for text in (header, code):
        assert ("No acceleration is known here" in text) == (load or ripple)
        assert f"+ friction({', '.join(arguments)})" in text
        assert ("Friction that grows with load, joints 2, 3, 4, 5, 6:" in text) == load
        assert ("Torque ripple of gears, joints 1, 6:" in text) == ripple
    assert ("ur5_load[" in header) == load
    assert ("ur5_add_ripple" in header) == ripple


@pytest.mark.long
def test_wrong_shapes_leave_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = dict(writing._FORMATS)
    estimate = shaped(load_robot("ur10"))

    def heavier(model: ExportModel) -> ExportModel:
        assert model.load is not None
        return replace(model, load=model.load + 1e-6)

    def shaken(model: ExportModel) -> ExportModel:
        first = model.ripples[0]
        moved = replace(first, coefficients=(first.coefficients[0] + 1e-6, *first.coefficients[1:]))
        return replace(model, ripples=(moved, *model.ripples[1:]))

    for spoiled in (heavier, shaken):
        for to in ("json", "c", "python"):
            text = partial(lambda model, note, make, kind: kind.text(make(model), note),
                           make=spoiled, kind=real[to])  # fmt: skip
            monkeypatch.setitem(writing._FORMATS, to, replace(real[to], text=text))
            with pytest.raises(JobError, match="torques differ"):
                write_model(estimate, tmp_path / "arm", to)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("to", ["urdf", "mjcf"])
@pytest.mark.parametrize("name", ["ur10", "sliding", "tx40"])
def test_robot_files_say_that_they_have_neither(name: str, to: str, tmp_path: Path) -> None:
    done = write_model(shaped(robot_called(name)), tmp_path / "arm", to)
    assert done.verified.passed
    words = {"friction that grows with load", "torque ripple of gears", "cube-root friction"}
    assert words <= set(done.left_out)
    text = (tmp_path / "arm").read_text()
    assert all(word in text for word in words)
    assert "nearest to all friction that was identified" in text


def test_mjcf_has_the_friction_of_urdf(tmp_path: Path) -> None:
    estimate = shaped(load_robot("ur10"))
    done = write_model(estimate, tmp_path / "arm.xml", "mjcf")
    other = write_model(estimate, tmp_path / "arm.urdf", "urdf")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    assert done.friction is not None
    assert other.friction is not None
    assert done.friction.stands_in
    np.testing.assert_allclose(model.dof_frictionloss, done.friction.coulomb, rtol=1e-9)
    np.testing.assert_allclose(model.dof_damping.ravel(), other.friction.viscous, rtol=1e-9)


def lift() -> RobotModel:
    """One joint that slides up: its gear carries the same weight everywhere."""
    return robot_from_chain(
        placements=np.eye(4)[None], axes=np.array([[0.0, 0.0, 1.0]]), joint_types=["prismatic"]
    )


def lift_estimate(cube_root: float = 0.0) -> Estimate:
    """Fc 3, Fv 5 and a share of 0.1 of the weight of 20 kg, moved without acceleration."""
    load = LoadFriction(joints=(0,), parameters=(20.0, *([0.0] * 9)))
    terms = replace(parse_terms("fc,fv,im,fr", width=0.0), load=load)
    parameters = np.concatenate([[12.0], np.zeros(3), np.full(3, 0.1), np.zeros(3)])
    friction = [3.0, 5.0, 0.4, cube_root, 0.1]
    estimate = estimate_of(lift(), np.concatenate([parameters, friction]), terms)
    return replace(estimate, motion=replace(estimate.motion, acceleration=np.zeros(1)))


def test_dry_friction_of_robot_files_holds_that_of_a_constant_load(tmp_path: Path) -> None:
    """Coulomb friction 3 N and a tenth of 196 N: alone, the 3 N would be far too little."""
    weight = 20.0 * float(np.linalg.norm(lift().gravity))
    done = write_model(lift_estimate(), tmp_path / "arm.urdf", "urdf")
    loaded = pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    assert loaded.friction[0] == pytest.approx(3.0 + 0.1 * weight, rel=1e-6)
    assert loaded.damping[0] == pytest.approx(5.0, rel=1e-6)
    assert done.friction is not None
    assert done.friction.missing[0] < EXACT * weight


def test_robot_files_have_the_nearest_friction(tmp_path: Path) -> None:
    """No other pair is nearer to it, and what is left is what it says."""
    estimate = lift_estimate(cube_root=-4.0)
    done = write_model(estimate, tmp_path / "arm.urdf", "urdf")
    assert done.friction is not None
    coulomb, viscous = float(done.friction.coulomb[0]), float(done.friction.viscous[0])
    speed = np.linspace(-1.0, 1.0, 4001) * float(estimate.motion.speed[0])
    weight = 20.0 * float(np.linalg.norm(lift().gravity))
    known = (3.0 + 0.1 * weight) * np.sign(speed) + 5.0 * speed - 4.0 * np.cbrt(speed)

    def left(change: tuple[float, float]) -> float:
        own = (coulomb + change[0]) * np.sign(speed) + (viscous + change[1]) * speed
        return float(np.sqrt(np.mean(np.square(known - own))))

    assert done.friction.missing[0] == pytest.approx(left((0.0, 0.0)), rel=0.05)
    assert done.friction.missing[0] > 0.05
    for change in ((0.2, 0.0), (-0.2, 0.0), (0.0, 0.3), (0.0, -0.3)):
        assert left(change) > left((0.0, 0.0))


def test_friction_of_speed_alone_is_written_as_identified(tmp_path: Path) -> None:
    terms = parse_terms("fc,fv,im,fo", width=0.001)
    robot = load_robot("ur5")
    parameters = parameters_of(robot, 0, terms)
    done = write_model(estimate_of(robot, parameters, terms), tmp_path / "arm.urdf", "urdf")
    loaded = pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    np.testing.assert_allclose(loaded.friction, parameters[60:66], rtol=1e-9)
    assert done.friction is not None
    assert not done.friction.stands_in
    np.testing.assert_allclose(done.friction.missing, parameters[-6:], rtol=1e-9)


def test_a_wide_step_is_not_taken_for_a_sign(tmp_path: Path) -> None:
    terms = parse_terms("fc,fv,im", width=0.5)
    robot = load_robot("ur5")
    parameters = parameters_of(robot, 0, terms)
    estimate = estimate_of(robot, parameters, terms)
    done = write_model(estimate, tmp_path / "arm.xml", "mjcf")
    assert done.friction is not None
    assert done.friction.stands_in
    speed = np.linspace(-1, 1, 501)[:, None] * estimate.motion.speed
    smooth = parameters[60:66] * np.tanh(speed / 0.5)
    ours, as_identified = (
        np.square(value * np.sign(speed) + slope * speed - smooth).mean(axis=0)
        for value, slope in (
            (done.friction.coulomb, done.friction.viscous - parameters[66:72]),
            (parameters[60:66], 0.0),
        )
    )
    assert (ours < as_identified).all()
    assert done.left_out_rms == pytest.approx(np.sqrt(ours), rel=0.1)
    assert done.left_out == ("the width of the Coulomb step",)
    # A joint that stood shows no shape: it keeps what was identified, and so do all others.
    slow = replace(estimate.motion, speed=np.where(np.arange(6) == 2, 2e-4, 100.0))
    done = write_model(replace(estimate, motion=slow), tmp_path / "slow.xml", "mjcf")
    assert done.friction is not None
    assert not done.friction.stands_in
    np.testing.assert_array_equal(done.friction.coulomb, parameters[60:66])


def test_what_a_urdf_leaves_out_is_told_in_size(tmp_path: Path) -> None:
    robot = load_robot("ur5")
    parameters = parameters_of(robot, 0)
    estimate = estimate_of(robot, parameters)
    urdf, code = (write_model(estimate, tmp_path / f"arm.{to}", to) for to in ("urdf", "python"))
    motors = urdf.model.terms["Im"] * estimate.motion.acceleration / np.sqrt(3.0)
    assert urdf.left_out_rms == pytest.approx(motors, rel=0.05)
    assert code.left_out_rms.max() < EXACT
