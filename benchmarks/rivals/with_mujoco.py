"""mujoco.sysid of MuJoCo 4.0: its parameters and optimiser on torques, by inverse dynamics."""

import mujoco
import numpy as np
from mujoco import sysid
from plain_pinocchio import motion

FEW, MANY, ITERATIONS = 150, 500, 15


def set_inertia(name):
    """mujoco.sysid's own compiles a model for each link, and leaves a NaN orientation."""

    def modify(spec, parameter):
        found = sysid.model_modifier.pi_from_theta(parameter.value)
        body, mass, com = spec.body(name), found[0], found[1:4] / found[0]
        tensor = found[4:].reshape(3, 3) - mass * (com @ com * np.eye(3) - np.outer(com, com))
        body.explicitinertial, body.mass, body.ipos = True, mass, com
        body.inertia, body.iquat = [0, 0, 0], [1, 0, 0, 0]
        body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    return modify


def parameters(spec, size):
    """Pseudo-inertia of each link; armature, damping, friction loss and offset of each joint."""
    model, found = spec.compile(), sysid.ParameterDict()
    for body in list(spec.bodies)[1:]:
        if body.name.startswith("link"):
            kind, modify = sysid.InertiaType.Pseudo, set_inertia(body.name)
            found.add(sysid.body_inertia_param(spec, model, body.name, kind, modifier=modify))
    for j, joint in enumerate(spec.joints):
        for field, share in (("armature", 0.01), ("damping", 0.1), ("frictionloss", 0.1)):

            def modify(s, p, name=joint.name, field=field):
                value = float(p.value[0])
                s.joint(name).__setattr__(field, value if field != "damping" else [value, 0, 0])

            name, start = f"{joint.name}_{field}", share * size[j]
            found.add(sysid.Parameter(name, start, 0.0, 20 * start, modifier=modify))
    found.add(sysid.Parameter("offset", 0 * size, -size, size, modifier=lambda s, p: None))
    return found


def torques(spec, parameters, path):
    """Inverse dynamics along a motion."""
    model = sysid.apply_param_modifiers(parameters, spec)
    data, out = mujoco.MjData(model), np.empty_like(path[0])
    for k, (q, dq, ddq) in enumerate(zip(*path, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out + parameters["offset"].value


def fit(urdf, gravity, path, tau, count):
    """The model and parameters that suit samples spread over a recording."""
    spec = mujoco.MjSpec.from_file(urdf)
    spec.option.gravity = gravity
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    few = np.linspace(0, len(tau) - 1, min(count, len(tau))).astype(int)
    path, wanted = [x[few] for x in path], tau[few]

    def residual(x, now):
        columns = []
        for values in x.reshape(len(x), -1).T:
            now.update_from_vector(values)
            columns.append(((torques(spec, now, path) - wanted) / tau.std(axis=0)).ravel())
        return [np.stack(columns, axis=1).reshape(-1, *x.shape[1:])], None, None

    first = parameters(spec, np.abs(tau).max(axis=0))
    how = {"optimizer": "scipy_parallel_fd", "max_iters": ITERATIONS, "verbose": False}
    return spec, sysid.optimize(first, residual, **how)[0]


def run(urdf, gravity, q, tau, rate, q_test, rate_test):
    """Cut-off by the last 30 % of the recording, then a fit to all of it."""
    errors, cut = {}, round(0.7 * len(q))
    for cutoff in (2, 4, 8, 16):
        path = motion(q, rate, cutoff)
        found = fit(urdf, gravity, [x[:cut] for x in path], tau[:cut], FEW)
        error = torques(*found, [x[cut:] for x in path]) - tau[cut:]
        errors[cutoff] = np.linalg.norm(np.sqrt(np.mean(error**2, axis=0)))
    cutoff = min(errors, key=errors.__getitem__)
    found = fit(urdf, gravity, motion(q, rate, cutoff), tau, MANY)
    return torques(*found, motion(q_test, rate_test, cutoff))
