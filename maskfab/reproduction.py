"""A finished output directory made once more from its own job, byte against byte."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maskfab import provenance
from maskfab.arguments import checked_arguments
from maskfab.errors import OutputError
from maskfab.files.finished import JOB_COPY, PAGE, REPORT, RESULT_MARK, TIMES, read_manifest
from maskfab.files.staging import put_back
from maskfab.pipeline import OVERVIEW, run
from maskfab.progress import Progress, silent
from maskfab.provenance import sha256_of_file

_MADE_BY = {REPORT: "numbers", PAGE: "figures", OVERVIEW: "figures", RESULT_MARK: "hashes of the others"}
_MASKS = "drawing and writing"


@dataclass(frozen=True)
class RemadeFile:
    """One file of a directory, and the same made once more.

    Attributes:
        name: in the directory.
        stage: that makes it, in words.
        difference: in words; None if every byte is the same.
    """

    name: str
    stage: str
    difference: str | None


@dataclass(frozen=True, repr=False)
class Reproduction:
    """A directory made once more.

    Attributes:
        directory: as it was given.
        files: every file of its manifest, the manifest last.
        versions: programs of other versions than then: name, then, now; "-" where there is none.
    """

    directory: Path
    files: tuple[RemadeFile, ...]
    versions: tuple[tuple[str, str, str], ...]

    @property
    def passed(self) -> bool:
        """Whether every byte is the same."""
        return all(file.difference is None for file in self.files)

    def to_dict(self) -> dict[str, Any]:
        """Files and versions."""
        return {
            "directory": str(self.directory),
            "reproduced": self.passed,
            "files": [vars(file) for file in self.files],
            "versions": [{"name": name, "then": then, "now": now} for name, then, now in self.versions],
        }

    def __str__(self) -> str:
        width = max(len(file.name) for file in self.files)
        lines = [
            f"{file.name.ljust(width)}  {'same bytes' if file.difference is None else f'differs: {file.difference}'}"
            for file in self.files
        ]
        lines += [f"{name} was {then} then, and is {now} now" for name, then, now in self.versions]
        other = [file for file in self.files if file.difference is not None]
        stages = ", ".join(dict.fromkeys(file.stage for file in other))
        differ = "1 file differs" if len(other) == 1 else f"{len(other)} files differ"
        told = "every byte is the same" if self.passed else f"{differ}, made by: {stages}"
        return "\n".join([*lines, f"{len(self.files)} files: {told}"])

    def __repr__(self) -> str:
        return str(self)


@checked_arguments
def reproduce(directory: str | Path, *, progress: Progress = silent) -> Reproduction:
    """Make a finished output directory once more, from the job that lies in it, and compare every byte.

    Nothing is taken from the cache, and nothing is written into the directory. A file that was changed since differs as
    one does that other versions make otherwise; :func:`maskfab.verification.verify` tells whether it was changed.

    Args:
        directory: of a finished run.
        progress: told where the work stands.

    Raises:
        OutputError: MF403 if the directory is not that of a finished run.
        InputError: if its job can no longer be used.
    """
    folder = Path(directory)
    put_back(Path(os.path.realpath(folder)))
    manifest = read_manifest(folder)
    names, versions = [str(row["path"]) for row in manifest["files"]], manifest.get("versions")
    if not isinstance(versions, Mapping) or JOB_COPY not in names:
        raise OutputError(
            "MF403", f"{folder} holds other results than a plate", cure="Name a directory that maskfab run has made"
        )
    then = {str(name): str(number) for name, number in versions.items()}
    with tempfile.TemporaryDirectory(prefix="maskfab-") as scratch:
        again = Path(scratch) / "again"
        run(folder / JOB_COPY, again, progress=progress)
        every = sorted({*names, *(path.name for path in again.iterdir())} - {TIMES, RESULT_MARK})
        files = tuple(_compared(folder, again, name) for name in (*every, RESULT_MARK))
    now = provenance.versions()
    changed = (
        (name, then.get(name, "-"), now.get(name, "-"))
        for name in sorted(then.keys() | now.keys())
        if then.get(name) != now.get(name)
    )
    return Reproduction(folder, files, tuple(changed))


def _compared(folder: Path, again: Path, name: str) -> RemadeFile:
    stage = _MADE_BY.get(name, "optics" if name.endswith(".exr") else _MASKS)
    one, other = folder / name, again / name
    if not one.is_file() or not other.is_file():
        return RemadeFile(name, stage, "it is missing" if other.is_file() else "it is not made any more")
    if sha256_of_file(one) == sha256_of_file(other):
        return RemadeFile(name, stage, None)
    return RemadeFile(name, stage, _first_difference(one, other))


def _first_difference(one: Path, other: Path) -> str:
    """Where two files begin to differ: by the path of a value in JSON, by the byte in all others."""
    if one.suffix == ".json":
        try:
            then, now = (json.loads(path.read_bytes()) for path in (one, other))
        except (ValueError, RecursionError):
            return "it is no JSON any more"
        found = _first_value(then, now, "")
        if found is not None:
            return found
    then, now = one.read_bytes(), other.read_bytes()
    place = next((at for at, (a, b) in enumerate(zip(then, now, strict=False)) if a != b), min(len(then), len(now)))
    return f"from byte {place} on, of {len(then)} then and {len(now)} now"


def _first_value(then: object, now: object, where: str) -> str | None:
    if isinstance(then, Mapping) and isinstance(now, Mapping) and then.keys() == now.keys():
        pairs = [(f"{where}.{key}".lstrip("."), then[key], now[key]) for key in then]
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        pairs = [(f"{where}[{number}]", *both) for number, both in enumerate(zip(then, now, strict=True))]
    else:
        return None if then == now else f"{where or 'its keys'}: {_short(then)} then, {_short(now)} now"
    return next((found for key, a, b in pairs if (found := _first_value(a, b, key)) is not None), None)


def _short(value: object, most: int = 60) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= most else f"{text[:most]}..."
