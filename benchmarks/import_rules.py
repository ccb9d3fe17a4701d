"""What each rule of the import earns: one after the other is taken out.

    python benchmarks/import_rules.py [RULE...]

Three answers for each rule of `dynid.recording.repair.pipeline.RULES`: the tests of repairs and of
damage that fail without it; damaged files, of 60 each of three text formats, that are then wrong
without a word; and the recordings of ../shared/data that are read otherwise. A rule without any
of them earns nothing.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import random
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "recording"), str(ROOT / "benchmarks")]

import test_damage  # noqa: E402
from real_recordings import cases  # noqa: E402

from dynid.core import InputError  # noqa: E402
from dynid.recording import read_recording  # noqa: E402
from dynid.recording.repair import pipeline  # noqa: E402

TESTS = ("test_repairs.py", "test_dropouts.py", "test_input_checks.py")
DAMAGED = 60


class _Failures:
    """Counts the tests that fail."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.names.append(report.nodeid.rpartition("::")[2])


def failing_tests() -> int:
    """How many tests of repairs fail."""
    seen = _Failures()
    words = ["-q", "-p", "no:cacheprovider", "--rootdir", str(ROOT)]
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main([*words, *(str(ROOT / "tests/recording" / x) for x in TESTS)], plugins=[seen])
    return len(set(seen.names))


def wrong_in_silence(folder: Path) -> int:
    """Damaged text files that are read wrongly and without a problem."""
    wrong = 0
    for name in ("ur-csv", "csv", "csv-counted"):
        write, options, text = test_damage.FORMATS[name]
        data = write(test_damage.MOTION, folder / "whole").read_bytes()
        for seed in range(DAMAGED):
            content, _ = test_damage.damaged(data, random.Random(f"{name} {seed}"), text)
            (folder / "damaged").write_bytes(content)
            try:
                record = read_recording(folder / "damaged", **options)
            except InputError:
                continue
            off = record.joints != 6 or test_damage.error_of(record, test_damage.MOTION) > 0.02
            wrong += off and not record.problems
    return wrong


def readings(data: Path) -> dict[str, str]:
    """Each real recording's name to a digest of what was read, or why it was not."""
    try:
        found = cases(data) if data.is_dir() else []
    except InputError as error:
        return {"all": str(error)}
    digests: dict[str, str] = {}
    for case in found:
        digest = hashlib.sha256(case.record.t.tobytes())
        for value in case.record.signals.values():
            digest.update(value.tobytes())
        codes = sorted(problem.code for problem in case.record.problems)
        digests[case.name] = f"{digest.hexdigest()[:12]} {codes}"
    return digests


def main() -> None:
    """Print one line a rule."""
    rules = pipeline.RULES
    whole = readings(ROOT.parent / "shared" / "data")
    names = sys.argv[1:] or [rule.name for rule in rules]
    print(f"{'rule':20} {'tests':>6} {'silent':>7}  recordings that are read otherwise")
    with tempfile.TemporaryDirectory() as folder:
        for name in ["(all)", *names]:
            pipeline.RULES = tuple(rule for rule in rules if rule.name != name)
            now = readings(ROOT.parent / "shared" / "data")
            other = [key for key, value in whole.items() if now.get(key, now.get("all")) != value]
            counts = failing_tests(), wrong_in_silence(Path(folder))
            print(f"{name:20} {counts[0]:6} {counts[1]:7}  {', '.join(other) or '-'}", flush=True)
    pipeline.RULES = rules


if __name__ == "__main__":
    main()
