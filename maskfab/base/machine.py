"""Resources that a machine lends to a process: processors and memory, or the container's share where that is less."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from pathlib import Path
from threading import Thread

STARTED_BY = "MASKFAB_STARTED_BY"
"""Variable of the environment that tells a helper the process that waits for it."""
_PR_SET_PDEATHSIG = 1
_LOOKED_EVERY_S = 1.0

_MEMORY = ("memory.max", "memory/memory.limit_in_bytes")
_TIME = ("cpu.max", "cpu/cpu.cfs_quota_us cpu/cpu.cfs_period_us")
"""Limits of a container, of the second and of the first kind of control groups."""
_GROUPS = Path("/sys/fs/cgroup")


def cores() -> int:
    """Processors that this process may use: those it is bound to, at most as many as its container's share of time."""
    bound = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    for names in _TIME:
        share = " ".join(map(_text, names.split())).split()
        if len(share) == 2 and all(number.isdigit() for number in share):
            bound = min(bound, -(-int(share[0]) // int(share[1])))
    return max(1, bound)


def memory_bytes() -> float:
    """Bytes of memory of the machine, or of the container; infinite where the system does not tell."""
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError, AttributeError):
        return float("inf")
    return float(min([total, *(int(text) for name in _MEMORY if (text := _text(name)).isdigit())]))


def end_with(parent: int) -> None:
    """End this process as soon as the one that waits for it has ended, however that came: by SIGKILL, too."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    elif os.name == "posix":
        Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.name == "posix" and os.getppid() != parent:  # it ended before
        os._exit(1)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOKED_EVERY_S)
    os._exit(1)


def end_with_starter() -> None:
    """:func:`end_with` whoever started this process as a helper, if anybody did."""
    if parent := os.environ.get(STARTED_BY):
        end_with(int(parent))


def _text(name: str) -> str:
    try:
        return (_GROUPS / name).read_text(encoding="ascii").strip()
    except OSError:
        return ""
