import runpy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from known_exports import (
    EVERY_TERM,
    estimate_of,
    heavy_arm,
    mixed_chain,
    parameters_of,
    pinocchio_chain,
    random_motion,
)

from dynid.core import InputError, JobError
from dynid.export import ExportModel, write_model, writing
from dynid.export import verification as load_code
from dynid.export.verification import c_torque
from dynid.export.writing import FORMATS
from dynid.identification import Estimate
from dynid.robot import RobotModel, load_robot

# The asked agreement of torques [N.m or N].
EXACT, MUJOCO = 1e-9, 1e-6
Text = Callable[[ExportModel, str], str]
ROBOTS = {"ur5": load_robot("ur5"), "tilted": load_robot("ur3e", mount="tilt:30")}


def truth(robot: RobotModel, seed: int = 0) -> Estimate:
    return estimate_of(robot, parameters_of(robot, seed))


@pytest.mark.parametrize("to", FORMATS)
@pytest.mark.parametrize("name", [*ROBOTS, "mixed"])
def test_other_programs_give_our_torques(name: str, to: str, tmp_path: Path) -> None:
    robot = mixed_chain() if name == "mixed" else ROBOTS[name]
    done = write_model(truth(robot), tmp_path / "model", to)
    assert done.verified.passed
    assert done.verified.max_torque_difference is not None
    assert done.verified.max_torque_difference < (MUJOCO if to == "mjcf" else EXACT)
    assert done.model.physical
    assert [path.name for path in tmp_path.iterdir()] == ["model"]


@pytest.mark.parametrize("to", ["urdf", "mjcf"])
def test_joints_named_as_our_own_or_alike_in_print(to: str, tmp_path: Path) -> None:
    names = ("mounting", "flange_fixed", "a\u200b", "a\u200c")
    done = write_model(truth(replace(mixed_chain(), joint_names=names)), tmp_path / "model", to)
    assert done.verified.passed


@pytest.mark.parametrize("to", ["json", "c", "python"])
@pytest.mark.parametrize("name", ["ur5", "heavy", "mixed"])
def test_code_holds_every_term(name: str, to: str, tmp_path: Path) -> None:
    robot = {"ur5": ROBOTS["ur5"], "heavy": heavy_arm(), "mixed": mixed_chain()}[name]
    estimate = estimate_of(robot, parameters_of(robot, 1, EVERY_TERM), EVERY_TERM)
    done = write_model(estimate, tmp_path / "model", to)
    assert done.verified.max_torque_difference is not None
    assert done.verified.max_torque_difference < EXACT
    assert done.left_out == ()


@pytest.mark.parametrize("to", ["json", "c", "python"])
def test_a_width_a_joint_and_signs(to: str, tmp_path: Path) -> None:
    robot = ROBOTS["ur5"]
    for width in (0.0, (0.0, 0.1, 0.01, 0.001, 0.5, 0.0)):
        terms = replace(EVERY_TERM, width=width)
        estimate = estimate_of(robot, parameters_of(robot, 2, terms), terms)
        done = write_model(estimate, tmp_path / "model", to)
        assert done.verified.passed


def test_urdf_by_pinocchio_from_its_own_numbers(tmp_path: Path) -> None:
    """The rigid part against pinocchio's model of the truth, not against our regressor."""
    for robot in (ROBOTS["tilted"], mixed_chain()):
        parameters = parameters_of(robot, 3)
        write_model(estimate_of(robot, parameters), tmp_path / "arm.urdf", "urdf")
        loaded = pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
        known = pinocchio_chain(robot, parameters)
        loaded.gravity.linear = np.array([0.0, 0.0, -float(np.linalg.norm(robot.gravity))])
        # Motor inertias that only stand in sum with a link's are in the links or beside them.
        n = robot.joints
        motor = parameters[12 * n : 13 * n]
        known.armature = motor
        loaded.armature = _armature(tmp_path / "arm.urdf", n)
        assert list(loaded.names)[1:] == list(robot.joint_names)
        np.testing.assert_allclose(loaded.damping, parameters[11 * n : 12 * n], rtol=1e-9)
        np.testing.assert_allclose(loaded.friction, parameters[10 * n : 11 * n])
        states = random_motion(robot)
        for q, dq, ddq in zip(states.q[:20], states.dq[:20], states.ddq[:20], strict=True):
            theirs = pin.rnea(loaded, loaded.createData(), q, dq, ddq)
            ours = pin.rnea(known, known.createData(), q, dq, ddq)
            np.testing.assert_allclose(theirs, ours, rtol=0, atol=EXACT)


def _armature(path: Path, joints: int) -> np.ndarray:
    line = next(x for x in path.read_text().splitlines() if "Motor inertias, joint side" in x)
    values = np.array(line.split("by joint:")[1].rstrip(" .").split(), dtype=float)
    assert len(values) == joints
    return values


def test_mjcf_fields(tmp_path: Path) -> None:
    robot, n = ROBOTS["ur5"], 6
    parameters = parameters_of(robot, 4)
    write_model(estimate_of(robot, parameters), tmp_path / "arm.xml", "mjcf")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    np.testing.assert_allclose(model.dof_frictionloss, parameters[10 * n : 11 * n], rtol=1e-9)
    np.testing.assert_allclose(model.dof_damping.ravel(), parameters[11 * n : 12 * n], rtol=1e-9)
    np.testing.assert_allclose(model.dof_armature[2:], parameters[12 * n + 2 :], rtol=1e-9)
    np.testing.assert_allclose(model.opt.gravity, robot.gravity)
    np.testing.assert_allclose(model.jnt_range[:, 0], robot.limits.lower)
    assert [model.joint(k).name for k in range(n)] == list(robot.joint_names)


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, object], pin.Model]:
    robot = mixed_chain()
    parameters = parameters_of(robot, 6)
    path = tmp_path_factory.mktemp("python") / "arm.py"
    write_model(estimate_of(robot, parameters), path, "python")
    known = pinocchio_chain(robot, parameters)
    known.armature = parameters[-robot.joints :]
    return runpy.run_path(str(path)), known


def test_python_parts_apart(generated: tuple[dict, pin.Model]) -> None:  # type: ignore[type-arg]
    arm, known = generated
    data = known.createData()
    states = random_motion(mixed_chain())
    for q, dq, ddq in zip(states.q[:10], states.dq[:10], states.ddq[:10], strict=True):
        mass = pin.crba(known, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        weight = pin.computeGeneralizedGravity(known, data, q).copy()
        bias = pin.nonLinearEffects(known, data, q, dq) - weight
        np.testing.assert_allclose(arm["mass_matrix"](q), mass, rtol=0, atol=EXACT)
        np.testing.assert_allclose(arm["gravity"](q), weight, rtol=0, atol=EXACT)
        np.testing.assert_allclose(arm["coriolis"](q, dq), bias, rtol=0, atol=EXACT)
        whole = mass @ ddq + bias + weight + arm["friction"](dq)
        np.testing.assert_allclose(arm["inverse_dynamics"](q, dq, ddq), whole, rtol=0, atol=EXACT)
        coriolis = pin.computeCoriolisMatrix(known, data, q, dq)
        own, slope = arm["momentum"](q, dq)
        np.testing.assert_allclose(own, mass @ dq, rtol=0, atol=EXACT)
        np.testing.assert_allclose(slope, coriolis.T @ dq, rtol=0, atol=EXACT)


def test_python_takes_one_state_or_many(generated: tuple[dict, pin.Model]) -> None:  # type: ignore[type-arg]
    arm, _ = generated
    states = random_motion(mixed_chain())
    many = arm["inverse_dynamics"](states.q, states.dq, states.ddq)
    one = arm["inverse_dynamics"](*(x[7].tolist() for x in (states.q, states.dq, states.ddq)))
    np.testing.assert_allclose(many[7], one, rtol=0, atol=EXACT)
    assert arm["mass_matrix"](states.q).shape == (200, 4, 4)


@pytest.mark.long
def test_c_parts_apart(tmp_path: Path) -> None:
    """The other functions of the header, called by a program of our own."""
    robot = heavy_arm()
    estimate = estimate_of(robot, parameters_of(robot, 1, EVERY_TERM), EVERY_TERM)
    write_model(estimate, tmp_path / "arm.h", "c")
    write_model(estimate, tmp_path / "arm.py", "python")
    arm = runpy.run_path(str(tmp_path / "arm.py"))
    states = random_motion(robot, 9)
    for number, expected in enumerate(
        [
            np.einsum("kij,kj->ki", arm["mass_matrix"](states.q), states.ddq),
            arm["coriolis"](states.q, states.dq),
            arm["gravity"](states.q),
            arm["friction"](states.dq),
            *arm["momentum"](states.q, states.dq),
        ]
    ):
        text = (tmp_path / "arm.h").read_text()
        (tmp_path / "part.h").write_text(f"{text}\n#define PART {number}\n{_PARTS}")
        got, _ = c_torque(tmp_path / "part.h", "part", states)
        np.testing.assert_allclose(got, expected, rtol=0, atol=EXACT)


_PARTS = """
#define PART_JOINTS UR5_JOINTS
static void part_inverse_dynamics(const double *q, const double *dq, const double *ddq, double *x)
{
    double mass[6][6], other[6];
    int i, j;
    ur5_mass_matrix(q, mass);
    ur5_momentum(q, dq, other, x);
    if (PART == 0)
        for (i = 0; i < 6; ++i) {
            x[i] = 0.0;
            for (j = 0; j < 6; ++j) x[i] += mass[i][j] * ddq[j];
        }
    if (PART == 1) ur5_coriolis(q, dq, x);
    if (PART == 2) ur5_gravity(q, x);
    if (PART == 3) ur5_friction(dq, x);
    if (PART == 4)
        for (i = 0; i < 6; ++i) x[i] = other[i];
}
"""


def test_what_a_format_cannot_hold_is_named(tmp_path: Path) -> None:
    robot = heavy_arm()
    estimate = estimate_of(robot, parameters_of(robot, 1, EVERY_TERM), EVERY_TERM)
    for to in ("urdf", "mjcf"):
        done = write_model(estimate, tmp_path / "arm", to)
        assert done.verified.passed
        assert {"torques of counterbalances", "cube-root friction", "Stribeck terms"} <= set(
            done.left_out
        )
        assert ("motor inertias" in done.left_out) == (to == "urdf")
        assert "cube-root friction" in (tmp_path / "arm").read_text()


def test_wrong_torques_leave_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, estimate = tmp_path / "arm", truth(ROBOTS["ur5"])
    for to, kind in writing._FORMATS.items():

        def spoiled(model: ExportModel, note: str, real: Text = kind.text) -> str:
            wrong = model.inertials.copy()
            wrong[2, 1] += 1e-6
            return real(replace(model, inertials=wrong), note)

        monkeypatch.setitem(writing._FORMATS, to, replace(kind, text=spoiled))
        with pytest.raises(JobError, match="torques differ"):
            write_model(estimate, path, to)
        assert list(tmp_path.iterdir()) == []


def test_without_another_program_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load_code, "c_compiler", lambda: None)
    done = write_model(truth(ROBOTS["ur5"]), tmp_path / "arm.h", "c")
    assert done.verified.max_torque_difference is None
    assert not done.verified.passed
    assert "compiler" in done.verified.loaded_with
    assert (tmp_path / "arm.h").exists()


def test_refuses_what_it_cannot_do(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown format"):
        write_model(truth(ROBOTS["ur5"]), tmp_path / "arm", "sdf")
    with pytest.raises(InputError, match="cannot be written"):
        write_model(truth(ROBOTS["ur5"]), tmp_path / "none" / "arm", "json")


def test_paths_may_be_text(tmp_path: Path) -> None:
    done = write_model(truth(ROBOTS["ur5"]), str(tmp_path / "arm.json"), "json")
    assert done.path == tmp_path / "arm.json"
    assert done.path.exists()
