"""Memory and CPU of an identification, of seconds and of hours, each in a process of its own.

    python benchmarks/streaming.py                  30 s at 125 Hz, caches warm; 5 minutes at 500 Hz
    python benchmarks/streaming.py hours [1 [best]] so many hours (from 0.2) at 500 Hz: a minute,
        tiled, each time with new noise; beside three minutes of it, with the same preset

Memory of hours is above that of a process that has identified 16 s. Of 24 hours with preset paper,
CPU a sample is not to be above that of one. The arm has a UR5's published inertias, each a tenth
off, and a UR5's friction: on torques of random parameters, which no UR5 has, most of the time goes
into the search for a fault. Exits with 1 where an asked figure is missed.
"""

import json
import tempfile
import time
from pathlib import Path

import numpy as np
from shared.measuring import asked, child, peak_mb, run

import dynid
from dynid.identification import inertial_prior
from dynid.recording.store import KEY
from dynid.regressor import InverseDynamicModel
from dynid.robot import load_robot

RATE_HZ, OFF, SHORT = 500.0, 0.1, 89_000
NOISE = np.array([2.0, 2.5, 1.5, 0.4, 0.4, 0.3])
COULOMB, VISCOUS = [7.7, 8.4, 8.3, 1.9, 1.8, 1.8], [10.8, 8.8, 5.5, 2.8, 1.9, 1.4]
MOTOR = [2.0, 2.2, 1.1, 0.3, 0.3, 0.3]
COLUMNS = ("q", "qd", "effort")
ASKED_CPU_S = {"paper": 1.0, "best": 20.0}


def recording(
    seconds: float, rate: float, generator: np.random.Generator
) -> dynid.ExperimentRecord:
    """Positions, velocities and torques of one period, without noise."""
    robot = load_robot("ur5")
    series = dynid.random_excitation(robot.limits, seed=1, period_s=seconds, harmonics=15)
    motion = series.evaluate(np.arange(int(seconds * rate)) / rate)
    bodies = inertial_prior(robot, robot.default_frames).parameters.ravel()
    bodies = bodies * generator.normal(1.0, OFF, bodies.size)
    torque = InverseDynamicModel(robot=robot).inverse_dynamics(
        motion.q, motion.dq, motion.ddq, np.concatenate([bodies, COULOMB, VISCOUS, MOTOR])
    )
    signals = dict(zip(COLUMNS, (motion.q, motion.dq, torque), strict=True))
    return dynid.ExperimentRecord(t=motion.t, signals=signals)


def noisy(seconds: float, rate: float, seed: int = 0) -> dynid.ExperimentRecord:
    """The same as a user records it, without velocities."""
    generator = np.random.default_rng(seed)
    clean = recording(seconds, rate, generator)
    q, _, torque = clean.signals.values()
    torque = torque + NOISE * generator.normal(size=torque.shape)
    return dynid.ExperimentRecord(t=clean.t, signals={"q": q, "effort": torque})


def write(path: Path, minutes: int) -> int:
    """Write a recording a minute at a time; its number of samples."""
    # Processes that measure memory do not load it.
    import pyarrow as pa
    import pyarrow.parquet as pq

    random = np.random.default_rng(0)
    record = recording(60.0, RATE_HZ, random)
    dynid.write_record(record, path)
    description = json.loads(pq.read_metadata(path).metadata[KEY])
    description.update(quantities=list(COLUMNS), digest=f"{minutes} minutes")
    description["metadata"]["robot"] = "ur5"
    names = ["t", *(f"{name}_{k}" for name in COLUMNS for k in range(6))]
    schema = pa.schema([(name, pa.float64()) for name in names], {KEY: json.dumps(description)})
    options = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
    clean = np.hstack(list(record.signals.values()))
    size = np.concatenate([np.full(6, 1e-5), np.full(6, 1e-3), NOISE])
    with pq.ParquetWriter(path, schema, **options) as writer:
        for k in range(minutes):
            rows = clean + size * random.normal(size=clean.shape)
            columns = [pa.array(column) for column in (record.t + 60.0 * k, *rows.T)]
            writer.write_table(pa.table(columns, schema=schema))
    return minutes * len(clean)


def identify(path: str, rows: int, preset: str) -> None:
    """Print memory before and after [MB] and CPU [s] of a file, or of its first rows in memory."""
    stored, settings = dynid.recording.open_stored(path), dynid.IdentifySettings(preset=preset)
    # A window that is no whole number of periods.
    given = stored.part(0, rows, COLUMNS) if rows else path
    dynid.identify(stored.part(0, 8_000, COLUMNS), "ur5", settings)
    before, begun = peak_mb(), time.process_time()
    dynid.identify(given, "ur5", settings)
    print(json.dumps([before, peak_mb(), time.process_time() - begun]))


def short() -> bool:
    record, missed = noisy(30.0, 125.0), False
    for preset, most in ASKED_CPU_S.items():
        for _ in range(2):
            begun = time.process_time()
            dynid.identify(record, "ur5", dynid.IdentifySettings(preset=preset))
            cpu = time.process_time() - begun
        missed |= asked(f"30 s at 125 Hz, preset {preset}: s of CPU", cpu, most=most)
        peak = float(child([__file__, "memory", 0, preset]))
        missed |= asked(f"5 minutes at 500 Hz, preset {preset}: GB", peak / 1e3, most=1)
    return missed


def long(hours: float, preset: str) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.parquet"
        samples = write(path, round(60 * hours))
        whole, part = (
            json.loads(child([__file__, "identify", rows, preset, path])) for rows in (0, SHORT)
        )
    each, usual = whole[2] / samples, part[2] / SHORT
    print(
        f"{hours:g} h at 500 Hz, {samples} samples, preset {preset}: {1e6 * each:.2f} us a sample"
    )
    missed = asked(f"MB above {whole[0]:.0f} MB", whole[1] - whole[0], most=300)
    return asked("CPU a sample over that of three minutes", each / usual, most=1.3) or missed


def main(what: str = "short", number: float = 1.0, preset: str = "best", path: str = "", /) -> bool:
    match what:
        case "memory":
            # A draw by which a delay is looked for at a cut-off of 2 Hz, which takes most memory.
            dynid.identify(noisy(300.0, RATE_HZ, 1), "ur5", dynid.IdentifySettings(preset=preset))
            print(peak_mb())
        case "identify":
            identify(path, int(number), preset)
        case "hours":
            return long(number, preset)
        case _:
            return short()
    return False


if __name__ == "__main__":
    run(main)
