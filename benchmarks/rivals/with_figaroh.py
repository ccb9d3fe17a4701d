"""figaroh 1.0.2: the subclass and the settings that its generic pipeline needs."""

import figaroh.identification.base_identification as figaroh
import numpy as np
from figaroh.tools.load_robot import load_robot
from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced


class Identification(figaroh.BaseIdentification):
    """Data and settings in memory, in the place of CSV and YAML files."""

    def __init__(self, robot, q, tau, rate, cutoff):
        self.given, self.cutoff, n = (q, tau, rate), cutoff, robot.model.nv
        self.settings = {
            "active_joints": list(robot.model.names[1:]),
            "act_idxq": list(range(n)),
            "act_idxv": list(range(n)),
            "has_friction": True,
            "has_actuator_inertia": True,
            "has_joint_offset": True,
            "is_joint_torques": True,
            "is_external_wrench": False,
            "force_torque": None,
            **{key: [0.0] * n for key in ("fv", "fs", "Ia", "rotor_inertias", "offset", "off")},
        }
        super().__init__(robot)

    def load_param(self, config_file, setting_type="identification"):
        """Settings from memory."""
        self.identif_config = self.settings

    def load_trajectory_data(self, data_source=None):
        """Data from memory."""
        q, tau, rate = self.given
        self.filter_config = {
            "differentiation_method": "gradient",
            "filter_params": {
                "nbutter": 4,
                "f_butter": self.cutoff,
                "med_fil": 5,
                "f_sample": rate,
            },
        }
        keys = ("timestamps", "positions", "velocities", "accelerations", "torques")
        return dict(zip(keys, (np.arange(len(q)) / rate, q, None, None, tau), strict=True))


def solved(robot, q, tau, rate, cutoff):
    """Weighted least squares, thinned to about 125 Hz by figaroh."""
    found, factor = Identification(robot, q, tau, rate, cutoff), round(rate / 125)
    found.initialize()
    found.solve(decimate=factor > 1, decimation_factor=max(factor, 1), plotting=False, wls=True)
    return found


def predicted(found, q, rate):
    """Torques of another motion, through figaroh's own filter, regressor and base columns."""
    found.given = (q, np.zeros_like(q), rate)
    found.process_data()
    motion = (found.processed_data[key] for key in ("positions", "velocities", "accelerations"))
    W = build_regressor_basic(found.robot, *motion, found.identif_config)
    W = build_regressor_reduced(W, found._idx_eliminated)[:, found._base_indices]
    return (W @ found.phi_base).reshape(q.shape[1], -1).T


def run(urdf, gravity, q, tau, rate, q_test, rate_test):
    """Cut-off by the last 30 % of the recording, then a fit to all of it."""
    robot = load_robot(urdf)
    robot.model.gravity.linear = gravity
    errors, cut = {}, round(0.7 * len(q))
    for cutoff in (2, 4, 8, 16):
        part = solved(robot, q[:cut], tau[:cut], rate, cutoff)
        error = predicted(part, q[cut:], rate) - tau[cut:]
        errors[cutoff] = np.linalg.norm(np.sqrt(np.mean(error**2, axis=0)))
    found = solved(robot, q, tau, rate, min(errors, key=errors.__getitem__))
    return predicted(found, q_test, rate_test)
