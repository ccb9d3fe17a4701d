"""The tab that plays: motion, time, speed, limits now, certificate.

What every tab with a job shows of it: how far it is, what it says, a button to stop it.

The tab that designs a motion, with its criterion as it falls.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.core import DynidError, InputError
from dynid.excitation import CRITERIA
from dynid.studio import text
from dynid.studio.jobs import Job
from dynid.studio.opening import REST
from dynid.studio.session import SPEEDS, Player, file_in, free_name

if TYPE_CHECKING:
    import viser

    from dynid.studio.jobs import Job, JobState
    from dynid.studio.live import Instant
    from dynid.studio.session import Now, Session


class JobView:
    """Start, stop, progress and words of one kind of job.

    Args:
        server: The page; the widgets go where widgets go now.
        session: Who starts jobs.
        start: What the start button says.
        stop: What the stop button says.
    """

    def __init__(self, server: viser.ViserServer, session: Session, start: str, stop: str) -> None:
        gui = server.gui
        self._session = session
        self.start = gui.add_button(start, color="green")
        self.stop = gui.add_button(stop, color="red", disabled=True)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._words = gui.add_html("")
        self._shown: JobState | None = None

        @self.stop.on_click
        def _(_event: object) -> None:
            job = session.job
            if job is not None:
                job.stop()

    def begin(self, job: Job) -> bool:
        """Start a job; whether it did, else the reason is shown."""
        try:
            self._session.start(job)
        except DynidError as error:
            self.say(str(error), text.BAD)
            return False
        self._shown = None
        self.start.disabled, self.stop.disabled = True, False
        self._bar.value, self._bar.visible = 0.0, True
        self.say("starting")
        return True

    def show(self, state: JobState) -> None:
        """Show how far it is."""
        if state is self._shown:
            return
        self._shown = state
        self._bar.value = round(100.0 * state.share, 1)
        self.stop.disabled = state.stopping or state.ended
        if not state.ended:
            self.say("stopping" if state.stopping else state.what)

    def end(self, state: JobState, words: str) -> None:
        """Show how it ended.

        Args:
            state: Its last state.
            words: What to say where there was no error.
        """
        self._shown = state
        self.start.disabled, self.stop.disabled = False, True
        self._bar.visible = False
        if state.error is not None:
            self.say(state.error, text.BAD)
        else:
            self.say(words, text.GOOD)

    def say(self, words: str, colour: str = text.INK) -> None:
        """Show a line."""
        self._words.content = text.line(words, colour)


FILE = "design.json"
"""What a design is called unless its name is typed; numbered where there is one."""
_MOST_S = 3600.0


class DesignPanel:
    """Design from the page.

    Args:
        server: The page; the panel goes where its widgets go now.
        session: For whose robot and scene.
        opened: Told when a new design is there to be played.
    """

    def __init__(
        self, server: viser.ViserServer, session: Session, opened: Callable[[], None]
    ) -> None:
        self._session, self._opened = session, opened
        gui = server.gui
        self.criterion = gui.add_dropdown("Criterion", tuple(CRITERIA), initial_value="prediction")
        self.period = gui.add_number("Period [s]", 10.0, min=1.0, max=600.0, step=0.5)
        self.harmonics = gui.add_number("Harmonics", 5, min=2, max=20, step=1)
        self.budget = gui.add_number("Time to search [s]", 15.0, min=1.0, max=_MOST_S, step=1.0)
        self.seed = gui.add_number("Seed", 0, min=0, step=1)
        self.name = gui.add_text("File", free_name(session.folder, FILE))
        self.view = JobView(server, session, "Design", "Stop, keep the best")
        empty = np.array([0.0, 1.0])
        self._curve = gui.add_uplot(
            (empty, np.array([1.0, 1.0])),
            ({"label": "s"}, {"label": "best so far", "stroke": "#0072B2", "width": 2}),
            scales={"x": {"time": False}, "y": {"distr": 3}},
            height=160,
            visible=False,
        )
        self._drawn = 0

        @self.view.start.on_click
        def _(_event: object) -> None:
            self._start()

    def show(self, state: JobState) -> None:
        """Show how the search goes."""
        self.view.show(state)
        history = state.history
        if len(history) != self._drawn and history:
            self._drawn = len(history)
            seconds, values = np.array(history, dtype=np.float64).T
            self._curve.data = (np.r_[seconds, seconds[-1] + 1e-3], np.r_[values, values[-1]])
            self._curve.visible = True

    def finished(self, state: JobState) -> None:
        """Play the design."""
        result, job = state.result, self._session.job
        failure = ""
        if result is not None and job is not None:
            # Before the words that say it is done: whoever reads them finds the motion.
            try:
                self._session.open(Path(job.job.output))
            except DynidError as error:
                failure = str(error)
            else:
                self._opened()
                self.name.value = free_name(self._session.folder, FILE)
        self.view.end(state, "" if result is None else _words(result))
        if failure:
            self.view.say(failure, text.BAD)

    def _start(self) -> None:
        session = self._session
        try:
            output = file_in(session.folder, self.name.value, ".json")
            options: dict[str, Any] = {
                "criterion": self.criterion.value,
                "period_s": float(self.period.value),
                "harmonics": int(self.harmonics.value),
                "budget_s": float(self.budget.value),
                "seed": int(self.seed.value),
                **session.surroundings_for_jobs(),
                "mount": None if session.robot.mount == "file" else session.robot.mount,
            }
        except DynidError as error:
            self.view.say(str(error), text.BAD)
            return
        self._drawn = 0
        self._curve.visible = False
        self.view.begin(
            Job(kind="design", source=session.reference, output=str(output), options=options)
        )


def _words(result: dict[str, Any]) -> str:
    state = str(result.get("certificate", "not judged"))
    early = ", stopped early" if result.get("interrupted") else ""
    number = result.get("condition_number")
    value = f"{number:.4g}" if isinstance(number, float) else "unknown"
    return f"condition number {value}, {state}{early}"


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
