"""Files and folders that are made under a hidden name beside the one they will have, and appear whole or not at all.

What is made aside is locked by the process that makes it; the system ends the lock with the process, however that
ends. Whatever has no lock is thus a dead process's, and the next that writes under the same name takes it away.

A run that may be cut off anywhere keeps its state in such a file, plain arrays without code, and goes on from it to the
same result.
"""

from __future__ import annotations

import os
import re
import secrets
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import write_arrays
from maskfab.base.errors import OutputError, SourceError

try:
    import fcntl
except ImportError:  # not on Windows; there nothing is locked, and nothing taken away
    fcntl = None  # type: ignore[assignment]


@dataclass(frozen=True)
class Aside:
    """A file or folder that this process makes, under its hidden name.

    Attributes:
        path: the hidden name; by the time it is closed, something else may have it.
        status: of what was made.
        descriptor: through which it is locked; None where nothing can be locked.
    """

    path: Path
    status: os.stat_result
    descriptor: int | None

    def is_there(self) -> bool:
        """Whether the hidden name is still that of what was made."""
        return _is_at(self.status, self.path)

    def close(self) -> None:
        """End the lock."""
        if self.descriptor is not None:
            os.close(self.descriptor)


def make(target: Path, ending: str, create: Callable[[Path], object]) -> Aside:
    """Something new beside ``target``, made by ``create`` and locked."""
    while True:
        path = target.with_name(f".{target.name}.{secrets.token_hex(4)}{ending}")
        create(path)
        try:
            descriptor = locked(path)
        except (BlockingIOError, FileNotFoundError):
            continue  # swept before it was locked
        except OSError:
            descriptor = None
        return Aside(path, path.lstat(), descriptor)


def make_file(path: Path) -> None:
    """An empty file of that name, which must be free."""
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))


def locked(path: Path) -> int:
    """A descriptor of a file or folder, which stays locked until it is closed or the process ends.

    Raises:
        BlockingIOError: if another process has locked it.
        FileNotFoundError: if it is not there, or no longer.
        OSError: if it cannot be locked on this system, or is a link.
    """
    if fcntl is None:
        raise OSError("this system has no locks of files")
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not _is_at(os.fstat(descriptor), path):
            raise FileNotFoundError(path)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _is_at(status: os.stat_result, path: Path) -> bool:
    try:
        return os.path.samestat(status, path.lstat())
    except FileNotFoundError:
        return False


def stale(target: Path, ending: str) -> Iterator[Path]:
    """Leftovers of dead processes beside ``target``, the latest first, each locked while the caller deals with it."""
    pattern = re.compile(rf"\.{re.escape(target.name)}\.[a-z0-9_]{{8}}{re.escape(ending)}")
    left = [path for path in target.parent.iterdir() if pattern.fullmatch(path.name)]
    for path in sorted(left, key=_changed_at, reverse=True):
        try:
            descriptor = locked(path)
        except OSError:
            continue
        try:
            yield path
        finally:
            os.close(descriptor)


def _changed_at(path: Path) -> int:
    try:
        return path.lstat().st_mtime_ns
    except FileNotFoundError:
        return 0


def free_name(target: Path, word: str) -> Iterator[Path]:
    """Names beside ``target`` for what nobody may lose: ``NAME.word``, and with a number if that is taken."""
    for number in count(1):
        ending = word if number == 1 else f"{word}-{number}"
        yield target.with_name(f"{target.stem}.{ending}{target.suffix}")


def not_writable(target: Path, error: OSError) -> OutputError:
    """MF401 of what the system said."""
    what = f"{target} cannot be written: {error.strerror or error}"
    return OutputError("MF401", what, cure="Give --out a path in a writable folder with room to spare")


@contextmanager
def writing(target: Path) -> Iterator[None]:
    """Refuse what the system does not let happen there: OutputError MF401."""
    try:
        yield
    except OSError as error:
        raise not_writable(target, error) from error


@contextmanager
def partial(path: Path, *, replace: bool = True) -> Iterator[Path]:
    """A name beside ``path`` to write a file to; renamed to ``path`` on success, removed on failure.

    A link stays; what it points to is written.

    Args:
        replace: whether it takes the place of a file that is there.

    Raises:
        OutputError: MF401 if the place cannot be written, or has no room left; MF404 if another file is there by now
            and is not to be replaced.
    """
    target = Path(os.path.realpath(path))
    ending = f".partial{target.suffix}"
    with writing(path):
        for left in stale(target, ending):
            if left.is_file():
                left.unlink()
        aside = make(target, ending, make_file)
    try:
        with writing(path):
            yield aside.path
            if replace:
                os.replace(aside.path, target)
            else:
                _add(aside.path, target)
    finally:
        aside.path.unlink(missing_ok=True)
        aside.close()


def _add(aside: Path, target: Path) -> None:
    """Give a finished file its name, or if that is taken by now, another that is told."""
    if _linked(aside, target):
        return
    place = next(name for name in free_name(target, "new") if _linked(aside, name))
    raise OutputError(
        "MF404", f"{target} was written by another program meanwhile and is kept; the new result lies in {place}",
        cure="Keep the one that you want",
    )  # fmt: skip


def _linked(aside: Path, target: Path) -> bool:
    """Whether the name was free; it is then that of the file."""
    try:
        os.link(aside, target)
    except FileExistsError:
        return False
    except OSError:  # a system of files without links
        if os.path.lexists(target):
            return False
        os.rename(aside, target)
    return True


State = Mapping[str, NDArray[np.generic]]
RUN = "run"
"""Name of what tells a run from every other."""


def save_state(path: Path, run: str, state: State) -> None:
    """Keep the state of a run.

    Args:
        path: of the file; its directory exists.
        run: what tells this run from every other.
        state: arrays by name.

    Raises:
        OutputError: MF401 if the file cannot be written.
    """
    with partial(path) as aside, aside.open("wb") as file:
        write_arrays(file, {RUN: np.array(run), **state})
        file.flush()
        os.fsync(file.fileno())


def read_state(path: Path) -> dict[str, NDArray[np.generic]]:
    """All arrays of a file that :func:`save_state` wrote, by name; MF303 if it is damaged."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except (OSError, ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        what = "the checkpoint is damaged"
        raise SourceError("MF303", what, where=str(path), cure="Delete it and start again") from error


PACKED = ".gz"


def suffix_of(path: Path) -> str:
    """The suffix of a file in small letters; of one that is packed by gzip that of its content, as of ``x.gds.gz``."""
    return Path(path.name.lower().removesuffix(PACKED)).suffix


def no_file(path: str | Path, shown: str | Path) -> str:
    """Words on a path, as it is shown, where a file is meant and there is none."""
    return f"{shown} is a folder, and a file is meant" if os.path.isdir(path) else f"there is no file {shown}"


def load_state(path: Path, run: str) -> dict[str, NDArray[np.generic]] | None:
    """The state that :func:`save_state` kept, None without a file; MF303 if damaged, MF304 if another run's."""
    if not os.path.exists(path):
        return None
    state = read_state(path)
    if RUN not in state or str(state.pop(RUN)) != run:
        what = "the checkpoint belongs to another run"
        raise SourceError("MF304", what, where=str(path), cure="Give the settings it was made with, or delete it")
    return state


@dataclass(frozen=True, eq=False)
class Kept:
    """A checkpoint that grows from stage to stage of a run.

    Attributes:
        path: of the file; its directory exists.
        key: what tells the run from every other.
        state: what is known of it so far, read from the file.

    Raises:
        SourceError: MF303, MF304 as :func:`load`.
    """

    path: Path
    key: str
    state: dict[str, NDArray[np.generic]] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.state.update(load_state(self.path, self.key) or {})

    def put(self, arrays: State) -> None:
        """Add these, or replace those of the same names, and save all; MF401 as :func:`save`."""
        self.state.update(arrays)
        save_state(self.path, self.key, self.state)
