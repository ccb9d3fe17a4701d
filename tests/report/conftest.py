from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.report import ReportContents
from dynid.simulation import SERIAL, simulated_arm
from dynid.trajectory import write_trajectory
from dynid.workflow import report


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory as a run leaves it: records with their truth, a trajectory, two estimates."""
    folder = tmp_path_factory.mktemp("run")
    robot = dynid.load_robot("ur5")
    arm = simulated_arm(robot, serial=SERIAL)
    records = []
    for seed, name in ((1, "identification"), (2, "validation")):
        series = dynid.random_excitation(robot.limits, seed=seed)
        record = dynid.simulate_recording(robot, series, periods=1, seed=seed)
        # As of a run of three periods that was stopped in the third.
        planned = {"periods": "3", "period_s": repr(0.4 * series.duration)}
        record = replace(record, metadata=replace(record.metadata, extra=planned))
        dynid.write_record(record, folder / f"{name}.parquet")
        records.append(dynid.read_record(folder / f"{name}.parquet"))
        links = arm.truth.standard_parameters_at(25.0)
        (folder / f"{name}_truth.json").write_text(json.dumps({"links": links.tolist()}))
        if seed == 1:
            made = dynid.core.files.provenance(seed=seed)
            write_trajectory(
                series, folder / "design.json", robot="ur5", limits=robot.limits, provenance=made
            )
    settings = dynid.IdentifySettings(preset="paper")
    result = dynid.identify(records[:1], robot, settings, validation=records[1])
    dynid.write_estimate(result.estimate, folder / "estimate.json")
    values = np.array(result.estimate.values)
    values[[k for k, n in enumerate(result.estimate.names) if n.startswith("Fv")]] *= 0.8
    dynid.write_estimate(replace(result.estimate, values=values), folder / "slippery.json")
    (folder / "broken.parquet").write_bytes(b"PAR1 no")
    (folder / "other.json").write_text("[1, 2")
    return folder


@pytest.fixture(scope="session")
def page(
    finished_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, ReportContents]:
    """The page of that directory, and what it is about."""
    return report(finished_run, tmp_path_factory.mktemp("page") / "report.html")
