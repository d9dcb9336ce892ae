"""Designs under the rules of a display: they are judged by the check itself, and what comes out fits."""

from __future__ import annotations

from pathlib import Path

import pytest
from once import leaves

from maskfab.display.emitters.placement import Verdict
from maskfab.display.feasibility import DisplayRules, feasibility
from maskfab.errors import JobError
from maskfab.job import load_job
from maskfab.jobfile import read
from maskfab.model import Tiling
from maskfab.opening.openings import opening_text
from maskfab.optimiser.design import check_possible, design, display_notes
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.families import bars
from maskfab.optimiser.rules.fit_rule import Display

JOB = """
[design]
name = "small"
dots = 11
pitch = "88 um"
clear_dots = 25
fit = true

[camera]
focal = "10 mm"
stop = { shape = "circle", diameter = "0.512 mm" }
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"

[emitters]
required = 0.1
gap_to_opening = "4 um"
colour_gap = "8 um"
min_width = "8 um"
circuit = "800 um^2"

[wires]
lines = 2
"""
DISPLAY = """
[job]
name = "SMALL"
title = "SMALL"

[plate]
template = "5in"
die_size = "0.62 mm"
die_pitch = "22 mm"
columns = 1

[[die]]
name = "SMALL"
label = "small"
opening = "small.toml"
dot = "8 um"
pitch = "88 um"
tiling = "random"
seed = 0
"""


def job_of(folder: Path, *edits: tuple[str, str], more: str = ""):
    text = JOB + more
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path = folder / "job.toml"
    path.write_text(text)
    return path


def test_the_rule_is_the_check_itself_and_the_quick_one_is_no_laxer(tmp_path: Path) -> None:
    spec = read(job_of(tmp_path, ("lines = 2", "lines = 4")))
    asked = Display.of(DisplayRules.of(spec.emitters, None, spec.wires), Tiling.RANDOM, 0, 5, 5)
    rules = Constraints(25, dots=11, dot_nm=8000, emitters=asked.rules.emitters, fit=asked)
    verdicts = []
    for bar in list(bars(11, 25))[::23]:
        found = feasibility(asked.panel(bar.unit, 8000), asked.rules)
        verdicts.append(found.verdict is Verdict.FITS)
        assert (not any(each.startswith("fit: ") for each in rules.violations(bar.unit))) == verdicts[-1]
        assert not rules.allows(bar.unit) or verdicts[-1]
    assert len(set(verdicts)) == 2


def test_what_is_designed_for_a_display_fits_in_the_job_that_holds_it(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("maskfab.camera.scenes.bundled", lambda count=4: (leaves(1),))
    path = job_of(tmp_path, more=DISPLAY)
    found = design(read(path), "a test", where=str(path))
    assert found.prices is not None
    assert [each.rule for each in found.prices.each] == ["fit"]
    (tmp_path / "small.toml").write_text(opening_text(found.opening))
    job = load_job(path)
    answer = feasibility(job.plate().dies[0].panel, job.display_rules)
    assert answer.verdict is Verdict.FITS
    assert found.prices.together >= 0


def test_a_display_that_no_opening_can_hold_is_refused_with_a_proof(tmp_path: Path) -> None:
    path = job_of(tmp_path, ("required = 0.1", "required = 0.33"))
    with pytest.raises(JobError, match=r"MF123.*fit.*not even a pixel without an opening.*design\.fit"):
        check_possible(read(path), where=str(path))


def test_a_design_must_fit_some_display(tmp_path: Path) -> None:
    text = JOB[: JOB.index("[emitters]")]
    path = tmp_path / "job.toml"
    path.write_text(text)
    with pytest.raises(JobError, match=r"MF105.*no display.*design\.fit.*\[emitters\]"):
        check_possible(read(path), where=str(path))


def test_a_display_that_a_design_need_not_fit_is_named(tmp_path: Path) -> None:
    told = display_notes(read(job_of(tmp_path, ("fit = true", ""))))
    assert told == ("Not used of the job, for [design] does not say fit = true: [emitters], [wires].",)
    assert display_notes(read(job_of(tmp_path))) == ()
