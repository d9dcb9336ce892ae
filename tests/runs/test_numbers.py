"""What cases say together: planes, intervals, yields, and draws that cover their fields."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.findings import STAGE_OF_QUANTITY
from maskfab.optics.mtf import LEVELS
from maskfab.runs.sweep_numbers import Swept, wilson
from maskfab.runs.sweep_plan import Field, Level, _draws


def swept(values, *fields, drawn=False) -> Swept:
    """A sweep of numeric fields, one value of a number in each case."""
    cases = [
        SimpleNamespace(levels=tuple(Level(f"{x} um", x) for x in row), stated=row) for row in zip(*fields, strict=True)
    ]
    named = tuple(Field(f"f{i}", (("process", f"f{i}"),), "um", True, (), drawn=drawn) for i, _ in enumerate(fields))
    row = {"name": "open_ratio", "die": "A", "wavelength_nm": None, "level_db": None, "unit": "1", "passed": None}
    records = tuple(
        {
            "key": str(i),
            "failed": None if math.isfinite(value) else "MF163",
            "rows": [{**row, "value": value}] if math.isfinite(value) else [],
        }
        for i, value in enumerate(values)
    )
    plan = SimpleNamespace(fields=named, cases=cases, quantities=("open_ratio",), limits=())
    return Swept(plan, records, 0)  # type: ignore[arg-type]


def test_a_plane_is_found_exactly_and_failed_cases_are_left_out():
    x, y = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(0, 2, 4))
    values = 3 + 0.5 * x - 2 * y
    values[0, 0] = np.nan
    one, other = swept(values.ravel().tolist(), x.ravel().tolist(), y.ravel().tolist()).sensitivities
    assert (one.field, other.field) == ("f1", "f0")
    assert one.slope == pytest.approx(-2, abs=1e-12)
    assert other.slope == pytest.approx(0.5, abs=1e-12)
    assert one.half_width < 1e-10
    assert one.unit == "1/um"


def test_a_slopes_interval_holds_it_as_often_as_it_says():
    draw, held = np.random.default_rng(1), 0
    for _ in range(400):
        x = draw.uniform(-1, 1, 12)
        (found,) = swept((2 * x + draw.normal(0, 0.3, 12)).tolist(), x.tolist()).sensitivities
        held += abs(found.slope - 2) <= found.half_width
    assert 0.92 < held / 400 < 0.98


def test_a_field_without_effect_has_no_range_though_draws_are_unevenly_spread():
    x, y = np.random.default_rng(2).random((2, 20))
    by_x, by_y = swept((2 * x).tolist(), x.tolist(), y.tolist(), drawn=True).sensitivities
    assert (by_x.field, by_y.field) == ("f0", "f1")
    assert by_x.range > 1
    assert by_y.range == pytest.approx(0, abs=1e-12)


def test_a_valley_has_a_range_though_its_plane_is_level():
    x = np.linspace(-1, 1, 9)
    (found,) = swept((x**2).tolist(), x.tolist(), [3.0] * 9).sensitivities  # a field of one value is left out
    assert found.slope == pytest.approx(0, abs=1e-12)
    assert found.range == 1


@given(st.integers(1, 400), st.data())
def test_wilsons_ends_are_where_the_share_seen_is_one_quantile_off(cases, data):
    kept = data.draw(st.integers(0, cases))
    low, high = wilson(kept, cases)
    assert 0 <= low <= kept / cases <= high <= 1
    for end in {low, high} - {0.0, 1.0}:
        off = abs(kept / cases - end) / math.sqrt(end * (1 - end) / cases)
        assert off == pytest.approx(1.959964, abs=1e-4)


def test_a_latin_hypercube_has_one_draw_in_every_part():
    drawn = _draws(3, 50, 7, latin=True)
    assert all(sorted((row * 50).astype(int).tolist()) == list(range(50)) for row in drawn)
    assert not np.array_equal(drawn[0], drawn[1])
    assert np.array_equal(_draws(3, 50, 7, latin=True), drawn)


def test_a_sweep_can_ask_for_every_level_of_the_mtf_that_there_is():
    """Their names stand apart from the levels, so that kept cases are read without the optics."""
    named = [name for name, finding in STAGE_OF_QUANTITY.items() if finding.name == "mtf"]
    fractions = [f"mtf{level:g}" for level in LEVELS]
    assert named == ["auc_radial_min", *fractions, *(f"{name}_per_pixel" for name in fractions)]
