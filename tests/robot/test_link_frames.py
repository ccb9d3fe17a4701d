import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robot_oracles import DATA, classes, needs_models
from urdf_samples import URS, load_urdf

from dynid.robot import (
    from_xyz_rpy,
    inverse,
    load_robot,
    parameter_frames,
    poses_at_zero,
    robot_from_chain,
    robot_from_dh,
    robot_from_urdf,
)

angles = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, 0.3, -1.1])
lengths = st.sampled_from([0.0, 0.0, 0.2, -0.4])
origins = st.tuples(lengths, lengths, lengths, angles, angles, angles)
axes = st.sampled_from([(1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0), (0, 0, -1.0), (0.6, 0, 0.8)])
chains = st.lists(st.tuples(origins, axes), min_size=1, max_size=7)


@settings(max_examples=60)
@given(chains)
def test_frames_of_any_chain_follow_the_conventions(chain) -> None:
    placements = np.array([from_xyz_rpy(row[0][:3], row[0][3:]) for row in chain])
    directions = np.array([row[1] for row in chain], dtype=float)
    n = len(chain)
    robot = robot_from_chain(placements=placements, axes=directions)  # checks all transforms
    poses = poses_at_zero(placements)
    near = poses @ robot.parameter_frames["mdh"]
    far = poses @ robot.parameter_frames["dh"]
    z = np.einsum("kij,kj->ki", poses[:, :3, :3], directions)
    for k in range(n):
        np.testing.assert_allclose(near[k, :3, 2], z[k], atol=1e-9)
        np.testing.assert_allclose(far[k, :3, 2], z[min(k + 1, n - 1)], atol=1e-9)
        # The origins lie on the axes.
        for frame, axis in ((near[k], k), (far[k], min(k + 1, n - 1))):
            off = np.cross(frame[:3, 3] - poses[axis, :3, 3], z[axis])
            np.testing.assert_allclose(off, 0, atol=1e-9)
        # From the near to the far frame: a along x, then a twist about x, nothing else.
        step = inverse(near[k]) @ far[k]
        np.testing.assert_allclose(step[1:3, 3], 0, atol=1e-9)
        np.testing.assert_allclose(step[:3, 0], [1, 0, 0], atol=1e-9)
        # From one link's far frame to the next near one: a turn about z and a rise along it.
        if k:
            step = inverse(far[k - 1]) @ near[k]
            np.testing.assert_allclose(step[:2, 3], 0, atol=1e-9)
            np.testing.assert_allclose(step[:3, 2], [0, 0, 1], atol=1e-9)


@settings(max_examples=60)
@given(st.integers(0, 10_000), st.integers(2, 7))
def test_frames_of_a_generic_table_are_the_tables(seed: int, n: int) -> None:
    random = np.random.default_rng(seed)
    table = {key: random.uniform(0.1, 1, n) for key in ("a", "d", "alpha", "theta")}
    robot = robot_from_dh(**table)
    derived = parameter_frames(robot.placements, robot.axes, robot.flange)
    for key in ("dh", "mdh"):
        np.testing.assert_allclose(derived[key][:-1], robot.parameter_frames[key][:-1], atol=1e-8)


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10"])
def test_urdf_and_table_give_the_same_structure(name: str) -> None:
    urdf = robot_from_urdf(URS[name].encode())
    table = load_robot(name)
    for frames in ("dh", "mdh", "urdf"):
        assert classes(urdf, frames) == classes(table, frames), frames


@needs_models
def test_the_urdf_of_ros_has_the_same_structure() -> None:
    urdf = load_urdf(DATA / "ur_description/urdf/ur5_robot.urdf")
    assert classes(urdf, "dh") == (52, 36, 33, 9)
    assert classes(urdf, "mdh") == (52, 36, 31, 11)
    assert classes(urdf, "urdf") == (52, 34, 35, 9)


def test_truncated_right_angles_leave_no_residue() -> None:
    robot = robot_from_urdf(URS["ur5"].encode())  # rpy 1.57079632679
    for frames in ("dh", "mdh"):
        rotations = robot.parameter_frames[frames][:, :3, :3]
        assert np.abs(rotations - np.round(rotations)).max() < 1e-10
