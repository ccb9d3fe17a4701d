"""Scripts that must not hurt: each is refused in words or contained."""

import time
import tracemalloc

import pytest

from scripts import execution, fault
from urtwin.functions import BUILTINS
from urtwin.urscript import ScriptError, compile_script

MEGABYTE = 1_000_000
MEMORY = 60 * MEGABYTE
LONGEST_CYCLE_S = 1.0


def refused(text: str) -> str:
    with pytest.raises(ScriptError) as caught:
        compile_script(text, BUILTINS)
    return str(caught.value)


@pytest.mark.parametrize(
    "body",
    [
        "while True:\n end",
        "x = 0\n while True:\n x = x + 1\n end",
        "def g():\n return True\n end\n while g():\n end",
        "while True:\n if True:\n continue\n end\n end",
        "thread t():\n while True:\n end\n end\n run t()\n while True:\n sync()\n end",
    ],
)
def test_endless_loops_end_in_words(body: str) -> None:
    assert "endless loop" in fault(f"def f():\n {body}\nend")


@pytest.mark.parametrize(
    "body",
    [
        "def g(n):\n return g(n + 1)\n end\n x = g(0)",
        "def g():\n h()\n end\n def h():\n g()\n end\n g()",
        "def g():\n sync()\n g()\n end\n g()",
    ],
)
def test_deep_recursion_ends_in_words(body: str) -> None:
    assert "nested too deeply" in fault(f"def f():\n {body}\nend", cycles=200)


def test_calls_of_forty_levels_work() -> None:
    text = "def f():\n def g(n):\n if n == 0:\n return 0\n end\n return g(n - 1) + 1\n end\n"
    running, places = execution(text + " x = g(38)\nend")
    running.step()
    assert running.fault is None
    assert running.shared[places["x"]] == 38


def test_ten_megabytes_are_refused() -> None:
    assert "too long" in refused("def f():\n" + "x = 1\n" * (10 * MEGABYTE // 6) + "end\n")


@pytest.mark.parametrize(
    "expression",
    ["(" * 50_000 + "1" + ")" * 50_000, "-" * 100_000 + "1", "[" * 50_000, "x" + "[0]" * 50_000],
)
def test_deep_nesting_is_refused(expression: str) -> None:
    assert "nested too deeply" in refused(f"def f():\n x = {expression}\nend\n")


def test_deep_blocks_are_refused() -> None:
    assert "nested too deeply" in refused("def f():\n" + "if True:\n" * 10_000)


def test_long_sums_and_long_branches_are_not_deep() -> None:
    running, places = execution("def f():\n x = 1" + " + 1" * 5_000 + "\nend\n")
    running.step()
    assert running.shared[places["x"]] == 5_001
    branches = "".join(f"elif x == {k}:\n y = {k}\n" for k in range(2_000))
    running, places = execution(f"def f():\n x = 1999\n if x < 0:\n y = -1\n {branches}end\nend\n")
    running.step()
    assert running.shared[places["y"]] == 1_999


def test_a_thousand_threads() -> None:
    body = "thread t():\n while True:\n sync()\n end\n end\n i = 0\n"
    loop = "while i < 1000:\n run t()\n i = i + 1\n sync()\n end\n"
    assert "too many threads" in fault(f"def f():\n {body} {loop}end", cycles=2_000)


def test_threads_that_breed() -> None:
    body = "thread t():\n run t()\n sync()\n end\n run t()\n while True:\n sync()\n end"
    text = f"def f():\n {body}\nend"
    running, _ = execution(text)
    for _ in range(200):
        if not running.finished:
            running.step()
    assert len(running.threads) <= 50


@pytest.mark.parametrize(
    "body",
    [
        's = "x"\n while True:\n s = s + s\n sync()\n end',
        "a = [1]\n while True:\n a = [a, a]\n sync()\n end",
        "a = 2\n while True:\n a = a * a\n sync()\n end",
        's = "x"\n while True:\n s = str_cat(s, s)\n sync()\n end',
    ],
)
def test_values_do_not_grow(body: str) -> None:
    tracemalloc.start()
    running, _ = execution(f"def f():\n {body}\nend")
    for _ in range(500):
        if not running.finished:
            running.step()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MEMORY
    assert running.finished == (running.fault is not None)
    if running.fault:
        assert "too long" in running.fault


def test_many_big_variables_are_out_of_memory() -> None:
    # Each call keeps a hundred lists of its own: three million numbers deep inside.
    big = ", ".join(["1"] * 1_000)
    lists = "\n".join(f"b{k} = a" for k in range(100))
    body = f"""a = [{big}]
    thread t():
      def deep(n):
        {lists}
        sync()
        if n > 0:
          deep(n - 1)
        end
        while True:
          sync()
        end
      end
      deep(30)
    end
    run t()
    while True:
      sync()
    end"""
    assert "out of memory" in fault(f"def f():\n{body}\nend", cycles=1_000)


@pytest.mark.parametrize("keep", ["l.append(str_cat(pad, k))", "l[k] = str_cat(pad, k)"])
def test_many_texts_in_lists_are_out_of_memory(keep: str) -> None:
    """Each counted as one, of a thousand characters too."""
    text = f"""def f():
      pad = "{"x" * 900}"
      def filled():
        l = {"[]" if "append" in keep else "make_list(1000, 0)"}
        k = 0
        while k < 1000:
          {keep}
          k = k + 1
        end
        sync()
        return l
      end
      a = filled()
      b = filled()
      c = filled()
    end"""
    assert "out of memory" in fault(text)


def test_too_many_variables_are_refused() -> None:
    text = "\n".join(f"v{k} = 1" for k in range(3_000))
    assert "too many variables" in refused(f"def f():\n{text}\nend")


def test_one_cycle_of_the_worst_stays_short() -> None:
    bombs = [
        "a = [1, 2, 3]\n while True:\n b = to_str(a)\n end",
        "while True:\n a = pose_trans(p[1,2,3,0,0,1], p[1,2,3,0,1,0])\n end",
        "a = [" + "1," * 999 + "1]\n while True:\n b = a\n end",
    ]
    for body in bombs:
        running, _ = execution(f"def f():\n {body}\nend")
        start = time.process_time()
        running.step()
        assert time.process_time() - start < LONGEST_CYCLE_S
        assert running.fault is not None
        assert "endless loop" in running.fault


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("\x00\xff", "unexpected character"),
        ("def f():\n unknown_name\nend", "unknown name"),
        ("def f():\n unknown_function(1)\nend", "line 2: unknown function"),
        ("def f():\n x = 1\n", "'end' expected"),
        ("def f():\n end end", "an expression expected"),
        ("def f():\n break\nend", "outside a loop"),
        ("def f():\n sin()\nend", "needs its argument"),
        ("def f():\n sin(1, 2)\nend", "too many arguments"),
        ("def f():\n sin(g=1)\nend", "argument of sin"),
        ("def f():\n run sin(1)\nend", "unknown thread"),
        ("def f():\n 1 = 2\nend", "assigned to"),
        ("def f():\n def g():\n end\n def g():\n end\nend", "defined twice"),
        ('def f():\n x = "open\nend', "unexpected character"),
        ("sec f():\n sync()\nend", "must not take time"),
        ("def f():\n if True:\n def g():\n end\n end\nend", "inside a block"),
    ],
)
def test_what_does_not_compile_never_starts(text: str, words: str) -> None:
    assert words in refused(text)
