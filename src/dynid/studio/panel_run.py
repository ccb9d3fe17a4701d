"""The tab that runs a design on a robot, with its signals as they come."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.core.errors import DynidError, InputError
from dynid.figures.theme import colour, joint_unit
from dynid.studio import text
from dynid.studio.files import file_in, free_name
from dynid.studio.job_view import JobView
from dynid.studio.jobs import Job
from dynid.studio.tail import Tail, TailReader

if TYPE_CHECKING:
    import viser

    from dynid.studio.session import Session
    from dynid.studio.supervisor import JobState

FILE = "record.parquet"
"""What a recording is called unless its name is typed; numbered where there is one."""
SIGNALS = {"current": "A", "q": "rad", "qd": "rad/s", "temperature": "degC"}
"""What can be drawn while it runs, with its unit."""


class RunPanel:
    """Run from the page.

    Args:
        server: The page; the panel goes where its widgets go now.
        session: What is run.
        opened: Told when a new recording is there to be played.
    """

    def __init__(
        self, server: viser.ViserServer, session: Session, opened: Callable[[], None]
    ) -> None:
        self._session, self._opened = session, opened
        gui = server.gui
        slides = session.robot.prismatic
        self._signals = {
            f"{name} [{joint_unit(unit, slides)}]": name for name, unit in SIGNALS.items()
        }
        self.target = gui.add_text("Robot", "sim", hint="sim, or ur://HOST for a real one")
        self.repeat = gui.add_number("Periods", 3, min=1, max=1000, step=1)
        self.slow = gui.add_checkbox("Slow first pass (20 %)", False)
        self.name = gui.add_text("File", free_name(session.folder, FILE))
        self.view = JobView(server, session, "Run", "STOP the robot")
        self._asked = gui.add_html("", visible=False)
        self.word = gui.add_text("Type the word", "", visible=False)
        self.agree = gui.add_button("Move the robot", color="orange", visible=False)
        self.signal = gui.add_dropdown("Signal", tuple(self._signals))
        series: list[Any] = [{"label": "s"}]
        for k, name in enumerate(session.robot.joint_names):
            series.append({"label": text.plain(name, 20), "stroke": colour(k), "width": 1})
        zero = np.zeros(2)
        self._blank = (np.array([0.0, 1.0]), *(zero for _ in session.robot.joint_names))
        self._plot = gui.add_uplot(
            self._blank,
            tuple(series),
            scales={"x": {"time": False}},
            legend={"show": False},
            height=200,
            visible=False,
        )
        self._reader: TailReader | None = None
        self._connect()

    def show(self, state: JobState, clock: float) -> None:
        """Show how the run goes: questions, progress, the newest samples."""
        self.view.show(state)
        self._ask(state)
        if self._reader is None and self._session.job is not None:
            self._reader = TailReader(Path(self._session.job.job.output))
        tail = None if self._reader is None else self._reader.read(clock)
        if tail is not None:
            self.draw(tail)
            speed = tail.signals.get("qd")
            self._session.follow(tail.signals["q"][-1], None if speed is None else speed[-1])

    def finished(self, state: JobState) -> None:
        """Play what was recorded, whole or not."""
        self._ask(state)
        self._reader = None
        self._session.follow(None)
        result = state.result
        record = None if result is None else result.get("record")
        failure = ""
        if isinstance(record, str):
            # Before the words that say it is done: whoever reads them finds the recording.
            try:
                self._session.open(Path(record))
            except DynidError as error:
                failure = str(error)
            else:
                self._opened()
                self.name.value = free_name(self._session.folder, FILE)
        self.view.end(state, "" if result is None else _words(result))
        if failure:
            self.view.say(failure, text.BAD)
        elif result is not None and result.get("aborted"):
            self.view.say(_words(result), text.WARN)

    def draw(self, tail: Tail) -> None:
        """Draw the newest samples."""
        values = tail.signals.get(self._signals[self.signal.value])
        if values is None or len(values) < 2:
            return
        self._plot.data = (tail.t, *(np.ascontiguousarray(column) for column in values.T))
        self._plot.visible = True

    def _ask(self, state: JobState) -> None:
        asked = state.ask is not None
        if asked == self.agree.visible:
            return
        if asked:
            words = f"{state.ask}\nType {state.word} to move the robot."
            self._asked.content = text.line(words, text.WARN, bold=True)
            self.word.value = ""
        self._asked.visible = self.word.visible = self.agree.visible = asked

    def _connect(self) -> None:
        session = self._session

        @self.view.start.on_click
        def _(_event: object) -> None:
            try:
                job = self._job()
            except DynidError as error:
                self.view.say(str(error), text.BAD)
                return
            self._plot.data, self._plot.visible = self._blank, False
            self.view.begin(job)

        @self.agree.on_click
        def _(_event: object) -> None:
            if session.job is not None:
                session.job.answer(self.word.value.strip())

    def _job(self) -> Job:
        session = self._session
        chosen = session.motions.get(session.motion.name)
        if chosen is None or not chosen.design:
            raise InputError("choose a design in the tab Motion first", value=session.motion.name)
        output = file_in(session.folder, self.name.value, ".parquet")
        return Job(
            kind="run",
            source=str(chosen.path),
            output=str(output),
            target=self.target.value.strip(),
            options={
                "repeat": int(self.repeat.value),
                "slow": 0.2 if self.slow.value else None,
                "scene": session.scene_for_jobs(),
            },
        )


def _words(result: dict[str, Any]) -> str:
    cause = result.get("cause")
    words = f"{result.get('samples')} samples, {result.get('gaps')} gaps"
    return words if not isinstance(cause, dict) else f"{words}; stopped: {_message(cause)}"


def _message(cause: Any) -> str:
    return str(cause.get("message"))
