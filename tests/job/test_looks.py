"""[looks] and [lives] of a job: distances, scales and limits that are refused."""

from __future__ import annotations

import pytest

from maskfab.base.errors import JobError
from maskfab.job.faults import parse_section
from maskfab.job.sections import LivesSection, LooksSection


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
        ("grain", 1.5, "MF104"),
        ("fringe", 0.0, "MF104"),
        ("dpi", 0, "MF104"),
        ("dpi", 9.9, "MF104"),
        ("dpi", 10_001, "MF104"),
        ("dpi", "300 dpi", "MF105"),
        ("reference", "diamond", "MF105"),
    ],
)
def test_what_no_eye_could_be_is_refused_with_its_key(key, value, code):
    with pytest.raises(JobError, match=rf"{code} .*{key}"):
        parse_section(LooksSection, {key: value}, where="looks")


def test_looks_are_written_as_they_were_stated():
    section = parse_section(LooksSection, {"distance": "0.4 m", "delta_e": 1.0}, where="looks")
    assert section.distance == 400e3
    assert section.model_dump(mode="json", exclude_none=True) == {
        "distance": "400 mm",
        "delta_e": 1.0,
        "reference": "stripe",
    }


@pytest.mark.parametrize(
    ("key", "value", "code"),
    [("life", 0, "MF104"), ("life", -1, "MF104"), ("power", 0.0, "MF104"), ("power", float("inf"), "MF104")],
)
def test_what_no_life_could_be_is_refused_with_its_key(key, value, code):
    with pytest.raises(JobError, match=rf"{code} .*{key}"):
        parse_section(LivesSection, {key: value}, where="lives")


def test_defaults_are_not_written_out_as_if_they_were_stated():
    """A job that is read back from a result must not look as if it had stated the limits itself."""
    for section in (LooksSection(), LivesSection()):
        assert not {"delta_e", "grain", "fringe", "life", "power"} & set(section.model_dump(exclude_none=True))
