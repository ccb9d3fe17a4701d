"""Masses, centres and tensors of the links behind base parameters, and how much of each is data."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.identification.bayesian import (
    COMPLETED,
    ORTHONORMAL,
    RELATIVE,
    inertial_prior,
    symbol_of,
)
from dynid.identification.estimate import Estimate, StandardParameters
from dynid.identification.problem import base_mapping
from dynid.reduction import BaseParametrization
from dynid.robot import from_pseudo_inertia, to_pseudo_inertia

DATA_ABOVE = 0.5
"""Share of a parameter's variance that the data must have removed to be called data."""


def standard_posterior(estimate: Estimate, base: BaseParametrization) -> StandardParameters:
    """Standard parameters of an estimate: its own, or published ones corrected by its base values.

    Base parameters b = B p with covariance C; published parameters p ~ N(p0, S), S from the
    pseudo-inertia metric (Lee, Wensing and Park 2020). Then p = p0 + K (b - B p0) with
    K = S B' (B S B' + C)^-1, and its covariance is S - K B S. The prior's share of a parameter is
    the share of its variance that is left.

    Args:
        estimate: The estimate.
        base: The base parametrization of its model, with the same independent columns.
    """
    if estimate.standard is not None:
        return estimate.standard
    model = estimate.model
    inertial = 10 * model.robot.joints
    known = inertial_prior(model.robot, model.frames)
    # A body of unknown mass is a guess; one whose tensor alone is unknown is not.
    relative = RELATIVE if np.isfinite(model.robot.inertias[:, :4]).all() else COMPLETED
    spread = np.zeros((len(model.columns), len(model.columns)))
    for i, body in enumerate(np.linalg.cholesky(to_pseudo_inertia(known.parameters))):
        here = slice(10 * i, 10 * i + 10)
        spread[here, here] = relative * from_pseudo_inertia(body @ ORTHONORMAL @ body.T).T
    sizes: dict[str, float] = {}
    for name, value in zip(estimate.names, np.abs(estimate.values), strict=True):
        sizes[symbol_of(name)] = max(float(value), sizes.get(symbol_of(name), 1e-6))
    # Friction and motor inertia have no published value: as wide as the largest of their kind.
    for k, name in enumerate(model.names[inertial:], start=inertial):
        spread[k, k] = sizes.get(symbol_of(name), max(sizes.values()))
    prior = np.zeros(len(model.columns))
    prior[:inertial] = known.parameters.ravel()
    mapping = base_mapping(base)
    covariance: Array = spread @ spread.T
    seen = covariance @ mapping.T
    gain = np.linalg.solve(mapping @ seen + estimate.covariance, seen.T).T
    variance = np.maximum(np.diag(covariance - gain @ seen.T), 0.0)
    share = np.clip(variance / np.maximum(np.diag(covariance), 1e-300), 0.0, 1.0)
    return StandardParameters(
        values=prior + gain @ (estimate.values - mapping @ prior),
        std=np.sqrt(variance),
        prior_share=share,
        prior=np.where(np.arange(len(prior)) < inertial, prior, np.nan),
        origins=tuple("data" if s < 1 - DATA_ABOVE else "prior" for s in share),
    )
