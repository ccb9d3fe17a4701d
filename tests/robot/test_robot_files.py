import math
from pathlib import Path

import numpy as np
import pytest
from robot_oracles import UR5_DH
from urdf_samples import ARM

from dynid.core import RobotError
from dynid.robot import from_body, joint_poses, load_robot, move, robot_from_dh
from dynid.robot.robotfile import MAX_BYTES

FULL = """
name = "two"
source = "made up"
joint_names = ["hip", "knee"]
frames = "mdh"
[base]
xyz = [0, 0, 1]
[flange]
xyz = [0, 0, 0.1]
rpy = [0, 0, 1.5]
[dh]
convention = "standard"
a = [0.5, 0]
d = [0, 0.2]
alpha = [0.0, 1.5707963267948966]
theta = [0.0, 0.3]
joint_types = ["revolute", "prismatic"]
sign = [1, -1]
source = "a ruler"
[urdf_frames]
xyz = [[0, 0, 0.1], [0, 0, 0]]
rpy = [[1.5707963267948966, 0, 0], [0, 0, 0]]
[mount]
kind = "tilt:30"
[limits]
lower = [-1, nan]
upper = [2, nan]
velocity = [1, 2]
velocity_source = "a stopwatch"
acceleration = [3, 4]
torque = [50, 60]
[drives]
gain = [10, nan]
gear_ratio = [101, 50]
coupling = [[101, 0], [3, 50]]
offset = [0, 0.1]
position_side = "motor"
torque_side = "motor"
source = "a nameplate"
[inertia]
frames = "dh"
mass = [3, nan]
com = [[0.1, 0, 0.02], [nan, nan, nan]]
tensor = [[0.1, 0.2, 0.25, 0.01, 0.02, 0.03], [nan, nan, nan, nan, nan, nan]]
[[counterbalance]]
joint = "hip"
outer = 0.8
inner = 0.2
rest_length = 0.6
offset = 1.6
piston_area = 0.0017
gas_work = 15600
gas_volume = 0.00096
[[capsule]]
link = "base"
start = [0, 0, 0]
end = [0, 0, 1]
radius = 0.1
[[body]]
name = "shin"
link = "knee"
frames = "dh"
points = [[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0]]
"""


def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "two.toml"
    path.write_text(text)
    return path


def test_a_full_file(tmp_path: Path) -> None:
    robot = load_robot(_file(tmp_path, FULL))
    assert (robot.name, robot.joint_names, robot.default_frames) == ("two", ("hip", "knee"), "mdh")
    assert robot.joint_types == ("revolute", "prismatic")
    np.testing.assert_array_equal(robot.placements[0, :3, 3], [0, 0, 1])
    np.testing.assert_array_equal(robot.axes, [[0, 0, 1], [0, 0, -1]])
    assert robot.mount == "tilt:30"
    g = 9.80665
    np.testing.assert_allclose(robot.gravity, [0, -g / 2, -g * math.sqrt(3) / 2], atol=1e-12)
    np.testing.assert_array_equal(robot.limits.upper, [2, np.nan])
    np.testing.assert_array_equal(robot.limits.acceleration, [3, 4])
    np.testing.assert_array_equal(robot.drives.motor_from_joint, [[101, 0], [3, 50]])
    assert (robot.drives.position_side, robot.drives.torque_side) == ("motor", "motor")
    tensor = np.array([[0.1, 0.03, 0.02], [0.03, 0.2, 0.01], [0.02, 0.01, 0.25]])
    body = from_body(3, [0.1, 0, 0.02], tensor)
    expected = move(body, robot.parameter_frames["dh"][0])
    np.testing.assert_allclose(robot.inertias[0], expected, atol=1e-14)
    assert np.isnan(robot.inertias[1]).all()
    assert robot.counterbalances[0].joint == 0
    shin, base = robot.bodies
    assert (base.link, shin.link, shin.name) == (0, 2, "shin")
    np.testing.assert_allclose(shin.points[0], robot.parameter_frames["dh"][1][:3, 3])
    np.testing.assert_array_equal(robot.parameter_frames["urdf"][0][:3, 3], [0, 0, 0.1])
    for part in ("made up", "dh: a ruler", "limits velocity: a stopwatch", "drives: a nameplate"):
        assert part in robot.source


def test_what_is_left_out_is_unknown(tmp_path: Path) -> None:
    robot = load_robot(
        _file(tmp_path, '[dh]\nconvention="modified"\na=[0, 1]\nd=[0, 0]\nalpha=[0, 0]\n')
    )
    assert (robot.name, robot.joint_names) == ("two", ("joint_1", "joint_2"))
    assert robot.mount == "floor"
    assert np.isnan(robot.inertias).all()
    assert np.isnan(robot.limits.torque).all()
    assert np.isnan(robot.drives.gain).all()
    np.testing.assert_array_equal(robot.flange, np.eye(4))


def test_joint_rows_and_a_table_give_the_same_arm(tmp_path: Path) -> None:
    table = robot_from_dh(**UR5_DH)
    text = "".join(
        f'[[joint]]\nname = "j{k}"\nxyz = {row[:3, 3].tolist()}\n'
        f"rpy = [{math.atan2(row[2, 1], row[2, 2])}, 0.0, 0.0]\naxis = [0, 0, 3]\n"
        for k, row in enumerate(table.placements)
    )
    rows = load_robot(_file(tmp_path, text))
    q = np.random.default_rng(0).uniform(-3, 3, 6)
    np.testing.assert_allclose(joint_poses(rows, q), joint_poses(table, q), atol=1e-12)
    assert rows.default_frames == "urdf"
    np.testing.assert_array_equal(rows.axes[0], [0, 0, 1])


def test_urdf_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "arm.urdf").write_text(ARM)
    text = (
        'urdf = "sub/arm.urdf"\ntip = "tool0"\njoint_names = ["a", "b"]\n[locked]\nj3 = 0.2\n'
        "[limits]\ntorque = [1, 2]\n"
    )
    robot = load_robot(_file(tmp_path, text))
    assert robot.joint_names == ("a", "b")
    assert robot.locked["j3"] == 0.2
    np.testing.assert_array_equal(robot.limits.torque, [1, 2])
    np.testing.assert_array_equal(robot.limits.upper, [np.nan, 1.5])  # as in the URDF
    (tmp_path / "sub" / "arm.urdf").unlink()
    with pytest.raises(RobotError, match="no such URDF file"):
        load_robot(tmp_path / "two.toml")


def test_a_linked_file_is_found_again_where_its_urdf_lies(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "7.toml").write_text('urdf = "arm.urdf"\ntip = "tool0"')
    link = tmp_path / "arm.toml"
    link.symlink_to(tmp_path / "store" / "7.toml")
    robot = load_robot(tmp_path / "store" / ".." / "arm.toml")
    assert robot.file == str(link)
    assert load_robot(robot.file).joint_names == robot.joint_names


DH = '[dh]\nconvention="standard"\na=[1, 1]\nd=[0, 0]\nalpha=[0, 0]\n'
CYLINDER = FULL[FULL.index("[[counterbalance]]") : FULL.index("[[capsule]]")]
BROKEN = {
    "not toml": ("name = ", "not a TOML file"),
    "control": (b"name = '\x00'", "not a TOML file"),
    "not utf-8": (b"name = '\xff\xfe'", "not a TOML file"),
    "empty": ("", "exactly one of urdf"),
    "twist in degrees": (
        "[dh]\na = [0.0]\nd = [0.0]\nalpha = [90.0]\n",
        "dh: 'alpha' is more than a turn; got .90.0.*radians",
    ),
    "pose in degrees": (
        "[[joint]]\nname = 'a'\nrpy = [0, 0, -90]\n",
        "joint 1: 'rpy' is more than a turn.*radians",
    ),
    "long": ("#" * (MAX_BYTES + 1), "too large"),
    "nested": ("a = " + "[" * 100_000, "nested too deep|not a TOML"),
    "two kinds": ('urdf = "x.urdf"\n' + DH, "exactly one of urdf.*urdf and dh"),
    "unknown top": ("mont = 1\n" + DH, r"unknown key 'mont'.*Did you mean mount\?"),
    "unknown in dh": (DH + "aa = [1]", r"dh: unknown key 'aa'"),
    "tip without urdf": ('tip = "x"\n' + DH, "'tip' does not go with dh"),
    "base with urdf": ('urdf = "x.urdf"\n[base]\nxyz=[0,0,0]', "'base' does not go with urdf"),
    "dh not a table": ("dh = 3", "dh: must be a table"),
    "no convention": (DH.replace('convention="standard"', ""), "'convention' is missing"),
    "convention": (DH.replace("standard", "classic"), "'convention' unknown word"),
    "lengths": (DH.replace("d=[0, 0]", "d=[0]"), "dh: 'd' wrong number of entries; got 1"),
    "text number": (DH.replace("d=[0, 0]", 'd=[0, "0"]'), "dh: 'd' must be a number"),
    "bool number": (DH.replace("d=[0, 0]", "d=[0, true]"), "dh: 'd' must be a number"),
    "nan": (DH.replace("d=[0, 0]", "d=[0, nan]"), "dh: 'd' is out of range"),
    "inf": (DH.replace("d=[0, 0]", "d=[0, inf]"), "dh: 'd' is out of range"),
    "huge int": (DH.replace("d=[0, 0]", f"d=[0, {10**400}]"), "dh: 'd' is out of range"),
    "long int": (DH.replace("d=[0, 0]", f"d=[0, {'9' * 5000}]"), "TOML"),
    "date": (DH.replace("d=[0, 0]", "d=[0, 1979-05-27]"), "must be a number"),
    "no list": (DH.replace("d=[0, 0]", "d=0"), "dh: 'd' must be a list"),
    "names": ('joint_names = ["a"]\n' + DH, "'joint_names' wrong number"),
    "same names": ('joint_names = ["a", "a"]\n' + DH, "names repeat"),
    "name lines": ('name = "a\\nb"\n' + DH, "'name' must be a text of one line"),
    "mount word": (DH + '[mount]\nkind = "roof"', "mount: unknown mounting"),
    "mount tilt": (DH + '[mount]\nkind = "tilt:x"', "tilt needs degrees"),
    "mount both": (DH + '[mount]\nkind="floor"\ngravity=[0,0,1]', "either kind or gravity"),
    "gravity": (DH + "[mount]\ngravity = [0, 0, 981]", "gravity is too strong"),
    "limits": (DH + "[limits]\nlower=[1,1]\nupper=[0,2]", "limits: joint 1: lower position"),
    "limit too small": (DH + "[limits]\nacceleration=[1e-200,1]", "acceleration limits .* 1e-09"),
    "safety limit too small": (DH + "[safety]\npower=1e-200", "safety limit power .* 1e-09"),
    "limit sign": (DH + "[limits]\ntorque=[1,-1]", "torque limits must be positive"),
    "gain zero": (DH + "[drives]\ngain=[1,0]", "drives gain must be finite and not zero"),
    "singular": (DH + "[drives]\ncoupling=[[1,1],[1,1]]", "cannot be inverted"),
    "rows": (DH + "[drives]\ncoupling=[[1,1],[1]]", "'coupling' wrong number"),
    "side": (DH + '[drives]\ntorque_side="left"', "'torque_side' unknown word"),
    "motor side": (DH + '[drives]\ntorque_side="motor"', "need gear_ratio or coupling"),
    "offset": (DH + "[drives]\noffset=[0,0.1]", "'offset' is that of motor positions"),
    "mass": (DH + "[inertia]\nmass=[1,-1]", "inertia: negative mass"),
    "inertia frames": (DH + '[inertia]\nframes="x"\nmass=[1,1]', "toml: inertia: 'frames' unknown"),
    "single counterbalance": (DH + CYLINDER.replace("[[", "[").replace("]]", "]"), r"write \[\["),
    "counterbalance joint": (DH + CYLINDER, "'joint' unknown word; got hip"),
    "gas": (
        DH + CYLINDER.replace("hip", "joint_1").replace("0.00096", "0.0001"),
        "use up the gas volume",
    ),
    "capsule": (
        DH + '[[capsule]]\nlink="base"\nstart=[0,0,0]\nend=[0,0,0]\nradius=0',
        "positive radius",
    ),
    "no points": (DH + '[[body]]\nlink="base"\npoints=[]\nradius=1', "given by points"),
    "points of no arm": (DH + '[[body]]\nlink="base"\npoints="ur99"', "unknown word"),
    "no such body": (DH + '[[body]]\nname="x"\nlink="base"\npoints="ur5"', "of this name"),
    "other frames": (
        DH + '[[body]]\nname="base 1"\nlink="base"\nframes="dh"\npoints="ur10e"',
        "'frames' must be those",
    ),
    "flat point": (DH + '[[body]]\nlink="base"\npoints=[[0,0]]\nradius=1', "wrong number"),
    "source": (DH + "source = 3", "'source' must be a text"),
    "key lines": ('"a\\nb" = 1\n' + DH, r"unknown key 'a\?b'"),
    "joint rows": ("joint = []", "number of"),
    "joint rows on a base": ("joint = []\n[base]\nxyz = [0, 0, 1]", "number of"),
    "joint axis": ('[[joint]]\nname="a"\naxis=[0,0,0]', "joint 1: the axis has no length"),
    "joint type": ('[[joint]]\nname="a"\ntype="continuous"', "joint 1: 'type' unknown word"),
    "joint name": ("[[joint]]\nxyz=[0,0,0]", "joint 1: the key 'name' is missing"),
    "no urdf": ('urdf = "nowhere.urdf"', "urdf: no such URDF file"),
    "urdf folder": ('urdf = "."', "is not a file"),
    "urdf name": (f'urdf = "{"x" * 5000}"', "no such URDF file"),
    "locked": ('urdf = "arm.urdf"\nlocked = 1', "locked: must be a table"),
    "locked text": ('urdf = "arm.urdf"\n[locked]\nj1 = "x"', "locked: 'j1' must be a number"),
}


def test_a_body_of_a_builtin_arm_keeps_its_own_radius(tmp_path: Path) -> None:
    body = '[[body]]\nname="base 1"\nlink="base"\npoints="ur10e"\n'
    theirs = next(body for body in load_robot("ur10e").bodies if body.name == "base 1")
    for given, radius in (("", theirs.radius), ("radius=0.05", 0.05)):
        (found,) = load_robot(_file(tmp_path, DH + body + given)).bodies
        np.testing.assert_array_equal(found.points, theirs.points)
        assert found.radius == radius


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_name_table_and_key(name: str, tmp_path: Path) -> None:
    text, message = BROKEN[name]
    (tmp_path / "arm.urdf").write_text(ARM)
    path = tmp_path / "two.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RobotError, match=message) as caught:
        load_robot(path)
    assert str(caught.value).count("two.toml") == 1
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 900


def test_what_a_table_of_inertias_leaves_out_is_that_of_the_urdf(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    file = tmp_path / "arm.toml"
    file.write_text('urdf = "arm.urdf"\n')
    published = load_robot(file).inertias
    file.write_text('urdf = "arm.urdf"\n[inertia]\nframes = "dh"\nmass = [nan, nan, nan]\n')
    np.testing.assert_allclose(load_robot(file).inertias, published, atol=1e-12)
    # A heavier link keeps its centre of mass and its tensor about it.
    file.write_text('urdf = "arm.urdf"\n[inertia]\nmass = [nan, 9.0, nan]\n')
    heavier = load_robot(file).inertias
    np.testing.assert_allclose(heavier[[0, 2]], published[[0, 2]], atol=1e-12)
    np.testing.assert_allclose(heavier[1, :4], published[1, :4] * 9.0 / published[1, 0])


def test_a_missing_inertial_is_given_by_the_robot_file_alone(tmp_path: Path) -> None:
    start = ARM.index("<inertial>", ARM.index('<link name="l1">'))
    stop = ARM.index("</inertial>", start) + len("</inertial>")
    (tmp_path / "arm.urdf").write_text(ARM[:start] + ARM[stop:])
    file = tmp_path / "arm.toml"
    file.write_text('urdf = "arm.urdf"\n')
    assert load_robot(file).published.tolist() == [False, True, True]
    com = "com = [[0, 0, 0.1], [nan, nan, nan], [nan, nan, nan]]"
    file.write_text(f'urdf = "arm.urdf"\n[inertia]\nmass = [4, nan, nan]\n{com}\n')
    robot = load_robot(file)
    assert robot.published.all()
    assert robot.inertias[0, :4].tolist() == [4, 0, 0, 0.4]
