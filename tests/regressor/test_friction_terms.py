import json
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.core import InputError
from dynid.regressor import (
    TERMS,
    FrictionTerms,
    Gear,
    LoadFriction,
    TorqueRipple,
    parse_terms,
    terms_from_json,
)

some_joints = st.none() | st.sets(st.integers(0, 11), min_size=1).map(lambda js: tuple(sorted(js)))
some_widths = st.floats(0, 10) | st.lists(st.floats(0, 10), min_size=1, max_size=12).map(tuple)


@st.composite
def friction_terms(draw: st.DrawFn) -> FrictionTerms:
    words = draw(st.permutations(TERMS))[: draw(st.integers(1, len(TERMS)))]
    return FrictionTerms(
        terms=tuple((word, draw(some_joints)) for word in words),
        width=draw(some_widths),
        stribeck_velocity=draw(st.floats(1e-6, 10)),
    )


@given(friction_terms())
@settings(derandomize=True)
def test_terms_survive_their_description(friction: FrictionTerms) -> None:
    again = parse_terms(
        friction.describe(), width=friction.width, stribeck_velocity=friction.stribeck_velocity
    )
    assert again == friction


@given(friction_terms())
@settings(derandomize=True)
def test_terms_survive_a_json_file(friction: FrictionTerms) -> None:
    assert terms_from_json(json.loads(json.dumps(friction.to_json()))) == friction


def test_parameters_taken_out_leave_the_others() -> None:
    load = LoadFriction(joints=(0, 2), parameters=(1.0,) * 30)
    terms = replace(parse_terms("fc,fv:1+3,fo:2"), load=load)
    left = terms.without({"Fc2", "Fv3", "Fo2", "Fl1", "mZ3"}, joints=3)
    assert left.describe() == "fc:1+3,fv:1"
    assert left.load == replace(load, joints=(2,))
    assert terms.without({"mZ3"}, joints=3) == terms
    assert terms.without({"Fl1", "Fl3"}, joints=3).load is None


@given(st.text(alphabet="fcvimorsa:,+0123456789 -²x", max_size=40) | st.text(max_size=20))
@settings(derandomize=True, max_examples=300)
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        friction = parse_terms(text)
    except InputError:
        return
    assert parse_terms(friction.describe()) == friction


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"terms: unknown, repeated or no terms; .*allowed: fc,fv,im,fo,fca,fva,fs,fr"),
        ("fc,fv,", "unknown, repeated or no terms"),
        ("fc,fx", r"got fc,fx; allowed: fc,"),
        ("fc,fv,fc", "repeated"),
        ("FC", "unknown"),
        ("fo:0", r"joints of a term count from 1; got fo:0. Write for example fo:1\+3"),
        ("fo:", "count from 1"),
        ("fo:-1", "count from 1"),
        ("fo:1+", "count from 1"),
        ("fo:1.5", "count from 1"),
        ("fo:²", "count from 1"),
        ("fo:" + "9" * 5000, "count from 1"),
    ],
)
def test_a_bad_choice_is_refused_in_words(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_terms(text)


def test_blanks_order_and_repeated_joints_are_tidied() -> None:
    assert parse_terms(" fc , fo:3+1+3 ").terms == (("fc", None), ("fo", (0, 2)))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"terms": (("fo", ()),)}, "needs joints"),
        ({"terms": (("fo", (1, 1)),)}, "each once"),
        ({"terms": (("fo", (-1,)),)}, "count from 0"),
        ({"terms": ()}, "no terms"),
        ({"width": -0.1}, "widths"),
        ({"width": math.nan}, "widths"),
        ({"width": (0.1, math.inf)}, "widths"),
        ({"stribeck_velocity": 0.0}, "Stribeck"),
        ({"stribeck_velocity": math.nan}, "Stribeck"),
    ],
)
def test_values_out_of_range_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        FrictionTerms(**values)


def test_terms_must_fit_the_robot() -> None:
    parse_terms("fc,fo:6", width=(0.1,) * 6).check_joints(6)
    with pytest.raises(InputError, match="got 7; allowed: 6"):
        parse_terms("fo:7").check_joints(6)
    with pytest.raises(InputError, match="one Coulomb width a joint; got 3; allowed: 6"):
        parse_terms("fc", width=(0.1, 0.2, 0.3)).check_joints(6)


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"terms": "fc", "width": 0.1},
        {"terms": "fc", "width": None, "stribeck_velocity": 0.1},
        {"terms": "fc", "width": [0.1, "x"], "stribeck_velocity": 0.1},
        {"terms": None, "width": 0.1, "stribeck_velocity": 0.1},
        {"terms": "fc", "width": {"a": 1}, "stribeck_velocity": 0.1},
    ],
)
def test_damaged_json_is_refused(data: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        terms_from_json(data)


@pytest.mark.parametrize(
    "wrong",
    [
        {"joint": -1},
        {"waves": ()},
        {"waves": (3.0, 0.0)},
        {"waves": (math.inf,)},
        {"speed": -1.0},
        {"powers": 0},
        {"powers": 7},
    ],
)
def test_a_gear_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    right: dict[str, Any] = {"joint": 0, "waves": (3.0, 7.5), "speed": 2.0, "powers": 6}
    assert Gear(**right).size == 24
    with pytest.raises(InputError, match="ripple cannot be read"):
        Gear(**{**right, **wrong})


@pytest.mark.parametrize(
    "wrong",
    [{"joint": -1}, {"gears": ()}, {"coefficients": (1.0,)}, {"coefficients": (1.0, math.nan)}],
)
def test_a_ripple_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    gear = Gear(joint=0, waves=(3.0,), speed=2.0, powers=1)
    right: dict[str, Any] = {"joint": 0, "gears": (gear,), "coefficients": (1.0, 2.0)}
    assert TorqueRipple(**right).coefficients == (1.0, 2.0)
    with pytest.raises(InputError, match="ripple cannot be read"):
        TorqueRipple(**{**right, **wrong})
