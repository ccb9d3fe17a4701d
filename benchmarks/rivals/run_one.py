"""One rival on one case, in a process of its own: `python run_one.py MODULE FOLDER RESULT.json`."""

import contextlib
import importlib
import io
import json
import resource
import sys
import time
import traceback
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from shared.measuring import peak_mb

CPU_LIMIT_S = 120
"""A rival that takes longer on one case is stopped, and told to have failed."""


def main(name: str, folder: Path, result: Path) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT_S, CPU_LIMIT_S + 5))
    rival = importlib.import_module(name)
    data = np.load(folder / "data.npz")
    values = (data["gravity"], data["train_q"], data["train_tau"], float(data["train_rate"]))
    base = peak_mb()
    started, out = time.process_time(), {}
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            torque = rival.run(
                str(folder / "robot.urdf"), *values, data["test_q"], float(data["test_rate"])
            )
        wanted = data["test_truth" if "test_truth" in data else "test_tau"]
        out["rms"] = np.sqrt(np.mean((torque - wanted) ** 2, axis=0)).tolist()
    except Exception as error:
        # A rival that fails is a row of the table; what it said stands beside it.
        out["error"] = f"{type(error).__name__}: {error}"
        traceback.print_exc()
    out |= {"cpu_s": time.process_time() - started, "peak_mb": peak_mb(), "before_mb": base}
    result.write_text(json.dumps(out))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
