import numpy as np
import pinocchio as pin
import pytest
from robot_oracles import EXAMPLES, SHARED, flange_pose, pinocchio_model
from urdf_samples import load_urdf

from dynid.robot import Counterbalance, joint_poses, load_robot, nominal_geometry

NAMES = ["gen3", "kr300", "panda", "tx40", "ur10_unisa"]
needs_recordings = pytest.mark.skipif(
    not SHARED.is_dir(), reason="recordings of ../shared/data are not here"
)


@pytest.mark.parametrize("name", NAMES)
def test_every_example_loads(name: str) -> None:
    robot = load_robot(EXAMPLES / f"{name}.toml")
    assert robot.name == name
    assert robot.source
    nominal = nominal_geometry(robot)
    assert nominal.joints == robot.joints
    # The URDF of the gen3 has 1.5708 and 3.1416.
    assert np.allclose(nominal.placements, robot.placements, atol=1e-9) == (name != "gen3")


@needs_recordings
@pytest.mark.parametrize(
    ("name", "urdf", "tip", "frames"),
    [
        ("tx40", "tx40/tx40_mdh_modified.urdf", "tool0", "urdf"),
        ("gen3", "kinova_gen3/gen3.urdf", "end_effector_link", "urdf"),
        ("panda", "panda_gaz/panda.urdf", "panda_link8", "mdh"),
        ("ur10_unisa", "ur10_unisa/ur10_robot.urdf", "tool0", None),
    ],
)
def test_kinematics_are_those_of_the_recordings(
    name: str, urdf: str, tip: str, frames: str | None
) -> None:
    robot = load_robot(EXAMPLES / f"{name}.toml")
    theirs = load_urdf(SHARED / urdf, tip=tip)
    assert robot.joint_names == theirs.joint_names
    q = np.random.default_rng(0).uniform(-3, 3, (5, robot.joints))
    np.testing.assert_allclose(flange_pose(robot, q), flange_pose(theirs, q), atol=1e-10)
    if frames is not None:
        ours = joint_poses(robot, q) @ robot.parameter_frames[frames]
        np.testing.assert_allclose(ours, joint_poses(theirs, q), atol=1e-10)


def test_tx40_transmission() -> None:
    drives = load_robot(EXAMPLES / "tx40.toml").drives
    q = np.array([0.1, 0.2, -0.3, 0.4, 0.5, -0.6])
    motor = drives.motor_from_joint @ (q - drives.offset)
    # The data's own recipe: q = N^-1 q_m, then q2 -= pi/2, q3 += pi/2.
    back = np.linalg.solve(drives.motor_from_joint, motor)
    back[1] -= np.pi / 2
    back[2] += np.pi / 2
    np.testing.assert_allclose(back, q)
    assert drives.motor_from_joint[5, 4] == 32.0
    assert (drives.position_side, drives.torque_side) == ("motor", "motor")


def test_kr300_stands_upright_under_gravity() -> None:
    robot = load_robot(EXAMPLES / "kr300.toml")
    np.testing.assert_allclose(robot.gravity, [0, 0, -9.80665])
    up = joint_poses(robot, np.zeros(6))
    np.testing.assert_allclose(up[2, :3, 3], [0.35, -0.189, 1.825], atol=1e-12)


def test_kr300_cylinder_relieves_the_motor() -> None:
    robot = load_robot(EXAMPLES / "kr300.toml")
    model = pinocchio_model(robot)
    # 500 kg at the elbow.
    model.appendBodyToJoint(3, pin.Inertia(500, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    spring = robot.counterbalances[0]
    assert robot.joint_names[spring.joint] == "A2"
    # The recorded angle of joint 2 counts from the upright arm.
    forward, still = np.array([0, np.pi / 2, 0, 0, 0, 0]), np.zeros(6)
    load = pin.rnea(model, model.createData(), forward, still, still)[1]
    share = spring.torque(forward[1:2])[0]
    # The motor carries load - share, which is less than half of the load here.
    assert load < -5000
    assert share < 0
    assert abs(load - share) < 0.6 * abs(load)
    # Arm straight up: no load and hardly any help.
    assert abs(spring.torque(np.array([np.radians(-5)]))[0]) < 1e-9


def test_a_cylinder_is_the_slope_of_its_gas_energy() -> None:
    spring = Counterbalance(
        joint=0, outer=0.8, inner=0.2, rest_length=0.6, offset=1.2, piston_area=0.0017,
        gas_work=15600.0, gas_volume=0.00096,
    )  # fmt: skip
    q = np.linspace(-1.5, 1.5, 7)

    def energy(angle: np.ndarray) -> np.ndarray:
        length = np.sqrt(0.8**2 + 0.2**2 - 2 * 0.8 * 0.2 * np.cos(angle + 1.2))
        return -15600.0 * np.log(0.00096 - (length - 0.6) * 0.0017)

    slope = (energy(q + 1e-6) - energy(q - 1e-6)) / 2e-6
    np.testing.assert_allclose(spring.torque(q), -slope, rtol=1e-6)
