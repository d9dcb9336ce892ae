"""[eye] of a job: distances and limits that are refused."""

from __future__ import annotations

import pytest

from maskfab.base.errors import JobError
from maskfab.job.read import parse_section
from maskfab.job.sections import EyeSection


@pytest.mark.parametrize(
    ("key", "value", "code"),
    [
        ("distance", "0 mm", "MF104"),
        ("distance", "9.9 mm", "MF104"),
        ("distance", "101 m", "MF104"),
        ("distance", "300", "MF103"),
        ("distance", 300, "MF103"),
        ("delta_e", 0, "MF104"),
        ("delta_e", -1.0, "MF104"),
        ("delta_e", float("nan"), "MF104"),
        ("grain", float("inf"), "MF104"),
        ("grain", -0.1, "MF104"),
    ],
)
def test_what_no_eye_could_be_is_refused_with_its_key(key, value, code):
    with pytest.raises(JobError, match=rf"{code} .*{key}"):
        parse_section(EyeSection, {key: value}, where="eye")


def test_an_eye_is_written_as_it_was_stated():
    section = parse_section(EyeSection, {"distance": "0.4 m", "delta_e": 1.0}, where="eye")
    assert section.distance == 400e3
    assert section.model_dump(mode="json", exclude_none=True) == {"distance": "400 mm", "delta_e": 1.0}
