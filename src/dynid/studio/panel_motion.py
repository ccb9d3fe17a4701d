"""The tab that plays: motion, time, speed, limits now, certificate."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from dynid.core.errors import InputError
from dynid.studio import text
from dynid.studio.motions import REST
from dynid.studio.player import SPEEDS, Player

if TYPE_CHECKING:
    import viser

    from dynid.studio.live import Instant
    from dynid.studio.session import Now, Session

_TEXT_EVERY_S = 0.2
"""Numbers that change faster cannot be read."""


class MotionPanel:
    """Play, pause, scrub, look.

    Args:
        server: The page; the panel goes where its widgets go now.
        session: What is shown.
    """

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        self._session, self._gui = session, server.gui
        gui = server.gui
        self.motion = gui.add_dropdown("Motion", self._names(), initial_value=self._current())
        self.play = gui.add_button("Play", icon=None, color="green")
        self.pause = gui.add_button("Pause")
        self.time = gui.add_slider("Time [s]", 0.0, self._end(), 0.01, 0.0)
        speeds = tuple(f"{speed:g} x" for speed in SPEEDS)
        self.speed = gui.add_dropdown("Speed", speeds, initial_value="1 x")
        self.repeat = gui.add_checkbox("Repeat", True)
        self._pose_folder = gui.add_folder("Pose", expand_by_default=False)
        with self._pose_folder:
            self.joints = self._sliders()
        self._now = gui.add_html("")
        self.certify = gui.add_button("Certify the whole motion")
        self._certificate = gui.add_html(text.certificate(None))
        self._written = 0.0
        self._moved = False
        self._player: Player = session.player
        self._connect()

    def refresh(self) -> None:
        """Offer the motions that there are now."""
        self.motion.options = self._names()
        self.motion.value = self._current()
        self.time.max = self._end()

    def show(self, now: Now, instant: Instant, clock: float) -> None:
        """Show where the motion is and how it stands with the limits."""
        session = self._session
        with session.lock:
            session.player.settle(clock)
            player, playing = session.player, session.player.playing
        # Of a motion that rests the visitor's hand knows the place before we do.
        moved = playing or self._moved or player is not self._player
        if moved and not session.following:
            self.time.value = round(min(now.place, self.time.max), 2)
            self._moved, self._player = playing, player
        self.play.disabled, self.pause.disabled = playing, not playing
        if clock - self._written >= _TEXT_EVERY_S or not playing:
            self._written = clock
            self._now.content = text.nearest(instant.near) + text.margins(instant.worst)

    def judge(self) -> None:
        """Certify the motion that is chosen, if it is a design."""
        self.certify.disabled = True
        try:
            if self._session.certifiable:
                self._session.certify()
        finally:
            self.certify.disabled = not self._session.certifiable
        self.show_certificate()

    def show_certificate(self) -> None:
        """Show the verdict that the session has."""
        found = self._session.verdict
        if not self._session.certifiable or found.motion != self._session.motion.name:
            self._certificate.content = text.certificate(None)
            return
        self._certificate.content = text.certificate(
            found.certificate, stale=self._session.stale, error=found.error
        )

    def _connect(self) -> None:
        session = self._session

        @self.motion.on_update
        def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
            if event.client_id is not None:
                try:
                    session.choose(self.motion.value)
                except InputError:
                    # The list has changed under the visitor's hand.
                    self.refresh()
                    return
                self.time.max = self._end()
                self.judge()

        @self.play.on_click
        def _(_event: object) -> None:
            session.player.play(time.monotonic())

        @self.pause.on_click
        def _(_event: object) -> None:
            session.player.pause(time.monotonic())

        # On the event loop, in order: the last place of a drag is the one that stays.
        @self.time.on_update
        async def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client_id is not None:
                now = time.monotonic()
                session.player.pause(now)
                session.player.seek(float(self.time.value), now)

        @self.speed.on_update
        def _(_event: object) -> None:
            chosen = float(self.speed.value.split()[0])
            session.player.set_speed(chosen, time.monotonic())

        @self.repeat.on_update
        def _(_event: object) -> None:
            now = time.monotonic()
            with session.lock:
                session.player.seek(session.player.place(now), now)
                session.player.loop = bool(self.repeat.value)

        for slider in self.joints:

            @slider.on_update
            async def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
                if event.client_id is not None:
                    session.hold(np.array([float(item.value) for item in self.joints]))
                    self.motion.value = REST

        @self.certify.on_click
        def _(_event: object) -> None:
            self.judge()

    def _sliders(self) -> list[viser.GuiSliderHandle[float]]:
        robot = self._session.robot
        start = self._session.now().q
        found: list[viser.GuiSliderHandle[float]] = []
        for k, name in enumerate(robot.joint_names):
            unit = "m" if robot.prismatic[k] else "rad"
            widest = 2.0 if robot.prismatic[k] else 2 * np.pi
            low, high = robot.limits.lower[k], robot.limits.upper[k]
            low = float(low) if np.isfinite(low) else -widest
            high = float(high) if np.isfinite(high) else widest
            place = float(np.clip(start[k], low, high))
            label = f"{text.plain(name, 24)} [{unit}]"
            found.append(self._gui.add_slider(label, low, high, (high - low) / 1000, place))
        return found

    def _names(self) -> tuple[str, ...]:
        return (*self._session.motions, REST)

    def _current(self) -> str:
        name = self._session.motion.name
        return name if name in self._session.motions else REST

    def _end(self) -> float:
        return max(round(self._session.motion.duration, 2), 0.01)
