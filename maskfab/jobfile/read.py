"""From a file or parsed data to a valid spec, or to the first thing that is wrong with it."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from maskfab import resources
from maskfab.errors import JobError, SourceError
from maskfab.jobfile.checks import (
    check_design,
    check_dies,
    check_display,
    check_film,
    check_method,
    check_order,
    check_report,
    check_scene,
)
from maskfab.jobfile.problems import first_problem
from maskfab.jobfile.section import Section
from maskfab.jobfile.sections import JobSpec
from maskfab.jobfile.toml import loads

Kind = TypeVar("Kind", bound=Section)


def read(path: Path) -> JobSpec:
    """Load and validate a job file (.toml, or the .json that a run keeps).

    Raises:
        SourceError: MF301, MF302, MF303 or MF308 if the file cannot be read.
        JobError: MF101 to MF115 for the first thing that is wrong with its content.
    """
    return validate(document(path, "job"), where=str(path))


def document(path: Path, kind: str) -> object:
    """Plain data of a file that a user writes, unchecked.

    Args:
        path: of a .toml, or of the .json that a run keeps.
        kind: of file, in words.

    Raises:
        SourceError: MF301, MF302, MF303, MF304 or MF308 if the file cannot be read.
        JobError: MF101 for what is no TOML.
    """
    if not os.path.isfile(path):
        raise SourceError(
            "MF301",
            f"there is no {kind} file {path}",
            cure=f"Give the path of a {kind} file (.toml); the shipped ones are in {resources.path('layouts')}",
        )
    data = path.read_bytes()
    if not data.strip():
        raise SourceError("MF302", f"the {kind} file {path} is empty", cure="Start from a shipped one, in layouts")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError("MF304", f"the {kind} file {path} is not text: {error}", cure="Save it as UTF-8") from error
    if path.suffix == ".json":
        try:
            return json.loads(text)
        except (ValueError, RecursionError) as error:
            raise SourceError(
                "MF303", f"{path} is not valid JSON: {error}", cure="Run the job again to rewrite it"
            ) from error
    if path.suffix != ".toml":
        raise SourceError("MF308", f"{path} has the suffix {path.suffix!r}", cure=f"A {kind} file ends in .toml")
    return _toml(text, str(path))


def validate(document: object, *, where: str) -> JobSpec:
    """A spec from parsed data; ``where`` names the file in errors."""
    check_method(document, where)
    spec = parse_section(JobSpec, document, where=where)
    check_design(spec, where)
    check_dies(spec, where)
    check_display(spec, where)
    check_scene(spec, where)
    check_film(spec, where)
    check_order(spec, where)
    check_report(spec, where)
    return spec


def parse_section(kind: type[Kind], values: object, *, where: str) -> Kind:
    """One section from values that did not come from a file; errors as for a job."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise first_problem(error, where) from error


def _toml(text: str, where: str) -> dict[str, Any]:
    try:
        return loads(text)
    except (ValueError, RecursionError) as error:
        found = re.search(r"line (\d+), column (\d+)", str(error))
        place = f"{where}:{found[1]}:{found[2]}" if found else f"{where}, at the end"
        raise JobError(
            "MF101",
            f"TOML syntax: {error}",
            where=place,
            cure="Correct the TOML there: close quotes and brackets, give every key one value",
        ) from error
