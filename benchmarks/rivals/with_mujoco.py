"""mujoco.sysid of MuJoCo 4.0: forward rollouts of short windows, Gauss-Newton."""

import mujoco
import numpy as np
from mujoco import sysid
from plain_pinocchio import motion

WINDOWS, WINDOW_S, STEP_S, ITERATIONS, CUTOFF_HZ = 24, 0.25, 0.002, 10, 8


def specification(urdf, gravity):
    """The arm with a motor and two sensors a joint."""
    spec = mujoco.MjSpec.from_file(urdf)
    spec.option.gravity, spec.option.timestep = gravity, STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in spec.joints:
        joint.actfrclimited = False
        motor = spec.add_actuator(name=f"m_{joint.name}", target=joint.name)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        for word in ("JOINTPOS", "JOINTVEL"):
            spec.add_sensor(
                name=f"{word}_{joint.name}",
                type=getattr(mujoco.mjtSensor, f"mjSENS_{word}"),
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=joint.name,
            )
    return spec


def set_inertia(name):
    """mujoco.sysid leaves a NaN orientation, which MuJoCo 4.0 does not compile."""

    def modify(spec, parameter):
        sysid.apply_body_inertia(spec, name, parameter)
        spec.body(name).iquat = [1, 0, 0, 0]

    return modify


def parameters(spec, model, scale):
    """Pseudo-inertia of each link; armature, damping and friction loss of each joint."""
    found = sysid.ParameterDict()
    for body in list(spec.bodies)[1:]:
        if body.name.startswith("link"):
            kind = sysid.InertiaType.Pseudo
            found.add(
                sysid.body_inertia_param(
                    spec, model, body.name, inertia_type=kind, modifier=set_inertia(body.name)
                )
            )
    for j, joint in enumerate(spec.joints):
        for field, share in (("armature", 0.01), ("damping", 0.1), ("frictionloss", 0.1)):
            start = share * scale[j]

            def modify(s, p, name=joint.name, field=field):
                value = float(p.value[0])
                s.joint(name).__setattr__(field, value if field != "damping" else [value, 0, 0])

            name = f"{joint.name}_{field}"
            found.add(sysid.Parameter(name, start, 0.0, 20 * start, modifier=modify))
    return found


def run(urdf, gravity, q, tau, rate, q_test, rate_test):
    """Windows spread over the recording; torques of the test by MuJoCo's inverse dynamics."""
    spec = specification(urdf, gravity)
    model = spec.compile()
    q_s, dq_s, _ = motion(q, rate, CUTOFF_HZ)
    steps = round(WINDOW_S / STEP_S)
    data, windows = mujoco.MjData(model), []
    for start in np.linspace(0.5, len(q) / rate - WINDOW_S - 0.5, WINDOWS):
        t = start + STEP_S * np.arange(steps + 1)
        clock = np.arange(len(q)) / rate

        def at(values, t=t, clock=clock):
            return np.column_stack([np.interp(t, clock, column) for column in values.T])

        now_q, now_dq = at(q_s), at(dq_s)
        data.qpos[:], data.qvel[:] = now_q[0], now_dq[0]
        state = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
        rows = np.stack([now_q, now_dq], axis=2).reshape(len(t), -1)
        control = sysid.TimeSeries(t - start, at(tau))
        sensor = sysid.TimeSeries.from_names(t - start, rows, model)
        windows.append((f"window {start:.2f} s", state, control, sensor))
    first = parameters(spec, model, np.abs(tau).max(axis=0))
    residual = sysid.build_residual_fn(
        models_sequences=[sysid.ModelSequences("arm", spec, *zip(*windows, strict=True))]
    )
    found, _ = sysid.optimize(first, residual, max_iters=ITERATIONS, verbose=False)
    sysid.apply_param_modifiers_spec(found, spec)
    model = spec.compile()
    data, out = mujoco.MjData(model), np.empty_like(q_test)
    for k, (a, b, c) in enumerate(zip(*motion(q_test, rate_test, CUTOFF_HZ), strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = a, b, c
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out
