"""The hard cases of displays that no other test here holds; each has an answer that can be counted by hand.

Elsewhere: all open, all closed, one dot, exactly three squares, squares that touch at corners, two equal halves, combs,
spirals, a ring, four rectangles in a pinwheel, a checkerboard and every colour order of 1 : 1 : 2.5 are in
``subpixels/test_rectangles.py``, ``test_freeform.py`` and ``test_fit.py``; openings on the border with a gap wider than
the gutter in ``subpixels/test_region.py``; lines from left to right that a slit stops in ``wiring/test_wiring.py``.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from display.shapes import bar, cells, published

from maskfab.base.model import Emitters, Opening, Panel, Tiling, orient
from maskfab.display import eye
from maskfab.display.emitter_rules import EmitterRules, Proof, Verdict, grid_of
from maskfab.display.emitter_shapes import guillotine, three_rectangles
from maskfab.display.footprint_bound import upper_bound
from maskfab.display.free_area import EVERY, borders, free_region
from maskfab.display.pixel_lines import DIRECTIONS, Net, ports
from maskfab.display.placement import footprint, wander
from maskfab.optics.colour import luminance_centroid

ALIKE = (1.0, 1.0, 1.0)
GUTTER = 8000


def four_blobs(dots: int = 21, low: int = 4, size: int = 4) -> np.ndarray:
    """Openings in the four quarters of a pixel, which has all symmetries of a square; bool, True is clear."""
    side = np.zeros(dots, dtype=bool)
    side[low : low + size] = side[dots - low - size : dots - low] = True
    return side[:, None] & side


@pytest.mark.parametrize("period", [2, 3])
def test_scattered_openings_leave_nothing_once_emitters_keep_a_gap(period: int) -> None:
    """Every dot is open or beside an open one, corners included, although most are closed."""
    mask = np.zeros((21, 21), dtype=bool)
    mask[period // 2 :: period, period // 2 :: period] = True
    opening = Opening("scattered", mask, 8000)
    answer = footprint(opening, 8000, GUTTER, EVERY, EmitterRules(8000, 8000, 8000))
    assert answer.verdict is Verdict.DOES_NOT_FIT
    assert answer.certificate is not None
    assert answer.certificate.proof is Proof.NO_THREE_SQUARES
    assert answer.bound_share == 0
    # Without the gap there is room, narrow as it is.
    assert footprint(opening, 8000, GUTTER, EVERY, EmitterRules(0, 8000, 8000)).found_share > 0


def test_the_third_largest_component_decides() -> None:
    """Parts of 100, 65 and 65 dots: two emitters in the first would have (100 - 10) / 2 each, so 65 is the optimum."""
    region = np.zeros((21, 21), dtype=bool)
    region[:10, :10] = True
    region[:5, 12:21], region[5:7, 12:21], region[7, 12:14] = True, True, True  # 45 + 18 + 2
    region[12:17, :13] = True
    assert [int(part.sum()) for part in (region[:10, :10], region[:8, 12:], region[12:])] == [100, 65, 65]
    grid = cells(21, 2, 1)
    bound, certificate = upper_bound(region, grid, ALIKE)
    found, _ = guillotine(region, grid, ALIKE)
    assert found == bound == 65
    assert certificate.proof is Proof.COMPONENT_PACKING


def test_symmetric_openings_have_ports_and_openings_on_the_sides_have_none() -> None:
    """Lines beside and between four blobs meet in all orientations; many lines alone do not bring a port."""
    blobs = ~four_blobs()
    through = [Net(blobs, way).count() for way in DIRECTIONS]
    assert through[0] == through[1] == 13
    assert ports(blobs).count == 13
    # Openings at the middle of one side: as many lines as before from side to side, none of which comes out anywhere
    # that is closed on all four sides.
    turned = np.ones((21, 21), dtype=bool)
    turned[0, ::2] = turned[1::2, 0] = False
    turned[0, 10] = True
    flow = min(Net(turned, way).count() for way in DIRECTIONS)
    assert flow >= 8
    assert ports(turned).count <= 1


def mask_of_the_authors() -> Opening:
    return Opening("published", published("L2Inv_Random"), 4000)


def test_a_footprint_between_found_and_bound_is_found_or_unknown() -> None:
    answer = footprint(mask_of_the_authors(), 4000, GUTTER, EVERY, EmitterRules(4000, 16000, 10000, required=0.093))
    assert answer.verdict is not Verdict.FITS or answer.found_share >= 0.093
    if answer.verdict is Verdict.DOES_NOT_FIT:
        assert answer.bound_share < 0.093
    assert answer.certificate is not None


def test_no_room_with_a_margin_is_no_proof_that_there_is_none() -> None:
    """With half the gap kept free along all sides no three squares fit; one colour alone at the border, they do."""
    opening, rules = mask_of_the_authors(), EmitterRules(4000, 20000, 12000)
    grid = grid_of(opening, 4000, GUTTER, rules)
    inner = free_region(opening.mask, grid, EVERY, margin=(20000 - GUTTER) // 2 // grid.cell_nm)
    assert three_rectangles(inner, grid, ALIKE)[0] == 0
    answer = footprint(opening, 4000, GUTTER, EVERY, rules)
    assert answer.best is not None
    assert answer.found_share == pytest.approx(0.017, abs=5e-3)
    panel = np.random.default_rng(3).integers(8, size=(40, 40)).astype(np.int8)
    clear = opening.mask.repeat(grid.per_dot, axis=0).repeat(grid.per_dot, axis=1)
    assert borders(answer.best.labels, clear, grid, panel).legal


def test_emitters_about_the_centre_wander_nowhere() -> None:
    """Three rows whose light balances, and three colours each in two halves opposite one another."""
    balanced = np.zeros((21, 21), dtype=np.int8)
    balanced[9:12, 9:12] = 2
    balanced[10, 0], balanced[10, 20] = 1, 1
    balanced[0, 10], balanced[20, 10] = 3, 3
    halves = np.zeros((20, 20), dtype=np.int8)
    for colour, row in ((1, 1), (2, 4), (3, 7)):
        halves[row, 2:9] = colour
        halves[19 - row, 11:18] = colour
    assert np.array_equal(orient(halves, 2), halves)
    assert not any(np.array_equal(orient(halves, k), halves) for k in (1, 3, 4, 5, 6, 7))
    for labels in (balanced, halves):
        emitters = Emitters(labels, 4000)
        assert np.hypot(*luminance_centroid(emitters, 84_000)) < 1e-15
        assert wander(emitters, 84_000) < 1e-15
        cells_of = np.random.default_rng(1).integers(8, size=(30, 30)).astype(np.int8)
        panel = Panel(
            Opening("closed", np.zeros(labels.shape), 4000), 4000, 0, cells_of, Tiling.RANDOM, 1, emitters
        )  # fmt: skip
        assert eye.centroids(panel)[1] < 1e-15


def test_a_mask_with_a_half_turn_has_the_same_answer_turned() -> None:
    mask = bar(21, 5, 8) | orient(bar(21, 3, 2), 2)
    mask |= orient(mask, 2)
    opening = Opening("half", mask, 8000)
    answers = [
        footprint(Opening("half", orient(opening.mask, k), 8000), 8000, GUTTER, EVERY, EmitterRules(0, 8000, 16000))
        for k in (0, 2)
    ]
    assert answers[0].found_share == answers[1].found_share
    assert answers[0].bound_share == answers[1].bound_share


@pytest.mark.parametrize("ratio", set(itertools.permutations((1.0, 1.0, 2.5))))
def test_blue_may_be_any_colour(ratio: tuple[float, float, float]) -> None:
    """The largest area decides nothing but how it is named: bound and footprint know no colours."""
    opening = Opening("slit", bar(21, 5, 8), 8000)
    answer, plain = (
        footprint(opening, 8000, GUTTER, EVERY, EmitterRules(0, 8000, 16000, ratio=each), largest=True)
        for each in (ratio, (1.0, 1.0, 2.5))
    )
    assert answer.bound_share == pytest.approx(plain.bound_share)
    assert answer.rectangles_share == pytest.approx(plain.rectangles_share)
    assert answer.best is not None
    assert np.argmax(answer.best.areas_um2) == np.argmax(ratio)
