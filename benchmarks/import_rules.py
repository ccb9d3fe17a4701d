"""What each rule of the import earns: one after the other is taken out.

    python benchmarks/import_rules.py [RULE...]

Four answers for each rule of `dynid.recording.repair.pipeline.RULES`: the tests that fail without
it; damaged text files (60 of each of three formats, short and long) that are then refused, wrong
and reported, or wrong in silence; and the recordings of ../shared/data that are read otherwise. A
rule without any of them earns nothing. Files are read once: rules work on the raw tables.
"""

import contextlib
import hashlib
import io
import random
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import pytest
from real_recordings import SOURCES, Source
from shared.measuring import DATA, ROOT, run

from dynid.core import InputError
from dynid.recording import RawTable, ReadOptions, parse_columns, reading, repair
from dynid.recording.content import Budget
from dynid.recording.repair import pipeline
from dynid.robot import RobotModel, load_robot

RECORDING = ROOT / "tests" / "recording"
sys.path[:0] = [str(RECORDING)]
import test_damage  # noqa: E402
from recorded_motions import Motion  # noqa: E402

TESTS = ("repairs", "dropouts", "input_checks", "text_tables", "foreign_headers", "ros_bags")
DAMAGED = 60
LENGTHS = (160, 1500)
Given = tuple[RawTable, ReadOptions, RobotModel | None]


def failing_tests() -> int:
    """How many tests of repairs fail."""
    failed: set[str] = set()

    class Plugin:
        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            failed.update([report.nodeid] if report.failed else [])

    words = ["-q", "-p", "no:cacheprovider", "--rootdir", str(ROOT)]
    with contextlib.redirect_stdout(io.StringIO()):
        pytest.main([*words, *(str(RECORDING / f"test_{x}.py") for x in TESTS)], plugins=[Plugin()])
    return len(failed)


def damaged_tables(folder: Path) -> list[tuple[Motion, Given]]:
    """Damaged text files that can be read, as raw tables, and the motion that is true."""
    found: list[tuple[Motion, Given]] = []
    for length in LENGTHS:
        motion = Motion(samples=length, rate=125)
        for name in ("ur-csv", "csv", "csv-counted"):
            write, options, text = test_damage.FORMATS[name]
            data = write(motion, folder / "whole").read_bytes()
            for seed in range(DAMAGED):
                content, _ = test_damage.damaged(data, random.Random(f"{name} {seed}"), text)
                (folder / "damaged").write_bytes(content)
                with contextlib.suppress(InputError):
                    table = _table([folder / "damaged"], options.get("columns"))
                    given = table, ReadOptions(rate_hz=options.get("rate_hz")), None
                    found.append((motion, given))
    return found


def outcome(motion: Motion, given: Given) -> str:
    """What a damaged file becomes."""
    try:
        record = repair(*given)
        off = record.joints != 6 or test_damage.error_of(record, motion) > 0.02
    except (InputError, ValueError):
        return "refused"
    return ("wrong, reported" if record.problems else "silent") if off else "right"


def real_tables() -> dict[str, Given]:
    """The recordings of ../shared/data as raw tables."""
    sources = dict(SOURCES)
    for path in sorted((DATA / "kinova_gen3").glob("*.csv")):
        sources[path.stem] = Source("gen3", (str(path),))
    found: dict[str, Given] = {}
    for name, source in sources.items():
        of = source.load_robot()
        table = _table([DATA / file for file in source.files], source.columns, of)
        found[name] = table, ReadOptions(rate_hz=source.rate_hz), of
    ur5 = load_robot("ur5")
    for folder in sorted((DATA / "ur5_kufieta").glob("no*")):
        table = _table(sorted(folder.glob("*.csv")), None, ur5)
        found[f"UR5 {folder.name}"] = table, ReadOptions(), ur5
    return found


def _table(files: list[Path], columns: str | None, of: RobotModel | None = None) -> RawTable:
    wanted = None if columns is None else parse_columns(columns)
    options = ReadOptions(columns=wanted, joints=() if of is None else of.joint_names)
    found = reading.read_table(files, options, Budget.of(files))
    assert isinstance(found, RawTable)
    return found


def digest(given: Given) -> str:
    """What a real recording becomes."""
    try:
        record = repair(*given)
    except (InputError, ValueError) as error:
        return str(error)
    found = hashlib.sha256(record.t.tobytes())
    for value in record.signals.values():
        found.update(value.tobytes())
    return f"{found.hexdigest()} {[problem.text for problem in record.problems]}"


def main(names: tuple[str, ...] = (), /) -> None:
    """Print one line a rule."""
    rules = pipeline.RULES
    known = [rule.apply.__name__ for rule in rules]
    if unknown := {*names} - {*known}:
        sys.exit(f"no rules: {', '.join(unknown)}; there are {', '.join(known)}")
    # Without a rule, those after it get what they never get.
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        damaged = damaged_tables(Path(folder))
    real = real_tables() if DATA.is_dir() else {}
    before = {name: digest(given) for name, given in real.items()}
    words = ("refused", "wrong, reported", "silent")
    usual = Counter(outcome(*item) for item in damaged)
    print(f"{len(damaged)} damaged tables, {len(real)} recordings; {dict(usual)}")
    print(f"{'rule':22} tests  damaged: {', '.join(words)}; recordings that are read otherwise")
    for name in names or known:
        pipeline.RULES = tuple(rule for rule in rules if rule.apply.__name__ != name)
        now = Counter(outcome(*item) for item in damaged)
        more = "".join(f"{now[word] - usual[word]:+6}" for word in words)
        other = [key for key, given in real.items() if digest(given) != before[key]]
        print(f"{name:22} {failing_tests():5} {more}  {', '.join(other) or '-'}", flush=True)
    pipeline.RULES = rules


if __name__ == "__main__":
    run(main)
