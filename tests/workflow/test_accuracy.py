"""The error that was found, in shares that do not depend on the unit of a sliding joint."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynid.trajectory import JointMotion
from dynid.workflow.identify import CONFIDENCE, accuracy


def estimate(unit: float) -> SimpleNamespace:
    """Two joints that turn and one that slides, its force in newtons over `unit`."""
    size, random = np.array([1.0, 1.0, 1 / unit]), np.random.default_rng(0)
    columns = random.standard_normal((5, 3, 40)) * size[:, None]
    told = {
        "anywhere": np.array([0.3, 0.2, 30.0]) * size,
        "noise_floor": np.array([0.1, 0.1, 20.0]) * size,
        "torque": np.array([5.0, 4.0, 100.0]) * size,
        "squares_at": lambda dq: np.square([[0.3, 0.2, 30.0], [0.1, 0.1, 5.0]] * size),
    }
    return SimpleNamespace(
        assessment=SimpleNamespace(**told),
        samples=1000,
        independent=range(5),
        covariance=np.diag(random.uniform(0.1, 1.0, 5)),
        model=SimpleNamespace(
            robot=SimpleNamespace(joints=3, prismatic=(False, False, True)),
            stack=lambda *_: columns,
        ),
        predict=lambda *_: columns.sum(axis=0).T,
    )


def test_the_unit_of_a_slide_changes_nothing() -> None:
    still, t = np.zeros((40, 3)), np.arange(40.0)
    motion = JointMotion(t=t, q=still, dq=still, ddq=still)
    newtons, kilonewtons = (accuracy(estimate(unit), [], still, [motion]) for unit in (1.0, 1000.0))  # type: ignore[arg-type]
    assert newtons is not None
    assert kilonewtons is not None
    names = ("found_percent", "bound_percent", "noise_percent")
    ours, others = ([getattr(one, name) for name in names] for one in (newtons, kilonewtons))
    assert ours == pytest.approx(others, rel=1e-9)
    alone = accuracy(estimate(1.0), [], still)
    assert alone is not None
    # Of the slide: it errs more.
    assert alone.found_percent == pytest.approx(np.sqrt(30.0**2 - 20.0**2), rel=1e-9)
    assert alone.bound_percent == pytest.approx(
        np.sqrt(30.0**2 - 20.0**2 + CONFIDENCE * 5.0**2), rel=1e-9
    )
