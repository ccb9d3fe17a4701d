"""An estimator of one's own: least absolute deviations, by weights that follow the residual."""

from dataclasses import dataclass

import numpy as np

import dynid


@dataclass(frozen=True)
class LeastAbsolute(dynid.Estimator):
    """min sum |W p - tau| / noise, by iteratively weighted least squares."""

    name = "least-absolute"
    """The word in files and tables."""
    iterations: int = 20

    def fit(self, problem: dynid.IdentificationProblem) -> dynid.Fit:
        """The base parameters, and what their statistics need."""
        rows, torques = zip(*((c, t) for _, c, t in problem.chunks()), strict=True)
        columns, torque = np.concatenate(rows, axis=2), np.concatenate(torques, axis=1)
        joints, samples = torque.shape
        weights = np.ones((joints, samples))
        for _ in range(self.iterations):
            matrix = (columns * weights).reshape(len(columns), -1).T
            values, *_ = np.linalg.lstsq(matrix, (torque * weights).ravel(), rcond=None)
            residual = torque - np.tensordot(values, columns, axes=1)
            noise = 1.4826 * np.median(np.abs(residual), axis=1, keepdims=True)
            # The root of |r| turns squares into absolute values; it is bounded near zero.
            weights = 1 / (noise * np.sqrt(np.maximum(np.abs(residual) / noise, 0.1)))
        return dynid.Fit(
            values=values,
            noise=residual.std(axis=1),
            weights=1 / noise[:, 0],
            row_weights=weights * noise,
            information=np.linalg.qr(matrix, mode="r"),
        )


robot = dynid.load_robot("ur5")
motions = [dynid.random_excitation(robot.limits, seed=seed) for seed in (1, 2)]
record, other = (dynid.simulate_recording(robot, m, seed=k) for k, m in enumerate(motions))
for estimator in ("ols", LeastAbsolute()):
    settings = dynid.IdentifySettings(preset="paper", estimator=estimator)
    result = dynid.identify(record, robot, settings, validation=other)
    error = np.linalg.norm(result.validation.metrics.rmse)
    print(f"{result.estimate.estimator}: {error:.3f} N.m on another motion")
