"""Emitters in several pieces: rules kept, light alike in all orientations, bounds and contradictions."""

from __future__ import annotations

import math
import random
from functools import partial

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.base.model import Emitters, Opening, Panel, Tiling
from maskfab.display import emitter_pieces
from maskfab.display.drive import CircuitRules, LightDemand
from maskfab.display.emitted_light import Viewing
from maskfab.display.emitter_pieces import (
    USUAL,
    _Annealing,
    _draws,
    _lack,
    in_pieces,
    look,
    pieces_bound,
    placed_in_pieces,
)
from maskfab.display.emitter_rules import EmitterRules, Proof, Verdict, grid_of
from maskfab.display.evenness import Evenness
from maskfab.display.feasibility import DisplayRules, feasibility
from maskfab.display.free_area import EVERY, Squares, borders, free_region
from maskfab.display.placement import footprint
from maskfab.job.sections import EmittersSection

RULES = EmitterRules(8000, 8000, 8000)
NEAR = Viewing(112.0, 200e3)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(emitter_pieces, "in_pieces", partial(in_pieces, moves=10_000))


def excess(seen) -> float:
    """Share of the nearer limit of the eye."""
    return max(seen.delta_e / USUAL.delta_e, seen.grain / USUAL.grain)


def corner() -> Opening:
    mask = np.zeros((14, 14), dtype=np.bool_)
    mask[1:5, 2:8] = True
    return Opening("corner", mask, 8000)


def panel_of(opening, kinds=8) -> Panel:
    cells = np.random.default_rng(0).integers(kinds, size=(20, 20)).astype(np.int8)
    return Panel(opening, 8000, 0, cells, Tiling.RANDOM, 0)


def test_pieces_look_more_alike_than_whole_emitters_and_keep_every_rule(quick):
    whole, parts = (
        feasibility(panel_of(corner()), DisplayRules(RULES, 0.5, CircuitRules(1.0), LightDemand(), None, pieces=pieces))
        for pieces in (False, True)
    )
    assert parts.verdict is Verdict.FITS or not parts.broken
    assert parts.broken == ()
    assert excess(parts.even) < 0.7 * excess(whole.even)
    assert parts.share >= 0.5 * whole.footprint.found_share - 1e-9
    assert parts.share <= parts.footprint.bound_share + 1e-12


def test_the_area_asked_for_is_there_and_borders_are_kept(quick):
    opening = corner()
    grid = grid_of(opening, 8000, 0, RULES)
    placed = in_pieces(opening, grid, EVERY, RULES.ratio, 15, NEAR, moves=3000)
    assert min((placed.labels == colour).sum() for colour in (1, 2, 3)) >= 15
    cells = np.random.default_rng(1).integers(8, size=(12, 12)).astype(np.int8)
    assert borders(placed.labels, opening.mask, grid, cells).legal


def test_the_same_seed_places_the_same_pieces(quick):
    grid = grid_of(corner(), 8000, 0, RULES)
    one, other, third = (
        in_pieces(corner(), grid, EVERY, RULES.ratio, 15, NEAR, seed=seed, moves=1000) for seed in (3, 3, 4)
    )
    assert np.array_equal(one.labels, other.labels)
    assert not np.array_equal(one.labels, third.labels)


@pytest.mark.parametrize(("seed", "width", "gap"), [(0, 1, 1), (1, 2, 2), (2, 3, 0), (3, 2, 1)])
def test_what_a_search_keeps_is_what_counting_in_full_gives(seed, width, gap):
    rng = np.random.default_rng(seed)
    squares = Squares.of(rng.random((11, 11)) > 0.02, width, gap)
    seen = rng.normal(size=(3, 11, 11, 5))
    targets = (20, 15, 25)
    search = _Annealing(squares, seen, targets, seed)
    search.run(2000)
    for held, cover, area, edges, own, light in zip(
        search.held, search.covers, search.areas, search.edges, seen, search.lights, strict=False
    ):
        cells = squares.picture(held)
        assert cover == squares.cover(held)
        assert area == cells.sum() > 0
        assert edges == sides(cells)
        assert light == pytest.approx(own[cells].sum(axis=0), abs=1e-10)
    # Moves that are only asked for, of every kind.
    kinds = set()
    for place in range(0, len(search.bits), 3):
        for colour in range(3):
            changes = search._changes(place, colour)
            kinds.add((len(changes), changes[0][-1] > 0))
            after = {k: held for k, held, *_ in changes}
            pictures = [squares.picture(after.get(k, held)) for k, held in enumerate(search.held)]
            areas = [int(cells.sum()) for cells in pictures]
            assert areas == [
                area + sum(more for own, *_, more in changes if own == k) for k, area in enumerate(search.areas)
            ]
            assert search._edges(changes) == [sides(cells) for cells in pictures]
            total = sum(own[cells].sum(axis=0) / max(1, cells.sum()) for own, cells in zip(seen, pictures, strict=True))
            assert search._length(place, changes, areas) == pytest.approx(np.linalg.norm(total), abs=1e-10)
    assert {(1, False), (2, True), (3, True)} <= kinds


def sides(cells) -> int:
    """Sides between cells that are lit and cells that are not, or lie outside."""
    framed = np.pad(cells, 1)
    return sum(int((np.diff(framed, axis=axis) != 0).sum()) for axis in (0, 1))


def test_moves_are_drawn_as_python_draws_them():
    draw = random.Random(7)
    for move, (place, colour, spare) in enumerate(_draws(7, 1026, 500)):
        assert (place, colour) == (draw.randrange(1026), draw.randrange(3))
        assert spare == -0.2 * math.exp(math.log(0.01 / 0.2) / 500 * move) * math.log(1 - draw.random()) >= 0


def test_a_colour_pays_for_the_area_that_it_lacks():
    prices = [_lack(area, 100) for area in range(120)]
    assert prices == sorted(prices, reverse=True)
    assert prices[101] == 0 < prices[100]
    assert prices[0] - prices[1] > 10


def test_no_placement_exceeds_the_bound_of_pieces(quick):
    grid = grid_of(corner(), 8000, 0, RULES)
    bound, proof = pieces_bound(free_region(corner().mask, grid), grid, RULES.ratio)
    assert proof.proof is Proof.COMPONENT_PACKING
    assert in_pieces(corner(), grid, EVERY, RULES.ratio, bound + 1, NEAR, moves=3000) is None


def test_pieces_of_the_ratio_asked_for(quick):
    grid = grid_of(corner(), 8000, 0, RULES)
    placed = in_pieces(corner(), grid, EVERY, (0.75, 0.75, 1.5), 14, NEAR, moves=3000)
    red, green, blue = ((placed.labels == colour).sum() for colour in (1, 2, 3))
    assert red >= 11
    assert green >= 11
    assert blue >= 21


def test_where_nothing_is_free_nothing_is_placed():
    opening = Opening("open", np.ones((14, 14), dtype=np.bool_), 8000)
    grid = grid_of(opening, 8000, 0, RULES)
    assert in_pieces(opening, grid, EVERY, RULES.ratio, 1, NEAR, moves=3000) is None


def test_pixels_that_lie_alike_are_left_as_they_were(quick):
    answers = [
        feasibility(
            panel_of(corner(), 1), DisplayRules(RULES, 0.5, CircuitRules(1.0), LightDemand(), None, pieces=pieces)
        )
        for pieces in (False, True)
    ]
    assert np.array_equal(answers[0].emitters.labels, answers[1].emitters.labels)


def test_emitters_of_all_symmetries_look_alike():
    labels = np.zeros((14, 14), dtype=np.int8)
    labels[6:8, 6:8] = 2
    labels[[0, 0, 13, 13], [0, 13, 0, 13]] = 1
    labels[[0, 0, 13, 13, 6, 7, 6, 7], [6, 7, 6, 7, 0, 0, 13, 13]] = 3
    assert look(Emitters(labels, 8000), 112_000, EVERY, Viewing(112.0, 600e3)).delta_e < 1e-6


def test_rectangles_in_pieces_contradict_each_other():
    section = EmittersSection(colour_gap="8 um", min_width="8 um", pieces="several", max_aspect=4.0, keep=0.7)
    with pytest.raises(JobError, match=r"MF105 .*max_aspect"):
        DisplayRules.of(section, None, None)


def test_pieces_need_some_of_the_largest_footprint():
    section = EmittersSection(colour_gap="8 um", min_width="8 um", pieces="several")
    with pytest.raises(JobError, match=r"MF105 keep = 1 leaves no room .*Set keep = 0.75"):
        DisplayRules.of(section, None, None)


def test_a_lax_limit_is_spent_on_area(quick):
    grid = grid_of(corner(), 8000, 0, RULES)
    whole = footprint(corner(), 8000, 0, EVERY, RULES, largest=True)
    areas = []
    limits = Evenness(5.0, 0.05)
    for larger in (False, True):
        _, drawn = placed_in_pieces(
            whole, None, corner(), grid, EVERY, RULES, keep=0.4, viewing=NEAR, limits=limits, larger=larger
        )
        areas.append(min(drawn.areas_um2))
        assert look(drawn, grid.pitch_nm, EVERY, NEAR).delta_e < limits.delta_e
        assert look(drawn, grid.pitch_nm, EVERY, NEAR).grain < limits.grain
    assert areas[1] > areas[0]


def test_a_search_that_counts_grain_leaves_less_of_it():
    grid = grid_of(corner(), 8000, 0, RULES)
    lax, strict = (
        look(
            in_pieces(corner(), grid, EVERY, RULES.ratio, 15, NEAR, limits=Evenness(2.3, grain), moves=10_000),
            grid.pitch_nm,
            EVERY,
            NEAR,
        )
        for grain in (10.0, 0.005)
    )
    assert strict.grain < 0.7 * lax.grain
