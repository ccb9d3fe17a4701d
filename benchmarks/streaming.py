"""Memory and CPU of an identification, of seconds and of hours, and the throughput of its pass.

`python benchmarks/streaming.py` (or `short`): asked are 1 s of CPU (`paper`) and 20 s (`best`) for
30 s at 125 Hz, caches warm, and 1 GB for five minutes at 500 Hz. The arm has a UR5's published
inertias, each a tenth off, and a UR5's friction: on torques of random parameters, which no UR5 has,
most of the time goes into the search for a fault.

`python benchmarks/streaming.py` (or `throughput`): regressor and products of a UR5 (52 columns),
beside a loop over pinocchio's regressor with products of its rows, in one run on one core, warm.
Asked: 10 times.

`python benchmarks/streaming.py hours 1 best`: writes a recording of so many hours at 500 Hz (a
minute of simulated motion, tiled, each time with new noise), identifies it in a process of its own
and prints what that took above a process that has identified three minutes with the same preset.
Asked: 300 MB, CPU a sample of an hour at most 1.3 times that of three minutes, of 24 hours (preset
paper) not above that of one.
"""

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from shared.measuring import child, fastest
from threadpoolctl import threadpool_limits

import dynid
from dynid.identification import PanelRows, PassPlan, inertial_prior, sum_rows
from dynid.recording import ExperimentRecord
from dynid.recording.store import KEY
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import load_robot
from dynid.signals import Samples

RATE_HZ = 500.0
NOISE = np.array([2.0, 2.5, 1.5, 0.4, 0.4, 0.3])
COLUMNS = ("q", "qd", "effort")
SAMPLES, SHORT = 20_000, 89_000
ROUNDS = 12


OFF = 0.1
COULOMB, VISCOUS = [7.7, 8.4, 8.3, 1.9, 1.8, 1.8], [10.8, 8.8, 5.5, 2.8, 1.9, 1.4]
MOTOR = [2.0, 2.2, 1.1, 0.3, 0.3, 0.3]
ASKED_CPU_S = {"paper": 1.0, "best": 20.0}


def recording(seconds: float, rate: float) -> ExperimentRecord:
    """A UR5 record that does not repeat, white noise on its torques."""
    robot, generator = load_robot("ur5"), np.random.default_rng(0)
    series = dynid.random_excitation(robot.limits, seed=1, period_s=seconds, harmonics=15)
    motion = series.evaluate(np.arange(int(seconds * rate)) / rate)
    bodies = inertial_prior(robot, robot.default_frames).parameters.ravel()
    bodies = bodies * generator.normal(1.0, OFF, bodies.size)
    parameters = np.concatenate([bodies, COULOMB, VISCOUS, MOTOR])
    model = InverseDynamicModel(robot=robot)
    torque = model.inverse_dynamics(motion.q, motion.dq, motion.ddq, parameters)
    noisy = torque + NOISE * generator.normal(size=torque.shape)
    return ExperimentRecord(t=motion.t, signals={"q": motion.q, "effort": noisy})


def short() -> None:
    """Print CPU of 30 s, and the memory of five minutes in a process of its own."""
    record = recording(30.0, 125.0)
    for preset, asked in ASKED_CPU_S.items():
        for _ in range(2):
            begun = time.process_time()
            dynid.identify(record, "ur5", dynid.IdentifySettings(preset=preset))
            used = time.process_time() - begun
        peak = child([__file__, "memory", preset]).peak_mb / 1e3
        print(
            f"identify --preset {preset}: {used:.2f} s of CPU (asked {asked:g} s); "
            f"5 minutes at 500 Hz: peak {peak:.2f} GB (asked 1 GB)"
        )


def minute() -> tuple[np.ndarray, ...]:
    """Positions, velocities and torques (N, 6) of one period of a minute."""
    robot = load_robot("ur5")
    motion = dynid.random_excitation(robot.limits, seed=1, period_s=60.0, harmonics=30).evaluate(
        np.arange(int(60 * RATE_HZ)) / RATE_HZ
    )
    model = InverseDynamicModel(robot=robot)
    parameters = np.random.default_rng(0).uniform(0.1, 2.0, len(model.columns))
    return motion.q, motion.dq, model.inverse_dynamics(motion.q, motion.dq, motion.ddq, parameters)


def write(path: Path, hours: float) -> int:
    """Write a recording a minute at a time; its number of samples."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    q, dq, torque = minute()
    record = ExperimentRecord(t=np.arange(len(q)) / RATE_HZ, signals={"q": q, "effort": torque})
    dynid.write_record(record, path)
    description = json.loads(pq.read_metadata(path).metadata[KEY])
    description.update(quantities=list(COLUMNS), digest=f"{hours} hours")
    description["metadata"]["robot"] = "ur5"
    names = ["t", *(f"{name}_{k}" for name in COLUMNS for k in range(6))]
    schema = pa.schema(
        [(name, pa.float64()) for name in names],
        metadata={KEY: json.dumps(description).encode()},
    )
    random, rows = np.random.default_rng(1), len(q)
    options = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
    with pq.ParquetWriter(path, schema, **options) as writer:
        for k in range(round(60 * hours)):
            noisy = np.concatenate(
                [
                    q + 1e-5 * random.normal(size=q.shape),
                    dq + 1e-3 * random.normal(size=q.shape),
                    torque + NOISE * random.normal(size=q.shape),
                ],
                axis=1,
            )
            t = (k * rows + np.arange(rows)) / RATE_HZ
            columns = [pa.array(t), *(pa.array(column) for column in noisy.T)]
            writer.write_table(pa.table(columns, schema=schema))
    return round(60 * hours) * rows


def peak_mb() -> float:
    """Most memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def identify(path: str, preset: str) -> None:
    """In a process of its own: memory [MB] and CPU [s] of a file, or of three minutes of it."""
    settings = dynid.IdentifySettings(preset=preset)
    with tempfile.TemporaryDirectory() as folder:
        short = Path(folder) / "short.parquet"
        write(short, 0.05)
        # In memory; a window that is no whole number of periods.
        stored = dynid.recording.open_stored(short)
        part, light = stored.part(0, SHORT, COLUMNS), stored.part(0, 8_000, COLUMNS)
    dynid.identify(light, "ur5", settings)
    compiled, begun = peak_mb(), time.process_time()
    estimate = dynid.identify(path or part, "ur5", settings).estimate
    cpu = time.process_time() - begun
    told = {"compiled_mb": compiled, "peak_mb": peak_mb(), "cpu_s": cpu}
    print(json.dumps(told | {"choices": " ".join(estimate.choices[-1:])}))


def hours(number: float, preset: str) -> None:
    """Print memory and CPU a sample."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.parquet"
        samples = write(path, number)
        long, short = (
            json.loads(child([__file__, "identify", what, preset]).said) for what in (path, "")
        )
    compiled, each, usual = long["compiled_mb"], long["cpu_s"] / samples, short["cpu_s"] / SHORT
    print(f"{number:g} h at 500 Hz, {samples} samples, preset {preset}: {long['choices']}")
    print(
        f"memory {long['peak_mb'] - compiled:.0f} MB above {compiled:.0f} MB; "
        f"CPU {1e6 * each:.2f} us a sample, three minutes {1e6 * usual:.2f} us "
        f"({each / usual:.2f} times)"
    )


def throughput() -> None:
    """Print the times of one sample."""
    # Here, not above: processes that measure memory load neither it nor Arrow.
    import pinocchio as pin
    from shared.pinocchio_arm import PinocchioArm

    model = InverseDynamicModel(robot=load_robot("ur5"))
    base, n = reduce_model(model), 6
    q, dq, torque = (np.array(x[:SAMPLES]) for x in minute())
    ddq = np.gradient(dq, 1 / RATE_HZ, axis=0)
    samples = Samples(
        t=np.arange(SAMPLES) / RATE_HZ, q=q, dq=dq, ddq=ddq, tau=torque, rate_hz=500, cutoff_hz=5
    )
    plan = PassPlan(
        base=base,
        values=np.zeros(base.rank),
        weights=np.ones(n),
        lag=150,
        regions=None,
        stretches=8,
        factors=False,
    )
    panels, independent = PanelRows(base), list(base.independent)
    theirs = PinocchioArm(model.robot)
    inertial = [k for k in independent if k < 10 * n]
    few = 1000

    def products_alone() -> list[np.ndarray]:
        total = [0.0] * n
        for _, parts in panels.chunks(samples, slice(0, SAMPLES)):
            total = [a + panel @ panel.T for a, panel in zip(total, parts, strict=True)]
        return total

    rows = np.zeros((few, n, base.rank + 1))

    def by_pinocchio() -> np.ndarray:
        # What a patient user writes: rows in a loop, products of a thousand samples at a time.
        for k in range(few):
            columns = pin.computeJointTorqueRegressor(
                theirs.model, theirs.data, q[k], dq[k], ddq[k]
            )
            rows[k, :, : len(inertial)] = columns[:, inertial]
        rows[:, :, -1] = torque[:few]
        by_joint = rows.transpose(1, 2, 0)
        return by_joint @ by_joint.transpose(0, 2, 1)

    works = {
        "pinocchio": by_pinocchio,
        "pass": products_alone,
        "scores": lambda: sum_rows(panels, plan, samples, slice(0, SAMPLES), 0, SAMPLES),
    }
    with threadpool_limits(limits=1):
        times = fastest(works, ROUNDS)
    each = {name: 1e6 * t / (few if name == "pinocchio" else SAMPLES) for name, t in times.items()}
    print(f"UR5, {base.rank} columns, one core, warm, microseconds a sample:")
    print(f"pinocchio, loop: regressor and products   {each['pinocchio']:8.2f}")
    print(f"pass: regressor and products              {each['pass']:8.2f}")
    print(f"pass with cells, scores and ranges        {each['scores']:8.2f}")
    print(f"against pinocchio {each['pinocchio'] / each['pass']:.1f} times (asked 10)")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["identify", path, preset]:
            identify(path, preset)
        case ["hours", count, preset]:
            hours(float(count), preset)
        case ["memory", preset]:
            settings = dynid.IdentifySettings(preset=preset)
            dynid.identify(recording(300.0, 500.0), "ur5", settings)
        case [] | ["short"] | ["throughput"]:
            for measure in (short, throughput):
                if sys.argv[1:] in ([], [measure.__name__]):
                    measure()
        case _:
            sys.exit(__doc__)
