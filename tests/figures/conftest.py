from __future__ import annotations

import pytest

import dynid


@pytest.fixture(scope="session")
def identified() -> dynid.Identification:
    robot = dynid.load_robot("ur5")
    records = [
        dynid.simulate_recording(
            robot, dynid.random_excitation(robot.limits, seed=seed), periods=1, seed=seed
        )
        for seed in (1, 2)
    ]
    settings = dynid.IdentifySettings(preset="paper")
    return dynid.identify(records[:1], robot, settings, validation=records[1])
