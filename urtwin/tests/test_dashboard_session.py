"""Dashboard commands and the exact words that clients compare."""

import pytest

from dynid.core import InputError
from dynid.protocol import dashboard as words
from urtwin.dashboard import LONGEST_LINE, DashboardSession, program_folder

PROGRAM = "def work():\n  while True:\n    sync()\n  end\nend\n"


@pytest.fixture
def folder(tmp_path):
    """As a robot's `/programs`: PolyScope keeps the script beside the program."""
    programs = tmp_path / "programs"
    (programs / "line 1").mkdir(parents=True)
    for name, text in (("work", PROGRAM), ("bad", "def ("), ("line 1/deep", PROGRAM)):
        (programs / f"{name}.script").write_text(text)
    (programs / "work.urp").write_bytes(b"\x1f\x8b")
    (programs / "binary.script").write_bytes(b"\xff\xfe")
    (tmp_path / "secret.script").write_text(PROGRAM)
    return programs


@pytest.fixture
def session(machine, folder):
    return DashboardSession(machine, "UR5", "20240001", program_folder(folder))


def run(machine, cycles):
    for _ in range(cycles):
        machine.tick()


# The answers of UR's dashboard article, as UR's own client reads them
# (Universal_Robots_Client_Library, src/ur/dashboard_client_implementation_g5.cpp and its tests).
EVERYWHERE = [
    ("robotmode", "Robotmode: RUNNING"),
    ("safetymode", "Safetymode: NORMAL"),
    ("running", "Program running: false"),
    ("programState", "STOPPED null"),
    ("isProgramSaved", "true null"),
    ("get loaded program", "No program loaded"),
    ("get robot model", "UR5"),
    ("get serial number", "20240001"),
    ("stop", "Stopped"),
    ("play", "Failed to execute: play"),
    ("pause", "Failed to execute: pause"),
    ("load missing.urp", "File not found: missing.urp"),
    ("load bad.urp", "Error while loading program: bad.urp"),
    ("load /programs/work.urp", "Loading program: /programs/work.urp"),
    ("load installation default.installation", "Loading installation: default.installation"),
    ("popup hello", "showing popup"),
    ("close popup", "closing popup"),
    ("close safety popup", "closing safety popup"),
    ("unlock protective stop", "Protective stop releasing"),
    ("addToLog hello", "Added log message"),
    ("addToLog", "No log message to add"),
    ("saveLog", "Log saved to disk"),
    ("  POWER   ON ", "Powering on"),
    ("power off", "Powering off"),
    ("brake release", "Brake releasing"),
    ("restart safety", "Restarting safety"),
    ("shutdown", "Shutting down"),
    ("quit", "Disconnected"),
    ("dance", "could not understand: 'dance'"),
    ("", "could not understand: ''"),
]
CB = [
    ("setUserRole operator", "Setting user role: operator"),
    ("setUserRole king", "Failed setting user role: king"),
    ("getUserRole", "NONE"),
    ("version", "could not understand: 'version'"),
    ("safetystatus", "could not understand: 'safetystatus'"),
    ("is in remote control", "could not understand: 'is in remote control'"),
    ("get operational mode", "could not understand: 'get operational mode'"),
    ("set operational mode manual", "could not understand: 'set operational mode manual'"),
]
E_SERIES = [
    ("version", "5.12.0.1101319"),
    ("safetystatus", "Safetystatus: NORMAL"),
    ("is in remote control", "true"),
    ("get operational mode", "NONE"),
    ("set operational mode AUTOMATIC", "Operational mode 'AUTOMATIC' is set"),
    ("set operational mode no", "Failed setting operational mode: no"),
    (
        "clear operational mode",
        "No longer controlling the operational mode. Current operational mode: 'NONE'.",
    ),
    ("setUserRole operator", "could not understand: 'setUserRole operator'"),
    ("getUserRole", "could not understand: 'getUserRole'"),
]


@pytest.mark.parametrize(("command", "reply"), EVERYWHERE + CB)
def test_replies_of_the_cb_series(session, command, reply):
    assert session.answer(command) == reply


@pytest.mark.parametrize(("command", "reply"), EVERYWHERE + E_SERIES)
def test_replies_of_the_e_series(e_machine, folder, command, reply):
    session = DashboardSession(e_machine, "UR5", "20240001", program_folder(folder))
    assert session.answer(command) == reply


def test_older_software_does_not_know_newer_commands():
    assert not words.known_to("get serial number", (3, 11))
    assert words.known_to("get serial number", (3, 12))
    assert not words.known_to("get operational mode", (5, 5))
    assert words.known_to("play", (3, 0))


def test_reports_that_nobody_makes_are_refused(session):
    assert session.answer("generate flight report system").startswith("Error")
    assert session.answer("generate support file .").startswith("Error")


def test_a_restart_of_the_safety_system_leaves_the_power_off(machine, session):
    session.answer("restart safety")
    run(machine, 2)
    assert session.answer("robotmode") == "Robotmode: POWER_OFF"


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
    # It had the name of the last script from then on.
    machine.run_script("def other():\n sleep(0.1)\nend")
    machine.tick()
    assert session.answer("programState") == "PLAYING other"
    assert session.answer("get loaded program") == "Loaded program: work.urp"
    run(machine, 20)
    assert session.answer("play") == words.STARTING
    assert session.answer("programState") == "PLAYING work.urp"


def test_power_goes_off_and_on_again(machine, session):
    assert session.answer("power off") == words.POWERING_OFF
    run(machine, 2)
    assert session.answer("robotmode") == "Robotmode: POWER_OFF"
    assert session.answer("brake release") == words.RELEASING
    run(machine, 500)
    assert session.answer("robotmode") == "Robotmode: RUNNING"


def test_a_protective_stop_is_unlocked_after_five_seconds(machine, session):
    machine.core.protective_stop("C153: test")
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


@pytest.mark.parametrize(
    "name", ["work.urp", "/programs/work.urp", "work.script", "line 1/deep.urp", "/work.urp"]
)
def test_programs_of_the_folder_load_and_play(session, machine, name):
    assert session.answer(f"load {name}") == f"Loading program: {name}"
    assert session.answer("get loaded program") == f"Loaded program: {name}"
    assert session.answer("play") == "Starting program"
    run(machine, 2)
    assert session.answer("programState") == f"PLAYING {name}"


@pytest.mark.parametrize(
    "name",
    [
        "",
        "work",
        "../secret.urp",
        "/programs/../../secret.urp",
        "binary.urp",
        "line 1",
        "/",
        ".urp",
    ],
)
def test_what_is_no_program_of_the_folder_is_not_found(session, name):
    assert session.answer(f"load {name}") == f"File not found: {name}"


def test_a_program_is_read_when_it_is_loaded(session, machine, folder):
    (folder / "work.script").write_text("def ")
    assert session.answer("load work.urp") == "Error while loading program: work.urp"
    (folder / "work.script").write_text(PROGRAM)
    assert session.answer("load work.urp") == "Loading program: work.urp"


def test_a_folder_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        program_folder(tmp_path / "nowhere")
