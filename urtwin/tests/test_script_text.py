"""Whole programs are found in a stream of text, however it is cut, within bounded memory."""

import contextlib
import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from urtwin.server.clients import Pool, ScriptReader, ScriptRefused

PROGRAM = """def prog():
  # end of "comment' with words: if while def
  global x = "end # no comment"
  while True:
    if x == 1: y = 2 end
    thread inner():
      defend = 'end'
    end
  end
end
"""
LINES = ["movej([0,0,0,0,0,0])\n", 'sec quick():\n textmsg("hi")\nend\n', "if a: b() end\n"]


@given(cuts=st.lists(st.integers(0, 400), max_size=20))
def test_programs_do_not_depend_on_how_the_text_is_cut(cuts):
    text = "\n# only a comment\n" + PROGRAM + "".join(LINES)
    raw = text.encode()
    edges = [0, *sorted(min(cut, len(raw)) for cut in cuts), len(raw)]
    pool = Pool()
    reader = ScriptReader(pool)
    found = []
    for start, end in itertools.pairwise(edges):
        found += reader.feed(raw[start:end])
    assert [program.strip() for program in found] == [
        PROGRAM.strip(),
        *(line.strip() for line in LINES),
    ]
    assert pool.taken == 0


def test_an_open_block_waits_for_its_end():
    reader = ScriptReader(Pool())
    assert reader.feed(b"def f():\n x = 1\n") == []
    assert reader.feed(b"en") == []
    assert reader.feed(b"d") == []
    assert reader.feed(b"\n") == ["def f():\n x = 1\nend\n"]


def test_a_string_ends_with_its_line():
    reader = ScriptReader(Pool())
    assert len(reader.feed(b'textmsg("never closed\nstopj(2)\n')) == 2


@pytest.mark.parametrize("piece", [b"x" * 1000, b"def f(\n" * 100, b'"' + b"y" * 999, b"# z" * 300])
def test_text_without_an_end_is_refused_and_its_memory_comes_back(piece):
    pool = Pool()
    reader = ScriptReader(pool, largest=10_000)

    def pour() -> None:
        for _ in range(100):
            reader.feed(piece)

    with pytest.raises(ScriptRefused, match="blocks are not closed"):
        pour()
    assert pool.taken <= 11_000
    reader.close()
    assert pool.taken == 0


def test_all_clients_share_one_pool():
    pool = Pool(size=25_000)
    readers = [ScriptReader(pool, largest=20_000) for _ in range(3)]
    readers[0].feed(b"def f(" * 2000)
    readers[1].feed(b"def f(" * 2000)
    with pytest.raises(ScriptRefused, match="too many unfinished programs"):
        readers[2].feed(b"def f(" * 2000)
    readers[0].close()
    readers[2].feed(b"def f(" * 2000)


def test_what_is_no_text_is_refused():
    with pytest.raises(ScriptRefused, match="not UTF-8"):
        ScriptReader(Pool()).feed(b"abc\xff\xfe\x00\n")


@given(st.binary(max_size=300))
def test_garbage_never_breaks_the_reader(junk):
    pool = Pool()
    reader = ScriptReader(pool)
    with contextlib.suppress(ScriptRefused):
        reader.feed(junk)
    reader.close()
    assert pool.taken == 0
