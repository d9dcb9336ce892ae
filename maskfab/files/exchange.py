"""Two folders exchange their names: at once where the system can, through a third name elsewhere."""

from __future__ import annotations

import ctypes
import errno
import os
from contextlib import suppress
from pathlib import Path

from maskfab.files.atomic import free_name, make

OLD = ".old"
"""Ending of the third name; the folder of that name holds the second under its own."""
_HERE, _EXCHANGE = -100, 2
"""AT_FDCWD and RENAME_EXCHANGE of renameat2(2)."""
_UNKNOWN = frozenset({errno.ENOSYS, errno.EINVAL, errno.EPERM, errno.EOPNOTSUPP})
"""Errors of systems that cannot exchange names; EPERM is a sandbox's word for a call that it does not know."""


def exchange(one: Path, other: Path) -> None:
    """Exchange the names of two folders of one parent.

    Raises:
        OSError: if a name cannot be changed; both have then the names that they had.
    """
    if not _at_once(one, other):
        _by_turns(one, other)


def _at_once(one: Path, other: Path) -> bool:
    """Whether the system could exchange them in one step."""
    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):
        return False
    if call(_HERE, ctypes.c_char_p(os.fsencode(one)), _HERE, ctypes.c_char_p(os.fsencode(other)), _EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNKNOWN:
        return False
    raise OSError(number, os.strerror(number), str(other))


def _by_turns(one: Path, other: Path) -> None:
    """Exchange them by three renames; a process that is killed in between leaves what :data:`OLD` names."""
    holder = make(other, OLD, os.mkdir)
    held = holder.path / other.name
    try:
        os.rename(other, held)
        try:
            os.rename(one, other)
        except OSError:
            _back(held, other)
            raise
        os.rename(held, one)
    finally:
        with suppress(OSError):  # where a name could not be given back, or the result not get another
            os.rmdir(holder.path)
        holder.close()


def _back(held: Path, other: Path) -> None:
    """Give a folder its name again, or a name that everybody sees if somebody has taken its own."""
    try:
        os.rename(held, other)
    except OSError:
        move(held, other, "old")
        raise


def move(folder: Path, beside: Path, word: str) -> Path:
    """Give a folder a name beside another that nobody has, and return it."""
    for name in free_name(beside, word):
        try:
            os.mkdir(name)
        except FileExistsError:
            continue
        os.rename(folder, name)
        return name
    raise AssertionError
