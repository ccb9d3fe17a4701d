"""One motion as a file of every kind that is read, and with every damage that is repaired."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import scipy.io
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

import dynid

ROWS, RATE = 700, 125.0
JOINTS = dynid.load_robot("ur5").joint_names
T = 10.0 + np.arange(ROWS) / RATE
_PHASE = 2 * np.pi * 0.3 * T[:, None] * [1, 1, 2, 1, 2, 3] + np.arange(6)
Q = 0.5 * np.sin(_PHASE) + [0.3, -1.2, 1.4, -0.5, -1.5, 0.2]
QD = 0.5 * 2 * np.pi * 0.3 * np.cos(_PHASE) * [1, 1, 2, 1, 2, 3]
# Rough as measured currents are, and the same in every file.
CURRENT = np.cos(Q) + 0.4 * np.tanh(20 * QD) + 0.05 * np.sin(4321.7 * T[:, None] + np.arange(6))
NAMES = ["timestamp", *(f"actual_{s}_{j}" for s in ("q", "qd", "current") for j in range(6))]
TABLE = np.column_stack([T, Q, QD, CURRENT])
ARRAYS = {"t": T, "q": Q, "qd": QD, "current": CURRENT}

Writer = Callable[[Path], "str | None"]
"""Writes into a folder; returns the option `columns`, if one is needed."""


def text_of(table: np.ndarray = TABLE, names: list[str] | None = NAMES, comma: str = ",") -> str:
    """A text table."""
    lines = [comma.join(names)] if names else []
    lines += [comma.join(f"{x:.9g}" for x in row) for row in table]
    return "\n".join(lines) + "\n"


def _file(name: str, content: Callable[[], bytes], columns: str | None = None) -> Writer:
    def write(folder: Path) -> str | None:
        (folder / name).write_bytes(content())
        return columns

    return write


def _packed(name: str, pack: Callable[[bytes], bytes]) -> Writer:
    return _file(name, lambda: pack(text_of().encode()))


def _zipped(data: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("run.csv", data)
    return out.getvalue()


def _zstd(data: bytes) -> bytes:
    return pa.Codec("zstd").compress(data, asbytes=True)


def _binary(save: Callable[[io.BytesIO], Any]) -> Callable[[], bytes]:
    def content() -> bytes:
        out = io.BytesIO()
        save(out)
        return out.getvalue()

    return content


def _columns() -> dict[str, np.ndarray]:
    return dict(zip(NAMES, TABLE.T, strict=True))


def _structured() -> np.ndarray:
    kinds = [(name, "f8", value.shape[1:]) for name, value in ARRAYS.items()]
    rows = np.zeros(ROWS, dtype=kinds)
    for name, value in ARRAYS.items():
        rows[name] = value
    return rows


def _hdf5(folder: Path) -> None:
    import h5py

    with h5py.File(folder / "run.h5", "w") as file:
        for name, value in ARRAYS.items():
            file[f"log/{name}"] = value


def _excel(folder: Path) -> None:
    def cell(value: object) -> str:
        if isinstance(value, str):
            return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
        return f"<c><v>{value:.9g}</v></c>"

    rows = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in [NAMES, *TABLE.tolist()])
    office = "http://schemas.openxmlformats.org"
    main, relations = f"{office}/spreadsheetml/2006/main", f"{office}/package/2006/relationships"
    kind = f"{office}/officeDocument/2006/relationships"
    types = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{office}/package/2006/content-types">'
        '<Default Extension="xml" ContentType="application/xml"/><Default Extension="rels" '
        'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        f'<Override PartName="/xl/workbook.xml" ContentType="{types}.sheet.main+xml"/>'
        f'<Override PartName="/xl/worksheets/sheet1.xml" ContentType="{types}.worksheet+xml"/>'
        "</Types>",
        "_rels/.rels": f'<Relationships xmlns="{relations}"><Relationship Id="rId1" '
        f'Type="{kind}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{kind}"><sheets>'
        '<sheet name="run" sheetId="1" r:id="rId1"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{relations}"><Relationship '
        f'Id="rId1" Type="{kind}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
        "xl/worksheets/sheet1.xml": f'<worksheet xmlns="{main}"><sheetData>{rows}</sheetData>'
        "</worksheet>",
    }
    with zipfile.ZipFile(folder / "run.xlsx", "w") as archive:
        for name, text in parts.items():
            archive.writestr(name, text)


def _bag(folder: Path, kind: str) -> None:
    """A bag of joint states as the rosbags library writes it."""
    ros1 = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    message = "sensor_msgs/msg/JointState"
    state, header, time = (
        store.types[name]
        for name in (message, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    if ros1:
        writer: Any = Ros1Writer(folder / "run.bag")
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Ros2Writer(folder / "bag", version=8, storage_plugin=plugin)
    pack = store.serialize_ros1 if ros1 else store.serialize_cdr
    with writer:
        topic = writer.add_connection("/joint_states", message, typestore=store)
        for k, stamp in enumerate(np.round(T * 1e9).astype(int).tolist()):
            sequence = {"seq": k} if ros1 else {}
            head = header(stamp=time(stamp // 10**9, stamp % 10**9), frame_id="", **sequence)
            row = state(head, list(JOINTS), Q[k], QD[k], CURRENT[k])
            writer.write(topic, stamp, pack(row, message))


def _own(folder: Path) -> None:
    source = folder / "source.csv"
    source.write_text(text_of())
    dynid.write_record(dynid.read_recording(source), folder / "run.parquet")
    source.unlink()


def _one_a_signal(folder: Path) -> None:
    for name, values in (("time", T), ("positions", Q), ("velocities", QD), ("currents", CURRENT)):
        np.savetxt(folder / f"run_{name}.txt", values, fmt="%.9g")


def _foreign(folder: Path, name: str) -> None:
    table = pa.table(_columns())
    if name.endswith("parquet"):
        pa.parquet.write_table(table, folder / name)
    else:
        pa.feather.write_feather(table, folder / name)


def _listed(folder: Path) -> None:
    lines = ["time;position;velocity;effort"]
    for k in range(ROWS):
        cells = ['"[' + ", ".join(f"{x:.9g}" for x in v[k]) + ']"' for v in (Q, QD, CURRENT)]
        lines.append(";".join([f"{T[k]:.9g}", *cells]))
    (folder / "echo.csv").write_text("\n".join(lines) + "\n")


BY_PATH = "t=rec.time,q=rec.q,qd=rec.qd,current=rec.current"
BY_NUMBER = "t=0,q=1:7,qd=7:13,current=13:19"
_REC = {"rec": {"time": T, "q": Q, "qd": QD, "current": CURRENT}}
FORMATS: dict[str, Writer] = {
    "ur record.py": _file("run.csv", lambda: text_of(comma=" ").encode()),
    "ur_rtde csv": _file("run.csv", lambda: text_of().encode()),
    "csv without header": _file("run.csv", lambda: text_of(names=None).encode(), BY_NUMBER),
    "csv decimal comma": _file(
        "run.csv", lambda: text_of(comma=";").replace(".", ",").encode("cp1252")
    ),
    "csv utf-16": _file("run.csv", lambda: text_of(comma="\t").encode("utf-16")),
    "csv lists in cells": _listed,
    "csv one file a signal": _one_a_signal,
    "excel": _excel,
    "ros 2 db3": lambda folder: _bag(folder, "db3"),
    "ros 2 mcap": lambda folder: _bag(folder, "mcap"),
    "ros 1 bag": lambda folder: _bag(folder, "bag"),
    "matlab 5": _file("run.mat", _binary(lambda out: scipy.io.savemat(out, _REC)), BY_PATH),
    "npz": _file("run.npz", _binary(lambda out: np.savez(out, **ARRAYS))),
    "npy": _file("run.npy", _binary(lambda out: np.save(out, _structured()))),
    "hdf5": _hdf5,
    "json": _file(
        "run.json", lambda: json.dumps({k: v.tolist() for k, v in ARRAYS.items()}).encode()
    ),
    "json lines": _file(
        "run.jsonl",
        lambda: "\n".join(
            json.dumps({k: v[i].tolist() for k, v in ARRAYS.items()}) for i in range(ROWS)
        ).encode(),
    ),
    "parquet": _own,
    "foreign parquet": lambda folder: _foreign(folder, "run.parquet"),
    "arrow": lambda folder: _foreign(folder, "run.feather"),
    "gz": _packed("run.csv.gz", gzip.compress),
    "bz2": _packed("run.csv.bz2", bz2.compress),
    "xz": _packed("run.csv.xz", lzma.compress),
    "zst": _packed("run.csv.zst", _zstd),
    "zip": _packed("run.zip", _zipped),
}
"""What is read -> how to write it; the written file holds the motion above."""


@dataclass(frozen=True)
class Damage:
    """A damaged table, and what a reader makes of it."""

    table: np.ndarray
    code: str | None
    """The code of the finding; None: it is mended and told in the notes, or not at all."""
    rows: int = ROWS
    """Rows that are left."""
    names: list[str] | None = None
    tolerance: float = 1e-6
    """Of positions, where all rows are left [rad]."""
    cut: int = 0
    """Bytes that the end of the file has lost."""
    settings: tuple[tuple[str, Any], ...] = ()


def _changed(rows: Any, columns: Any, value: Any) -> np.ndarray:
    table = TABLE.copy()
    table[rows, columns] = value
    return table


def _scaled(columns: slice, factor: float) -> np.ndarray:
    table = TABLE.copy()
    table[:, columns] *= factor
    return table


def _wrapped() -> np.ndarray:
    """The second axis is cut where it passes -1.2 rad."""
    table = TABLE.copy()
    table[:, 2] = (table[:, 2] + 1.2) % (2 * np.pi) - 1.2
    return table


def _rested() -> np.ndarray:
    rng = np.random.default_rng(1)
    still = np.repeat(TABLE[:1], 2000 - ROWS, axis=0)
    still[:, 1:7] += 1e-6 * rng.standard_normal((len(still), 6))
    still[:, 7:13] = 1e-5 * rng.standard_normal((len(still), 6))
    still[:, 13:] += 1e-3 * rng.standard_normal((len(still), 6))
    table = np.vstack([still, TABLE])
    table[:, 0] = 10.0 + np.arange(2000) / RATE
    return table


def _interleaved() -> np.ndarray:
    motion, torque = TABLE.copy(), TABLE.copy()
    motion[:, 13:], torque[:, 1:13] = np.nan, np.nan
    torque[:, 0] += 0.001
    return np.stack([motion, torque], axis=1).reshape(-1, TABLE.shape[1])


_OTHER_RUN = np.column_stack([T, Q[::-1], -QD[::-1], CURRENT[::-1]])


def _clock(change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    return np.column_stack([change(T), TABLE[:, 1:]])


def _stepped(at: int, by: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: np.where(np.arange(ROWS) < at, t, t + by)


_DEGREES = [n.replace("actual_q_", "q_deg_") for n in NAMES]
REPAIRS: dict[str, Damage] = {
    "nan row": Damage(_changed(200, 5, np.nan), "corrupt_rows", ROWS - 1),
    "infinite value": Damage(_changed(200, 5, np.inf), "corrupt_rows", ROWS - 1),
    "repeated row": Damage(np.insert(TABLE, 300, TABLE[300], axis=0), "dropped_rows"),
    "repeated stamp": Damage(_changed(300, 0, T[299]), "dropped_rows", ROWS - 1),
    "milliseconds": Damage(_scaled(slice(0, 1), 1e3), "unit_suspect"),
    "coarse stamps": Damage(_clock(lambda t: np.round(t, 2)), "clock_jitter"),
    "clock set in motion": Damage(_clock(_stepped(350, 3600.0)), "clock_mismatch"),
    "two runs": Damage(np.vstack([TABLE, _OTHER_RUN]), "clock_mismatch", 2 * ROWS),
    "torques on rows of their own": Damage(_interleaved(), "clock_mismatch", ROWS - 1),
    "pause": Damage(TABLE[np.r_[0:300, 400:ROWS]], "clock_jitter", ROWS - 100),
    "degrees in the header": Damage(
        _scaled(slice(1, 7), 180 / np.pi), None, names=_DEGREES, tolerance=1e-5
    ),
    "degrees as an option": Damage(
        _scaled(slice(1, 13), 180 / np.pi), None, tolerance=1e-5, settings=(("degrees", True),)
    ),
    "velocities in degrees": Damage(_scaled(slice(7, 13), 180 / np.pi), "unit_suspect"),
    "whole turns": Damage(_wrapped(), "unit_suspect"),
    "spike": Damage(_changed(250, 2, 40.0), "corrupt_rows", ROWS - 1),
    "burst": Damage(_changed(slice(250, 256), slice(1, 7), 77.0), "corrupt_rows", ROWS - 6),
    "zeros": Damage(_changed(slice(400, 420), slice(1, 19), 0.0), "corrupt_rows", ROWS - 20),
    "placeholder": Damage(_changed(slice(400, 420), 15, -9999.0), "corrupt_rows", ROWS - 20),
    "held positions": Damage(
        _changed(slice(400, 440), slice(1, 13), TABLE[400, 1:13]), "corrupt_rows", ROWS - 39
    ),
    "held torque": Damage(_changed(slice(400, 460), 16, TABLE[400, 16]), "corrupt_rows", ROWS - 59),
    "saturated torque": Damage(
        np.column_stack([TABLE[:, :13], np.clip(CURRENT, -9, 0.6)]), "saturated"
    ),
    "dead torque": Damage(_changed(slice(None), 15, 0.25), "dead_channel"),
    "standstill": Damage(_rested(), "at_rest", 2000),
    "cut line": Damage(TABLE, "truncated_file", ROWS - 1, cut=40),
    "wrong rate of the clock": Damage(_clock(lambda t: 2 * t), "clock_mismatch"),
    "velocities of another joint": Damage(
        TABLE[:, [0, *range(1, 7), 12, *range(8, 12), 7, *range(13, 19)]], "unit_suspect"
    ),
}
"""What is repaired or reported -> the damage."""
