"""Long work: progress that is told to its caller, time left of a budget, and one thread for each call of a library.

Our products are small: a second thread saves little on a quiet machine, and on a busy one its waiting costs more than
the product. Cores are kept busy by working on several dies at once instead.
"""

from __future__ import annotations

import gc
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import lru_cache, wraps
from importlib import import_module
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from maskfab.base.errors import JobError

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, how many of its steps are done, and how many there are; 0 of 0 for words on a part."""


def silent(stage: str, done: int, total: int) -> None:
    """A progress that nobody watches."""


_SEEN_AFTER_S, _SEEN_EVERY_S = 2.0, 0.2
"""Seconds of work after which a notebook shows where it stands, and between two looks at it."""


class NotebookLine:
    """A progress that a notebook shows: one line, updated, once the work has taken two seconds.

    Args:
        display: shows plain text and gives what updates it, as ``IPython.display.display`` does.
        now: seconds that have gone by since any moment.
    """

    def __init__(self, name: str, display: Callable[..., Any], now: Callable[[], float] = time.monotonic) -> None:
        self._name, self._display, self._now = name, display, now
        self._begun = self._shown = now()
        self._line: Any = None

    def __call__(self, stage: str, done: int, total: int) -> None:
        moment = self._now()
        if total and moment - self._begun >= _SEEN_AFTER_S and moment - self._shown >= _SEEN_EVERY_S:
            self._show(f"{stage} {done}/{total}, {moment - self._begun:.0f} s")
            self._shown = moment

    def end(self) -> None:
        """The last word, of work that was shown."""
        if self._line is not None:
            self._show(f"done in {self._now() - self._begun:.0f} s")

    def _show(self, text: str) -> None:
        shown = {"text/plain": f"{self._name}: {text}"}
        if self._line is None:
            self._line = self._display(shown, raw=True, display_id=True)
        else:
            self._line.update(shown, raw=True)


def notebook_line(name: str) -> NotebookLine | None:
    """A line for the work of that name, where Python is run by the kernel of a notebook; elsewhere None."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if getattr(shell, "kernel", None) is None:
        return None
    return NotebookLine(name, import_module("IPython.display").display)


SLACK = 0.2
"""Share of itself by which the least that is useful may pass a budget before it is refused."""


@dataclass(frozen=True)
class Clock:
    """Counts from when it was made.

    Attributes:
        budget_s: seconds in all; None for as many as it takes.
        refuses: whether :meth:`require` refuses; a search on its own does what it can.
        halt: set by whoever ends the work early; clocks that are made from this one share it.
        now: seconds that have gone by since any moment.
    """

    budget_s: float | None = None
    refuses: bool = False
    halt: threading.Event = field(default_factory=threading.Event, repr=False, compare=False)
    now: Callable[[], float] = field(default=time.monotonic, repr=False, compare=False)
    _begun: float = field(default=math.nan, repr=False, compare=False)
    _given_s: float | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        if math.isnan(self._begun):
            object.__setattr__(self, "_begun", self.now())
            object.__setattr__(self, "_given_s", self.budget_s)

    def __reduce__(self) -> tuple[type[Clock], tuple[float | None, bool]]:
        """For another process: a clock of what is left now, which no halt reaches any more."""
        return type(self), (self.left(), self.refuses)

    @property
    def spent(self) -> float:
        """Seconds since it was made."""
        return self.now() - self._begun

    def left(self, share: float = 1.0) -> float | None:
        """Seconds of this share of what is left, never below 0; None without a budget."""
        if self.halt.is_set():
            return 0.0
        if self.budget_s is None:
            return None
        return max(0.0, share * (self.budget_s - self.spent))

    def part(self, share: float, least_s: float = 0.0) -> Clock:
        """The clock of what may take this share of what is left, and so many seconds at least."""
        left = self.left(share)
        return self if left is None else replace(self, budget_s=self.spent + max(left, least_s))

    @property
    def ender(self) -> str:
        """Whatever ends work that this clock is over for, as the subject of a sentence."""
        return "Ctrl-C" if self.halt.is_set() else "The budget"

    @property
    def over(self) -> bool:
        """Whether nothing is left."""
        return self.left() == 0.0

    def affords(self, seconds: float) -> bool:
        """Whether so much more time keeps the budget."""
        if self.halt.is_set():
            return False
        return self.budget_s is None or self.spent + seconds <= self.budget_s

    def before(self, seconds: float) -> Clock:
        """The clock of what must leave so many seconds to what follows."""
        return self if self.budget_s is None else replace(self, budget_s=self.budget_s - seconds)

    def require(self, seconds: float, what: str, where: str) -> None:
        """Refuse a budget that so much more time, the least that is useful, does not keep.

        Args:
            seconds: that are needed from now on.
            what: takes them, in the plural.

        Raises:
            JobError: MF150.
        """
        least, budget_s, given_s = self.spent + seconds, self.budget_s, self._given_s
        if self.refuses and budget_s is not None and given_s is not None and least > (1 + SLACK) * budget_s:
            part = f", and have {budget_s:.3g} s of it" if budget_s < given_s else ""
            until = f"{float(f'{least:.2g}'):g} s from the beginning{part}"
            raise JobError(
                "MF150",
                f"a budget of {given_s:.3g} s is too short: {what} take until {until}",
                where=where,
                # What leaves a share to others has that share of a longer one too.
                cure=f"Give {math.ceil(1.2 * least * (given_s / budget_s if budget_s > 0 else 1)):d} s or more",
            )


NO_END = Clock()
"""As much time as it takes."""
_COMMAND_BEGUN: ContextVar[float] = ContextVar("command_begun", default=math.nan)
"""When the command line was started, where one was: its budget holds the time of its imports, too."""


def budget_clock(seconds: float | None, *, refuses: bool = True) -> Clock:
    """The clock of a verb's budget: from the call on, or from the start of the command that calls."""
    return Clock(seconds, refuses=refuses, _begun=_COMMAND_BEGUN.get())


@contextmanager
def ended_by_interrupt(clock: Clock) -> Iterator[None]:
    """Let the first Ctrl-C halt a clock, so that the best so far is taken, and the second one interrupt as ever.

    Only where Python's own handler is in place, and in the thread that may ask for it.
    """
    plain = signal.default_int_handler
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) is not plain:
        yield
        return

    def halt(_number: int, _frame: object) -> None:
        signal.signal(signal.SIGINT, plain)
        clock.halt.set()

    signal.signal(signal.SIGINT, halt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, plain)


Given = ParamSpec("Given")
Result = TypeVar("Result")


def one_thread(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Limit of one thread on loaded libraries while a function runs that other programs call; restored afterwards."""

    @wraps(function)
    def limited(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with _libraries(len(sys.modules)).limit(limits=1):
            return function(*args, **kwargs)

    return limited


@lru_cache(maxsize=1)
def _libraries(imported: int) -> ThreadpoolController:
    """The numerical libraries that are loaded, looked for again only where modules were imported since."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables of the environment that limit the threads of numerical libraries."""
_OBJECTS = 10_000
"""Made before the youngest are looked through: polygons and drawings are many, and hardly ever form cycles."""


def settle() -> None:
    """Limit every numerical library that is not loaded yet to one thread, unless the environment says otherwise, look
    for unreachable objects seldom, and count the command's time from here, less what its processor has spent."""
    for name in THREADS:
        os.environ.setdefault(name, "1")
    # Else pydantic reads what all other packages here say of themselves, for plugins of its own.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    gc.set_threshold(_OBJECTS)
    _COMMAND_BEGUN.set(time.monotonic() - time.process_time())
