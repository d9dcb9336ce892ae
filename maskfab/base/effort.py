"""Processor time and memory that a piece of work takes, of helper processes too: what the files of each format cost."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from pathlib import Path

_BYTES_PER_UNIT = 1 if sys.platform == "darwin" else 1024
"""Of ``ru_maxrss``."""


@dataclass
class Effort:
    """Cost of work so far: seconds of processors here and in those waited for, bytes of the largest process."""

    seconds: float = 0.0
    bytes: float = 0.0

    def add(self, seconds: float, held: float) -> None:
        """Further work, after or beside the rest."""
        self.seconds, self.bytes = self.seconds + seconds, max(self.bytes, held)


_WORK: ContextVar[Effort | None] = ContextVar("work", default=None)


@contextmanager
def measured(clock_s: Callable[[], float] = time.thread_time) -> Iterator[Effort]:
    """Measure what is done within: known when it is left. Only the main thread tells the memory of this process.

    Args:
        clock_s: seconds of the processor here: of this thread, or of all threads by :func:`time.process_time`.
    """
    effort, begun = Effort(), clock_s()
    main = threading.current_thread() is threading.main_thread()
    if main:
        _forget_peak()
    token = _WORK.set(effort)
    try:
        yield effort
    finally:
        _WORK.reset(token)
        if (around := _WORK.get()) is not None:
            around.add(effort.seconds, effort.bytes)
        effort.add(clock_s() - begun, _peak() if main else 0.0)


def add_helper(seconds: float) -> None:
    """Count the seconds of another process to the work that is measured here, and the memory of those that have ended,
    unless an earlier one had more: the system tells that of the largest so far."""
    if (effort := _WORK.get()) is not None:
        effort.add(seconds, _helpers_peak())


@dataclass(frozen=True)
class FormatCost:
    """Cost of the files of a format: seconds of a processor, and bytes of the largest process.

    Attributes:
        write_s, write_bytes: to write them.
        read_s, read_bytes: to read them back and compare them.
    """

    format: str
    files: int = 0
    write_s: float = 0.0
    write_bytes: float = 0.0
    read_s: float = 0.0
    read_bytes: float = 0.0


@dataclass
class Costs:
    """Cost of every format so far, by its name."""

    of: dict[str, FormatCost] = field(default_factory=dict)

    @property
    def rows(self) -> tuple[FormatCost, ...]:
        """By format, in the order in which they were met."""
        return tuple(self.of.values())

    def wrote(self, name: str, effort: Effort) -> None:
        """A file was written."""
        cost = self.of.get(name, FormatCost(name))
        write_s, most = round(cost.write_s + effort.seconds, 3), max(cost.write_bytes, effort.bytes)
        self.of[name] = replace(cost, files=cost.files + 1, write_s=write_s, write_bytes=most)

    @contextmanager
    def reading(self, name: str) -> Iterator[None]:
        """Files of a format are read and compared within."""
        with measured() as effort:
            yield
        self.read(name, effort)

    def read(self, name: str, effort: Effort) -> None:
        """A file was read back."""
        cost = self.of.get(name, FormatCost(name))
        read_s, most = round(cost.read_s + effort.seconds, 3), max(cost.read_bytes, effort.bytes)
        self.of[name] = replace(cost, read_s=read_s, read_bytes=most)


def _helpers_peak() -> float:
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    return float(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * _BYTES_PER_UNIT)


def _forget_peak() -> None:
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return  # no Linux: the peak is that of all work so far


def _peak() -> float:
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        return 0.0
