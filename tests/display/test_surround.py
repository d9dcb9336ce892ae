"""A die in the regular display: what is the same leaves no border, what is not leaves a line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.model import Tiling
from maskfab.display import eye
from maskfab.display.emitted_light import Viewing
from maskfab.display.emitter_rules import EmitterRules
from maskfab.display.eye import judge
from maskfab.display.reference import Reference
from maskfab.display.surround import Surrounded

NEAR = Viewing(84.672, 150e3)


def stripes(make_panel, order=(1, 2, 3), count=20):
    labels = np.repeat(np.array(order, dtype=np.int8), 14)[None].repeat(42, axis=0)
    mask = np.zeros((21, 21), dtype=np.bool_)
    return make_panel(mask, labels, 4032, count=count, tiling=Tiling.PERIODIC)


def thirds(panel):
    return Reference.of("stripe", panel.pitch_nm, EmitterRules(0, 0, 1))


def numbers(panel, pixels=12):
    judged = judge("D", panel, {"flat": np.full((pixels, pixels, 3), 0.5)}, 6, NEAR)
    return {quantity.name: float(quantity) for quantity in judged.quantities if "border" in quantity.name}, judged


def test_a_die_of_the_regular_display_has_no_border(make_panel):
    found, judged = numbers(stripes(make_panel))
    assert found["border_delta_e_inside"] == pytest.approx(found["border_delta_e_outside"], rel=1e-6)
    assert found["border_delta_e_step"] < 1e-6
    assert found["border_delta_e_edge"] < 0.2
    assert judged.surrounded.pixels == 12 + 2 * 3


def test_other_colours_beside_each_other_leave_a_line(make_panel):
    found, _ = numbers(stripes(make_panel, (3, 2, 1)))
    assert found["border_delta_e_edge"] > 3
    assert found["border_delta_e_inside"] > found["border_delta_e_outside"]


def test_round_the_die_lies_the_reference_that_is_asked_for(make_panel):
    panel, image = stripes(make_panel), {"flat": np.full((12, 12, 3), 0.5)}
    rules = EmitterRules(0, 4000, 4000)
    seen = {
        layout: judge("D", panel, image, 6, NEAR, reference=Reference.of(layout, panel.pitch_nm, rules))
        for layout in ("stripe", "pentile")
    }
    for layout, judged in seen.items():
        row = next(row for row in judged.quantities if row.name == "border_delta_e_outside")
        assert layout in row.method
    outside = [
        float(next(row for row in judged.quantities if row.name == "border_delta_e_outside"))
        for judged in seen.values()
    ]
    # Colours of a pentile lie farther apart.
    assert outside[1] > 1.5 * outside[0]


def test_light_is_the_same_here_and_there(make_panel):
    panel = stripes(make_panel, (3, 2, 1))
    around = Surrounded.of(panel, thirds(panel), 12, 6, 4)
    rgb = around.tiled.light(around.image, 6).rgb
    by_pixel = rgb.reshape(3, around.pixels, 6, around.pixels, 6).mean(axis=(2, 4))
    np.testing.assert_allclose(by_pixel, 0.5, rtol=1e-12)


def test_a_picture_that_is_too_large_takes_fewer_pixels(make_panel):
    panel = stripes(make_panel, count=300)
    around = Surrounded.of(panel, thirds(panel), 300, 21, 4)
    assert around.pixels * 21 <= 1 << 12
    assert around.tiled.light(around.image, 2).pixels == (around.pixels, around.pixels)


def test_a_limit_is_told_beside_its_number(make_panel):
    panel = replace(stripes(make_panel))
    image = {"flat": np.full((12, 12, 3), 0.5)}
    judged = judge("D", panel, image, 6, NEAR, limits={"flat_delta_e_mean": 1e-9, "grain_slow": 1.0})
    told = {quantity.name: quantity.passed for quantity in judged.quantities if quantity.limit is not None}
    assert told == {"flat_delta_e_mean": False, "grain_slow": True}
    assert eye.JUST_NOTICEABLE == 2.3
