"""What release 0.1 could do, row by row: a feature that is taken out turns its row red.

`inventory.json` was made by `list_features.py`. A row that leaves on purpose goes into its table
`left`, with the reason that CHANGELOG.md gives too.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recorded_files as recorded
from answers import Answer, ask

import dynid

HERE = Path(__file__).parent
FILES = HERE / "files"
INVENTORY = json.loads((HERE / "inventory.json").read_text(encoding="utf-8"))
ROWS = [(kind, row) for kind, rows in INVENTORY["rows"].items() for row in rows]
LEFT: dict[str, str] = INVENTORY["left"]
CHECKS: dict[str, Callable[..., None]] = {}

Fixture = pytest.FixtureRequest


def check(*kinds: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The function that exercises rows of these kinds."""

    def note(function: Callable[..., None]) -> Callable[..., None]:
        CHECKS.update(dict.fromkeys(kinds, function))
        return function

    return note


@pytest.mark.parametrize(
    ("kind", "row"), [pytest.param(k, r, id=f"{k}: {r}".replace("::", ":")) for k, r in ROWS]
)
def test_row(kind: str, row: str, tmp_path: Path, request: Fixture) -> None:
    if f"{kind}: {row}" in LEFT:
        return
    given = {"row": row, "kind": kind, "folder": tmp_path}
    function = CHECKS[kind]
    names = inspect.signature(function).parameters
    function(*(given[name] if name in given else request.getfixturevalue(name) for name in names))


def test_what_left_is_known_and_told() -> None:
    told = (HERE.parents[1] / "CHANGELOG.md").read_text(encoding="utf-8")
    for row, reason in LEFT.items():
        kind, _, name = row.partition(": ")
        assert (kind, name) in ROWS, row
        assert len(reason.split()) > 3, row
        assert name.split(" VALUE")[0] in told, f"{row} is not in CHANGELOG.md"


@check("command")
def help_of_a_command(row: str) -> None:
    assert ask([*row.split(), "--help"], parse=False)["exit"] == 0


def words_of(row: str) -> tuple[str, list[str]]:
    """The command of a row of options, and the option as it is given."""
    *command, option = row.removesuffix(" VALUE").split()
    return " ".join(command), [option, *(["1"] if row.endswith(" VALUE") else [])]


@functools.cache
def takes_all_values(command: str) -> bool:
    """Whether all options of a command that have a value are taken at once."""
    # The parser refuses unknown options before it shows the help, and takes the value of known.
    assert ask([*command.split(), "--no-such-option", "--help"], parse=False)["exit"] == 2
    given = [words_of(row) for row in INVENTORY["rows"]["option"] if f"option: {row}" not in LEFT]
    # Flags are asked one by one: what has become an option with a value would take the next one.
    words = [w for other, option in given if other == command and option[1:] for w in option]
    return ask([*command.split(), *words, "--help"], parse=False)["exit"] == 0


@check("option")
def option_is_taken(row: str) -> None:
    command, option = words_of(row)
    together = takes_all_values(command) and len(option) == 2
    assert together or ask([*command.split(), *option, "--help"], parse=False)["exit"] == 0


@check("name")
def public_name(row: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        found = getattr(dynid, row)
    if row != "__version__":
        assert inspect.isclass(found) == row[0].isupper()
        assert found.__doc__


@check("robot")
def built_in_robot(row: str) -> None:
    assert row in {robot.name for robot in dynid.robots()}
    assert dynid.load_robot(row).joints == 6


@pytest.fixture(scope="module")
def ur5() -> dynid.RobotModel:
    return dynid.load_robot("ur5")


@check("format")
def format_is_read(row: str, folder: Path, ur5: dynid.RobotModel) -> None:
    columns = recorded.FORMATS[row](folder)
    files = sorted(folder.iterdir())
    source = files if len(files) > 1 else files[0]
    record = dynid.read_recording(source, robot=ur5, columns=columns)
    torque = record.signals.get("current", record.signals.get("effort"))
    for values, truth in ((record.signals["q"], recorded.Q), (torque, recorded.CURRENT)):
        np.testing.assert_allclose(values, truth, atol=1e-7)
    np.testing.assert_allclose(record.t, recorded.T - recorded.T[0], atol=1e-7)


@check("format word")
def format_word_is_known(row: str, folder: Path) -> None:
    writers = {
        "ur-csv": "ur record.py",
        "ur-rtde-csv": "ur_rtde csv",
        "csv": "ur_rtde csv",
        "rosbag": "ros 2 db3",
        "mcap": "ros 2 mcap",
        "mat": "matlab 5",
    }
    columns = recorded.FORMATS[writers.get(row, row)](folder)
    (path,) = folder.iterdir()
    record = dynid.read_recording(path, format=row, columns=columns)
    assert record.samples == recorded.ROWS
    with pytest.raises(dynid.InputError):
        dynid.read_recording(path, format="npz" if row != "npz" else "mcap", columns=columns)


@check("repair")
def damage_is_repaired(row: str, folder: Path, ur5: dynid.RobotModel) -> None:
    damage = recorded.REPAIRS[row]
    text = recorded.text_of(damage.table, damage.names or recorded.NAMES)
    (folder / "run.csv").write_text(text[: len(text) - damage.cut])
    record = dynid.read_recording(folder / "run.csv", robot=ur5, **dict(damage.settings))
    codes = {problem.code for problem in record.problems}
    assert damage.code in codes if damage.code else not codes
    assert record.samples == damage.rows
    if record.samples == recorded.ROWS:
        np.testing.assert_allclose(record.signals["q"], recorded.Q, atol=damage.tolerance)


@check("code")
def code_is_found(row: str, findings: set[str]) -> None:
    by_repair = {damage.code for damage in recorded.REPAIRS.values()}
    assert row in by_repair | findings


@pytest.fixture(scope="module")
def cold() -> dynid.ExperimentRecord:
    return dynid.read_record(FILES / "cold.parquet")


@pytest.fixture(scope="module")
def findings(cold: dynid.ExperimentRecord, ur5: dynid.RobotModel) -> set[str]:
    """Codes of identifications that go wrong in different ways."""
    paper = dynid.IdentifySettings(preset="paper")
    short = replace(paper, stop_s=1.2)
    found = [dynid.identify([cold], ur5, short, validation=cold, validation_start_s=2.0)]
    current = cold.signals["current"]
    for other in (-current, current * (1 + 0.2 * np.sin(9 * cold.t))[:, None]):
        record = replace(cold, signals={**cold.signals, "current": other})
        found.append(dynid.identify([record], ur5, paper))
    return {notice.code for result in found for notice in result.warnings}


@pytest.fixture(scope="module")
def fit(
    cold: dynid.ExperimentRecord, ur5: dynid.RobotModel
) -> Callable[[str], dynid.Identification]:
    """Identifications by the word of their estimator, each made once."""

    @functools.cache
    def made(word: str) -> dynid.Identification:
        settings = dynid.IdentifySettings(preset="paper", estimator=word)
        return dynid.identify([cold], ur5, settings)

    return made


@check("estimator")
def estimator_fits(
    row: str, fit: Callable[[str], dynid.Identification], undiagnosed_once: None
) -> None:
    result = fit(row)
    assert result.estimate.estimator == row
    # All rows are judged, also the ends that an estimation leaves out: 6.35 % of irls is the most.
    assert result.training.metrics.relative_error_overall_percent < 6.5
    kept = dynid.read_estimate(FILES / "estimate.json")
    assert kept.estimator == "ols"
    # Each is a method of its own; recursive least squares ends at the same numbers. Release 0.1,
    # which wrote the file, mirrored a motion at its ends.
    if row != "rls":
        away = np.abs(result.estimate.values - kept.values) / kept.std
        assert (away.max() < 0.01) == (row == "ols")


@check("export")
def export_is_written_and_loaded(
    row: str, folder: Path, fit: Callable[[str], dynid.Identification]
) -> None:
    written = dynid.write_model(fit("sdp").estimate, folder / f"model.{row}", row)
    assert written.path.stat().st_size > 1000
    assert written.verified.max_torque_difference is not None
    assert written.verified.max_torque_difference < 1e-5


CRITERIA, TRAJECTORIES = (
    [row for row in INVENTORY["rows"][kind] if f"{kind}: {row}" not in LEFT]
    for kind in ("criterion", "trajectory")
)
DESIGN = [
    "design",
    "ur5",
    "--method",
    "ga",
    "--population",
    "4",
    "--generations",
    "1",
    "--limits",
    "paper",
    "--jobs",
    "1",
]


@pytest.fixture(scope="module")
def designs(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Answer, Path]]:
    """A small design for each criterion, the trajectories in turn; all exports of each."""
    found: list[tuple[Answer, Path]] = []
    for k, criterion in enumerate(CRITERIA):
        folder = tmp_path_factory.mktemp(criterion)
        words = ["--criterion", criterion, "--trajectory", TRAJECTORIES[k % len(TRAJECTORIES)]]
        for option in INVENTORY["rows"]["motion export"]:
            words += [option, str(folder / option)]
        path = folder / "design.json"
        found.append((ask([*DESIGN, *words, "-o", str(path), "--json"]), path))
    return found


@check("criterion")
def criterion_is_designed_for(row: str, designs: list[tuple[Answer, Path]]) -> None:
    answer, _ = designs[CRITERIA.index(row)]
    assert (answer["exit"], answer["criterion"]) == (0, row)
    assert all(f"criteria.{row}" in answer for answer, _ in designs)


@check("trajectory")
def trajectory_is_designed(row: str, designs: list[tuple[Answer, Path]]) -> None:
    _, path = designs[TRAJECTORIES.index(row)]
    assert dynid.read_trajectory(path).trajectory.joints == 6
    word = {"modified-fourier": "fourier"}.get(row, row)
    assert json.loads(path.read_text())["trajectory"]["type"] == word


@check("motion export")
def motion_is_exported(row: str, designs: list[tuple[Answer, Path]]) -> None:
    sign = {"--csv": r"^t \[s\],", "--urscript": r"servoj\(", "--ros": r"joint_names:"}[row]
    for _, path in designs:
        assert re.search(sign, (path.parent / row).read_text(), re.MULTILINE)


def _stored(folder: Path, motion: dict[str, Any]) -> Path:
    """The design of release 0.1 with another motion."""
    document = json.loads((FILES / "design.json").read_text())
    path = folder / "motion.json"
    path.write_text(json.dumps({**document, "trajectory": motion}))
    return path


@check("trajectory file")
def trajectory_file_is_read(row: str, folder: Path) -> None:
    zero, one = [0.0] * 6, [0.1] * 6
    waves = {"a": [[0.05, -0.05]] * 6, "b": [[0.1, -0.025]] * 6}
    quintic = {"type": "quintic", "travel_time": 2.0, "start": zero, "goal": one}
    motions: dict[str, dict[str, Any]] = {
        "fourier": {"period": 4.0, "offset": one, **waves},
        "fourier-quintic": {"period": 4.0, "start": zero, "goal": one, **waves},
        "bspline": {"travel_time": 3.0, "degree": 5, "control": [[0.1 * k for k in range(9)]] * 6},
        "quintic": quintic,
        "sequence": {"parts": [quintic, {**quintic, "start": one, "goal": zero}]},
        "repetition": {
            "times": 2,
            "part": {"type": "fourier", "period": 4.0, "offset": one, **waves},
        },
    }
    length = {"bspline": 3.0, "quintic": 2.0, "repetition": 8.0}.get(row, 4.0)
    motion = dynid.read_trajectory(_stored(folder, {"type": row, **motions[row]})).trajectory
    assert motion.duration == pytest.approx(length)
    assert np.isfinite(motion.evaluate(np.linspace(0, length, 9)).q).all()


@check("term")
def friction_term_has_columns(row: str, ur5: dynid.RobotModel) -> None:
    other = "fv" if row == "fc" else "fc"
    names, fewer = (
        dynid.InverseDynamicModel(robot=ur5, friction=dynid.parse_terms(terms)).names
        for terms in (f"{other},{row}:2", other)
    )
    assert len(names) == len(fewer) + 1


@dataclass
class Controller:
    """What a simulated UR controller answered to all that clients know of release 0.1."""

    outputs: dict[str, str] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    dashboard: dict[str, str] = field(default_factory=dict)
    interpreter: dict[str, str] = field(default_factory=dict)
    lines: dict[str, bytes] = field(default_factory=dict)


MODBUS = {
    "modbus_add_signal()": '"10.0.0.9", 255, 5, 1, "output"',
    "modbus_delete_signal()": '"output"',
    "modbus_get_signal_status()": '"output", False',
    "modbus_set_output_register()": '"output", 58, False',
    "modbus_set_output_signal()": '"output", True, False',
}
"""What these functions take, as UR's script manual has them; release 0.1 took calls without."""


def names_of(kind: str) -> list[str]:
    return [row.split()[0] for row in INVENTORY["rows"][kind]]


@contextlib.contextmanager
def controller(robot: str, software: str, host: str) -> Iterator[Callable[[int], socket.socket]]:
    # Nothing here needs the 500 Hz of an e-Series controller.
    words = ["--robot", robot, "--software", software, "--host", host, "--rate", "125", "--json"]
    process = subprocess.Popen(
        [sys.executable, "-m", "dynid", "controller", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline())["host"] == host
        yield lambda port: socket.create_connection((host, port), timeout=20.0)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20.0)
        process.stdout.close()  # type: ignore[union-attr]


def ask_lines(sock: socket.socket, lines: list[str], greeting: bool) -> dict[str, str]:
    with sock, sock.makefile("rw", newline="\n") as stream:
        if greeting:
            stream.readline()
        found: dict[str, str] = {}
        for line in lines:
            stream.write(line + "\n")
            stream.flush()
            found[line] = stream.readline().rstrip("\n")
    return found


def rtde_types(sock: socket.socket, kind: int, names: list[str]) -> dict[str, str]:
    """The types of variables as a controller answers them (UR's RTDE guide, version 2)."""

    def exchange(code: int, payload: bytes) -> bytes:
        sock.sendall(struct.pack(">HB", len(payload) + 3, code) + payload)
        while True:
            head = read(3)
            body = read(struct.unpack(">H", head[:2])[0] - 3)
            if head[2] == code:
                return body

    def read(count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = sock.recv(count - len(data))
            assert more, "the controller hung up"
            data += more
        return data

    with sock:
        assert exchange(86, struct.pack(">H", 2)) == b"\x01"
        rate = struct.pack(">d", 125.0) if kind == 79 else b""
        answer = exchange(kind, rate + ",".join(names).encode())
    return dict(zip(names, answer[1:].decode().split(","), strict=True))


def primary_says(sock: socket.socket, line: str) -> bytes:
    """What comes on the primary port after a line was sent, until the second robot state."""
    with sock:
        sock.recv(65536)
        sock.sendall(line.encode() + b"\n")
        return b"".join(sock.recv(65536) for _ in range(2))


@pytest.fixture(scope="module")
def ur() -> Controller:
    pid = os.getpid()
    host = f"127.77.{pid >> 8 & 255}.{max(pid & 255, 1)}"
    lines = [row for row in INVENTORY["rows"]["script line"] if row != "power off"]
    plain = [row for row in INVENTORY["rows"]["dashboard"] if row not in ("shutdown", "quit")]
    said = Controller()
    with controller("ur5", "3.15.8", host) as connect:
        said.dashboard = ask_lines(connect(29999), ["getuserrole", "setuserrole none"], True)
    with controller("ur5e", "5.25.0", host) as connect:
        said.outputs = rtde_types(connect(30004), 79, names_of("rtde output"))
        said.inputs = rtde_types(connect(30004), 73, names_of("rtde input"))
        ask_lines(connect(29999), ["power on", "brake release"], True)
        for line in ("no such words", *lines):
            said.lines[line] = primary_says(connect(30001), line)
        with connect(30002) as script:
            script.sendall(b"def p():\n l = [1, 2]\n interpreter_mode()\nend\n")
            script.recv(65536)
            calls = INVENTORY["rows"]["urscript"]
            methods = INVENTORY["rows"]["urscript method"]
            given = {call: call.replace("()", f"({MODBUS.get(call, '')})") for call in calls}
            texts = {f"if False: {given[call]} end": call for call in calls}
            texts["if False: nonsense() end"] = "nonsense()"
            texts |= {f"if False: l.{call} end": call for call in ("nonsense(0)", *methods)}
            # Lines that came before the program was in its mode are discarded.
            first = "if False: acos(0) end"
            while not ask_lines(connect(30020), [first], False)[first].startswith("ack"):
                pass
            answered = ask_lines(connect(30020), list(texts), False)
            said.interpreter = {texts[line]: answer for line, answer in answered.items()}
        said.lines["power off"] = primary_says(connect(30001), "power off")
        e_series = [row for row in plain if "userrole" not in row]
        said.dashboard |= ask_lines(connect(29999), e_series, True)
        said.dashboard |= ask_lines(connect(29999), ["quit"], True)
        said.dashboard |= ask_lines(connect(29999), ["shutdown"], True)
    return said


@check("rtde output", "rtde input")
def rtde_variable(row: str, kind: str, ur: Controller) -> None:
    name, expected = row.split()
    assert (ur.outputs if kind == "rtde output" else ur.inputs)[name] == expected


@check("dashboard")
def dashboard_command(row: str, ur: Controller) -> None:
    answer = {"setuserrole x": "setuserrole none"}.get(row, row)
    assert ur.dashboard[answer]
    assert not ur.dashboard[answer].startswith("could not understand")


@check("script line")
def line_on_a_script_port(row: str, ur: Controller) -> None:
    assert b"rror" in ur.lines["no such words"]
    assert b"rror" not in ur.lines[row]


@check("urscript", "urscript method")
def urscript_function(row: str, ur: Controller) -> None:
    assert ur.interpreter["nonsense()"].startswith("discard")
    assert ur.interpreter["nonsense(0)"].startswith("discard")
    assert ur.interpreter[row].startswith("ack"), ur.interpreter[row]
