import numpy as np
import pytest

from dynid.regressor import turns

LAST_DIGIT = 2.3e-16
"""Two units in the last place below 1."""


@pytest.mark.parametrize("reach", [1.0, 10.0, 1e3, 1e5])
def test_cosine_and_sine_are_good_to_the_last_digit(reach: float) -> None:
    angles = np.random.default_rng(1).uniform(-reach, reach, (3, 5000))
    cosine, sine = turns(angles)
    np.testing.assert_allclose(cosine, np.cos(angles), rtol=0, atol=LAST_DIGIT)
    np.testing.assert_allclose(sine, np.sin(angles), rtol=0, atol=LAST_DIGIT)


def test_quarter_turns_and_odd_angles() -> None:
    angles = np.concatenate([np.arange(-9, 10) * np.pi / 4, [0.0, 1e-300, 5e-324, 123456.789]])
    cosine, sine = turns(angles[None])
    np.testing.assert_allclose(cosine[0], np.cos(angles), rtol=0, atol=LAST_DIGIT)
    np.testing.assert_allclose(sine[0], np.sin(angles), rtol=0, atol=LAST_DIGIT)
    assert not np.isfinite(turns(np.array([[np.nan, np.inf]]))).any()
