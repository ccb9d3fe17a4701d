"""Point-to-point motions: the profile, and programs that say the same motion when read back."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace

import numpy as np
import pytest

from dynid.core import InputError, JsonFields
from dynid.robot import load_robot
from dynid.trajectory import (
    MotionSequence,
    PointToPoint,
    motion_family,
    pieces,
    points_text,
    trajectory_from_json,
    trajectory_to_json,
    ur_program,
)

STEP = 1e-5
PERIOD, POINTS = 8.0, 4
LEG = PERIOD / (POINTS + 1)


def _motion() -> MotionSequence:
    random = np.random.default_rng(3)
    family = motion_family("points", PERIOD, POINTS)
    found = family.trajectory(random.uniform(-1, 1, 6), random.uniform(-0.5, 0.5, (6, POINTS)))
    assert isinstance(found, MotionSequence)
    return found


def test_velocity_and_acceleration_are_the_derivatives_of_a_trapezoid() -> None:
    leg = _motion().parts[0]
    t = np.linspace(0.01, LEG - 0.01, 97)
    motion = leg.evaluate(t)
    before, after = leg.evaluate(t - STEP), leg.evaluate(t + STEP)
    np.testing.assert_allclose((after.q - before.q) / (2 * STEP), motion.dq, atol=1e-4)
    edge = np.minimum(np.abs(t - LEG / 3), np.abs(t - 2 * LEG / 3)) < 2 * STEP
    change = (after.dq - before.dq) / (2 * STEP)
    np.testing.assert_allclose(change[~edge], motion.ddq[~edge], atol=1e-4)
    way = np.abs(leg.evaluate([LEG]).q - leg.evaluate([0.0]).q)[0]
    np.testing.assert_allclose(np.abs(motion.dq).max(axis=0), 1.5 * way / LEG, rtol=1e-9)
    np.testing.assert_allclose(np.abs(motion.ddq).max(axis=0), 4.5 * way / LEG**2, rtol=1e-9)


def test_family_formulas_and_file_say_the_same_motion() -> None:
    motion = _motion()
    t = np.linspace(0.0, PERIOD, 333)
    truth = motion.evaluate(t)
    again = trajectory_from_json(JsonFields(trajectory_to_json(motion)))
    np.testing.assert_array_equal(again.evaluate(t).q, truth.q)
    family = motion_family("points", PERIOD, POINTS)
    places = np.array([part.goal for part in motion.parts[:-1]]) - motion.parts[0].start
    q = family.basis(t)[0] @ places + motion.parts[0].start
    np.testing.assert_allclose(q, truth.q, atol=1e-12)
    begin, formulas = 0.0, pieces(motion)
    assert len(formulas) == 3 * len(motion.parts)
    for piece in formulas:
        s = np.linspace(0.0, 1.0, 7)
        ours = np.power(s[:, None], np.arange(piece.polynomial.shape[1])) @ piece.polynomial.T
        theirs = motion.evaluate(np.minimum(begin + s * piece.duration, PERIOD)).q
        np.testing.assert_allclose(ours, theirs, atol=1e-12)
        begin += piece.duration
    assert "servoj" in ur_program(motion)


def _numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


def test_programs_read_back_are_the_motion() -> None:
    motion, limits = _motion(), load_robot("ur5").limits
    poses = np.array([motion.parts[0].start, *(part.goal for part in motion.parts)])
    far = np.abs(np.diff(poses, axis=0))

    moves = re.findall(
        r"movej\(\[(.*?)\], a=(\S+), v=([^,)]+)", points_text(motion, "movej", limits)
    )
    np.testing.assert_allclose([_numbers(pose) for pose, _, _ in moves], poses, atol=1e-8)
    # Time of movej's trapezoid: way / v + v / a, of the axis that goes far.
    push, speed = (np.array([float(move[k]) for move in moves[1:]]) for k in (1, 2))
    times = far.max(axis=1) / speed + speed / push
    np.testing.assert_allclose(times, LEG, rtol=1e-6)

    rows = list(csv.reader(io.StringIO(points_text(motion, "waypoints", limits))))
    table = np.array(rows[1:], dtype=float)
    np.testing.assert_array_equal(table[:, 1:], poses)
    np.testing.assert_allclose(table[1:, 0], LEG)

    krl = points_text(motion, "krl", limits)
    axes = [re.findall(r"A\d (\S+?)[,}]", line) for line in krl.splitlines() if "PTP" in line]
    np.testing.assert_allclose(np.radians(np.array(axes, dtype=float)), poses, atol=1e-8)
    shares = np.array(re.findall(r"\$VEL_AXIS\[\d\]=(\d+)", krl), dtype=float).reshape(-1, 6) / 100
    # Whole per cent, rounded down: not faster than what was certified, but for the least, 1.
    one, speed = 0.01 * limits.velocity, 1.5 * far / LEG
    assert (shares * limits.velocity <= np.maximum(speed, one) + 1e-9).all()
    assert (shares * limits.velocity >= speed - one).all()
    unknown = replace(limits, acceleration=np.full(6, np.nan))
    with pytest.raises(InputError, match=r"krl: KRL takes shares .*joint 1.*Give \[limits\]"):
        points_text(motion, "krl", unknown)

    rapid = points_text(motion, "rapid", limits)
    lines = [line for line in rapid.splitlines() if "MoveAbsJ" in line]
    joints = [_numbers(line.split("[[")[1].split("]")[0]) for line in lines]
    np.testing.assert_allclose(np.radians(joints), poses, atol=1e-8)
    assert all(f"\\T:={LEG:.6f}" in line and "fine" in line for line in lines[1:])
    assert all("untested" in text for text in (krl, rapid))
    for language, mark in (("movej", "  # "), ("krl", "; "), ("rapid", "    ! ")):
        text = points_text(motion, language, limits, comment="not judged: torque")
        assert re.search(rf"^{mark}untested.*; not judged: torque$", text, re.MULTILINE)


def test_other_motions_have_no_points() -> None:
    limits = load_robot("ur5").limits
    series = motion_family("fourier", 5.0, 2).trajectory(np.zeros(6), np.zeros((6, 2)))
    with pytest.raises(InputError, match="not a motion through points"):
        points_text(series, "krl", limits)
    with pytest.raises(InputError, match="language: unknown word"):
        points_text(_motion(), "karel", limits)
    small = PointToPoint(start=np.zeros(3), goal=np.ones(3), travel_time=1.0)
    with pytest.raises(InputError, match="six joints"):
        points_text(small, "rapid", limits)
