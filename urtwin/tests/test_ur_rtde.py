"""ur_rtde, a genuine client with its genuine control script, against the simulated controller."""

import time

import numpy as np
import pytest

from rtde_client import ask_dashboard, wait_for
from urtwin import controller_process

pytestmark = pytest.mark.realtime

rtde_control = pytest.importorskip("rtde_control")
rtde_receive = pytest.importorskip("rtde_receive")
rtde_io = pytest.importorskip("rtde_io")
dashboard_client = pytest.importorskip("dashboard_client")

POSE_ERROR, JOINT_ERROR = 2e-3, 5e-3
"""Where the arm stands after a motion [m and rad], [rad]; friction leaves a rest."""
SPEED, ACCELERATION = 1.0, 2.0
"""Slow enough for the tool to stay below 1.5 m/s wherever it is [rad/s], [rad/s^2]."""
HOME = [0.0, -1.5707963, 0.0, -1.5707963, 0.0, 0.0]


@pytest.fixture
def receive(fast):
    client = rtde_receive.RTDEReceiveInterface(fast.host)
    yield client
    client.disconnect()


@pytest.fixture
def control(fast):
    assert ask_dashboard(fast.host, "safetymode", "stop")[0] == "Safetymode: NORMAL", fast.said()
    client = rtde_control.RTDEControlInterface(fast.host)
    assert client.isProgramRunning()
    yield client
    client.stopScript()
    client.disconnect()


@pytest.fixture
def dashboard(fast):
    client = dashboard_client.DashboardClient(fast.host)
    client.connect()
    yield client
    client.disconnect()


def upload_again(control):
    assert control.reuploadScript()
    # The client looks at packages that are older than its upload.
    wait_for(control.isProgramRunning, "the program runs again")


@pytest.mark.parametrize("which", ["real", "real_e"])
def test_receive_in_real_time(which, request):
    controller = request.getfixturevalue(which)
    client = rtde_receive.RTDEReceiveInterface(controller.host)
    first = client.getTimestamp()
    wait_for(lambda: client.getTimestamp() > first + 0.5, "half a second has passed")
    # A client may miss packages; it never sees a time between two cycles.
    cycles = (client.getTimestamp() - first) * controller.rate_hz
    assert cycles == pytest.approx(round(cycles), abs=1e-6)
    np.testing.assert_allclose(client.getActualQ(), HOME, atol=JOINT_ERROR)
    assert client.getRobotMode() == 7
    assert client.getSafetyMode() == 1
    assert client.getRuntimeState() == 1
    assert client.getSpeedScaling() == 1.0
    assert len(client.getJointTemperatures()) == len(client.getActualCurrent()) == 6
    client.disconnect()


def test_receive_names_what_the_controller_does_not_have(fast):
    with pytest.raises(RuntimeError, match="nonsense"):
        rtde_receive.RTDEReceiveInterface(fast.host, 125.0, ["timestamp", "nonsense"])


def test_joint_motion_and_state(control, receive):
    assert control.moveJ(HOME, SPEED, ACCELERATION)
    goal = [0.4, -1.3, 0.5, -1.2, 0.3, -0.4]
    assert control.moveJ(goal, SPEED, ACCELERATION)
    wait_for(control.isSteady, "the arm is steady")
    np.testing.assert_allclose(receive.getActualQ(), goal, atol=JOINT_ERROR)
    assert len(control.getJointTorques()) == 6
    # Without arguments: with them ur_rtde 1.6.5 writes a recipe too short for its tool.
    pose = control.getForwardKinematics()
    np.testing.assert_allclose(receive.getActualTCPPose(), pose, atol=3 * POSE_ERROR)
    np.testing.assert_allclose(control.getInverseKinematics(pose, goal), goal, atol=JOINT_ERROR)
    assert control.isPoseWithinSafetyLimits(pose)
    assert control.isJointsWithinSafetyLimits(goal)
    assert control.getTCPOffset() == [0.0] * 6


def test_straight_motion(control, receive):
    assert control.moveJ([0.0, -1.2, 1.2, -1.0, 0.8, 0.0], SPEED, ACCELERATION)
    pose = receive.getActualTCPPose()
    pose[2] += 0.1
    assert control.moveL(pose, 0.5, 1.2)
    np.testing.assert_allclose(receive.getActualTCPPose(), pose, atol=POSE_ERROR)


def test_motion_in_the_background_and_its_stop(control, receive):
    assert control.moveJ(HOME, SPEED, ACCELERATION)
    assert control.moveJ([1.5, *HOME[1:]], SPEED, ACCELERATION, True)
    wait_for(lambda: receive.getActualQ()[0] > 0.2, "the arm moves")
    control.stopJ(4.0)
    wait_for(lambda: abs(receive.getTargetQd()[0]) == 0.0, "the arm stands")
    assert 0.2 < receive.getActualQ()[0] < 1.5
    assert control.getAsyncOperationProgress() < 0


def test_servo_and_speed_motion(control, receive):
    assert control.moveJ(HOME, SPEED, ACCELERATION)
    for step in range(51):
        assert control.servoJ([0.004 * step, *HOME[1:]], 0.0, 0.0, 0.008, 0.1, 300)
        time.sleep(0.001)
    wait_for(lambda: abs(receive.getActualQ()[0] - 0.2) < JOINT_ERROR, "the last set point")
    assert control.servoStop()
    assert control.speedJ([0.0, 0.0, 0.0, 0.0, 0.5, 0.0], 2.0)
    wait_for(lambda: receive.getTargetQ()[4] > 0.3, "the fifth joint turns")
    np.testing.assert_allclose(receive.getTargetQd()[4], 0.5, atol=1e-6)
    assert control.speedStop(10.0)
    wait_for(lambda: receive.getTargetQd()[4] == 0.0, "the fifth joint stands")


def test_scripts_are_stopped_and_uploaded_again(control, receive):
    control.stopScript()
    wait_for(lambda: receive.getRuntimeState() == 1, "the program has stopped")
    upload_again(control)
    assert control.moveJ(HOME, SPEED, ACCELERATION)


def test_a_watchdog_that_is_not_kicked_stops_the_script(control, receive):
    assert control.setWatchdog(10.0)
    for _ in range(20):
        control.kickWatchdog()
        time.sleep(0.02)
    assert receive.getRuntimeState() == 2
    wait_for(lambda: receive.getRuntimeState() == 1, "the watchdog has stopped the program")
    upload_again(control)


def test_a_protective_stop_and_its_release(control, receive, dashboard):
    control.triggerProtectiveStop()
    wait_for(receive.isProtectiveStopped, "the protective stop")
    assert receive.getSafetyMode() == 3
    assert receive.getSafetyStatusBits() & 1 << 2
    wait_for(lambda: receive.getRuntimeState() == 1, "the program has been stopped")
    assert dashboard.safetymode() == "Safetymode: PROTECTIVE_STOP"
    stopped = receive.getTimestamp()
    wait_for(lambda: receive.getTimestamp() > stopped + 5.1, "five seconds, in virtual time")
    dashboard.closeSafetyPopup()
    dashboard.unlockProtectiveStop()
    wait_for(lambda: not receive.isProtectiveStopped(), "the release")
    upload_again(control)
    assert control.moveJ(HOME, SPEED, ACCELERATION)


def test_a_second_control_client_is_told_who_writes(control, fast):
    with pytest.raises(RuntimeError, match="in use"):
        rtde_control.RTDEControlInterface(fast.host)


def test_inputs_and_outputs(fast, receive):
    io = rtde_io.RTDEIOInterface(fast.host)
    assert io.setStandardDigitalOut(3, True)
    wait_for(lambda: receive.getDigitalOutState(3), "the output is on")
    assert io.setStandardDigitalOut(3, False)
    wait_for(lambda: not receive.getDigitalOutState(3), "the output is off")
    assert io.setSpeedSlider(0.5)
    wait_for(lambda: receive.getTargetSpeedFraction() == 0.5, "the speed slider at half")
    assert io.setSpeedSlider(1.0)
    wait_for(lambda: receive.getTargetSpeedFraction() == 1.0, "the speed slider at full")
    assert io.setAnalogOutputVoltage(0, 0.5)
    wait_for(lambda: receive.getStandardAnalogOutput0() > 0.0, "the analog output")
    assert io.setInputIntRegister(18, 42)
    assert io.setInputDoubleRegister(18, 4.25)
    io.disconnect()


def test_dashboard(dashboard, control):
    assert dashboard.isConnected()
    assert dashboard.robotmode() == "Robotmode: RUNNING"
    assert dashboard.safetymode() == "Safetymode: NORMAL"
    assert dashboard.polyscopeVersion() == "3.15.8.106339"
    assert dashboard.getRobotModel() == "UR5"
    assert dashboard.programState().startswith("PLAYING")
    assert dashboard.running()
    dashboard.stop()
    wait_for(lambda: not dashboard.running(), "the program has stopped")
    dashboard.powerOff()
    wait_for(lambda: dashboard.robotmode() == "Robotmode: POWER_OFF", "the power is off")
    dashboard.powerOn()
    wait_for(lambda: dashboard.robotmode() == "Robotmode: IDLE", "the power is on")
    dashboard.brakeRelease()
    wait_for(lambda: dashboard.robotmode() == "Robotmode: RUNNING", "the brakes are open")
    upload_again(control)


def test_two_robots_side_by_side():
    with (
        controller_process("ur5", virtual_time=True) as one,
        controller_process("ur10e", virtual_time=True) as two,
    ):
        first = rtde_control.RTDEControlInterface(one.host)
        second = rtde_control.RTDEControlInterface(two.host)
        assert first.moveJ([0.3, *HOME[1:]], SPEED, ACCELERATION)
        assert second.moveJ([-0.3, *HOME[1:]], SPEED, ACCELERATION)
        for host, angle in ((one.host, 0.3), (two.host, -0.3)):
            receive = rtde_receive.RTDEReceiveInterface(host)
            assert receive.getActualQ()[0] == pytest.approx(angle, abs=JOINT_ERROR)
            receive.disconnect()
        for client in (first, second):
            client.stopScript()
            client.disconnect()


def test_a_path_with_blends_does_not_stop_on_its_way(control, receive):
    assert control.moveJ(HOME, SPEED, ACCELERATION)

    def took(radius):
        began = receive.getTimestamp()
        ways = [(0.2, radius), (0.4, radius), (0.6, 0.0)]
        path = [[angle, *HOME[1:], 0.5, ACCELERATION, blend] for angle, blend in ways]
        assert control.moveJ(path)
        np.testing.assert_allclose(receive.getActualQ(), [0.6, *HOME[1:]], atol=JOINT_ERROR)
        seconds = receive.getTimestamp() - began
        assert control.moveJ(HOME, SPEED, ACCELERATION)
        return seconds

    # Three moves of 0.65 s each, or one of 1.45 s.
    assert took(0.1) < took(0.0) - 0.3


def test_force_mode_moves_the_free_tool(control, receive):
    assert control.moveJ([0.0, -1.2, 1.2, -1.0, 0.8, 0.0], SPEED, ACCELERATION)
    before = receive.getActualTCPPose()[2]
    frame, down, limits = [0.0] * 6, [0, 0, -10, 0, 0, 0], [2.0, 2.0, 0.04, 1.0, 1.0, 1.0]
    assert control.forceMode(frame, [0, 0, 1, 0, 0, 0], down, 2, limits)
    wait_for(lambda: receive.getActualTCPPose()[2] < before - 0.02, "the tool moves down")
    assert receive.getTargetTCPSpeed()[2] == pytest.approx(-0.04, rel=0.05)
    assert control.forceModeStop()
    wait_for(lambda: abs(receive.getTargetTCPSpeed()[2]) < 1e-4, "the tool stands")
