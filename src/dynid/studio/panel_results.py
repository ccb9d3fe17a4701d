"""The tab of results: identify a recording, the verdict, the figures, the report."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.core.errors import DynidError
from dynid.figures import parameters, torque
from dynid.figures.theme import paint
from dynid.studio import text
from dynid.studio.files import file_in, free_name
from dynid.studio.job_view import JobView
from dynid.studio.jobs import Job
from dynid.workflow.reporting import report

if TYPE_CHECKING:
    import viser

    from dynid.figures.canvas import Canvas
    from dynid.report.contents import ReportedEstimate
    from dynid.studio.session import Session
    from dynid.studio.supervisor import JobState

FILE = "estimate.json"
"""What an estimate is called unless its name is typed; numbered where there is one."""
_NONE = "-"
_WIDTH = 340.0
"""Of a figure in the panel, about [px]: its height stays what it was made with."""
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
        self.name = gui.add_text("File", free_name(session.folder, FILE))
        self.view = JobView(server, session, "Identify", "Stop")
        self.look = gui.add_button("Show the results of the folder")
        self.report = gui.add_button("Write report.html")
        self._verdict = gui.add_html("")
        self._folder = gui.add_folder("Figures", expand_by_default=True, visible=False)
        self._figures: list[viser.GuiPlotlyHandle] = []
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
        self.name.value = free_name(self._session.folder, FILE)
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
        robot = item.estimate.model.robot
        drawn: list[Canvas] = []
        if item.shown is not None:
            drawn.append(torque.prediction(item.shown, robot.joint_names, robot.prismatic))
        drawn.append(parameters.parameter_intervals(item.estimate))
        for handle in self._figures:
            handle.remove()
        self._figures = []
        self._folder.visible = True
        with self._folder:
            for canvas in drawn:
                figure: Any = paint(canvas)
                height = float(figure.layout.height)
                canvas.update_layout(
                    title_font_size=13, font_size=10, height=None, margin={"l": 44, "r": 6}
                )
                # viser's aspect is height over width, whatever its documentation says.
                self._figures.append(self._server.gui.add_plotly(figure, aspect=height / _WIDTH))

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
