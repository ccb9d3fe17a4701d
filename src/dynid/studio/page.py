"""The page: tabs, the 3D stage, and the loop that keeps them up to date."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dynid.core import DynidError
from dynid.studio import text
from dynid.studio.panel_motion import DesignPanel, MotionPanel
from dynid.studio.panel_run import ResultsPanel, RunPanel
from dynid.studio.panel_scene import ScenePanel
from dynid.studio.stage import Stage

if TYPE_CHECKING:
    import viser

    from dynid.studio.jobs import JobState, Supervisor
    from dynid.studio.session import Session
    from dynid.studio.solids import LinkMesh

_FRAME_S = 1 / 25
_FRAME_WHILE_RUNNING_S = 1 / 8
"""A recording needs the machine more than the page does."""
_IDLE_S = 0.2
_NICE = 10


class Page:
    """What visitors see and do.

    Args:
        server: viser, behind its door.
        session: What it is about.
        meshes: The bodies of the arm.
        notes: What visitors should know: files and bodies that are not shown.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        meshes: tuple[LinkMesh, ...],
        notes: Sequence[str] = (),
    ) -> None:
        self._server, self.session = server, session
        self.stage = Stage(server, session.robot, meshes)
        gui = server.gui
        gui.add_html(text.line(f"{text.plain(session.robot.name)}", bold=True))
        gui.add_html("".join(text.line(text.plain(note, 200), text.WARN) for note in notes))
        self._problem = gui.add_html("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Motion"):
            self.motion = MotionPanel(server, session)
        with tabs.add_tab("Scene"):
            self.scene = ScenePanel(server, session, self.stage)
        with tabs.add_tab("Design"):
            self.design = DesignPanel(server, session, self._opened)
        with tabs.add_tab("Run"):
            self.run_panel = RunPanel(server, session, self._opened)
        with tabs.add_tab("Results"):
            self.results = ResultsPanel(server, session)
        self._last: tuple[object, ...] = ()
        self._done: Supervisor | None = None

    def run(self, stop: threading.Event) -> None:
        """Keep the page up to date until `stop` is set.

        The calling thread steps back behind the processes of jobs, for good.
        """
        # On Linux a thread has a priority of its own; jobs are started by other threads.
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        # The first certificate compiles for seconds on a new machine: visitors need not wait.
        threading.Thread(target=self._first_look, daemon=True).start()
        while not stop.is_set():
            began = time.monotonic()
            try:
                busy = self.step(began)
            except DynidError as error:
                # One thing that cannot be shown does not end the page, nor a run beside it.
                self._problem.content, busy = text.line(str(error), text.BAD), True
            if not self._server.get_clients():
                period = _IDLE_S
            else:
                period = _FRAME_WHILE_RUNNING_S if busy else _FRAME_S
            stop.wait(max(period - (time.monotonic() - began), 0.005))

    def step(self, clock: float) -> bool:
        """Show what is true now; whether a job runs.

        Args:
            clock: The time of `time.monotonic` [s].
        """
        self.scene.settle()
        busy = self._follow_job(clock)
        session = self.session
        now = session.now(clock)
        seen = (now.place, now.q.tobytes(), id(session.constraints), session.player.playing)
        if seen != self._last:
            if self._last and self._last[2] != seen[2]:
                self.motion.show_certificate()
            self._last = seen
            instant = session.look(now)
            self.stage.show(instant)
            self.motion.show(now, instant, clock)
        return busy

    def _follow_job(self, clock: float) -> bool:
        job = self.session.job
        if job is None or job is self._done:
            return False
        state = job.state
        if state.ended:
            self._done = job
            self._finished(job.job.kind, state)
            return False
        if job.job.kind == "design":
            self.design.show(state)
        elif job.job.kind == "run":
            self.run_panel.show(state, clock)
        else:
            self.results.show(state)
        return True

    def _finished(self, kind: str, state: JobState) -> None:
        if kind == "design":
            self.design.show(state)
            self.design.finished(state)
        elif kind == "run":
            self.run_panel.finished(state)
        else:
            self.results.finished(state)

    def _first_look(self) -> None:
        self.motion.judge()
        if self.session.estimates:
            self.results.show_results()

    def _opened(self) -> None:
        """A job has made something to play."""
        self.motion.refresh()
        self.results.refresh()
        self.motion.judge()
