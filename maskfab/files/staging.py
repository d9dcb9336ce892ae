"""Output directories that appear whole or not at all, and take the place of nothing but an earlier result."""

from __future__ import annotations

import errno
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from maskfab.errors import OutputError
from maskfab.files.atomic import Aside, locked, make, not_writable, partial, stale
from maskfab.files.exchange import OLD, exchange, move
from maskfab.files.finished import Finished, discard, finished

_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS})
_TAKEN = frozenset({errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR})
"""Errors of the system for giving a folder the name of what is not an empty folder."""
_NEW, _TURN = ".partial", ".turn"
"""Endings of the hidden names of what is not finished, which may be removed whole, and of one result while it exchanges
names with another: of whichever has it then, nothing may be removed that its manifest does not know.
"""
_PATIENCE_S = 60.0
"""For another process that replaces the same result; it takes as long as reading it twice."""


@dataclass(frozen=True)
class Place:
    """Where an output directory is to appear, and what was there when the work began.

    Attributes:
        asked: the path as it was given.
        path: the folder itself, behind whatever links lead there.
        digest: SHA-256 of the manifest of the result that is to be replaced; None if nothing may be.
    """

    asked: Path
    path: Path
    digest: str | None


def check_target(target: Path, *, force: bool) -> Place:
    """Refuse an output directory before any work starts; first put back what a killed process had taken away.

    Args:
        target: it may exist only if it is empty, or if ``force`` lets an earlier result be replaced.
        force: replace that, once the new one is complete; anything else is never replaced.

    Raises:
        OutputError: MF401 if the place cannot be written, MF402 if it is occupied.
    """
    path = Path(os.path.realpath(target))
    try:
        return _checked(target, path, force=force)
    except OSError as error:  # a name that is too long, a folder that may not be read
        raise not_writable(target, error) from error


def _checked(target: Path, path: Path, *, force: bool) -> Place:
    put_back(path)
    if path.is_symlink():
        raise OutputError(
            "MF401", f"{target} is a link that leads nowhere", cure="Remove that link, or give --out another folder"
        )
    if path.exists() and not path.is_dir():
        raise OutputError("MF401", f"{target} is a file, not a directory", cure="Give --out the path of a folder")
    if os.path.ismount(path):
        cure = f"Choose a folder in it: --out {target / 'result'}"
        raise OutputError("MF401", f"{target} is a disk of its own, which no folder can replace", cure=cure)
    digest = None
    if path.is_dir() and any(path.iterdir()):
        digest = _replaceable(target, finished(path), force=force).digest
    parent = path.parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise OutputError("MF401", f"{parent} cannot be written", cure="Choose another --out, or mend its permissions")
    return Place(target, path, digest)


def _replaceable(target: Path, found: Finished | None, *, force: bool) -> Finished:
    if found is None:
        raise OutputError(
            "MF402",
            f"the directory {target} is not empty and holds no maskfab result",
            cure="Name a new or empty folder",
        )
    if not force:
        raise OutputError(
            "MF402",
            f"the output directory {target} is not empty",
            cure="Add --force to replace it, or choose another",
        )
    if found.strange:
        raise OutputError(
            "MF402",
            f"the output directory {target} holds {found.strange[0]!r}, which maskfab did not write, or not so",
            cure="Move it elsewhere, or choose another --out",
        )
    return found


@contextmanager
def staged(place: Place) -> Iterator[Path]:
    """A directory to write into; it becomes ``place`` on success, and is removed on failure.

    Where something has come there meanwhile, or an earlier result was changed, both stay, under names that are told.

    Raises:
        OutputError: MF401 if the place cannot be written or has no room left, MF404 if it is no longer as it was.
    """
    target = place.path
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _sweep(target)
        aside = make(target, _NEW, os.mkdir)
    except OSError as error:
        raise not_writable(place.asked, error) from error
    try:
        yield aside.path
        _put(aside, place)
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise not_writable(place.asked, error) from error
        raise
    finally:
        _clear(aside, place)
        aside.close()


def _put(aside: Aside, place: Place) -> None:
    """Give the finished directory its name, in place of nothing, of an empty folder, or of the result found before."""
    if Path(os.path.realpath(place.asked)) != place.path:
        _stop(aside, place, "leads elsewhere by now")
    begun = time.monotonic()
    try:
        while not _renamed(aside, place):
            if place.digest is None:
                _stop(aside, place, "is no longer empty")
            if time.monotonic() - begun > _PATIENCE_S:
                _stop(aside, place, "is held by another process")
            # Locked, so that nobody else replaces it, or takes it for a leftover while it has the hidden name.
            try:
                descriptor = locked(place.path)
            except (BlockingIOError, FileNotFoundError):
                time.sleep(0.01)
                continue
            except OSError:
                descriptor = None
            try:
                _replace(aside, place)
            finally:
                if descriptor is not None:
                    os.close(descriptor)
            return
    except OSError as error:
        raise not_writable(place.asked, error) from error


def _renamed(aside: Aside, place: Place) -> bool:
    """Whether nothing but an empty folder was in the way."""
    try:
        os.rename(aside.path, place.path)
    except OSError as error:
        if error.errno in _TAKEN:
            return False
        raise
    return True


def _replace(aside: Aside, place: Place) -> None:
    """Exchange old for new, and remove the old one.

    It is looked at again when nobody can reach it any more under its name, for something may have come until then.
    """
    if _unchanged(place.path, place) is not None:
        new, aside = aside, _in_turn(aside)
        os.rename(new.path, aside.path)
        exchange(aside.path, place.path)
        found = _unchanged(aside.path, place)
        if found is not None:
            kept = discard(aside.path, place.path, found)
            if kept is not None:
                raise OutputError(
                    "MF405",
                    f"the new result lies in {place.asked}; the old one was changed while it was replaced, and the "
                    f"rest of it lies in {kept}",
                    cure="Keep what you need of it, and delete the rest",
                )
            return
        exchange(aside.path, place.path)
    _stop(aside, place, "no longer holds what was to be replaced, or more than that")


def _unchanged(folder: Path, place: Place) -> Finished | None:
    """The result that was found before, if it is that one and all that there is."""
    found = None if folder.is_symlink() else finished(folder)
    return None if found is None or found.strange or found.digest != place.digest else found


def _stop(aside: Aside, place: Place, why: str) -> NoReturn:
    kept = move(aside.path, place.path, "new")
    raise OutputError(
        "MF404", f"{place.asked} {why}: it stays as it is, and the new result lies in {kept}",
        cure="Move one of them to where you want it",
    )  # fmt: skip


def _in_turn(aside: Aside) -> Aside:
    return replace(aside, path=aside.path.with_suffix(_TURN))


def _clear(aside: Aside, place: Place) -> None:
    """Remove what an interruption leaves under the hidden names: the new result, finished or not, or the old one."""
    turn = _in_turn(aside)
    if turn.is_there():
        os.rename(turn.path, aside.path)
    else:
        _discard_old(turn.path, place.path)
    if aside.is_there():
        shutil.rmtree(aside.path, ignore_errors=True)


def _sweep(target: Path) -> None:
    """Remove what killed processes have left: unfinished directories, and results that had been replaced."""
    for left in stale(target, _NEW):
        shutil.rmtree(left, ignore_errors=True)
    for left in stale(target, _TURN):
        _discard_old(left, target)
    for holder in stale(target, OLD):
        _discard_old(holder / target.name, target)
        with suppress(OSError):
            holder.rmdir()


def _discard_old(folder: Path, target: Path) -> None:
    with suppress(OSError):
        discard(folder, target, finished(folder))


def put_back(target: Path) -> None:
    """Give a result its name again if a process was killed while it replaced it, where that takes several renames."""
    if target.parent.is_dir():
        for holder in stale(target, OLD):
            with suppress(OSError):
                os.rename(holder / target.name, target)  # which succeeds in place of nothing, or of an empty folder
                holder.rmdir()
                return


def check_file(target: Path, *, force: bool) -> None:
    """Refuse to write a file over another, or where nothing can be written (MF401, MF402)."""
    try:
        _check_file(target, force=force)
    except OSError as error:
        raise not_writable(target, error) from error


def _check_file(target: Path, *, force: bool) -> None:
    if target.is_dir():
        raise OutputError("MF401", f"{target} is a directory", cure="Give --out the path of a file")
    if target.exists() and not target.is_file():
        raise OutputError(
            "MF401", f"{target} is a device, which no file can replace", cure="Give --out the path of an ordinary file"
        )
    if target.exists() and not force:
        raise OutputError("MF402", f"{target} exists", cure="Add --force to replace it, or choose another --out")
    path = Path(os.path.realpath(target))
    if path.is_symlink():
        raise OutputError(
            "MF401", f"{target} is a link that leads nowhere", cure="Remove that link, or give --out another path"
        )
    parent = path.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise OutputError("MF401", f"{target} cannot be written", cure="Choose a directory that exists and is writable")


def write_text(target: Path, text: str, *, replace: bool = True) -> None:
    """Write a text in UTF-8 as :func:`write_bytes` does."""
    write_bytes(target, text.encode(), replace=replace)


def write_bytes(target: Path, content: bytes, *, replace: bool = True) -> None:
    """Write a file so that it is never half-written; raises as :func:`maskfab.files.atomic.partial`."""
    with partial(target, replace=replace) as aside:
        aside.write_bytes(content)
