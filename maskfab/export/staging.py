"""Output directories that appear whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maskfab.errors import OutputError

_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS})
RESULT_MARK = "manifest.json"
"""The file that every finished output directory has."""


@contextmanager
def staged(target: Path, *, force: bool) -> Iterator[Path]:
    """A directory beside ``target`` to write into; renamed to ``target`` on success, removed on failure.

    Args:
        target: the output directory; it may exist only if it is empty, or if ``force`` lets it be replaced.
        force: replace an earlier result, once the new one is complete; anything else is never replaced.

    Raises:
        OutputError: MF401 if the place cannot be written or has no room left, MF402 if it is occupied.
    """
    check_target(target, force=force)
    target = target.absolute()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        aside = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".partial", dir=target.parent))
    except OSError as error:
        raise _not_writable(target, error) from error
    try:
        yield aside
        aside.chmod(0o777 & ~_umask())
        _replace(aside, target)
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise _not_writable(target, error) from error
        raise
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def check_target(target: Path, *, force: bool) -> None:
    """Refuse an output directory before any work starts; raises as :func:`staged` does."""
    if target.exists() and not target.is_dir():
        raise OutputError("MF401", f"{target} is a file, not a directory", cure="Choose another --out")
    if target.is_dir() and any(target.iterdir()):
        strange = _strangers(target)
        if strange is None:
            raise OutputError(
                "MF402", f"the directory {target} is not empty and holds no maskfab result", cure="Choose another --out"
            )
        if strange and force:
            raise OutputError(
                "MF402",
                f"the output directory {target} holds {strange[0]!r}, which maskfab did not write",
                cure="Move it elsewhere, or choose another --out",
            )
        if not force:
            raise OutputError(
                "MF402",
                f"the output directory {target} is not empty",
                cure="Add --force to replace it, or choose another",
            )
    parent = target.absolute()
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise OutputError("MF401", f"{parent} cannot be written", cure="Choose another --out, or mend its permissions")


def _strangers(target: Path) -> list[str] | None:
    """What lies in a finished output directory besides the result; None if it is not one."""
    try:
        manifest = json.loads((target / RESULT_MARK).read_text(encoding="utf-8"))
        own = {RESULT_MARK, *(file["path"] for file in manifest["files"])} if "maskfab_version" in manifest else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return None if own is None else sorted({path.name for path in target.iterdir()} - own)


def _replace(aside: Path, target: Path) -> None:
    try:
        if target.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".old", dir=target.parent))
            target.rename(old / target.name)
            aside.rename(target)
            shutil.rmtree(old)
        else:
            aside.rename(target)
    except OSError as error:
        raise _not_writable(target, error) from error


def _not_writable(target: Path, error: OSError) -> OutputError:
    return OutputError("MF401", f"{target} cannot be written: {error.strerror or error}", cure="Choose another --out")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def check_file(target: Path, *, force: bool) -> None:
    """Refuse to write a file over another, or where nothing can be written (MF401, MF402)."""
    if target.is_dir():
        raise OutputError("MF401", f"{target} is a directory", cure="Choose another --out")
    if target.exists() and not force:
        raise OutputError("MF402", f"{target} exists", cure="Add --force to replace it, or choose another --out")
    if not target.absolute().parent.is_dir() or not os.access(target.absolute().parent, os.W_OK | os.X_OK):
        raise OutputError("MF401", f"{target} cannot be written", cure="Choose a directory that exists and is writable")


def write_text(target: Path, text: str) -> None:
    """Write a text in UTF-8 as :func:`write_bytes` does."""
    write_bytes(target, text.encode())


def write_bytes(target: Path, content: bytes) -> None:
    """Write a file aside and rename it, so that it is never half-written (MF401 if that fails)."""
    aside = target.with_name(f".{target.name}.{os.getpid()}.partial")
    try:
        aside.write_bytes(content)
        os.replace(aside, target)
    except OSError as error:
        raise _not_writable(target, error) from error
    finally:
        aside.unlink(missing_ok=True)
