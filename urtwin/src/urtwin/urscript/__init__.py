"""URScript: from text to a program that runs one control cycle at a time."""

from urtwin.urscript.execution import BACK, LISTENING, Routine, ScriptRun
from urtwin.urscript.library import LIBRARY, matrix_of, numbers, pose_of
from urtwin.urscript.program import (
    CompiledProgram,
    Context,
    compile_addition,
    compile_script,
)
from urtwin.urscript.syntax import MAX_CHARACTERS
from urtwin.urscript.values import (
    MAX_LENGTH,
    Builtin,
    Pose,
    ScriptError,
    ScriptFault,
    Value,
    builtins,
    number,
    shown,
    truth,
    whole,
    within,
)

__all__ = [
    "BACK",
    "LIBRARY",
    "LISTENING",
    "MAX_CHARACTERS",
    "MAX_LENGTH",
    "Builtin",
    "CompiledProgram",
    "Context",
    "Pose",
    "Routine",
    "ScriptError",
    "ScriptFault",
    "ScriptRun",
    "Value",
    "builtins",
    "compile_addition",
    "compile_script",
    "matrix_of",
    "number",
    "numbers",
    "pose_of",
    "shown",
    "truth",
    "whole",
    "within",
]
