"""Gravity from poses at rest: MuJoCo's torques with friction that holds anything in its band."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import dynid
from dynid.bench import Plant, arm, plant
from dynid.cli.app import build
from dynid.core import Array, InputError
from dynid.identification import gravity_of
from dynid.recording import ExperimentRecord, are_poses
from dynid.robot import robot_from_dh

SEEDS = range(6)
HELD = 0.85
"""Of 95 % intervals, 60 parameters: three standard deviations below."""


def poses(real: Plant, seed: int, count: int) -> tuple[Array, Array, Array]:
    """Positions, torques as measured and without friction and noise (count, n)."""
    draw = np.random.default_rng(seed)
    limits = real.robot.limits
    lower, upper = np.fmax(limits.lower, -2.5), np.fmin(limits.upper, 2.5)
    q = draw.uniform(lower, upper, (count, len(lower)))
    gravity = real.torque(q, 0 * q, 0 * q)
    held = real.coulomb * draw.uniform(-1, 1, q.shape)
    return q, gravity + held + real.torque_noise * draw.normal(size=q.shape), gravity


def test_gravity_is_predicted_better_than_published_and_within_intervals() -> None:
    better, held = [], []
    for seed in SEEDS:
        real = plant(arm("ur5"), seed)
        q, torque, _ = poses(real, seed, 200)
        found = gravity_of(real.robot, q, torque)
        many, _, gravity = poses(real, seed + 100, 4000)
        error = found.predict(many) - gravity
        np.testing.assert_array_equal(found.predict(many[:3].tolist()), found.predict(many[:3]))
        with pytest.raises(InputError) as caught:
            found.predict(many[0])
        assert caught.value.limit == "(any, 6)"
        assert found.published is not None
        # Without noise all poses together show the true base parameters.
        true = gravity_of(real.robot, many, gravity)
        held.append(np.abs(found.values - true.values) < 1.96 * found.std)
        given = gravity_of(real.robot, many, gravity).published
        assert given is not None
        better.append(np.sqrt(np.square(error).mean(axis=0).sum()) / np.linalg.norm(given))
        np.testing.assert_allclose(found.band[[0, 3]], 0.95 * real.coulomb[[0, 3]], rtol=0.25)
        assert {"Jxx2", "Fc1", "Fv1", "Im1", "m1"} <= set(found.unseen)
        assert "mx6" not in found.unseen
    assert np.exp(np.log(better).mean()) < 0.75
    assert np.mean(held) > HELD


def test_the_band_holds_its_share_of_poses_to_come_however_few_it_is_from() -> None:
    """Errors uniform in [-1, 1], as friction that holds anything in its band."""
    real, draw = plant(arm("ur5"), 3), np.random.default_rng(9000)
    held, near = [], []
    for seed in range(30):
        (q, _, few), (new, _, gravity) = poses(real, seed, 20), poses(real, 1000 + seed, 300)
        found = gravity_of(real.robot, q, few + draw.uniform(-1, 1, few.shape))
        error = gravity + draw.uniform(-1, 1, gravity.shape) - found.predict(new)
        held.append(np.abs(error) <= found.band)
        near.append(np.abs(found.band - np.quantile(np.abs(error), 0.95, axis=0)))
        near[-1] = near[-1] < 1.96 * found.band_std
    assert abs(np.mean(held) - 0.95) < 0.02
    assert np.mean(near) > 0.65


def test_heavy_links_without_published_inertias() -> None:
    """Torques of another unit of mass are predicted as well."""
    real = plant(arm("ur5"), 0)
    unknown = replace(real.robot, inertias=np.full((6, 10), np.nan))
    (q, torque, _), (many, _, gravity) = poses(real, 0, 60), poses(real, 1, 500)
    for heavier in (1.0, 1000.0):
        found = gravity_of(unknown, q, heavier * torque)
        error = np.square(found.predict(many) / heavier - gravity).mean(axis=0)
        assert (np.sqrt(error) < real.coulomb).all()


def test_torques_that_are_not_those_of_gravity_are_doubted() -> None:
    real = plant(arm("ur10e"), 3)
    q, torque, _ = poses(real, 3, 60)
    assert gravity_of(real.robot, q, torque).warnings == ()
    turned = torque * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
    (found,) = gravity_of(real.robot, q, turned).warnings
    assert (found.kind, found.joints) == ("reversed", (1,))
    held = torque - gravity_of(real.robot, q, torque).predict(q)
    (found,) = gravity_of(real.robot, q, held).warnings
    assert found.kind == "gravity_compensated"
    assert {1, 2} <= set(found.joints)


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    real = plant(arm("ur5"), 0)
    q, torque, _ = poses(real, 0, 60)
    path = tmp_path_factory.mktemp("poses") / "poses.csv"
    head = ",".join(f"{name}{j}" for name in ("q", "tau") for j in range(1, 7))
    np.savetxt(path, np.hstack([q, torque]), delimiter=",", header=head, comments="")
    return path


def test_the_command_reads_a_table_without_time(table: Path) -> None:
    out = table.with_suffix(".json")
    words = ["gravity", str(table), "--robot", "ur5"]
    done = CliRunner().invoke(build(), [*words, "-o", str(out), "--json"], catch_exceptions=False)
    assert done.exit_code == 0
    data = json.loads(done.stdout)
    assert data == json.loads(out.read_text())
    assert data["poses"] == 60
    assert len(data["stiction_band"]) == len(data["stiction_band_std"]) == 6
    assert {"name", "expression", "unit", "value", "std", "from_prior"} == set(
        data["parameters"][0]
    )
    # The links alone give these torques to any program.
    found = dynid.identify_gravity(table, "ur5")
    links = np.zeros((6, 10))
    links[:, :4] = [[row[key] for key in ("m", "mx", "my", "mz")] for row in data["links"]]
    q = np.random.default_rng(1).uniform(-2, 2, (5, 6))
    model = dynid.InverseDynamicModel(robot=dynid.load_robot("ur5"))
    columns = model.stack(q, 0 * q, 0 * q)[:60]
    np.testing.assert_allclose(
        np.tensordot(links.ravel(), columns, axes=1).T, found.predict(q), atol=1e-9
    )


def test_what_is_wrong_with_the_table_is_said(table: Path, tmp_path: Path) -> None:
    lines = table.read_text().splitlines()
    lines[7] = lines[7].replace(lines[7].split(",")[0], "abc", 1)
    (tmp_path / "poses.csv").write_text("\n".join(lines))
    words = ["gravity", str(tmp_path / "poses.csv"), "--robot", "ur5"]
    data = json.loads(CliRunner().invoke(build(), [*words, "--json"]).stdout)
    assert data["poses"] == 59
    assert {told["code"] for told in data["warnings"]} == {
        told["code"] for told in data["findings"]
    }
    assert "Findings" in CliRunner().invoke(build(), words).stdout


def test_an_arm_whose_axes_are_vertical_has_no_gravity_to_find() -> None:
    robot = robot_from_dh(a=[0.3, 0.3], d=[0.0, 0.0], alpha=[0.0, 0.0])
    draw = np.random.default_rng(0)
    with pytest.raises(InputError, match="no joint carries gravity"):
        gravity_of(robot, draw.uniform(-1, 1, (40, 2)), draw.normal(size=(40, 2)))


def test_poses_have_no_rows_that_could_be_lost(tmp_path: Path) -> None:
    """Of thirty random tables, in this one a step looked like two."""
    draw = np.random.default_rng(21)
    values = np.hstack([draw.uniform(-2, 2, (60, 6)), draw.normal(size=(60, 6))])
    head = ",".join(f"{name}{j}" for name in ("q", "tau") for j in range(1, 7))
    np.savetxt(tmp_path / "x.csv", values, delimiter=",", header=head, comments="")
    assert dynid.read_recording(tmp_path / "x.csv", robot="ur5").problems == ()


def test_poses_are_no_motion(table: Path) -> None:
    with pytest.raises(InputError, match="dynid gravity"):
        dynid.identify(table, "ur5")


def test_stops_of_a_motion_are_poses() -> None:
    real = plant(arm("ur5"), 3)
    q, torque, _ = poses(real, 3, 25)
    # A second of motion to each pose and a second there, at 50 Hz.
    way = np.linspace(0, 1, 50, endpoint=False)
    blend = (way**3 * (10 - 15 * way + 6 * way**2))[:, None]
    rows, efforts = [], []
    for k in range(1, len(q)):
        rows += [q[k - 1] + blend * (q[k] - q[k - 1]), np.tile(q[k], (50, 1))]
        efforts += [np.full((50, 6), 1e3), np.tile(torque[k], (50, 1))]
    signals = {"q": np.vstack(rows), "effort": np.vstack(efforts)}
    record = ExperimentRecord(t=np.arange(len(signals["q"])) / 50.0, signals=signals)
    assert not are_poses(signals["q"])
    found = dynid.identify_gravity(record, real.robot)
    assert found.poses == 24
    np.testing.assert_allclose(found.values, gravity_of(real.robot, q[1:], torque[1:]).values)
    moving = {name: value[:40] for name, value in signals.items()}
    with pytest.raises(InputError, match="no poses at rest"):
        dynid.identify_gravity(ExperimentRecord(t=record.t[:40], signals=moving), real.robot)


def test_grids_are_poses_and_slow_samples_of_motions_are_none() -> None:
    grid = np.stack(np.meshgrid(*3 * [np.linspace(-1, 1, 5)], indexing="ij"), axis=-1)
    assert are_poses(grid.reshape(-1, 3))
    t = np.arange(200)[:, None] / 10.0
    assert not are_poses(np.sin(2 * np.pi * t * [0.3, 1.0, 1.2]))
    assert not are_poses(1e-3 * np.random.default_rng(0).normal(size=(100, 6)))
    # A slow motion, 500 times a second and to three digits, steps by one of the last at most.
    slow = np.sin(2 * np.pi * np.arange(2000)[:, None] / 500.0 * [0.03, 0.05, 0.02])
    assert not are_poses(np.round(slow, 3))
