"""Photographs lose what a die that is not as drawn costs, and houses keep their promises of widths or do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camera.capture.captured_dies import phased_picture
from optics_cases import camera, noise, panel

from maskfab.camera.blur import MeasuredBlur
from maskfab.camera.inspection.costs import ALL, ORIENTATION, costs
from maskfab.camera.inspection.die_image import DieImage, Pixels, Setting
from maskfab.camera.inspection.die_verdict import Promise
from maskfab.camera.protocol import STRENGTHS, Protocol
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import NARROW, SMALLEST, dead_leaves
from maskfab.camera.scores import inner, psnr
from maskfab.camera.sensor import record_light
from maskfab.job.camera import Sensor
from maskfab.mask.houses.profiles import load_shop
from maskfab.optics.colour import code_of_light
from maskfab.optics.spectrum import line_spectrum

# Its window is that of the photographs' kernels, 257 pixels.
CAMERA = camera(diameter_um=800.0, window_um=514.0)
DIE = panel(noise(8, 0.45, 3), cells=14, seed=5)
SLITS = panel(np.arange(64).reshape(8, 8) // 8 % 6 > 1, cells=14)
COMA = ((4, 0.1), (7, 0.12))


def priced(setting, die=DIE, way=0, drawn=0):
    axis = np.arange(5) - 2.0
    image = DieImage.of(die, way, CAMERA, {"-": line_spectrum([530.0])}, [Pixels("-", axis, -axis)])
    seen = [name for name, value in zip(setting.names, setting.values, strict=True) if value]
    return {each.of: each for each in costs(image, setting, seen, drawn, Sensor())}


def test_a_die_as_drawn_costs_nothing_wherever_its_light_lies():
    found = priced(Setting(x_um=3.0, y_um=-2.0))
    assert set(found) == {ALL}
    for each in (found[ALL].by_design, found[ALL].for_good):
        assert (each.mean, each.half_width) == (0, 0)


@pytest.mark.slow
def test_aberrations_cost_what_photographs_by_another_path_lose():
    """Point spreads of a phase on exact dots, the Wiener filter, and the scene itself for the truth."""
    found = priced(Setting(terms=COMA))
    assert set(found) == {"z4", "z7", ALL}
    light = Protocol("camera").exposure(40).behind(float(noise(8, 0.45, 3).mean()))

    def blur(terms):
        picture = phased_picture(DIE, CAMERA, terms)
        kernel = np.broadcast_to(picture / picture.sum(), (3, *picture.shape))
        return MeasuredBlur(kernel, tuple(side // 2 for side in picture.shape), ())

    def restored(known, seen, by):
        record = record_light(Sensor(), known.margin.through(known.light, seen.on(known.margin.shape)), light, 7)
        ready = Wiener(NARROW).prepare(record, by)
        return [psnr(inner(code_of_light(ready(e)), 64), inner(known.true, 64)) for e in STRENGTHS[8:24:2]]

    drawn, bent = blur(()), blur(COMA)
    by_design, for_good = [], []
    for number in (1, 2, 3, 4):
        known = replace(dead_leaves(number, SMALLEST, SMALLEST), around=NARROW)
        right, own, wrong = (restored(known, *pair) for pair in ((drawn, drawn), (bent, bent), (bent, drawn)))
        best = int(np.argmax(right))
        by_design.append(own[best] - wrong[best])
        for_good.append(right[best] - own[best])
    whole = found[ALL]
    assert whole.by_design.mean == pytest.approx(np.mean(by_design), rel=0.1)
    assert whole.for_good.mean == pytest.approx(np.mean(for_good), rel=0.1)
    assert whole.by_design.mean > 2 * whole.by_design.half_width > 0
    assert whole.by_design.mean > found["z4"].by_design.mean


def test_slits_that_stand_otherwise_are_lost_only_to_who_does_not_know():
    found = priced(Setting(), SLITS, way=1)
    assert set(found) == {ORIENTATION, ALL}
    each = found[ORIENTATION]
    assert each.by_design.mean > 2 * each.by_design.half_width
    assert abs(each.for_good.mean) < each.for_good.half_width
    assert found[ALL].by_design.mean == pytest.approx(each.by_design.mean)


@pytest.mark.parametrize(
    ("shop", "bias", "half", "kept", "words"),
    [
        (None, 0.4, 0.1, False, "names no mask house"),
        (None, 0.08, 0.1, True, "the job states"),
        (None, 0.08, 0.5, None, "the job states"),
        ("pog", 0.4, 0.1, False, "publishes no CD tolerance"),
        ("photoplotstore", 0.3, 0.1, True, "the ±0.5 um that"),
        ("photoplotstore", -0.45, 0.1, None, "the ±0.5 um that"),
        ("photoplotstore", -0.7, 0.1, False, "promises of features of 8 um"),
        ("topro_chrome", 0.3, 0.1, False, "the ±0.1 um"),
    ],
)
def test_an_interval_is_held_against_what_the_house_promises(shop, bias, half, kept, words):
    promise = Promise(0.0, None if shop is None else load_shop(shop))
    assert promise.kept(8.0, bias, half) is kept
    assert words in promise.words(8.0)


def test_what_is_ordered_comes_before_what_is_promised():
    promise = Promise(0.0, load_shop("photoplotstore"), 0.2)
    assert promise.kept(8.0, 0.3, 0.05) is False
    assert promise.words(8.0) == "the ±0.2 um that the job orders"


def test_wider_features_are_promised_less():
    tolerance = load_shop("photoplotstore").tolerance
    assert [tolerance.of_width(width) for width in (1, 10, 10.1, 127, 1e4)] == [0.5, 0.5, 1.0, 1.3, 2.54]
