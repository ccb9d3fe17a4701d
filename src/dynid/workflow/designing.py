"""`dynid design`: from a robot and a purpose to a certified excitation trajectory in a file.

It is also written in the formats of others: CSV, URScript, ROS, programs of points.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid import core, excitation, reduction, regressor, signals, trajectory
from dynid.robot import RobotLike, RobotModel, load_robot
from dynid.settings import LONGEST_S, DesignSettings, word_of
from dynid.workflow import design_limits, recordings
from dynid.workflow.design_files import ROBOT, motions_from, robot_hash, write_design

DEFAULT_STARTS = {"prediction": 6, "a-opt": 4, "d-opt": 4}
"""Of the gradient method, where neither starts nor a budget are given: seeds of smooth criteria
end within 2 % of each other."""
MOST_STARTS = 12
"""The same where extreme eigenvalues make many local minima."""
PATIENCE = 60
"""Starts without a better motion that end a search with a budget."""
PAPER = ("cond", "cond+sigma")
"""Criteria of rows as they are, not over the noise of their joint."""
SHORTEST_S = 4.0
"""Period below which `--accuracy` does not go: ramps would take most of it."""
TRIES = 3
"""Periods that `--accuracy` designs."""
MARGIN = 1.05
"""Of the time that the last design says is needed: shorter periods lose a little."""
WEAK_PERCENT = 20.0
"""Expected torque error of a run of `RUN` periods above which a design excites too little."""
WEAK_SHARE = 1.0
"""Standard deviation over the parameter's expected size above which a motion says nothing of it."""
RUN = 3
"""Periods that `dynid run` records by default."""
Watch = Callable[[excitation.HistoryEntry], None]
"""Told each best motion so far."""


def design(
    robot: RobotLike,
    settings: DesignSettings | None = None,
    *,
    output: str | Path | None = None,
    progress: core.Progress | None = None,
    watch: Watch | None = None,
) -> excitation.ExcitationDesign:
    """Design an excitation trajectory.

    Ctrl-C ends the search; what was found until then is certified and returned, with
    `interrupted` set. It replaces no file, see `unfinished_path`.

    Args:
        robot: The robot, or its name or file.
        settings: What to do.
        output: The design's JSON file; it appears whole or not at all. An infeasible design is
            written as well: it says so.
        progress: Told what is being done and how far it is (0 to 1).
        watch: Told each best motion so far: criterion, time and evaluations.

    Raises:
        InputError: Settings, limits or a scene that make no sense; a budget that is too short.
        JobError: No motion within the limits excites every parameter, or none reaches the
            accuracy within ten minutes.
    """
    asked = settings or DesignSettings()
    folders = tuple(map(Path, asked.mesh_dirs or ()))
    model = load_robot(robot, mount=asked.mount, mesh_dirs=folders)
    reference = recordings.robot_reference(robot)
    job = _DesignJob(model, reference, asked, _telling(progress, watch))
    accuracy = asked.accuracy_percent
    result = job.design(asked.period_s) if accuracy is None else job.shortest(accuracy)
    if output is not None:
        path = unfinished_path(output) if result.interrupted else output
        write_design(result, path, robot=model)
    return result


def unfinished_path(path: str | Path) -> Path:
    """Where an interrupted design goes: beside the file, if there is one, which stays."""
    path = Path(path)
    return core.free_name(path, f"{path.stem}.interrupted-", path.suffix) if path.exists() else path


def _telling(progress: core.Progress | None, watch: Watch | None) -> excitation.SearchProgress:
    """Words for one, each new best motion for the other."""
    told: list[excitation.HistoryEntry] = []

    def tell(search: excitation.Search, share: float) -> None:
        if progress is not None:
            progress(search.words(), share)
        best = search.history[-1:]
        if watch is not None and best and best != told[-1:]:
            told.extend(best)
            watch(best[0])

    return tell


class _DesignJob:
    """What designs of one robot for one purpose share, whatever their period."""

    def __init__(
        self,
        robot: RobotModel,
        reference: str,
        asked: DesignSettings,
        tell: excitation.SearchProgress,
    ) -> None:
        self.reference = reference
        self.asked, self.tell = asked, tell
        self.limits = design_limits.given_limits(asked)
        robot = self.robot = self.limits.equipped(robot)
        self.judge = self.limits.constraints(robot)
        if asked.start_pose is not None:
            self.judge.check_pose(_each(asked.start_pose, robot.joints, "--start"))
        terms = regressor.parse_terms(asked.terms)
        model = regressor.InverseDynamicModel(robot=robot, frames=asked.frames, friction=terms)
        self.base = reduction.reduce_model(model)
        given = None if asked.noise is None else _each(asked.noise, robot.joints, "--noise")
        self.weights: core.Array | None = given
        excitation.check_room(self.judge, excitation.region_of(self._problem(asked.period_s, None)))
        if asked.motions:
            source = ", ".join(map(str, asked.motions))
            motions = motions_from(asked.motions, robot)
        else:
            source, motions = excitation.ANYWHERE, excitation.safe_motions(self.base, self.judge)
        self.purpose = excitation.purpose_of(self.base, motions, source)
        assumed = excitation.assumed_noise(robot, self.purpose.torque)
        self.noise: core.Array = assumed if given is None else given
        self.weights = given if asked.minimised in PAPER else self.noise
        self.previous: core.Array | None = self._information(self.noise) if asked.previous else None

    def design(self, period_s: float) -> excitation.ExcitationDesign:
        """The design of one period."""
        found = _optimised(self._problem(period_s, self.purpose), self.asked, self.tell)
        return self._told(*found, period_s)

    def shortest(self, percent: float) -> excitation.ExcitationDesign:
        """The shortest whole number of periods that is expected to reach an accuracy.

        Noise averages out with time, so that one design tells how much time is needed; a period
        that fits it is designed next, until nothing is gained.
        """
        best, period = None, self.asked.period_s
        for _ in range(TRIES):
            found = self.design(period)
            needed = period * self._repetitions(found, percent)
            count = max(math.ceil(needed / period), 1)
            if needed > LONGEST_S:
                raise core.JobError(
                    f"the accuracy of {percent:g} % would take {needed:.0f} s of motion",
                    next_step=f"Ask for less: {LONGEST_S:g} s are the most that are designed for.",
                )
            if best is None or count * period < best.repetitions * best.trajectory.duration:
                told = self._expected(self._weighted_gram(found), count)
                findings = self._findings(told, 1)
                best = replace(found, repetitions=count, expected=told, findings=findings)
            count = max(round(needed / self.asked.period_s), 1)
            step = 25 / self.asked.rate_hz
            fitting = max(math.ceil(MARGIN * needed / count / step) * step, SHORTEST_S)
            total = best.repetitions * best.trajectory.duration
            if found.interrupted or fitting * count >= 0.97 * total:
                break
            period = fitting
        if best is None:
            raise core.JobError("no design was found", next_step="Give the arm more room.")
        return best

    def _problem(
        self, period_s: float, purpose: excitation.Purpose | None
    ) -> excitation.ExcitationProblem:
        asked, base = self.asked, self.base
        # Variances can be added only where the parameters have a common scale.
        scaled = asked.minimised == excitation.AOptimal.name
        previous = self._information(self.weights) if asked.previous and purpose else None
        start = asked.start_pose
        return excitation.ExcitationProblem(
            base=base,
            criterion=excitation.parse_criterion(
                asked.minimised,
                scale=excitation.prior_scale(base) if scaled else None,
                previous=previous,
                moment=None if purpose is None else purpose.moment(self.noise),
            ),
            family=trajectory.motion_family(
                asked.trajectory, period_s, replace(asked, period_s=period_s).order
            ),
            constraints=self.judge,
            rate_hz=asked.rate_hz,
            noise=self.weights,
            start_pose=None if start is None else np.array(start),
        )

    def _information(self, noise: core.Array | None) -> core.Array:
        """The Gram matrix (b, b) of earlier recordings, their friction free to be another."""
        total = np.zeros((self.base.rank, self.base.rank))
        kernel = self._kernel(noise)
        for path in self.asked.previous:
            samples = signals.process(path, self.robot)
            # Per second of motion, at the rate of the design: neither side counts by its sampling.
            weight = self.asked.rate_hz / samples.rate_hz
            gram = weight * kernel.gram(samples.q, samples.dq, samples.ddq)
            total += excitation.without_friction(gram, self.base)
        return total

    def _kernel(self, noise: core.Array | None) -> excitation.GramKernel:
        return excitation.GramKernel(self.base, noise=noise, coulomb_width=None)

    def _weighted_gram(self, found: excitation.ExcitationDesign) -> core.Array:
        motion = found.trajectory.evaluate(np.arange(found.samples) / self.asked.rate_hz)
        return self._kernel(self.noise).gram(motion.q, motion.dq, motion.ddq)

    def _expected(self, gram: core.Array, repetitions: float) -> excitation.Expected:
        return excitation.expected(repetitions * gram, self.purpose, self.noise, self.previous)

    def _repetitions(self, found: excitation.ExcitationDesign, percent: float) -> float:
        """How many periods reach the accuracy, as a real number."""
        gram = self._weighted_gram(found)
        if not math.isfinite(self._expected(gram, 1.0).bound_percent):
            raise core.InputError(
                "the torque of this robot is unknown, so no error of it is a percentage",
                where="--accuracy",
                next_step="Give masses and centres of mass of its links.",
            )
        low, high = 1e-3, 1e5
        while high / low > 1.001:
            middle = math.sqrt(low * high)
            reached = self._expected(gram, middle).bound_percent <= percent
            low, high = (low, middle) if reached else (middle, high)
        return high

    def _told(
        self, finished: excitation.Finished, search: excitation.Search, period_s: float
    ) -> excitation.ExcitationDesign:
        asked, base, wall_s = self.asked, self.base, search.wall_s
        problem = self._problem(period_s, None)
        certificate, robot = finished.certificate, self.robot
        motion = finished.trajectory.evaluate(problem.times)
        state = (motion.q, motion.dq, motion.ddq)
        # The figures are those of the motion alone and of rows as they are, whatever was optimised;
        # an expected error needs rows over their noise.
        plain = self._kernel(None).gram(*state)
        gram = self._kernel(self.noise).gram(*state)
        prediction = excitation.parse_criterion(
            "prediction", moment=self.purpose.moment(self.noise)
        )
        criteria = excitation.all_criteria(plain, scale=excitation.prior_scale(base))
        inputs = (*asked.previous, *asked.motions, asked.scene or "")
        return excitation.ExcitationDesign(
            trajectory=finished.trajectory,
            robot=self.reference,
            robot_name=robot.name,
            mount=robot.mount,
            frames=base.model.frames,
            terms=base.model.friction.describe(),
            limits=robot.limits.motion,
            purpose=asked.goal,
            purpose_motions=self.purpose.source,
            criterion=asked.minimised,
            method=word_of(asked.method),
            criteria=criteria | {"prediction": prediction.value(gram)},
            expected=self._expected(gram, 1.0),
            repetitions=1,
            findings=self._findings(self._expected(gram, RUN), RUN),
            scaled_condition_number=excitation.scaled_condition_number(plain),
            base_parameters=base.rank,
            samples=problem.samples,
            certificate=certificate,
            repair=finished.repair,
            evaluations=search.evaluations,
            starts=search.starts,
            wall_s=wall_s,
            seed=asked.seed,
            ended_by=search.ended_by,
            history=tuple(search.history),
            provenance=core.provenance(
                {str(path): core.file_hash(Path(path)) for path in inputs if path},
                asked.to_json(),
                asked.seed,
            ),
            settings={**self.limits.to_json(), ROBOT: robot_hash(self.robot)},
        )

    def _findings(self, told: excitation.Expected, periods: int) -> tuple[core.Finding, ...]:
        """What the motion does not excite."""
        if not told.torque_error_percent > WEAK_PERCENT:
            return ()
        share = told.parameter_std / excitation.prior_scale(self.base)
        worst = [int(k) for k in np.argsort(-share) if share[k] > WEAK_SHARE]
        columns = self.base.model.columns
        names = ", ".join(self.base.names[k] for k in worst[:6])
        lost = f"; not identified: {len(worst)} parameters, the first {names}" if worst else ""
        return (
            core.Finding(
                kind="weak_excitation",
                text=f"the motion excites too little: {periods} periods leave an expected torque "
                f"error of {told.torque_error_percent:.3g} %, limit {WEAK_PERCENT:g} %{lost}",
                severity="error",
                joints=tuple(sorted({columns[self.base.independent[k]].joint for k in worst})),
                value=told.torque_error_percent,
                unit="%",
                next_step="give the arm more room or a longer period, or pass --accept-weak",
            ),
        )


def _optimised(
    problem: excitation.ExcitationProblem, asked: DesignSettings, tell: excitation.SearchProgress
) -> tuple[excitation.Finished, excitation.Search]:
    method = asked.method
    if method == "ga":
        method = excitation.GeneticAlgorithm(asked.population, asked.generations)
    if not isinstance(method, str):
        return excitation.by_optimiser(
            problem, method, seed=asked.seed, budget_s=asked.budget_s, tell=tell
        )
    starts, patience = asked.starts, None
    if starts is None and asked.budget_s is None:
        starts = DEFAULT_STARTS.get(asked.minimised, MOST_STARTS)
    elif starts is None:
        patience = PATIENCE
    effort = excitation.Effort(starts=starts, budget_s=asked.budget_s, patience=patience)
    with core.workers(asked.jobs, asked.dask) as found:
        return excitation.by_gradient(problem, effort, seed=asked.seed, beside=found, tell=tell)


def _each(values: Sequence[float], joints: int, where: str) -> core.Array:
    if len(values) != joints:
        raise core.InputError(
            "needs a number a joint", where=where, value=len(values), limit=joints
        )
    return np.array(values)


def check_export(kind: str, robot: RobotLike, motion: str) -> None:
    """Refuse a format that cannot hold a motion before that is searched for.

    Args:
        kind: `csv`, `urscript`, `ros` or a language of points.
        robot: The robot that is to move.
        motion: The word of its kind of motion.

    Raises:
        InputError: Another kind of motion, or number or kind of joints, than the format has, or
            no limits that it needs.
    """
    if kind in trajectory.LANGUAGES and motion != "points":
        raise core.InputError(
            "holds motions through points alone",
            where=f"--{kind}",
            value=motion,
            next_step="Design with --trajectory points.",
        )
    model = load_robot(robot)
    if kind in trajectory.LANGUAGES:
        trajectory.check_points(kind, model.joints, model.limits.motion)
    elif kind == "urscript" and model.joints != 6:
        raise core.InputError("needs six joints", where=f"--{kind}", value=model.joints, limit=6)
    if kind in {"urscript", *trajectory.LANGUAGES} - {"waypoints"} and any(model.prismatic):
        raise core.InputError(
            "holds angles alone, and this joint slides",
            where=f"--{kind}",
            value=model.joint_names[list(model.prismatic).index(True)],
            next_step="Take --csv, --ros or --waypoints.",
        )


def export_motion(design: excitation.ExcitationDesign, kind: str, path: str | Path) -> None:
    """Write one period of a design in another format, whole or not at all.

    Formats with comments have the verdict of the certificate in their head.

    Raises:
        InputError: An unknown kind, a motion that the format cannot hold, or a place where no
            such file can be.
        JobError: The disk does not take the file.
    """
    robot, certificate = load_robot(design.robot), design.certificate
    missing = [kind for kind, worst in certificate.worst.items() if math.isnan(worst.margin)]
    said = f"dynid: {certificate.headline}; "
    said += f"not judged: {', '.join([*missing, 'the way to the start'])}"
    match kind:
        case "csv":
            units = ["m" if slides else "rad" for slides in robot.prismatic]
            text = trajectory.csv_text(design.trajectory, units=units)
        case "ros":
            text = f"# {said}\n" + trajectory.joint_trajectory_yaml(
                design.trajectory, robot.joint_names
            )
        case "urscript":
            comment = f"design for {robot.name}\n{said}"
            text = trajectory.ur_program(design.trajectory, comment=comment, fed=False)
        case _:
            text = trajectory.points_text(design.trajectory, kind, design.limits, comment=said)
    core.write_text(Path(path), text)
