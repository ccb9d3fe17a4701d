"""Files of less than 20 MB that claim, unpack to or nest far more than they hold.

Each maker writes one file and returns its path; `MAKERS` names them. Readers must end within their
budget with one clear message.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

Maker = Callable[[Path], Path]
MAKERS: dict[str, Maker] = {}
MB = 1 << 20
HEADER = b"t," + b",".join(b"q%d,tau%d" % (k, k) for k in range(6)) + b"\n"


def maker(name: str) -> Callable[[Maker], Maker]:
    def add(function: Maker) -> Maker:
        MAKERS[name] = function
        return function

    return add


def blob(name: str, content: Callable[[], bytes]) -> None:
    """A file whose bytes are made in one go."""

    def write(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content())
        return path

    MAKERS[name] = write


def zeros(count: int) -> bytes:
    return bytes(count)


# Text tables.
blob("zeros.csv", lambda: HEADER + b"0,0,0,0,0,0,0,0,0,0,0,0,0\n" * (19 * MB // 26))
blob("one_line.csv", lambda: b"1," * (9 * MB))
blob("empty_lines.csv", lambda: HEADER + b"\n" * (19 * MB))
blob("single_digits.csv", lambda: b"1\n" * (9 * MB))
blob("wide.csv", lambda: (b",".join(b"q%d" % k for k in range(4900)) + b"\n") + b"1," * 9 * MB)
blob("brackets.csv", lambda: HEADER + (b"[" * 5000 + b"\n") * 3000)
blob("open_lists.csv", lambda: (b"(1, 2, [3, " * 60 + b"\n") * 20_000)
blob("quotes.csv", lambda: HEADER + b'"' * (15 * MB))
blob("long_numbers.csv", lambda: HEADER + (b"1" * 500_000 + b",") * 30)
blob("huge_numbers.csv", lambda: HEADER + b",".join([b"1e308"] * 13) + b"\n" * 2 + b"1e400," * MB)
blob("broken_rows.csv", lambda: HEADER + (b"1,2,3\n" + b"0" + b",1" * 12 + b"\n") * (600_000))
blob("words.csv", lambda: b"a,b\n" * (4 * MB))
blob("same_stamps.csv", lambda: HEADER + b"5,1,2,3,4,5,6,7,8,9,8,7,6\n" * 700_000)
blob("long_header.csv", lambda: b",".join([b"joint_position_" * 40] * 1500) + b"\n1,2\n" * 99)


@maker("shuffled_time.csv")
def _shuffled(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    t = rng.permutation(600_000)
    rows = "\n".join(f"{k},{k % 7}.5,{k % 5}.25" for k in t.tolist())
    (folder / "shuffled_time.csv").write_text(f"t,q1,tau1\n{rows}\n")
    return folder / "shuffled_time.csv"


# Packed: members one after the other, each of 64 MB of zeros.
blob("zeros.csv.gz", lambda: gzip.compress(zeros(64 * MB), 9) * 100)
blob("zeros.csv.bz2", lambda: bz2.compress(zeros(16 * MB)) * 4000)
blob("zeros.csv.xz", lambda: lzma.compress(zeros(64 * MB), preset=0) * 500)
blob("rows.csv.gz", lambda: gzip.compress(HEADER + b"0,1,2,3,4,5,6,7,8,9,8,7,6\n" * 12_000_000, 1))


@maker("zeros.csv.zst")
def _zst(folder: Path) -> Path:
    from backports import zstd

    (folder / "zeros.csv.zst").write_bytes(zstd.compress(zeros(64 * MB)) * 3000)
    return folder / "zeros.csv.zst"


def archive(name: str, members: Callable[[zipfile.ZipFile], None]) -> None:
    def write(folder: Path) -> Path:
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as file:
            members(file)
        return folder / name

    MAKERS[name] = write


def _sheet(cells: Callable[[], bytes]) -> Callable[[zipfile.ZipFile], None]:
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006/relationships"
    space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'

    def link(kind: str, target: str) -> str:
        inner = f'<Relationship Id="r" Type="{office}/{kind}" Target="{target}"/>'
        return f'<Relationships xmlns="{package}">{inner}</Relationships>'

    def write(file: zipfile.ZipFile) -> None:
        file.writestr("_rels/.rels", link("officeDocument", "xl/workbook.xml"))
        file.writestr("xl/_rels/workbook.xml.rels", link("worksheet", "worksheets/s.xml"))
        sheet = '<sheets><sheet name="a" sheetId="1" r:id="r"/></sheets>'
        book = f'<workbook {space} xmlns:r="{office}">{sheet}</workbook>'
        file.writestr("xl/workbook.xml", book)
        body = f"<worksheet {space}><sheetData>".encode() + cells()
        file.writestr("xl/worksheets/s.xml", body + b"</sheetData></worksheet>")

    return write


def _cell(place: bytes) -> bytes:
    return b'<row r="%s"><c r="%s"><v>1</v></c></row>' % (place.lstrip(b"AXFD"), place)


archive("corners.xlsx", _sheet(lambda: _cell(b"A1") + _cell(b"XFD1048576")))
archive("rows.xlsx", _sheet(lambda: b"<row><c><v>1</v></c><c><v>2</v></c></row>" * 6_000_000))
archive("spaces.xlsx", _sheet(lambda: b" " * (700 * MB)))
archive("zeros.zip", lambda file: file.writestr("a.csv", zeros(700 * MB)))
archive("members.zip", lambda file: [file.writestr(f"{k}", "") for k in range(100_000)] and None)


# NumPy.
def npy(shape: object, kind: str = "<f8", data: bytes = b"") -> bytes:
    head = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode()
    head += b" " * (-(10 + len(head) + 1) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + data


blob("claims.npy", lambda: npy((10**9, 6)))
blob("negative.npy", lambda: npy((-5, 6)))
blob("objects.npy", lambda: npy((3,), "|O", b"cos\nsystem\n(S'true'\ntR."))
blob("bytes.npy", lambda: npy((19 * MB,), "|i1", zeros(19 * MB)))
archive("zeros.npz", lambda file: file.writestr("q.npy", npy((80 * MB,), "<f8") + zeros(640 * MB)))
archive(
    "wide.npz",
    lambda file: file.writestr("q.npy", npy((200 * MB, 1), "|i1") + zeros(200 * MB)),
)
archive(
    "many.npz",
    lambda file: (
        [file.writestr(f"a{k}.npy", npy((1,), data=zeros(8))) for k in range(60_000)] and None
    ),
)


# MATLAB.
def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(name: bytes, rows: int, columns: int, data: bytes, kind: int = 1) -> bytes:
    parts = element(6, struct.pack("<II", 9 if kind == 1 else 6, 0))
    parts += element(5, struct.pack("<ii", rows, columns)) + element(1, name) + element(kind, data)
    return element(14, parts)


MAT = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
blob("wide.mat", lambda: MAT + matrix(b"q", 18 * MB, 1, zeros(18 * MB)))
blob("claims.mat", lambda: MAT + matrix(b"q", 1 << 30, 6, zeros(64), 9))
blob(
    "zeros.mat",
    lambda: MAT + element(15, zlib.compress(matrix(b"q", 300 * MB, 1, zeros(300 * MB)))),
)
blob("many.mat", lambda: MAT + b"".join(matrix(b"v%d" % k, 1, 1, b"\x01") for k in range(150_000)))
blob(
    "repeated.mat",
    lambda: MAT + element(15, zlib.compress(matrix(b"q", 200 * MB, 1, zeros(200 * MB)))) * 30,
)

# JSON.
blob("deep.json", lambda: b'{"q":' + b"[" * (9 * MB))
blob("lists.json", lambda: b'{"q":[' + b"[]," * (6 * MB) + b"[]]}")
blob("objects.json", lambda: b"[" + b'{"a":0},' * (2 * MB) + b'{"a":0}]')
blob("twice.json", lambda: b'{"t":[1,2],"q":[1,2],"tau":[1,2],"q":[3,4]}')
blob("digits.json", lambda: b'{"q":[' + b"1" * (15 * MB) + b"]}")
blob("lines.json", lambda: b'{"q":1}\n' * (2 * MB))
blob("numbers.json", lambda: b'{"t":[' + b"0," * (9 * MB) + b"0]}")


# HDF5, Parquet, Arrow.
def hdf5(name: str, fill: Callable[[object], None]) -> None:
    def write(folder: Path) -> Path:
        import h5py

        with h5py.File(folder / name, "w") as file:
            fill(file)
        return folder / name

    MAKERS[name] = write


def _groups(file) -> None:
    group = file
    for k in range(3000):
        group = group.create_group(f"g{k % 3}")


def _loop(file) -> None:
    import h5py

    file["a"] = h5py.SoftLink("/a")
    group = file.create_group("g")
    group["h"] = group


def _external(file) -> None:
    file.create_dataset("q", (1000, 6), "f8", external=[("/etc/passwd", 0, 48_000)])


def _virtual(file) -> None:
    import h5py

    layout = h5py.VirtualLayout((10**9,), "f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "q", (10**9,))
    file.create_virtual_dataset("q", layout)


def _linked(file) -> None:
    import h5py

    file["q"] = h5py.ExternalLink("/tmp/other.h5", "/q")


def _zeros(file) -> None:
    for k in range(12):
        file.create_dataset(f"a{k}", (5 * MB,), "f8", compression="gzip", data=np.zeros(5 * MB))


hdf5("claims.h5", lambda file: file.create_dataset("q", (10**9, 6), "f8", chunks=(1024, 6)))
hdf5("chunk.h5", lambda file: file.create_dataset("q", (10**8,), "i1", chunks=(10**8,)))
hdf5(
    "fields.h5",
    lambda file: file.create_dataset("q", (10**7,), [(f"f{k}", "f8") for k in range(99)]),
)
hdf5("groups.h5", _groups)
hdf5("loop.h5", _loop)
hdf5("external.h5", _external)
hdf5("virtual.h5", _virtual)
hdf5("linked.h5", _linked)
hdf5("zeros.h5", _zeros)
hdf5(
    "many.h5", lambda file: [file.create_dataset(f"d{k}", data=0.0) for k in range(15_000)] and None
)


def parquet(name: str, rows: int, columns: int, own: bool = False) -> None:
    def write(folder: Path) -> Path:
        import pyarrow as pa
        from pyarrow import parquet as pq

        names = [f"q_{k}" for k in range(columns)]
        schema = pa.schema([(x, pa.float64()) for x in names])
        if own:
            schema = schema.with_metadata({b"dynid": b'{"schema": 1}'})
        block = pa.table([pa.array(np.zeros(rows))] * columns, schema=schema)
        with pq.ParquetWriter(folder / name, schema, compression="zstd") as writer:
            for _ in range(max(1, 100_000_000 // rows // columns)):
                writer.write_table(block)
        return folder / name

    MAKERS[name] = write


parquet("rows.parquet", 10_000_000, 2)
parquet("columns.parquet", 2_000, 5_000)
parquet("own.parquet", 10_000_000, 2, own=True)


@maker("zeros.feather")
def _feather(folder: Path) -> Path:
    import pyarrow as pa
    from pyarrow import feather

    table = pa.table({"q": np.zeros(150_000_000)})
    feather.write_feather(table, folder / "zeros.feather", compression="zstd")
    return folder / "zeros.feather"


# Bags.
def bag(name: str, *statements: str) -> None:
    def write(folder: Path) -> Path:
        database = sqlite3.connect(folder / name)
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type)")
        kind = "sensor_msgs/msg/JointState"
        database.execute("INSERT INTO topics VALUES (1, '/joint_states', ?)", (kind,))
        for statement in statements:
            database.execute(statement)
        database.commit()
        database.close()
        return folder / name

    MAKERS[name] = write


COUNT = "WITH RECURSIVE c(k) AS (SELECT 0 UNION ALL SELECT k + 1 FROM c) "
PLAIN = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)"
bag("view.db3", f"CREATE VIEW messages AS {COUNT}SELECT k AS id, 1 AS topic_id, k AS timestamp, "
    "zeroblob(100) AS data FROM c")  # fmt: skip
bag("topics.db3", PLAIN, "DROP TABLE topics", f"CREATE VIEW topics AS {COUNT}SELECT k AS id, "
    "'/a' || k AS name, 'x' AS type FROM c")  # fmt: skip
bag("computed.db3", "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data BLOB "
    "GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL)",
    "INSERT INTO messages(topic_id, timestamp) VALUES (1, 1), (1, 2)")  # fmt: skip
bag("blobs.db3", PLAIN, "INSERT INTO messages VALUES (1, 1, 1, zeroblob(18000000))")
bag("garbage.db3", PLAIN, "INSERT INTO messages WITH RECURSIVE c(k) AS (SELECT 1 UNION ALL SELECT "
    "k + 1 FROM c WHERE k < 300000) SELECT k, 1, k, zeroblob(24) FROM c")  # fmt: skip


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def mcap(name: str, make: Callable[[], bytes], definition: str = "") -> None:
    def write() -> bytes:
        schema = struct.pack("<H", 1) + text(
            "x_msgs/msg/X" if definition else "sensor_msgs/JointState"
        )
        channel = struct.pack("<HH", 1, 1) + text("/a") + text("cdr") + struct.pack("<I", 0)
        return (
            b"\x89MCAP0\r\n"
            + b"".join(
                struct.pack("<BQ", code, len(data)) + data
                for code, data in (
                    (1, text("ros2") + text("x")),
                    (3, schema + text("ros2msg") + text(definition)),
                    (4, channel),
                )
            )
            + make()
        )

    blob(name, write)


def chunk(size: int, data: bytes, method: str) -> bytes:
    body = struct.pack("<QQQI", 0, 1, size, 0) + text(method) + struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", 6, len(body)) + body


def _zstd_zeros(size: int) -> bytes:
    from backports import zstd

    return zstd.compress(zeros(size))


def _message(data: bytes) -> bytes:
    body = struct.pack("<HIQQ", 1, 0, 5, 5) + data
    return struct.pack("<BQ", 5, len(body)) + body


mcap("zeros.mcap", lambda: chunk(250 * MB, _zstd_zeros(250 * MB), "zstd") * 20)
mcap("lies.mcap", lambda: chunk(10, _zstd_zeros(250 * MB), "zstd") * 20)
mcap("claims.mcap", lambda: struct.pack("<BQ", 6, 1 << 60) + bytes(100))
mcap("tiny.mcap", lambda: chunk(0, b"", "") * 250_000)
mcap("garbage.mcap", lambda: _message(bytes([0, 1, 0, 0]) + b"\xff" * 40) * 200_000)
mcap("definition.mcap", lambda: _message(bytes(64)), "float64 q\n" * 100_000)
mcap("recursive.mcap", lambda: _message(bytes(64)), "X x\nfloat64 q\n")
mcap("empty_items.mcap", lambda: _message(b"\x00\x01\x00\x00" + b"\xff" * 4 + bytes(60)),
     "E[] items\nfloat64 q\n" + "=" * 80 + "\nMSG: x_msgs/E\n")  # fmt: skip


def ros1(name: str, make: Callable[[], bytes]) -> None:
    blob(name, lambda: b"#ROSBAG V2.0\n" + make())


def record(fields: dict[bytes, bytes], data: bytes) -> bytes:
    head = b"".join(
        struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in fields.items()
    )
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def _bz2_chunk(size: int, data: bytes) -> bytes:
    return record({b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", size)}, data)


ros1("zeros.bag", lambda: _bz2_chunk(200 * MB, bz2.compress(zeros(200 * MB))) * 30)
ros1("claims.bag", lambda: _bz2_chunk(0xFFFFFFFF, b"") * 1000)
ros1("fields.bag", lambda: record({b"op": b"\x02"}, b"") * 500_000)

# What is no recording: formats that are refused, archives in archives.
archive("nested.zip", lambda file: file.writestr("a.zip", zeros(500 * MB)))
blob("noise.bin", lambda: np.random.default_rng(0).bytes(15 * MB))
blob("pickle.pkl", lambda: b"\x80\x04" + b"(" * (10 * MB))


# Documents that are no recordings: `documents` tells with which reader.
DOCUMENTS: dict[str, bytes] = {
    "dotted.toml": b"a." * 50_000 + b"a = 1\n",
    "dotted_table.toml": b"[" + b"a." * 50_000 + b"a]\n",
    "deep.toml": b"a = " + b"[" * 400_000,
    "deep_scene.json": b'{"boxes":' + b"[" * 500_000,
    "twice_scene.json": b'{"boxes": [], "boxes": []}',
    "laughs.urdf": b'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + b"".join(
        b'<!ENTITY a%d "%s">' % (k, b"&a%s;" % (b"%d" % (k - 1) if k else b"") * 10)
        for k in range(12)
    )
    + b"]><robot>&a11;</robot>",
}


GOOD_ROWS = 140_000


def good_table(path: Path, rows: int = GOOD_ROWS) -> Path:
    """An honest CSV of about 19 MB, which must be read."""
    rng = np.random.default_rng(1)
    t = np.arange(rows) / 500
    q = np.sin(0.3 * t[:, None] + np.arange(6))
    table = np.column_stack([t, q, rng.normal(size=(rows, 6))])
    buffer = io.StringIO()
    np.savetxt(buffer, table, delimiter=",", fmt="%.7f")
    names = ["t", *(f"q{k}" for k in range(6)), *(f"tau{k}" for k in range(6))]
    path.write_text(",".join(names) + "\n" + buffer.getvalue())
    return path
