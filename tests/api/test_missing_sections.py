"""A job that lacks sections is told all of them at once, by every verb."""

from __future__ import annotations

from pathlib import Path

import pytest

import maskfab as mf
from maskfab.base.errors import JobError

CAMERA = """
[camera]
focal = "5 mm"
stop = { diameter = "800 um" }
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"
"""
DESIGN = '\n[design]\nname = "tiny"\ndots = 11\npitch = "88 um"\nclear_dots = 25\n'
LAID_OUT = ("[job]", "[plate]", "[[die]]")


@pytest.mark.parametrize(
    ("text", "verb", "lacks"),
    [
        (CAMERA + DESIGN, mf.advise, ("[emitters]", "[plate]", "no die")),
        (CAMERA, mf.advise, ("[design]", "[emitters]", "[plate]", "no die")),
        (CAMERA, lambda job: mf.design(job, front=True), ("[pareto]", "[emitters]", "[design]")),
        (CAMERA, mf.check, ("emitters", *LAID_OUT)),
        (CAMERA, mf.study, ("[study]", *LAID_OUT)),
        (CAMERA, mf.simulate, LAID_OUT),
    ],
)
def test_all_that_is_missing_is_told_at_once(tmp_path: Path, text: str, verb: object, lacks: tuple[str, ...]) -> None:
    job = tmp_path / "job.toml"
    job.write_text(text, encoding="utf-8")
    with pytest.raises(JobError) as refusal:
        verb(job)  # type: ignore[operator]
    told = " ".join(fault.what for fault in refusal.value.faults)
    assert all(part in told for part in lacks), told
