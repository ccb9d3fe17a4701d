"""What every tab with a job shows of it: how far it is, what it says, a button to stop it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dynid.studio import text

if TYPE_CHECKING:
    import viser

    from dynid.studio.jobs import Job
    from dynid.studio.session import Session
    from dynid.studio.supervisor import JobState

from dynid.core.errors import DynidError


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
