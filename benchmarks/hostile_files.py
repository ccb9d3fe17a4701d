"""Read every hostile file in a process of its own: peak memory and CPU time of each.

    python benchmarks/hostile_files.py [NAME...]

Limits: 1.5 GB and 20 s of CPU, one message of one line; an honest file of the same size is read.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recording"))
from hostile_files import DOCUMENTS, GOOD_ROWS, MAKERS, good_table

MOST_MB, MOST_S = 1500, 20.0
READ = """
import sys
from dynid.core import DynidError, load_object
from dynid.recording import read_recording
from dynid.robot import load_robot
path = sys.argv[1]
try:
    if path.endswith((".toml", ".urdf")):
        load_robot(path)
    elif path.endswith("_scene.json"):
        load_object(path)
    else:
        print("read", read_recording(path, rate_hz=125.0).samples)
except DynidError as error:
    print("refused:", error)
"""


def make(name: str, folder: Path) -> None:
    if name in DOCUMENTS:
        (folder / name).write_bytes(DOCUMENTS[name])
    elif name == "good.csv":
        good_table(folder / name)
    else:
        MAKERS[name](folder)


def main(names: list[str]) -> int:
    bad = 0
    with tempfile.TemporaryDirectory() as place:
        for name in names or ["good.csv", *MAKERS, *DOCUMENTS]:
            folder = Path(place) / name
            folder.mkdir()
            # In a process of its own: a child's peak counts from that of its parent.
            subprocess.run([sys.executable, __file__, "make", name, str(folder)], check=True)
            (path,) = folder.iterdir()
            size = path.stat().st_size
            process = subprocess.Popen(
                [sys.executable, "-c", READ, str(path)],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
            )
            assert process.stdout is not None
            said = process.stdout.read().decode().strip()
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            megabytes, seconds = usage.ru_maxrss / 1024, usage.ru_utime + usage.ru_stime
            fine = megabytes <= MOST_MB and seconds <= MOST_S and process.returncode == 0
            fine = fine and "\n" not in said and size < 20e6
            fine = fine and (name != "good.csv" or said == f"read {GOOD_ROWS}")
            bad += not fine
            print(
                f"{'ok ' if fine else 'BAD'} {name:20} {size / 1e6:6.2f} MB -> {megabytes:5.0f} MB "
                f"{seconds:5.1f} s  {said[:110]}",
                flush=True,
            )
            path.unlink()
    print(f"{bad} of {len(names) or len(MAKERS) + len(DOCUMENTS) + 1} beyond the limits")
    return bool(bad)


if __name__ == "__main__":
    if sys.argv[1:2] == ["make"]:
        make(sys.argv[2], Path(sys.argv[3]))
    else:
        sys.exit(main(sys.argv[1:]))
