"""Provenance of an artefact: hashes of jobs and files, versions of what was used."""

from __future__ import annotations

import hashlib
import json
import platform
import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path

from maskfab.base import __version__, resources
from maskfab.base.model import WrittenFile

_REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)(?:.*\bextra == '(?P<extra>\w+)')?")
_WRITING = ("design", "solid")
"""Extras whose libraries files may come from; those of others only read."""


def sha256_of_file(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def job_hash(resolved: Mapping[str, object]) -> str:
    """Hexadecimal SHA-256 of a resolved job: its canonical JSON, openings included, so that a comment or the
    order of keys does not change it while any dot of any opening does."""
    canonical = json.dumps(resolved, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()


def versions(*, extras: bool = False) -> dict[str, str]:
    """Versions of maskfab, Python, and of the libraries that may have written into a file, as installed here.

    Args:
        extras: name the libraries of all extras, too.
    """
    return {"maskfab": __version__, "python": platform.python_version(), **_libraries(extras)}


@cache
def _libraries(extras: bool) -> Mapping[str, str]:
    """Looked up once, for their metadata are long texts."""
    from importlib import metadata  # slow to load, and only what is written needs it

    asked = filter(None, map(_REQUIREMENT.match, metadata.requires("maskfab") or ()))
    names = {each["name"] for each in asked if extras or each["extra"] in (None, *_WRITING)}
    numbers: dict[str, str] = {}
    for name in sorted(names):
        with suppress(metadata.PackageNotFoundError):
            numbers[name] = metadata.version(name)
    return numbers


def environments(job_digest: str, version: str, hashes: Collection[str]) -> tuple[str, ...] | None:
    """Environments in which a job of ours gave GDSII and OASIS of these hashes, as ``make environments`` recorded them.

    Returns:
        their names; none where its bytes were others; None for a job or version of maskfab that is not on record.
    """
    record = json.loads(resources.path("export_templates/environments.json").read_text(encoding="utf-8"))
    tried = {name: seen for name, seen in record["environments"].items() if seen["job"] == job_digest}
    if version != record["maskfab"] or not tried:
        return None
    alike = [name for name, seen in tried.items() if set(seen["files"].values()) <= set(hashes)]
    return tuple(f"{name} (Python {tried[name]['python']}, numpy {tried[name]['packages']['numpy']})" for name in alike)


def signature(job_digest: str, seeds: Mapping[str, int]) -> str:
    """One line that every artefact carries: who made it, from which job, with which seeds."""
    drawn = ",".join(f"{name}={seed}" for name, seed in seeds.items()) or "none"
    return f"maskfab {__version__} | job {job_digest[:16]} | seeds {drawn}"


def file_record(root: Path, path: Path, kind: str) -> WrittenFile:
    """The record of a finished file under the output directory ``root``."""
    return WrittenFile(path.relative_to(root).as_posix(), kind, path.stat().st_size, sha256_of_file(path))
