from dataclasses import replace

import numpy as np
import pytest
from robot_oracles import UR5_DH, classes
from urdf_samples import ARM, URS

from dynid.robot import (
    Body,
    from_xyz_rpy,
    joint_poses,
    load_robot,
    nominal_geometry,
    robot_from_chain,
    robot_from_dh,
    robot_from_urdf,
    structural_gravity,
)

# Two real factory calibrations in the layout of ROS 2's ur_description (z axes throughout):
# x y z roll pitch yaw of each joint. A UR5e and a UR5.
UR5E = """
0 0 0.1627122445743823 0 0 5.707382499074709e-08
0.0001820110310317555 0 0 1.571314866107557 0 1.12157791523139e-06
-0.425170344631444 0 0 0.001444320579376547 -0.0004261037597356073 4.642343028998144e-06
-0.392646598028507 -0.0004030322688786401 0.1331063119537431 0.0030278882 -0.0011857226 -2.5698e-06
-7.071306960874342e-06 -0.09960359635829828 -3.198591184007791e-07 1.570799538 0 1.30482028e-06
1.369362273278849e-05 0.09958483828527664 9.521789789182917e-05 1.571752475 3.1415926536 3.14159251
"""
UR5 = """
0 0 0.089201138580847966 0 0 1.5413963267648517e-05
8.28481932000539e-05 0 0 1.5702793305568989 0 9.4248239648454113e-05
-0.42514603197027351 0 0 0.00027727163297603633 0.00074181659174685764 8.2061777589927939e-05
-0.39231335412023205 0.0007036784286 0.11004902881674888 3.1351985141 -3.14009544 3.1415185610
3.6501405590628345e-05 -0.094721186124807052 0.0001791428278527357 1.5689050644 0 -1.320607e-05
0.00015399008043081661 0.082421327089370319 0.00012632686 1.572329 3.1415926536 -3.141586771
"""


@pytest.mark.parametrize("scale", [1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", range(20))
def test_perturbed_tables_get_the_nominal_axes(scale: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    table = {key: np.array(v) + random.normal(0, scale, 6) for key, v in UR5_DH.items()}
    perturbed, exact = robot_from_dh(**table), robot_from_dh(**UR5_DH)
    nominal = nominal_geometry(perturbed)
    np.testing.assert_array_equal(nominal.axes, exact.axes)
    np.testing.assert_array_equal(nominal.placements[:, :3, :3], exact.placements[:, :3, :3])
    zero = exact.placements[:, :3, 3] == 0
    np.testing.assert_array_equal(nominal.placements[:, :3, 3][zero], 0)
    np.testing.assert_allclose(nominal.placements, perturbed.placements, atol=6 * scale)
    for key in ("dh", "mdh", "urdf"):
        ours, theirs = nominal.parameter_frames[key], exact.parameter_frames[key]
        # Square to the axes exactly; table and geometry may choose opposite x.
        assert set(np.abs(ours[:, :3, :3]).ravel()) <= {0.0, 1.0}
        np.testing.assert_allclose(ours[:, :3, 3], theirs[:, :3, 3], atol=6 * scale)
    if seed < 2:
        assert classes(nominal, "dh") == (52, 36, 33, 9)
        assert classes(nominal, "mdh") == (52, 36, 31, 11)
        assert classes(perturbed, "dh")[0] == 53


@pytest.mark.parametrize("rows", [UR5E, UR5], ids=["ur5e", "ur5"])
def test_real_calibrations(rows: str) -> None:
    numbers = [[float(word) for word in line.split()] for line in rows.split("\n") if line]
    robot = robot_from_chain(
        placements=np.array([from_xyz_rpy(row[:3], row[3:]) for row in numbers]),
        axes=np.tile([0.0, 0, 1], (6, 1)),
    )
    assert classes(robot, "dh")[0] == 53
    nominal = nominal_geometry(robot)
    assert classes(nominal, "dh") == (52, 36, 33, 9)
    assert classes(nominal, "mdh") == (52, 36, 31, 11)
    # The frames stay where they were, so that names mean the same in both.
    for key in ("dh", "mdh", "urdf"):
        np.testing.assert_allclose(
            nominal.parameter_frames[key], robot.parameter_frames[key], atol=0.01
        )
    q = np.random.default_rng(0).uniform(-3, 3, (5, 6))
    np.testing.assert_allclose(joint_poses(nominal, q), joint_poses(robot, q), atol=0.02)


def test_rounded_angles_of_a_urdf() -> None:
    text = URS["ur5"]
    robot = robot_from_urdf(text.replace("1.57079632679", "1.5708").encode())
    nominal = nominal_geometry(robot)
    assert classes(nominal, "urdf") == (52, 34, 35, 9)
    exact = nominal_geometry(robot_from_urdf(text.encode()))
    assert set(np.abs(exact.placements[:, :3, :3]).ravel()) <= {0.0, 1.0}


def test_what_is_not_nearly_right_stays() -> None:
    robot = robot_from_urdf(ARM.encode())
    nominal = nominal_geometry(robot)
    np.testing.assert_allclose(nominal.placements, robot.placements, atol=1e-9)


def test_inertias_and_bodies_move_along() -> None:
    table = {key: np.array(v, dtype=float) for key, v in UR5_DH.items()}
    table["alpha"][0] += 1e-3
    body = Body(name="x", link=2, points=np.array([np.zeros(3), np.ones(3)]), radius=0.1)
    base = Body(name="y", link=0, points=np.array([np.zeros(3), np.ones(3)]), radius=0.1)
    robot = replace(
        robot_from_dh(**table),
        inertias=np.array(load_robot("ur10").inertias),
        bodies=(base, body),
    )
    nominal = nominal_geometry(robot)
    assert nominal.bodies[0] is base
    assert nominal.joint_names == robot.joint_names
    np.testing.assert_allclose(nominal.inertias, robot.inertias, atol=0.05)
    np.testing.assert_allclose(nominal.bodies[1].points, body.points, atol=0.01)
    np.testing.assert_array_equal(nominal.inertias[:, 0], robot.inertias[:, 0])


@pytest.mark.parametrize("degrees", [0.0, 0.1, 0.9, 179.5])
def test_gravity_nearly_along_the_first_axis(degrees: float) -> None:
    robot = load_robot("ur5", mount=f"tilt:{degrees}")
    gravity, note = structural_gravity(robot)
    sign = 1 if degrees > 90 else -1
    np.testing.assert_array_equal(gravity[:2], 0)
    np.testing.assert_allclose(gravity[2], sign * 9.80665)
    off = min(degrees, 180 - degrees)
    assert (note is None) == (off == 0)
    if note:
        assert f"{off:.2g} deg" in note


def test_gravity_elsewhere_stays() -> None:
    for mount in ("wall", "tilt:2"):
        robot = load_robot("ur5", mount=mount)
        gravity, note = structural_gravity(robot)
        assert note is None
        np.testing.assert_array_equal(gravity, robot.gravity)
    weightless = replace(load_robot("ur5"), gravity=np.zeros(3))
    assert structural_gravity(weightless)[1] is None
