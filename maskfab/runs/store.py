"""Findings that are kept: one folder of theirs, whole output directories, and the cases of sweeps.

What a finding was found from is known by fingerprints, equal only for values from which the same is found. An entry is
one file: the SHA-256 of the rest, a line of JSON that says what it was found from, and the finding as plain data (see
:mod:`maskfab.base.plain_data`): whoever wrote it, nothing in it is run. It is checked before it is used. What cannot be
written is not kept, and what is refused is found anew: no run fails by its cache.

An unchanged job is made once, for its output directory is kept whole. The cases of a sweep are files beside it, each
under the hash of what it was found from.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import os
import stat
import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import UTC, date, datetime
from enum import Enum
from itertools import chain
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import Any, BinaryIO, Protocol, TypeAlias

import numpy as np
from pydantic import BaseModel

from maskfab.base import __version__, provenance, resources
from maskfab.base.errors import OutputError
from maskfab.base.files import locked, partial, writing
from maskfab.base.folders import TIMES
from maskfab.base.plain_data import from_data, to_data
from maskfab.base.provenance import sha256_of_file

_PLAIN = frozenset({int, float, bool, str, type(None)})


class _Sum(Protocol):
    def update(self, data: bytes, /) -> None: ...


def fingerprint(*values: object) -> str:
    """Hexadecimal SHA-256 of values and types, in a mapping's order: what is made of it may keep that order."""
    total = hashlib.sha256()
    for value in values:
        _add(total, value)
    return total.hexdigest()


@functools.cache
def of_installation() -> str:
    """Hexadecimal SHA-256 of this program's own files and of the versions of all libraries that it uses."""
    total = hashlib.sha256()
    _add(total, sorted(provenance.versions(extras=True).items()))
    for folder in (Path(resources.__file__).resolve().parents[1], resources.path("export_templates")):
        for path in sorted(file for file in folder.rglob("*") if file.is_file() and file.suffix != ".pyc"):
            _add(total, (path.relative_to(folder).as_posix(), path.read_bytes()))
    return total.hexdigest()


def _add(total: _Sum, value: object) -> None:
    kind, content = _leaf(value) or _parts(value)
    if isinstance(content, bytes):
        # Kind and length come first, so that no two sequences of values read alike.
        total.update(f"{kind} {len(content)}\n".encode() + content)
        return
    total.update(f"{kind} of {len(content)}\n".encode())
    for part in content:
        _add(total, part)


def _leaf(value: object) -> tuple[str, bytes] | None:
    """Kind and content of a value that has no parts; None of one that has."""
    match value:
        case date():
            return type(value).__name__, value.isoformat().encode()
        case Enum():
            return _name(type(value)), value.name.encode()
        case None | bool() | int():
            return type(value).__name__, repr(value).encode()
        case float():
            return "float", struct.pack("<d", value)
        case complex():
            return "complex", struct.pack("<dd", value.real, value.imag)
        case str():
            return "str", value.encode("utf-8", "surrogatepass")
        case bytes():
            return "bytes", value
        case np.generic() | np.ndarray():
            return _array(np.asarray(value))
        case FunctionType() | BuiltinFunctionType() | type():
            if "<" in value.__qualname__:
                raise TypeError(f"the function {value.__qualname__} has no name to be found by")
            return "function", f"{value.__module__}.{value.__qualname__}".encode()
        case tuple() if _is_plain(value):
            return "plain", repr(value).encode("utf-8", "surrogatepass")
    return _region(value)


def _region(value: object) -> tuple[str, bytes] | None:
    """Kind and content of a region; None of anything else, for which klayout need not be loaded."""
    if not type(value).__module__.startswith("klayout."):
        return None
    from klayout import db

    return ("region", value.to_s(2**31 - 1).encode()) if isinstance(value, db.Region) else None


def _parts(value: object) -> tuple[str, list[Any]]:
    name = _name(type(value))
    match value:
        case tuple() | list():
            return name, list(value)
        case frozenset() | set():
            return name, sorted(fingerprint(item) for item in value)
        case Mapping():
            return "mapping", list(value.items())
        case functools.partial():
            return name, [value.func, value.args, value.keywords]
        case BaseModel():
            return name, [(field, getattr(value, field)) for field in type(value).model_fields]
        case _ if is_dataclass(value):
            return name, [(field.name, getattr(value, field.name)) for field in fields(value)]
    raise TypeError(f"a {name} has no fingerprint")


def _is_plain(value: tuple[Any, ...]) -> bool:
    """Whether a tuple, such as the vertices of a polygon, holds nothing but words and numbers, or tuples of them."""
    kinds = set(map(type, value))
    if kinds == {tuple}:
        kinds = set(map(type, chain.from_iterable(value)))
    return type(value) is tuple and kinds <= _PLAIN


def _array(array: np.ndarray[Any, Any]) -> tuple[str, bytes]:
    if array.dtype.hasobject:
        raise TypeError("an array of objects has no fingerprint")
    # Sums depend on the order in memory, so arrays that only compare equal are told apart.
    order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
    return f"array {array.dtype.str} {array.shape} {order}", array.tobytes()


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


VARIABLE = "MASKFAB_CACHE"
"""Environment variable: the folder, or "off"."""
_OFF = "off"
_FORM = 2
_DIGEST = 64
_MOST_HEADER = 100_000
_AT_A_TIME = 1 << 20
_OTHERS = 0o022
# A link may lead anywhere, and opening a pipe would wait for whoever writes to it.
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
LIMIT_BYTES = 4 << 30
"""Beyond which what was used longest ago is removed."""


@dataclass(frozen=True)
class Origin:
    """Everything that a finding depends on: fingerprints of the installation, the function, each of its arguments."""

    what: str
    parts: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hexadecimal SHA-256 of it, under which the finding is kept."""
        return fingerprint(self.what, self.parts)


@dataclass(frozen=True)
class KeptFinding:
    """A finding that was kept, since when, UTC by ISO 8601."""

    value: Any
    since: str
    version: str


@dataclass(frozen=True)
class Refused:
    """An entry that is there and is not used."""

    why: str


@dataclass(frozen=True)
class Entry:
    """One finding that is kept.

    Attributes:
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


class _RefusedError(Exception):
    """An entry cannot be used."""


@dataclass(frozen=True)
class Store:
    """Findings in a folder that only its owner may write."""

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
            _require_own(folder.stat(), "the cache")
        except (OSError, RuntimeError, _RefusedError):
            return None
        return cls(folder)

    def has(self, origin: Origin) -> bool:
        """Whether something is kept of an origin, which may yet turn out to be refused."""
        return self._path(origin.key).is_file()

    def get(self, origin: Origin, kind: Any) -> KeptFinding | Refused | None:
        """The finding of an origin; None if there is no entry."""
        path = self._path(origin.key)
        try:
            with self._opened(path) as stream:
                digest, content = stream.read(_DIGEST).decode(errors="replace"), stream.read()
            if digest != hashlib.sha256(content).hexdigest():
                raise _RefusedError("its content is not what was written")
            head, _, body = content.partition(b"\n")
            facts = json.loads(head)
            if (facts["form"], facts["key"], facts["what"], facts["from"]) != (
                _FORM,
                origin.key,
                origin.what,
                list(origin.parts),
            ):
                raise _RefusedError("it was found from something else")
            finding = KeptFinding(from_data(body, kind), str(facts["found"]), str(facts["version"]))
            with suppress(OSError):
                os.utime(path)
        except FileNotFoundError:
            return None
        except Exception as error:  # of a damaged file anything may come
            with suppress(OSError):
                path.unlink()
            return Refused(str(error) if isinstance(error, _RefusedError) else f"it cannot be read: {error!r:.100}")
        return finding

    def put(
        self, origin: Origin, content: object, kind: Any, seconds: float | None = None, expected_s: float | None = None
    ) -> str:
        """Keep a finding, and what it took; one that is no plain data is not kept.

        Returns:
            When it was found, UTC by ISO 8601.
        """
        since = datetime.now(UTC).isoformat(timespec="seconds")
        try:
            body = to_data(content, kind)
        except TypeError:
            return since
        head: dict[str, Any] = {"form": _FORM, "key": origin.key, "what": origin.what, "from": origin.parts}
        head |= {"found": since, "version": __version__}
        head |= {} if seconds is None else {"seconds": round(seconds, 4), "expected_s": expected_s}
        rest = json.dumps(head).encode() + b"\n" + body
        with suppress(OSError, OutputError):
            path = self._room(origin.key)
            with partial(path) as aside:
                aside.chmod(0o600)
                aside.write_bytes(hashlib.sha256(rest).hexdigest().encode() + rest)
        return since

    def give_file(self, sha256: str, path: Path) -> bool:
        """Copy a kept file to ``path``; False, and nothing there, if it is not kept or no longer what it was."""
        own = self._path(sha256)
        try:
            source = self._opened(own)
        except OSError:
            return False
        except _RefusedError:
            with suppress(OSError):
                own.unlink()
            return False
        with source:
            total = hashlib.sha256()
            with path.open("xb") as copy:
                while some := source.read(_AT_A_TIME):
                    total.update(some)
                    copy.write(some)
        if total.hexdigest() == sha256:
            with suppress(OSError):
                os.utime(own)
            return True
        path.unlink()
        with suppress(OSError):
            own.unlink()
        return False

    def keep_file(self, sha256: str, path: Path) -> None:
        """Keep a copy of a file whose hash is known."""
        target = self._path(sha256)
        if target.exists():
            return
        with suppress(OSError, OutputError):
            self._room(sha256)
            with partial(target) as aside, path.open("rb") as source:
                aside.chmod(0o600)
                with aside.open("wb") as copy:
                    while some := source.read(_AT_A_TIME):
                        copy.write(some)

    def _opened(self, path: Path) -> BinaryIO:
        """An entry for reading, of which every level is the owner's alone."""
        for folder, status in ((self.folder, self.folder.stat()), (path.parent, path.parent.lstat())):
            if not stat.S_ISDIR(status.st_mode):
                raise _RefusedError(f"{folder.name} is no folder")
            _require_own(status, f"the folder {folder.name}")
        descriptor = os.open(path, os.O_RDONLY | _NO_LINKS)
        stream = os.fdopen(descriptor, "rb")
        try:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise _RefusedError("it is no file")
            _require_own(status, "it")
        except BaseException:
            stream.close()
            raise
        return stream

    def _room(self, key: str) -> Path:
        """Place of an entry, in a folder that is its owner's alone from now on."""
        path = self._path(key)
        path.parent.mkdir(exist_ok=True, mode=0o700)
        if path.parent.lstat().st_mode & _OTHERS:
            path.parent.chmod(0o700)
        return path

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
        every = sorted(self._files(), key=lambda file: file[1].st_mtime, reverse=True)
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
        for path in sorted(self.folder.glob("[0-9a-f][0-9a-f]/" + "[0-9a-f]" * 64)):
            with suppress(OSError):
                status = path.lstat()
                if stat.S_ISREG(status.st_mode):
                    yield path, status

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / key


def _require_own(status: os.stat_result, what: str) -> None:
    """Refuse what is not this account's, or may be written by others."""
    if hasattr(os, "getuid"):
        if status.st_uid != os.getuid():
            raise _RefusedError(f"{what} belongs to another account")
        if status.st_mode & _OTHERS:
            raise _RefusedError(f"others may write {what}")


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
        head = stream.readline(_MOST_HEADER)[_DIGEST:]
    try:
        facts = json.loads(head)
        return str(facts["what"]), _number(facts.get("seconds")), _number(facts.get("expected_s"))
    except (ValueError, KeyError, TypeError, AttributeError):
        return "file", None, None


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and 0 <= value < math.inf else None


def keep_result(store: Store, origin: Origin, folder: Path, summary: object, kind: Any) -> None:
    """Keep every file of a finished directory but that of its times, and make room for it.

    Args:
        origin: everything that the files depend on.
        folder: which nobody changes meanwhile.
        kind: of the summary, as a type hint states it.
    """
    hashes = {path.name: sha256_of_file(path) for path in sorted(folder.iterdir()) if path.name != TIMES}
    for name, sha256 in hashes.items():
        store.keep_file(sha256, folder / name)
    store.put(origin, (hashes, summary), tuple[dict[str, str], kind])
    store.prune()


def give_result(store: Store, origin: Origin, folder: Path, kind: Any) -> KeptFinding | None:
    """Put the files of a kept directory into an empty one.

    Returns:
        The summary that was kept with it. None if nothing is kept of that origin, or its entry is refused, or a file of
        it is lost or damaged; the folder is then empty again.
    """
    entry = store.get(origin, tuple[dict[str, str], kind])
    if not isinstance(entry, KeptFinding):
        return None
    hashes, summary = entry.value
    if any(Path(name).name != name for name in hashes):
        return None
    if all(store.give_file(sha256, folder / name) for name, sha256 in hashes.items()):
        return replace(entry, value=summary)
    for name in hashes:
        (folder / name).unlink(missing_ok=True)
    return None


Record: TypeAlias = Mapping[str, Any]
"""Record of a case: its key, rows of numbers, and why it failed, or None."""


def make_folder(folder: Path) -> None:
    """Make the folder of the cases, before the first is looked for. Raises OutputError MF401 if it cannot be made."""
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)


def keep(folder: Path, record: Record) -> None:
    """Write a case under its key; nobody sees half a file. Raises OutputError MF401 if it cannot be written."""
    path = _path(folder, record["key"])
    path.parent.mkdir(parents=True, exist_ok=True)
    with partial(path) as aside:
        aside.write_text(json.dumps(record, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def kept(folder: Path, key: str) -> Record | None:
    """A case that was found before; None if there is none, or its file is damaged."""
    try:
        record: Any = json.loads(_path(folder, key).read_text(encoding="utf-8"))
        sound = record["key"] == key and (record["failed"] is not None or record["rows"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return record if sound else None


def _path(folder: Path, key: str) -> Path:
    # A folder of a hundred thousand files is slow to list, and it is listed for every file that is written.
    return folder / key[:2] / f"{key}.json"
