"""Packages: one zip of plain files in one folder, in equal bytes for equal files, and safe to unpack.

Each revision of a plate has a package of its own name, and none takes the place of another."""

from __future__ import annotations

import json
import os
import re
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from maskfab.base.errors import InputError, OutputError, SourceError
from maskfab.base.files import partial
from maskfab.base.folders import RESULT_MARK

_DATE = (1980, 1, 1, 0, 0, 0)
_UNIX = 3
_READABLE = 0o100644 << 16
_DIRECTORY, _LINK, _KIND = 0o040000, 0o120000, 0o170000
_LEVEL = 6
_BLOCK = 1 << 20
_MOST_MEMBERS = 256
_MOST_BYTES = 8_000_000_000
_MOST_SHRUNK = 250
"""Mask files shrink to a tenth or a twentieth; to a thousandth only what is made to fill a disk."""
_SPARSE = (".bmp", ".tif")
"""Bitmaps of plates shrink to as little, for most of a plate is chrome; they are held to ``_MOST_BYTES`` alone."""
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, NotImplementedError, RuntimeError, ValueError, IndexError,
    OSError,
)  # fmt: skip
"""Errors that zipfile raises for damaged archives."""
_LOCAL, _CENTRAL = struct.Struct("<26xHH"), struct.Struct("<28xHHH12x")
"""Lengths of name, extra fields and comment in the record before a file, which has no comment, and in the directory."""
_END_BYTES, _END_64_BYTES = 22, 56 + 20
_END_64, _LENGTHS_64 = b"PK\x06\x06", b"\x01\x00"
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


def safe_stem(name: str) -> str:
    """The name as the stem of a file that every system can unpack: letters, digits, ``_`` and ``-`` only."""
    stem = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_-")[:64] or "plate"
    return f"{stem}_" if _RESERVED.fullmatch(stem) else stem


def write_package(target: Path, folder: Path, names: Sequence[str], stem: str, *, replace: bool = True) -> None:
    """Zip files of a folder, sorted, undated, under the folder ``stem`` of the zip."""
    with (
        partial(target, replace=replace) as aside,
        zipfile.ZipFile(aside, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as archive,
    ):
        for name in sorted(names):
            member = zipfile.ZipInfo(f"{stem}/{name}", _DATE)
            member.compress_type, member.create_system, member.external_attr = zipfile.ZIP_DEFLATED, _UNIX, _READABLE
            member.file_size = (folder / name).stat().st_size
            with (folder / name).open("rb") as source, archive.open(member, "w") as sink:
                shutil.copyfileobj(source, sink, _BLOCK)


def is_package(path: Path) -> bool:
    """Whether a file is called a package or is one whatever it is called: a zip with a manifest."""
    if path.suffix.lower() == ".zip":
        return not os.path.isdir(path)
    try:
        with zipfile.ZipFile(path) as archive:
            return any(PurePosixPath(name).name == RESULT_MARK for name in archive.namelist())
    except _DAMAGE:
        return False


def unpack(package: Path, folder: Path) -> tuple[str, ...]:
    """Unpack a package into a folder, every member checked before any is written; the names of its files.

    Raises:
        SourceError: MF301 if there is none; MF303 if it is damaged; MF422 if it is no zip with one folder and a
            manifest; MF423 if a member's name leads elsewhere, comes twice, is no plain file, or if there are more or
            larger ones than a package has.
    """
    if not os.path.isfile(package):
        what = f"there is no package {package}"
        raise SourceError("MF301", what, cure="Give the path of a .zip that maskfab order pack wrote")
    with _opened(package) as archive:
        members = _checked(archive.infolist(), package)
        for name, member in members.items():
            with (folder / name).open("wb") as sink:
                for block in _blocks(archive, member, package):
                    sink.write(block)
    return tuple(members)


@dataclass(frozen=True)
class Wrapping:
    """Everything of a package but its files: parts that belong to none, in words, and their length."""

    folder: str
    strange: tuple[str, ...]
    strange_bytes: int


def wrapping(package: Path) -> Wrapping:
    """The wrapping of a package that :func:`unpack` takes.

    A zip is read from its end, so that programs pass over whatever lies before, between and behind its files.
    (PKWARE APPNOTE 6.3.10, section 4.3.)

    Raises:
        SourceError: MF303 for a damaged one.
    """
    problems: list[tuple[int, str]] = []
    try:
        with zipfile.ZipFile(package) as archive, package.open("rb") as file:
            members = sorted(archive.infolist(), key=lambda member: member.header_offset)
            place = 0
            for member in members:
                problems.append((member.header_offset - place, f"before {member.filename}"))
                place = member.header_offset + member.compress_size
                place += _record(file, member.header_offset, _LOCAL, problems, member.filename)
            problems.append((archive.start_dir - place, "behind the last file"))
            place = archive.start_dir
            for member in members:
                place += _record(file, place, _CENTRAL, problems, member.filename)
            file.seek(place)
            if file.read(4) == _END_64:
                place += _END_64_BYTES
            problems.append((len(archive.comment), "of a comment"))
            place += _END_BYTES + len(archive.comment)
            problems.append((package.stat().st_size - place, "behind its end"))
            folder = PurePosixPath(members[0].filename).parts[0]
    except _DAMAGE as error:
        raise _damaged(package, error) from error
    parts = [(length, where) for length, where in problems if length]
    return Wrapping(folder, tuple(f"{n} bytes {where}" for n, where in parts), sum(abs(n) for n, _ in parts))


def _record(file: BinaryIO, place: int, kind: struct.Struct, found: list[tuple[int, str]], name: str) -> int:
    """Length of a member's record in front of its content, or in the directory; what its extra fields and comment hold
    is added to ``found``, but for the lengths of very large files."""
    file.seek(place)
    called, extra, *comment = kind.unpack(file.read(kind.size))
    file.seek(called, os.SEEK_CUR)
    if not file.read(extra).startswith(_LENGTHS_64):
        found.append((extra, f"of extra fields of {name}"))
    found.append((sum(comment), f"of a comment on {name}"))
    return int(kind.size + called + extra + sum(comment))


def _opened(package: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(package)
    except _DAMAGE as error:
        raise _damaged(package, error) from error


def _blocks(archive: zipfile.ZipFile, member: zipfile.ZipInfo, package: Path) -> Iterator[bytes]:
    """The content of a member; one that says less than it holds ends in an error of the archive's own."""
    try:
        with archive.open(member) as source:
            while block := source.read(_BLOCK):
                yield block
    except _DAMAGE as error:
        raise _damaged(package, error) from error


def _damaged(package: Path, error: Exception) -> SourceError:
    code = "MF303" if zipfile.is_zipfile(package) else "MF422"
    return SourceError(
        code, f"{package} cannot be unpacked: {error}", cure="Pack the job again with maskfab order pack"
    )


def _checked(members: Sequence[zipfile.ZipInfo], package: Path) -> dict[str, zipfile.ZipInfo]:
    if len(members) > _MOST_MEMBERS or sum(member.file_size for member in members) > _MOST_BYTES:
        raise _unsafe(package, f"it holds {len(members)} files of {sum(m.file_size for m in members) / 1e9:.3g} GB")
    named: dict[str, zipfile.ZipInfo] = {}
    folders = set()
    for member in members:
        # ZipInfo ends a name at its first null byte; what came before that is judged too.
        for text in (member.orig_filename, member.filename):
            path = PurePosixPath(text)
            if "\\" in text or "\0" in text or path.is_absolute() or ".." in path.parts or ":" in text:
                raise _unsafe(package, f"its member {text!r} leads out of the folder it is unpacked to")
        kind = (member.external_attr >> 16) & _KIND
        if kind == _LINK:
            raise _unsafe(package, f"its member {member.filename!r} is a link")
        # An empty name makes is_dir() fail.
        if len(path.parts) != 2 or member.is_dir() or kind == _DIRECTORY:
            raise _unsafe(package, f"its member {member.filename!r} is no file of one folder")
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise _unsafe(package, f"its member {member.filename!r} is packed in a way that packages are not")
        sparse = path.suffix in _SPARSE
        if not sparse and member.file_size > max(_BLOCK, _MOST_SHRUNK * member.compress_size):
            raise _unsafe(
                package,
                f"its member {member.filename!r} unpacks from {member.compress_size} to {member.file_size} bytes",
            )
        if path.name.casefold() in (name.casefold() for name in named):
            raise _unsafe(package, f"its member {member.filename!r} comes twice")
        folders.add(path.parts[0])
        named[path.name] = member
    if len(folders) != 1 or RESULT_MARK not in named:
        what = f"{package} has no folder with a {RESULT_MARK}"
        raise SourceError("MF422", what, cure="Name a zip that maskfab order pack wrote")
    return named


def _unsafe(package: Path, what: str) -> SourceError:
    return SourceError("MF423", f"{package}: {what}", cure="Do not unpack it; ask for it again")


def package_stem(plate: str, shop: str, revision: str | None) -> str:
    """Name of a package's folder, and of the package itself where only a folder is given for it."""
    suffix = "" if revision is None else f"_rev{safe_stem(revision)}"
    return f"{safe_stem(plate)}_{safe_stem(shop)}{suffix}"


def placed(target: Path, stem: str) -> Path:
    """The file to write: ``target`` itself, or in the folder that it is."""
    return target / f"{stem}.zip" if os.path.isdir(target) else target


def check_earlier(target: Path, revision: str | None) -> None:
    """Refuse (MF406) to replace the package of another revision."""
    earlier = _manifest(target)
    if earlier is not None and earlier.get("revision") != revision:
        what = f"{target} holds {_revision(earlier.get('revision'))}, and this is {_revision(revision)}"
        cure = "Give --out another name, or a folder, in which each revision has a name of its own"
        raise OutputError("MF406", what, cure=cure)


def check_same(target: Path, manifest: Mapping[str, Any]) -> None:
    """Refuse (MF406) to replace a package of the same revision that holds something else."""
    earlier, revision = _manifest(target), manifest.get("revision")
    if earlier is None or revision is None or earlier == json.loads(json.dumps(manifest)):
        return
    hashes = [{row["path"]: row["sha256"] for row in contents.get("files", ())} for contents in (earlier, manifest)]
    other = sorted(name for name in {**hashes[0], **hashes[1]} if hashes[0].get(name) != hashes[1].get(name))
    what = f"{target} holds {_revision(revision)} already, and other contents: {', '.join(other) or RESULT_MARK}"
    cure = "Raise order.revision in the job; or move the package elsewhere if nobody has received it"
    raise OutputError("MF406", what, cure=cure)


def _revision(revision: object) -> str:
    return "a package without a revision" if revision is None else f"revision {revision}"


def _manifest(target: Path) -> dict[str, Any] | None:
    """The manifest of a package that is there; None where there is none, or another file."""
    if not os.path.isfile(target) or not is_package(target):
        return None
    try:
        with tempfile.TemporaryDirectory(prefix="maskfab-package-") as folder:
            unpack(target, Path(folder))
            held = json.loads((Path(folder) / RESULT_MARK).read_text(encoding="utf-8"))
    except (InputError, ValueError):
        return None
    return held if isinstance(held, dict) else None
