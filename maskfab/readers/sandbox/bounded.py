"""Work on a foreign file in a forked process with limits on time and memory that grow with the file.

The libraries that read and merge polygons cannot be interrupted: a few bytes that repeat, nest or overlap keep them
busy for hours, or fill memory. So the work is done in a copy of the process whose processor time and memory the system
limits, and its answer comes back. Where the work finds that the file is honest, it asks for as much more as that takes.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from maskfab.errors import SourceError, is_lack_of_memory
from maskfab.progress import Progress, silent
from maskfab.readers.sandbox.limits import BYTES_PER_SECOND, SECONDS, end_by_signals, limit_memory, limit_processor
from maskfab.readers.sandbox.messages import (
    answer_message,
    error_message,
    progress_message,
    read_message,
    unusable,
)

Answer = TypeVar("Answer")

SHAPES_PER_SECOND = 10_000
"""Of the design that the file is held against; they take a fifth of it."""

MEMORY = 1_500_000_000
MEMORY_PER_BYTE = 64

_WALL_PER_PROCESSOR = 30
_OUT_OF_TIME = {getattr(signal, name, 0) for name in ("SIGXCPU", "SIGKILL")}
_CURE = "Write it again as plain polygons, with fewer copies and no overlaps"


def bounded(
    path: Path,
    work: Callable[[Progress], Answer],
    progress: Progress = silent,
    *,
    kind: Any,
    seconds: int | None = None,
) -> Answer:
    """Run work within limits of time and memory and return its result; on systems without fork, without limits.

    Args:
        path: the file that the work reads: the larger, the longer it may take.
        work: told what to tell of its progress.
        progress: told what the work tells.
        kind: of the answer, plain data of which come back, see :mod:`maskfab.files.plain_data`.
        seconds: of the processor, for a small file; :data:`SECONDS` if None.

    Raises:
        SourceError: MF322 if it takes longer, or more memory, or ends the process; MF323 if a library throws; MF327 if
            what comes back is no answer.
        MaskfabError: whatever the work raises, if that is maskfab's; InternalError MF901 in place of all else.
    """
    with begun(path, work, progress, kind=kind, seconds=seconds) as answer:
        return answer()


@contextmanager
def begun(
    path: Path,
    work: Callable[[Progress], Answer],
    progress: Progress = silent,
    *,
    kind: Any,
    seconds: int | None = None,
) -> Iterator[Callable[[], Answer]]:
    """Work of :func:`bounded` that goes on beside other work here, until its answer is asked for or nobody wants it.

    Yields:
        The answer, waited for; called once, it raises as :func:`bounded`.
    """
    if "fork" not in multiprocessing.get_all_start_methods():
        yield lambda: work(progress)
        return
    size = path.stat().st_size if os.path.isfile(path) else 0
    limit = math.ceil((SECONDS if seconds is None else seconds) + size / BYTES_PER_SECOND)
    here, there = multiprocessing.Pipe(duplex=False)
    memory = MEMORY + MEMORY_PER_BYTE * size
    copy = multiprocessing.get_context("fork").Process(target=_work, args=(path, there, work, kind, limit, memory))
    with warnings.catch_warnings():
        # Of threads that would not be there in the copy; those of the libraries are at rest, or begin anew.
        warnings.simplefilter("ignore", DeprecationWarning)
        copy.start()
    there.close()

    def answer() -> Answer:
        stage, ended = "read", None

        def tell(*told: Any) -> None:
            nonlocal stage
            stage = told[0]
            progress(*told)

        try:
            while here.poll(_WALL_PER_PROCESSOR * limit):
                if found := read_message(here.recv_bytes(memory), kind, path, tell):
                    return found[0]  # type: ignore[no-any-return]
        except EOFError:
            copy.join()
            ended = copy.exitcode
        except OSError as error:  # longer than all the memory that it may take
            raise unusable(path, error) from error
        if ended is None or -ended in _OUT_OF_TIME:
            what = f"does not come to an end of the stage {stage!r} in the processor time that it may take"
            raise _too_much(path, what)
        raise _too_much(path, f"ends the process in the stage {stage!r}, or needs more memory than it may take")

    try:
        yield answer
    finally:
        copy.kill()
        copy.join()
        here.close()


def seconds_of(shapes: int) -> int:
    """For :func:`bounded`: what a small file may take that is held against a design of so many shapes."""
    return SECONDS + math.ceil(shapes / SHAPES_PER_SECOND)


@contextmanager
def library_errors(path: Path) -> Iterator[None]:
    """MF323 for what klayout throws at shapes of a file that it cannot work with."""
    try:
        yield
    except RuntimeError as error:
        told = _said(path, error)
        if told is error:
            raise
        raise told from error


def _gave_up(path: Path, error: RuntimeError) -> SourceError:
    said = (str(error).strip() or "no reason told").splitlines()[0][:200]
    what = f"{path.name}: the library of polygons gives up on its shapes ({said})"
    return SourceError("MF323", what, where=str(path), cure=_CURE)


def _said(path: Path, error: Exception) -> Exception:
    """Errors of the libraries, and a lack of memory, as errors of the file."""
    if is_lack_of_memory(error):
        return _too_much(path, "needs more memory than it may take")
    return _gave_up(path, error) if type(error) is RuntimeError else error


def _too_much(path: Path, what: str) -> SourceError:
    return SourceError("MF322", f"{path.name} {what}", where=str(path), cure=_CURE)


def _work(path: Path, there: Connection, work: Callable[[Progress], Any], kind: Any, seconds: int, memory: int) -> None:
    """The life of the copy."""

    def tell(stage: str, done: int, total: int) -> None:
        there.send_bytes(progress_message(stage, done, total))

    end_by_signals()
    limit_processor(seconds)
    limit_memory(memory)
    try:
        message = answer_message(work(tell), kind)
    except Exception as error:
        message = error_message(_said(path, error))
    there.send_bytes(message)
    there.close()
