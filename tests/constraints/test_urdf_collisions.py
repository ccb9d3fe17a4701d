"""Self-collision of robots from URDF files, against pinocchio and coal."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from chains_for_constraints import random_arm

import dynid
from dynid.constraints import certify, safe_constraints
from dynid.core import InputError
from dynid.robot import Body, load_robot
from dynid.trajectory import FourierSeries, Quintic

DATA = Path(sys.prefix) / (
    f"lib/python3.{sys.version_info.minor}/site-packages/"
    "cmeel.prefix/share/example-robot-data/robots"
)
needs_models = pytest.mark.skipif(
    not DATA.is_dir(), reason="the package example-robot-data is not installed"
)
PANDA = DATA / "panda_description" / "urdf" / "panda.urdf"


@needs_models
def test_no_pose_of_a_panda_with_touching_meshes_passes() -> None:
    robot = load_robot(PANDA)
    judge = safe_constraints(robot, acceleration=np.full(7, 10.0))
    model = pin.buildModelFromUrdf(str(PANDA))
    shapes = pin.buildGeomFromUrdf(
        model, str(PANDA), pin.GeometryType.COLLISION, package_dirs=[str(DATA.parent.parent)]
    )
    # The fingers are fixed in the hand here.
    link = [min(item.parentJoint, 7) for item in shapes.geometryObjects]
    for a in range(len(link)):
        for b in range(a + 1, len(link)):
            if abs(link[a] - link[b]) > 1:
                shapes.addCollisionPair(pin.CollisionPair(a, b))
    data, placed = model.createData(), shapes.createData()
    rest = np.zeros((1, 7))
    touching = passed = 0
    limits = robot.limits
    for q in np.random.default_rng(3).uniform(limits.lower, limits.upper, (150, 7)):
        passes = judge.usage(q[None], rest, rest)["self_collision"].margin >= 0.001
        hit = pin.computeCollisions(model, data, shapes, placed, np.r_[q, 0, 0], True)
        touching += hit
        passed += passes
        assert not (hit and passes)
    assert touching > 15
    assert passed > 50


def write_drum(path: Path, radius: float, height: float) -> None:
    """A round mesh about z, from 0 to its height [m]."""
    turns = np.linspace(0, 2 * np.pi, 73)
    rim = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    low, high = np.pad(rim, ((0, 0), (0, 1))), np.insert(rim, 2, height, axis=1)
    ends = low * 0, low * 0 + [0, 0, height]
    faces = [
        *zip(low, low[1:], high, strict=False),
        *zip(low[1:], high[1:], high, strict=False),
        *zip(ends[0], low[1:], low, strict=False),
        *zip(ends[1], high, high[1:], strict=False),
    ]
    corner = "vertex {:.9f} {:.9f} {:.9f}\n".format
    facets = "".join(
        f"facet normal 0 0 0\nouter loop\n{''.join(corner(*p) for p in face)}endloop\nendfacet\n"
        for face in faces
    )
    path.write_text(f"solid drum\n{facets}endsolid drum\n")


def test_parts_that_stay_near_each_other_keep_most_of_their_distance(tmp_path: Path) -> None:
    """A drum that circles the one on the base, 4 mm from it: bodies may take a third of that."""
    write_drum(tmp_path / "drum.stl", 0.06, 0.1)
    drum = '<collision><geometry><mesh filename="drum.stl"/></geometry></collision>'
    links = "".join(
        f'<link name="{name}">{shape}</link>'
        for name, shape in (("base", drum), ("one", ""), ("two", drum), ("far", drum))
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{a}"/><child link="{b}"/>'
        f'<origin xyz="{x} 0 {z}"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
        for name, a, b, x, z in (
            ("j1", "base", "one", 0, 0), ("j2", "one", "two", 0.124, 0), ("j3", "two", "far", 0, 1),
        )
    )  # fmt: skip
    path = tmp_path / "drums.urdf"
    path.write_text(f'<robot name="drums">{links}{joints}</robot>')
    robot = load_robot(path)
    judge = safe_constraints(robot, acceleration=np.full(3, 10.0), floor="none")
    q = np.random.default_rng(1).uniform(-3, 3, (50, 3))
    room = [judge.usage(a[None], a[None] * 0, a[None] * 0)["self_collision"] for a in q]
    assert min(a.value for a in room) > 0.0025
    assert max(a.value for a in room) < 0.004
    # What nothing is near is not made of more points than before.
    base, near, far = sorted(robot.bodies, key=lambda body: body.link)
    assert len(far.points) < min(len(base.points), len(near.points))


def test_what_a_coupled_branch_carries_is_not_certified(tmp_path: Path) -> None:
    """The rod of a palletiser: frozen, though the real one swings with the second joint."""
    box = '<geometry><box size="0.1 0.1 0.3"/></geometry>'
    links = "".join(
        f'<link name="{name}"><inertial><mass value="2"/>'
        f'<inertia ixx="0.0{k}" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
        f"<collision>{box}</collision></link>"
        for k, name in enumerate(("base", "one", "two", "end", "rod"), start=2)
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{a}"/><child link="{b}"/>'
        f'<origin xyz="0 {y} 0.4"/><axis xyz="0 1 0"/>{more}'
        '<limit lower="-2" upper="2" velocity="2" effort="200"/></joint>'
        for name, a, b, y, more in (
            ("j1", "base", "one", 0, ""), ("j2", "one", "two", 0, ""),
            ("j3", "two", "end", 0, ""), ("j4", "one", "rod", 0.3, '<mimic joint="j2"/>'),
        )
    )  # fmt: skip
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm">{links}{joints}</robot>')
    fixed = tmp_path / "fixed.toml"
    fixed.write_text('urdf = "arm.urdf"\nlocked = {j4 = 0.0}\n')
    move = Quintic(start=np.zeros(3), goal=np.array([0.2, 1, 0]), travel_time=4.0)
    found = dynid.check(move, robot=path, floor=-1.0).certificate
    assert {item.kind for item in found.unjudged} >= {"torque", "self_collision", "environment"}
    assert not {"self_collision", "environment"} & set(found.proven)
    assert dynid.check(move, robot=fixed, floor=-1.0).certificate.verdict == "certified"


@needs_models
def test_what_is_assumed_of_an_arm_stands_in_its_certificate() -> None:
    robot = load_robot(DATA / "so_arm_description" / "urdf" / "so100.urdf")
    judge = safe_constraints(robot, acceleration=np.full(5, 10.0))
    assert any("visual geometry: gripper, jaw" in note for note in judge.notes)
    assert any("frozen: gripper" in note for note in judge.notes)


@needs_models
def test_a_panda_is_judged_and_what_is_judged_is_proven() -> None:
    judge = safe_constraints(load_robot(PANDA), acceleration=np.full(7, 10.0))
    rest = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
    sine = np.zeros((7, 2))
    sine[3, 0] = 0.2
    certificate = certify(FourierSeries(period=10.0, offset=rest, a=sine, b=0 * sine), judge)
    assert certificate.worst["self_collision"].margin > 0.001
    assert "self_collision" in certificate.proven


@needs_models
def test_bodies_of_near_links_that_are_too_wide_are_named_and_nothing_is_called_proven() -> None:
    robot = load_robot("ur5")
    wide = Body(name="wide", link=5, points=np.zeros((1, 3)), radius=0.3)
    judge = safe_constraints(replace(robot, bodies=(*robot.bodies, wide)))
    assert any("wide are not judged" in note for note in judge.notes)
    assert judge.surroundings is not None
    assert judge.surroundings.lacking["self_collision"]
    assert "shoulder 1 - wide" in judge.surroundings.pairs["self_collision"].names
    assert "forearm 1 - wide" not in judge.surroundings.pairs["self_collision"].names


def test_causes_are_those_of_each_kind_and_notes_of_the_robot_are_none() -> None:
    robot = load_robot("ur5")
    wide = Body(name="wide", link=5, points=np.zeros((1, 3)), radius=0.3)
    noted = replace(robot, bodies=(*robot.bodies, wide), notes=("an axis made a unit axis",))
    judge = safe_constraints(noted)
    assert {item.kind for item in judge.unjudged} == {"self_collision"}
    bare = safe_constraints(replace(noted, bodies=()))
    (cause,) = next(item.causes for item in bare.unjudged if item.kind == "self_collision")
    assert cause.startswith("no bodies are known of the robot")
    assert "an axis made a unit axis" in bare.notes


@pytest.mark.parametrize("floor", ["none", -4.0])
def test_pairs_that_are_left_out_are_told_where_no_other_is_left(floor: float | str) -> None:
    arm = random_arm(2, 5, slides=False)
    wide = tuple(Body(name=f"b{k}", link=k, points=np.zeros((1, 3)), radius=0.3) for k in range(3))
    judge = safe_constraints(replace(arm, bodies=wide), floor=floor)
    assert judge.surroundings is None
    (item,) = judge.unjudged
    assert item.kind == "self_collision"
    assert item.causes == ("b0 and b2 are not judged: their bodies touch in 100% of poses",)


@needs_models
def test_a_larger_clearance_judges_no_pair_less() -> None:
    path = DATA / "talos_data" / "robots" / "talos_left_arm.urdf"
    required: dict[str, float] = {}
    for clearance in (0.001, 0.005, 0.01, 0.05):
        judge = safe_constraints(load_robot(path), clearance=clearance, floor="none")
        assert judge.surroundings is not None
        pairs = judge.surroundings.pairs["self_collision"]
        larger = dict(zip(pairs.names, pairs.required.tolist(), strict=True))
        assert all(larger.get(name, -1.0) >= least for name, least in required.items())
        required = larger
    held = required["arm_left_5_link 1 - wrist_left_ft_link 1"]
    assert held == pytest.approx(0.0068, abs=1e-4)
    assert any(f"the limit is {held:.4f} m" in note for note in judge.notes)


def test_what_a_robot_says_of_its_bodies_is_passed_on() -> None:
    built_in = load_robot("ur5")
    assert not any("mesh" in note for note in safe_constraints(built_in).notes)
    bare = replace(
        built_in,
        bodies=tuple(body for body in built_in.bodies if body.link != 4),
        body_notes=("a mesh was not found",),
    )
    judge = safe_constraints(bare)
    assert "a mesh was not found" in judge.notes
    assert any("wrist_1_joint" in note and "not judged" in note for note in judge.notes)
    # What is told as the cause of something unjudged is not told twice; words alike are.
    still = FourierSeries(offset=np.zeros(6), a=np.zeros((6, 1)), b=np.zeros((6, 1)), period=1.0)
    certificate = certify(still, judge)
    assert "a mesh was not found" in certificate.unjudged[0].to_json()["causes"]
    assert "a mesh" in replace(certificate, notes=(*certificate.notes, "a mesh")).assumed
    assert "a mesh was not found" not in certificate.assumed


def test_a_robot_without_bodies_is_not_judged() -> None:
    judge = safe_constraints(replace(load_robot("ur5"), bodies=()))
    assert judge.surroundings is None
    assert {item.kind for item in judge.unjudged} == {"self_collision", "environment"}
    # One reason, and one next step: shapes for the links.
    assert len({(item.causes, item.next_step) for item in judge.unjudged}) == 1


@needs_models
def test_the_limit_that_keeps_even_a_small_motion_from_being_found_is_named() -> None:
    arm = DATA / "hextilt_description" / "urdf" / "hextilt_flying_arm_5.urdf"
    with pytest.raises(InputError, match="not even a small one: self collision") as caught:
        dynid.design(arm, dynid.DesignSettings(starts=1, floor="none"))
    assert "--clearance" in (caught.value.next_step or "")
    assert "link_2" in str(caught.value.where)
