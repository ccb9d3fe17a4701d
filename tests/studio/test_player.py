from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.core import InputError
from dynid.studio.session import Player

EXACT = 1e-9
TIMES = st.floats(0.0, 1e4)


def test_it_plays_with_the_clock_and_stays_where_it_is_paused() -> None:
    player = Player(10.0)
    player.play(100.0)
    assert player.place(103.0) == 3.0
    player.pause(104.0)
    assert player.place(1000.0) == 4.0
    player.play(2000.0)
    assert player.place(2002.0) == 6.0


def test_the_end_is_followed_by_the_start_or_by_rest() -> None:
    player = Player(10.0)
    player.play(0.0)
    assert player.place(23.0) == 3.0
    once = Player(10.0, loop=False)
    once.play(0.0)
    assert not once.settle(9.0)
    assert once.settle(11.0)
    assert (once.playing, once.place(50.0)) == (False, 10.0)
    once.play(60.0)
    assert once.place(61.0) == 1.0


@given(place=st.floats(-5.0, 15.0), now=TIMES, later=st.floats(0.0, 5.0))
def test_scrubbing_goes_to_the_place_and_plays_on_from_there(
    place: float, now: float, later: float
) -> None:
    player = Player(10.0, loop=False)
    player.play(0.0)
    player.seek(place, now)
    inside = min(max(place, 0.0), 10.0)
    assert player.place(now) == pytest.approx(inside, abs=EXACT)
    assert player.place(now + later) == pytest.approx(min(inside + later, 10.0), abs=1e-8)


@given(speed=st.floats(0.01, 10.0), now=st.floats(0.0, 100.0))
def test_another_speed_makes_no_jump(speed: float, now: float) -> None:
    player = Player(7.0)
    player.play(0.0)
    before = player.place(now)
    player.set_speed(speed, now)
    assert player.place(now) == pytest.approx(before, abs=EXACT)


def test_what_cannot_be_played_is_refused() -> None:
    for duration in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError):
            Player(duration)
    with pytest.raises(InputError):
        Player(1.0).set_speed(0.0, 0.0)
