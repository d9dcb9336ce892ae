"""Finished output directories: their known files by name and SHA-256, and removal of nothing else."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from maskfab.base import __version__
from maskfab.errors import OutputError
from maskfab.files.exchange import move
from maskfab.provenance import sha256_of_file

RESULT_MARK = "manifest.json"
"""The file that every finished output directory has."""
TIMES = "timing.json"
"""The file beside it that tells how long the work took, and which findings the run made itself and which earlier ones
had kept: no two runs have it alike, and no manifest hashes it."""
REPORT, PAGE = "report.json", "report.html"
"""The numbers of a run, and the page that shows them."""
JOB_COPY = "job.json"
"""The resolved job of a run."""
_Trace = tuple[int, int, int]


@dataclass(frozen=True)
class Account:
    """Where one finding of a run comes from.

    Attributes:
        what: function that found it, in words.
        die: that it is of; None if it is of several.
        kept: whether an earlier run found it.
        since: when it was found, UTC by ISO 8601.
        version: of maskfab that found it.
        entry: of the cache, by its key.
        refused: why an entry of an earlier run was not used, and this was found again; None if none was refused.
    """

    what: str
    die: str | None
    kept: bool
    since: str
    version: str
    entry: str
    refused: str | None = None


def write_mark(folder: Path, job_hash: str | None) -> None:
    """Write the manifest of all files in a folder, by which an earlier result is known as one.

    Args:
        folder: with every file in it.
        job_hash: of the job that made them; None without one.
    """
    files = [
        {"path": path.name, "bytes": path.stat().st_size, "sha256": sha256_of_file(path)}
        for path in sorted(folder.iterdir())
    ]
    mark = {"maskfab_version": __version__, "job_hash": job_hash, "files": files}
    text = json.dumps(mark, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    (folder / RESULT_MARK).write_text(text, encoding="utf-8")


@dataclass(frozen=True)
class Finished:
    """A finished output directory as it was found.

    Attributes:
        digest: SHA-256 of its manifest, in which are those of its files.
        own: its files as the manifest knows them, the manifest last: name, and by which a change would show.
        strange: names of what it holds besides, or holds otherwise.
    """

    digest: str
    own: Mapping[str, _Trace]
    strange: tuple[str, ...]


def read_manifest(folder: Path) -> Mapping[str, Any]:
    """The manifest of a finished output directory.

    Raises:
        OutputError: MF403 if there is none, or it lacks what every version writes.
    """
    try:
        manifest = json.loads((folder / RESULT_MARK).read_text(encoding="utf-8"))
        listed = manifest["files"]
        complete = "maskfab_version" in manifest and all({"path", "sha256", "bytes"} <= file.keys() for file in listed)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise OutputError(
            "MF403", f"{folder} has no readable {RESULT_MARK}: {error}", cure="Name the --out of a finished maskfab run"
        ) from error
    if not complete:
        raise OutputError("MF403", f"{folder / RESULT_MARK} lacks a version or hashes", cure="Run the job again")
    return dict(manifest)


def times_text(job_hash: str, seconds: Mapping[str, float], accounts: Iterable[Account] = ()) -> str:
    """The content of :data:`TIMES`."""
    findings = [asdict(each) for each in accounts]
    document = {"job_hash": job_hash, "seconds": dict(seconds), "findings": findings}
    return json.dumps(document, indent=1) + "\n"


def finished(folder: Path) -> Finished | None:
    """Known content of an output directory; None if it is not a finished result of maskfab."""
    try:
        content = (folder / RESULT_MARK).read_bytes()
        manifest = json.loads(content)
        known = {row["path"]: row.get("sha256") for row in manifest["files"]} if "maskfab_version" in manifest else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    if known is None:
        return None
    digest = hashlib.sha256(content).hexdigest()
    known[RESULT_MARK] = digest
    own: dict[str, _Trace] = {}
    strange = []
    for path in sorted(folder.iterdir(), key=lambda each: (each.name == RESULT_MARK, each.name)):
        trace = _trace(path)
        if path.is_symlink() or not path.is_file():
            strange.append(path.name)
        elif known.get(path.name) == sha256_of_file(path) or (path.name == TIMES and _is_times(path, manifest)):
            own[path.name] = trace
        else:
            strange.append(path.name)
    return Finished(digest, own, tuple(strange))


def _trace(path: Path) -> _Trace:
    status = path.lstat()
    return status.st_ino, status.st_size, status.st_mtime_ns


def _is_times(path: Path, manifest: Mapping[str, object]) -> bool:
    """Whether a file says what :func:`times_text` writes for the job, numbers under names, accounts, and nothing else;
    earlier versions gave no account."""
    try:
        text = path.read_text(encoding="utf-8")
        document = json.loads(text)
        seconds = {str(stage): float(took) for stage, took in document["seconds"].items()}
        accounts = [Account(**row) for row in document.get("findings", ())]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False
    job_hash = str(manifest.get("job_hash"))
    if "findings" not in document:
        return text == json.dumps({"job_hash": job_hash, "seconds": seconds}, indent=1) + "\n"
    return text == times_text(job_hash, seconds, accounts)


def discard(folder: Path, target: Path, found: Finished | None) -> Path | None:
    """Remove a result that another has replaced, and nothing else.

    Args:
        folder: where it lies now.
        target: the name that it had.
        found: what is in it; None if it is none, or no longer.

    Returns:
        Where the rest lies, beside ``target``; None if there is none.

    Raises:
        OSError: if the rest cannot be moved.
    """
    for name, trace in () if found is None or found.strange else found.own.items():
        with suppress(OSError):
            # The manifest is last, and stays with whatever has come meanwhile.
            if _trace(folder / name) == trace and (name != RESULT_MARK or os.listdir(folder) == [name]):
                (folder / name).unlink()
    try:
        folder.rmdir()
    except FileNotFoundError:
        return None
    except OSError:
        return move(folder, target, "kept")
    return None
