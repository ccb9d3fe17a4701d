import numpy as np
import pytest
from criteria_chains import base_columns, by_coefficients, chain, coefficients, motion, reduced

from dynid.core import InputError
from dynid.excitation import GramKernel
from dynid.excitation.evaluation import DESIGN_WIDTH
from dynid.reduction import reduce_model
from dynid.regressor import TERMS, InverseDynamicModel, parse_terms

SAME = 1e-12
"""Of the product of two columns' norms."""
PINOCCHIO = 1e-11
DIFFERENCES = 1e-8
STEP = 1e-3


def _assert_gram(ours: np.ndarray, w: np.ndarray, tolerance: float) -> None:
    truth = w.T @ w
    norms = np.linalg.norm(w, axis=0)
    np.testing.assert_allclose(
        ours / np.outer(norms, norms), truth / np.outer(norms, norms), rtol=0, atol=tolerance
    )


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("samples", [3, 16, 50, 101])
@pytest.mark.parametrize("joints", range(3, 8))
def test_the_gram_matrix_is_that_of_the_weighted_base_columns(
    joints: int, samples: int, coupled: bool
) -> None:
    base = reduced(chain(joints, joints, wall=joints == 4, coupled=coupled))
    state = motion(coefficients(1, joints), samples)
    noise = np.linspace(0.3, 3.0, joints)
    ours = GramKernel(base, noise=noise, coulomb_width=None).gram(*state)
    w = base.model.observation_matrix(*state)[:, list(base.independent)]
    _assert_gram(ours, w / np.repeat(noise, samples)[:, None], SAME)


@pytest.mark.parametrize("width", [None, DESIGN_WIDTH])
@pytest.mark.parametrize("joints", range(3, 8))
def test_the_gram_matrix_is_pinocchios(joints: int, width: float | None) -> None:
    base = reduced(chain(10 + joints, joints, wall=joints == 5))
    state = motion(coefficients(2, joints), 40)
    ours = GramKernel(base, coulomb_width=width).gram(*state)
    columns = base_columns(base, width or 0.001, *state)
    _assert_gram(ours, columns.reshape(-1, base.rank), PINOCCHIO)


@pytest.mark.parametrize("terms", ["fo", "fc:2,fo:1+3", ",".join(TERMS)])
def test_any_choice_of_terms_has_its_panels(terms: str) -> None:
    model = InverseDynamicModel(robot=chain(3, 4), friction=parse_terms(terms))
    base = reduce_model(model)
    state = motion(coefficients(3, 4), 60)
    w = model.observation_matrix(*state)[:, list(base.independent)]
    _assert_gram(GramKernel(base, coulomb_width=None).gram(*state), w, SAME)


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("joints", range(3, 8))
def test_the_pullback_is_the_derivative(joints: int, coupled: bool) -> None:
    base = reduced(chain(20 + joints, joints, coupled=coupled))
    kernel = GramKernel(base, noise=np.linspace(0.5, 2.0, joints), coulomb_width=0.3)
    state = motion(coefficients(4, joints), 21)
    random = np.random.default_rng(5)
    half = random.normal(size=(base.rank, base.rank))
    s = half + half.T
    gram = kernel.gram(*state)
    bars = kernel.pullback(s)
    np.testing.assert_array_equal(kernel.gram(*state), gram)
    for which, bar in enumerate(bars):
        assert bar.shape == (21, joints)
        directions = [*random.normal(size=(3, 21, joints)), np.eye(21, joints)]
        for direction in directions:
            slope = 0.0
            for steps, weight in ((1, 45), (2, -9), (3, 1)):
                for sign in (1, -1):
                    moved = list(state)
                    moved[which] = state[which] + sign * steps * STEP * direction
                    slope += sign * weight * float((s * kernel.gram(*moved)).sum()) / (60 * STEP)
            size = np.abs(bar).max() * np.abs(direction).sum()
            assert abs(slope - (bar * direction).sum()) < DIFFERENCES * size
    kernel.gram(*state)
    for one, two in zip(kernel.pullback(s), bars, strict=True):
        np.testing.assert_array_equal(one, two)


def test_only_the_symmetric_part_is_asked_for_and_few_samples_suffice() -> None:
    base = reduced(chain(31, 3))
    kernel = GramKernel(base)
    s = np.eye(base.rank)
    long, short = motion(coefficients(6, 3), 40), motion(coefficients(6, 3), 5)
    fresh = GramKernel(base)
    fresh.gram(*short)
    expected = fresh.pullback(s)
    kernel.gram(*long)
    kernel.pullback(s)
    kernel.gram(*short)
    for got, truth in zip(kernel.pullback(s), expected, strict=True):
        np.testing.assert_array_equal(got, truth)
    assert by_coefficients(expected).shape == (3, 7)


def test_inputs_stay_and_results_are_not_shared() -> None:
    base = reduced(chain(32, 4))
    kernel = GramKernel(base)
    one, two = motion(coefficients(7, 4), 30), motion(coefficients(8, 4), 30)
    copies = [x.copy() for x in one]
    for x in one:
        x.setflags(write=False)
    first = kernel.gram(*one)
    kept = first.copy()
    kernel.gram(*two)
    np.testing.assert_array_equal(first, kept)
    for x, copy in zip(one, copies, strict=True):
        np.testing.assert_array_equal(x, copy)
    np.testing.assert_array_equal(kernel.gram(*(np.asfortranarray(x) for x in one)), kept)


@pytest.mark.parametrize("noise", [[1.0, 2.0], [1.0, 0.0, 1.0], [1.0, np.nan, 1.0]])
def test_noise_is_positive_and_a_joint(noise: list[float]) -> None:
    base = reduced(chain(34, 3))
    with pytest.raises(InputError, match="noise"):
        GramKernel(base, noise=np.array(noise))


def test_a_width_and_shapes_that_cannot_be_are_refused() -> None:
    base = reduced(chain(35, 3))
    with pytest.raises(InputError, match="width"):
        GramKernel(base, coulomb_width=-1.0)
    q, dq, ddq = motion(coefficients(11, 3), 20)
    with pytest.raises(InputError, match="ddq has the wrong shape"):
        GramKernel(base).gram(q, dq, ddq[:19])
