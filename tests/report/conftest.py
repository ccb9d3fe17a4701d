from __future__ import annotations

from pathlib import Path

import pytest

import dynid
from dynid.trajectory import write_trajectory


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory as `dynid identify` leaves it: records, a trajectory, an estimate."""
    folder = tmp_path_factory.mktemp("run")
    robot = dynid.load_robot("ur5")
    records = []
    for seed, name in ((1, "identification"), (2, "validation")):
        series = dynid.random_excitation(robot.limits, seed=seed)
        record = dynid.simulate_recording(robot, series, periods=1, seed=seed)
        dynid.write_record(record, folder / f"{name}.parquet")
        records.append(dynid.read_record(folder / f"{name}.parquet"))
        if seed == 1:
            made = records[0].metadata and dynid.core.files.provenance(seed=seed)
            write_trajectory(
                folder / "design.json", series, robot="ur5", limits=robot.limits, provenance=made
            )
    settings = dynid.IdentifySettings(preset="paper")
    result = dynid.identify(records[:1], robot, settings, validation=records[1])
    dynid.write_estimate(result.estimate, folder / "estimate.json")
    return folder
