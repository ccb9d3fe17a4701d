import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scripts import execution, fault, value, variables
from urtwin.urscript import Pose

numbers = st.floats(-1e3, 1e3).map(lambda x: f"{x:.6f}" if x >= 0 else f"({x:.6f})")
sums = st.recursive(
    numbers,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"{t[0]} {t[1]} {t[2]}"),
        inner.map(lambda e: f"({e})"),
        inner.map(lambda e: f"-({e})"),
    ),
    max_leaves=12,
)


@settings(derandomize=True, max_examples=60)
@given(sums)
def test_arithmetic_is_that_of_floats(expression: str) -> None:
    # Our text goes through Python's own compiler: an independent reader of the same grammar.
    assert value(expression) == pytest.approx(eval(expression), rel=1e-15, abs=0)


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("1 + 2 * 3", 7),
        ("(1 + 2) * 3", 9),
        ("8 / 4 / 2", 1.0),
        ("1 / 2", 0.5),
        ("7 % 4", 3),
        ("-7 % 4", -3),
        ("2147483647 + 1", -2147483648),
        ("127 * 16777216 + 32768", 127 * 16777216 + 32768),
        ("1 < 2 and 2 < 3", True),
        ("1 > 2 or 3 > 2", True),
        ("True xor True", False),
        ("not 1 == 2", True),
        ("not True or True", True),
        ("not (True or True)", False),
        ('"a" + "b" + 1', "ab1"),
        ("[1, 2, 3][1]", 2),
        ("p[1, 2, 3, 4, 5, 6][4]", 5),
        ("p[1, 2, 3, 4, 5, 6] == p[1, 2, 3, 4, 5, 6]", True),
        ("[[1, 2], [3, 4]][1, 0]", 3),
        ("1e-3 * .5 + 2.", 2.0005),
    ],
)
def test_expressions(expression: str, expected: object) -> None:
    found = value(expression)
    assert found == expected
    assert type(found) is type(expected)


def test_line_ends_mean_nothing() -> None:
    # What ur_rtde sends: an injected number at the beginning of the next line.
    text = "def f(): global a = # comment\n0    global b = 24 c = a + b if c\n == 24: d = 1 end end"
    assert variables(text)["d"] == 1


def test_pose_literal_and_index_of_a_variable_called_p() -> None:
    text = """def f():
      def scale(p, k):
        p[0] = p[0] * k
        return p
      end
      pose = p[1, 0, 0, 0, 0, 0]
      twice = scale(pose, 2)
    end"""
    found = variables(text)
    assert found["twice"] == [2.0, 0, 0, 0, 0, 0]
    assert isinstance(found["twice"], Pose)
    assert found["pose"][0] == 1.0, "arguments are copies"


def test_names_of_the_program_are_shared_and_others_are_local() -> None:
    text = """def f():
      def change():
        shared = 2
        own = 3
        local hidden = 4
        global made = 5
      end
      shared = 1
      hidden = 0
      change()
    end"""
    found = variables(text)
    assert (found["shared"], found["hidden"], found["made"]) == (2, 0, 5)
    assert "own" not in found


def test_lists_are_values() -> None:
    text = """def f():
      a = [1, 2]
      b = a
      b[0] = 9
      rows = [a, b]
      a[1] = 7
    end"""
    found = variables(text)
    assert found["a"] == [1, 7]
    assert found["b"] == [9, 2]
    assert found["rows"] == [[1, 2], [9, 2]]


def test_loops_branches_and_early_ends() -> None:
    text = """def f():
      def sign(x):
        if x > 0:
          return 1
        elif x < 0:
          return -1
        else:
          return 0
        end
      end
      sum = 0
      i = 0
      while True:
        i = i + 1
        if i == 3:
          continue
        end
        if i > 5:
          break
        end
        sum = sum + i
      end
      signs = [sign(2), sign(-2), sign(0)]
      halt
      sum = -1
    end"""
    found = variables(text)
    assert found["sum"] == 1 + 2 + 4 + 5
    assert found["signs"] == [1, -1, 0]


def test_logic_does_not_look_further_than_it_must() -> None:
    text = """def f():
      count = 0
      def touched(answer):
        count = count + 1
        return answer
      end
      a = touched(False) and touched(True)
      b = touched(True) or touched(True)
    end"""
    found = variables(text)
    assert (found["a"], found["b"], found["count"]) == (False, True, 2)


def test_arguments_by_name_and_defaults() -> None:
    text = """def f():
      def weigh(a, b=2, c=3):
        return a * 100 + b * 10 + c
      end
      x = weigh(1, c=7)
    end"""
    assert variables(text)["x"] == 127


def test_each_sync_is_one_cycle_and_threads_take_turns() -> None:
    text = """def f():
      ticks = 0
      seen = 0
      thread count():
        while True:
          ticks = ticks + 1
          sync()
        end
      end
      handle = run count()
      sync()
      sync()
      sync()
      kill handle
      sync()
      seen = ticks
    end"""
    running, places = execution(text)
    cycles = 0
    while not running.finished:
        running.step()
        cycles += 1
    assert cycles == 5
    assert running.shared[places["seen"]] == 3


def test_killing_no_thread_does_nothing() -> None:
    assert variables("def f():\n kill 0\n done = 1\nend")["done"] == 1


def test_join_waits_for_the_end_of_a_thread() -> None:
    text = """def f():
      n = 0
      thread work():
        sync()
        sync()
        n = 2
      end
      join run work()
      after = n
    end"""
    assert variables(text)["after"] == 2


def test_critical_sections_keep_other_threads_out() -> None:
    text = """def f():
      n = 0
      thread count():
        while True:
          n = n + 1
          sync()
        end
      end
      run count()
      sync()
      enter_critical
      before = n
      sync()
      sync()
      after = n
      exit_critical
      sync()
      sync()
      later = n
    end"""
    found = variables(text)
    assert found["before"] == found["after"]
    assert found["later"] > found["after"]


def test_two_threads_have_a_critical_section_by_turns_in_each_cycle() -> None:
    text = """def f():
      a = 0
      b = 0
      thread servo():
        while True:
          enter_critical
          a = a + 1
          sync()
          exit_critical
        end
      end
      run servo()
      sync()
      while b < 5:
        enter_critical
        b = b + 1
        exit_critical
      end
    end"""
    found = variables(text)
    # Only the thread that waits within it lets a cycle go by.
    assert 4 <= found["a"] <= 6


def test_who_joins_in_a_critical_section_does_not_lock_the_other_in() -> None:
    text = """def f():
      n = 0
      thread work():
        sync()
        enter_critical
        n = 1
        exit_critical
        sync()
        n = 2
      end
      enter_critical
      join run work()
      after = n
      exit_critical
    end"""
    assert variables(text)["after"] == 2


def test_a_thread_that_dies_in_a_critical_section_lets_go() -> None:
    text = """def f():
      thread hold():
        enter_critical
        sync()
      end
      run hold()
      sync()
      sync()
      sync()
      done = 1
    end"""
    assert variables(text)["done"] == 1


def test_the_program_ends_with_its_main_thread() -> None:
    running, _ = execution(
        "def f():\n thread t():\n while True:\n sync()\n end\n end\n run t()\nend"
    )
    running.step()
    assert running.finished


def test_functions_that_wait_inside_expressions() -> None:
    text = """def f():
      def later(x):
        sync()
        return x
      end
      a = later(1) + later(2) * later(3)
      b = [later(4), 5][0]
      if later(True) and not later(False):
        c = later(6)
      end
    end"""
    found = variables(text)
    assert (found["a"], found["b"], found["c"]) == (7, 4, 6)


def test_labels_of_polyscope_are_skipped() -> None:
    assert variables('def f():\n $ 1 "Robot Program"\n $ 2 "a = 1"\n a = 2\nend')["a"] == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def f():\n x = 1 / 0\nend", "line 2: division by zero"),
        ("def f():\n a = [1]\n\n b = a[3]\nend", "line 4: no such element"),
        ("def f():\n if False:\n a = 1\n end\n b = a\nend", "'a' has no value"),
        ('def f():\n a = "x" * 2\nend', "a number expected"),
        ("def f():\n a = [1] + [2, 3]\nend", "lists of different length"),
        ("def f():\n a = sqrt(-1)\nend", "math domain error"),
        ("def f():\n def g():\n end\n a = g()\nend", "returns nothing"),
        ('def f():\n if "x":\n end\nend', "a number expected"),
    ],
)
def test_faults_name_the_line_and_the_cause(text: str, words: str) -> None:
    assert words in fault(text)


def test_numbers_are_finite_where_python_says_so() -> None:
    assert math.isinf(value("1e308 * 10.0"))
