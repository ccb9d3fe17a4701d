"""Words of options, written where nothing heavy is loaded, are those of the registries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid import settings
from dynid.constraints import PRESETS
from dynid.core import InputError, in_python
from dynid.excitation import CRITERIA
from dynid.identification import ESTIMATORS, PURPOSES
from dynid.recording import FORMATS
from dynid.settings import options_of
from dynid.trajectory import FAMILY_NAMES


def test_words_are_those_that_exist() -> None:
    for kind, known in (
        (
            dynid.DesignSettings,
            {"criterion": CRITERIA, "trajectory": FAMILY_NAMES, "limits": PRESETS},
        ),
        (dynid.IdentifySettings, {"estimator": ESTIMATORS, "purpose": PURPOSES}),
        (dynid.ImportOptions, {"format": ("auto", *FORMATS)}),
    ):
        options = options_of(kind)
        for name, words in known.items():
            assert set(options[name].words) == set(words)


@pytest.mark.parametrize(
    "kind", [v for v in vars(settings).values() if hasattr(v, "__dataclass_fields__")]
)
def test_messages_in_python_name_the_fields(kind: type) -> None:
    for name, option in options_of(kind).items():
        given = name if option.metavar else f"{name}={not option.name.startswith('--no-')}"
        assert in_python(f"give {option.name}, or") == f"give {given}, or"


def test_python_and_the_command_line_are_held_to_the_same_bounds() -> None:
    for wrong in ({"seed": -1}, {"period_s": float("nan")}, {"frames": "euler"}, {"noise": (0.0,)}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            dynid.DesignSettings(**wrong)  # type: ignore[arg-type]
    for share in (0.0, 1.0, 2.0):
        with pytest.raises(InputError, match="false_alarms"):
            dynid.FleetSettings(false_alarms=share)


@pytest.mark.parametrize(
    "wrong",
    [{"mount": 3}, {"mount": Path("wall")}, {"floor": False}, {"thermal": True}, {"scene": 3}],
    ids=str,
)
def test_values_of_another_type_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        dynid.RunSettings(**wrong)  # type: ignore[arg-type]


def test_bounds_are_said_in_words() -> None:
    design, fleet = options_of(dynid.DesignSettings), options_of(dynid.FleetSettings)
    assert design["collision"].bounds == "True or False"
    assert design["seed"].bounds == "a whole number, 0 or more"
    assert design["mount"].bounds == "text"
    assert fleet["false_alarms"].bounds == "a finite number, 1e-06 to 0.999999"
    assert design["noise"].bounds.startswith("several finite numbers, ")


def test_python_may_pass_what_no_command_line_can() -> None:
    lists = [{"noise": [1.0, np.nan]}, {"start_pose": np.array([np.nan])}]
    # None is the usual for other settings: no collision was judged, and the motion certified.
    flags = [{"collision": None}, {"collision": "no"}]
    for wrong in (*lists, *flags, {"method": None}, {"limits": ["safe"]}, {"criterion": 3}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            dynid.DesignSettings(**wrong)  # type: ignore[arg-type]
    assert dynid.DesignSettings(noise=()).noise == ()


@pytest.mark.parametrize(
    ("kind", "wrong", "option"),
    [
        (dynid.RunSettings, {"repeat": 2.5}, "--repeat"),
        (dynid.RunSettings, {"repeat": True}, "--repeat"),
        (dynid.RunSettings, {"slow": "0.2"}, "--slow"),
        (dynid.RunSettings, {"thermal": 500.0}, "--thermal"),
        (dynid.DesignSettings, {"seed": "x"}, "--seed"),
        (dynid.DesignSettings, {"period_s": "10"}, "--period"),
        (dynid.DesignSettings, {"noise": ("a",)}, "--noise"),
        (dynid.DesignSettings, {"payload": 3.0}, "--payload"),
        (dynid.DesignSettings, {"clearance": -1.0}, "--clearance"),
        (dynid.DesignSettings, {"clearance": 0.0}, "--clearance"),
        (dynid.DesignSettings, {"starts": 0}, "--starts"),
        (dynid.DesignSettings, {"budget_s": 0.0}, "--budget"),
        (dynid.DesignSettings, {"population": 3}, "--population"),
        (dynid.DesignSettings, {"generations": 0}, "--generations"),
        (dynid.DesignSettings, {"period_s": 3600.0}, "--period"),
        (dynid.DesignSettings, {"jobs": 0}, "--jobs"),
        (dynid.DesignSettings, {"rate_hz": float("nan")}, "rate_hz"),
        (dynid.IdentifySettings, {"cutoff_hz": 0.0}, "--cutoff"),
        (dynid.ImportOptions, {"rate_hz": -1.0}, "--rate"),
        (dynid.FleetSettings, {"reference_degC": -300.0}, "--reference"),
    ],
)
def test_what_is_no_such_number_is_refused_where_it_is_set(
    kind: type, wrong: dict[str, object], option: str
) -> None:
    with pytest.raises(InputError) as caught:
        kind(**wrong)
    assert caught.value.where == option
    assert repr(caught.value.value) == repr(next(iter(wrong.values())))
    assert caught.value.limit


def test_a_margin_that_is_no_number_is_told_what_is_allowed() -> None:
    with pytest.raises(InputError) as caught:
        dynid.DesignSettings(margin_percent=float("nan"))
    assert "0 to 99" in str(caught.value.limit)
    assert dynid.DesignSettings(seed=np.int64(3), period_s=np.float32(8)).seed == 3  # type: ignore[arg-type]
