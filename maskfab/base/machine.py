"""Resources that a machine lends to a process: processors and memory, or the container's share where that is less."""

from __future__ import annotations

import os
from pathlib import Path

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


def _text(name: str) -> str:
    try:
        return (_GROUPS / name).read_text(encoding="ascii").strip()
    except OSError:
        return ""
