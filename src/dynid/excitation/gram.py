"""The Gram matrix of the observation matrix, and its derivative by the motion.

G = W_B' Omega^-1 W_B holds all that the criteria ask of a motion. It is summed joint by joint from
panels that leave structural zeros out; the derivative of a function of G with dL = tr(S dG) goes
back through the regressor with the weights 2 Omega^-1 W_B S, in one pass whatever S is.
"""

from collections.abc import Callable

import numpy as np

from dynid import regressor
from dynid.core import Array, InputError
from dynid.reduction import BaseParametrization, gram_layout

DESIGN_WIDTH = 0.05
"""Width of the Coulomb step inside an optimiser [rad/s or m/s]: its slope can be followed."""
Pullback = Callable[[Array], regressor.Gradient]
"""From S (b, b) to the derivatives of tr(S G) by q, dq and ddq, each (N, n)."""


class GramKernel:
    """Gram matrices of many motions of one robot, in memory that is used again.

    One caller at a time: each worker makes its own. A search limits BLAS to one thread for all its
    calls: such small products gain nothing from more, and to set the limit costs as much as one.

    Args:
        model: The inverse dynamic model.
        base: Its base parameters; the columns are the first-come ones.
        noise: (n) standard deviation of each joint's torque [N.m or N], by which its rows are
            divided; None for rows as they are.
        coulomb_width: Width of the Coulomb step [rad/s or m/s]; None for the model's own.

    Raises:
        InputError: A base of another model, columns without a derivative, noise that is not
            positive, or a width below 0.
    """

    def __init__(
        self,
        model: regressor.InverseDynamicModel,
        base: BaseParametrization,
        *,
        noise: Array | None = None,
        coulomb_width: float | None = DESIGN_WIDTH,
    ) -> None:
        n = model.robot.joints
        if base.model.names != model.names:
            raise InputError("the base parameters are those of another model")
        regressor.check_differentiable(model)
        sigma = np.ones(n) if noise is None else np.asarray(noise, dtype=np.float64)
        if sigma.shape != (n,) or not (np.isfinite(sigma) & (sigma > 0)).all():
            raise InputError(
                "noise needs a positive standard deviation a joint", value=noise, limit=n
            )
        self._model = model if coulomb_width is None else model.with_coulomb_width(coulomb_width)
        self._layout = gram_layout(self._model, base)
        self._weights = 1.0 / np.square(sigma)
        sizes = [len(panel.columns) for panel in self._layout.panels]
        self._entries = np.concatenate(
            [(c[:, None] * base.rank + c).ravel() for c in (p.columns for p in self._layout.panels)]
        )
        self._sums = np.empty(len(self._entries))
        ends = np.cumsum(np.square(sizes))[:-1]
        self._products = [
            part.reshape(size, size)
            for part, size in zip(np.split(self._sums, ends), sizes, strict=True)
        ]
        self._samples = -1

    def gram(self, q: Array, dq: Array, ddq: Array) -> Array:
        """G (b, b) of a motion: positions [rad or m], velocities, accelerations, each (N, n).

        Raises:
            InputError: Shapes that do not fit the robot or each other.
        """
        state = self._state = regressor.in_lanes(self._model.motion(q, dq, ddq))
        if len(q) != self._samples:
            self._allocate(len(q), state.shape)
        turn = self._turn = regressor.turns(state[0])
        regressor.inertial_rows(
            *self._model.constants, turn, state, self._rows, self._layout.places
        )
        self._model.fill_beside(state[1], state[2], self._beside)
        for j, panel in enumerate(self._layout.panels):
            rows = self._rows[panel.rows, : self._samples]
            for row, column in zip(rows, panel.beside, strict=False):
                row[:] = self._beside[column, j, : self._samples]
            np.matmul(rows, rows.T, out=self._products[j])
            self._products[j] *= self._weights[j]
        rank = self._layout.rank
        entries = np.bincount(self._entries, self._sums, minlength=rank**2)
        return np.asarray(entries, dtype=np.float64).reshape(rank, rank)

    def gram_and_pullback(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Pullback]:
        """G (b, b), as `gram`, and the function that differentiates tr(S G).

        The function works on the memory of this call: it must be used before the next one.
        """
        return self.gram(q, dq, ddq), self._pull

    def _pull(self, s: Array) -> regressor.Gradient:
        samples = self._samples
        for j, panel in enumerate(self._layout.panels):
            rows, bars = (a[panel.rows, :samples] for a in (self._rows, self._bars))
            part = s[np.ix_(panel.columns, panel.columns)]
            np.matmul(2.0 * self._weights[j] * part, rows, out=bars)
            for bar, column in zip(bars, panel.beside, strict=False):
                self._beside_bars[column, j, :samples] = bar
        regressor.regressor_pullback(
            *self._model.constants, self._turn, self._state, self._bars,
            self._layout.places, self._out,
        )  # fmt: skip
        self._model.pull_beside(self._state, self._beside_bars, self._out)
        return regressor.by_sample(self._out, samples)

    def _allocate(self, samples: int, shape: tuple[int, ...]) -> None:
        n, length = shape[1:]
        beside = (len(self._model.columns) - 10 * n, n, length)
        self._samples = samples
        self._out = np.zeros(shape)
        self._rows = np.zeros((self._layout.rows, length))
        self._bars = np.zeros((self._layout.rows, length))
        self._beside = np.zeros(beside)
        self._beside_bars = np.zeros(beside)
