import re
from dataclasses import replace
from pathlib import Path

import clarabel
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_exports import estimate_of, mixed_chain, parameters_of
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation

from dynid.core import Array, JobError
from dynid.export import simulator_obstacle, write_model
from dynid.export.completion import PseudoInertias, complete, null_space
from dynid.identification import (
    StandardParameters,
    inertial_prior,
    read_estimate,
    write_estimate,
)
from dynid.reduction import random_states
from dynid.robot import (
    RobotModel,
    load_robot,
    robot_from_chain,
    to_pseudo_inertia,
    with_mount,
)

UR5 = load_robot("ur5")
# Torques of two sets of standard parameters that are the same to motion [N.m].
SAME = 1e-9
ROUNDING = 1e-6
"""The same where a least squares step took tens of newton metres back [N.m]."""
OFF_NOMINAL = 0.2
"""What a geometry that is off by 1 mm and 0.1 degree shows of possible bodies [N.m]."""
LACK = 2e-4
"""The barrier of the first phase ends within 1e-4 of the optimum."""


@given(st.integers(0, 1000))
@settings(max_examples=8)
def test_possible_bodies_are_found_where_there_are_some(seed: int) -> None:
    """Noise-free base parameters of possible bodies have a possible completion."""
    robot = mixed_chain() if seed % 2 else UR5
    truth = parameters_of(robot, seed)
    estimate = estimate_of(robot, truth)
    found = complete(estimate)
    assert found.physical
    assert found.worst == ""
    states = random_states(robot, 40, seed)
    ours = estimate.model.inverse_dynamics(*states, truth)
    theirs = estimate.model.inverse_dynamics(*states, found.values)
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=SAME * max(1.0, np.abs(ours).max()))
    links = to_pseudo_inertia(found.values[: 10 * robot.joints].reshape(-1, 10))
    assert (np.linalg.eigvalsh(links) > 0).all()
    assert (found.values[-robot.joints :] > 0).all()


def test_the_prior_comes_back_where_it_is_the_truth() -> None:
    """Data that confirm the prior leave it as it is, also where they say nothing."""
    model = estimate_of(UR5, parameters_of(UR5)).model
    prior = PseudoInertias.of(model, inertial_prior(UR5, model.frames).parameters).prior
    found = complete(estimate_of(UR5, prior))
    np.testing.assert_allclose(found.values, prior, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("known", [True, False])
def test_mass_that_motion_cannot_tell_from_a_slides_motor_is_the_bodys(known: bool) -> None:
    """URDF has no place for motor inertias: what may be mass must not be lost there."""
    gantry = robot_from_chain(
        placements=np.tile(np.eye(4), (3, 1, 1)),
        axes=np.eye(3),
        name="gantry",
        joint_types=["prismatic"] * 3,
    )
    mass, motor = np.array([15.0, 8.0, 4.0]), np.array([0.5, 0.4, 0.3])
    links = np.zeros((3, 10))
    links[:, 0], links[:, 4:7] = mass, 0.05
    if known:
        gantry = replace(gantry, inertias=links)
    truth = parameters_of(gantry)
    truth[:30], truth[-3:] = links.ravel(), motor
    found = complete(estimate_of(gantry, truth))
    assert found.physical
    moved = np.cumsum(found.values[:30:10][::-1])[::-1]
    total = np.cumsum(mass[::-1])[::-1] + motor
    # Gravity tells the last mass from its motor.
    np.testing.assert_allclose(moved[:2] / total[:2], 1.0, atol=0.02)
    assert moved[2] == pytest.approx(mass[2], rel=1e-6)


def test_it_is_the_nearest_of_all() -> None:
    """No step that motion does not show comes nearer to the prior."""
    estimate = estimate_of(UR5, parameters_of(UR5, 3))
    bodies = PseudoInertias.of(
        estimate.model, inertial_prior(UR5, estimate.model.frames).parameters
    )
    found, unseen = complete(estimate), null_space(estimate.model)
    best = bodies.divergence(found.values)[0]
    random = np.random.default_rng(0)
    for size in (1e-3, 1e-2, 0.1):
        for _ in range(20):
            step = unseen @ random.normal(size=unseen.shape[1])
            assert bodies.divergence(found.values + size * step)[0] >= best - 1e-9


def test_an_estimate_is_completed_once(tmp_path: Path) -> None:
    """Each file of a model, the verdict and the report read it again."""
    estimate = estimate_of(UR5, parameters_of(UR5))
    write_estimate(estimate, tmp_path / "estimate.json")
    found = complete(estimate)
    assert complete(read_estimate(tmp_path / "estimate.json")) is found
    assert complete(replace(estimate, values=1.01 * estimate.values)) is not found


def test_the_divergence_is_zero_at_the_prior_and_has_its_derivatives() -> None:
    model = estimate_of(UR5, parameters_of(UR5)).model
    bodies = PseudoInertias.of(model, inertial_prior(UR5, model.frames).parameters)
    assert bodies.divergence(bodies.prior)[0] == pytest.approx(0.0, abs=1e-5)
    values, step = parameters_of(UR5, 5), 1e-6
    _, gradient, curvature = bodies.divergence(values)
    for k in (0, 5, 13, 26, 44, 59, 62, 72, 77):
        move = np.zeros(len(values))
        move[k] = step
        before, after = bodies.divergence(values - move), bodies.divergence(values + move)
        slope = (after[0] - before[0]) / (2 * step)
        assert slope == pytest.approx(gradient[k], rel=1e-5, abs=1e-4 * np.abs(gradient).max())
        numeric = (after[1] - before[1]) / (2 * step)
        scale = np.abs(curvature[k]).max()
        np.testing.assert_allclose(curvature[k], numeric, rtol=0, atol=1e-5 * max(scale, 1.0))


def test_unseen_directions_are_unseen_and_all_of_them() -> None:
    for robot, rank in ((UR5, 52), (load_robot("ur5", mount="tilt:45"), 54)):
        model = estimate_of(robot, parameters_of(robot)).model
        unseen = null_space(model)
        assert unseen.shape == (78, 78 - rank)
        w = model.observation_matrix(*random_states(robot, 50, 9))
        assert np.abs(w @ unseen).max() < 1e-9 * np.abs(unseen).max() * np.abs(w).max()


@pytest.mark.parametrize("tilt", [1e-9, 1e-7, 1e-3])
def test_axes_nearly_parallel_keep_possible_bodies_possible(tilt: float) -> None:
    """A file's rounding, or a calibration, shows what the base parameters hold as one."""
    placements, random = UR5.placements.copy(), np.random.default_rng(0)
    turns = Rotation.from_rotvec(tilt * random.normal(size=(5, 3)))
    placements[1:, :3, :3] @= turns.as_matrix()
    robot = replace(UR5, placements=placements)
    truth = parameters_of(robot, 1)
    estimate = estimate_of(robot, truth)
    found = complete(estimate)
    assert found.physical
    states = random_states(robot, 40, 1)
    ours, theirs = (estimate.model.inverse_dynamics(*states, x) for x in (truth, found.values))
    assert np.abs(theirs - ours).max() < (SAME + tilt) * np.abs(ours).max()


def test_impossible_base_parameters_are_said_to_be(tmp_path: Path) -> None:
    truth = parameters_of(UR5, 2)
    # Motor 4 stands alone: no link can make up for a negative inertia.
    truth[75] = -0.2
    impossible = estimate_of(UR5, truth)
    found = complete(impossible)
    assert not found.physical
    assert found.worst == "motor inertia Im4"
    states = random_states(UR5, 40, 1)
    np.testing.assert_allclose(
        impossible.model.inverse_dynamics(*states, found.values),
        impossible.model.inverse_dynamics(*states, truth),
        rtol=0,
        atol=1e-7,
    )
    with pytest.raises(JobError, match="not physically consistent: motor inertia Im4") as caught:
        write_model(impossible, tmp_path / "arm.xml", "mjcf")
    assert "sdp" in str(caught.value)
    assert "Im4" in simulator_obstacle(impossible)
    assert not simulator_obstacle(estimate_of(UR5, parameters_of(UR5, 2)))
    assert list(tmp_path.iterdir()) == []
    for to in ("urdf", "json", "c", "python"):
        done = write_model(impossible, tmp_path / "arm", to)
        assert done.verified.passed
        assert not done.model.physical


def test_distant_centres_of_mass_are_written(tmp_path: Path) -> None:
    # As bad recordings have it: the tensor about the centre is the difference of 1e9 kg.m^2.
    truth = parameters_of(UR5, 0)
    truth[31], truth[33] = 1e4, -3e3
    done = write_model(estimate_of(UR5, truth), tmp_path / "arm.urdf", "urdf")
    assert done.verified.passed


def test_negative_friction_is_refused_before_loaders_do(tmp_path: Path) -> None:
    truth = parameters_of(UR5, 2)
    truth[61] = -0.5
    for to in ("mjcf", "urdf"):
        with pytest.raises(JobError, match="Coulomb friction of joint 2 is negative"):
            write_model(estimate_of(UR5, truth), tmp_path / "arm.xml", to)


def test_a_link_that_cannot_be_is_named() -> None:
    truth = parameters_of(UR5, 2)
    # An inertia about x far below what its own first moments ask for.
    estimate = estimate_of(UR5, truth)
    values = estimate.values.copy()
    values[[k for k, name in enumerate(estimate.names) if name == "Jxx4"]] -= 50.0
    found = complete(replace(estimate, values=values))
    assert not found.physical
    assert re.match("links? 4", found.worst)
    # The last digits, which differ from one BLAS kernel to another, do not change the names.
    random = np.random.default_rng(0)
    for _ in range(4):
        rounded = values * (1 + 1e-13 * random.normal(size=len(values)))
        assert complete(replace(estimate, values=rounded)).worst == found.worst


def calibrated(degrees: float, metres: float) -> RobotModel:
    """A UR5 whose axes are off as those of a calibrated one are."""
    random, placements = np.random.default_rng(3), UR5.placements.copy()
    turn = Rotation.from_rotvec(np.radians(degrees) * random.uniform(-1, 1, (5, 3))).as_matrix()
    placements[1:, :3, :3] = placements[1:, :3, :3] @ turn
    placements[1:, :3, 3] += metres * random.uniform(-1, 1, (5, 3))
    return replace(UR5, placements=placements)


@pytest.mark.parametrize("robot", [calibrated(0.1, 1e-3), with_mount(UR5, "tilt:0.9")])
@pytest.mark.parametrize("possible", [True, False])
def test_a_geometry_off_nominal_has_the_torques_that_are_predicted(
    robot: RobotModel, possible: bool
) -> None:
    """With the regrouping of the nominal geometry they were up to 11 N.m off."""
    estimate = estimate_of(robot, parameters_of(robot, 2))
    values = estimate.values.copy()
    if not possible:
        values[[name == "Jxx4" for name in estimate.names]] -= 50.0
    estimate = replace(estimate, values=values)
    found = complete(estimate)
    assert found.physical == possible
    states = random_states(robot, 50, 4, speed=1.0)
    off = estimate.model.inverse_dynamics(*states, found.values) - estimate.predict(*states)
    # Possible bodies have what a geometry off nominal shows of them, which is little.
    assert np.abs(off).max() < (OFF_NOMINAL if possible else ROUNDING)


def least_lack(bodies: PseudoInertias, start: Array, unseen: Array) -> float:
    """The least sum of the shares of their priors that bodies lack, by a conic solver."""
    apart = bodies.prior_by_body()
    motors = bodies.motors
    k, b = unseen.shape[1], apart.shape[1]
    rows, sides, cones = [-np.eye(k + b)[k:]], [np.zeros(b)], [clarabel.NonnegativeConeT(b)]
    moves = np.column_stack([unseen, apart])
    rows.append(-moves[motors])
    sides.append(start[motors])
    cones.append(clarabel.NonnegativeConeT(len(motors)))
    lower = [(i, j) for i in range(4) for j in range(i + 1)]
    at, weights = tuple(zip(*lower, strict=True)), [1.0 if i == j else 2**0.5 for i, j in lower]
    for link in range(bodies.links):
        mine = slice(10 * link, 10 * link + 10)
        sides.append(to_pseudo_inertia(start[mine])[at] * weights)
        rows.append(-(to_pseudo_inertia(moves[mine].T)[:, *at] * weights).T)
        cones.append(clarabel.PSDTriangleConeT(4))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cost = np.concatenate([np.zeros(k), np.ones(b)])
    solved = clarabel.DefaultSolver(
        csc_matrix((k + b, k + b)),
        cost,
        csc_matrix(np.vstack(rows)),
        np.concatenate(sides),
        cones,
        settings,
    ).solve()
    assert solved.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
    return float(solved.obj_val)


@pytest.mark.parametrize("seed", [8, 10, 24])
def test_impossible_bodies_lack_as_little_as_a_conic_solver_finds(seed: int) -> None:
    """On seeds whose masses come out positive, so that none is lifted afterwards."""
    random = np.random.default_rng(seed)
    estimate = estimate_of(UR5, parameters_of(UR5, seed))
    values = estimate.values * (1.0 + 0.5 * random.normal(size=len(estimate.values)))
    far = replace(estimate, values=values)
    bodies = PseudoInertias.of(far.model, inertial_prior(UR5, far.model.frames).parameters)
    least = least_lack(bodies, np.asarray(far.standard_parameters()), null_space(far.model))
    found = complete(far)
    lacking = float(np.maximum(bodies.shortfalls(found.values), 0.0).sum())
    assert not found.physical
    assert lacking == pytest.approx(least, rel=LACK)


def test_consistent_estimates_keep_their_parameters(tmp_path: Path) -> None:
    truth = parameters_of(UR5, 4)
    estimate = estimate_of(UR5, truth)
    p = len(truth)
    consistent = StandardParameters(
        values=truth,
        std=np.ones(p),
        prior_share=np.zeros(p),
        prior=np.full(p, np.nan),
        origins=("data",) * p,
    )
    found = complete(replace(estimate, standard=consistent))
    np.testing.assert_array_equal(found.values, truth)
    assert found.physical
    done = write_model(replace(estimate, standard=consistent), tmp_path / "arm.xml", "mjcf")
    assert done.verified.passed


def test_masses_are_positive_even_where_bodies_are_not(tmp_path: Path) -> None:
    """Base parameters of no bodies at all still make a URDF that loads and has our torques."""
    estimate = estimate_of(UR5, parameters_of(UR5, 2))
    random = np.random.default_rng(3)
    noise = random.normal(size=len(estimate.values))
    friction = [name.startswith("F") for name in estimate.names]
    wild = replace(estimate, values=np.where(friction, np.abs(noise), noise))
    found = complete(wild)
    assert not found.physical
    assert (found.values[: 10 * 6 : 10] > 0).all()
    done = write_model(wild, tmp_path / "arm.urdf", "urdf")
    assert done.verified.passed
    states = random_states(UR5, 40, 1)
    np.testing.assert_allclose(
        wild.model.inverse_dynamics(*states, found.values),
        wild.predict(*states),
        rtol=0,
        atol=1e-8,
    )
