"""A folder of findings by fingerprint, each checked by its own hash before it is used.

What cannot be written is not kept, and what cannot be read is found anew: no run fails by its cache.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import pickle
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maskfab.errors import OutputError
from maskfab.files.atomic import locked, partial
from maskfab.files.pickling import pickled

VARIABLE = "MASKFAB_CACHE"
"""Environment variable: the folder, or "off"."""
_OFF = "off"
_FORM = 1
_MOST_HEADER = 1000
_AT_A_TIME = 1 << 20
LIMIT_BYTES = 4 << 30
"""Beyond which what was used longest ago is removed."""


@dataclass(frozen=True)
class Entry:
    """One finding that is kept.

    Attributes:
        path: of its file.
        what: it is, in words.
        bytes: of the file.
        used: when it was used last, seconds since 1970.
        seconds: of a processor that finding it took; None if it does not say.
        expected_s: that it was expected to take on the machine of the reference numbers; None likewise.
    """

    path: Path
    what: str
    bytes: int
    used: float
    seconds: float | None = None
    expected_s: float | None = None


@dataclass(frozen=True)
class Store:
    """Findings in a folder that only its owner may write: they are pickles, which may run anything."""

    folder: Path

    @classmethod
    def of_user(cls) -> Store | None:
        """The user's own: ``$MASKFAB_CACHE``, else ``maskfab`` in ``$XDG_CACHE_HOME`` or ``~/.cache``; None if off, or
        if there is no place for it."""
        stated = os.environ.get(VARIABLE, "")
        if stated == _OFF:
            return None
        try:
            base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
            folder = Path(stated).absolute() if stated else base / "maskfab"
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            status = folder.stat()
        except (OSError, RuntimeError):
            return None
        foreign = hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & 0o022)
        return None if foreign else cls(folder)

    def has(self, key: str) -> bool:
        """Whether something is kept under a fingerprint, which may yet turn out to be damaged."""
        return self._path(key).is_file()

    def get(self, key: str) -> Any:
        """The finding kept under a fingerprint, in a tuple of one; None if there is none, or only a damaged one."""
        path = self._path(key)
        try:
            content = path.read_bytes()
            head, _, body = content.partition(b"\n")
            if json.loads(head)["sha256"] != hashlib.sha256(body).hexdigest():
                raise ValueError(key)
            found = (pickle.loads(body),)
            os.utime(path)
        except FileNotFoundError:
            return None
        except Exception:  # of a damaged file anything may come
            with suppress(OSError):
                path.unlink()
            return None
        return found

    def put(
        self, key: str, what: str, content: object, seconds: float | None = None, expected_s: float | None = None
    ) -> None:
        """Keep a finding, and what it took; one that no other process can be given is not kept."""
        try:
            body = pickled(content)
        except (TypeError, AttributeError, pickle.PicklingError):
            return
        head: dict[str, Any] = {"form": _FORM, "what": what, "sha256": hashlib.sha256(body).hexdigest()}
        head |= {} if seconds is None else {"seconds": round(seconds, 4), "expected_s": expected_s}
        with suppress(OSError, OutputError):
            path = self._path(key)
            path.parent.mkdir(exist_ok=True)
            with partial(path) as aside:
                aside.write_bytes(json.dumps(head).encode() + b"\n" + body)

    def give_file(self, sha256: str, path: Path) -> bool:
        """Copy a kept file to ``path``; False, and nothing there, if it is not kept or no longer what it was.

        Raises:
            OSError: if ``path`` cannot be written.
        """
        kept = self._path(sha256)
        try:
            source = kept.open("rb")
        except OSError:
            return False
        with source:
            found = hashlib.sha256()
            with path.open("xb") as copy:
                while some := source.read(_AT_A_TIME):
                    found.update(some)
                    copy.write(some)
        if found.hexdigest() == sha256:
            with suppress(OSError):
                os.utime(kept)
            return True
        path.unlink()
        with suppress(OSError):
            kept.unlink()
        return False

    def keep_file(self, sha256: str, path: Path) -> None:
        """Keep a copy of a file whose hash is known."""
        kept = self._path(sha256)
        if kept.exists():
            return
        with suppress(OSError, OutputError):
            kept.parent.mkdir(exist_ok=True)
            with partial(kept) as aside, path.open("rb") as source, aside.open("wb") as copy:
                while some := source.read(_AT_A_TIME):
                    copy.write(some)

    def entries(self) -> Iterator[Entry]:
        """Everything that is kept."""
        for path, status in self._files():
            with suppress(OSError):
                yield _entry(path, status)

    def prune(self, limit_bytes: int = LIMIT_BYTES) -> tuple[Entry, ...]:
        """Remove what was used longest ago, until the rest takes no more than so many bytes.

        Every run asks for it, so only what is removed is opened.

        Returns:
            What was removed.
        """
        every = sorted(self._files(), key=lambda each: each[1].st_mtime, reverse=True)
        for left in self.folder.glob("[0-9a-f][0-9a-f]/.*.partial"):
            _sweep(left)
        removed, total = [], 0
        for path, status in every:
            total += status.st_size
            if total > limit_bytes:
                with suppress(OSError):
                    entry = _entry(path, status)
                    path.unlink()
                    removed.append(entry)
        return tuple(removed)

    def _files(self) -> Iterator[tuple[Path, os.stat_result]]:
        """Files of all entries."""
        for path in sorted(self.folder.glob("[0-9a-f][0-9a-f]/" + "[0-9a-f]" * 64)):
            with suppress(OSError):
                yield path, path.stat()

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / key


def _sweep(left: Path) -> None:
    """Remove what a process has not finished, if that has ended."""
    with suppress(OSError):
        descriptor = locked(left)
        try:
            left.unlink()
        finally:
            os.close(descriptor)


def _entry(path: Path, status: os.stat_result) -> Entry:
    what, seconds, expected_s = _told(path)
    return Entry(path, what, status.st_size, status.st_mtime, seconds, expected_s)


def _told(path: Path) -> tuple[str, float | None, float | None]:
    """Words in which an entry says what it is, and seconds; a kept file says nothing."""
    with path.open("rb") as stream:
        head = stream.readline(_MOST_HEADER)
    try:
        told = json.loads(head)
        return str(told["what"]), _number(told.get("seconds")), _number(told.get("expected_s"))
    except (ValueError, KeyError, TypeError, AttributeError):
        return "file", None, None


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and 0 <= value < math.inf else None
