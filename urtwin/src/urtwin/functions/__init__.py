"""Every built-in function that a script can call on the controller."""

from urtwin.functions.table import BUILTINS

__all__ = [
    "BUILTINS",
]
