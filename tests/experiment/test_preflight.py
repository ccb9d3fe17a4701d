"""What keeps a robot from moving, each thing alone."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from dynid.constraints import safe_constraints
from dynid.core import InputError, JobError
from dynid.drivers import ControllerState
from dynid.experiment import ExperimentPlan, check_design, check_robot, plan_approach, require_ready
from dynid.experiment.preflight import PreflightCheck
from dynid.robot import load_robot, with_tool
from rest_motions import rest_series

UR5 = load_robot("ur5")
MIDDLE = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])
SERIES = rest_series(2.0, MIDDLE, 0.05 * np.random.default_rng(0).normal(size=(6, 4)))
CONSTRAINTS = safe_constraints(UR5)
PLAN = ExperimentPlan(robot=UR5, trajectory=SERIES)
READY = ControllerState(
    host="127.0.1.9",
    version=(3, 15, 8, 0),
    model="UR5",
    remote=None,
    rate_hz=125.0,
    q=PLAN.start + 0.01,
    target_qd=np.zeros(6),
    temperature=np.full(6, 24.0),
    robot_mode=7,
    safety_mode=1,
    runtime_state=1,
    speed_fraction=1.0,
    payload=0.0,
    payload_cog=np.zeros(3),
)


def looked(plan: ExperimentPlan, state: ControllerState) -> tuple[PreflightCheck, ...]:
    return check_robot(plan, state, plan_approach(state.q, plan.start, CONSTRAINTS))


def failed(state: ControllerState, plan: ExperimentPlan = PLAN) -> list[str]:
    return [check.name for check in looked(plan, state) if not check.passed]


def test_a_robot_that_is_ready_passes() -> None:
    checks = looked(PLAN, READY)
    assert failed(READY) == []
    require_ready(checks, READY.host)
    assert check_design(PLAN, CONSTRAINTS).feasible


def test_a_robot_with_a_name_of_its_own_is_told_how_to_say_its_model() -> None:
    own = replace(PLAN, robot=replace(UR5, name="ur5_lab"))
    with pytest.raises(JobError, match=r'design for ur5_lab.*by its name, such as name = "ur5e"'):
        require_ready(looked(own, READY), READY.host)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"model": "UR10"}, "model"),
        ({"version": (5, 11, 0, 0)}, "model"),
        ({"rate_hz": 500.0}, "rate"),
        ({"robot_mode": 5}, "robot mode"),
        ({"safety_mode": 3}, "safety mode"),
        ({"runtime_state": 2}, "program"),
        ({"remote": False}, "remote control"),
        ({"speed_fraction": 0.8}, "speed slider"),
        ({"target_qd": np.full(6, 0.1)}, "at rest"),
        ({"payload": 1.2}, "payload"),
        ({"tcp_offset": np.array([0.0, 0.0, 0.15])}, "tool"),
        ({"round_trip_s": 0.15}, "network"),
        ({"freedrive": True}, "freedrive"),
    ],
)
def test_each_thing_alone_keeps_it_from_moving(changes: dict[str, object], name: str) -> None:
    state = replace(READY, **changes)  # pyright: ignore[reportArgumentType]
    assert failed(state) == [name]
    with pytest.raises(JobError, match=f"not ready; {name}") as caught:
        require_ready(looked(PLAN, state), state.host)
    assert caught.value.exit_code == 1
    assert "127.0.1.9" in str(caught.value)


def test_all_that_is_wrong_stands_in_one_message() -> None:
    state = replace(READY, robot_mode=5, speed_fraction=0.5)
    with pytest.raises(JobError, match=r"robot mode: idle.*speed slider: 50 %") as caught:
        require_ready(looked(PLAN, state), state.host)
    assert "100 %" in str(caught.value.next_step)


def test_an_e_series_robot_needs_an_e_series_controller() -> None:
    plan = ExperimentPlan(robot=load_robot("ur5e"), trajectory=SERIES, rate_hz=500.0)
    e_series = replace(READY, version=(5, 11, 0, 0), rate_hz=500.0, remote=True)
    assert failed(e_series, plan) == []
    assert failed(replace(e_series, version=(3, 15, 0, 0)), plan) == ["model"]
    # Of a robot with a name of its own nobody knows the series.
    own = replace(PLAN, robot=replace(UR5, name="mine"))
    for version in ((3, 15, 0, 0), (5, 11, 0, 0)):
        assert failed(replace(READY, model="", version=version), own) == []
    # Such a controller has a switch, but nobody who tells it.
    silent = looked(plan, replace(e_series, model="", remote=None))
    assert any(check.finding == "it does not say" for check in silent)


def test_the_payload_asked_for_must_be_set_with_its_centre() -> None:
    plan = replace(PLAN, robot=with_tool(UR5, payload=[1.2, 0.0, 0.0, 0.05]))
    assert failed(READY, plan) == ["payload"]
    assert any("--payload" in check.finding for check in looked(plan, READY))
    held = replace(READY, payload=1.2, payload_cog=np.array([0.0, 0.0, 0.05]))
    assert failed(held, plan) == []
    for wrong in ({"payload_cog": np.zeros(3)}, {"payload": 1.0}):
        assert failed(replace(held, **wrong), plan) == ["payload"]  # type: ignore[arg-type]
    # Old software does not tell its payload; the person is told what it must be.
    silent = looked(plan, replace(READY, payload=None, payload_cog=None))
    assert any("1.2 kg" in check.finding for check in silent)


def test_a_design_beyond_the_limits_is_refused() -> None:
    wild = rest_series(2.0, MIDDLE, 2.0 * np.random.default_rng(0).normal(size=(6, 4)))
    plan = ExperimentPlan(robot=UR5, trajectory=wild)
    with pytest.raises(InputError, match=r"must not run on ur5: .*velocity") as caught:
        check_design(plan, CONSTRAINTS)
    assert caught.value.exit_code == 2
    # Value, limit and margin stand there, and the step concerns the robot as it was described.
    assert re.search(
        r"velocity \(\w+\): -?[\d.]+ at \S+ s, limit 3\.142 less 5 %", str(caught.value)
    )
    assert re.search(r"collision \([^)]+\): -?[\d.]+ at \S+ s, limit 0\.\d+[;.]", str(caught.value))
    assert "with the same options" in str(caught.value)


def test_a_slow_pass_that_needs_more_torque_is_refused() -> None:
    """It was never judged: at full speed the acceleration takes some of the gravity torque off."""
    arm = with_tool(load_robot("ur10e"), payload=(12.5, 0, 0, 0.1))
    judge, random = safe_constraints(arm, collision=False), np.random.default_rng(136954)
    middle = random.uniform(-1.5, 1.5, 6) - 1.5 * np.eye(6)[1]
    motion = rest_series(4.0, middle, 0.15 * random.normal(size=(6, 4)))
    fast = ExperimentPlan(robot=arm, trajectory=motion)
    assert check_design(fast, judge).worst["torque"].margin > 0.08
    with pytest.raises(InputError, match=r"the slow pass .* torque \(elbow_joint\): 145\.6"):
        check_design(replace(fast, slow=0.2), judge)
    check_design(replace(fast, slow=0.9), judge)


def test_a_way_to_the_start_beyond_the_limits_is_refused() -> None:
    far = replace(READY, q=PLAN.start + np.array([0, 0, 0, 0, 0, 9.0]))
    assert failed(far) == ["way to the start"]


def test_what_cannot_be_judged_must_be_accepted_by_name() -> None:
    bare = safe_constraints(replace(UR5, bodies=()))
    with pytest.raises(InputError, match=r"cannot be judged.*accept_unjudged") as no:
        check_design(PLAN, bare)
    # All of them: no second refusal for the next one.
    for kind in ("self_collision", "environment"):
        assert f"--accept-unjudged {kind}" in str(no.value.next_step)
    with pytest.raises(InputError, match="environment cannot be judged"):
        check_design(PLAN, bare, ("self_collision",))
    found = check_design(PLAN, bare, ("self_collision", "environment"))
    assert found.verdict == "unjudged"
    # A height of the floor helps no robot without bodies: it is refused.
    (floor,) = (item for item in found.unjudged if item.kind == "environment")
    assert "[[capsule]]" in floor.next_step


def test_the_tool_is_compared_with_the_controllers() -> None:
    plan = replace(PLAN, robot=with_tool(UR5, tcp=[0.0, 0.0, 0.15]))
    assert failed(replace(READY, tcp_offset=np.array([0.0, 0.0, 0.15])), plan) == []
    assert failed(replace(READY, tcp_offset=np.zeros(3)), plan) == ["tool"]
