import importlib.util
import tracemalloc
import warnings
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from structure_oracles import classify, first_come, found, names, observation, reduce, reduced

from dynid.core import InputError
from dynid.reduction import gram_layout, random_states, reduce_model
from dynid.reduction.base import acting_joints, rank_and_classes, regrouping
from dynid.regressor import FrictionTerms, Gear, InverseDynamicModel, LoadFriction, TorqueRipple
from dynid.robot import RobotModel, from_xyz_rpy, load_robot, robot_from_chain, with_mount

EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
ORACLE = Path(__file__).parents[3] / "shared" / "oracles" / "base_params_check.py"
SAME_TORQUE = 1e-10
"""Of the largest torque."""
SAME_REGROUPING = 1e-7
MEGABYTE = 2**20

ROBOTS = [
    ("ur5", "dh"),
    ("ur5", "urdf"),
    (str(EXAMPLES / "panda.toml"), "mdh"),
    (str(EXAMPLES / "kr300.toml"), "dh"),
    (str(EXAMPLES / "ur10_unisa.toml"), "urdf"),
]


def _chain(seed: int, joints: int) -> RobotModel:
    """A chain whose axes are parallel, square or skew by chance."""
    random = np.random.default_rng(seed)
    placements = np.tile(np.eye(4), (joints, 1, 1))
    for pose in placements:
        turn = np.eye(3)[random.permutation(3)] * random.choice([-1, 1], 3)[:, None]
        pose[:3, :3] = turn * np.linalg.det(turn)
        pose[:3, 3] = random.choice([0.0, 0.3, -0.5], 3)
    return robot_from_chain(
        name="chain",
        placements=placements,
        axes=np.tile([0.0, 0, 1], (joints, 1)),
        flange=np.eye(4),
        joint_types=[str(kind) for kind in random.choice(["revolute", "prismatic"], joints)],
    )


@given(
    robot=st.sampled_from([*ROBOTS, (str(EXAMPLES / "tx40.toml"), "urdf")]),
    seed=st.integers(0, 2**31),
)
@settings(derandomize=True, max_examples=30)
def test_base_parameters_give_the_torques_of_all_parameters(
    robot: tuple[str, str], seed: int
) -> None:
    base = reduced(*robot)
    random = np.random.default_rng(seed)
    parameters = random.normal(size=len(base.model.columns))
    state = random.uniform(-3, 3, (3, 8, base.model.robot.joints))
    stack = base.model.stack(*state)
    torque = np.tensordot(parameters, stack, axes=1)
    ours = np.tensordot(base.from_standard(parameters), stack[list(base.independent)], axes=1)
    np.testing.assert_allclose(ours, torque, rtol=0, atol=SAME_TORQUE * np.abs(torque).max())


@pytest.mark.parametrize(("name", "frames"), ROBOTS)
def test_structure_is_that_of_pinocchios_regressor(name: str, frames: str) -> None:
    base = reduced(name, frames)
    matrix = observation(base.model.robot, frames)
    assert found(base) == classify(matrix)
    independent, dependent, k = first_come(matrix)
    assert list(base.independent) == independent
    assert list(base.dependent) == dependent
    np.testing.assert_allclose(base.regrouping, k, rtol=0, atol=SAME_REGROUPING * np.abs(k).max())


@pytest.mark.parametrize("seed", range(12))
def test_structure_of_any_chain_is_that_of_pinocchios_regressor(seed: int) -> None:
    robot = _chain(seed, joints=2 + seed % 4)
    for frames in robot.parameter_frames:
        base = reduce(robot, frames)
        matrix = observation(robot, frames)
        assert found(base) == classify(matrix)
        assert list(base.independent) == first_come(matrix)[0]


@pytest.mark.parametrize(
    ("name", "frames", "rank"),
    [
        ("gen3.toml", "dh", 62),
        ("gen3.toml", "urdf", 62),
        ("tx40.toml", "urdf", 55),
        ("tx40.toml", "dh", 55),
    ],
)
def test_other_arms_keep_their_rank(name: str, frames: str, rank: int) -> None:
    base = reduced(str(EXAMPLES / name), frames)
    assert base.rank == base.classes.rank == rank


def test_a_coupled_wrist_adds_three_columns_alone() -> None:
    coupled = reduced(str(EXAMPLES / "tx40.toml"), "urdf")
    plain = reduced(str(EXAMPLES / "tx40.urdf"), "urdf")
    assert coupled.rank == plain.rank + 3
    added = {"Fcm6", "Fvm6", "Imm6"}
    assert added <= names(coupled, coupled.classes.alone)
    assert found(plain) == classify(observation(plain.model.robot, "urdf"))


def test_the_offsets_of_gen3_are_one_notice() -> None:
    (notice,) = reduced(str(EXAMPLES / "gen3.toml"), "dh").warnings
    # Axes 6 and 7 miss each other's neighbours by 0.35 mm; its rounded angles are not told.
    assert "joint_6" in notice.message
    assert "deg" not in notice.message


def _oracle() -> ModuleType:
    if not ORACLE.is_file():
        pytest.skip(f"the independent check {ORACLE} is not on this machine")
    spec = importlib.util.spec_from_file_location("base_params_check", ORACLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with np.printoptions():
        spec.loader.exec_module(module)
    if module.find_urdf() is None:
        pytest.skip("example-robot-data is not installed")
    return module


@pytest.mark.parametrize(
    ("frames", "builder"), [("dh", "model_std_dh"), ("mdh", "model_mod_dh"), ("urdf", "model_urdf")]
)
def test_the_independent_check_finds_the_same(frames: str, builder: str) -> None:
    oracle = _oracle()
    with warnings.catch_warnings():
        # The check leaves its URDF file open.
        warnings.simplefilter("ignore", ResourceWarning)
        model, poses = getattr(oracle, builder)((0, 0, -9.81))
    matrix = oracle.stack(model, poses, *oracle.rand_state(100, seed=9))
    rank, alone, combined, none, _, _ = oracle.classify(matrix, 1e-9)
    base = reduced("ur5", frames)
    assert found(base) == (rank, tuple(alone), tuple(combined), tuple(none))
    independent, dependent, k = oracle.qr_base(matrix)
    assert (base.independent, base.dependent) == (tuple(independent), tuple(dependent))
    if frames == "dh":
        np.testing.assert_allclose(base.regrouping, k, rtol=0, atol=SAME_REGROUPING)


def test_a_seed_gives_the_same_bits_and_any_seed_the_same_structure() -> None:
    model = InverseDynamicModel(robot=load_robot("ur5"))
    first, again = (reduce_model(model, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.regrouping, again.regrouping)
    np.testing.assert_array_equal(first.singular_values, again.singular_values)
    for other in (reduce_model(model, seed=seed, samples=40) for seed in range(4)):
        assert (other.independent, other.dependent) == (first.independent, first.dependent)
        assert found(other) == found(first)
        assert not np.array_equal(other.singular_values, first.singular_values)
        np.testing.assert_allclose(
            other.regrouping, first.regrouping, rtol=SAME_REGROUPING, atol=SAME_REGROUPING
        )


@pytest.mark.parametrize("kinds", ["rppp", "ppp", "pppprr", "ppppppp"])
def test_an_arm_of_slides_keeps_the_friction_of_every_joint(kinds: str) -> None:
    random, joints = np.random.default_rng(3), len(kinds)
    placements, axes = np.tile(np.eye(4), (joints, 1, 1)), random.normal(size=(joints, 3))
    placements[:, :3, 3] = random.uniform(-0.3, 0.3, (joints, 3))
    robot = robot_from_chain(
        name="gantry",
        placements=placements,
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        joint_types=[{"r": "revolute", "p": "prismatic"}[kind] for kind in kinds],
    )
    base = reduce_model(InverseDynamicModel(robot=robot))
    assert base.rank == base.classes.rank
    assert {f"Fc{j + 1}" for j in range(joints)} <= set(base.names)


def test_few_points_are_raised_and_many_need_little_memory() -> None:
    model = InverseDynamicModel(robot=load_robot("ur5"))
    assert reduce_model(model, samples=1).samples == 20
    tracemalloc.start()
    try:
        base = reduce_model(model, samples=2000)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (base.samples, base.rank) == (2000, 52)
    # The matrix has 7.5 MB; an orthonormal basis of its 12000 rows would have 1150 MB.
    assert peak < 100 * MEGABYTE


def test_a_single_joint_shows_gravity_inertia_and_friction() -> None:
    robot = robot_from_chain(
        name="pendulum",
        placements=np.array([[[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0.3], [0, 0, 0, 1]]]),
        axes=np.array([[0.0, 0, 1]]),
        flange=np.eye(4),
    )
    base = reduce(robot, "urdf")
    assert base.names == ("mx1", "my1", "Jzz1", "Fc1", "Fv1")
    assert base.expressions[2] == "Jzz1 + Im1"
    slide = replace(robot, joint_types=("prismatic",))
    assert reduce(slide, "urdf").expressions[0] == "m1 + Im1"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": 0}, "samples: needs at least one sample; got 0"),
        ({"tolerance": 0.0}, "tolerance outside"),
        ({"tolerance": 1.0}, "tolerance outside"),
        ({"tolerance": float("nan")}, "tolerance outside"),
    ],
)
def test_bad_options_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        reduce_model(InverseDynamicModel(robot=load_robot("ur5")), **options)  # type: ignore[arg-type]


def test_a_rank_without_a_clear_gap_is_said() -> None:
    robot = load_robot("ur5")
    # So wide a step is a straight line: Coulomb friction looks like viscous friction.
    wide = InverseDynamicModel(robot=robot, friction=FrictionTerms(width=1e3))
    (notice,) = reduce_model(wide).warnings
    assert notice.code == "ill_conditioned"
    assert "rank 52 has no clear gap" in notice.message
    cut = reduce_model(InverseDynamicModel(robot=robot), tolerance=0.2).warnings
    assert any("no clear gap" in notice.message for notice in cut)
    assert any("the tolerance cuts through" in notice.message for notice in cut)


def test_rounding_is_no_term_of_a_base_parameter() -> None:
    # An offset and |sign| differ at the slowest points alone: all else hangs on that difference.
    base = reduced(terms="fc,fv,im,fo,fs,fca")
    assert {f"Fo{j}" for j in range(2, 7)} <= set(base.expressions)


def test_a_right_angle_of_few_digits_makes_no_huge_term_of_a_base_parameter() -> None:
    # The axis of joint 1 has no part along z of link 2, but for the digits of 1.5708.
    poses = (
        ([0, 0.15, 3.0], [0, 0.4, 0]),
        ([0, 0, 0.6], [1.5708, 0, 0]),
        ([0, 0.15, 0.4], [0, 0, 1.5708]),
    )
    robot = robot_from_chain(
        placements=np.array([from_xyz_rpy(*pose) for pose in poses]),
        axes=np.array([[0.6, 0.0, 0.8], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        joint_types=["revolute", "prismatic", "prismatic"],
    )
    base = reduce_model(InverseDynamicModel(robot=robot, frames="urdf"))
    assert base.rank == 17
    assert np.abs(base.regrouping).max() < 10


@pytest.mark.parametrize("seed", [182, 265, 393])
def test_rounding_is_no_base_parameter(seed: int) -> None:
    """A column of which 3e-5 is its own made a parameter of the rounding of a later one."""
    random = np.random.default_rng(seed)
    poses = [from_xyz_rpy(random.uniform(-0.4, 0.4, 3), random.uniform(-3, 3, 3)) for _ in range(7)]
    axes = random.normal(size=(7, 3))
    robot = robot_from_chain(
        placements=np.array(poses), axes=axes / np.linalg.norm(axes, axis=1)[:, None]
    )
    base = reduce_model(InverseDynamicModel(robot=robot, frames="urdf"))
    before, after = base.classes.gap
    assert before > 1e-3
    assert after < 1e-14
    assert (base.rank, base.classes.rank) == (65, 65)


def test_columns_of_any_size_and_order_are_told_apart() -> None:
    random = np.random.default_rng(1)
    inner = random.normal(size=(50, 3))
    factors = np.array([[2.0, 0, 0], [0, 0.01, 0], [0, 0, 100.0]])
    zero, sums = np.zeros((50, 1)), inner @ factors @ np.array([[1.0, 0], [1, 0], [0, 4]])
    matrix = np.hstack([zero, inner @ factors, sums, zero])
    kinds = rank_and_classes(matrix)
    assert kinds.rank == 3
    assert (kinds.alone, kinds.combined, kinds.unidentifiable) == ((), (1, 2, 3, 4, 5), (0, 6))
    independent, dependent, k = regrouping(matrix)
    assert (independent, dependent) == ((1, 2, 3), (0, 4, 5, 6))
    expected = np.array([[0, 1.0, 0, 0], [0, 1, 0, 0], [0, 0, 4, 0]])
    np.testing.assert_allclose(k, expected, rtol=1e-6, atol=1e-6)


def test_a_geometry_that_creates_no_parameters_keeps_its_own_base() -> None:
    right, shift = np.pi / 2, (0.3, 0.3, 0.0)
    # Joint 3 leans by 0.4 degrees on purpose, which makes no parameter more.
    rows = [
        ("prismatic", shift, (right, np.pi, -right), (0, 0, 1.0)),
        ("revolute", shift, (0.4, 0.4, -right), (0, 1.0, 0)),
        ("prismatic", (0, 0, 0.3), (0, 0, 0.4), (-0.686756430104, -0.309840967612, 0.005234596171)),
        ("revolute", shift, (right, 0.4, 0.4), (0, 0, 1.0)),
        ("prismatic", (-0.2, -0.2, 0), (-right, right, np.pi), (0.712154, 0.896586, -0.317893)),
    ]
    axes = np.array([axis for *_, axis in rows])
    robot = robot_from_chain(
        placements=np.array([from_xyz_rpy(x, r) for _, x, r, _ in rows]),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        joint_types=[kind for kind, *_ in rows],
    )
    robot = with_mount(robot, "tilt:37")
    for frames in robot.parameter_frames:
        base = reduce(robot, frames)
        matrix = base.model.observation_matrix(*random_states(robot, 100, seed=3))
        seen = rank_and_classes(matrix[:, list(base.independent)]).rank
        assert seen == base.rank == classify(observation(robot, frames)).rank


def test_random_states_reach_every_joint_in_its_own_unit() -> None:
    robot = replace(_chain(1, 3), joint_types=("revolute", "prismatic", "revolute"))
    q, dq, ddq = random_states(robot, 4000, seed=2)
    np.testing.assert_allclose(np.abs(q).max(axis=0), [np.pi, 1, np.pi], rtol=0.01, atol=0)
    np.testing.assert_allclose(np.abs(dq).max(axis=0), np.pi, rtol=0.01, atol=0)
    np.testing.assert_allclose(np.abs(ddq).max(axis=0), 5.5 * np.pi, rtol=0.01, atol=0)
    np.testing.assert_array_equal(random_states(robot, 4000, seed=2)[0], q)


@pytest.mark.parametrize(("robot", "frames"), ROBOTS[:3])
def test_panels_hold_the_columns_that_load_their_joint(robot: str, frames: str) -> None:
    base = reduce(load_robot(robot), frames, "fc,fv,im,fo")
    model = base.model
    n, layout = model.robot.joints, gram_layout(model, base)
    states = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 20, n))
    stack = model.stack(*states)[list(base.independent)]
    ends = [0]
    for j, panel in enumerate(layout.panels):
        loads = set(np.flatnonzero(np.abs(stack[:, j]).max(axis=1) > 0).tolist())
        assert loads <= set(panel.columns.tolist())
        columns = [base.independent[k] for k in panel.columns]
        assert panel.beside.tolist() == [c - 10 * n for c in columns if c >= 10 * n]
        links = [c for c in columns if c < 10 * n]
        assert links == sorted(links, reverse=True)
        assert all(c // 10 >= j for c in links)
        assert panel.rows.stop - panel.rows.start == len(columns)
        assert panel.rows.start - ends[-1] >= 1
        ends.append(panel.rows.stop)
        for row, c in enumerate(columns, start=panel.rows.start):
            assert c >= 10 * n or layout.places[c // 10, j, c % 10] == row
    assert (layout.places >= 0).sum() == sum(len(p.columns) - len(p.beside) for p in layout.panels)
    assert ends[-1] <= layout.rows
    assert layout.rank == base.rank


@pytest.mark.parametrize("robot", ["ur5", str(EXAMPLES / "tx40.toml")])
def test_columns_beside_the_links_act_where_the_regressor_says(robot: str) -> None:
    arm = load_robot(robot)
    n = arm.joints
    gear = Gear(joint=1, waves=(3.0,), speed=1.0, powers=1)
    ripple = TorqueRipple(joint=4, gears=(gear,), coefficients=(0.3, 0.4))
    load = LoadFriction(joints=(0, 2), parameters=tuple(np.ones(10 * n)))
    terms = (("fc", None), ("fv", None), ("im", (1, 3)), ("fo", (2,)), ("fs", None))
    friction = FrictionTerms(terms=terms, load=load, ripples=(ripple,))
    model = InverseDynamicModel(robot=arm, friction=friction)
    q, dq, ddq = random_states(arm, 30, seed=3)
    beside = model.stack(q, dq, ddq)[10 * n :]
    np.testing.assert_array_equal(acting_joints(model), np.abs(beside).max(axis=2) > 0)
    filled = np.zeros_like(beside)
    model.fill_beside(dq.T, ddq.T, filled)
    own = model.beside
    np.testing.assert_array_equal(filled[:own], beside[:own])
    assert not filled[own:].any()
    assert len(beside) - own == 3


def test_a_sharp_stribeck_peak_stands_in_its_joints_panel() -> None:
    # A hundredth is what sliding joints have by default [m/s].
    friction = FrictionTerms(terms=(("fs", None), ("fv", None)), stribeck_velocity=0.01)
    base = reduce_model(InverseDynamicModel(robot=load_robot("ur5"), friction=friction))
    panels = gram_layout(base.model, base).panels
    there = {base.names[k] for panel in panels for k in panel.columns}
    assert {f"Fs{j + 1}" for j in range(6)} <= there
