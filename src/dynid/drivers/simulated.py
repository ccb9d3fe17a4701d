"""The simulated arm in this process: no sockets, faster than real time."""

import json
from threading import Event

import numpy as np

from dynid.core import Array, DynidError, InputError, Progress
from dynid.drivers import driver
from dynid.simulation import PlantState, SimulatedArm, SimulatedPlant, Thermal, recorded, stacked

_BLOCK = 8
"""Cycles that are recorded, or told, together: less than the 0.1 s in which a stop is due."""
STOP_S = 0.08
"""Time in which a stop takes the set points to rest [s]."""
_STANDSTILL, _STANDSTILL_S = 1e-3, 2.0
"""Speed of an arm that stands [rad/s or m/s], and how long it is waited for [s]."""


class SimulatedDriver(driver.Driver):
    """Moves the simulated arm and records what its sensors see.

    Args:
        arm: The simulated arm.
        thermal: `cold`, `warm`, one temperature or one a joint [degC], at the start; executions
            warm it further.
        seed: Seed of the measurement noise.

    Raises:
        InputError: A thermal state that is none.
    """

    def __init__(self, arm: SimulatedArm, *, thermal: Thermal = "cold", seed: int = 0) -> None:
        self.arm = arm
        self.seed = seed
        self.states: list[PlantState] = []
        """The exact states behind the recorded samples: the truth."""
        self.rest: PlantState | None = None
        """The state in which the last execution left the arm."""
        self._start = arm.truth.thermal.start(thermal)
        self._temperature = self._start
        self._noise = np.random.default_rng(seed)

    @property
    def source(self) -> driver.Source:
        """See `Driver.source`."""
        return driver.Source(
            quantities=driver.QUANTITIES,
            channels=("index",),
            format="simulation",
            origin=f"simulated {self.arm.robot.name}, seed {self.seed}",
            drive_gains=self.arm.made_up_gains,
            extra={
                "seed": str(self.seed),
                "start_degC": json.dumps([round(float(value), 2) for value in self._start]),
            },
        )

    def execute(
        self,
        execution: driver.Execution,
        recorder: driver.Recorder | None,
        *,
        cancel: Event | None = None,
        progress: Progress | None = None,
    ) -> driver.Outcome:
        """See `Driver.execute`."""
        setpoints, joints = execution.setpoints(), self.arm.robot.joints
        if setpoints.shape[1] != joints:
            raise InputError("joints of the motion", value=setpoints.shape[1], limit=joints)
        plant = SimulatedPlant(
            self.arm, rate_hz=execution.rate_hz, thermal=self._temperature, pose=setpoints[0]
        )
        watchdog = driver.Watchdog(execution.limits, execution.rate_hz, execution.total)
        block: list[PlantState] = []
        abort: driver.Abort | None = None
        samples = k = 0
        for k in range(execution.total):
            state = plant.tick(setpoints[k % execution.cycles])
            aim = state.target.q
            cycle = driver.Cycle(timestamp=state.t, index=k, q=state.q, qd=state.dq, target_q=aim)
            abort = watchdog.see(cycle)
            if recorder is not None and k >= execution.first_recorded:
                block.append(state)
            if abort is None and cancel is not None and cancel.is_set():
                abort = driver.INTERRUPTED
            more = (len(block) or k + 1) % _BLOCK > 0 and k + 1 < execution.total
            if abort is None and more:
                continue
            if recorder is not None:
                samples, refused = self._record(recorder, block, samples, execution.rate_hz)
                abort = abort or refused
            block = []
            if progress is not None:
                progress("run", (k + 1) / execution.total)
            if abort is not None:
                break
        self.rest = _stop(plant, setpoints[k % execution.cycles], execution.rate_hz)
        self._temperature = plant.temperature
        periods = samples // execution.cycles
        return driver.Outcome(samples=samples, periods=periods, gaps=0, abort=abort)

    def _record(
        self, recorder: driver.Recorder, block: list[PlantState], samples: int, rate_hz: float
    ) -> tuple[int, driver.Abort | None]:
        """Measure and record some states; how many there are now, and whether it failed."""
        if not block:
            return samples, None
        signals = recorded(self.arm.truth, stacked(block), self._noise)
        try:
            for k, state in enumerate(block):
                row = {name: values[k] for name, values in signals.items()}
                recorder.append(samples / rate_hz, row, {"index": float(samples)})
                self.states.append(state)
                samples += 1
        except DynidError as error:
            return samples, driver.Abort("recording", error.changed(next_step=None).line)
        return samples, None


def _stop(plant: SimulatedPlant, setpoint: Array, rate_hz: float) -> PlantState:
    """Brake evenly within `STOP_S`, then hold until the arm stands still."""
    state = plant.tick(setpoint)
    speed, aim = state.target.dq, setpoint.copy()
    braking = max(round(STOP_S * rate_hz), 1)
    for k in range(braking + round(_STANDSTILL_S * rate_hz)):
        if k >= braking and np.abs(state.dq).max() < _STANDSTILL:
            break
        aim = aim + max(1.0 - (k + 1) / braking, 0.0) * speed / rate_hz
        state = plant.tick(aim)
    return state
