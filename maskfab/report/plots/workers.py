"""Figures drawn side by side, in processes of their own: matplotlib's settings belong to a whole process.

    python -P workers.py

reads pickled tasks from stdin, and pickles what they drew to stdout. What is drawn depends on the task alone, so that
the number of processes does not show.
"""

from __future__ import annotations

import copyreg
import io
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from types import MappingProxyType
from typing import Any

from maskfab.errors import InternalError

Pictures = dict[str, str]
Task = tuple[Callable[..., Pictures], tuple[Any, ...]]
"""A function of a module, and its arguments."""


def draw_all(tasks: Sequence[Task], workers: int) -> list[Pictures]:
    """Pictures of every task, in order; drawn by this process if one is enough.

    Raises:
        InternalError: MF901 with the last words of a process that fails.
    """
    if min(workers, len(tasks)) < 2:
        return [function(*given) for function, given in tasks]
    found: list[Pictures] = [{} for _ in tasks]
    with ExitStack() as stack:
        processes = []
        # Neighbours are alike in cost, so each process takes every so many of them.
        for first in range(min(workers, len(tasks))):
            process = stack.enter_context(_started())
            stack.callback(process.kill)
            _send(tasks[first::workers], process)
            processes.append(process)
        for first, process in enumerate(processes):
            answer, said = process.communicate()
            if process.returncode:
                words = said.decode(errors="replace").strip().splitlines() or ["nothing"]
                raise InternalError("MF901", f"a process that draws figures ended with {words[-1]}")
            found[first::workers] = pickle.loads(answer)
    return found


def _started() -> subprocess.Popen[bytes]:
    command = [sys.executable, "-P", __file__]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def _send(tasks: Sequence[Task], process: subprocess.Popen[bytes]) -> None:
    assert process.stdin is not None
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer, protocol=pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = copyreg.dispatch_table | {MappingProxyType: lambda view: (read_only, (dict(view),))}
    pickler.dump(list(tasks))
    # What ends it early is told when it is waited for.
    with suppress(BrokenPipeError):
        process.stdin.write(buffer.getbuffer())
        process.stdin.flush()


def read_only(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    """A read-only view for unpickling, where its own class has no name to be found by."""
    return MappingProxyType(content)


def _work() -> None:
    # What is printed on the way must not get among the answer.
    stdout, sys.stdout = sys.stdout.buffer, sys.stderr
    tasks: list[Task] = pickle.load(sys.stdin.buffer)
    stdout.write(pickle.dumps(draw_all(tasks, 1)))


if __name__ == "__main__":
    _work()
