"""Choices by what is left out: blocks, regions, the prior, left-out errors and intervals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from known_robot import NOISE, recording, torques, ur5
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from dynid import identify, verdict
from dynid.core import Array, InputError
from dynid.identification import (
    CENTRE_SPREAD_M,
    MASS_SPREAD,
    TENSOR_SPREAD,
    IdentificationProblem,
    TowardPublished,
    WeightedLeastSquares,
    deviations,
    inertial_prior,
    not_negative,
    published_prior,
    read_estimate,
    standard_posterior,
    write_estimate,
)
from dynid.identification.selection.candidates import (
    DISPLACEMENTS,
    LEVER,
    WIDTHS,
    CandidateColumns,
    JointChoice,
    chosen_friction,
)
from dynid.identification.selection.gram import (
    NormalEquations,
    Shrinkage,
    gram_blocks,
    shared_picks,
    signed_solutions,
    solutions,
)
from dynid.identification.selection.regions import (
    MOST_ALONE,
    divided,
    find_regions,
    moving_rows,
)
from dynid.identification.selection.scoring import PRIOR_WEIGHTS, Scores, ScoreSearch, gain_of
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import RobotModel, load_robot
from dynid.signals import ProcessingSettings, process, uniform_signals
from dynid.trajectory import random_excitation
from dynid.workflow import IdentifySettings
from dynid.workflow.identify import gains_nothing

pytestmark = pytest.mark.usefixtures("undiagnosed")

SAME = 1e-6
NEAR = 1.25
"""What holding unknowns for good may cost against the constrained minimum."""


def test_friction_and_motor_inertia_only() -> None:
    model = InverseDynamicModel(robot=ur5())
    signed = {name for name, yes in zip(model.names, not_negative(model), strict=True) if yes}
    assert signed == {f"{symbol}{j}" for symbol in ("Fc", "Fv", "Im") for j in range(1, 7)}


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000))
def test_close_to_the_constrained_minimum(seed: int) -> None:
    generator = np.random.default_rng(seed)
    matrix = generator.normal(size=(40, 6))
    matrix /= np.linalg.norm(matrix, axis=0)
    target = generator.normal(size=40)
    all_signed = np.ones(6, dtype=bool)
    found = signed_solutions((matrix.T @ matrix)[None], (matrix.T @ target)[None], all_signed)[0]
    assert found.min() > -SAME
    _, least = nnls(matrix, target)
    assert least <= np.linalg.norm(matrix @ found - target) * (1 + SAME)
    assert np.linalg.norm(matrix @ found - target) <= NEAR * least


def test_free_unknowns_stay_free() -> None:
    generator = np.random.default_rng(0)
    matrix = generator.normal(size=(40, 5))
    truth = np.array([1.0, -2.0, 3.0, -4.0, 5.0])
    normal, right = matrix.T @ matrix, matrix.T @ matrix @ truth
    positive = np.array([True, False, True, False, True])
    found = signed_solutions(np.stack([normal] * 2), np.stack([right] * 2), positive)
    np.testing.assert_allclose(found, [truth, truth], rtol=0, atol=SAME)


def test_the_columns_that_a_joint_may_take_know_their_signs() -> None:
    columns = CandidateColumns(
        stepped=(("fc", None),),
        extras=("fo", "fca", "fr", "fl"),
        stribeck_velocity=(0.1,),
        levers=np.ones(1),
        unit=np.ones(1),
    )
    width = len(WIDTHS)
    expected = [True] * width + [False, False, True] + [True] * width
    assert columns.positive.tolist() == expected
    assert columns.places(0, 2, frozenset({1, 3})) == (2, width + 1, width + 3 + 2)


def test_a_joint_that_slides_tries_its_own_widths_and_displacements() -> None:
    columns = CandidateColumns(
        stepped=(("fc", None),),
        extras=("fs",),
        stribeck_velocity=(0.1, 0.1 * LEVER),
        levers=np.array([1.0, LEVER]),
        unit=np.array([1.0, LEVER]),
        displacements=DISPLACEMENTS,
    )
    dq, states = np.linspace(-1, 1, 21), np.zeros((len(DISPLACEMENTS), 21))
    turning, sliding = (columns.values(j, by * dq, dq, states) for j, by in ((0, 1.0), (1, LEVER)))
    np.testing.assert_allclose(sliding, turning, atol=SAME)
    choices = (JointChoice(0, frozenset(), 1), JointChoice(2, frozenset()))
    found = chosen_friction(choices, columns, None)
    assert found.width == (WIDTHS[0], LEVER * WIDTHS[2])
    assert found.presliding == (DISPLACEMENTS[1], 0.0)
    assert found.stribeck_velocity == (0.1, 0.1 * LEVER)


def test_blocks_leave_out_what_least_squares_on_the_other_rows_leaves_out() -> None:
    generator = np.random.default_rng(3)
    joints, unknowns, rows = 2, 4, 90
    columns = generator.normal(size=(unknowns, joints, rows))
    torque = generator.normal(size=(joints, rows))
    labels = np.tile(np.arange(rows) % 3, (joints, 1))
    parts = [
        (slice(a, a + 45), np.concatenate([columns, torque[None]])[:, :, a : a + 45])
        for a in (0, 45)
    ]
    weights = np.array([1.0, 2.0])
    blocks = gram_blocks(parts, labels, 3, unknowns + 1)
    system = NormalEquations(blocks, shared_picks(unknowns, joints), weights)
    values = system.left_out(None)
    errors = system.square_errors(values)
    for k in range(3):
        here = labels[0] == k
        stacked = np.concatenate([w * columns[:, j, ~here].T for j, w in enumerate(weights)])
        target = np.concatenate([w * torque[j, ~here] for j, w in enumerate(weights)])
        expected = np.linalg.lstsq(stacked, target, rcond=None)[0]
        np.testing.assert_allclose(values[k], expected, atol=1e-5)
        left = torque[:, here] - np.tensordot(expected, columns[:, :, here], axes=1)
        np.testing.assert_allclose(errors[:, k], np.square(left).sum(axis=1), rtol=1e-4)
    merged = blocks.merged(np.array([0, 1, -1]))
    assert merged.rows.tolist() == [[30, 30]] * 2


def test_friction_that_left_out_parts_alone_show_stays_small() -> None:
    # An inertia with a prior, and friction of a joint that all but rests elsewhere.
    matrix = np.array([np.eye(2), np.diag([1.0, 1e-10])])
    prior = Shrinkage(mean=np.zeros(2), precision=np.diag([1e-8, 0.0]))
    found = solutions(matrix, np.array([[1.0, 1.0], [1.0, 1e-6]]), prior)
    np.testing.assert_allclose(found, [[1.0, 1.0], [1.0, 10.0]], rtol=2e-3)


def test_regions_know_no_order_and_no_rest() -> None:
    generator = np.random.default_rng(0)
    first, second = generator.uniform(-2, 2, (2, 400, 6)).cumsum(axis=1) * 0.05
    standing = np.concatenate([np.repeat(first[:1], 3000, axis=0), first])
    one, other = (find_regions(q, (False,) * 6) for q in ([first, second], [second, first]))
    rested = find_regions([standing, second], (False,) * 6)
    for k in (0, 1):
        np.testing.assert_array_equal(one.centres[k], other.centres[k])
        np.testing.assert_allclose(one.centres[k], rested.centres[k], atol=1e-6)


def test_a_reversal_is_motion_and_a_stop_is_rest() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    dq = np.where(t < 5.0, np.sin(2.0 * t), 0.0)[:, None]
    moves = moving_rows([dq], 100.0)[0][:, 0]
    assert moves[(t > 1.0) & (t < 4.8)].all()
    assert not moves[t > 5.2].any()
    # A rate as stamps from 100 s on give it.
    np.testing.assert_array_equal(moving_rows([dq], 100.00000000000014)[0][:, 0], moves)


def test_a_stronger_prior_may_cost_an_error_of_few_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last costs 0.0132: a standard error of four parts is 0.0121, Student's 0.0145."""
    apart = 0.007 * np.array([1.0, -1.0, 1.0, -1.0])

    def scores(_: object, __: object, ___: object, weight: float) -> Scores:
        step = PRIOR_WEIGHTS.index(weight)
        dearer = np.ones((6, 4)) + 4e-4 * step + apart * (step > 0)
        return Scores(errors=(dearer,), rows=(np.ones((6, 4)),))

    plain = ProcessingSettings()
    signals = uniform_signals(recording(0), ur5(), plain)
    search = ScoreSearch(
        ur5(), ur5().default_frames, [signals], None, presliding=False, purpose="anywhere"
    )
    for name in ("blocks", "weights"):
        monkeypatch.setattr(search, name, lambda *_: None)
    monkeypatch.setattr(search, "scores", scores)
    assert search.prior_weights(plain, (), 1.0)[0][-1] == PRIOR_WEIGHTS[-1]


@settings(max_examples=100)
@given(seed=st.integers(0, 10_000))
def test_what_is_left_shows_each_joint_in_motion(seed: int) -> None:
    generator = np.random.default_rng(seed)
    counts = generator.integers(50, 200, 3)
    recordings = np.repeat(np.arange(3), counts)
    parts = generator.integers(0, 4, counts.sum())
    # Each recording moves some joints.
    moves = (generator.random((3, 4)) < 0.5)[recordings] & (generator.random((counts.sum(), 4)) < 1)
    found = divided(parts, moves, recordings)
    for part in np.unique(found):
        assert (moves[found == part].sum(axis=0) <= MOST_ALONE * moves.sum(axis=0)).all()
        assert len(set(parts[found == part])) == 1
    order = np.argsort(-recordings, kind="stable")
    other = divided(parts[order], moves[order], recordings[order])
    np.testing.assert_array_equal(other, found[order])
    assert not divided(np.zeros(len(parts), dtype=int), moves, recordings).any()


def written_with(robot: RobotModel, decimals: int) -> RobotModel:
    """The robot with rounded fixed rotations, as files write them."""
    placements = robot.placements.copy()
    for place in placements:
        place[:3, :3] = Rotation.from_euler(
            "xyz", Rotation.from_matrix(place[:3, :3]).as_euler("xyz").round(decimals)
        ).as_matrix()
    return replace(robot, placements=placements)


@pytest.mark.parametrize("decimals", [16, 10, 7, 5, 3])
def test_published_inertias_leave_friction_and_motor_inertia_alone(decimals: int) -> None:
    base = reduce_model(InverseDynamicModel(robot=written_with(ur5(), decimals)))
    prior = published_prior(base)
    model, inertial = base.model, 60
    parameters = np.zeros(len(model.columns))
    parameters[:inertial] = inertial_prior(model.robot, model.frames).parameters.ravel()
    np.testing.assert_allclose(prior.mean, base.from_standard(parameters), atol=1e-9)
    scale = np.abs(prior.root).max()
    for column in range(inertial, len(model.columns)):
        unit = np.zeros(len(model.columns))
        unit[column] = 1.0
        assert np.abs(prior.root @ base.from_standard(unit)).max() < SAME * scale
    # Elsewhere a deviation costs: a heavier forearm is seen.
    unit = np.zeros(len(model.columns))
    unit[20] = 1.0
    assert np.linalg.norm(prior.root @ base.from_standard(unit)) > 0.1


def test_published_links_are_off_as_real_ones_are() -> None:
    robot = load_robot("ur10e")
    link = 1
    root = deviations(robot, "urdf")[10 * link : 10 * link + 10, 10 * link : 10 * link + 10]
    row = inertial_prior(robot, "urdf").parameters[link]
    mass, centre = row[0], row[1:4] / row[0]

    def steiner(at: Array) -> Array:
        """Ten parameters of a unit mass."""
        x, y, z = at
        second = [y * y + z * z, x * x + z * z, x * x + y * y, -y * z, -x * z, -x * y]
        return np.array([1.0, x, y, z, *second])

    heavier = MASS_SPREAD * mass * steiner(centre)
    shift = np.array([0.0, 0.0, CENTRE_SPREAD_M])
    moved = mass * (steiner(centre + shift) - steiner(centre - shift)) / 2
    tensor = row - mass * steiner(centre)
    wider = TENSOR_SPREAD / np.sqrt(3.0) * tensor * (np.arange(10) >= 4)
    for off in (heavier, moved, wider):
        assert np.linalg.norm(np.linalg.solve(root, off)) == pytest.approx(1.0, abs=SAME)
    # Without published tensors masses are known no less.
    guessed = deviations(ur5(), "urdf")
    known = inertial_prior(ur5(), "urdf").parameters[:, 0]
    spread = np.linalg.norm(guessed[::10], axis=1)
    np.testing.assert_allclose(spread, MASS_SPREAD * known)


def test_a_strong_prior_gives_the_published_inertias_and_a_weak_one_least_squares() -> None:
    samples = process(recording(0, seconds=12.0), ur5())
    base = reduce_model(InverseDynamicModel(robot=ur5()))
    problem = IdentificationProblem(base=base, samples=samples)
    prior = published_prior(base)
    strong = TowardPublished(weight=1e6).fit(problem).values
    weak = TowardPublished(weight=1e-12).fit(problem).values
    plain = WeightedLeastSquares(prior_gain=1.0).fit(problem).values
    np.testing.assert_allclose(prior.root @ strong, prior.root @ prior.mean, atol=1e-2)
    np.testing.assert_allclose(weak, plain, rtol=1e-3, atol=1e-4)


def test_an_estimate_carries_left_out_errors_models_and_intervals(tmp_path: Path) -> None:
    run = recording(0, seconds=20.0)
    result = identify(run, ur5(), IdentifySettings(preset="paper"), validation=recording(5))
    told = result.estimate.assessment
    assert told is not None
    assert list(told.models) == [
        "published",
        "published_friction",
        "identified",
    ]
    assert (told.this_motion <= 1.5 * told.anywhere).all()
    assert (told.noise_floor <= told.this_motion).all()
    assert result.to_json()["assessment"]["left_out_rms"]["anywhere"] == told.anywhere.tolist()
    (finding,) = gains_nothing(replace(result.estimate, assessment=replace(told, pays=False)))
    assert finding.code == "weak_excitation"
    assert not list(gains_nothing(replace(result.estimate, assessment=replace(told, pays=True))))
    write_estimate(result.estimate, tmp_path / "e.json")
    read = read_estimate(tmp_path / "e.json")
    q = np.random.default_rng(1).uniform(-3, 3, (50, 6))
    zero = np.zeros_like(q)
    found = result.estimate.predict(q, zero + 0.5, zero, interval=0.9)
    again = read.predict(q, zero + 0.5, zero, interval=0.9)
    np.testing.assert_allclose(again.half_width, found.half_width, rtol=1e-9)
    np.testing.assert_array_equal(found.torque, result.estimate.predict(q, zero + 0.5, zero))
    wide = result.estimate.half_width(q, zero + 0.5, zero, level=0.99)
    assert (wide >= found.half_width).all()
    # Twice as fast as anything recorded, the interval is wider.
    fast = result.estimate.half_width(q, zero + 20.0, zero + 100.0)
    assert (fast > 2.0 * found.half_width).all()
    # Where a joint errs at rest alone, what is unsure of its parameters is no less in motion.
    calm = replace(told.interval, quantiles=0.0 * told.interval.quantiles)
    sure = replace(calm, root=0.0 * calm.root)
    unsure, known = (
        replace(result.estimate, assessment=replace(told, interval=interval)).half_width(
            q, zero + 0.5, zero
        )
        for interval in (calm, sure)
    )
    assert (unsure > known).all()
    with pytest.raises(InputError, match="level"):
        result.estimate.half_width(q, zero, zero, level=1.5)
    with pytest.raises(InputError, match="no torque intervals"):
        replace(result.estimate, assessment=None).half_width(q, zero, zero)


def test_slower_motions_are_expected_to_err_as_slow_parts_of_the_recording_do(
    tmp_path: Path,
) -> None:
    """Friction that turns round more slowly than the model's, on a motion a third as fast."""
    run = recording(0, seconds=20.0, noise=0.2, width=0.1)
    result = identify(run, ur5(), IdentifySettings(preset="paper"))
    series = random_excitation(ur5().limits, seed=3, period_s=100.0)
    t = np.arange(1000) / 10.0
    slow, told = series.evaluate(t), result.estimate.assessment
    assert told is not None
    error = result.estimate.predict(slow.q, slow.dq, slow.ddq) - torques(series, t, 0.1)
    true = np.sqrt(np.square(error).mean(axis=0))
    square, doubt = told.squares_at(slow.dq)
    # Friction that turns round is no noise.
    np.testing.assert_allclose(told.noise_floor, 0.2 * NOISE, rtol=0.1)
    expected = np.sqrt(square - np.square(told.noise_floor))
    np.testing.assert_allclose(expected, true, rtol=0.2)
    assert np.linalg.norm(told.anywhere) < 0.75 * np.linalg.norm(true)
    assert (doubt > 0).all()
    assert "at 1/10 of the speed the model error is" in verdict(result).prediction.reason
    write_estimate(result.estimate, tmp_path / "e.json")
    read = read_estimate(tmp_path / "e.json").assessment
    assert read is not None
    np.testing.assert_array_equal(read.squares_at(slow.dq), told.squares_at(slow.dq))
    # Of before 0.2, no speeds are told apart.
    data = json.loads((tmp_path / "e.json").read_text())
    del data["assessment"]["by_speed"]
    (tmp_path / "e.json").write_text(json.dumps(data))
    read = read_estimate(tmp_path / "e.json").assessment
    assert read is not None
    np.testing.assert_allclose(read.squares_at(slow.dq), [told.anywhere**2, np.zeros(6)])


def test_the_noise_floor_leaves_out_what_changes_slowly() -> None:
    drift = np.sin(2 * np.pi * np.arange(2500) / 125.0 / 7.0)[:, None] * NOISE
    run = recording(0, seconds=20.0, offset=drift)
    told = identify(run, ur5(), IdentifySettings(preset="paper")).estimate.assessment
    assert told is not None
    np.testing.assert_allclose(told.noise_floor, NOISE, rtol=0.06)
    assert (told.this_motion > 1.15 * told.noise_floor).all()


def test_standard_parameters_are_the_published_ones_corrected_by_bayes_rule() -> None:
    """Against the information form, as least squares of both sources together."""
    result = identify(recording(0), ur5(), IdentifySettings(preset="paper"))
    estimate, base = result.estimate, reduce_model(result.estimate.model)
    found = standard_posterior(estimate, base)
    mapping = np.column_stack([base.from_standard(unit) for unit in np.eye(78)])
    friction = [
        np.abs(estimate.values[[name.startswith(kind) for name in estimate.names]]).max()
        for kind in ("Fc", "Fv", "Im")
    ]
    spread = scipy.linalg.block_diag(
        deviations(ur5(), "dh"), *(size * np.eye(6) for size in friction)
    )
    prior = np.concatenate([inertial_prior(ur5(), "dh").parameters.ravel(), np.zeros(18)])
    whiten = np.linalg.inv(np.linalg.cholesky(estimate.covariance))
    rows = np.vstack([np.eye(78), whiten @ mapping @ spread])
    seen = np.concatenate([np.zeros(78), whiten @ (estimate.values - mapping @ prior)])
    moved = np.linalg.lstsq(rows, seen, rcond=None)[0]
    left = spread @ np.linalg.inv(rows.T @ rows) @ spread.T
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(left)), rtol=SAME)
    assert (np.abs(found.values - prior - spread @ moved) < SAME * found.std).all()
    share = np.diag(left) / np.diag(spread @ spread.T)
    np.testing.assert_allclose(found.prior_share, share, rtol=SAME)
    assert [origin == "prior" for origin in found.origins] == (share > 0.5).tolist()


def test_the_order_of_recordings_changes_nothing() -> None:
    """The same bits: what is computed twice from the same input is the same."""
    runs = [recording(seed, seconds=8.0) for seed in (1, 2)]
    one, other = (
        identify(order, ur5(), IdentifySettings(preset="paper")).estimate
        for order in (runs, runs[::-1])
    )
    np.testing.assert_array_equal(one.values, other.values)
    np.testing.assert_array_equal(one.covariance, other.covariance)
    assert one.settings == other.settings
    assert one.motion_condition_number == other.motion_condition_number


@pytest.mark.parametrize("slower", [0.0, 1e-9])
def test_stamps_whose_last_digit_is_off_try_the_same_cut_offs(slower: float) -> None:
    """Four fifths of the Nyquist frequency of 125 Hz are 50 Hz, which is one of them."""

    class Enough(Exception):
        pass

    tried: set[float] = set()

    def tell(what: str, share: float) -> None:
        if what == "cut-off":
            tried.add(share)
        elif tried:
            raise Enough

    record = recording(1)
    with pytest.raises(Enough):
        identify(replace(record, t=(1.0 + slower) * record.t), ur5(), progress=tell)
    # 2, 3, 4.5, 7, 10, 15, 22, 33 and 50 Hz.
    assert len(tried) == 9


def test_an_unknown_purpose_is_refused() -> None:
    with pytest.raises(InputError, match="purpose"):
        IdentifySettings(purpose="something")
    with pytest.raises(InputError, match=r"estimator: .*; got 3"):
        IdentifySettings(estimator=3)  # pyright: ignore[reportArgumentType]


def test_the_deviation_of_a_gain_is_that_of_leaving_each_part_out_once_more() -> None:
    parts = 12
    after = np.ones((3, parts))
    before = after + np.random.default_rng(0).normal(0.01, 0.005, after.shape)
    gain, deviation = gain_of(before, after)
    kept = ~np.eye(parts, dtype=bool)
    others = [0.5 * np.log(before[:, k].sum(1) / after[:, k].sum(1)).sum() for k in kept]
    assert gain == pytest.approx(0.5 * np.log(before.sum(1) / after.sum(1)).sum(), rel=0.01)
    assert deviation == pytest.approx(np.sqrt((parts - 1) * np.var(others)), rel=0.01)
