"""The wording of the package: docstrings name the thing, cures say what to write, and no phrase of the old idiom."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import maskfab
from maskfab.base.errors import catalogue

SOURCES = {
    path.relative_to(Path(maskfab.__file__).parent).as_posix(): path.read_text(encoding="utf-8")
    for path in Path(maskfab.__file__).parent.rglob("*.py")
}


def found(pattern: str) -> list[str]:
    return [f"{name}: {match[0]}" for name, text in SOURCES.items() for match in re.finditer(pattern, text)]


def test_docstrings_begin_with_the_thing_itself():
    assert found(r'(?m)^\s*r?"""(What|How|The same)\b.*') == []


@pytest.mark.parametrize(
    "cure",
    [
        "Mend",
        "Check the path",
        "Check the file",
        "Give one that is",
        'Choose another"',
        "Leave it out",
        'Write it again"',
    ],
)
def test_cures_say_what_to_write_instead_of(cure):
    assert found(rf'cure=f?"{cure}.*') == []


def test_meanings_of_codes_are_whole_sentences():
    assert [code for code, own in catalogue().items() if not re.fullmatch(r"\S+( \S+){2,}\.", own["meaning"])] == []
