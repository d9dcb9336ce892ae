"""Readers of other makers in a process of their own, which a damaged file may end, hang or fill without harm."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from maskfab.errors import SourceError
from maskfab.progress import silent
from maskfab.readers.sandbox.limits import allow, children_seconds
from maskfab.readers.sandbox.messages import read_message

PATIENCE_S = 600.0
"""Of the clock, for a process that waits for ever; its processor time, which a busy machine does not stretch, has a
limit of its own."""

_TOOK_TOO_LONG = {getattr(signal, name, 0) for name in ("SIGXCPU", "SIGKILL")}
"""Signals with which the system ends a process at its limit."""


def read_apart(path: Path, script: Path, *arguments: str, kind: Any, seconds: float) -> Any:
    """Run a reader script on a file in a process of its own and return the answer that it writes to stdout, a message
    of :mod:`maskfab.readers.sandbox.messages`.

    What it takes of the processor is taken of what this process may take, see :mod:`maskfab.readers.sandbox.bounded`.

    Args:
        path: the file, the last argument of the script.
        script: a Python file, which limits what it takes by :func:`maskfab.readers.sandbox.limits.limit_share`; a
            warning in it is a failure.
        arguments: of the script, before the path.
        kind: of the answer.
        seconds: that it may take.

    Raises:
        SourceError: MF316 if it takes longer, MF303 with the last thing it says if it ends in any other way than well.
        MaskfabError: the one that it tells; MF327 if that is no answer.
    """
    before = children_seconds()
    command = [sys.executable, "-P", "-W", "error", str(script), *arguments, str(path)]
    try:
        process = subprocess.run(command, capture_output=True, check=False, timeout=seconds)
    except subprocess.TimeoutExpired as error:
        raise _endless(path, f"within {seconds:.0f} s") from error
    allow(before - children_seconds())
    if process.returncode < 0 and -process.returncode in _TOOK_TOO_LONG:
        raise _endless(path, "in the processor time that it may take")
    if process.returncode != 0:
        said = process.stderr.decode(errors="replace").strip().splitlines()
        what = said[-1] if said else "its records cannot be read"
        raise SourceError("MF303", f"{path.name}: {what}", where=str(path), cure="Write or copy it again")
    (answer,) = read_message(process.stdout, kind, path, silent) or (None,)
    return answer


def _endless(path: Path, limit: str) -> SourceError:
    what = f"{path.name} is not read {limit}"
    return SourceError("MF316", what, where=str(path), cure="Write it again, with fewer repetitions")
