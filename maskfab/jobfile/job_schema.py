"""The JSON Schema of a job file, from which editors complete keys and show their meaning.

It is that of the types that check a job, with values as a job file writes them. An editor may let pass what
:func:`maskfab.jobfile.read` refuses, and refuses nothing that it takes.
"""

from __future__ import annotations

import re
from typing import Any

from maskfab.jobfile.reference import FORMS, holds_sections, written_key
from maskfab.jobfile.section import Section
from maskfab.jobfile.sections import JobSpec
from maskfab.jobfile.uses import INNER

_TEXTS = frozenset(
    {"LengthOrZero", "SignedLength", "PlateLength", "Length", "Pitch", "Area", "Time", "Distance", "Name", "Line"}
)


def job_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12)."""
    stated = JobSpec.model_json_schema()
    kinds = {kind.__name__: kind for kind in _sections(Section)}
    for name, rules in {JobSpec.__name__: stated, **stated["$defs"]}.items():
        if name in kinds:
            written = {key: each for key, each in rules["properties"].items() if key not in INNER}
            rules["properties"] = {key: _as_written(kinds[name], key, each) for key, each in written.items()}
            rules.pop("title", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "maskfab job", **stated}


def _sections(kind: type[Section]) -> list[type[Section]]:
    return [each for below in kind.__subclasses__() for each in (below, *_sections(below))]


def _as_written(kind: type[Section], key: str, rules: dict[str, Any]) -> dict[str, Any]:
    """Rules of one key: of a value with a unit or of several forms, those of its text in the job."""
    if holds_sections(kind, key):
        return rules
    annotation, meaning = written_key(kind, key)
    form = next((word for word in re.findall(r"\w+", annotation) if word in FORMS), None)
    told = {"description": meaning if form is None else f"{meaning} Form: {FORMS[form]}."}
    if form is None:
        return {name: each for name, each in rules.items() if name != "title"} | told
    return told | ({"type": "string"} if form in _TEXTS else {})
