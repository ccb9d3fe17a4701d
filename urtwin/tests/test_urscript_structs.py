"""Structs and methods of lists, as the script manual's page "Lists and Structs" has them."""

import pytest

from scripts import fault, value, variables
from urtwin.urscript import ScriptError


def test_members_are_read_and_written_by_name_and_by_place() -> None:
    found = variables(
        """def f():
          s = struct(identifier1 = 1, identifier2 = 2, text = "Hello structs", list = [1, 2, 3])
          s.text = "Goodbye structs"
          s.list[1] = 20
          word = s.text
          element = s.list[1]
          second = s[1]
          nested = struct(inner = struct(member = "Hi"))
          hi = nested.inner.member
          shown = to_str(s)
        end"""
    )
    assert found["word"] == "Goodbye structs"
    assert found["element"] == 20
    assert found["second"] == 2
    assert found["hi"] == "Hi"
    assert found["shown"] == (
        "struct(identifier1=1, identifier2=2, text=Goodbye structs, list=[1, 20, 3])"
    )


def test_structs_are_passed_and_kept_by_value() -> None:
    found = variables(
        """def f():
          def change(s):
            s.a = 9
            return s
          end
          before = struct(a = 1, b = [1.5])
          after = change(before)
          other = before
          other.b[0] = 7
          kept = before.a + before.b[0]
          new = after.a
        end"""
    )
    assert (found["kept"], found["new"]) == (2.5, 9)


def test_lists_grow_and_shrink() -> None:
    found = variables(
        """def f():
          l = make_list(0, 0, 10)
          l.append(4)
          l.append(5)
          l.insert(0, 3)
          l.insert(3, 6)
          l.extend([7, 8])
          last = l.pop()
          l.remove(1)
          part = l.slice(1, 3)
          count = l.length()
          text = l.to_string()
          m = [1, 2]
          m.clear()
          empty = m.length()
          copy = l
          copy.append(99)
          still = l.length()
        end"""
    )
    assert found["l"] == [3, 5, 6, 7]
    assert (found["last"], found["part"], found["count"]) == (8, [5, 6], 4)
    assert found["text"] == "[3, 5, 6, 7]"
    assert (found["empty"], found["still"]) == (0, 4)


def test_an_element_of_a_nested_list_is_written_in_two_steps_too() -> None:
    assert variables("def f():\n m = [[1, 2], [3, 4]]\n m[1][0] = 9\nend\n")["m"] == [
        [1, 2],
        [9, 4],
    ]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("s = struct(a=1) x = s.b", "no such member"),
        ("s = struct(a=1) s.b = 2", "no such member"),
        ("s = struct(a=1) s.append(2)", "keeps its length"),
        ("q = p[1,2,3,0,0,0] q.pop()", "keeps its length"),
        ("l = [1] l.clear() l.pop()", "empty"),
        ("l = [1] l.insert(3, 1)", "no such element"),
        ("l = [1] x = l.member", "whole number"),
        ("l = make_list(1000, 0) l.append(1)", "too long"),
        ("l = [1] while True: l.append(1) l.clear() end", "endless loop"),
        ("x = 3 x.append(1)", "a list expected"),
    ],
)
def test_what_cannot_be_is_a_fault(line: str, words: str) -> None:
    assert words in fault(f"def f(): {line} end")


@pytest.mark.parametrize(
    "line",
    [
        "x = struct(1, 2)",
        "x = struct()",
        "l = [1] l.sort()",
        "l = [1] l.append()",
        "x = 1.a.b(c=1)",
    ],
)
def test_what_is_no_struct_or_method_does_not_compile(line: str) -> None:
    with pytest.raises(ScriptError):
        variables(f"def f(): {line} end")


def test_numbers_keep_their_points() -> None:
    assert value("[1., .5, 2.5][1] + 1.") == 1.5
