"""The vocabulary refuses nonsense when it is made, with the code of the refusal, and takes everything else as it is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.errors import InputError
from maskfab.base.model import Die, Emitters, Gauge, Opening, Panel, Plate, Tiling, Track
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import Glass, Process, Roughness

MASK = np.eye(4, dtype=np.bool_)
OPENING = Opening("eye", MASK, 8000)
PANEL = Panel(OPENING, 8000, 2, np.arange(8).reshape(2, 4), Tiling.RANDOM, 0)
DIE = Die("A", "a", PANEL, (-3, 5), 200_000)
PLATE = Plate("P", "p", 10_000_000, 9_000_000, (DIE,), (), (), ())
STOP = Stop("circle", 400.0)
CAMERA = Camera(5000.0, STOP, (610.0, 530.0), 2.0, 64.0)


def refused(code: str, make, *given, **named) -> InputError:
    with pytest.raises(InputError) as refusal:
        make(*given, **named)
    assert refusal.value.code == code
    assert refusal.value.where
    assert refusal.value.cure
    return refusal.value


NONSENSE = [
    ("MF122", PANEL, {"orientations": np.full((2, 4), 99)}),
    ("MF122", PANEL, {"orientations": np.full((2, 4), 8)}),
    ("MF122", PANEL, {"orientations": np.full((2, 4), -1)}),
    ("MF122", PANEL, {"orientations": np.full((2, 4), 256)}),  # 0 in eight bits
    ("MF122", PANEL, {"orientations": np.full((2, 4), 0.5)}),
    ("MF122", PANEL, {"orientations": np.full((2, 4), math.nan)}),
    ("MF122", PANEL, {"orientations": np.zeros(4)}),
    ("MF122", PANEL, {"orientations": np.zeros((0, 4))}),
    ("MF122", PANEL, {"others": (Opening("five", np.ones((5, 5)), 8000),)}),
    ("MF107", PANEL, {"gutter_nm": 3}),
    ("MF104", PANEL, {"gutter_nm": -2}),
    ("MF104", PANEL, {"dot_nm": 0}),
    ("MF107", PANEL, {"dot_nm": 8000.5}),
    ("MF105", PANEL, {"dot_nm": "8 um"}),
    ("MF105", PANEL, {"dot_nm": (8000, 4000)}),
    ("MF105", PANEL, {"dot_nm": True}),
    ("MF105", PANEL, {"tiling": "random"}),
    ("MF105", PANEL, {"opening": MASK}),
    ("MF111", PANEL, {"seed": None}),
    ("MF105", PANEL, {"seed": "one"}),
    ("MF104", PANEL, {"seed": -1}),
    ("MF201", OPENING, {"mask": np.ones((4, 5), dtype=np.bool_)}),
    ("MF201", OPENING, {"mask": np.ones(4, dtype=np.bool_)}),
    ("MF201", OPENING, {"mask": np.ones((0, 0), dtype=np.bool_)}),
    ("MF202", OPENING, {"mask": np.full((4, 4), 0.5)}),
    ("MF202", OPENING, {"mask": np.full((4, 4), 255, dtype=np.uint8)}),
    ("MF202", OPENING, {"mask": np.full((4, 4), math.nan)}),
    ("MF202", OPENING, {"mask": np.full((4, 4), "#")}),
    ("MF105", OPENING, {"dot_nm": "8 um"}),
    ("MF105", OPENING, {"name": 5}),
    ("MF119", OPENING, {"emitters": np.full((4, 4), 4)}),
    ("MF119", Emitters(np.ones((2, 2)), 4000), {"labels": np.full((2, 2), 260)}),
    ("MF105", Track("scan", "x", (), True), {"axis": "z"}),
    ("MF104", Track("scan", "x", (), True), {"transmission": 1.5}),
    ("MF108", DIE, {"slot_nm": PANEL.size_nm[0] - 1}),
    ("MF107", DIE, {"centre_nm": (0.5, 0)}),
    ("MF105", DIE, {"panel": OPENING}),
    ("MF109", PLATE, {"dies": (DIE, replace(DIE, label="b"))}),
    ("MF104", PLATE, {"blank_nm": 0}),
    ("MF105", Gauge("g", "x", (0, 0), 5, 2), {"axis": "diagonal"}),
    ("MF105", STOP, {"shape": "round"}),
    ("MF105", STOP, {"diameter_um": "4 mm"}),
    ("MF104", STOP, {"diameter_um": math.nan}),
    ("MF104", STOP, {"diameter_um": -1.0}),
    ("MF104", STOP, {"size_um": (4.0, 0.0)}),
    ("MF104", STOP, {"shape": "annulus", "inner_share": 1.5}),
    ("MF132", STOP, {"shape": "polygon", "outline_um": ()}),
    ("MF132", STOP, {"shape": "polygon", "outline_um": ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))}),
    ("MF105", CAMERA, {"focal_um": "10 mm"}),
    ("MF104", CAMERA, {"pixel_um": 0.0}),
    ("MF105", CAMERA, {"stop": 4000.0}),
    ("MF105", CAMERA, {"wavelengths_nm": "530 nm"}),
    ("MF105", CAMERA, {"wavelengths_nm": ("530 nm",)}),
    ("MF105", CAMERA, {"wavelengths_nm": ()}),
    ("MF104", CAMERA, {"wavelengths_nm": (math.nan,)}),
    ("MF104", Glass(2300.0, 1.46, "away"), {"index": 0.9}),
    ("MF105", Glass(2300.0, 1.46, "away"), {"chrome": "both"}),
    ("MF104", Process(1.0), {"corner_radius_um": -1.0}),
    ("MF104", Process(1.0), {"corner_radius_um": math.nan}),
    ("MF104", Process(1.0), {"cd_bias_um": math.nan}),
    ("MF104", Roughness(0.1, 1.0), {"sigma_um": -0.1}),
    ("MF104", Roughness(0.1, 1.0), {"correlation_um": 0.0}),
    ("MF104", Process(1.0), {"cd_bias_um": math.inf}),
    ("MF104", Process(1.0), {"cd_bias_um": -math.inf}),
    ("MF104", CAMERA, {"focal_um": math.inf}),
]


@pytest.mark.parametrize(("code", "sound", "wrong"), NONSENSE, ids=lambda each: str(each)[:40])
def test_nonsense_is_refused_with_its_code_and_the_field_that_it_stands_in(code, sound, wrong):
    told = refused(code, replace, sound, **wrong)
    assert told.where.startswith(type(sound).__name__)
    assert told.where.rpartition(".")[2] in wrong


@given(st.integers(-1000, 1000), st.integers(1, 4))
def test_a_cell_holds_an_opening_under_an_element_of_d4_and_nothing_else(entry, openings):
    others = tuple(Opening(f"o{k}", MASK, 8000) for k in range(1, openings))
    cells = np.zeros((2, 3), dtype=np.int64)
    cells[1, 2] = entry
    if 0 <= entry < 8 * openings:
        panel = replace(PANEL, orientations=cells, others=others)
        assert panel.orientations.dtype == np.int8
        assert int(panel.orientations[1, 2]) == entry
        assert panel.pattern(entry).sum() == MASK.sum()
    else:
        refused("MF122", replace, PANEL, orientations=cells, others=others)


@given(st.integers(0, 10**6))
def test_gutters_are_whole_on_either_side_of_a_cell(gutter_nm):
    if gutter_nm % 2:
        told = refused("MF107", replace, PANEL, gutter_nm=gutter_nm)
        assert replace(PANEL, gutter_nm=int(told.cure.split()[1])).gutter_nm == gutter_nm + 1
    else:
        assert replace(PANEL, gutter_nm=gutter_nm).pitch_nm == 4 * 8000 + gutter_nm


@pytest.mark.parametrize("tiling", Tiling)
def test_only_tilings_that_draw_need_a_seed(tiling):
    if tiling.seeded:
        refused("MF111", replace, PANEL, tiling=tiling, seed=None)
    else:
        assert replace(PANEL, tiling=tiling, seed=None).seed is None


@pytest.mark.parametrize("mask", [MASK.tolist(), MASK.astype(np.uint8), MASK.astype(float)])
def test_dots_of_zero_and_one_are_dots(mask):
    opening = Opening("eye", mask, np.int64(8000))
    assert opening.mask.dtype == np.bool_
    assert not opening.mask.flags.writeable
    assert np.array_equal(opening.mask, MASK)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_stop_has_a_positive_diameter(diameter):
    """An infinite one lets everything through."""
    if diameter > 0:
        assert Stop("square", diameter).diameter_um == diameter
    else:
        refused("MF104", Stop, "square", diameter)
