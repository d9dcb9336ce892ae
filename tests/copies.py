"""Reader scripts run in a forked copy of this process, which a file may end as well as a process that was started.

To start Python and import a library takes ten times as long as to read a small file.
"""

from __future__ import annotations

import faulthandler
import os
import runpy
import subprocess
import sys
import traceback
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import NoReturn

from maskfab.camera.frames import frame_process
from maskfab.mask import process_limits as limits
from maskfab.mask.formats import gdstk_process, gerber_process, step_process

LIBRARIES = {
    gdstk_process.__file__: "gdstk",
    gerber_process.__file__: "gerbonara",
    step_process.__file__: "OCP.STEPControl",
    frame_process.__file__: "rawpy",
}
"""What each script reads with, which is imported once, not in every copy."""


def run(command: list[str], **options: object) -> subprocess.CompletedProcess[bytes]:
    """As :func:`subprocess.run` of a command ``python -P -W error SCRIPT ARGUMENTS`` whose output is captured."""
    *switches, script = command[1:5]
    if script not in LIBRARIES or not hasattr(os, "fork"):
        return subprocess.run(command, **options)  # type: ignore[call-overload, no-any-return] # noqa: PLW1510
    assert switches == ["-P", "-W", "error"]
    with suppress(ImportError):
        import_module(LIBRARIES[script])
    # Pipes, as those of a process that was started, are bound by no limit on the size of files.
    (out, out_end), (said, said_end) = os.pipe(), os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        copy = os.fork()
    if not copy:
        _live(command[4:], out_end, said_end)
    os.close(out_end)
    os.close(said_end)
    with open(out, "rb") as answer, open(said, "rb") as complaint, ThreadPoolExecutor(1) as beside:
        complained = beside.submit(complaint.read)
        answered = answer.read()
        _, status = os.waitpid(copy, 0)
        return subprocess.CompletedProcess(command, os.waitstatus_to_exitcode(status), answered, complained.result())


def _live(arguments: list[str], out: int, said: int) -> NoReturn:
    """The life of the copy."""
    code = 1
    try:
        faulthandler.disable()
        limits.end_by_signals()
        os.dup2(out, 1)
        os.dup2(said, 2)
        sys.stdout, sys.stderr = open(1, "w"), open(2, "w")  # noqa: SIM115
        sys.argv = arguments
        _limit_growth()
        warnings.resetwarnings()
        warnings.simplefilter("error")
        runpy.run_path(arguments[0], run_name="__main__")
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
        print(end.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _limit_growth() -> None:
    """Limit what this process takes besides what it holds, where a new one would hold next to nothing."""
    held = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGESIZE")
    set_limit = limits._set_limit

    def set_growth(kind: str, value: int, *, for_good: bool = False) -> None:
        set_limit(kind, value + held * (kind == "RLIMIT_AS"), for_good=for_good)

    limits._set_limit = set_growth


FORKING = SimpleNamespace(run=run, TimeoutExpired=subprocess.TimeoutExpired)
"""Stands for the module subprocess."""
