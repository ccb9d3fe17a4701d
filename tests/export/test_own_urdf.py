"""The URDF that a robot came from, with the identified inertias in it."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from known_exports import estimate_of, parameters_of

from dynid.cli.app import main
from dynid.core import InputError
from dynid.export import write_model
from dynid.identification import write_estimate
from dynid.robot import load_robot

# Three joints, one of them endless and one askew; a tool with a collision body fixed to the last
# link, on a table of its own; a gripper whose finger slides.
ARM = """<?xml version="1.0" encoding="utf-8"?>
<!-- Copyright of somebody -->
<robot name="mine" xmlns:tool="http://example.org/tool">
  <!-- the table -->
  <link name="table"><visual><geometry><sphere radius="1"/></geometry></visual></link>
  <link name="turret">
    <visual><geometry><mesh filename="meshes/turret.stl"/></geometry></visual>
    <inertial><mass value="3"/>
      <inertia ixx=".02" iyy=".02" izz=".03" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="boom">
    <visual><geometry><mesh filename="package://mine/boom.stl"/></geometry></visual>
    <inertial>
      <origin xyz="0 0 .2" rpy=".3 0 0"/>
      <mass value="2"/>
      <inertia ixx=".03" iyy=".03" izz=".004" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="bracket"/>
  <link name="wrist"><inertial><mass value="1"/>
    <inertia ixx=".002" iyy=".002" izz=".003" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool">
    <collision><geometry><box size=".1 .1 .1"/></geometry></collision>
    <inertial><mass value=".5"/>
      <inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="palm"/>
  <link name="finger">
    <inertial><mass value=".05"/>
      <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="turn" type="continuous">
    <origin xyz="0 0 .3"/><parent link="table"/><child link="turret"/><axis xyz="0 0 1"/>
    <limit other:acceleration="2.5" effort="80" velocity="2"/>
  </joint>
  <joint name="lift" type="revolute">
    <origin xyz="0 .1 .2" rpy=".1 .2 .3"/><parent link="turret"/><child link="boom"/>
    <axis xyz="0 .8 .6"/>
    <limit lower="-2" upper="2" effort="60" velocity="2"/><dynamics damping="7"/>
  </joint>
  <joint name="weld" type="fixed">
    <origin xyz="0 0 .4"/><parent link="boom"/><child link="bracket"/>
  </joint>
  <joint name="roll" type="revolute">
    <origin xyz=".1 0 0" rpy="0 1 0"/><parent link="bracket"/><child link="wrist"/>
    <axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="20" velocity="3"/>
  </joint>
  <joint name="mount" type="fixed">
    <origin xyz="0 .05 .1"/><parent link="wrist"/><child link="tool"/>
  </joint>
  <joint name="hold" type="fixed">
    <origin xyz="0 0 .2"/><parent link="tool"/><child link="palm"/>
  </joint>
  <joint name="gripper_slide" type="prismatic">
    <origin xyz="0 .02 0"/><parent link="palm"/><child link="finger"/><axis xyz="0 1 0"/>
    <limit lower="0" upper=".04" effort="5" velocity="1"/>
  </joint>
  <tool:changer kind="quick"/>
</robot>
"""
ROBOT_FILE = 'urdf = "mine/arm.urdf"\n[mount]\nkind = "tilt:30"\n[locked]\ngripper_slide = 0.03\n'


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "arm.urdf").write_text(ARM)
    (tmp_path / "arm.toml").write_text(ROBOT_FILE)
    return folder / "arm.urdf"


def test_it_is_a_copy_with_other_numbers(mine: Path) -> None:
    robot = load_robot(mine)
    done = write_model(
        estimate_of(robot, parameters_of(robot, 5)), mine.parent / "new.urdf", "urdf"
    )
    assert done.verified.passed
    assert done.verified.loaded_with.startswith("pinocchio")
    assert done.source == mine
    assert done.to_json()["copy_of"] == str(mine)
    text = done.path.read_text()
    for kept in (
        "<!-- Copyright of somebody -->",
        "<!-- the table -->",
        '<mesh filename="meshes/turret.stl"/>',
        '<mesh filename="package://mine/boom.stl"/>',
        '<limit lower="-2" upper="2" effort="60" velocity="2"/>',
        '<link name="table"><visual><geometry><sphere radius="1"/></geometry></visual></link>',
        'changer kind="quick"/>',
    ):
        assert text.count(kept) == 1
    again = load_robot(done.path)
    assert again.joint_names == robot.joint_names
    np.testing.assert_allclose(again.inertias, done.model.inertials, atol=1e-12)
    np.testing.assert_array_equal(again.limits.torque, robot.limits.torque)


def test_pinocchio_and_mujoco_have_the_same_arm(mine: Path) -> None:
    """Links of MuJoCo whose inertia is gone would get one from their collision geometry."""
    robot = load_robot(mine.parent.parent / "arm.toml")
    parameters = parameters_of(robot, 6)
    done = write_model(estimate_of(robot, parameters), mine.parent / "new.urdf", "urdf")
    assert done.verified.passed
    theirs = mujoco.MjModel.from_xml_string(_without_meshes(done.path))
    theirs.opt.gravity[:] = robot.gravity
    data = mujoco.MjData(theirs)
    loaded = pin.buildModelFromUrdf(str(done.path))
    loaded.gravity.linear = robot.gravity
    random = np.random.default_rng(0)
    for _ in range(20):
        q, dq, ddq = random.uniform(-1, 1, (3, 4))
        q[3], dq[3], ddq[3] = 0.03, 0.0, 0.0
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        mujoco.mj_inverse(theirs, data)
        full = np.array([np.cos(q[0]), np.sin(q[0]), *q[1:]])
        friction = loaded.damping * dq
        torque = pin.rnea(loaded, loaded.createData(), full, dq, ddq) + friction
        np.testing.assert_allclose(data.qfrc_inverse, torque, atol=1e-9)


def test_fixed_links_are_in_the_one_that_moves_and_fingers_keep_theirs(mine: Path) -> None:
    robot = load_robot(mine)
    published = np.hstack([robot.inertias.ravel(), parameters_of(robot, 7)[30:]])
    done = write_model(estimate_of(robot, published), mine.parent / "new.urdf", "urdf")
    theirs = pin.buildModelFromUrdf(str(done.path))
    finger = theirs.inertias[theirs.getJointId("gripper_slide")]
    assert finger.mass == pytest.approx(0.05)
    wrist = theirs.inertias[theirs.getJointId("roll")]
    assert wrist.mass == pytest.approx(done.model.inertials[2, 0] - 0.05)
    tool = next(frame for frame in theirs.frames if frame.name == "tool")
    assert tool.inertia.mass == 0.0


def test_meshes_are_found_from_another_folder(mine: Path, tmp_path: Path) -> None:
    robot = load_robot(mine)
    (tmp_path / "fitted").mkdir()
    done = write_model(
        estimate_of(robot, parameters_of(robot, 5)), tmp_path / "fitted" / "model.urdf", "urdf"
    )
    assert '<mesh filename="../mine/meshes/turret.stl"/>' in done.path.read_text()
    (tmp_path / "deep" / "folder").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "deep" / "folder")
    done = write_model(
        estimate_of(robot, parameters_of(robot, 5)), tmp_path / "link" / "model.urdf", "urdf"
    )
    assert '<mesh filename="../../mine/meshes/turret.stl"/>' in done.path.read_text()


def test_one_that_has_moved_is_named_and_others_are_refused(
    mine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = load_robot(mine)
    estimate = estimate_of(robot, parameters_of(robot, 5))
    there = mine.rename(tmp_path / "moved.urdf")
    own = write_model(estimate, tmp_path / "own.urdf", "urdf")
    assert own.source is None
    assert 'name="link_3"' in own.path.read_text()
    assert write_model(estimate, tmp_path / "new.urdf", "urdf", urdf=there).source == there
    write_estimate(estimate, tmp_path / "estimate.json")
    words = ["export", str(tmp_path / "estimate.json"), "--to", "urdf", "-o"]
    assert main([*words, str(tmp_path / "a.urdf")]) == 0
    # Lines are broken where the path ends, which is as long as the folder's number.
    assert f"{mine}isnotthere" in "".join(capsys.readouterr().out.split())
    assert main([*words, str(tmp_path / "b.urdf"), "--urdf", str(there)]) == 0
    assert f"acopyof{there}" in "".join(capsys.readouterr().out.split())
    there.write_text(ARM.replace('xyz="0 0 .3"', 'xyz="0 0 .31"'))
    with pytest.raises(InputError, match="turn"):
        write_model(estimate, tmp_path / "other.urdf", "urdf", urdf=there)
    there.write_text(ARM.replace('"roll"', '"twist"'))
    with pytest.raises(InputError, match="roll"):
        write_model(estimate, tmp_path / "other.urdf", "urdf", urdf=there)
    with pytest.raises(InputError, match="mjcf"):
        write_model(estimate, tmp_path / "other.xml", "mjcf", urdf=there)
    assert not list(tmp_path.glob("*other*"))


def test_the_robot_s_own_urdf_is_never_replaced(mine: Path, tmp_path: Path) -> None:
    robot = load_robot(mine)
    estimate = estimate_of(robot, parameters_of(robot, 5))
    write_estimate(estimate, tmp_path / "estimate.json")
    before = mine.read_bytes()
    for more in ([], ["--urdf", str(mine)]):
        words = ["export", str(tmp_path / "estimate.json"), "--to", "urdf", "-o", str(mine), *more]
        assert main([*words, "--force"]) == 2
        assert mine.read_bytes() == before
    # Of a name that other formats have, too.
    named = mine.rename(mine.with_suffix(".xml"))
    estimate = estimate_of(load_robot(named), parameters_of(robot, 5))
    with pytest.raises(InputError, match="own URDF"):
        write_model(estimate, named, "mjcf")
    assert named.read_bytes() == before


def test_joints_that_a_robot_file_renames_are_those_of_no_urdf(mine: Path, tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text(f'joint_names = ["a", "b", "c"]\n{ROBOT_FILE}')
    robot = load_robot(tmp_path / "arm.toml")
    assert robot.bodies
    done = write_model(estimate_of(robot, parameters_of(robot, 5)), tmp_path / "own.urdf", "urdf")
    assert (done.source, done.verified.passed) == (None, True)


def _without_meshes(path: Path) -> str:
    """MuJoCo looks for meshes."""
    lines = path.read_text().splitlines()
    return "\n".join(line for line in lines if "<mesh" not in line)
