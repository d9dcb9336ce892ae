"""The explanations of the error codes: one for each that is raised, and examples that do raise them."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path

import pytest

import maskfab
from maskfab.base import resources
from maskfab.base.errors import MaskfabError, catalogue
from maskfab.base.resources import explained, grouped
from maskfab.mask.job import Job, load_job

PACKAGE = Path(maskfab.__file__).parent
LAYOUTS = resources.path("layouts")
PARTS = ("meaning", "example", "cause", "cure")
JOB_LINE = re.compile(r"(\[{1,2}\w+\]{1,2}) ((\w+) = .*)", re.DOTALL)
JOB_LINES = {code: line for code in catalogue() if (line := JOB_LINE.fullmatch(explained(code).example))}


def raised_codes() -> set[str]:
    """Codes in the package's code, apart from those that an error is only compared with."""
    texts = (path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py") if path.name != "errors.py")
    return {code for text in texts for code in re.findall(r'(?<![=!]= )"(MF\d{3})"', text)}


def test_every_code_that_is_raised_is_explained_and_no_other():
    assert raised_codes() | {"MF153"} == set(catalogue())  # several faults are one there, too
    assert sorted(code for codes in grouped().values() for code in codes) == sorted(catalogue())


@pytest.mark.parametrize("part", PARTS)
def test_no_part_of_an_explanation_is_empty_or_stands_twice(part):
    texts = {code: asdict(explained(code))[part] for code in catalogue()}
    assert [code for code, text in texts.items() if len(text.strip()) < 12] == []
    assert len({" ".join(text.casefold().split()) for text in texts.values()}) == len(texts)


def test_causes_and_cures_are_sentences_that_say_more_than_the_meaning():
    for code in catalogue():
        entry = explained(code)
        for text in (entry.meaning, entry.cause, entry.cure):
            assert text.endswith("."), (code, text)
        assert len(entry.cause) + len(entry.cure) > len(entry.meaning)


def shown(job: Job) -> None:
    """The plate laid out, and its PSF looked for, as a run does."""
    job.check_window()
    job.plate()


@pytest.mark.parametrize("code", JOB_LINES)
def test_a_job_line_that_is_an_example_raises_its_code(tmp_path, code):
    heading, line, key = JOB_LINES[code].groups()
    for folder in ("openings", "maps"):
        (tmp_path / folder).symlink_to(LAYOUTS / folder)
    text = (LAYOUTS / "upc12.toml").read_text(encoding="utf-8")
    if heading not in text:
        text += f"\n{heading}\n"
    before, after = text.split(f"{heading}\n", 1)
    section, *rest = re.split(r"(?m)^(?=\[)", after, maxsplit=1)
    section = re.sub(rf"(?m)^{key} =.*\n", "", section)
    job = tmp_path / "job.toml"
    job.write_text(f"{before}{heading}\n{line}\n{section}{''.join(rest)}", encoding="utf-8")
    with pytest.raises(MaskfabError) as caught:
        shown(load_job(job))
    # A plate of twelve dies may have several.
    assert code in {fault.code for fault in caught.value.faults}, caught.value
