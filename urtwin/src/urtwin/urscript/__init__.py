"""URScript: from text to a program that runs one control cycle at a time."""

from urtwin.urscript.execution import BACK as BACK
from urtwin.urscript.execution import LISTENING as LISTENING
from urtwin.urscript.execution import Routine as Routine
from urtwin.urscript.execution import ScriptRun as ScriptRun
from urtwin.urscript.library import LIBRARY as LIBRARY
from urtwin.urscript.library import matrix_of as matrix_of
from urtwin.urscript.library import numbers as numbers
from urtwin.urscript.library import pose_of as pose_of
from urtwin.urscript.program import CompiledProgram as CompiledProgram
from urtwin.urscript.program import Context as Context
from urtwin.urscript.program import compile_addition as compile_addition
from urtwin.urscript.program import compile_script as compile_script
from urtwin.urscript.syntax import MAX_CHARACTERS as MAX_CHARACTERS
from urtwin.urscript.values import MAX_LENGTH as MAX_LENGTH
from urtwin.urscript.values import Builtin as Builtin
from urtwin.urscript.values import Pose as Pose
from urtwin.urscript.values import ScriptError as ScriptError
from urtwin.urscript.values import ScriptFault as ScriptFault
from urtwin.urscript.values import Value as Value
from urtwin.urscript.values import builtins as builtins
from urtwin.urscript.values import number as number
from urtwin.urscript.values import shown as shown
from urtwin.urscript.values import truth as truth
from urtwin.urscript.values import whole as whole
from urtwin.urscript.values import within as within
