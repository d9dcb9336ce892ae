"""Processes that replace a result are killed at every system call, and somebody writes into the folder meanwhile.

    python tests/kill_swaps.py 10000          so many kills
    python tests/kill_swaps.py 400-600        those of these numbers; the same number is the same round

A tracer (ptrace) stops the process before each of its system calls: no state of the disk lies between two of them.
A round begins with a finished result, or with nothing. Up to three processes in a row start to put a new one there,
each with what the last one left; each is killed before a call, and before another call somebody may write a document:
under the folder's name, or in the folder that had it when the round began, or over one of the result's files. After
each kill the next start must find one whole result, and every document. After the last, one that nobody kills leaves
its result and nothing that is hidden.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import random
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path

from swaps import swap, whole

from maskfab.base import folders
from maskfab.base.errors import OutputError

_TRACE_ME, _TO_CALL, _OPTIONS = 0, 24, 0x4200
_TELL_CALLS, _END_WITH_TRACER = 0x1, 0x100000
_AT_CALL = signal.SIGTRAP | 0x80
_BY_NAME, _INSIDE, _OVER, _EMPTY = "by its name", "in the opened folder", "over a file", "an empty folder"
_WAYS = (_BY_NAME, _INSIDE, _OVER, _EMPTY)
_DOCUMENT = "document"


@cache
def _call() -> Callable[..., int]:
    call = ctypes.CDLL(None, use_errno=True).ptrace
    call.argtypes, call.restype = (ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p), ctypes.c_long
    return call


def _ptrace(request: int, process: int, data: int = 0) -> None:
    if _call()(request, process, None, data) == -1:
        raise OSError(ctypes.get_errno(), "ptrace")


def can_trace() -> bool:
    """Whether this system lets a process stop another at its calls."""
    try:
        return traced(lambda: 0, lambda number: True) is None
    except (AttributeError, OSError):
        return False


def traced(work: Callable[[], int], before: Callable[[int], bool]) -> int | None:
    """Run something in a process of its own, stopped before each system call, which are counted from 1.

    Args:
        work: returns the exit status.
        before: told the number of the call; true kills the process there.

    Returns:
        The exit status; None of a killed process.
    """
    process = os.fork()
    if not process:
        try:
            _ptrace(_TRACE_ME, 0)
            os.kill(os.getpid(), signal.SIGSTOP)
            os._exit(work())
        finally:
            os._exit(99)
    status, calls, enters = os.waitpid(process, 0)[1], 0, True
    if os.WIFSTOPPED(status):
        _ptrace(_OPTIONS, process, _TELL_CALLS | _END_WITH_TRACER)
    while os.WIFSTOPPED(status):
        if os.WSTOPSIG(status) == _AT_CALL:
            calls += enters
            if enters and before(calls):
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)
                return None
            enters = not enters
        _ptrace(_TO_CALL, process)
        status = os.waitpid(process, 0)[1]
    return os.waitstatus_to_exitcode(status)


def _swapped(target: Path, word: str, *, force: bool) -> int:
    try:
        swap(target, word, force=force)
    except OutputError:
        return 2
    return 0


@dataclass
class Person:
    """Somebody who writes documents into the folder of a result.

    Attributes:
        target: the folder's path.
        opened: the folder that had the name when the round began; None if there was none.
        documents: what was written.
    """

    target: Path
    opened: int | None
    documents: set[str] = field(default_factory=set)

    def write(self, way: str) -> None:
        text = f"{_DOCUMENT} {len(self.documents)}"
        try:
            if way == _EMPTY:
                self.target.mkdir()
                return
            if way == _INSIDE and self.opened is not None:
                file = os.open(f"{text}.txt", os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644, dir_fd=self.opened)
                os.write(file, text.encode())
                os.close(file)
            else:
                self.target.mkdir(exist_ok=True)
                (self.target / ("a.txt" if way == _OVER else f"{text}.txt")).write_text(text)
        except OSError:
            return  # that folder is there already, or no longer, for anybody
        self.documents.add(text)

    def misses(self, *, hidden: bool) -> list[str]:
        """The documents that are gone, or that only who looks for hidden names finds."""
        parent = self.target.parent
        found = {
            path.read_text()
            for path in parent.rglob("*")
            if path.is_file() and (hidden or not any(part[0] == "." for part in path.relative_to(parent).parts))
        }
        return [f"lost: {text}" for text in sorted(self.documents - found)]

    def takes_away(self, elsewhere: Path) -> None:
        """Move the documents out of the folder, as the refusal asks; with all of it if it is no sound result."""
        if not self.target.is_dir():
            return
        mine = [path for path in self.target.iterdir() if path.read_text().startswith(_DOCUMENT)]
        if mine and (self.target / "a.txt" in mine or not (self.target / "manifest.json").exists()):
            self.target.rename(elsewhere)
            return
        for path in mine:
            elsewhere.mkdir(exist_ok=True)
            path.rename(elsewhere / path.name)


@contextmanager
def _by_turns(turns: bool) -> Iterator[None]:
    """Names exchanged as on a system that cannot do it at once."""
    at_once = folders._at_once
    if turns:
        folders._at_once = lambda one, other: False
    try:
        yield
    finally:
        folders._at_once = at_once


@dataclass(frozen=True)
class Met:
    """What one process meets.

    Attributes:
        kill: the call before which it is killed.
        write: the call before which somebody writes, and how; None if nobody does.
    """

    kill: int
    write: tuple[int, str] | None = None


@dataclass(frozen=True)
class Round:
    """What happens to a folder.

    Attributes:
        turns: names are exchanged one by one, as where the system cannot do it at once.
        force: a result is there, which is to be replaced; else there is nothing.
        met: by one process after the other.
    """

    turns: bool
    force: bool
    met: tuple[Met, ...]


def chosen(number: int, calls: Mapping[tuple[bool, bool], int]) -> Round:
    """The round of that number: first a kill before every call and nothing else, then what chance brings."""
    for (turns, force), most in calls.items():
        if number < most:
            return Round(turns, force, (Met(number + 1),))
        number -= most
    chance = random.Random(number)
    (turns, force), most = chance.choice(list(calls.items()))
    met = []
    for _ in range(chance.choice((1, 1, 2, 3))):
        kill = chance.randint(1, most)
        written = (chance.randint(1, kill), chance.choice(_WAYS)) if chance.random() < 0.6 else None
        met.append(Met(kill, written))
    return Round(turns, force, tuple(met))


def play(parent: Path, what: Round) -> tuple[int, list[str]]:
    """Play a round in a new folder; how many were killed, and what was lost or left that must not be."""
    parent.mkdir()
    target = parent / "out"
    if what.force:
        swap(target, "old")
    expected = {"old", None}
    person = Person(target, os.open(target, os.O_RDONLY) if what.force else None)
    kills, wrong = 0, []
    with _by_turns(what.turns):
        for turn, met in enumerate(what.met):
            word = f"new {turn}"
            kills += traced(partial(_swapped, target, word, force=what.force), partial(_meet, met, person)) is None
            expected.add(word)
            wrong += person.misses(hidden=True)
            for again in range(2):  # a document may stand in the way of the result, and come back with it
                person.takes_away(parent / f"elsewhere {turn} {again}")
                folders.put_back(target)
            spoilt = any(each.write is not None and each.write[1] == _OVER for each in what.met)
            # Beside it, if somebody took the name while the old result did not have it.
            found = whole(target) or whole(parent / "out.old")
            lost = found is None and (what.force or (target.exists() and any(target.iterdir())))
            if not spoilt and (lost or found not in expected):
                wrong.append(f"the folder holds {found!r} of {expected}")
    code = _swapped(target, "last", force=True)
    if (code, whole(target)) != (0, "last"):
        wrong.append(f"the next start ends with {code} and leaves {whole(target)!r}")
    wrong += person.misses(hidden=False)
    names = {path.name for path in parent.iterdir()}
    if any(name.startswith(".") for name in names) or (names != {"out"} and not person.documents):
        wrong.append(f"left: {sorted(names)}")
    if person.opened is not None:
        os.close(person.opened)
    shutil.rmtree(parent)
    return kills, wrong


def _meet(met: Met, person: Person, call: int) -> bool:
    if met.write is not None and call == met.write[0]:
        person.write(met.write[1])
    return call == met.kill


def counted(parent: Path) -> dict[tuple[bool, bool], int]:
    """How many calls a swap makes, by whether names are exchanged one by one, and by whether a result is replaced."""
    told = {}
    for turns, force in itertools.product((False, True), repeat=2):
        target = parent / f"{turns} {force}" / "out"
        target.parent.mkdir()
        if force:
            swap(target, "old")
        seen = itertools.count()
        with _by_turns(turns):
            assert traced(partial(_swapped, target, "new", force=force), lambda _, seen=seen: next(seen) < 0) == 0
        told[turns, force] = next(seen)
    return told


def main(numbers: str) -> int:
    """Play rounds, one for each number; the exit status."""
    first, last = (int(each) for each in numbers.split("-")) if "-" in numbers else (0, int(numbers))
    kills, findings = 0, 0
    with tempfile.TemporaryDirectory() as name:
        calls = counted(Path(name))
        for (turns, force), most in calls.items():
            how = "one name after the other" if turns else "both names at once"
            print(f"{most} system calls to {'replace a result' if force else 'put a result in place'}, {how}")
        for number in range(first, last):
            what = chosen(number, calls)
            more, wrong = play(Path(name) / "round", what)
            kills += more
            findings += bool(wrong)
            for each in wrong:
                print(f"FINDING {number}: {each}; {what}", flush=True)
    print(f"{last - first} rounds, {kills} kills, {findings} findings")
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
