"""Dashboard commands and the exact words that clients compare."""

import pytest

from dynid.protocol import dashboard as words
from dynid.simulation.controller.dashboard import LONGEST_LINE, DashboardSession

PROGRAM = "def work():\n  while True:\n    sync()\n  end\nend\n"


@pytest.fixture
def session(machine):
    return DashboardSession(machine, "UR5", "20240001", {"work.urp": PROGRAM, "bad.urp": "def ("})


def run(machine, cycles):
    for _ in range(cycles):
        machine.tick()


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        ("robotmode", "Robotmode: RUNNING"),
        ("safetymode", "Safetymode: NORMAL"),
        ("safetystatus", "Safetystatus: NORMAL"),
        ("running", "Program running: false"),
        ("programState", "STOPPED null"),
        ("get loaded program", "No program loaded"),
        ("get robot model", "UR5"),
        ("get serial number", "20240001"),
        ("is in remote control", "true"),
        ("version", "3.15.8.106339"),
        ("stop", "Stopped"),
        ("play", "Failed to execute: play"),
        ("pause", "Failed to execute: pause"),
        ("load missing.urp", "File not found: missing.urp"),
        ("load bad.urp", "Error while loading program: bad.urp"),
        ("load /programs/work.urp", "Loading program: /programs/work.urp"),
        ("popup hello", "showing popup"),
        ("close popup", "closing popup"),
        ("close safety popup", "closing safety popup"),
        ("addToLog hello", "Added log message"),
        ("setUserRole operator", "Setting user role: operator"),
        ("setUserRole king", "Failed setting user role: king"),
        ("  POWER   ON ", "Powering on"),
        ("dance", "could not understand: 'dance'"),
        ("", "could not understand: ''"),
    ],
)
def test_replies(session, command, reply):
    assert session.answer(command) == reply


def test_the_version_has_four_numbers(session):
    assert "3.15.8.106339" in session.answer("PolyscopeVersion")


def test_a_program_is_loaded_played_paused_and_stopped(machine, session):
    assert session.answer("load work.urp") == "Loading program: work.urp"
    assert session.answer("get loaded program").startswith("Loaded program: ")
    assert session.answer("play") == words.STARTING
    run(machine, 3)
    assert session.answer("programState").startswith("PLAYING work")
    assert session.answer("running") == "Program running: true"
    assert session.answer("pause") == words.PAUSING
    assert session.answer("programState").startswith("PAUSED work")
    assert session.answer("play") == words.STARTING
    assert session.answer("stop") == words.STOPPED
    assert session.answer("programState").startswith("STOPPED work")


def test_power_goes_off_and_on_again(machine, session):
    assert session.answer("power off") == words.POWERING_OFF
    run(machine, 2)
    assert session.answer("robotmode") == "Robotmode: POWER_OFF"
    assert session.answer("brake release") == words.RELEASING
    run(machine, 500)
    assert session.answer("robotmode") == "Robotmode: RUNNING"


def test_a_protective_stop_is_unlocked_after_five_seconds(machine, session):
    machine.protective_stop("C153: test")
    run(machine, 10)
    assert session.answer("safetymode") == "Safetymode: PROTECTIVE_STOP"
    assert session.answer("unlock protective stop") == words.UNLOCK_TOO_EARLY
    run(machine, 640)
    assert session.answer("unlock protective stop") == words.UNLOCKING
    assert session.answer("safetymode") == "Safetymode: NORMAL"


def test_lines_come_in_any_pieces_and_one_reply_each(session):
    assert session.receive(b"robotm") == []
    assert session.receive(b"ode\r\nrunn") == ["Robotmode: RUNNING"]
    assert session.receive(b"ing\nsafetymode\n") == [
        "Program running: false",
        "Safetymode: NORMAL",
    ]
    assert session.receive(b"quit\nrobotmode\n") == [words.DISCONNECTED]
    assert session.over


def test_a_line_without_end_is_refused(session):
    (said,) = session.receive(b"x" * (LONGEST_LINE + 1))
    assert "no command is longer" in said
    assert session.over


def test_a_driver_reads_the_value():
    assert words.value("Robotmode: RUNNING") == "RUNNING"
    assert words.value("true") == "true"
