"""The estimators by their words."""

from __future__ import annotations

from collections.abc import Callable

from dynid.core.errors import InputError
from dynid.identification.bayesian import BayesianRegression
from dynid.identification.instrumental import InstrumentalVariables, OutputError
from dynid.identification.least_squares import (
    Estimator,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from dynid.identification.likelihood import MaximumLikelihood
from dynid.identification.physical import PhysicallyConsistent
from dynid.identification.recursive import RecursiveLeastSquares
from dynid.identification.robust import HuberRegression
from dynid.identification.total_least_squares import TotalLeastSquares

ESTIMATORS = ("ols", "wls", "irls", "tls", "iv", "ml", "didim", "sdp", "bayes", "rls")
"""The words of `--estimator`."""


def estimator_of(word: str, prior_gain: float | None = None) -> Estimator:
    """The estimator of a word.

    Args:
        word: One of `ESTIMATORS`.
        prior_gain: See `WeightedLeastSquares`; for those that have it.

    Raises:
        InputError: An unknown word.
    """
    makers: dict[str, Callable[[], Estimator]] = {
        "ols": OrdinaryLeastSquares,
        "wls": lambda: WeightedLeastSquares(prior_gain=prior_gain),
        "irls": lambda: HuberRegression(prior_gain=prior_gain),
        "tls": TotalLeastSquares,
        "iv": lambda: InstrumentalVariables(prior_gain=prior_gain),
        "ml": lambda: MaximumLikelihood(prior_gain=prior_gain),
        "didim": lambda: OutputError(prior_gain=prior_gain),
        "sdp": lambda: PhysicallyConsistent(prior_gain=prior_gain),
        "bayes": BayesianRegression,
        "rls": RecursiveLeastSquares,
    }
    if word not in makers:
        raise InputError("unknown", where="--estimator", value=word, limit=", ".join(ESTIMATORS))
    return makers[word]()
