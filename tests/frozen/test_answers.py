"""The fast answers of release 0.1 are today's, but for the differences of `intended.toml`."""

from __future__ import annotations

import json

from answers import ANY_KERNEL, GOLDEN, INTENDED, commands, compare, differences


def test_the_fast_commands_answer_as_release_0_1_did() -> None:
    wrong = compare(commands(fast=True), ANY_KERNEL, speak=False)
    assert not wrong, "\n".join(wrong)


def test_every_command_has_an_answer_and_every_answer_a_command() -> None:
    kept = json.loads(GOLDEN.read_text(encoding="utf-8"))["answers"]
    assert {command.name for command in commands()} == set(kept)
    assert INTENDED.exists()


def test_differences_are_seen() -> None:
    before = {"exit": 0, "rmse": [1.0, 2.0], "warnings.codes": ["at_rest"], "names": ["m2"]}
    assert differences(before, {**before, "new": 3, "rmse": [1.0, 2.0 + 1e-6]}, 1e-5) == {}
    for key, value in (
        ("exit", 1),
        ("rmse", [1.0, 2.001]),
        ("rmse", [1.0]),
        ("warnings.codes", []),
        ("names", ["m3"]),
    ):
        assert set(differences(before, {**before, key: value}, 1e-5)) == {key}
    assert set(differences(before, {"exit": 0}, 1e-5)) == {"rmse", "warnings.codes", "names"}
