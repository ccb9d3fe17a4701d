"""Two robots over twelve days: friction by joint, temperature regressed out, alarms."""

import tempfile
from pathlib import Path

import dynid

robot = dynid.load_robot("ur5")
motion = dynid.random_excitation(robot.limits, seed=6)
with tempfile.TemporaryDirectory() as place:
    folder = Path(place) / "recordings"
    for name in ("cell-1", "cell-2"):
        for day in range(1, 13):
            seed = 100 * day + int(name[-1])
            warm = 25.0 + day % 5
            record = dynid.simulate_recording(robot, motion, thermal=warm, seed=seed)
            path = folder / name / f"2026-01-{day:02d}" / "run.parquet"
            path.parent.mkdir(parents=True)
            dynid.write_record(record, path)
    for run in (1, 2):
        found = dynid.fleet(folder, Path(place) / "fleet", dynid.FleetSettings(robot="ur5"))
        print(f"run {run}: {found.computed} of {len(found.recordings)} recordings computed")
        print(f"not used: {len(found.skipped)}")
    print(f"{found.tests} trends, {len(found.alarms)} alarms (nothing was changed)")
    for joint in found.joints[::4]:
        print(f"{joint.robot} {joint.name}: {joint.now:.2f} {joint.unit} of friction")
