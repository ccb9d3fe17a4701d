"""`dynid run --until PERCENT`: design, run and identification in turn, until the model is good.

Each round adds a motion that tells most beside what is recorded already, so that every recording
is predicted by a model of the others. The rounds end when the error that is found there, at the
speeds of the motions that the model is for, is small enough, or when a run ten times as long would
not make it so.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from threading import Event
from typing import Any

from dynid import excitation, experiment, recording, reduction, regressor, trajectory
from dynid.core import InputError, JobError, Progress, require_absent
from dynid.settings import DesignSettings, IdentifySettings, RunSettings, SceneSettings
from dynid.workflow import design_files, running
from dynid.workflow.designing import design
from dynid.workflow.identify import LONGER, Accuracy, accuracy, identify

MOST_ROUNDS = 10
"""A tenfold longer run than the first."""
REACHED, OUT_OF_REACH, TOO_LONG, STOPPED = "reached", "out_of_reach", "too_long", "stopped"


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """One design, its run, and what is known after it."""

    design: Path
    run: running.Run
    accuracy: Accuracy | None
    """By all recordings so far; None where the run was stopped."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        told = {} if self.accuracy is None else self.accuracy.to_json()
        return {"design": str(self.design), "record": self.run.to_json()["record"], **told}


@dataclass(frozen=True, slots=True, kw_only=True)
class RunUntil:
    """What became of the rounds."""

    asked_percent: float
    """Torque error that was asked for, over the RMS torque [%]."""
    rounds: tuple[Round, ...]
    """Design, run and accuracy of each."""
    ended_by: str
    """`reached`, `out_of_reach`, `too_long` or `stopped`."""

    @property
    def last(self) -> running.Run:
        """The last run."""
        return self.rounds[-1].run

    def to_json(self) -> dict[str, Any]:
        """The keys that `dynid run --until --json` prints: those of the last run, and `until`."""
        return {
            **self.last.to_json(),
            "until": {
                "asked_percent": self.asked_percent,
                "reached": self.ended_by == REACHED,
                "ended_by": self.ended_by,
                "rounds": [item.to_json() for item in self.rounds],
            },
        }

    def describe(self) -> str:
        """One line a round."""
        lines = [
            f"Round {k}, {item.run.record}: {item.accuracy.describe()}"
            for k, item in enumerate(self.rounds, start=1)
            if item.accuracy is not None
        ]
        return "\n".join(lines)

    def raise_if_missed(self) -> None:
        """Turn an accuracy that was not reached into an error.

        Raises:
            JobError: The robot was stopped, or the accuracy was not reached; the message says why.
        """
        self.last.raise_if_aborted()
        told = self.rounds[-1].accuracy
        if self.ended_by == REACHED or told is None:
            return
        why = f"{len(self.rounds)} rounds are the most that are run"
        step = "Ask for less, or give the arm more room."
        if self.ended_by == OUT_OF_REACH:
            why = (
                f"a run {LONGER:g} times as long would leave {told.after_longer_percent:.3g} %, of "
                f"which {told.model_percent:.3g} % is the model's own error"
            )
            step = (
                "Identify the recordings together: richer friction terms, gains or a warm arm may "
                "be what the model lacks."
            )
        raise JobError(
            "the accuracy was not reached",
            where="--until",
            value=f"{told.found_percent:.3g} %",
            limit=f"{self.asked_percent:g} %: {why}",
            next_step=step,
        )


def run_until(
    first: design_files.DesignLike,
    output: str | Path,
    percent: float,
    *,
    on: str = running.SIMULATED,
    settings: RunSettings | None = None,
    identification: IdentifySettings | None = None,
    confirm: running.Confirm | None = None,
    cancel: Event | None = None,
    progress: Progress | None = None,
) -> RunUntil:
    """Run a design, and further ones, until a torque error is reached.

    Args:
        first: The first design or its file; further ones are asked for as it was, and stand
            beside the recordings as `OUTPUT_2_design.json` and so on. One in memory is written to
            `OUTPUT_design.json`.
        output: The first recording, `*.parquet`; further ones are `OUTPUT_2.parquet` and so on.
        percent: Torque error to expect on the motions that the design is for, over the RMS torque
            there [%].
        on: `sim` or `ur://HOST`.
        settings: How to run each of them.
        identification: How to identify.
        confirm: Shown what is about to move, for every round; None agrees to everything.
        cancel: Stops the robot, and the rounds, when it is set.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: An accuracy that is no share, a plain trajectory, or what `run_design` refuses.
        JobError: See `run_design`.
        KeyboardInterrupt: A signal between two runs.
    """
    if not 0.01 <= percent <= 100:
        raise InputError(
            "must be a share of the torque", where="--until", value=percent, limit="0.01 to 100 %"
        )
    asked, path = settings or RunSettings(), Path(output)
    if isinstance(first, str | Path):
        place = Path(first)
    else:
        place = path.with_name(f"{path.stem}_design.json")
        require_absent(place, force=asked.force)
        design_files.write_design(first, place, robot=asked.robot)
    stored = design_files.read_design(
        place, robot=asked.robot, mount=asked.mount, mesh_dirs=asked.mesh_dirs
    )
    again = _settings(stored, place)
    # Further motions are for the surroundings, and the load, that the robot runs with.
    around = {item.name: getattr(asked, item.name) for item in fields(SceneSettings)}
    again = replace(again, **{name: x for name, x in around.items() if x is not None})
    motions = _purpose(stored, again)
    rounds: list[Round] = []
    records: list[Path] = []
    ended = ""
    for number in range(1, MOST_ROUNDS + 1):
        record = path if number == 1 else path.with_name(f"{path.stem}_{number}{path.suffix}")
        if number > 1:
            place = path.with_name(f"{path.stem}_{number}_design.json")
            require_absent(place, record, force=asked.force)
            previous = (*again.previous, *map(str, records))
            more = replace(again, previous=previous, seed=again.seed + number - 1)
            robot = stored.stored.robot if asked.robot is None else asked.robot
            with experiment.interruptible():
                if design(robot, more, output=place, progress=progress).interrupted:
                    raise KeyboardInterrupt
        run = running.run_design(
            place,
            record,
            on=on,
            settings=replace(asked, seed=asked.seed + number - 1),
            confirm=confirm,
            cancel=cancel,
            progress=progress,
        )
        if run.abort is not None or run.record is None:
            rounds.append(Round(design=place, run=run, accuracy=None))
            ended = STOPPED
            break
        records.append(run.record)
        with experiment.interruptible():
            several = recording.open_several(records, stored.robot)
            result = identify(several, stored.robot, identification, progress=progress)
            told = accuracy(result.estimate, several, result.training.dq, motions)
        rounds.append(Round(design=place, run=run, accuracy=told))
        if told is None:
            raise JobError(
                "this identification has no error on left-out data",
                where=str(run.record),
                next_step="Leave the estimator to the preset.",
            )
        ended = _ended(told, percent, number)
        if ended:
            break
    return RunUntil(asked_percent=percent, rounds=tuple(rounds), ended_by=ended or TOO_LONG)


def _ended(told: Accuracy, percent: float, rounds: int) -> str:
    if told.bound_percent <= percent and not told.noise_percent > percent:
        return REACHED
    # One recording cannot tell a region that it never saw from an error of the model.
    if rounds > 1 and told.after_longer_percent > percent:
        return OUT_OF_REACH
    return ""


def _settings(stored: design_files.StoredDesign, place: Path) -> DesignSettings:
    """How the design was asked for."""
    given: dict[str, Any] = dict(stored.stored.provenance.settings)
    names = {item.name for item in fields(DesignSettings)}
    if not stored.facts or not names >= set(given) or not given:
        raise InputError(
            "further rounds need the settings of the first design, which this file does not have",
            where=str(place),
            next_step="Make it with dynid design.",
        )
    lists = [name for name, value in given.items() if isinstance(value, list)]
    values: dict[str, Any] = given | {name: tuple(given[name]) for name in lists}
    return replace(DesignSettings(**values), accuracy_percent=None)


def _purpose(
    stored: design_files.StoredDesign, asked: DesignSettings
) -> list[trajectory.JointMotion]:
    """The motions that the model is for."""
    if asked.motions:
        return design_files.motions_from(asked.motions, stored.robot)
    base = reduction.reduce_model(
        regressor.InverseDynamicModel(robot=stored.robot, frames=asked.frames)
    )
    if stored.limits is None:
        return []
    return excitation.safe_motions(base, stored.limits.constraints(stored.robot))
