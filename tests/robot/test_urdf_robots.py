from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robot_oracles import DATA, EXAMPLES, SHARED, flange_pose, from_pinocchio, needs_models
from urdf_samples import ARM, chain, joint, load_urdf

from dynid.core import RobotError
from dynid.robot import RobotModel, joint_poses, load_robot, robot_from_urdf

ARMS = [
    "ur_description/urdf/ur5_robot.urdf",
    "ur_description/urdf/ur3_gripper.urdf",
    "panda_description/urdf/panda.urdf",
    "kinova_description/robots/kinova.urdf",
    "xarm_description/urdf/xarm7.urdf",
    "z1_description/urdf/z1.urdf",
    "so_arm_description/urdf/so101.urdf",
    "talos_data/robots/talos_left_arm.urdf",
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
    "finger_edu_description/robots/finger_edu.urdf",
]


def _reduced(path: Path, robot: RobotModel) -> pin.Model:
    """The same chain by pinocchio: other joints locked, continuous joints made revolute."""
    text = path.read_text().replace('"continuous"', '"revolute"')
    model = pin.buildModelFromXML(text)
    free = pin.neutral(model)
    rest = [name for name in model.names[1:] if name not in robot.joint_names]
    for name, value in robot.locked.items():
        free[model.joints[model.getJointId(name)].idx_q] = value
    return pin.buildReducedModel(model, [model.getJointId(name) for name in rest], free)


def _agrees(robot: RobotModel, model: pin.Model) -> None:
    order = [model.getJointId(name) for name in robot.joint_names]
    assert sorted(order) == list(range(1, robot.joints + 1))
    data = model.createData()
    for q in np.random.default_rng(0).uniform(-2, 2, (3, robot.joints)):
        theirs = np.empty(robot.joints)
        for k, index in enumerate(order):
            theirs[model.joints[index].idx_q] = q[k]
        pin.forwardKinematics(model, data, theirs)
        poses = [data.oMi[index].homogeneous for index in order]
        np.testing.assert_allclose(joint_poses(robot, q), poses, atol=1e-10)
    for k, index in enumerate(order):
        inertia = from_pinocchio(model.inertias[index].toDynamicParameters())
        ours = np.nan_to_num(robot.inertias[k])  # a link without inertia is unknown to us
        np.testing.assert_allclose(ours, inertia, atol=1e-10)
        assert robot.joint_types[k] == (
            "prismatic" if "P" in model.joints[index].shortname()[10:12] else "revolute"
        )


@needs_models
@pytest.mark.parametrize("name", ARMS)
def test_kinematics_and_inertias_agree_with_pinocchio(name: str) -> None:
    robot = load_urdf(DATA / name)
    assert robot.default_frames == "urdf"
    _agrees(robot, _reduced(DATA / name, robot))


def test_the_tx40_agrees_with_pinocchio() -> None:
    path = EXAMPLES / "tx40.urdf"
    robot = load_urdf(path)
    _agrees(robot, _reduced(path, robot))


def test_a_xacro_arm_with_everything_in_it(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace("0 -2 0", "0 -1 0"))
    robot = load_robot(path)
    assert robot.name == "arm"
    assert robot.joint_names == ("j1", "j2", "j3")
    assert robot.joint_types == ("revolute", "revolute", "prismatic")
    assert dict(robot.locked) == {"finger_1": 0.0, "finger_2": 0.01}
    _agrees(robot, _reduced(path, robot))
    limits = robot.limits
    np.testing.assert_array_equal(limits.lower, [np.nan, -2, 0])
    np.testing.assert_array_equal(limits.upper, [np.nan, 1.5, 0.5])
    np.testing.assert_array_equal(limits.velocity, [2, 3, 1])
    np.testing.assert_array_equal(limits.torque, [np.nan, 80, 100])
    assert np.isnan(limits.acceleration).all()
    assert any("branches" in note for note in robot.notes)
    assert any("finger_1 at 0" in note for note in robot.notes)
    # The flange is tool0, which is fixed to the hand.
    np.testing.assert_allclose(robot.flange[:3, 3], [0, 0, 0.3], atol=1e-15)


def test_a_prefix_that_nothing_declares(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    text = ARM.replace("0 -2 0", "0 -1 0").replace("<limit ", '<limit drake:acceleration="2" ')
    path.write_text(text.replace("</robot>", "<drake:group/></robot>"))
    _agrees(robot := load_urdf(path), _reduced(path, robot))


def test_locked_joints_and_tips_of_choice(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace("0 -2 0", "0 -1 0"))
    robot = load_urdf(path, tip="l2", locked={"finger_1": 0.02})
    assert robot.joint_names == ("j1", "j2")
    assert dict(robot.locked) == {"j3": 0.0, "finger_1": 0.02, "finger_2": 0.05}
    _agrees(robot, _reduced(path, robot))
    bent = load_urdf(path, locked={"j2": 0.7})
    assert bent.joint_names == ("j1", "j3")
    _agrees(bent, _reduced(path, bent))
    finger = load_urdf(path, tip="f1")
    assert finger.joint_names == ("j1", "j2", "j3", "finger_1")


def test_a_velocity_limit_that_stands_for_none_is_unknown() -> None:
    robot = robot_from_urdf(ARM.replace('velocity="3"', 'velocity="10000"').encode())
    assert np.isnan(robot.limits.velocity).tolist() == [False, True, False]
    assert any("j2: velocity limit of 1e+04 read as unknown" in note for note in robot.notes)


def test_axes_get_unit_length_with_a_note() -> None:
    robot = robot_from_urdf(ARM.encode())
    np.testing.assert_array_equal(robot.axes[1], [0, -1, 0])
    assert any("axis of length 2" in note for note in robot.notes)
    default = robot_from_urdf(
        chain(joint("j", "a", "b", inside=""))
        .replace('<link name="c"/><link name="d"/><link name="e"/><link name="f"/>', "")
        .encode()
    )
    np.testing.assert_array_equal(default.axes, [[1, 0, 0]])
    assert np.isnan(default.inertias).all()
    assert any("no inertia" in note for note in default.notes)


def _links(text: str, kept: str) -> bytes:
    for name in "abcdef":
        if name not in kept:
            text = text.replace(f'<link name="{name}"/>', "")
    return text.encode()


def test_mimicking_branches_do_not_end_the_arm() -> None:
    mimic = '<axis xyz="0 1 0"/><mimic joint="j1"/>'
    text = chain(
        joint("j1", "a", "b"),
        joint("rod", "b", "f", inside=mimic),
        joint("j2", "b", "c"),
        joint("j3", "c", "d"),
    )
    robot = robot_from_urdf(_links(text, "abcdf"))
    assert robot.joint_names == ("j1", "j2", "j3")
    assert dict(robot.locked) == {"rod": 0.0}
    assert any("torques" in note and "rod with j1" in note for note in robot.notes)
    # A hand of one driven and one mimicking finger does.
    text = chain(
        joint("j1", "a", "b"),
        joint("left", "b", "c"),
        joint("right", "b", "d", inside='<axis xyz="0 1 0"/><mimic joint="left"/>'),
    )
    assert robot_from_urdf(_links(text, "abcd")).joint_names == ("j1",)


def test_only_a_branch_with_mass_makes_its_leader_unknown() -> None:
    """Where a rod of 0.5 kg is when the arm moves is not known; an empty frame is nowhere."""
    body = (
        '<link name="{}"><inertial><mass value="{}"/>'
        '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    mimic = '<axis xyz="0 1 0"/><mimic joint="ja"/>'
    for mass in (0.0, 0.5):
        text = '<robot name="arm"><link name="a"/>'
        for name, kg in (("b", 2.0), ("c", 1.0), ("d", 1.0), ("f", mass)):
            text += body.format(name, kg, i=0.01 * kg)
        text += joint("rod", "b", "f", inside=mimic)
        text += "".join(joint(f"j{a}", a, b) for a, b in ("ab", "bc", "cd"))
        robot = robot_from_urdf(f"{text}</robot>".encode())
        assert np.isfinite(robot.inertias).all(axis=1).tolist() == [mass == 0, True, True]


def test_a_torso_that_arms_stand_on_is_not_taken_for_the_arm() -> None:
    """A torso of one joint, a head of one and an arm of two: which is meant is asked."""
    arm = (joint("j1", "b", "d"), joint("j2", "d", "e"))
    text = _links(chain(joint("lift", "a", "b"), joint("head", "b", "c"), *arm), "abcde")
    with pytest.raises(RobotError, match=r"link b .* 1 moving joints lead there, 2 go on.*tip = "):
        robot_from_urdf(text)
    assert robot_from_urdf(text, tip="e").joint_names == ("lift", "j1", "j2")
    # As many as lead there may be a hand.
    assert robot_from_urdf(text, locked={"j2": 0.0}).joint_names == ("lift",)


def test_a_mimicking_joint_within_the_arm_is_refused_or_locked() -> None:
    text = chain(
        joint("j1", "a", "b"),
        joint("j2", "b", "c", inside='<axis xyz="0 1 0"/><mimic joint="j1" offset="0.5"/>'),
        joint("j3", "c", "d"),
    )
    with pytest.raises(RobotError, match=r"j2 mimics j1.*\[locked\] j2 = 0.0"):
        robot_from_urdf(_links(text, "abcd"))
    robot = robot_from_urdf(_links(text, "abcd"), locked={"j2": 0.5})
    assert robot.joint_names == ("j1", "j3")
    assert dict(robot.locked) == {"j2": 0.5}


def test_floating_bases_are_fixed_and_floating_joints_within_the_arm_refused() -> None:
    text = chain(joint("root", "a", "b", "floating", ""), joint("j1", "b", "c"))
    robot = robot_from_urdf(_links(text, "abc"))
    assert robot.joint_names == ("j1",)
    assert any("floating" in note for note in robot.notes)
    text = chain(
        joint("j1", "a", "b"), joint("free", "b", "c", "planar", ""), joint("j2", "c", "d")
    )
    with pytest.raises(RobotError, match="within the arm"):
        robot_from_urdf(_links(text, "abcd"))


def test_limits_that_mean_nothing_are_unknown() -> None:
    inside = '<axis xyz="0 0 1"/><limit lower="-inf" upper="1e10" effort="-1" velocity="inf"/>'
    robot = robot_from_urdf(_links(chain(joint("j", "a", "b", inside=inside)), "ab"))
    assert np.isnan([robot.limits.lower, robot.limits.upper, robot.limits.torque]).all()
    # Of planar bases: no motion was found between them.
    inside = '<axis xyz="0 0 1"/><limit lower="-999999" upper="2" effort="5" velocity="1"/>'
    robot = robot_from_urdf(_links(chain(joint("j", "a", "b", inside=inside)), "ab"))
    assert np.isnan(robot.limits.lower).all()
    assert robot.limits.upper == 2
    assert any("j: lower limit of -1e+06 read as unknown" in note for note in robot.notes)
    inside = '<axis xyz="0 0 1"/><limit lower="0" upper="0" effort="5" velocity="1"/>'
    robot = robot_from_urdf(_links(chain(joint("j", "a", "b", inside=inside)), "ab"))
    assert np.isnan(robot.limits.lower).all()
    assert any("0 to 0" in note for note in robot.notes)


def test_a_limit_that_is_left_out_beside_the_other_is_zero() -> None:
    for given, limits in (('lower="-1.5"', (-1.5, 0.0)), ('upper="0.5"', (0.0, 0.5))):
        inside = f'<axis xyz="0 0 1"/><limit {given} effort="5" velocity="1"/>'
        text = _links(chain(joint("j", "a", "b", inside=inside)), "ab")
        robot, theirs = robot_from_urdf(text), pin.buildModelFromXML(text.decode())
        assert (robot.limits.lower[0], robot.limits.upper[0]) == limits
        assert (theirs.lowerPositionLimit[0], theirs.upperPositionLimit[0]) == limits


def test_soft_limits_within_hard_ones_are_the_limits() -> None:
    hard = '<axis xyz="0 0 1"/><limit lower="-2" upper="3" effort="5" velocity="1"/>'
    for soft, limits in (
        ('soft_lower_limit="-1.8" soft_upper_limit="2.5"', (-1.8, 2.5)),
        ('soft_lower_limit="-4" soft_upper_limit="2.5"', (-2.0, 2.5)),
        ('k_position="20"', (-2.0, 3.0)),
        ('soft_lower_limit="0" soft_upper_limit="0"', (-2.0, 3.0)),
    ):
        inside = f'{hard}<safety_controller k_velocity="1" {soft}/>'
        robot = robot_from_urdf(_links(chain(joint("j", "a", "b", inside=inside)), "ab"))
        assert (robot.limits.lower[0], robot.limits.upper[0]) == limits
    # Where the hard ones are not known, the soft ones still are.
    soft = '<safety_controller k_velocity="1" soft_lower_limit="-1" soft_upper_limit="2"/>'
    for known in ('lower="-inf" upper="inf"', 'lower="-inf" upper="3"', ""):
        inside = f'<axis xyz="0 0 1"/><limit {known} effort="5" velocity="1"/>{soft}'
        robot = robot_from_urdf(_links(chain(joint("j", "a", "b", inside=inside)), "ab"))
        assert (robot.limits.lower[0], robot.limits.upper[0]) == (-1.0, 2.0)


@needs_models
@pytest.mark.parametrize(
    ("name", "chains"),
    [
        ("tiago_description/robots/tiago_no_hand.urdf", "several chains"),
        ("allegro_hand_description/urdf/allegro_left_hand.urdf", "several chains"),
        ("hector_description/robots/quadrotor_base.urdf", "no chain"),
    ],
)
def test_without_a_trunk_the_error_lists_tips(name: str, chains: str) -> None:
    with pytest.raises(RobotError, match=f"{chains} of moving joints") as caught:
        load_urdf(DATA / name)
    if "tiago" in name:
        assert str(caught.value.limit).startswith("arm_tool_link")
        robot = load_urdf(DATA / name, tip="arm_tool_link")
        assert robot.joints == 8
        _agrees(robot, _reduced(DATA / name, robot))


BROKEN = {
    "empty": ("", "empty"),
    "text": ("hello", "not well-formed"),
    "cut": (ARM[:900], "not well-formed"),
    "sdf": ("<sdf version='1.6'><model/></sdf>", "outer element is not <robot>"),
    "xacro": (
        ARM.replace("<material", '<xacro:property name="x" value="1"/><material', 1),
        "xacro FILE",
    ),
    "unbound xacro": ("<robot name='r'><xacro:arm/></robot>", "xacro FILE"),
    "xacro number": (ARM.replace('"0 0 0.3"', '"0 0 ${h}"'), "xacro FILE"),
    "entities": (
        '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;"/>',
        "document type",
    ),
    "deep": ("<robot>" + "<a>" * 200000, "deep"),
    "no links": ('<robot name="r"/>', "no links"),
    "nan": (ARM.replace('"0 0 0.3"', '"0 0 nan"'), "joint j1: <origin xyz> is not a finite"),
    "inf mass": (ARM.replace('value="4"', 'value="inf"'), "link l1: <mass value> is not a finite"),
    "underscore": (ARM.replace('"0 0 0.3"', '"0 0 1_0"'), "not a finite"),
    "comma": (ARM.replace('"0 0 0.3"', '"0,0,0.3"'), "three numbers"),
    "huge": (ARM.replace('"0 0 0.3"', '"0 0 1e30"'), "out of range"),
    "huge exponent": (ARM.replace('"0 0 0.3"', '"0 0 1e999"'), "out of range"),
    "negative mass": (ARM.replace('value="4"', 'value="-4"'), "link l1: negative mass"),
    "no mass": (ARM.replace('<mass value="4"/>', ""), "link l1: the mass"),
    "zero axis": (ARM.replace("0 -2 0", "0 0 0"), "joint j2: the axis has no length"),
    "type": (ARM.replace('"continuous"', '"screw"'), "unknown joint type"),
    "no type": (ARM.replace(' type="continuous"', ""), "unknown joint type"),
    "missing link": (
        ARM.replace('<child link="l1"/>', '<child link="l9"/>'),
        "child link does not",
    ),
    "no parent": (ARM.replace('<parent link="base"/>', ""), "parent link does not exist"),
    "no name": (ARM.replace('<link name="tool0"/>', "<link/>"), "no name"),
    "same link": (ARM.replace('<link name="tool0"/>', '<link name="l1"/>'), "same name"),
    "same joint": (ARM.replace('joint name="j2"', 'joint name="j1"'), "same name"),
    "limits": (ARM.replace('lower="-2"', 'lower="2"'), "lower limit above"),
    "two roots": (ARM.replace("</robot>", '<link name="x"/></robot>'), "one tree"),
    "two parents": (ARM.replace('<child link="cover"/>', '<child link="l1"/>'), "two parent"),
    "loop": (ARM.replace('<parent link="world"/>', '<parent link="hand"/>'), "one tree|loop"),
    "many joints": (
        '<robot name="r"><link name="n0"/>'
        + "".join(
            f'<link name="n{k}"/>' + joint(f"j{k}", f"n{k - 1}", f"n{k}") for k in range(1, 99)
        )
        + "</robot>",
        "number of joints",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_name_the_place(name: str, tmp_path: Path) -> None:
    text, message = BROKEN[name]
    path = tmp_path / "broken.urdf"
    path.write_text(text)
    with pytest.raises(RobotError, match=message) as caught:
        load_robot(path)
    assert "broken.urdf" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bad_wishes() -> None:
    data = ARM.encode()
    with pytest.raises(RobotError, match=r"no such tip link.*tool0"):
        robot_from_urdf(data, tip="tool00")
    with pytest.raises(RobotError, match="no such joint to lock"):
        robot_from_urdf(data, locked={"nope": 0.0})
    with pytest.raises(RobotError, match="does not move"):
        robot_from_urdf(data, locked={"fix": 0.0})
    with pytest.raises(RobotError, match="finite"):
        robot_from_urdf(data, locked={"j1": float("nan")})
    with pytest.raises(RobotError, match="no chain of moving joints"):
        robot_from_urdf(data, tip="base")


def test_other_encodings_and_blank_lines_first() -> None:
    for data in (
        b"\n\n" + ARM.encode(),
        b"\xef\xbb\xbf" + ARM.encode(),
        ARM.replace('version="1.0"', 'version="1.0" encoding="UTF-16"').encode("utf-16"),
    ):
        assert robot_from_urdf(data).joints == 3


@pytest.mark.skipif(not SHARED.is_dir(), reason="recordings of ../shared/data are not here")
@pytest.mark.parametrize("path", sorted(SHARED.glob("*/*.urdf")), ids=lambda path: path.stem)
def test_robots_of_the_recordings(path: Path) -> None:
    robot = load_urdf(path)
    assert robot.joints in (6, 7)
    _agrees(robot, _reduced(path, robot))
    assert flange_pose(robot, np.zeros(robot.joints)).shape == (4, 4)


_BODY = (
    '<link name="l{k}"><inertial><origin xyz="{com}"/><mass value="{mass}"/><inertia ixx="{ixx}" '
    'iyy="{iyy}" izz="{iyy}" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j{k}" '
    'type="revolute"><parent link="l{p}"/><child link="l{k}"/><origin xyz="0.3 0 0"/>'
    '<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="4" effort="200"/></joint>'
)


def _published(masses: Sequence[float], ixx: float, iyy: float, com: str) -> list[int]:
    """Numbers of each link that are known."""
    robot = _serial(masses, ixx, iyy, com)
    known: list[int] = np.isfinite(robot.inertias).sum(axis=1).tolist()
    assert any("placeholder" in note for note in robot.notes) == (min(known) < 10)
    return known


def _serial(masses: Sequence[float], ixx: float, iyy: float, com: str) -> RobotModel:
    return robot_from_urdf(_chain_of(masses, ixx, iyy, com).encode())


def _chain_of(masses: Sequence[float], ixx: float, iyy: float, com: str) -> str:
    links = "".join(
        _BODY.format(k=k + 1, p=k, mass=mass, ixx=ixx, iyy=iyy, com=com)
        for k, mass in enumerate(masses)
    )
    return f'<robot name="arm"><link name="l0"/>{links}</robot>'


def test_an_arm_without_any_mass_is_unknown_and_not_weightless() -> None:
    robot = _serial([0, 0, 0], 0.0, 0.0, "0 0 0")
    assert np.isnan(robot.inertias).all()
    assert robot.notes == ("no link that moves has a mass: all are taken as unknown",)
    assert np.isfinite(_serial([3, 0, 0], 0.0, 0.0, "0 0 0").inertias).all()


def test_links_without_inertia_are_one_note() -> None:
    links = "".join(f'<link name="{name}"/>' for name in "abc")
    text = "".join(joint(f"j{a}", a, b, inside='<axis xyz="0 0 1"/>') for a, b in ("ab", "bc"))
    notes = robot_from_urdf(f'<robot name="arm">{links}{text}</robot>'.encode()).notes
    assert [note for note in notes if "inertia" in note] == [
        "the URDF has no inertia of links moved by ja, jb"
    ]


def test_shapes_are_read_where_they_alone_tell_a_tensor(tmp_path: Path) -> None:
    ball = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    for masses, ixx, iyy, read in (([7, 5, 3], 0.3, 0.3, True), ([2, 2, 2], 0.01, 0.02, False)):
        text = _chain_of(masses, ixx, iyy, "0.1 0 0").replace("<inertial>", f"{ball}<inertial>")
        (tmp_path / "arm.urdf").write_text(text)
        assert bool(load_robot(tmp_path / "arm.urdf", collision=False).bodies) == read


def test_placeholders_of_inertias_are_unknown() -> None:
    assert _published([1, 1, 1, 1], 1.0, 1.0, "0 0 0") == [0, 0, 0, 0]
    assert _published([1, 1, 1], 0.01, 0.02, "0 0 0") == [0, 0, 0]
    # Masses of a data sheet, and centres, beside one tensor for all.
    assert _published([7, 5, 3], 0.3, 0.3, "0.1 0 0") == [4, 4, 4]
    # The true link is fixed to a dummy, as in the arms of a PR2.
    dummies = _chain_of([0.1, 0.1, 0.1], 0.01, 0.01, "0 0 0")
    true = _BODY.format(k=9, p=1, mass=6, ixx=0.1, iyy=0.2, com="0.2 0 0")
    fixed = true.replace('type="revolute"', 'type="fixed"')
    held = robot_from_urdf(dummies.replace("</robot>", f"{fixed}</robot>").encode())
    assert np.isfinite(held.inertias).all(axis=1).tolist() == [True, True, True]
    assert held.inertias[0, 0] == pytest.approx(6.1)
    # Modules of one kind are true, and so may two bodies be.
    assert _published([2, 2, 2], 0.01, 0.02, "0.1 0 0") == [10, 10, 10]
    assert _published([1, 1], 0.01, 0.01, "0 0 0") == [10, 10]
