"""Work on a foreign file in a process of its own, with limits on time and memory that grow with the file.

Libraries that read and merge polygons cannot be interrupted: a few bytes that repeat, nest or overlap keep them busy
for hours, fill memory, or end the process. So readers of other makers are scripts in a process of their own, and work
with klayout is done in a copy of this one, whose processor time and memory the system limits. Where the work finds that
the file is honest, it asks for as much more as that takes.

What comes back is one message, a letter and what follows from it: an answer as typed data; progress, an error of
maskfab, or a fault of another kind as JSON. It is plain data, so that whatever a file makes of such a process, no code
comes from it. What an answer is, only who asks says (see :mod:`maskfab.base.plain_data`).
"""

from __future__ import annotations

import io
import json
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import traceback
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from maskfab.base.effort import add_helper
from maskfab.base.errors import (
    InputError,
    InternalError,
    JobError,
    MaskfabError,
    OpeningError,
    OutputError,
    SourceError,
    catalogue,
    is_lack_of_memory,
)
from maskfab.base.files import no_file
from maskfab.base.machine import STARTED_BY, end_with
from maskfab.base.plain_data import from_data, to_data
from maskfab.base.work import Progress, silent
from maskfab.mask.process_limits import (
    BYTES_PER_SECOND,
    SECONDS,
    allow,
    children_seconds,
    end_by_signals,
    limit_memory,
    limit_processor,
)

_ANSWER, _PROGRESS, _ERROR, _FAULT = b"A", b"P", b"E", b"F"
_ERRORS: Mapping[str, type[MaskfabError]] = MappingProxyType(
    {
        error.__name__: error
        for error in (InputError, JobError, OpeningError, SourceError, OutputError, InternalError, MaskfabError)
    }
)
_LONGEST = 10_000
"""Characters of what a fault says, and of where it happened."""


def answer_message(answer: object, kind: Any) -> bytes:
    """An answer of a kind that :func:`maskfab.base.plain_data.to_data` takes."""
    return _ANSWER + to_data(answer, kind)


def error_message(error: Exception) -> bytes:
    """Any exception; those that are not maskfab's in words."""
    where = traceback.format_exc()[-_LONGEST:]
    if isinstance(error, MaskfabError):
        kind = type(error).__name__
        fields = [kind if kind in _ERRORS else InputError.__name__, error.code, error.what, error.where, error.cure]
        return _ERROR + json.dumps([*fields, where]).encode()
    return _FAULT + json.dumps([f"{type(error).__name__}: {error}"[:_LONGEST], where]).encode()


def read_message(message: bytes, kind: Any, path: Path, progress: Callable[[str, int, int], None]) -> tuple[Any, ...]:
    """The answer, alone in a tuple; nothing yet for progress, which is passed on.

    Raises:
        MaskfabError: that of the process; InternalError MF901 for a fault of another kind.
        SourceError: MF327 if the message is none.
    """
    raised: MaskfabError
    try:
        letter, content = message[:1], message[1:]
        if letter == _ANSWER:
            # Nothing in the archive is packed, and so nothing unpacks to more than it takes.
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                members = archive.infolist()
            _require(all(member.compress_type == zipfile.ZIP_STORED for member in members))
            _require(sum(member.file_size for member in members) <= len(content))
            return (from_data(content, kind),)
        fields = json.loads(content)
        if letter == _PROGRESS:
            stage, done, total = fields
            _require(isinstance(stage, str) and len(stage) <= _LONGEST and {type(done), type(total)} == {int})
            progress(stage, done, total)
            return ()
        _require(letter in (_ERROR, _FAULT) and all(isinstance(value, str) for value in fields))
        if letter == _ERROR:
            name, code, what, where, cure, trace = fields
            _require(code in catalogue())
            raised = _ERRORS[name](code, what, where=where, cure=cure)
        else:
            fault, trace = fields
            raised = InternalError("MF901", fault, cure="Please report this with the file")
    except Exception as error:
        raise unusable(path, error) from error
    raised.add_note(trace[-_LONGEST:])
    raise raised


def unusable(path: Path, why: Exception) -> SourceError:
    """MF327 for what is no message, or too long."""
    what = f"the process that reads {path.name} gives an answer that cannot be used ({type(why).__name__})"
    cure = "Do not trust the file; if you know its source, write it again"
    return SourceError("MF327", what, where=str(path), cure=cure)


def _require(held: bool) -> None:
    if not held:
        raise ValueError


def missing(path: Path) -> SourceError:
    """MF301 for a file that is not there."""
    cure = "Give the path of an existing file"
    return SourceError("MF301", no_file(path, path.name), where=str(path), cure=cure)


def damaged(path: Path, what: str) -> SourceError:
    """MF303 for a file that says what cannot be."""
    return SourceError("MF303", f"{path.name}: {what}", where=str(path), cure="Write or copy it again")


def wrong_kind(path: Path, kind: str) -> SourceError:
    """MF304 for a file whose content is not what its suffix says."""
    return SourceError("MF304", f"{path.name} is not a {kind} file", where=str(path), cure="Give it its true suffix")


Answer = TypeVar("Answer")

SHAPES_PER_SECOND = 10_000
"""Shapes of the design that the file is held against; they take a fifth of it."""

MEMORY = 1_500_000_000
MEMORY_PER_BYTE = 64

_WALL_PER_PROCESSOR = 30
_OUT_OF_TIME = {getattr(signal, name, 0) for name in ("SIGXCPU", "SIGKILL")}
"""Signals with which the system ends a process at its limit."""

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
        kind: of the answer, plain data of which come back, see :mod:`maskfab.base.plain_data`.
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
    """Work of :func:`bounded` beside other work here; yields its answer, which, called once, waits or raises."""
    if "fork" not in multiprocessing.get_all_start_methods():
        yield lambda: work(progress)
        return
    size = path.stat().st_size if os.path.isfile(path) else 0
    limit = math.ceil((SECONDS if seconds is None else seconds) + size / BYTES_PER_SECOND)
    here, there = multiprocessing.Pipe(duplex=False)
    memory = MEMORY + MEMORY_PER_BYTE * size
    copy = multiprocessing.get_context("fork").Process(
        target=_work, args=(os.getpid(), path, there, work, kind, limit, memory)
    )
    with warnings.catch_warnings():
        # Of threads that would not be there in the copy; those of the libraries are at rest, or begin anew.
        warnings.simplefilter("ignore", DeprecationWarning)
        copy.start()
    there.close()

    def answer() -> Answer:
        stage, ended = "read", None

        def tell(*step: Any) -> None:
            nonlocal stage
            stage = step[0]
            progress(*step)

        try:
            while here.poll(_WALL_PER_PROCESSOR * limit):
                if answers := read_message(here.recv_bytes(memory), kind, path, tell):
                    return answers[0]  # type: ignore[no-any-return]
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
    """Seconds, for :func:`bounded`, that a small file may take that is held against a design of so many shapes."""
    return SECONDS + math.ceil(shapes / SHAPES_PER_SECOND)


@contextmanager
def library_errors(path: Path) -> Iterator[None]:
    """MF323 for what klayout throws at shapes of a file that it cannot work with."""
    try:
        yield
    except RuntimeError as error:
        refusal = _said(path, error)
        if refusal is error:
            raise
        raise refusal from error


def _said(path: Path, error: Exception) -> Exception:
    if is_lack_of_memory(error):
        return _too_much(path, "needs more memory than it may take")
    if type(error) is not RuntimeError:
        return error
    said = (str(error).strip() or "no reason told").splitlines()[0][:200]
    what = f"{path.name}: the library of polygons gives up on its shapes ({said})"
    return SourceError("MF323", what, where=str(path), cure=_CURE)


def _too_much(path: Path, what: str) -> SourceError:
    return SourceError("MF322", f"{path.name} {what}", where=str(path), cure=_CURE)


def _work(
    parent: int, path: Path, there: Connection, work: Callable[[Progress], Any], kind: Any, seconds: int, memory: int
) -> None:
    """The life of the copy."""
    end_with(parent)

    def tell(stage: str, done: int, total: int) -> None:
        there.send_bytes(_PROGRESS + json.dumps([stage, done, total]).encode())

    end_by_signals()
    limit_processor(seconds)
    limit_memory(memory)
    try:
        message = answer_message(work(tell), kind)
    except Exception as error:
        message = error_message(_said(path, error))
    there.send_bytes(message)
    there.close()


PATIENCE_S = 600.0
"""Of the clock, for a process that waits for ever; its processor time, which a busy machine does not stretch, has a
limit of its own."""


def read_apart(path: Path, script: Path, *arguments: str, kind: Any, seconds: float) -> Any:
    """Run a reader script on a file in a process of its own and return the answer that it writes to stdout, a message
    of :mod:`maskfab.mask.sandbox`.

    What it takes of the processor is taken of what this process may take, see :mod:`maskfab.mask.sandbox`.

    Args:
        path: the file, the last argument of the script.
        script: a Python file, which limits what it takes by :func:`maskfab.mask.process_limits.limit_share`; a
            warning in it is a failure.

    Raises:
        SourceError: MF316 if it takes longer, MF303 with the last thing it says if it ends in any other way than well.
        MaskfabError: the one that it tells; MF327 if that is no answer.
    """
    before, environment = children_seconds(), {**os.environ, STARTED_BY: str(os.getpid())}
    command = [sys.executable, "-P", "-W", "error", str(script), *arguments, str(path)]
    try:
        process = subprocess.run(command, capture_output=True, check=False, timeout=seconds, env=environment)
    except subprocess.TimeoutExpired as error:
        raise _endless(path, f"within {seconds:.0f} s") from error
    took_s = children_seconds() - before
    add_helper(took_s)
    allow(-took_s)
    if process.returncode < 0 and -process.returncode in _OUT_OF_TIME:
        raise _endless(path, "in the processor time that it may take")
    if process.returncode != 0:
        said = process.stderr.decode(errors="replace").strip().splitlines()
        what = said[-1] if said else "its records cannot be read"
        raise damaged(path, what)
    (answer,) = read_message(process.stdout, kind, path, silent) or (None,)
    return answer


def _endless(path: Path, limit: str) -> SourceError:
    what = f"{path.name} is not read {limit}"
    return SourceError("MF316", what, where=str(path), cure="Write it again, with fewer repetitions")
