"""Read every hostile file in a process of its own: peak memory and CPU time of each.

    python benchmarks/hostile_files.py [NAME...]

Limits: 1.5 GB and 20 s of CPU, one message of one line; an honest file of the same size is read.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from shared.measuring import ROOT, child, run

sys.path.insert(0, str(ROOT / "tests" / "recording"))
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


def main(names: tuple[str, ...] = ("good.csv", *MAKERS, *DOCUMENTS), /) -> bool:
    bad = 0
    for name in names:
        with tempfile.TemporaryDirectory() as place:
            # In a process of its own: a child's peak counts from that of its parent.
            child([__file__, "make", name, place])
            (path,) = Path(place).iterdir()
            size = path.stat().st_size
            found = child(["-c", READ, path], stderr=subprocess.STDOUT, check=False)
        fine = found.peak_mb <= MOST_MB and found.cpu_s <= MOST_S and found.code == 0
        fine = fine and "\n" not in found.said and size < 20e6
        fine = fine and (name != "good.csv" or found.said == f"read {GOOD_ROWS}")
        bad += not fine
        print(
            f"{'ok ' if fine else 'BAD'} {name:20} {size / 1e6:6.2f} MB -> {found.peak_mb:5.0f} MB "
            f"{found.cpu_s:5.1f} s  {found.said[:110]}",
            flush=True,
        )
    print(f"{bad} of {len(names)} beyond the limits")
    return bad > 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["make"]:
        make(sys.argv[2], Path(sys.argv[3]))
    else:
        run(main)
