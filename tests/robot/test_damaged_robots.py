"""Whatever happens to a robot file, the answer is a sound robot or one clear line."""

from __future__ import annotations

import random
import re
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from robot_oracles import EXAMPLES
from test_robot_files import FULL
from urdf_samples import ARM, URS

from dynid.core import InputError
from dynid.robot import joint_poses, load_robot, nominal_geometry, structural_gravity

DAMAGES, MORE_DAMAGES = range(200), range(200, 700)
SECONDS = 3.0
"""CPU time for one file: more would be a bomb [s]."""
LIBRARY = Path(load_robot.__code__.co_filename).parent / "library"
TOML = [FULL, *(path.read_text() for path in [LIBRARY / "ur5.toml", *EXAMPLES.glob("*.toml")])]
URDF = [ARM, URS["ur5"], (EXAMPLES / "tx40.urdf").read_text()]
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?")
ODD = [
    "nan", "inf", "-inf", "1e300", "-1e9", "1e-300", "0", "-0.0", "9" * 400, "true", '"x"', "[]",
    "{}", "1979-05-27", "0x1F", "", "1_000", "${x}", "\x00", "é", "\u0661",
]  # fmt: skip
WORDS = ["", "a", "\n", "joint", "link", "nan", "😀", "x" * 300, "base", "__class__", "../../x"]


def _bytes(data: bytes, dice: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(dice.choice([1, 1, 2, 5, 40])):
        changed[dice.randrange(len(changed))] = dice.randrange(256)
    return bytes(changed)


def _cut(data: bytes, dice: random.Random) -> bytes:
    at = dice.randrange(len(data))
    return data[:at] if dice.random() < 0.6 else data[at:]


def _drop_lines(data: bytes, dice: random.Random) -> bytes:
    lines = data.split(b"\n")
    for _ in range(dice.choice([1, 1, 2, 4])):
        lines.pop(dice.randrange(len(lines)))
        if not lines:
            break
    return b"\n".join(lines)


def _shuffle_lines(data: bytes, dice: random.Random) -> bytes:
    lines = data.split(b"\n")
    first, second = dice.randrange(len(lines)), dice.randrange(len(lines))
    lines[first], lines[second] = lines[second], lines[first]
    lines.insert(first, lines[second])
    return b"\n".join(lines)


def _numbers(data: bytes, dice: random.Random) -> bytes:
    text = data.decode("utf-8", "replace")
    found = list(NUMBER.finditer(text))
    for match in sorted(
        dice.sample(found, min(len(found), dice.choice([1, 1, 3]))), key=lambda m: -m.start()
    ):
        new = dice.choice(ODD) if dice.random() < 0.7 else str(dice.gauss(0, 10) ** 5)
        text = text[: match.start()] + new + text[match.end() :]
    return text.encode("utf-8", "surrogatepass")


def _words(data: bytes, dice: random.Random) -> bytes:
    text = data.decode("utf-8", "replace")
    found = list(re.finditer(r"[A-Za-z_]\w+", text))
    if not found:
        return data
    match = dice.choice(found)
    other = dice.choice(found).group() if dice.random() < 0.5 else dice.choice(WORDS)
    if dice.random() < 0.5:  # everywhere
        return text.replace(match.group(), other).encode()
    return (text[: match.start()] + other + text[match.end() :]).encode()


HEADERS = [
    b"", b"\xff\xfe", b"#" * 1_100_000 + b"\n", b"<" * 99, b"[" * 999, b"\n\n",
    b"<?xml version='1.0' encoding='x'?>", b"<!-- " + b"-" * 5000,
]  # fmt: skip


def _headers(data: bytes, dice: random.Random) -> bytes:
    return dice.choice(HEADERS) + data


def _nothing(data: bytes, dice: random.Random) -> bytes:
    return dice.choice([b"", b"\n", b"\0", b"<robot/>", b"<", b"[", b"a=1", data * 2, data[::-1]])


WAYS: list[Callable[[bytes, random.Random], bytes]] = [
    _bytes, _cut, _drop_lines, _shuffle_lines, _numbers, _numbers, _words, _words, _headers,
    _nothing,
]  # fmt: skip


def _judge(path: Path) -> str:
    start = time.process_time()
    try:
        robot = load_robot(path)
        assert np.isfinite(robot.placements).all()
        poses = joint_poses(robot, np.full(robot.joints, 0.3))
        assert np.isfinite(poses).all()
        structural_gravity(nominal_geometry(robot))
        lines = [*robot.notes, robot.name, robot.source, *robot.joint_names]
        outcome = "robot"
    except InputError as error:
        lines, outcome = [str(error)], "error"
    assert all(len(line) < 10_000 for line in lines)
    assert not any("\n" in line or "\0" in line for line in lines), lines
    assert time.process_time() - start < SECONDS
    return outcome


@pytest.mark.parametrize("seeds", [DAMAGES, pytest.param(MORE_DAMAGES, marks=pytest.mark.long)])
@pytest.mark.parametrize(("texts", "suffix"), [(TOML, "toml"), (URDF, "urdf")])
def test_damaged_files(
    texts: list[str],
    suffix: str,
    seeds: range,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "tx40.urdf").write_text(URDF[2])
    outcomes = {"robot": 0, "error": 0}
    for seed in seeds:
        dice = random.Random(seed)
        data = dice.choice(texts).encode()
        for _ in range(dice.choice([1, 1, 1, 2, 3])):
            data = dice.choice(WAYS)(data, dice) if data else data
        path = tmp_path / f"x.{suffix if dice.random() < 0.9 else 'csv'}"
        path.write_bytes(data)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                outcomes[_judge(path)] += 1
        except Exception as error:
            kept = Path("/tmp") / f"damaged_{seed}.{suffix}"
            kept.write_bytes(data)
            raise AssertionError(f"seed {seed}, kept as {kept}: {error!r}") from error
    assert outcomes["error"] > len(seeds) / 5
    assert outcomes["robot"] > len(seeds) / 20
    assert capfd.readouterr() == ("", "")
