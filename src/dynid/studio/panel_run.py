"""The tab that runs a design on a robot, with its signals as they come.

The tab of results: identify a recording, the verdict, the figures, the report.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.core import DynidError, InputError
from dynid.figures import colour, fragment, joint_role, joint_unit, style
from dynid.report import parameter_figure, torque_figure
from dynid.studio import text
from dynid.studio.jobs import Job
from dynid.studio.live import Tail, TailReader
from dynid.studio.panel_motion import JobView
from dynid.studio.session import file_in, free_name
from dynid.workflow import report

if TYPE_CHECKING:
    import viser

    from dynid.report import ReportedEstimate
    from dynid.studio.jobs import JobState
    from dynid.studio.session import Session


RESULT_FILE = "estimate.json"
"""What an estimate is called unless its name is typed; numbered where there is one."""
_NONE = "-"
_COLOURS = {"usable": text.GOOD, "care": text.WARN, "do_not_use": text.BAD}


class ResultsPanel:
    """Results beside the arm.

    Args:
        server: The page; the panel goes where its widgets go now.
        session: Whose recordings.
    """

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        self._server, self._session = server, session
        gui = server.gui
        names = self._recordings()
        self.record = gui.add_dropdown("Recording", names, initial_value=names[-1])
        self.validation = gui.add_dropdown("Validate on", names, initial_value=_NONE)
        self.preset = gui.add_dropdown("Preset", ("best", "paper"), initial_value="best")
        self.name = gui.add_text("File", free_name(session.folder, RESULT_FILE))
        self.view = JobView(server, session, "Identify", "Stop")
        self.look = gui.add_button("Show the results of the folder")
        self.report = gui.add_button("Write report.html")
        self._verdict = gui.add_html("")
        self._folder = gui.add_folder("Figures", expand_by_default=True, visible=False)
        self._figures: list[viser.GuiHtmlHandle] = []
        self._connect()

    def refresh(self) -> None:
        """Offer the recordings that there are now."""
        names = self._recordings()
        for dropdown in (self.record, self.validation):
            chosen = dropdown.value if dropdown.value in names else _NONE
            dropdown.options = names
            dropdown.value = chosen
        if self.record.value == _NONE:
            self.record.value = names[-1]

    def show(self, state: JobState) -> None:
        """Show how the identification goes."""
        self.view.show(state)

    def finished(self, state: JobState) -> None:
        """Show the verdict and the figures of the new estimate."""
        result = state.result or {}
        self.view.end(state, f"written: {Path(str(result.get('file', ''))).name}")
        if state.result is None:
            return
        self.name.value = free_name(self._session.folder, RESULT_FILE)
        self._show_verdict(
            [("", str(result.get("level")), str(result.get("headline")))],
        )
        self.show_results()

    def show_results(self) -> None:
        """Judge the estimates of the folder and draw the newest of them."""
        with tempfile.TemporaryDirectory(prefix="dynid-studio-") as scratch:
            self._report(Path(scratch) / "report.html")

    def _report(self, output: Path) -> bool:
        try:
            _, contents = report(self._session.folder, output)
        except DynidError as error:
            self.view.say(str(error), text.BAD)
            return False
        self._show_verdict([(item.name, item.level, item.headline) for item in contents.estimates])
        newest = max(contents.estimates, key=lambda item: _age(self._session.folder / item.name))
        self._draw(newest)
        return True

    def _draw(self, item: ReportedEstimate) -> None:
        drawn = (torque_figure(item), parameter_figure(item.estimate))
        for handle in self._figures:
            handle.remove()
        self._figures = []
        self._folder.visible = True
        with self._folder:
            for figure in drawn:
                if figure is not None:
                    page = f"<style>{style()}</style>{fragment(figure)}"
                    self._figures.append(self._server.gui.add_html(page))

    def _show_verdict(self, found: list[tuple[str, str, str]]) -> None:
        self._verdict.content = "".join(
            text.line(
                f"{text.plain(name)}: {headline}" if name else headline,
                _COLOURS.get(level, text.WARN),
                bold=True,
            )
            for name, level, headline in found
        )

    def _connect(self) -> None:
        session = self._session

        @self.view.start.on_click
        def _(_event: object) -> None:
            try:
                output = file_in(session.folder, self.name.value, ".json")
                chosen = session.motions.get(self.record.value)
                if chosen is None:
                    self.view.say("choose a recording; make one in the tab Run", text.BAD)
                    return
            except DynidError as error:
                self.view.say(str(error), text.BAD)
                return
            other = session.motions.get(self.validation.value)
            self.view.begin(
                Job(
                    kind="identify",
                    source=str(chosen.path),
                    output=str(output),
                    options={
                        "preset": self.preset.value,
                        "robot": session.reference,
                        "validate": None if other is None else str(other.path),
                    },
                )
            )

        self._long(self.look, self.show_results)
        self._long(self.report, self._write)

    def _write(self) -> None:
        if self._report(self._session.folder / "report.html"):
            self.view.say("written: report.html", text.GOOD)

    def _long(self, button: viser.GuiButtonHandle, job: Callable[[], None]) -> None:
        @button.on_click
        def _(_event: object) -> None:
            button.disabled = True
            self.view.say("working")
            try:
                job()
            finally:
                button.disabled = False

    def _recordings(self) -> tuple[str, ...]:
        found = [name for name, item in self._session.motions.items() if not item.design]
        return (_NONE, *found)


def _age(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


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
            series.append(
                {"label": text.plain(name, 20), "stroke": colour(joint_role(k)), "width": 1}
            )
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
                **session.surroundings_for_jobs(),
            },
        )


def _words(result: dict[str, Any]) -> str:
    cause = result.get("cause")
    words = f"{result.get('samples')} samples, {result.get('gaps')} gaps"
    return words if not isinstance(cause, dict) else f"{words}; stopped: {_message(cause)}"


def _message(cause: Any) -> str:
    return str(cause.get("message"))
