"""How often 95 % intervals of parameters and payloads hold the truth, on arms of MuJoCo.

    python benchmarks/intervals.py [known|chosen|sdp|payload|delays] [--seed 1] [--count 12]

`known`: Coulomb and viscous friction as planted, nothing chosen (wls). `chosen`: preset best.
`sdp`: the same by consistent bodies. Friction is what the terms can say, noise is white and slow
in equal parts, links differ from what is published as real ones do. `base`: base parameters, of
which `data` are those that the prior does not dominate; `links`: link parameters from data.
`payload`: the same motion without and with 0.5 to 3 kg on another day: friction of each joint is
up to 20 % different, and each drive gain is off by 2 %; mass and centre.
`delays`: torques of one joint between 20 ms early and 60 ms late, with the scoreboard's friction,
presliding in every second group of five arms.
"""

import itertools
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from shared.measuring import run

import dynid
from dynid.bench.plants import Motion, Plant, arm, motion, plant
from dynid.core import Array, DynidError, one_thread
from dynid.identification import select, standard_posterior
from dynid.identification.bayesian import deviations
from dynid.identification.problem import base_mapping
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms
from dynid.robot import from_pseudo_inertia, move
from dynid.signals import ProcessingSettings, fold_periods, uniform_signals
from dynid.workflow import identify_payload

CONFIDENCE = 1.96
WIDTH = 0.02
"""Smoothing velocity of the planted Coulomb friction [rad/s]."""
ARMS = ("ur5", "ur10e", "ur3", "seven", "heavy")
GAINS_OFF, FRICTION_OFF = 0.02, 0.2
IN_TIME_S = 2e-3
FINE_HZ = 4000.0
SETTINGS = {
    "known": dynid.IdentifySettings(
        preset="paper", estimator="wls", terms=FrictionTerms(width=WIDTH)
    ),
    "chosen": dynid.IdentifySettings(),
    "sdp": dynid.IdentifySettings(estimator="sdp"),
}


def record(real: Plant, path: Motion, draw: np.random.Generator, gains: Array) -> Array:
    """(N, n) torques as they are recorded."""
    rigid = real.torque(path.q, path.dq, path.ddq)
    rubs = real.coulomb + real.load * np.abs(rigid)
    torque = rigid + rubs * np.tanh(path.dq / WIDTH) + real.viscous * path.dq
    white, drive = draw.normal(size=(2, *torque.shape))
    slow = lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], drive, axis=0)
    return gains * torque + real.torque_noise * (white + slow) / np.sqrt(2)


def recording(path: Motion, torque: Array, draw: np.random.Generator) -> dynid.ExperimentRecord:
    """Positions as encoders count them."""
    q = path.q + 5e-6 * draw.normal(size=path.q.shape)
    return dynid.ExperimentRecord(t=path.t, signals={"q": q, "effort": torque})


def truth(real: Plant, estimate: dynid.Estimate) -> Array:
    """(p) true standard parameters in the estimate's frames."""
    inverses = np.linalg.inv(real.robot.parameter_frames[estimate.model.frames])
    values = np.zeros(len(estimate.model.names))
    for k, inverse in enumerate(inverses):
        place = np.append(real.centre[k], 1.0)
        pseudo = real.mass[k] * np.outer(place, place)
        pseudo[:3, :3] += real.second[k]
        values[10 * k : 10 * k + 10] = move(from_pseudo_inertia(pseudo), inverse)
    known = {"Fc": real.coulomb, "Fv": real.viscous, "Im": real.armature}
    for k, name in enumerate(estimate.model.names[10 * real.robot.joints :]):
        if name[:2] in known and name[2:].isdigit():
            values[10 * real.robot.joints + k] = known[name[:2]][int(name[2:]) - 1]
    return values


def parameters(kind: str, seed: int) -> tuple[str, dict[str, Array]]:
    """What was identified, and errors over their deviations by group."""
    draw = np.random.default_rng(seed)
    told = arm(str(draw.choice(ARMS)))
    real = replace(plant(told, seed), load=np.zeros(told.joints))
    how = "waypoints" if draw.random() < 0.4 else "fourier"
    path = motion(told, how, seed, 125.0, float(draw.choice([20.0, 30.0, 60.0])))
    torque = record(real, path, draw, np.ones(told.joints))
    estimate = dynid.identify([recording(path, torque, draw)], told, SETTINGS[kind]).estimate
    base = reduce_model(estimate.model)
    mapping, right = base_mapping(base), truth(real, estimate)
    away = (estimate.values - mapping @ right) / estimate.std
    known = np.zeros(len(right))
    inertial = 10 * told.joints
    known[:inertial] = np.linalg.norm(deviations(told, estimate.model.frames), axis=1)
    # Base parameters with motor inertia or friction in them have no prior.
    free = np.abs(mapping[:, inertial:]).max(axis=1) > 0
    before = np.sqrt(np.square(mapping) @ np.square(known))
    groups = {"base": away, "data": away[free | (estimate.std < 0.7 * before)]}
    links = standard_posterior(estimate, base)
    data = (np.array(links.origins) == "data") & (np.arange(len(right)) < inertial)
    groups["links"] = ((links.values - right) / np.maximum(links.std, 1e-300))[data]
    return f"{told.name} {how} {path.t[-1]:.0f} s, {estimate.estimator}", groups


def payload(_: str, seed: int) -> tuple[str, dict[str, Array]]:
    """What was weighed, and errors over deviations of mass and centre."""
    draw = np.random.default_rng(seed)
    told = arm(str(draw.choice(ARMS)))
    n = told.joints
    real = plant(told, seed)
    path = motion(told, "fourier", seed, 125.0, 20.0)
    mass, centre = draw.uniform(0.5, 3.0), draw.uniform(-0.05, 0.08, 3)
    gains = 1 + GAINS_OFF * draw.normal(size=n)
    runs: list[dynid.ExperimentRecord] = []
    for load in (0.0, mass):
        rubs = draw.uniform(1 - FRICTION_OFF, 1 + FRICTION_OFF, n)
        now = replace(
            real, coulomb=rubs * real.coulomb, viscous=rubs * real.viscous, load=rubs * real.load
        )
        if load:
            now = now.with_payload(load, told.flange[:3, 3] + told.flange[:3, :3] @ centre)
        runs.append(recording(path, record(now, path, draw, gains), draw))
    found = identify_payload(runs[0], runs[1], told)
    groups = {
        "mass": np.array([found.mass - mass]) / found.mass_std,
        "centre": (found.centre - centre) / found.centre_std,
    }
    return f"{told.name} {mass:.2f} kg: {found.mass:.3f} +- {found.mass_std:.3f}", groups


def delay(_: str, seed: int) -> tuple[str, dict[str, Array]]:
    """The delay measured, its errors over 2 ms, and over its deviation.

    Five arms in turn, presliding on every second five.
    """
    draw = np.random.default_rng(seed)
    told = arm(ARMS[seed % len(ARMS)])
    n, rate = told.joints, float(draw.choice([125.0, 125.0, 250.0, 500.0]))
    real = plant(told, seed)
    if seed // len(ARMS) % 2 == 0:
        real = replace(real, presliding=np.full(n, 1e-6))
    each = round(FINE_HZ / rate)
    # A late torque is one between two samples.
    fine = motion(told, "fourier", seed, each * rate, 30.0 if rate < 250.0 else 20.0)
    path = Motion(t=fine.t[::each], q=fine.q[::each], dq=fine.dq[::each], ddq=fine.ddq[::each])
    joint, late = int(draw.integers(n)), float(draw.uniform(-0.02, 0.06))
    rigid = CubicSpline(path.t, real.torque(path.q, path.dq, path.ddq))(fine.t)
    whole = rigid + real.friction(fine.dq, rigid, float(fine.t[1]))
    torque = whole[::each]
    torque[:, joint] = np.interp(path.t - late, fine.t, whole[:, joint])
    torque += real.torque_noise * draw.normal(size=torque.shape)
    settings = ProcessingSettings(period_s=10.0)
    signals = uniform_signals(recording(path, torque, draw), told, settings)
    found = select(told, "urdf", [fold_periods(signals, 10.0)], settings)
    assert found.delays_std_s is not None
    std = found.delays_std_s[joint]
    taken = 0.0 if found.settings.delays_s is None else found.settings.delays_s[joint]
    name = f"{told.name} joint {joint + 1} of {n}, {rate:g} Hz, {1e3 * late:.1f} ms:"
    away = np.array([taken - late])
    if taken == 0.0 and abs(late) > IN_TIME_S:
        return f"{name} not identifiable, +- {1e3 * std:.1f}", {"told": np.array([np.inf])}
    groups = {"told": np.zeros(1), "2 ms": CONFIDENCE * away / IN_TIME_S, "deviation": away / std}
    return f"{name} {1e3 * taken:.1f} +- {1e3 * std:.1f}", groups


@one_thread()
def main(kind: str = "known", /, seed: int = 1, count: int = 12) -> None:
    """Print a line a recording, and how many intervals hold."""
    judged = {"payload": payload, "delays": delay}.get(kind, parameters)
    total: dict[str, list[Array]] = {}
    made = 0
    for k in itertools.count(1000 * seed):
        try:
            name, groups = judged(kind, k)
        except DynidError as error:
            print(f"{k}: refused, {error}", flush=True)
            continue
        made += 1
        cells = [f"{g} {(np.abs(z) <= CONFIDENCE).sum()} of {len(z)}" for g, z in groups.items()]
        print(f"{k} {name}: {', '.join(cells)}", flush=True)
        for group, away in groups.items():
            total.setdefault(group, []).append(away)
        if made == count:
            break
    for group, parts in total.items():
        away = np.concatenate(parts)
        held = 100 * (np.abs(away) <= CONFIDENCE).mean()
        size = np.sqrt(np.square(away[np.isfinite(away)]).mean())
        print(f"{group}: {held:.1f} % of {len(away)} within 95 %, error {size:.2f} deviations")


if __name__ == "__main__":
    run(main)
