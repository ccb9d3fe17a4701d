"""Making a Python process keep time."""

from __future__ import annotations

import gc
import os
import resource
import sys

_SWITCH_S = 0.0005
_PRIORITY = 10
_FILES = 4096
_YOUNG, _OLD, _OLDEST = 20_000, 20, 50


def keep_time(*, real_time: bool) -> bool:
    """Prepare the process for a loop of control cycles; whether it got a real-time priority.

    Other threads of the process (the compiler) hand over within half a millisecond, the garbage
    collector forgets what will live for ever, and SCHED_FIFO is asked for: without it a loaded
    machine delays cycles by tens of milliseconds, with it by a tenth of one.

    Args:
        real_time: Whether to ask for the priority; in virtual time nobody is to be hurried.
    """
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    gc.set_threshold(_YOUNG, _OLD, _OLDEST)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _FILES if hard == resource.RLIM_INFINITY else min(_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return real_time and _first_in_first_out()


def _first_in_first_out() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))
    except OSError:
        return False
    return True
