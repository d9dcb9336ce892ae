"""System limits on processor time and memory for a process that works on a foreign file.

Without any effect where the system knows no such limits.
"""

from __future__ import annotations

import math
import os
import signal
from pathlib import Path

from maskfab.base.machine import end_with_starter

SECONDS = 5
"""Seconds of the processor, for any file; a process that reads for another takes of what that one has left."""

BYTES_PER_SECOND = 100_000
"""Bytes of a file for each second more that it may take; whole files of polygons take a third of it."""


def limit_share(
    path: Path, memory: int, memory_per_byte: int, seconds: int = SECONDS, bytes_per_second: int = BYTES_PER_SECOND
) -> None:
    """Called by a script that only reads: let the system end it for more than a whole file takes, and with its starter.

    Args:
        memory: in bytes, for any file.
        memory_per_byte: of the file, besides.
        seconds: of the processor, for any file.
    """
    end_with_starter()
    size = os.path.getsize(path)
    for kind, most in (
        ("RLIMIT_AS", memory + memory_per_byte * size),
        ("RLIMIT_CPU", seconds + size // bytes_per_second),
    ):
        _set_limit(kind, most, for_good=True)


def allow(seconds: float, memory: int = 0) -> None:
    """Let work within limits take so much more, or less below 0; where nothing is limited, nothing changes."""
    for kind, more in (("RLIMIT_CPU", math.ceil(seconds)), ("RLIMIT_DATA", memory)):
        limit = limit_in_force(kind)
        if limit is not None:
            _set_limit(kind, max(0, limit + more))


def limit_memory(memory: int) -> None:
    """Let the system refuse this process more than so many further bytes."""
    try:
        held = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5]) * os.sysconf("SC_PAGESIZE")
    except (OSError, ValueError, IndexError):
        return  # no Linux, and no system that counts what this limit is of
    _set_limit("RLIMIT_DATA", held + memory)


def limit_processor(seconds: int) -> None:
    """Let the system end this process after so many seconds of the processor; more can be allowed later."""
    _set_limit("RLIMIT_CPU", seconds)


def children_seconds() -> float:
    """Processor time that processes of this one have taken which have ended."""
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def limit_in_force(kind: str) -> int | None:
    """Most that the system lets this process take, in the units of ``RLIMIT_AS`` and its like; None for no limit."""
    limits = _limits(kind)
    return limits[0] if limits is not None and limits[0] >= 0 else None


def end_by_signals() -> None:
    """Let signals end a copy of a process as they end any, but not an interrupt, which is the affair of who waits."""
    for number in signal.valid_signals():
        if callable(signal.getsignal(number)):
            signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _limits(kind: str) -> tuple[int, int] | None:
    """Present limit and highest limit that can be set; negative values stand for none."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    return resource.getrlimit(getattr(resource, kind))


def _set_limit(kind: str, value: int, *, for_good: bool = False) -> None:
    limits = _limits(kind)
    if limits is not None:
        import resource

        most = limits[1]
        value = value if most < 0 else min(value, most)
        resource.setrlimit(getattr(resource, kind), (value, value if for_good else most))
