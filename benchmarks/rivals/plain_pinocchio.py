"""A plain pipeline with pinocchio and SciPy, as many write it themselves: about forty lines."""

import numpy as np
import pinocchio
from scipy.signal import butter, sosfiltfilt


def motion(q, rate, cutoff):
    """Zero-phase low-pass, then central differences."""
    q = sosfiltfilt(butter(4, cutoff, fs=rate, output="sos"), q, axis=0)
    dq = np.gradient(q, 1 / rate, axis=0)
    return q, dq, np.gradient(dq, 1 / rate, axis=0)


def regressor(model, q, dq, ddq):
    """(n, N, p): inertial columns, then rotor inertia, viscous, Coulomb, offset of each joint."""
    data, n, one = model.createData(), model.nv, np.ones_like(dq)
    W = np.zeros((n, len(q), 14 * n))
    for k in range(len(q)):
        W[:, k, : 10 * n] = pinocchio.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])
    for c, column in enumerate((ddq, dq, np.tanh(dq / 0.01), one)):
        for j in range(n):
            W[j, :, (10 + c) * n + j] = column[:, j]
    return W


def fit(W, tau, rcond):
    """Weighted least squares by each joint's residual; small singular values are left out."""
    size = np.linalg.norm(W.reshape(-1, W.shape[2]), axis=0) + 1e-12
    weight = 1 / tau.std(axis=0)
    for _ in range(3):
        rows = np.vstack([w * s for w, s in zip(W, weight, strict=True)]) / size
        p = np.linalg.lstsq(rows, (tau * weight).T.ravel(), rcond=rcond)[0] / size
        weight = 1 / np.std(tau - (W @ p).T, axis=0)
    return p


def identify(model, q, tau, rate):
    """Cut-off and rcond by the last 30 % of the recording, then a fit to all of it."""
    best, step, cut = (
        (np.inf,),
        max(1, round(rate / 125)),
        round(0.7 * len(q) / max(1, rate // 125)),
    )
    for cutoff in (2, 4, 8, 16):
        W = regressor(model, *(x[::step] for x in motion(q, rate, cutoff)))
        for rcond in (1e-6, 1e-4, 1e-3, 1e-2, 3e-2):
            p = fit(W[:, :cut], tau[::step][:cut], rcond)
            error = np.linalg.norm(np.sqrt(np.mean((tau[::step][cut:].T - W[:, cut:] @ p) ** 2, 1)))
            best = min(best, (error, cutoff, rcond))
    W = regressor(model, *(x[::step] for x in motion(q, rate, best[1])))
    return fit(W, tau[::step], best[2]), best[1]


def predict(model, p, cutoff, q, rate):
    """Torques of another motion."""
    return (regressor(model, *motion(q, rate, cutoff)) @ p).T


def run(urdf, gravity, q, tau, rate, q_test, rate_test):
    """From URDF and recording to torques of another motion."""
    model = pinocchio.buildModelFromUrdf(urdf)
    model.gravity.linear = gravity
    return predict(model, *identify(model, q, tau, rate), q_test, rate_test)
