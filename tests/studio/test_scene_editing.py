from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.constraints import scene_from_json
from dynid.core import InputError, JsonFields, load_object
from dynid.robot import from_xyz_rpy
from dynid.studio.scene_editing import DIMENSIONS, KINDS, SceneEditor

ROUNDED = 2e-4
"""Files keep a tenth of a millimetre, and of a milliradian."""


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_can_be_added_moved_sized_saved_and_read_again(
    kind: str, tmp_path: Path
) -> None:
    editor = SceneEditor()
    number = editor.add(kind)
    place = from_xyz_rpy([0.4, -0.3, 0.2], [0.0, 0.0, 0.5])
    editor.place(number, place)
    for name in DIMENSIONS[kind]:
        editor.resize(number, name, 0.25)
    assert editor.sizes(number) == dict.fromkeys(DIMENSIONS[kind], 0.25)
    path = tmp_path / "scene.json"
    editor.save(path)
    again = SceneEditor(load_object(path).values)
    assert again.to_json() == editor.to_json()
    (shape,) = scene_from_json(load_object(path)).shapes
    np.testing.assert_allclose(shape.pose, editor.shape(number).pose, rtol=0, atol=0)
    held = again.pose(1)
    expected = [0.0, 0.0, 0.2] if kind == "floor" else [0.4, -0.3, 0.2]
    np.testing.assert_allclose(held[:3, 3], expected, rtol=0, atol=ROUNDED)


angles = st.floats(-3.1, 3.1)


@given(roll=angles, pitch=st.floats(-1.5, 1.5), yaw=angles)
def test_a_dragged_box_is_written_where_it_is(roll: float, pitch: float, yaw: float) -> None:
    editor = SceneEditor()
    number = editor.add("box")
    pose = from_xyz_rpy([0.1, 0.2, 0.3], [roll, pitch, yaw])
    editor.place(number, pose)
    np.testing.assert_allclose(editor.pose(number), pose, rtol=0, atol=ROUNDED)


@given(roll=angles, pitch=angles)
def test_a_turned_wall_keeps_its_free_side(roll: float, pitch: float) -> None:
    editor = SceneEditor()
    number = editor.add("wall")
    pose = from_xyz_rpy([0.5, 0.0, 0.0], [roll, pitch, 0.0])
    editor.place(number, pose)
    np.testing.assert_allclose(editor.pose(number)[:3, 2], pose[:3, 2], rtol=0, atol=ROUNDED)


def test_what_the_flange_carries_is_kept() -> None:
    payload = [{"type": "sphere", "radius": 0.05, "position": [0, 0, 0.1]}]
    editor = SceneEditor({"payload": payload})
    editor.add("floor")
    assert editor.to_json()["payload"] == payload
    assert len(scene_from_json(JsonFields(editor.to_json())).payload) == 1


def test_numbers_are_never_used_again() -> None:
    editor = SceneEditor({"shapes": [{"type": "floor"}]})
    second = editor.add("box")
    editor.remove(second)
    assert editor.add("box") == second + 1
    with pytest.raises(InputError, match="no such shape"):
        editor.place(second, np.eye(4))


def test_wrong_sizes_change_nothing() -> None:
    editor = SceneEditor()
    number = editor.add("box")
    before, changes = editor.to_json(), editor.changes
    for value in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError):
            editor.resize(number, "size x", value)
    with pytest.raises(InputError):
        editor.resize(number, "radius", 0.1)
    with pytest.raises(InputError):
        editor.add("teapot")
    assert (editor.to_json(), editor.changes) == (before, changes)


def test_the_given_document_is_not_changed(tmp_path: Path) -> None:
    document = {"shapes": [{"type": "box", "size": [1, 1, 1], "position": [2, 0, 0]}]}
    text = json.dumps(document)
    editor = SceneEditor(document)
    editor.resize(1, "size x", 0.5)
    editor.items[1]["size"][0] = 9
    assert json.dumps(document) == text
    assert editor.sizes(1)["size x"] == 0.5


def test_a_place_that_cannot_be_changes_nothing() -> None:
    editor = SceneEditor()
    number = editor.add("box")
    before, changes = editor.items, editor.changes
    far = np.eye(4)
    far[0, 3] = 700.0
    with pytest.raises(InputError):
        editor.place(number, far)
    assert (editor.items, editor.changes) == (before, changes)
