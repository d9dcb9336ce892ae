"""Somebody interferes before each system call of a swap in turn: kills it, or puts a document into the folder.

Run as ``python swaps.py FOLDER STEP`` for every call of so many; prints as JSON the state of the folder after each
round, by what was done and how names are exchanged. Python tells an audit hook of every call that it makes to the
system.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from maskfab.base import folders
from maskfab.base.errors import OutputError
from maskfab.base.folders import times_text

EVENTS = ("os.", "open", "shutil.rmtree", "ctypes.dl", "fcntl.flock")
NOTE = "what somebody wrote"


def write_result(folder: Path, word: str, *names: str) -> None:
    rows = []
    for name in names or ("a.txt", "b.txt"):
        (folder / name).write_text(f"{word} {name}")
        digest = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        rows.append({"path": name, "sha256": digest})
    (folder / "manifest.json").write_text(json.dumps({"maskfab_version": word, "files": rows}))
    (folder / "timing.json").write_text(times_text("None", {"optics": 1.25}))


def swap(target: Path, word: str, *, force: bool = True, meanwhile: Callable[[], object] = lambda: None) -> None:
    with folders.staged(folders.check_target(target, force=force)) as folder:
        write_result(folder, word)
        meanwhile()


def whole(folder: Path) -> str | None:
    """Which result a folder holds; None if it is not one whole result."""
    found = folders.finished(folder)
    if found is None or found.strange or len(found.own) != 4:
        return None
    return str(json.loads((folder / "manifest.json").read_text())["maskfab_version"])


def interfered(target: Path, number: int, interfere: Callable[[], None]) -> int:
    """Exit status of a process that swaps, and is interfered with before its call of that number; 9 if it has fewer."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    place, seen, busy = folders.check_target(target, force=True), 0, False

    def hook(event: str, _: object) -> None:
        nonlocal seen, busy
        if busy or not event.startswith(EVENTS):
            return
        seen += 1
        if seen == number:
            busy = True
            interfere()
            busy = False

    code = 0
    try:
        with folders.staged(place) as folder:
            write_result(folder, "new")
            sys.addaudithook(hook)
    except OutputError:
        code = 2
    except SystemExit:
        code = 143
    finally:
        os._exit(code if seen >= number else 9)


def rounds(root: Path, how: str, step: int) -> list[dict[str, object]]:
    """One round for each call of so many."""
    told, number = [], 1 - step
    while True:
        number += step
        parent = root / "round"
        target = parent / "out"
        parent.mkdir()
        swap(target, "old")

        def terminate(*_: object) -> None:
            raise SystemExit(143)

        def write(name: str, target: Path = target) -> None:
            try:
                (target / name).write_text(NOTE)
            except FileNotFoundError:
                (target.parent / "late.txt").write_text(NOTE)

        ways = {
            "kill": lambda: os.kill(os.getpid(), signal.SIGKILL),
            "signal": terminate,
            "add": lambda: write("note.txt"),
            "change": lambda: write("a.txt"),
        }
        code = interfered(target, number, ways[how])
        if code == 9:
            shutil.rmtree(parent)
            return told
        names = [path.name for path in parent.iterdir()]
        notes = sum(path.is_file() and path.read_text() == NOTE for path in parent.rglob("*"))
        at_once = whole(target)
        folders.put_back(target)
        recovered = whole(target)
        results = [whole(path) for path in parent.iterdir() if path.name == "out.new"]
        if how in ("kill", "signal"):
            swap(target, "next")
        left = [path.name for path in parent.iterdir()]
        told.append(
            {"number": number, "code": code, "names": names, "notes": notes, "at_once": at_once,
             "recovered": recovered, "new": results, "left": left}
        )  # fmt: skip
        shutil.rmtree(parent)


if __name__ == "__main__":
    at_once = folders._at_once
    told = {}
    for kind, call in {"exchange": at_once, "renames": lambda one, other: False}.items():
        folders._at_once = call
        for how in ("kill", "signal", "add", "change"):
            told[f"{how} {kind}"] = rounds(Path(sys.argv[1]), how, int(sys.argv[2]))
    print(json.dumps(told))
