import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from structure_oracles import A2, A3, D4, D5, D6, found, names, reduce, reduced

from dynid.reduction import random_states
from dynid.robot import RobotModel, load_robot, robot_from_dh

REGROUPING = 1e-6
"""Asked of the regrouping table."""
PRINTED = 1e-5
"""Six digits are printed."""
ENERGY = 0.02
"""The paper's energy depends on the random points."""


@pytest.mark.parametrize(
    ("mount", "terms", "frames", "counts"),
    [
        ("floor", "fc,fv,im", "dh", (52, 36, 33, 9)),
        ("floor", "fc,fv,im", "mdh", (52, 36, 31, 11)),
        ("floor", "fc,fv,im", "urdf", (52, 34, 35, 9)),
        ("ceiling", "fc,fv,im", "dh", (52, 36, 33, 9)),
        ("wall", "fc,fv,im", "dh", (54, 37, 34, 7)),
        ("wall", "fc,fv,im", "mdh", (54, 37, 33, 8)),
        ("wall", "fc,fv,im", "urdf", (54, 35, 36, 7)),
        ("tilt:45", "fc,fv,im", "dh", (54, 37, 34, 7)),
        ("floor", "fc,fv,im,fo", "dh", (58, 42, 33, 9)),
        ("floor", "fc,fv", "dh", (48, 32, 31, 9)),
        ("floor", "im", "dh", (40, 24, 33, 9)),
    ],
)
def test_rank_and_classes(
    mount: str, terms: str, frames: str, counts: tuple[int, int, int, int]
) -> None:
    base = reduced("ur5", frames, mount, terms)
    assert found(base).counts == counts
    assert base.warnings == ()


def test_without_gravity_two_are_lost() -> None:
    robot = replace(load_robot("ur5"), gravity=np.zeros(3))
    assert [found(reduce(robot, frames)).counts for frames in ("dh", "mdh", "urdf")] == [
        (50, 34, 35, 9),
        (50, 35, 30, 13),
        (50, 32, 37, 9),
    ]


def test_the_78_are_36_inertial_12_friction_and_4_motors() -> None:
    base = reduced()
    assert len(base.model.columns) == 78
    independent = np.array(base.independent)
    assert ((independent < 60).sum(), (independent >= 72).sum()) == (36, 4)
    assert base.names[48:] == ("Im3", "Im4", "Im5", "Im6")
    assert names(base, base.classes.unidentifiable) == {
        f"{symbol}1" for symbol in ("m", "mx", "my", "mz", "Jxx", "Jzz", "Jyz", "Jxz", "Jxy")
    }
    before, after = base.classes.gap
    assert before > 0.05
    assert after < 1e-14


@pytest.mark.parametrize("deg", [0.01, 0.1, 0.9])
def test_a_base_nearly_upright_keeps_52_and_says_so(deg: float) -> None:
    base = reduced(mount=f"tilt:{deg}")
    assert found(base).counts == (52, 36, 33, 9)
    (notice,) = base.warnings
    assert notice.code == "ill_conditioned"
    assert f"gravity is {deg} deg off the axis of joint 1" in notice.message
    # Torques are still those of the arm as it stands.
    np.testing.assert_array_equal(
        base.model.robot.gravity, load_robot("ur5", mount=f"tilt:{deg}").gravity
    )


def _calibrated(scale: float, seed: int) -> RobotModel:
    random = np.random.default_rng(seed)
    table = {
        "a": [0, A2, A3, 0, 0, 0],
        "d": [0.089159, 0, 0, D4, D5, D6],
        "alpha": [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0],
    }
    return robot_from_dh(
        **{key: np.array(x) + random.normal(0, scale, 6) for key, x in table.items()}
    )


@pytest.mark.parametrize("scale", [1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", range(3))
def test_a_calibrated_arm_has_the_nominal_structure(scale: float, seed: int) -> None:
    robot, nominal = _calibrated(scale, seed), reduced()
    base = reduce(robot)
    assert found(base).counts == (52, 36, 33, 9)
    assert base.independent == nominal.independent
    assert base.classes.alone == nominal.classes.alone
    assert base.model.robot is robot
    # Around 0.01 deg and 0.1 mm it is a matter of chance; never more than one sentence.
    told = ["nominal geometry" in notice.message for notice in base.warnings]
    assert told in {1e-6: [[]], 1e-5: [[]], 1e-4: [[], [True]], 1e-3: [[True]]}[scale]


@pytest.mark.parametrize("seed", range(2))
def test_a_calibrated_arm_regroups_nearly_as_well_as_can_be(seed: int) -> None:
    """What the base columns of other states leave of the others, by SciPy's own solution."""
    robot = _calibrated(1e-3, seed)
    base = reduce(robot)
    w = base.model.observation_matrix(*random_states(robot, 300, 9))
    own, others = w[:, list(base.independent)], w[:, list(base.dependent)]
    best = scipy.linalg.lstsq(own, others)[0]
    least, left, nominal = (
        np.linalg.norm(others - own @ k) for k in (best, base.regrouping, base.nominal_regrouping)
    )
    assert left < 1.5 * least < nominal


def test_the_gap_is_between_the_last_base_parameter_and_the_next() -> None:
    classes = reduced().classes
    s = classes.normalised_singular_values
    assert classes.gap == (s[51] / s[0], s[52] / s[0])


@pytest.mark.parametrize(("what", "size"), [("alpha", 0.02), ("d", 2e-4), ("a", 2e-4)])
def test_one_sentence_names_a_joint_and_the_size_of_a_departure(what: str, size: float) -> None:
    table = {
        "a": np.array([0, A2, A3, 0, 0, 0]),
        "d": np.array([0.089159, 0, 0, D4, D5, D6]),
        "alpha": np.array([np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]),
    }
    table[what][1 if what == "d" else 0] += np.radians(size) if what == "alpha" else size
    base = reduce(robot_from_dh(**table))
    (notice,) = base.warnings
    unit = "deg" if what == "alpha" else "m"
    told = re.search(r"up to ([\d.e-]+) (\w+) \((\w+)\) off it", notice.message)
    assert told is not None
    assert told[2] == unit
    assert float(told[1]) == pytest.approx(size, rel=0.01)
    assert told[3] in base.model.robot.joint_names


def test_rounded_angles_in_a_file_are_silent() -> None:
    rounded = {"alpha": [1.5708, 0, 0, 1.5708, -1.5708, 0]}
    base = reduce(robot_from_dh(a=[0, A2, A3, 0, 0, 0], d=[0.089159, 0, 0, D4, D5, D6], **rounded))
    assert found(base).counts == (52, 36, 33, 9)
    assert base.warnings == ()


# Closed forms of methods.md 1.3; what is not listed is zero.
MASSES = ("m4", "m5", "m6")
TABLE: dict[str, dict[str, float]] = {
    "Jyy1": {
        **dict.fromkeys(("Jyy2", "Jyy3", "Jzz4", "Im1"), 1.0),
        **dict.fromkeys(("Jzz2", "Jzz3", "Im2"), -1.0),
        **dict.fromkeys(MASSES, D4**2),
        "my4": 2 * D4,
    },
    "m2": {"Jzz2": -1 / A2**2, "Jzz3": 1 / A3**2, "Im2": -1 / A2**2},
    "mx2": {"Jzz2": 1 / A2, "Im2": 1 / A2},
    "mz2": {"Jxz2": -1 / A2, "Jxz3": 1 / A3},
    "Jxx2": {"Jyy2": -1.0, "Jzz2": 1.0, "Im2": 1.0},
    "m3": {"Jzz3": -1 / A3**2, **dict.fromkeys(MASSES, 1.0)},
    "mx3": {"Jzz3": 1 / A3},
    "mz3": {"Jxz3": -1 / A3, **dict.fromkeys(MASSES, D4), "my4": 1.0},
    "Jxx3": {"Jyy3": -1.0, "Jzz3": 1.0},
    "mz4": {"m5": D5, "m6": D5, "my5": -1.0},
    "Jxx4": {"Jzz4": -1.0, "m5": D5**2, "m6": D5**2, "my5": -2 * D5, "Jzz5": 1.0},
    "Jyy4": {"m5": D5**2, "m6": D5**2, "my5": -2 * D5, "Jzz5": 1.0},
    "mz5": {"m6": D6, "mz6": 1.0},
    "Jxx5": {"Jzz5": -1.0, "m6": D6**2, "mz6": 2 * D6, "Jyy6": 1.0},
    "Jyy5": {"m6": D6**2, "mz6": 2 * D6, "Jyy6": 1.0},
    "Jxx6": {"Jyy6": -1.0},
}


def test_regrouping_is_the_table_of_closed_forms() -> None:
    base = reduced()
    dependent = [base.model.names[i] for i in base.dependent]
    expected = np.zeros((52, 26))
    for row, name in enumerate(base.names):
        for other, factor in TABLE.get(name, {}).items():
            expected[row, dependent.index(other)] = factor
    np.testing.assert_allclose(base.regrouping, expected, rtol=REGROUPING, atol=0)
    assert set(TABLE) == {
        name for name, row in zip(base.names, base.regrouping, strict=True) if row.any()
    }


def test_a_base_column_without_company_is_a_parameter_alone() -> None:
    base = reduced()
    rows = [i for i, row in zip(base.independent, base.regrouping, strict=True) if not row.any()]
    assert tuple(rows) == base.classes.alone


def test_expressions_say_what_the_numbers_say() -> None:
    base = reduced()
    dependent = [base.model.names[i] for i in base.dependent]
    for name, row, text in zip(base.names, base.regrouping, base.expressions, strict=True):
        assert text.split(" ")[0] == name
        told = np.zeros(len(dependent))
        for sign, factor, other in re.findall(r" ([+-]) (?:([\d.e-]+)\*)?(\w+)", text):
            told[dependent.index(other)] = float(factor or 1) * (1 if sign == "+" else -1)
        np.testing.assert_allclose(told, row, rtol=PRINTED, atol=0)


def test_cumulative_energy_is_the_papers() -> None:
    energy = reduced().cumulative_energy
    assert energy.shape == (78,)
    assert (np.diff(energy) >= 0).all()
    np.testing.assert_allclose(energy[[34, 40, 45]], [0.99, 0.999, 0.9999], rtol=0, atol=ENERGY)
    assert energy[50] < 1 - 1e-9 < energy[51]
    assert energy[-1] == pytest.approx(1.0, abs=1e-15)
