"""The answer about a pixel: never a yes without a placement, never a no without a proof."""

import itertools
import math
import time

import numpy as np
import pytest
from display.shapes import bar, broken_rules, cells, published
from sweeps import in_turns, sweep

from maskfab.base.errors import JobError
from maskfab.base.model import Opening, orient
from maskfab.base.resources import path
from maskfab.display.emitter_rules import EmitterRules, Proof, Verdict, grid_of
from maskfab.display.free_area import EVERY, border_margin, borders, facing_squares, free_region, three_facing_squares
from maskfab.display.placement import footprint, largest_gap, three_squares
from maskfab.mask.opening_file import parse_opening

DOT, GUTTER = 8000, 8000
PIXEL = 22**2
"""Dots in a pixel of 21 dots with a gutter of one."""


def slit():
    return Opening("slit", bar(21, 5, 8), DOT)


def fitted():
    return parse_opening(path("layouts/openings/toled.toml").read_text(encoding="utf-8"))


def rules(to_opening=0, gap=1, width=2, **more):
    return EmitterRules(to_opening * DOT, gap * DOT, width * DOT, **more)


def checked(opening, dot, gutter, used, given, **more):
    """The answer, after every rule was measured again on its placement, in the pixel and across all borders."""
    answer = footprint(opening, dot, gutter, used, given, **more)
    grid = grid_of(opening, dot, gutter, given)
    assert answer.found_share <= answer.bound_share
    assert answer.rectangles_share <= answer.found_share
    if answer.best is None:
        assert answer.found_share == 0
        assert answer.verdict is not Verdict.FITS
        return answer
    region = free_region(opening.mask, grid, used)
    least = answer.found_share * grid.pitch_nm**2 / grid.cell_nm**2
    assert broken_rules(answer.best.labels, region, grid, given.ratio, least) == []
    panel = np.random.default_rng(0).choice(np.array(list(used), dtype=np.int8), (50, 50))
    clear = np.kron(opening.mask, np.ones((grid.per_dot, grid.per_dot), dtype=bool))
    assert borders(answer.best.labels, clear, grid, panel).legal
    if answer.verdict is Verdict.FITS:
        assert answer.found_share >= given.required - 1e-9
    return answer


def test_the_slit_fits_with_two_colours_in_one_half():
    answer = checked(slit(), DOT, GUTTER, EVERY, rules(required=80 / PIXEL))
    assert answer.verdict is Verdict.FITS
    assert answer.method == "rectangles"
    assert answer.found_share == pytest.approx(80 / PIXEL)
    assert answer.best.areas_um2 == (80 * 64, 80 * 64, 80 * 64)


def test_a_pixel_without_an_opening():
    # 10 x 13 dots twice, a dot apart, and 21 x 7 above them: more than three stripes of 6.33 x 21 in whole dots.
    answer = checked(Opening("none", np.zeros((21, 21)), DOT), DOT, GUTTER, EVERY, rules())
    assert answer.found_share == pytest.approx(130 / PIXEL)


@pytest.mark.parametrize(
    ("mask", "squares"),
    [
        pytest.param(np.ones((9, 9)), 0, id="all open"),
        pytest.param(1 - np.pad(np.ones((2, 2)), ((0, 7), (3, 4))), 1, id="one"),
        pytest.param(1 - np.indices((9, 9)).sum(0) % 2, 0, id="checkerboard"),
        pytest.param(1 - np.pad(np.ones((2, 5)), ((3, 4), (1, 3))), 2, id="two beside one another"),
        pytest.param(1 - np.pad(np.ones((7, 2)), ((0, 2), (7, 0))), 2, id="two above one another"),
    ],
)
def test_no_three_squares_is_proved_and_shown(mask, squares):
    opening = Opening("few", mask, DOT)
    answer = checked(opening, DOT, GUTTER, EVERY, rules(required=0.0))
    assert answer.verdict is Verdict.DOES_NOT_FIT
    assert (answer.bound_share, answer.best) == (0, None)
    proof = answer.certificate
    assert proof.proof is Proof.NO_THREE_SQUARES
    assert proof.numbers["squares"] == squares
    assert proof.witness.sum() == 4 * squares
    assert not (proof.witness & opening.mask).any()
    assert "16 um" in proof.statement


def test_more_than_the_bound_is_refused_with_its_proof():
    answer = checked(slit(), DOT, GUTTER, EVERY, rules(required=90 / PIXEL))
    assert answer.verdict is Verdict.DOES_NOT_FIT
    assert answer.certificate.proof in (Proof.COMPONENT_PACKING, Proof.SEPARATION)
    assert answer.bound_share < 90 / PIXEL
    assert answer.best is not None


def test_crooked_borders_are_looked_for_only_where_they_decide():
    quick = checked(fitted(), DOT, GUTTER, EVERY, rules())
    assert (quick.verdict, quick.method) == (Verdict.FITS, "straight cuts")
    needed = 96 / PIXEL
    assert quick.found_share < needed <= quick.bound_share
    answer = checked(fitted(), DOT, GUTTER, EVERY, rules(required=needed))
    assert (answer.verdict, answer.method) == (Verdict.FITS, "crooked borders")
    assert checked(fitted(), DOT, GUTTER, EVERY, rules(), largest=True).found_share >= needed


def test_between_the_best_found_and_the_bound_it_is_not_known():
    largest = footprint(fitted(), DOT, GUTTER, EVERY, rules(), largest=True)
    assert largest.found_share < largest.bound_share
    answer = checked(fitted(), DOT, GUTTER, EVERY, rules(required=largest.bound_share))
    assert answer.verdict is not Verdict.DOES_NOT_FIT
    if answer.verdict is Verdict.UNKNOWN:
        assert answer.found_share < answer.bound_share


@pytest.mark.parametrize("ratio", set(itertools.permutations((1.0, 1.0, 2.5))))
def test_every_colour_order(ratio):
    answer = checked(slit(), DOT, GUTTER, EVERY, rules(ratio=ratio))
    large = int(np.argmax(ratio)) + 1
    # 8 columns of 21 for the largest; the others share the other half, 8 x 10 each. The areas are trimmed.
    assert answer.found_share * PIXEL == pytest.approx(168 / (7.5 / 4.5))
    assert (answer.best.labels == large).sum() == 168


@pytest.mark.parametrize(("gap", "used"), sweep(in_turns([2, 3, 1], [EVERY, (0,), (0, 1, 2, 3)]), 3))
def test_neighbours_keep_the_colours_apart_in_every_orientation(gap, used):
    opening = fitted()
    answer = checked(opening, DOT, GUTTER, used, rules(to_opening=2, gap=gap))
    assert answer.best is not None
    assert checked(opening, DOT, GUTTER, used, rules(gap=gap), largest=True).best is not None


def test_orientation_does_not_matter_to_the_first_answer():
    opening = fitted()
    answers = [
        footprint(Opening("turned", orient(opening.mask, k), DOT), DOT, GUTTER, EVERY, rules(gap=2)) for k in range(8)
    ]
    for answer in answers[1:]:
        assert answer.rectangles_share == answers[0].rectangles_share
        assert answer.bound_share == pytest.approx(answers[0].bound_share)


def test_squares_that_need_no_margin_are_found():
    # Closed are three squares, one of them in a corner: with a gap of 3 and a gutter of 1 the margin would forbid it.
    mask = np.ones((15, 15), dtype=bool)
    for y, x in ((0, 0), (5, 5), (10, 10)):
        mask[y : y + 2, x : x + 2] = False
    opening = Opening("corner", mask, DOT)
    given = rules(gap=3)
    assert border_margin(grid_of(opening, DOT, GUTTER, given)) == 1
    answer = checked(opening, DOT, GUTTER, EVERY, given)
    assert (answer.verdict, answer.method) == (Verdict.FITS, "three squares")
    assert answer.found_share == pytest.approx(4 / 16**2)


def test_squares_that_meet_across_borders_are_no_placement():
    mask = np.ones((15, 15), dtype=bool)
    for y, x in ((0, 0), (0, 13), (7, 7)):
        mask[y : y + 2, x : x + 2] = False
    opening = Opening("corners", mask, DOT)
    answer = checked(opening, DOT, GUTTER, EVERY, rules(gap=3))
    assert answer.verdict is Verdict.DOES_NOT_FIT
    assert answer.certificate.proof is Proof.BORDER_PAIR
    assert checked(opening, DOT, GUTTER, EVERY, rules(gap=1)).verdict is Verdict.FITS


def test_three_facing_squares_against_the_check_of_whole_panels():
    rng = np.random.default_rng(5)
    both = set()
    for _ in range(60):
        n, gap, width = int(rng.integers(5, 8)), int(rng.integers(1, 4)), int(rng.integers(1, 3))
        region = rng.random((n, n)) < 0.35
        grid = cells(n, width, gap, gutter=1)
        used = (EVERY, (0,), (0, 2), (0, 1, 2, 3))[rng.integers(4)]
        panel = rng.choice(np.array(used, dtype=np.int8), (40, 40))
        squares = [
            (y, x)
            for y in range(n - width + 1)
            for x in range(n - width + 1)
            if region[y : y + width, x : x + width].all()
        ]
        exists = False
        for triple in itertools.combinations(squares, 3):
            labels = np.zeros((n, n), dtype=np.int8)
            for k, (y, x) in enumerate(triple):
                labels[y : y + width, x : x + width] = k + 1
            near = any(
                max(abs(a - c), abs(b - d)) < width + gap for (a, b), (c, d) in itertools.combinations(triple, 2)
            )
            if not near and borders(labels, np.zeros((n, n), dtype=bool), grid, panel).legal:
                exists = True
                break
        found = three_facing_squares(facing_squares(region, grid, used))
        assert any(found) == exists
        both.add(exists)
    assert both == {False, True}


def test_three_squares_is_none_where_three_fit():
    assert three_squares(np.ones((5, 5), dtype=bool), cells(5, 2, 1)) is None
    proof = three_squares(np.ones((5, 5), dtype=bool), cells(5, 2, 2))
    assert proof.numbers["squares"] == 1
    assert three_squares(np.ones((5, 5), dtype=bool), cells(5, 2, 1, to_opening=1)) is None


def test_the_largest_gap_is_bracketed():
    given = rules(required=60 / PIXEL)
    answer = largest_gap(fitted(), DOT, GUTTER, EVERY, given)
    assert answer.footprint.verdict is Verdict.FITS
    at_found = footprint(fitted(), DOT, GUTTER, EVERY, rules(gap=answer.found_nm // DOT, required=60 / PIXEL))
    assert at_found.found_share == answer.footprint.found_share
    excluded = rules(gap=answer.excluded_nm // DOT, required=60 / PIXEL)
    assert footprint(fitted(), DOT, GUTTER, EVERY, excluded).verdict is Verdict.DOES_NOT_FIT
    assert answer.found_nm < answer.excluded_nm


def test_the_largest_gap_where_nothing_or_everything_fits():
    closed = largest_gap(Opening("open", np.ones((9, 9)), DOT), DOT, GUTTER, EVERY, rules())
    assert (closed.found_nm, closed.excluded_nm, closed.footprint) == (None, 0, None)
    free = largest_gap(Opening("closed", np.zeros((9, 9)), DOT), DOT, GUTTER, (0,), rules(width=1))
    # Two lines of 3 dots between three squares of 1; the gutter adds one to the gap across the border.
    assert free.found_nm >= 2 * DOT


def test_impossible_rules_are_refused():
    with pytest.raises(JobError, match="MF117"):
        footprint(slit(), DOT, GUTTER, EVERY, rules(width=22))
    with pytest.raises(JobError, match="MF118"):
        footprint(slit(), DOT, GUTTER, EVERY, EmitterRules(10, 8000, 16000))


@pytest.mark.parametrize(("gap", "width"), [(8000, 8000), (16000, 10000), (20000, 12000)])
@pytest.mark.parametrize(("dot", "name"), [(8000, "150 DPI"), (4000, "300 DPI")])
def test_the_authors_mask_under_a_makers_rules(gap, width, dot, name):
    opening = Opening("published", published("L2Inv_Random"), dot)
    answer = checked(opening, dot, GUTTER, EVERY, EmitterRules(4000, gap, width))
    # Shares were published of the 21 x 21 dots alone, without the gutter.
    scale = (opening.dots * dot + GUTTER) ** 2 / (opening.dots * dot) ** 2
    known = {
        (8000, 8000): (11.9, 15.6),
        (8000, 16000): (9.5, 10.2),
        (8000, 20000): (8.1, 8.8),
        (4000, 8000): (9.5, 9.7),
        (4000, 16000): (5.1, 5.1),
        (4000, 20000): (0.0, 0.0),
    }[dot, gap]
    assert 100 * scale * answer.rectangles_share == pytest.approx(known[0], abs=0.3)
    assert 100 * scale * answer.found_share >= known[1] - 0.3


def test_crooked_borders_need_no_margin():
    opening = Opening("published", published("L2Inv_Random"), DOT)
    given = EmitterRules(4000, 20000, 12000)
    with_margin = checked(opening, DOT, GUTTER, EVERY, given).found_share
    # One colour has the borders to itself: 10.5 % of the pixel instead of 8.1 %.
    assert checked(opening, DOT, GUTTER, EVERY, given, largest=True).found_share > 1.2 * with_margin


def test_a_share_that_no_one_found_is_not_called_possible():
    opening = Opening("published", published("L2Inv_Random"), 4000)
    answer = checked(opening, 4000, GUTTER, EVERY, EmitterRules(4000, 16000, 10000, required=0.093))
    assert answer.verdict is not Verdict.FITS


def test_a_grid_of_42_cells_takes_a_fraction_of_a_second():
    start = time.perf_counter()
    footprint(fitted(), DOT, GUTTER, EVERY, EmitterRules(4000, 16000, 12000, max_aspect=math.inf))
    # Measured on one quiet core: 0.05 s; the limit leaves room for a busy machine.
    assert time.perf_counter() - start < 1
