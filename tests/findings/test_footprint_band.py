"""The band of emitters about openings that are written wider: against widths by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtri

from maskfab.base.model import Die, Emitters, Opening, Panel, Tiling
from maskfab.display.emitter_rules import EmitterRules
from maskfab.display.polygon_check import left_of_emitters
from maskfab.findings.bands import ProcessSpread
from maskfab.findings.display import footprint_band
from maskfab.job.process import Process

STRIPE = np.zeros((7, 7), dtype=bool)
STRIPE[:, 3] = True
LABELS = np.zeros((7, 7), dtype=np.int8)
LABELS[:, 1], LABELS[:, 5], LABELS[:, 6] = 1, 2, 3
"""Red and green are a gap of one dot away from the stripe, blue is two."""
RULES = EmitterRules(8000, 0, 8000)
EMITTERS = Emitters(LABELS, 8000)


def die() -> Die:
    panel = Panel(Opening("S", STRIPE, 8000), 8000, 0, np.zeros((3, 3), dtype=np.int8), Tiling.PERIODIC, None)
    return Die("S", "S", replace(panel, emitters=EMITTERS), (0, 0), 3 * panel.pitch_nm)


@pytest.mark.parametrize(("growth_nm", "left"), [(-100, (1, 1, 1)), (0, (1, 1, 1)), (100, (0.9875, 0.9875, 1))])
def test_emitters_lose_what_is_nearer_to_the_opening_than_their_gap(growth_nm, left):
    assert left_of_emitters(die().panel, RULES, growth_nm) == pytest.approx(left)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 3), (30, 20)])
def test_a_wider_opening_takes_from_its_own_pixel_and_from_the_next(rows, columns):
    mask = np.zeros((4, 4), dtype=bool)
    mask[:, 0] = True
    beside = Emitters(np.tile(np.array([0, 3, 2, 1], dtype=np.int8), (4, 1)), 8000)
    cells = np.zeros((rows, columns), dtype=np.int8)
    panel = Panel(Opening("S", mask, 8000), 8000, 0, cells, Tiling.PERIODIC, None, beside)
    assert left_of_emitters(panel, EmitterRules(0, 8000, 8000), 500) == pytest.approx((0.9375, 1.0, 0.9375))


def test_the_band_lies_between_the_footprints_of_the_least_and_the_greatest_bias():
    found = SimpleNamespace(emitters=EMITTERS)
    (row,) = footprint_band(die(), found, RULES, Process(0.5, 0.0), ProcessSpread(bias_um=0.2))
    lost = ndtri(0.975) * 0.2 / 2 / 56  # of an emitter as high as the pixel
    assert row.between == pytest.approx((1 / 7 - lost, 1 / 7), abs=1e-5)
    assert row.value == pytest.approx(lost / 2, abs=1e-5)
    assert row.uncertainty == pytest.approx(1e-3 / 56)
    assert footprint_band(die(), found, RULES, Process(0.5), ProcessSpread(radius_um=0.2)) == ()
