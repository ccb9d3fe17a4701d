"""The tab that designs a motion, with its criterion as it falls."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.core.errors import DynidError
from dynid.excitation.criteria import CRITERIA
from dynid.studio import text
from dynid.studio.files import file_in, free_name
from dynid.studio.job_view import JobView
from dynid.studio.jobs import Job

if TYPE_CHECKING:
    import viser

    from dynid.studio.session import Session
    from dynid.studio.supervisor import JobState

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
        self.criterion = gui.add_dropdown("Criterion", tuple(CRITERIA), initial_value="cond")
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
                "scene": session.scene_for_jobs(),
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
    state = "feasible" if result.get("feasible") else "NOT feasible"
    early = ", stopped early" if result.get("interrupted") else ""
    number = result.get("condition_number")
    value = f"{number:.4g}" if isinstance(number, float) else "unknown"
    return f"condition number {value}, {state}{early}"
