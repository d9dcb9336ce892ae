"""Wires as they are drawn: every rule checked by KLayout on tiles of many pixels, every line followed across them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from klayout import db
from sweeps import sweep

from maskfab.base.model import CLEAR, WIRES, Layer, Opening, Panel, Tiling
from maskfab.display.emitter_rules import Verdict
from maskfab.display.pixel_lines import WireRules
from maskfab.display.wiring import WireDemand, wiring
from maskfab.mask.layout import simple_polygon
from maskfab.mask.opening_file import load_opening
from maskfab.mask.outlines import unit_shapes
from maskfab.optics.tiling import orientations

RULES = WireRules(2000, 2000, 1000)
OPENINGS = Path(__file__).parents[2] / "layouts" / "openings"
SIDE = 12


def panel(opening: Opening, tiling: Tiling, gutter_nm: int = 0, dot_nm: int = 8000) -> Panel:
    return Panel(opening, dot_nm, gutter_nm, orientations(tiling, SIDE, SIDE, 1), tiling, 1)


def drawn(wired: Panel) -> dict[Layer, db.Region]:
    regions = {layer: db.Region() for layer in (CLEAR, *WIRES)}
    for (row, column), cell in np.ndenumerate(wired.orientations):
        shift = db.Trans(int(column) * wired.pitch_nm, int(row) * wired.pitch_nm)
        for layer, polygons in unit_shapes(wired, int(cell)).items():
            for polygon in polygons if layer in regions else ():
                regions[layer].insert(simple_polygon(polygon).transformed(shift))
    return {layer: region.merged() for layer, region in regions.items()}


def check_rules(wired: Panel, rules: WireRules, lines: int) -> None:
    """Every line is one piece from border to border of the tile; lines and openings keep their distances."""
    regions = drawn(wired)
    whole = SIDE * wired.pitch_nm
    for axis, layer in zip("xy", WIRES, strict=True):
        metal = regions[layer]
        assert (metal.sized(rules.clearance_nm, 2) & regions[CLEAR]).is_empty()
        assert metal.space_check(rules.space_nm).count() == 0
        assert metal.width_check(rules.line_nm).count() == 0
        spans = [box.width() if axis == "x" else box.height() for box in (each.bbox() for each in metal.each())]
        assert sorted(spans) == [whole] * (SIDE * lines)


def wired_by(found, bare: Panel) -> Panel:  # type: ignore[no-untyped-def]
    return Panel(
        bare.opening, bare.dot_nm, bare.gutter_nm, bare.orientations, bare.tiling, bare.seed, None, found.tracks
    )


def centred(dots: int, clear: int) -> Opening:
    mask = np.zeros((dots, dots), dtype=bool)
    low = (dots - clear) // 2
    mask[low : low + clear, low : low + clear] = True
    return Opening("square", mask, 8000)


@pytest.mark.parametrize("tiling", [Tiling.PERIODIC, Tiling.FLIPS, Tiling.RANDOM, Tiling.ROT90FLIP])
@pytest.mark.parametrize("lines", [1, 2, 4])
def test_lines_round_an_opening_meet_in_every_tiling(tiling: Tiling, lines: int) -> None:
    bare = panel(centred(9, 3), tiling)
    found = wiring(bare, bare.opening, WireDemand(RULES, lines))
    assert found.verdict is Verdict.FITS
    count = found.through[0]
    assert count >= lines
    check_rules(wired_by(found, bare), RULES, count)


@pytest.mark.parametrize("name", sweep(["diamond", "paper_inv_periodic", "poled"], 1))
def test_shipped_openings_in_random_tilings(name: str) -> None:
    opening = load_opening(OPENINGS / f"{name}.toml")
    bare = panel(opening, Tiling.RANDOM, dot_nm=opening.dot_nm)
    found = wiring(bare, opening, WireDemand(RULES, 4))
    assert found.verdict is not Verdict.UNKNOWN
    if min(found.through):
        check_rules(wired_by(found, bare), RULES, found.through[0])


def test_gutters_are_filled_first_and_keep_apart_from_lines_beside_them() -> None:
    bare = panel(centred(9, 3), Tiling.RANDOM, gutter_nm=8000)
    found = wiring(bare, bare.opening, WireDemand(RULES, 4))
    assert found.in_gutter == 2
    assert found.verdict is Verdict.FITS
    check_rules(wired_by(found, bare), RULES, found.in_gutter + found.through[0])


def test_a_slit_stops_every_line_across_it_and_that_is_proved() -> None:
    mask = np.zeros((9, 9), dtype=bool)
    mask[:, 4] = True
    opening = Opening("slit", mask, 8000)
    found = wiring(panel(opening, Tiling.PERIODIC), opening, WireDemand(RULES, 1))
    assert found.verdict is Verdict.DOES_NOT_FIT
    assert found.failed is not None
    assert found.failed.numbers == {"lines": 0, "wanted": 1}
    assert len({x for x, _ in found.failed.chain_nm}) == 2
    assert found.lines == (0, 1)
    # A transparent wire crosses it.
    crossed = wiring(panel(opening, Tiling.PERIODIC), opening, WireDemand(RULES, 1, 8000, 0.9))
    assert crossed.verdict is Verdict.FITS
    assert {track.transmission for track in crossed.tracks} == {0.9}


def test_narrow_dots_are_no_obstacle() -> None:
    """Dots of 2 um, narrower than any line: closed area counts, not the dot."""
    fine = Opening("fine", centred(9, 3).mask.repeat(4, axis=0).repeat(4, axis=1), 2000)
    bare = panel(fine, Tiling.RANDOM, dot_nm=2000)
    found = wiring(bare, fine, WireDemand(RULES, 4))
    assert found.verdict is Verdict.FITS
    check_rules(wired_by(found, bare), RULES, found.through[0])
