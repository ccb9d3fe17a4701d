from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_motions import Motion, write_plain_csv, write_rtde_csv, write_ur_csv

from dynid.core import RecordError
from dynid.recording import open_record, read_recording, recording_name
from dynid.robot import load_robot

COLUMNS = "t=0,q=1:7,qd=7:13,current=13:19"


def codes(record) -> list[str]:
    return [problem.code for problem in record.problems]


def assert_true_to(record, motion: Motion, tolerance: float = 1e-5) -> None:
    t = record.t + float(record.metadata.extra["t0"])
    np.testing.assert_allclose(record.signals["q"], motion.position(t), atol=tolerance)
    np.testing.assert_allclose(record.signals["current"], motion.current(t), atol=0.02)


@pytest.mark.parametrize(
    ("file", "name"), [("log.csv.gz", "log"), ("day.1.csv", "day.1"), ("bag/a.db3.ZST", "a")]
)
def test_names_of_recordings_have_no_endings(file: str, name: str) -> None:
    assert recording_name(file) == name


def test_ur_log(tmp_path: Path) -> None:
    motion = Motion()
    record = read_recording(write_ur_csv(motion, tmp_path / "log.csv"), robot=load_robot("ur5"))
    assert record.metadata.format == "ur-csv"
    assert record.metadata.robot == "ur5"
    assert record.problems == ()
    assert record.samples == motion.samples
    assert record.rate_hz == pytest.approx(125)
    assert record.t[0] == 0
    assert float(record.metadata.extra["t0"]) == motion.start
    assert record.metadata.joint_names[2] == "elbow_joint"
    assert len(record.metadata.input_hash) == 64
    assert_true_to(record, motion, 1e-12)


def test_rtde_log(tmp_path: Path) -> None:
    motion = Motion()
    record = read_recording(write_rtde_csv(motion, tmp_path / "log.csv"))
    assert record.metadata.format == "ur-rtde-csv"
    assert record.problems == ()
    assert_true_to(record, motion)


def test_rtde_log_with_doubled_and_lost_rows(tmp_path: Path) -> None:
    motion = Motion(samples=1000)
    path = write_rtde_csv(motion, tmp_path / "log.csv")
    header, *rows = path.read_text().splitlines()
    rng = np.random.default_rng(1)
    kept = [row for row in rows for _ in range(int(rng.choice([0, 1, 2], p=[0.05, 0.75, 0.2])))]
    path.write_text("\n".join([header, *kept]) + "\n")
    record = read_recording(path)
    assert set(codes(record)) == {"dropped_rows", "clock_jitter"}
    assert record.samples == len(set(kept))
    assert record.metadata.dropped_rows == len(kept) - len(set(kept))
    assert_true_to(record, motion)


def test_log_with_the_stamps_of_a_pc(tmp_path: Path) -> None:
    motion = Motion(samples=2000)
    table = motion.table()
    rng = np.random.default_rng(2)
    steps = 0.008 + rng.normal(0, 0.0004, len(table))
    late = rng.random(len(table)) < 0.02
    steps[late] += 0.012
    t = 1.7e9 + np.cumsum(np.maximum(steps, 0.001))
    table = np.column_stack([t, motion.position(t), motion.velocity(t), motion.current(t)])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, delimiter=" ", header=" ".join(motion.header()), comments="")
    record = read_recording(path)
    assert codes(record) == ["clock_jitter"]
    assert record.samples == 2000
    np.testing.assert_allclose(record.t, t - t[0], atol=1e-6)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_headerless_table_by_columns(tmp_path: Path, delimiter: str) -> None:
    motion = Motion()
    path = write_plain_csv(motion, tmp_path / "x.txt", delimiter)
    record = read_recording(path, columns=COLUMNS)
    assert record.metadata.format == "csv"
    assert record.problems == ()
    assert_true_to(record, motion)
    again = read_recording(path, columns=COLUMNS, header=False, delimiter=delimiter)
    np.testing.assert_array_equal(again.signals["q"], record.signals["q"])


def test_a_word_beside_the_first_row_costs_no_row(tmp_path: Path) -> None:
    motion = Motion()
    path = write_rtde_csv(motion, tmp_path / "log.csv")
    header, first, *rest = path.read_text().splitlines()
    rows = [f"event,{header}", f"start,{first}", *(f",{row}" for row in rest)]
    path.write_text("\n".join(rows))
    record = read_recording(path)
    assert (record.samples, record.problems) == (motion.samples, ())


def test_a_damaged_first_row_of_a_headerless_table_is_told(tmp_path: Path) -> None:
    """More than half of it is no number: it is a row that is lost, not a header."""
    motion = Motion()
    q, qd, i = (f(motion.t) for f in (motion.position, motion.velocity, motion.current))
    rows = [[f"{x:.6f}" for x in row] for row in np.column_stack([motion.t, q, qd, i])]
    rows[0][2:14] = ["#$%", "---", "x@!", "??", "..", "!!", "&&", "((", "))", "4f#", "1x2", "0x"]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(map(",".join, rows)), encoding="utf-8")
    record = read_recording(path, columns=COLUMNS)
    assert (record.samples, record.metadata.dropped_rows) == (motion.samples - 1, 1)


def test_the_minus_sign_of_unicode(tmp_path: Path) -> None:
    path = write_rtde_csv(Motion(), tmp_path / "x.csv")
    plain = read_recording(path)
    path.write_text(path.read_text().replace("-", "\u2212"), encoding="utf-8")
    record = read_recording(path)
    assert (record.samples, record.problems) == (plain.samples, ())
    np.testing.assert_array_equal(record.signals["q"], plain.signals["q"])


def test_decimal_comma(tmp_path: Path) -> None:
    motion = Motion()
    path = write_plain_csv(motion, tmp_path / "x.csv", ";")
    path.write_text(path.read_text().replace(".", ","))
    assert_true_to(read_recording(path, columns=COLUMNS), motion)


@pytest.mark.parametrize(
    ("group", "decimal", "cell", "delimiter"),
    [
        (",", ".", "{}", ";"),
        (".", ",", "{}", ";"),
        ("\u00a0", ",", "{}", ";"),
        ("'", ".", "{}", "\t"),
        (",", ".", '"{}"', ","),
        ("", ",", '"{}"', ","),
    ],
)
@pytest.mark.parametrize("offset", [0.0, 900.0])
def test_thousands_and_commas_in_quotes(
    tmp_path: Path, group: str, decimal: str, cell: str, delimiter: str, offset: float
) -> None:
    """Numbers from 1000 on have separators, from the first row on or later."""
    motion = Motion(start=offset, samples=1200)
    table = motion.table() * 1.0
    table[:, 13:] *= 1e3

    def write(value: float) -> str:
        text = f"{value:,.6f}".replace(",", "_").replace(".", decimal).replace("_", group)
        return cell.format(text) if delimiter in text or offset == 0 else text

    names = [f"{name}{k}" for name in ("q", "dq", "tau") for k in range(1, 7)]
    rows = [delimiter.join(["t", *(n + " [mNm]" * n.startswith("tau") for n in names)])]
    rows += [delimiter.join(map(write, row)) for row in table]
    (tmp_path / "x.csv").write_bytes("\n".join(rows).encode("cp1252"))
    record = read_recording(tmp_path / "x.csv")
    np.testing.assert_allclose(record.t, motion.t - motion.t[0], atol=1e-6)
    np.testing.assert_allclose(record.signals["q"], table[:, 1:7], atol=1e-6)
    np.testing.assert_allclose(record.signals["effort"], table[:, 13:] / 1e3, atol=1e-6)
    assert not codes(record)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", ",\n"),
        lambda text: text.replace("\n", ",\n").replace(",\n", "\n", 1),
        lambda text: "# made by hand\n\n" + text,
        lambda text: "#" + text,
        lambda text: text.rstrip("\n"),
        lambda text: text + "\n\n",
        lambda text: text.replace(",", ", "),
        lambda text: (
            ",".join(f'"{x}"' for x in text.split("\n")[0].split(","))
            + "\n"
            + text.split("\n", 1)[1]
        ),
        lambda text: text.replace("\n", f"\ns{',rad' * 6}{',rad/s' * 6}{',A' * 6}\n", 1),
        lambda text: "Run 7 of the arm\n" + text,
    ],
    ids=[
        "crlf",
        "cr",
        "bom",
        "trailing delimiter",
        "trailing delimiter, not in the header",
        "comment",
        "commented header",
        "no last line end",
        "blank lines",
        "blanks",
        "quotes",
        "units row",
        "title",
    ],
)
def test_ways_of_writing_a_table(tmp_path: Path, change) -> None:
    motion = Motion()
    path = tmp_path / "x.csv"
    with path.open("w", newline="", encoding="utf-8") as stream:
        stream.write(change(_text(motion, tmp_path)))
    record = read_recording(path)
    assert record.problems == ()
    assert record.samples == motion.samples
    assert_true_to(record, motion)


def _text(motion: Motion, folder: Path) -> str:
    return write_rtde_csv(motion, folder / "source.csv").read_text()


def test_utf16(tmp_path: Path) -> None:
    motion = Motion()
    path = tmp_path / "x.csv"
    path.write_text(_text(motion, tmp_path), encoding="utf-16")
    assert_true_to(read_recording(path), motion)


def test_other_columns_become_channels(tmp_path: Path) -> None:
    motion = Motion(samples=100)
    header, *rows = _text(motion, tmp_path).splitlines()
    rows = [f"{row},{k % 3},RUNNING" for k, row in enumerate(rows)]
    path = tmp_path / "x.csv"
    path.write_text("\n".join([header + ",speed_scaling,state", *rows]) + "\n")
    record = read_recording(path)
    assert record.problems == ()
    assert list(record.channels) == ["speed_scaling"]
    np.testing.assert_array_equal(record.channels["speed_scaling"], np.arange(100) % 3)


def test_rate_is_the_clock_without_stamps(tmp_path: Path) -> None:
    motion = Motion()
    path = write_plain_csv(motion, tmp_path / "x.csv")
    columns = "q=1:7,qd=7:13,current=13:19"
    record = read_recording(path, columns=columns, rate_hz=125)
    assert record.metadata.clock == "rate"
    assert record.problems == ()
    np.testing.assert_allclose(record.t, motion.t - motion.start, atol=1e-9)
    with pytest.raises(RecordError, match="rate_hz"):
        read_recording(path, columns=columns)
    with pytest.raises(RecordError, match="rate must be positive"):
        read_recording(path, columns=columns, rate_hz=-1)


def test_counted_time_holds_over_broken_lines(tmp_path: Path) -> None:
    motion = Motion()
    path = write_plain_csv(motion, tmp_path / "x.csv")
    lines = path.read_text().splitlines()
    lines[50] = lines[50].replace(",", ";", 4)
    lines[100:102] = [lines[100] + lines[101]]
    lines[200] = "garbage"
    path.write_text("\n".join(lines) + "\n")
    record = read_recording(path, columns="q=1:7,qd=7:13,current=13:19", rate_hz=125)
    assert codes(record) == ["corrupt_rows"]
    assert record.metadata.dropped_rows == 4
    np.testing.assert_allclose(
        record.signals["q"], motion.position(record.t + motion.start), atol=1e-5
    )


def test_errors_name_file_line_and_column(tmp_path: Path) -> None:
    motion = Motion()
    path = write_rtde_csv(motion, tmp_path / "run.csv")
    lines = path.read_text().splitlines()
    cells = lines[41].split(",")
    cells[9] = "oops"
    lines[41] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    record = read_recording(path)
    assert codes(record) == ["corrupt_rows"]
    message = record.problems[0].message
    assert "run.csv" in message
    assert "line 42" in message
    assert "actual_qd_2" in message
    assert record.metadata.dropped_rows == 1


@pytest.mark.parametrize(
    ("samples", "step"), [(40, 3), pytest.param(500, 1, marks=pytest.mark.long)]
)
def test_last_line_cut_in_a_number(samples: int, step: int, tmp_path: Path) -> None:
    motion = Motion(samples=samples)
    text = write_ur_csv(motion, tmp_path / "x.csv").read_text()
    for cut in range(2, 200, step):
        (tmp_path / "cut.csv").write_text(text[:-cut])
        record = read_recording(tmp_path / "cut.csv")
        assert_true_to(record, motion, 1e-6)
        whole = text[:-cut].count("\n") - 1
        unclosed = not text[:-cut].endswith("\n")
        assert record.samples in (whole, whole + unclosed)
        assert (codes(record) == ["truncated_file"]) == (unclosed and record.samples == whole)


def test_files_side_by_side(tmp_path: Path) -> None:
    motion = Motion()
    table = motion.table()
    np.savetxt(tmp_path / "pos.csv", table[:, 1:7], delimiter=",", header="a,b,c,d,e,f")
    np.savetxt(tmp_path / "cur.csv", table[:, 13:], delimiter=";")
    files = [tmp_path / "pos.csv", tmp_path / "cur.csv"]
    record = read_recording(files, columns="q=0:6,current=6:12", rate_hz=125)
    assert record.problems == ()
    np.testing.assert_allclose(record.signals["current"], table[:, 13:])
    assert "pos.csv" in record.metadata.origin
    assert "cur.csv" in record.metadata.origin


def test_one_number_a_line(tmp_path: Path) -> None:
    motion = Motion()
    table = motion.table()
    files = []
    for name, part in (("t", table[:, 0]), ("q", table[:, 1:7]), ("c", table[:, 13:])):
        np.savetxt(tmp_path / f"{name}.txt", part.ravel())
        files.append(tmp_path / f"{name}.txt")
    record = read_recording(files, columns="t=0,q=1:7,current=7:13")
    assert record.problems == ()
    assert "row by row as 6 columns" in record.metadata.extra["notes"]
    np.testing.assert_allclose(record.signals["q"], table[:, 1:7])
    np.savetxt(files[1], table[:, 1:7].ravel()[:-1])
    with pytest.raises(RecordError, match="no multiple"):
        read_recording(files, columns="t=0,q=1:7,current=7:13")


@pytest.mark.parametrize("one_file_a_joint", [False, True])
def test_numbers_a_line_without_a_file_of_times(tmp_path: Path, one_file_a_joint: bool) -> None:
    """Of files as long as each other the number of joints says how long a row is."""
    motion = Motion(samples=600)
    files = []
    for name, part in (("q", motion.position(motion.t)), ("c", motion.current(motion.t))):
        for k, values in enumerate(part.T if one_file_a_joint else [part]):
            files.append(tmp_path / f"{name}{k}.txt")
            np.savetxt(files[-1], values.ravel())
    given = {"columns": "q=0:6,current=6:12", "rate_hz": motion.rate, "robot": "ur5"}
    record = read_recording(files, **given)
    np.testing.assert_allclose(record.signals["q"], motion.position(motion.t))
    np.testing.assert_allclose(record.signals["current"], motion.current(motion.t))
    lines = files[0].read_text().splitlines()
    # The sixth number of the 51st row costs its row, and is told by its line or by the row's.
    for word, line in () if one_file_a_joint else (("?", 306), ("nan", 301)):
        files[0].write_text("\n".join([*lines[:305], word, *lines[306:]]))
        record = read_recording(files, **given)
        (found,) = [one for one in record.problems if one.kind == "corrupt_rows"]
        assert (record.samples, record.metadata.dropped_rows) == (599, 1)
        assert f"line {line}" in found.text


def test_a_link_goes_by_its_own_name(tmp_path: Path) -> None:
    """Version control of data keeps files under their hashes and links to them."""
    motion = Motion()
    parts = {
        "time": motion.t[:, None],
        "positions": motion.position(motion.t),
        "currents": motion.current(motion.t),
    }
    for number, (name, values) in enumerate(parts.items()):
        np.savetxt(tmp_path / f"{number}a5f", values)
        (tmp_path / f"run_{name}.txt").symlink_to(f"{number}a5f")
    record = read_recording([tmp_path / f"run_{name}.txt" for name in parts])
    assert_true_to(record, motion)
    assert record.samples == motion.samples


def test_a_shorter_file_cuts_the_others(tmp_path: Path) -> None:
    motion = Motion()
    table = motion.table()
    np.savetxt(tmp_path / "a.csv", table[:, :7], delimiter=",")
    np.savetxt(tmp_path / "b.csv", table[:480, 13:], delimiter=",")
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    record = read_recording(files, columns="t=0,q=1:7,current=7:13")
    assert codes(record) == ["truncated_file"]
    assert record.samples == 480
    np.savetxt(tmp_path / "b.csv", table[:300, 13:], delimiter=",")
    with pytest.raises(RecordError, match="same number of rows"):
        read_recording(files, columns="t=0,q=1:7,current=7:13")


def test_joint_order(tmp_path: Path) -> None:
    motion = Motion()
    table = motion.table()
    place = [2, 1, 0, 3, 4, 5]
    shuffled = [0, *(1 + k for k in place), *(7 + k for k in place), *(13 + k for k in place)]
    path = tmp_path / "x.csv"
    np.savetxt(
        path, table[:, shuffled], delimiter=",", header=",".join(motion.header()), comments=""
    )
    robot = load_robot("ur5")
    names = [robot.joint_names[k] for k in place]
    for order in (["2", "1", "0", "3", "4", "5"], names):
        record = read_recording(path, robot=robot, joint_order=order)
        np.testing.assert_allclose(record.signals["q"], table[:, 1:7])
    for order in (["0", "1"], ["x"] * 6, ["0"] * 6):
        with pytest.raises(RecordError, match="joint order"):
            read_recording(path, robot=robot, joint_order=order)


def test_german_words(tmp_path: Path) -> None:
    motion = Motion()
    table = motion.table() * np.repeat([1, 180 / np.pi, 30 / np.pi, 1], [1, 6, 6, 6])
    names = ("Achse{} Winkel [°]", "Achse{} Drehzahl [rpm]", "Achse{} Moment [Nm]")
    header = ",".join(["t", *(name.format(k) for name in names for k in range(1, 7))])
    np.savetxt(tmp_path / "x.csv", table, delimiter=",", header=header, comments="")
    record = read_recording(tmp_path / "x.csv", robot=load_robot("ur5"))
    assert not codes(record)
    np.testing.assert_allclose(record.signals["qd"], motion.table()[:, 7:13])


def test_a_folder_of_one_file_a_joint_names_the_whole_command(tmp_path: Path) -> None:
    folder = tmp_path / "a run"
    folder.mkdir()
    for k in (1, 2):
        np.savetxt(folder / f"joint_{k}.csv", np.ones((9, 3)), delimiter=",", header="t,q,tau")
    files = " ".join(f"'{folder}/joint_{k}.csv'" for k in (1, 2))
    with pytest.raises(RecordError) as refused:
        open_record(folder, load_robot("ur5"))
    assert str(refused.value).endswith(f"dynid import {files} --robot ROBOT -o RECORD.parquet")


def test_an_order_that_is_the_files_own(tmp_path: Path) -> None:
    motion, axles = Motion(), ("c3", "c1", "c2", "c6", "c5", "c4")
    header = ",".join(
        ["t", *(f"{kind}_{axle}" for kind in ("pos", "vel", "eff") for axle in axles)]
    )
    np.savetxt(
        tmp_path / "x.csv", motion.table(), delimiter=",", header=header, comments="", fmt="%.9g"
    )
    ur5 = load_robot("ur5")
    taken = read_recording(tmp_path / "x.csv", robot=ur5)
    assert codes(taken) == ["unit_suspect"]
    record = read_recording(tmp_path / "x.csv", robot=ur5, joint_order=axles)
    assert not codes(record)
    np.testing.assert_allclose(record.signals["q"], motion.table()[:, 1:7], rtol=1e-7)


def test_number_of_joints_is_checked(tmp_path: Path) -> None:
    motion = Motion(joints=5)
    path = write_rtde_csv(motion, tmp_path / "x.csv")
    with pytest.raises(RecordError, match=r"5 joints.*ur5 has 6"):
        read_recording(path, robot=load_robot("ur5"))


def test_gains_are_stored_and_checked(tmp_path: Path) -> None:
    path = write_rtde_csv(Motion(), tmp_path / "x.csv")
    assert read_recording(path, gains=[1, 2, 3, 4, 5, 6]).metadata.drive_gains == (1, 2, 3, 4, 5, 6)
    for gains in ([1.0, 2.0], [0.0] * 6, [float("nan")] * 6, ["x"] * 6):
        with pytest.raises(RecordError):
            read_recording(path, gains=gains)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\n\n\n", "no rows"),
        (b"hello\nworld\n", "no rows"),
        (b"t,q_0,current_0\n", "no rows"),
        (b"t,q_0,current_0\n1,2,3\n", "fewer than two"),
        (b"1,2,3\n2,3,4\n", "no header"),
        (b"x" * 10_000_000, "too long"),
        (b"1," * 5_000_000, "too long"),
        (bytes(range(256)) * 50, "none of the formats"),
        (b"t,q_0,q_1,current_0\n1,2,3,4\n2,3,4,5\n", "no columns|left out|current"),
        (b"t,q_0,qd_0\n0,1,2\n1,2,3\n", "neither current nor effort"),
        (b"PK\x03\x04" + bytes(100), "zip"),
        (b"\x1f\x8b" + bytes(100), "gzip file is damaged"),
        (b"#ROSBAG V2.0\n" + bytes(100), "no message in it can be read"),
    ],
)
def test_hopeless_files_are_one_clear_error(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    with pytest.raises(RecordError, match=words) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_hopeless_paths(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no such file"):
        read_recording(tmp_path / "none.csv")
    with pytest.raises(RecordError, match="holds no recording"):
        read_recording(tmp_path)
    motion = Motion()
    path = write_rtde_csv(motion, tmp_path / "only.csv")
    assert read_recording(tmp_path).samples == motion.samples
    write_rtde_csv(motion, tmp_path / "second.csv")
    with pytest.raises(RecordError, match=r"2 files.*dynid import .*only\.csv .*second\.csv"):
        read_recording(tmp_path)
    path.unlink()
    with pytest.raises(RecordError, match="no recording was given"):
        read_recording([])


def test_wrong_extension_goes_by_content(tmp_path: Path) -> None:
    motion = Motion()
    path = write_rtde_csv(motion, tmp_path / "run.mat")
    assert_true_to(read_recording(path), motion)
    with pytest.raises(RecordError, match="content is csv, not mat"):
        read_recording(path, format="mat")
    with pytest.raises(RecordError, match="unknown format"):
        read_recording(path, format="xls")


def test_named_ur_format_needs_its_header(tmp_path: Path) -> None:
    motion = Motion()
    path = write_plain_csv(motion, tmp_path / "x.csv")
    with pytest.raises(RecordError, match="not that of a ur-csv"):
        read_recording(path, format="ur-csv", columns=COLUMNS)


def test_huge_numbers_of_columns_are_refused_quickly(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text((",".join(["1"] * 50_000) + "\n") * 20)
    with pytest.raises(RecordError, match="too many columns"):
        read_recording(path, columns="t=0,q=1:7,current=7:13")


def test_an_option_is_said_with_the_command_that_takes_it(tmp_path: Path) -> None:
    path, t = tmp_path / "log.csv", np.arange(300) / 100
    angles = 100 * np.sin(np.outer(t, np.arange(1, 7)))
    names = [f"{kind}{j + 1}" for kind in ("q", "tau") for j in range(6)]
    table = np.column_stack([t, angles, angles])
    np.savetxt(path, table, delimiter=",", header=",".join(["t", *names]), comments="")
    with pytest.raises(RecordError, match=r"pass degrees=True\. It is an option of dynid import, "):
        open_record(path, load_robot("ur5"))
    # Dashes alone are no option of ours: rtde's recorder has that one.
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"timestamp actual_q_0\nDOUBLE DOUBLE\n" + bytes(64))
    with pytest.raises(RecordError) as caught:
        open_record(binary, load_robot("ur5"))
    assert caught.value.next_step == "Record again without --binary."


def test_columns_that_cannot_be_told_apart_are_named_with_the_command_that_takes_names(
    tmp_path: Path,
) -> None:
    path = tmp_path / "currents.csv"
    names = ",".join(f"Joint_{k}" for k in range(1, 7))
    path.write_text(f"{names}\n" + "0.5,0.25,1,1,2,3\n" * 99)
    with pytest.raises(RecordError, match=r"columns.* It is an option of dynid import, "):
        open_record(path, load_robot("ur5"))


@pytest.mark.parametrize("cells", [6, 7, 10])
def test_lines_cut_short_are_a_row_each(tmp_path: Path, cells: int) -> None:
    motion, path = Motion(samples=900), tmp_path / "cut.csv"
    rows = np.hstack([motion.position(motion.t), motion.current(motion.t)])
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    for k in (*range(300, 310), *range(600, 604)):
        lines[k] = ",".join(lines[k].split(",")[:cells])
    head = ",".join(f"{name}{j}" for name in ("q", "current") for j in range(1, 7))
    path.write_text("\n".join([head, *lines]))
    record = read_recording(path, rate_hz=125.0, robot=load_robot("ur5"))
    # Where rows count time, each that is lost would shift all that follow.
    assert record.t[-1] == pytest.approx(899 / 125)
    assert [problem.code for problem in record.problems] == ["corrupt_rows"]
    assert record.problems[0].message.startswith("14 of 900 rows")


def test_some_lines_may_end_with_a_delimiter(tmp_path: Path) -> None:
    motion, path = Motion(samples=900), tmp_path / "x.csv"
    head, *lines = write_rtde_csv(motion, path).read_text().splitlines()
    comma = "," if "," in head else " "
    plain = read_recording(path)
    path.write_text("\n".join([head, *(x + comma * (k % 2) for k, x in enumerate(lines)), ""]))
    record = read_recording(path)
    assert record.problems == ()
    np.testing.assert_array_equal(record.signals["q"], plain.signals["q"])
