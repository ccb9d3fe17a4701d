"""The tab that edits the scene."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np

from dynid.core import DynidError
from dynid.studio import text
from dynid.studio.scene_editing import KINDS
from dynid.studio.text import plain

if TYPE_CHECKING:
    import viser

    from dynid.core import Array
    from dynid.studio.session import Session
    from dynid.studio.stage import Stage

_NONE = "-"


class ScenePanel:
    """Add, remove, move and save shapes.

    Args:
        server: The page; the panel goes where its widgets go now.
        session: Whose scene it is.
        stage: Where it is drawn.
    """

    def __init__(self, server: viser.ViserServer, session: Session, stage: Stage) -> None:
        self._server, self._session, self._stage = server, session, stage
        gui = server.gui
        self._chosen: int | None = None
        self._changed = threading.Event()
        self.kind = gui.add_dropdown("New shape", KINDS)
        self.add = gui.add_button("Add")
        self.shape = gui.add_dropdown("Shape", self._names(), initial_value=_NONE)
        self.position = gui.add_vector3("Position [m]", (0.0, 0.0, 0.0), step=0.01, visible=False)
        self._sizes = gui.add_folder("Size", visible=False)
        self._inputs: list[viser.GuiNumberHandle[float]] = []
        self.remove = gui.add_button("Remove", disabled=True)
        self._state = gui.add_html("")
        self.name = gui.add_text("File", session.scene_name)
        self.save = gui.add_button("Save the scene")
        self._connect()
        stage.draw_scene(session.editor, None)
        self._say()

    def settle(self) -> None:
        """Judge the scene anew if it was changed since; called now and then."""
        if self._changed.is_set():
            self._changed.clear()
            self._session.judge()
            self._say()

    def choose(self, number: int | None) -> None:
        """Take hold of a shape."""
        session = self._session
        with session.lock:
            self._chosen = number
            self._stage.draw_scene(session.editor, number)
            self._stage.hold(session.editor, number, self._moved)
            self.shape.options = self._names()
            self.shape.value = _NONE if number is None else self._label(number)
            self.remove.disabled = number is None
            self.position.visible = number is not None
            if number is not None:
                self._show_position(number)
            self._offer_sizes(number)

    def _moved(self, number: int, pose: Array, let_go: bool) -> None:
        session = self._session
        with session.lock:
            if number not in session.editor.items:
                return
            session.editor.place(number, pose)
            self._stage.move_shape(session.editor, number)
            if let_go:
                self._show_position(number)
        self._changed.set()

    def _connect(self) -> None:
        session = self._session

        @self.add.on_click
        def _(_event: object) -> None:
            with session.lock:
                self.choose(session.editor.add(self.kind.value))
            self._changed.set()

        @self.shape.on_update
        def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
            if event.client_id is not None:
                self.choose(self._number(self.shape.value))

        @self.remove.on_click
        def _(_event: object) -> None:
            with session.lock:
                if self._chosen is not None and self._chosen in session.editor.items:
                    session.editor.remove(self._chosen)
                self.choose(None)
            self._changed.set()

        @self.position.on_update
        def _(event: viser.GuiEvent[viser.GuiVector3Handle]) -> None:
            number = self._chosen
            if event.client_id is None or number is None:
                return
            with session.lock:
                pose = session.editor.pose(number)
                pose[:3, 3] = self.position.value
                session.editor.place(number, pose)
                self._stage.draw_scene(session.editor, number)
                self._stage.hold(session.editor, number, self._moved)
            self._changed.set()

        @self.save.on_click
        def _(_event: object) -> None:
            try:
                path = session.save_scene(self.name.value)
            except DynidError as error:
                self._state.content = text.line(str(error), text.BAD)
                return
            self._state.content = text.line(f"saved: {path.name}", text.GOOD)

    def _offer_sizes(self, number: int | None) -> None:
        for handle in self._inputs:
            handle.remove()
        self._inputs = []
        sizes = {} if number is None else self._session.editor.sizes(number)
        self._sizes.visible = bool(sizes)
        with self._sizes:
            for name, value in sizes.items():
                made = self._server.gui.add_number(f"{name} [m]", value, min=0.001, step=0.001)
                self._inputs.append(made)
                self._watch(made, name)

    def _watch(self, handle: viser.GuiNumberHandle[float], name: str) -> None:
        session = self._session

        @handle.on_update
        def _(event: viser.GuiEvent[viser.GuiNumberHandle[float]]) -> None:
            number = self._chosen
            if event.client_id is None or number is None:
                return
            try:
                with session.lock:
                    session.editor.resize(number, name, float(handle.value))
                    self._stage.draw_scene(session.editor, number)
            except DynidError as error:
                self._state.content = text.line(str(error), text.BAD)
                return
            self._changed.set()

    def _say(self) -> None:
        session = self._session
        if session.scene_error:
            self._state.content = text.line(session.scene_error, text.BAD)
        else:
            count = len(session.editor.items)
            self._state.content = text.line(f"{count} shape{'s' * (count != 1)} in the scene")

    def _show_position(self, number: int) -> None:
        place = np.round(self._session.editor.pose(number)[:3, 3], 4) + 0.0
        self.position.value = (float(place[0]), float(place[1]), float(place[2]))

    def _names(self) -> tuple[str, ...]:
        return (_NONE, *(self._label(number) for number in self._session.editor.items))

    def _label(self, number: int) -> str:
        return f"{number}: {plain(self._session.editor.label(number), 40)}"

    def _number(self, label: str) -> int | None:
        head = label.split(":", 1)[0]
        found = int(head) if head.isdigit() else None
        return found if found in self._session.editor.items else None
