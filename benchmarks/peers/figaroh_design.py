"""Excitation by figaroh 1.0.2 on the UR5, judged by our own condition number.

figaroh plans rest-to-rest cubic splines through way points with IPOPT and finite differences, in an
environment of its own:

    python3 -m venv /tmp/peer && /tmp/peer/bin/pip install figaroh==1.0.2 cyipopt-wheels
    /tmp/peer/bin/pip install -e . example-robot-data
    /tmp/peer/bin/python benchmarks/peers/figaroh_design.py --iterations 100 --seeds 3 --save DIR

`--save DIR` keeps the motions, which `criteria.py --motions DIR` judges on its plant.

Same horizon (10 s), position and velocity limits and no collisions, as the paper's problem.
figaroh has no acceleration limit: its peak is printed beside its condition number.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import logging
import sysconfig
import time
from pathlib import Path

import figaroh.optimal.base_optimal_trajectory as figaroh_trajectory
import numpy as np
import pinocchio
from figaroh.tools.load_robot import load_robot as load_figaroh

import dynid
from dynid.identification.problem import condition_number

URDF = (
    Path(sysconfig.get_paths()["purelib"])
    / "cmeel.prefix/share/example-robot-data/robots/ur_description/urdf/ur5_robot.urdf"
)
HORIZON, WAYPOINTS, PLANNING_RATE, RATE = 10.0, 6, 50, 125


class Trajectory(figaroh_trajectory.BaseOptimalTrajectory):
    """figaroh's planner with settings given in place of a YAML file."""

    def __init__(self, robot, iterations: int) -> None:
        self.robot, self.model = robot, robot.model
        self.active_joints = list(robot.model.names[1:])
        self.logger = logging.getLogger("figaroh")
        self.trajectory_config = {
            "n_wps": WAYPOINTS,
            "freq": PLANNING_RATE,
            "t_s": HORIZON / (WAYPOINTS - 1),
            "soft_lim": 0.0,
            "max_attempts": 1000,
            "max_iterations": iterations,
            "segment_attempts": 1,
        }
        self.identif_config = {
            "act_idxv": list(range(6)),
            "has_friction": True,
            "has_actuator_inertia": True,
            "has_joint_offset": False,
            "is_joint_torques": True,
            "is_external_wrench": False,
            "force_torque": None,
            **{key: [0.0] * 6 for key in ("fv", "fs", "Ia", "rotor_inertias")},
        }
        keys = ("T_F", "P_F", "V_F", "A_F", "iteration_data")
        self.results = {key: [] for key in keys} | {"final_regressor_shape": None}

    def create_ipopt_problem(self, *arguments):
        """The problem class that figaroh ships."""
        self.problem = figaroh_trajectory.BaseTrajectoryIPOPTProblem(self, *arguments)
        return self.problem


def sampled(planned: Trajectory, path) -> tuple[np.ndarray, ...]:
    """Positions, velocities and accelerations (N, n) at 125 Hz."""
    spacing = round(PLANNING_RATE * HORIZON / (WAYPOINTS - 1))
    problem = planned.problem
    _, q, dq, ddq = planned.CB.get_full_config(
        RATE, problem.tps, path[::spacing].T, problem.vel_wps, problem.acc_wps
    )
    return tuple(np.ascontiguousarray(x)[: round(HORIZON * RATE)] for x in (q, dq, ddq))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--iterations", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--save", type=Path)
    options = parser.parse_args()
    base = dynid.reduce_model(dynid.InverseDynamicModel(robot=dynid.load_robot("ur5"), frames="dh"))
    print(f"{'seed':>4} {'cond':>8} {'CPU s':>7} {'max dq':>7} {'max ddq':>8}  end")
    for seed in range(options.seeds):
        np.random.seed(seed)  # noqa: NPY002 (figaroh draws from the global generator)
        start = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            robot = load_figaroh(str(URDF), package_dirs=str(URDF.parents[4]))
            robot.geom_model = pinocchio.GeometryModel()
            planned = Trajectory(robot, options.iterations)
            planned.initialize()
            result = planned.solve(stack_reps=1)
        spent = time.process_time() - start
        data = result["iteration_data"]
        if not data:
            print(f"{seed:4d} {'none':>8} {spent:7.1f}   no feasible result")
            continue
        q, dq, ddq = sampled(planned, np.asarray(result["P_F"][0]))
        cond = condition_number(base.model.observation_matrix(q, dq, ddq)[:, base.independent])
        speed, acceleration = np.abs(dq).max(), np.abs(ddq).max()
        if options.save is not None:
            options.save.mkdir(parents=True, exist_ok=True)
            np.savez(options.save / f"{seed}.npz", q=q, dq=dq, ddq=ddq)
        end = "converged" if data[0]["converged"] else "iteration limit"
        print(f"{seed:4d} {cond:8.1f} {spent:7.1f} {speed:7.2f} {acceleration:8.1f}  {end}")


if __name__ == "__main__":
    main()
