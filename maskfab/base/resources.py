"""Bundled data, in a checkout and in an installed wheel alike: layouts, templates, and explanations of the error codes.

Explanations of codes are in ``error_codes.toml`` beside this file, as :func:`maskfab.base.errors.catalogue` reads them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType

from maskfab.base.errors import InternalError, JobError, catalogue


def template(name: str) -> str:
    """Text of a file in export_templates/."""
    return path(f"export_templates/{name}").read_text(encoding="utf-8")


def path(name: str) -> Path:
    """Path of a bundled file, such as ``layouts/upc12.toml``."""
    package = Path(__file__).resolve().parents[1]
    for root in (package / "_bundled", package.parent):
        if (root / name).exists():
            return root / name
    what = f"the bundled file {name} is missing from this installation"
    raise InternalError("MF901", what, cure="Install maskfab again")


GROUPS: Mapping[str, str] = MappingProxyType(
    {
        "MF1": "The job file",
        "MF2": "An opening",
        "MF3": "A file that is read",
        "MF4": "Output, shops and packages",
        "MF9": "Internal errors",
    }
)
"""Headings of the codes, by what they begin with."""


@dataclass(frozen=True)
class Explanation:
    """One error code in words: ``meaning`` is the one line that every error of this code shares."""

    code: str
    meaning: str
    example: str
    cause: str
    cure: str


def explained(code: str) -> Explanation:
    """The explanation of a code, which may be written in small letters; MF105 for an unknown one."""
    name = code.strip().upper()
    if name not in catalogue():
        raise JobError("MF105", f"there is no error code {code!r}", where="CODE", cure=_near(name))
    return Explanation(name, **catalogue()[name])


def grouped() -> Mapping[str, tuple[str, ...]]:
    """Codes under the headings of :data:`GROUPS`, in ascending order."""
    return {
        heading: tuple(sorted(code for code in catalogue() if code.startswith(start)))
        for start, heading in GROUPS.items()
    }


def _near(code: str) -> str:
    number = code.removeprefix("MF")
    swapped = [name for name in catalogue() if sorted(name) == sorted(f"MF{number}")]
    likely = swapped or get_close_matches(f"MF{number}", catalogue(), n=3, cutoff=0.6)
    listed = "maskfab explain lists all codes"
    return f"Did you mean {' or '.join(likely)}? {listed}" if likely else f"Codes are MF and three digits; {listed}"
