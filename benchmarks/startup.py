"""How long `dynid --help` takes, beside `python -c "import numpy"`.

The commands run in turn, many times, so that both meet the same load of the machine. The
asked figure is a ratio of medians of at most 4.
"""

import statistics
import subprocess
import sys
import time
from pathlib import Path

REPETITIONS = 30
ASKED = 4.0
BIN = Path(sys.executable).parent
COMMANDS = {
    'python -c "import numpy"': [sys.executable, "-c", "import numpy"],
    "dynid --help": [str(BIN / "dynid"), "--help"],
    "dynid --version": [str(BIN / "dynid"), "--version"],
    "dynid identify --help": [str(BIN / "dynid"), "identify", "--help"],
    'python -c "import dynid"': [sys.executable, "-c", "import dynid"],
    "python -c pass": [sys.executable, "-c", "pass"],
}


def measure() -> dict[str, list[float]]:
    """Wall times of each command [s], after one run of each to warm the caches."""
    times: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for repetition in range(REPETITIONS + 1):
        for name, words in COMMANDS.items():
            start = time.perf_counter()
            subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
            if repetition:
                times[name].append(time.perf_counter() - start)
    return times


def main() -> int:
    """Print the table; 1 if the asked figure is missed."""
    times = measure()
    base = statistics.median(next(iter(times.values())))
    print(f"{'command':28}{'median ms':>10}{'fastest ms':>12}{'ratio':>8}   ({REPETITIONS} runs)")
    for name, values in times.items():
        middle = statistics.median(values)
        print(f"{name:28}{1000 * middle:10.1f}{1000 * min(values):12.1f}{middle / base:8.2f}")
    ratio = statistics.median(times["dynid --help"]) / base
    print(f"dynid --help takes {ratio:.2f} times as long as importing numpy; asked: {ASKED:g}")
    return int(ratio > ASKED)


if __name__ == "__main__":
    sys.exit(main())
