"""A job of one's own to begin with, and the schemas from which editors complete one."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from maskfab.base import resources
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target, staged

FIRST = "first_plate"
"""Shipped job that one begins with unless another is named."""
JOB = "job.toml"
_LAYOUTS = "layouts"


@dataclass(frozen=True)
class Begun:
    """A folder with a job and everything that it names.

    Attributes:
        job: the job file.
        files: all files, the job first.
    """

    job: Path
    files: tuple[Path, ...]

    def __str__(self) -> str:
        named = "\n".join(str(path) for path in self.files)
        return f"{named}\nNext: maskfab check {self.job}, then maskfab run {self.job} --out {self.job.parent / 'plate'}"

    def to_dict(self) -> dict[str, Any]:
        """The paths."""
        return {"job": str(self.job), "files": [str(path) for path in self.files]}


def templates() -> tuple[str, ...]:
    """Names of the shipped jobs that lay out a plate, sorted."""
    every = sorted(resources.path(_LAYOUTS).glob("*.toml"))
    return tuple(path.stem for path in every if "die" in tomllib.loads(path.read_text(encoding="utf-8")))


@checked_arguments
def new(folder: str | Path, source: str = FIRST) -> Begun:
    """Begin a job of one's own: a folder with a commented job, and the openings and maps that it names.

    Args:
        folder: which must be new or empty.
        source: the shipped job to begin with, see :func:`templates`.

    Raises:
        JobError: MF105 for another name.
        OutputError: MF401 or MF402 if the folder cannot be written, or is not empty.
    """
    if source not in templates():
        cure = f"Begin with {', '.join(templates())}"
        raise JobError("MF105", f"there is no shipped job {source!r}", where="source", cure=cure)
    place, layouts = check_target(Path(folder), force=False), resources.path(_LAYOUTS)
    text = (layouts / f"{source}.toml").read_text(encoding="utf-8")
    named = sorted({name for name in _texts(tomllib.loads(text)) if name and (layouts / name).is_file()})
    with staged(place) as made:
        (made / JOB).write_text(text, encoding="utf-8")
        for name in named:
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes((layouts / name).read_bytes())
    return Begun(Path(folder) / JOB, tuple(Path(folder) / name for name in (JOB, *named)))


@checked_arguments
def schema(of: Literal["job", "report", "check"] = "job") -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of a job file, of report.json or of ``maskfab check --json``.

    Raises:
        JobError: MF105 for another name.
    """
    if of == "job":
        from maskfab.job.reference import job_schema

        return job_schema()
    if of == "report":
        from maskfab.report.documents.report import schema as report_schema

        return report_schema()
    if of == "check":
        from maskfab.report.documents.check import check_schema

        return check_schema()
    raise JobError("MF105", f"there is no schema of {of!r}", where="of", cure="Name job, report or check")


def _texts(value: object) -> Iterator[str]:
    """Every text in a document."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)
