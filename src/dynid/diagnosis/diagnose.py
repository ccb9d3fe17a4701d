"""Findings about the recordings of an identification, strongest first."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.core import Array, Finding, InputError
from dynid.diagnosis import events
from dynid.diagnosis.explain import Explained, Explanation, explain
from dynid.diagnosis.hypotheses import COUPLED, LEAST_DELAY_S
from dynid.diagnosis.prior import link_prior
from dynid.diagnosis.residual import ROWS, SHAPES, Recording, fits, reference, undriven
from dynid.recording import ExperimentRecord, at_limit, checked_records
from dynid.robot import RobotModel
from dynid.signals import ProcessingSettings, Samples, process

CLOCKS_DIFFER = 0.005
"""Share by which time and velocities may disagree."""
LEAST_RIPPLE = 0.005
"""Amplitude of a ripple over the joint's torque limit, or its largest torque."""
DRIVEN, BY_CHANCE = 0.04, 10.0
"""Share of the friction that friction which only brakes leaves at least where some was taken off,
and variances of the noise a joint, twice what noise alone leaves.

Friction that only brakes leaves up to 0.027, real arms 0.036. What a controller takes off turns
round with the velocity, and friction over a distance: 0.043 to 0.16 is left; where joints jog at
one speed 0.004 to 0.06, which is not told."""
NO_FRICTION = (0.03, 0.6)
"""Braking torque over the torque limit, and over the torque, that few gears stay below."""
NEAR_ZERO = 0.01
"""Share of its largest value to which a torque comes that turns round at zero."""
NO_NOISE = 2e-4
"""Noise over torque that no measurement stays below unless it is filtered."""
MODELLED = 0.01
"""Share of a measured torque that a rigid model leaves at least."""
UNEXPLAINED = 0.25
"""Share of the torque, beyond noise, that is left by the richest model: something is wrong."""
TURNED = 0.3
"""Tilt or zero [rad] from which a result must not be used."""
MISSCALED = 5.0
"""Factor of all torques beyond which units, not masses, are wrong, and are set right first."""
ALIKE = 0.7
"""Correlation, without friction, of torques that are those of the bodies but for their unit."""
_ABOUT_X = 0.01
"""Share of gravity along the base's x axis that a mounting about this axis leaves (0.6 deg)."""
MOST_TOUCHED = 0.3
"""Share of a recording that contacts may take before something else is the cause."""
WIDER = 2.0
"""Factor between cut-offs of the motion that are tried."""
WORTH_ANOTHER = 0.02
"""Share by which another one must lower the errors of a joint."""
SAMPLES = 64
"""Fewer are not diagnosed."""
MOST_JOINTS = 12
"""Nor are more joints: rivals, their columns and those of the arm multiply, hours with thirty."""

_STEPS = {
    "drive_gain": "check its drive gain; its share of the parameters is scaled by it",
    "gain_all": "check the drive gains and units; masses and inertias are scaled by them",
    "delay": "shift torques against motion in the file, or let --preset best do so",
    "clock_scale": "check --rate and the time column",
    "clock_offset": "two clocks? Shift one of them in the file",
    "encoder_zero": "check the zero of its angle against the robot file",
    "flexibility": "positions are those of the motor: record those of the link, or keep "
    "accelerations low",
    "link_length": "check the kinematics of the robot file",
    "spring": "add the spring or counterbalance to the robot file",
    "mounting": "level the base, or give the mounting: {mount}[mount] gravity = {gravity} in the "
    "robot file",
    "coupled_friction": "give the coupling of their motors in the robot file: {coupling}",
    "coupled_torques": "give the coupling of their motors in the robot file: {coupling}, "
    'torque_side = "motor"',
    "coupled_motors": "give the coupling of their motors in the robot file: {coupling}, "
    'torque_side = "motor", position_side = "motor"',
    "payload": "remove it, or give it in a robot file: [tool] with mass and com",
    "payload_change": "record with one payload, or identify a part without changes (--from, --to)",
    "friction_drift": "move the arm until it is warm, or identify parts with --from and --to",
    "gravity_compensated": "record the whole torque: the controller's gravity has been taken off",
    "reversed": "check the signs of its torque or current and position",
    "exchanged": "check the order of the joints (--columns or --joint-order)",
    "exchanged_torques": "check the order of the torque columns (--columns or --joint-order)",
}
_TURNS = (
    "the motors of {joints} are coupled: the second turns {value:.3g} +- {std:.2g} times with the "
    "first joint as well"
)
_FACTS = {
    "drive_gain": "torques of {joints} are {factor:.3g} +- {std:.2g} times what the other joints "
    "let expect",
    "gain_all": "all torques are {factor:.3g} +- {std:.2g} times what published masses let expect",
    "delay": "torques of {joints} are {ms:.1f} +- {ms_std:.1f} ms late",
    "clock_scale": "the clock of the recording runs {factor:.4g} times too slowly",
    "clock_offset": "torques were stamped {value:.2f} +- {std:.2g} s later than their motion",
    "encoder_zero": "the encoder zero of {joints} is off by {value:.3g} +- {std:.2g} {unit}",
    "flexibility": "{joints} has a flexibility of {value:.2g} +- {std:.1g} {unit}",
    "link_length": "the link before {joints} is {mm:.1f} +- {mm_std:.1f} mm {longer} than in "
    "the robot file",
    "spring": "{joints} has a torque of its position beyond gravity, up to {value:.2g} {unit}",
    "mounting": "gravity is {deg:.2f} +- {deg_std:.2f} deg off the mounting",
    "coupled_friction": _TURNS,
    "coupled_torques": f"{_TURNS}, and torques are those of motors",
    "coupled_motors": f"{_TURNS}, and positions and torques are those of motors",
    "payload": "the last link carries {size:.3g} +- {std:.2g} kg {more} than published",
    "payload_change": "the payload changes by {value:+.3g} +- {std:.2g} kg at about {since:.1f} s"
    "{again}",
    "friction_drift": "friction changes by {percent:+.0f} +- {percent_std:.0f} % along the record",
    "gravity_compensated": "the torques contain no gravity",
    "reversed": "the torques of {joints} fit only when reversed",
    "exchanged": "the columns of {joints} look exchanged",
    "exchanged_torques": "the torques of {joints} look exchanged",
}


def diagnose(
    records: Sequence[ExperimentRecord], robot: RobotModel, settings: ProcessingSettings
) -> tuple[Finding, ...]:
    """Look for faults in recordings.

    Args:
        records: The recordings that a model was identified from.
        robot: The robot as it was told.
        settings: Their window, and the delays that the model takes out; nothing else is hidden.

    Returns:
        Errors first. Of several recordings, each kind of fault once, as the recording shows it
        that shows it best; contacts of each. For an arm of too many joints, that alone.
    """
    if robot.joints > MOST_JOINTS:
        text = f"faults of recordings are looked for on arms of up to {MOST_JOINTS} joints"
        return (Finding("not_diagnosed", text, value=robot.joints, unit="1"),)
    prior = link_prior(robot)
    plain = ProcessingSettings(start_s=settings.start_s, stop_s=settings.stop_s)
    best: dict[tuple[str, tuple[int, ...]], tuple[float, list[Finding]]] = {}
    others: list[Finding] = []
    for record in records:
        samples = process(record, robot, plain)
        if samples.count < SAMPLES:
            continue
        samples = _whole_motion(record, plain, samples, robot, prior)
        if _absolute(record):
            text = "no torque of any joint is ever negative: absolute values"
            step = "record torques or currents with their signs"
            return (Finding("absolute_torque", text, next_step=step),)
        scale = _torque_scale(recording_of(robot, samples), prior)
        samples = replace(samples, tau=samples.tau / scale)
        explained = _explained(recording_of(robot, samples), prior)
        if scale != 1.0:
            best["gain_all", ()] = (np.inf, [_scaled(scale, explained)])
        for item in explained.found:
            key = (item.kind, item.joints)
            if key not in best or best[key][0] < item.score:
                undone = explained.reference.recording.robot
                told = [finding_of(one, robot, undone) for one in (item, *item.rivals[:1])]
                for k, rival in enumerate(told[1:], start=1):
                    text = f"as likely as that: {rival.text}"
                    told[k] = replace(rival, severity="info", text=text)
                best[key] = (item.score, told)
        others += _signals(record, robot, samples, explained)
    ranked = sorted(best.values(), key=lambda pair: (pair[1][0].severity != "error", -pair[0]))
    kinds = {pair[1][0].kind for pair in ranked}
    # The clock shows itself in two ways.
    rest = [f for f in others if not (f.kind == "clock_scale" and f.kind in kinds)]
    faults = (finding for _, pair in ranked for finding in pair)
    return (*(_compensated(f, settings.delays_s) for f in faults), *dict.fromkeys(rest))


def _compensated(finding: Finding, delays_s: Sequence[float] | None) -> Finding:
    """A delay as information where less of it is left than is looked for; others as they are.

    Of all joints, what is left of most counts: a joint may show no delay of its own.
    """
    if finding.kind != "delay" or finding.value is None or delays_s is None:
        return finding
    left = [abs(finding.value - delays_s[j]) for j in finding.joints or range(len(delays_s))]
    if np.median(left) > LEAST_DELAY_S:
        return replace(finding, next_step="shift torques against motion in the file")
    return replace(finding, severity="info", text=f"{finding.text}, compensated", next_step="")


def findings_of(record: ExperimentRecord, robot: RobotModel) -> tuple[Finding, ...]:
    """`diagnose` for one recording.

    Raises:
        RecordError: A torque that never changes, or of a size that no arm has.
    """
    return diagnose(checked_records([record]), robot, ProcessingSettings())


def _explained(recording: Recording, prior: tuple[Array, Array]) -> Explained:
    """The faults of a recording without its contacts, which look like faults where they are few."""
    explained = explain(recording, prior)
    if not explained.found:
        return explained
    _, touched = events.untouched(explained.reference, explained.values)
    touched = tuple(one for one in touched if not _meets(recording, one, explained))
    rows = events.rows_of(touched, recording.t)
    if not 0.0 < rows.mean() < MOST_TOUCHED:
        return explained
    return explain(recording.without(rows), prior)


def _whole_motion(
    record: ExperimentRecord,
    plain: ProcessingSettings,
    samples: Samples,
    robot: RobotModel,
    prior: tuple[Array, Array],
) -> Samples:
    """Samples whose motion is low-passed where the torques that are left are least.

    Where friction turns round, servos swing faster than what they were told: without these
    accelerations torques are left that look like those of gears that bend. Their noise hides what
    bends, so that little is not worth it. Of rows that were sampled a part of a step early or late
    accelerations are mostly noise, of which a slower clock would leave less.
    """

    def left(samples: Samples) -> float:
        ref = reference(recording_of(robot, samples).fast(), prior)
        return float(0.5 * np.log(np.square(ref.left(fits(ref)[1])).mean(axis=1) + 1e-18).mean())

    least, first = left(samples), samples
    for factor in (WIDER, 1 / WIDER):
        while True:
            try:
                other = process(record, robot, replace(plain, cutoff_hz=factor * samples.cutoff_hz))
            except InputError:  # A narrower one reaches from gap to gap.
                break
            same = abs(other.cutoff_hz / samples.cutoff_hz - 1) < 0.01
            if same or other.count < SAMPLES or (now := left(other)) > least - WORTH_ANOTHER:
                break
            samples, least = other, now
        if samples is not first:
            break
    return samples


def _torque_scale(recording: Recording, prior: tuple[Array, Array]) -> float:
    """Factor of all torques over those of published bodies, where it is beyond `MISSCALED`; else 1.

    So far from the prior the search below, which is one of small faults, finds other ones.
    """
    robot = recording.robot
    if not robot.published.all():
        return 1.0
    ref = reference(recording, prior)
    bodies = np.tensordot(prior[0], ref.columns[: len(prior[0])], axes=1)
    both = alone = measured = 0.0
    for body, torque, friction in zip(
        bodies, ref.torque, ref.columns[len(prior[0]) :].swapaxes(0, 1), strict=True
    ):
        base, *_ = np.linalg.svd(friction[friction.any(axis=1)].T, full_matrices=False)
        own, seen = (values - base @ (base.T @ values) for values in (body, torque))
        # Motor inertia and friction may hold all that a body does, as where it only slides.
        if own @ own > 1e-6 * (body @ body) and (size := float(seen @ seen)) > 0:
            # Every joint counts alike, however much it is loaded.
            both += float(own @ seen) / size
            alone += float(own @ own) / size
            measured += 1.0
    if both <= ALIKE * np.sqrt(alone * measured) or 1 / MISSCALED < both / alone < MISSCALED:
        return 1.0
    return both / alone


def _scaled(scale: float, explained: Explained) -> Finding:
    rest = next((item for item in explained.found if item.kind == "gain_all"), None)
    factor = scale * (1 + rest.value) if rest else scale
    return Finding(
        "gain_all",
        f"all torques are {float(f'{factor:.2g}'):g} times what published masses let expect",
        value=factor,
        unit="1",
        next_step=_STEPS["gain_all"],
    )


def recording_of(robot: RobotModel, samples: Samples) -> Recording:
    """Samples as explanations may change them."""
    return Recording(
        robot=robot,
        t=samples.t,
        q=np.array(samples.q),
        dq=np.array(samples.dq),
        ddq=np.array(samples.ddq),
        friction_q=samples.friction_q,
        tau=np.array(samples.tau),
        block=max(1, -(-samples.count // ROWS)),
        apart=apart if (apart := at_limit(samples.tau, robot.limits.torque)).any() else None,
    )


def finding_of(item: Explanation, robot: RobotModel, undone: RobotModel) -> Finding:
    """An explanation as a finding; `undone` is the robot after all that was found."""
    every = len(item.joints) == robot.joints > 1
    names = "all joints" if every else " and ".join(robot.joint_names[j] for j in item.joints)
    value, std = item.value, item.std
    text = _FACTS[item.kind].format(
        joints=names, value=value, std=std, unit=item.unit, since=next(iter(item.changes_s), 0.0),
        again=f", and back: {len(item.changes_s)} changes" if len(item.changes_s) > 1 else "",
        factor=1 + value, ms=1e3 * value, ms_std=1e3 * std, mm=1e3 * abs(value),
        mm_std=1e3 * std, longer="longer" if value > 0 else "shorter",
        size=abs(value), more="more" if value > 0 else "less",
        deg=np.degrees(value), deg_std=np.degrees(std), percent=100 * value, percent_std=100 * std,
    )  # fmt: skip
    if item.rivals:
        kind, joints = item.rivals[0].kind, item.rivals[0].joints
        where = "" if len(joints) in (0, robot.joints) else f" of joint {joints[0] + 1}"
        text += f" (cannot be told from {kind.replace('_', ' ')}{where})"
    factor = item.kind in ("drive_gain", "gain_all", "clock_scale")
    turned = item.kind in ("mounting", "encoder_zero") and abs(value) > TURNED
    return Finding(
        item.kind,
        text,
        severity="error" if turned else "",
        joints=() if every else item.joints,
        value=1 + value if factor else value,
        std=std,
        unit=item.unit,
        next_step=_STEPS[item.kind].format(
            gravity=np.round(undone.gravity, 3).tolist(),
            mount=_mount_option(undone.gravity),
            coupling=f"[drives] coupling = {_coupling(robot, undone)}",
        ),
    )


def _coupling(robot: RobotModel, undone: RobotModel) -> list[list[float]]:
    """(n, n) motor turns per joint turn: those that were found, by the gear ratios known."""
    ratios, turns = np.diag(robot.drives.motor_from_joint), undone.drives.coupling
    motors = "motor" in (robot.drives.position_side, robot.drives.torque_side)
    found = np.eye(robot.joints) if turns is None else turns / np.diag(turns)[:, None]
    return np.round(found * ratios[:, None] if motors else found, 3).tolist()


def _mount_option(gravity: Array) -> str:
    """The option of this mounting, where there is one: those turn about the base's x axis."""
    x, y, z = gravity
    if abs(x) > _ABOUT_X * np.linalg.norm(gravity):
        return ""
    degrees = float(np.degrees(np.arctan2(-y, -z)))
    return f"--mount tilt:{round(degrees, 1) + 0.0}, or "


def _signals(
    record: ExperimentRecord, robot: RobotModel, samples: Samples, explained: Explained
) -> list[Finding]:
    found: list[Finding] = []
    ref = explained.reference
    rec = ref.recording
    made = _computed(samples.tau, ref.left(explained.values).T)
    error, touched = events.untouched(ref, explained.values)
    ends = at_limit(samples.tau, robot.limits.torque).any(axis=0) & (not made)
    stopped: list[int] = np.flatnonzero(ends).tolist()
    torque = np.sqrt(np.square(rec.tau).mean(axis=0))
    size = robot.limits.rated_torque
    limit = np.where(np.isfinite(size), size, 3 * np.maximum(torque, 1e-300))
    for j in stopped:
        text = f"torque of {robot.joint_names[j]} stops at a limit"
        found.append(Finding("saturated", text, joints=(j,), next_step="record a slower motion"))
    # The friction of coupled motors turns round where their ratio, which is estimated, says.
    doubted = {*stopped, *(j for e in explained.found if e.kind in COUPLED for j in e.joints)}
    kinds = [] if made else _kind_of_torque(explained, limit)
    if any(k.severity != "info" for k in kinds):
        # Friction was taken off where joints move; what holds one of them at rest is not known.
        touched = tuple(c for c in touched if len(c.joints) > 1 or _moving(rec, c))
    if not made:
        told = [c for c in touched if not _meets(rec, c, explained)]
        found += [_touched(c, robot) for c in told if not set(c.joints) <= doubted]
    for j in range(robot.joints):
        wave = events.ripple(rec, error, j, LEAST_RIPPLE * float(limit[j]), touched)
        if wave is not None:
            text = (
                f"torque of {robot.joint_names[j]} ripples with {wave[1]:.2g} (amplitude), "
                f"{wave[0]:.0f} waves a turn"
            )
            unit = "N" if robot.prismatic[j] else "N.m"
            found.append(Finding("ripple", text, joints=(j,), value=wave[1], unit=unit))
    if "qd" in record.signals:
        scale = events.clock_scale(record.t, record.signals["q"], record.signals["qd"])
        if abs(scale - 1) > CLOCKS_DIFFER and abs(scale - 1) < 0.5:
            text = f"time runs {scale:.4g} times as fast in the stamps as in the velocities"
            found.append(
                Finding("clock_scale", text, value=scale, unit="1", next_step=_STEPS["clock_scale"])
            )
    if made:
        text = "the torques contain no noise: computed by a model or controller, not measured"
        step = "record measured torques or currents"
        found.insert(0, Finding("commanded", text, next_step=step))
    found += kinds
    rows = rec.measured(rec.average(error.T))
    # The model does not have to explain contacts.
    free = rec.average(events.rows_of(touched, rec.t).astype(np.float64)) == 0.0
    noise = np.square(np.diff(rows, axis=1)).mean(axis=1) / 2
    left = np.square(rows[:, free]).mean(axis=1)
    beyond = np.maximum(left - noise, 0.0)
    # Torques that are zero in the window leave nothing to explain.
    share = float(np.sqrt(beyond.sum() / (np.square(torque).sum() or np.inf)))
    if share > UNEXPLAINED:
        text = (
            f"the richest model leaves {100 * share:.0f} % of the torques, and no single fault "
            "that is known here explains it"
        )
        step = "check robot, joint order, units and signs"
        found.append(Finding("unexplained", text, value=share, unit="1", next_step=step))
    return found


def _meets(rec: Recording, contact: events.Contact, explained: Explained) -> bool:
    """Whether a contact begins and ends at changes of a payload, which are told to a row."""
    near = events.NEXT_S + rec.block * float(rec.t[1] - rec.t[0])
    ends = (contact.start_s, contact.stop_s)
    changes_s = [t for item in explained.found for t in item.changes_s]
    return all(any(abs(end - t) <= near for t in changes_s) for end in ends)


def _moving(rec: Recording, contact: events.Contact) -> bool:
    """Whether a joint that the contact loads moves meanwhile."""
    fast = np.percentile(np.abs(rec.dq), 98, axis=0)
    moves = np.abs(rec.dq) > events.REVERSAL * fast
    return bool(moves[events.rows_of((contact,), rec.t)][:, list(contact.joints)].any())


def _touched(contact: events.Contact, robot: RobotModel) -> Finding:
    names = ", ".join(robot.joint_names[j] for j in contact.joints)
    units = sorted({"N" if robot.prismatic[j] else "N.m" for j in contact.joints})
    return Finding(
        "contact",
        f"torques of {names} do not belong to the motion from {contact.start_s:.1f} to "
        f"{contact.stop_s:.1f} s (up to {contact.size:.2g} {' or '.join(units)})",
        joints=contact.joints,
        value=contact.start_s,
        unit="s",
        next_step="if this is a contact, leave it out with --from and --to, or record again",
    )


def _absolute(record: ExperimentRecord) -> bool:
    """Whether all torques are cut at zero: none is negative, and each comes close to zero."""
    tau = record.signals["effort" if "effort" in record.signals else "current"]
    low, high = tau.min(axis=0), tau.max(axis=0)
    return bool(((low >= 0.0) & (low < NEAR_ZERO * high)).all())


def _computed(tau: Array, error: Array) -> bool:
    """Whether torques (N, n) contain no noise and a rigid model leaves (T, n) next to nothing.

    Fourth differences keep noise, and of a motion little but where it starts and stops. Measured
    torques may be filtered, but no model is as good as that for them.
    """
    size = np.maximum(np.sqrt(np.square(tau).mean(axis=0)), 1e-300)
    noise = 1.48 * np.median(np.abs(np.diff(tau, n=4, axis=0)), axis=0) / np.sqrt(70)
    left = np.sqrt(np.square(error).mean(axis=0))
    return bool(np.median(noise / size) < NO_NOISE and np.median(left / size) < MODELLED)


def _kind_of_torque(explained: Explained, limit: Array) -> list[Finding]:
    ref = explained.reference
    rec, n = ref.recording, ref.recording.robot.joints
    count = (ref.shapes.stop - ref.shapes.start) // SHAPES
    dq = rec.average(rec.dq.T)
    way = np.maximum(np.abs(dq).sum(axis=1), 1e-300)
    torque = np.maximum(np.sqrt(np.square(rec.tau).mean(axis=0)), 1e-300)
    error = ref.left(explained.values)
    driven, all_friction = 0.0, 0.0
    left: list[tuple[float, float]] = []
    # Slides may have no gears, and friction of a joint that stands still is not seen.
    turn = ~np.array(rec.robot.prismatic) & events.travels(rec.q)
    turns: list[int] = np.flatnonzero(turn).tolist()
    for j in turns:
        own = [*range(ref.shapes.start + j, ref.shapes.stop, count), 10 * n + j]
        columns = rec.measured(ref.columns[[*own, 11 * n + j]])[:, j]
        powers: Array = ref.columns[own, j] @ dq[j] / way[j]
        power = float(explained.values[own] @ powers)
        friction = explained.values[own] @ columns[:-1]
        left.append((power / float(limit[j]), power / float(torque[j])))
        # In variances of the noise: of joints whose torque is mostly noise little can be told.
        noise = max(float(np.square(error[j]).mean()), 1e-300)
        driven += undriven(columns, powers, error[j] + friction) / noise
        all_friction += float(friction @ friction) / noise
    if driven > max(DRIVEN**2 * all_friction, BY_CHANCE * len(turns)):
        text = "friction has been taken off the torques: part of what is left of it drives the arm"
        return [Finding("friction_compensated", text)]
    if left and bool((np.median(left, axis=0) < NO_FRICTION).all()):
        text = "the torques contain hardly any friction: that of the gears is low, or not measured"
        return [Finding("hardly_any_friction", text)]
    return []
