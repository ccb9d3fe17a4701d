"""What a design is expected to be worth, against estimates from simulated noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_arms import arm, problem

from dynid.excitation import (
    GramKernel,
    Purpose,
    assumed_noise,
    expected,
    purpose_of,
    random_numbers,
    region_of,
    safe_motions,
    without_friction,
)
from dynid.robot import load_robot
from dynid.trajectory import JointMotion

NOISE = np.array([1.0, 0.7, 0.3])
DRAWS = 400
SAMPLED = 0.06
"""Of 400 draws: three standard deviations of a root mean square with about 20 unknowns."""


def _motions(count: int, seed: int) -> list[JointMotion]:
    asked = problem(arm())
    random = np.random.default_rng(seed)
    drawn = random_numbers(region_of(asked), count, random, fill=0.5)
    return [asked.family.trajectory(x[:, 0], x[:, 1:]).evaluate(asked.times) for x in drawn]


@pytest.mark.parametrize("size", [3, 4])
def test_the_bound_is_one_where_rounding_decides(size: int) -> None:
    for seed in range(40):
        rows = np.random.default_rng(seed).normal(size=(60, size))
        rows[:, -1] = rows[:, :-1].sum(axis=1) + 1e-6 * rows[:, -1]
        own, task = rows[:40], rows[40:]
        purpose = Purpose(
            source="", moments=(task.T @ task)[None], torque=np.ones(1), prismatic=(False,)
        )
        found = expected(own.T @ own, purpose, np.ones(1))
        share = found.bound_percent / found.torque_error_percent
        # The root of a chi-square's 95 % quantile, by Wilson and Hilferty, of one to all.
        assert 1 < share < 2


def test_the_expected_error_is_that_of_weighted_least_squares() -> None:
    base = problem(arm()).base
    design, *task = _motions(4, 1)
    columns = list(base.independent)
    rows = base.model.stack(design.q, design.dq, design.ddq)[columns] / NOISE[:, None]
    w = rows.reshape(len(columns), -1).T
    found = expected(w.T @ w, purpose_of(base, task, "a task"), NOISE)
    random = np.random.default_rng(2)
    solve = np.linalg.pinv(w)
    errors = np.array([solve @ random.standard_normal(len(w)) for _ in range(DRAWS)])
    squares = np.zeros((DRAWS, 3))
    for motion in task:
        stack = base.model.stack(motion.q, motion.dq, motion.ddq)[columns]
        squares += np.square(np.einsum("kp,pjn->kjn", errors, stack)).mean(axis=2) / len(task)
    truth = np.sqrt(squares.mean(axis=0))
    np.testing.assert_allclose(found.torque_error, truth, rtol=SAMPLED)
    np.testing.assert_allclose(found.parameter_std, errors.std(axis=0), rtol=3 * SAMPLED)
    # The bound holds in 95 % of the draws.
    overall = np.sqrt(squares.sum(axis=1))
    scale = found.bound_percent / found.torque_error_percent * np.linalg.norm(found.torque_error)
    assert 0.9 < np.mean(overall < scale) < 0.99


def test_the_unit_of_a_slide_changes_nothing() -> None:
    base = problem(arm()).base
    kernel = GramKernel(base, noise=NOISE, coulomb_width=None)
    one, *task = _motions(3, 5)
    gram = kernel.gram(one.q, one.dq, one.ddq)
    purpose = replace(purpose_of(base, task, "a task"), prismatic=(False, False, True))
    unit = np.array([1.0, 1.0, 1000.0])
    other = replace(
        purpose, moments=purpose.moments * unit[:, None, None] ** 2, torque=purpose.torque * unit
    )
    found, same = (expected(gram, each, NOISE) for each in (purpose, other))
    assert same.torque_error_percent == pytest.approx(found.torque_error_percent, rel=1e-9)
    assert same.bound_percent == pytest.approx(found.bound_percent, rel=1e-9)
    # Joints that the purpose neither moves nor loads have no share.
    still = replace(
        purpose,
        moments=purpose.moments * np.array([1.0, 1.0, 0.0])[:, None, None],
        torque=purpose.torque * np.array([1.0, 1.0, 0.0]),
    )
    assert expected(gram, still, NOISE).torque_error_percent <= found.torque_error_percent
    nothing = replace(still, torque=0 * still.torque)
    assert np.isnan(expected(gram, nothing, NOISE).torque_error_percent)
    # The kind that errs more, never less than both together.
    whole = expected(gram, replace(purpose, prismatic=(False,) * 3), NOISE)
    assert found.torque_error_percent > whole.torque_error_percent


def test_more_periods_and_earlier_records_lower_the_error_as_they_must() -> None:
    base = problem(arm()).base
    kernel = GramKernel(base, noise=NOISE, coulomb_width=None)
    one, two, *task = _motions(4, 3)
    first, second = (kernel.gram(m.q, m.dq, m.ddq) for m in (one, two))
    purpose = purpose_of(base, task, "a task")
    alone = expected(first, purpose, NOISE)
    four = expected(4 * first, purpose, NOISE)
    np.testing.assert_allclose(four.torque_error, alone.torque_error / 2, rtol=1e-6)
    assert four.bound_percent == pytest.approx(alone.bound_percent / 2, rel=1e-6)
    # Friction of another day tells less than the same record of today, and more than nothing.
    later = without_friction(second, base)
    errors = [
        np.linalg.norm(expected(first, purpose, NOISE, known).torque_error)
        for known in (second, later, None)
    ]
    assert errors[0] < errors[1] < errors[2]
    # As if the earlier record had friction columns of its own.
    own = [k for k, c in enumerate(base.independent) if base.model.names[c].startswith("F")]
    others = [k for k in range(base.rank) if k not in own]
    size, extra = base.rank, len(own)
    both = np.zeros((size + extra, size + extra))
    place = {k: k for k in others} | {k: size + i for i, k in enumerate(own)}
    at = [place[k] for k in range(size)]
    both[:size, :size] = first
    both[np.ix_(at, at)] += second
    joint = np.linalg.inv(both)[:size, :size]
    np.testing.assert_allclose(np.linalg.inv(first + later), joint, rtol=1e-6, atol=1e-9)


def test_the_whole_workspace_is_moved_through_safely() -> None:
    asked = problem(arm(), safe=True)
    motions = safe_motions(asked.base, asked.constraints)
    found = purpose_of(asked.base, motions, "anywhere")
    again = purpose_of(asked.base, safe_motions(asked.base, asked.constraints), "anywhere")
    np.testing.assert_array_equal(found.moments, again.moments)
    assert isinstance(found, Purpose)
    assert np.linalg.matrix_rank(found.moment(NOISE), hermitian=True) == asked.base.rank
    assert (found.torque > 0).all()
    assert (found.torque < asked.base.model.robot.limits.torque).all()


def test_noise_is_a_share_of_the_torque_limits() -> None:
    np.testing.assert_allclose(assumed_noise(load_robot("ur5")), [2.1] * 3 + [0.392] * 3, rtol=1e-9)


def test_one_limit_of_all_joints_says_as_little_of_noise_as_none() -> None:
    motions, found = _motions(3, seed=5), {}
    for limit in (80.0, 8000.0, np.nan):
        robot = arm()
        robot = replace(robot, limits=replace(robot.limits, torque=np.full(3, limit)))
        purpose = purpose_of(problem(robot).base, motions, "a task")
        found[limit] = (purpose.torque, assumed_noise(robot, purpose.torque))
    for torque, noise in found.values():
        np.testing.assert_array_equal(torque, found[80.0][0])
        # A UR5's is 0.06 of its second joint's RMS torque, 0.012 of that for its wrists.
        assert (noise > 0.01 * torque.max()).all()
        assert (noise <= 0.06 * torque.max()).all()
