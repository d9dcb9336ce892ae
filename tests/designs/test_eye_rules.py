"""The rules of the eye: judged as the display's check would draw, refused where there is nothing to look at."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from asked_displays import asked_display

from maskfab.base.errors import JobError
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import of_display
from maskfab.designs.search.result import constraints_of
from maskfab.job.faults import parse_section
from maskfab.job.sections import SearchSection

UNIT = np.zeros((12, 12), dtype=np.bool_)
UNIT[1:4, 1:6] = True


def constraints(display, **rules) -> Constraints:
    return Constraints(15, dots=12, **of_display(display), **rules)


def seen_from(display, distance_um):
    return replace(display, rules=replace(display.rules, eye=display.rules.eye.viewed(distance_um=distance_um)))


def test_a_limit_is_broken_near_and_kept_from_far_away():
    near, far = (seen_from(asked_display(), distance) for distance in (200e3, 20_000e3))
    broken = constraints(near, delta_e=0.5, grain=0.001).violations(UNIT)
    assert [line.split(":")[0] for line in broken] == ["grain", "delta_e"]
    assert "200 mm, at most 0.5" in broken[1]
    assert constraints(far, delta_e=0.5, grain=0.001).violations(UNIT) == ()


def test_pieces_keep_a_limit_that_whole_emitters_break():
    near = seen_from(asked_display(keep=0.4, min_width_nm=8000), 150e3)
    parts = replace(near, rules=replace(near.rules, pieces=True))
    whole = constraints(near, delta_e=1.0)
    assert not whole.allows(UNIT)
    assert constraints(parts, delta_e=1.0).allows(UNIT)


def test_periodic_cells_keep_every_limit():
    display = asked_display()
    held = Constraints(
        15, dots=12, orientations=(0,), **of_display(replace(display, cells=display.cells * 0)), grain=1e-6
    )
    assert held.violations(UNIT) == ()


@pytest.mark.parametrize("rule", ["delta_e", "grain"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_limits_are_positive(rule, value):
    with pytest.raises(JobError, match=rf"MF10\d .*{rule}"):
        parse_section(SearchSection, section_text(f"{rule} = {value}"), where="design")


@pytest.mark.parametrize("rule", ["delta_e", "grain"])
def test_nothing_is_looked_at_without_a_display(rule):
    section = parse_section(SearchSection, section_text(f"{rule} = 1.0"), where="design")
    with pytest.raises(JobError, match=rf"MF105 .*{rule}.*Set fit = true"):
        constraints_of(section)


def section_text(rules: str) -> dict[str, object]:
    text = f'name = "x"\ndots = 12\npitch = "96 um"\nclear_dots = 15\n[rules]\n{rules}\n'
    return tomllib.loads(text)
