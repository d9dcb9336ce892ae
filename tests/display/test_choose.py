"""Where the light comes from, and which placement brings it to the middle: rules measured anew, and symmetric cases."""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
import pytest
from display.shapes import ALIKE, bar, broken_rules, cells, published
from scipy import ndimage
from sweeps import in_turns, sweep

from maskfab.base.model import Emitters, Opening, Tiling
from maskfab.base.resources import path
from maskfab.display.emitter_rules import EmitterRules, grid_of
from maskfab.display.emitter_shapes import cut_triples, guillotine, shaved
from maskfab.display.free_area import Squares, borders, free_region
from maskfab.display.placement import centred, footprint, wander
from maskfab.mask.opening_file import parse_opening
from maskfab.optics.colour import luminance_centroid
from maskfab.optics.tiling import orientations

ALL = orientations(Tiling.RANDOM, 40, 40, 1)
DOT = 8000


def slit() -> Opening:
    return Opening("slit", bar(21, 5, 8), DOT)


def fitted() -> Opening:
    return parse_opening(path("layouts/openings/toled.toml").read_text(encoding="utf-8"))


def offset(emitters: Emitters, pitch_nm: int) -> float:
    return math.hypot(*luminance_centroid(emitters, pitch_nm))


def chosen(opening: Opening, rules: EmitterRules, keep: float, gutter: int = DOT, panel: np.ndarray = ALL) -> Emitters:
    """The choice, after all rules were measured again on it."""
    grid = grid_of(opening, DOT, gutter, rules)
    used = range(8)
    found = footprint(opening, DOT, gutter, used, rules, largest=True).best
    assert found is not None
    emitters = centred(found, opening, grid, panel, rules, keep=keep)
    assert emitters is not None
    best, least = (min((each.labels == k + 1).sum() / rules.ratio[k] for k in range(3)) for each in (found, emitters))
    assert least >= keep * best - 1e-9
    region = free_region(opening.mask, grid, used)
    assert broken_rules(emitters.labels, region, grid, rules.ratio, least) == []
    clear = np.kron(opening.mask, np.ones((grid.per_dot, grid.per_dot), dtype=bool))
    assert borders(emitters.labels, clear, grid, panel).legal
    # To within what makes a visible difference.
    assert offset(emitters, grid.pitch_nm) <= offset(found, grid.pitch_nm) + 0.001
    return emitters


def test_centroid_of_stripes_and_its_wander() -> None:
    """Red left, green middle, blue right: the light leans towards red by (0.2126 - 0.0722) stripe pitches."""
    labels = np.repeat(np.array([1, 2, 3], dtype=np.int8), 3)[None].repeat(9, axis=0)
    emitters = Emitters(labels, 1000)
    x, y = luminance_centroid(emitters, 9000)
    assert y == pytest.approx(0)
    assert x == pytest.approx((0.0722 - 0.2126) / 3)
    assert wander(emitters, 9000) == pytest.approx(abs(x))
    assert wander(emitters, 9000, [0]) == 0
    centred = Emitters(np.where(labels == 2, labels, 0), 1000)
    assert luminance_centroid(centred, 9000) == pytest.approx((0, 0))


@pytest.mark.parametrize(
    ("opening", "most"),
    [
        pytest.param(slit(), 0.035, id="slit"),
        pytest.param(fitted(), 0.015, id="toled"),
        pytest.param(None, 0.050, id="inv_random"),
    ],
)
def test_three_quarters_of_the_area_are_enough_to_centre_the_light(opening: Opening | None, most: float) -> None:
    opening = opening or Opening("inv_random", published("L2Inv_Random"), DOT)
    emitters = chosen(opening, EmitterRules(0, DOT, 2 * DOT), 0.75)
    assert offset(emitters, 22 * DOT) <= most


@pytest.mark.parametrize(
    ("gutter", "rules"),
    sweep(in_turns([0, 8000], [EmitterRules(4000, 16000, 12000), EmitterRules(8000, 24000, 16000)]), 2),
)
def test_neighbours_keep_the_rules_where_the_gap_is_wider_than_the_gutter(gutter: int, rules: EmitterRules) -> None:
    chosen(fitted(), rules, 0.8, gutter)


@pytest.mark.parametrize("ratio", set(itertools.permutations((1.0, 1.0, 2.5))))
def test_colours_keep_their_ratio(ratio: tuple[float, float, float]) -> None:
    rules = EmitterRules(0, DOT, 2 * DOT, ratio)
    for keep in (1.0, 0.8):
        emitters = chosen(slit(), rules, keep)
        held = [(emitters.labels == k + 1).sum() / rules.ratio[k] for k in range(3)]
        assert max(held) <= 1.25 * min(held)


def test_what_is_required_and_found_is_kept() -> None:
    needed = 75 / 22**2
    emitters = chosen(slit(), EmitterRules(0, DOT, 2 * DOT, required=needed), 0.5)
    assert min((emitters.labels == k).sum() for k in (1, 2, 3)) >= 75


def test_an_empty_pixel_is_centred_and_nothing_stays_nothing() -> None:
    opening = Opening("none", np.zeros((21, 21)), DOT)
    rules = EmitterRules(0, DOT, 2 * DOT)
    assert offset(chosen(opening, rules, 0.7), 22 * DOT) < 0.01
    assert centred(None, opening, grid_of(opening, DOT, DOT, rules), ALL, rules, keep=0.7) is None


def test_is_the_same_each_time_and_quick() -> None:
    for rules, limit in ((EmitterRules(0, DOT, 2 * DOT), 0.06), (EmitterRules(4000, 16000, 12000), 0.25)):
        opening = fitted()
        grid = grid_of(opening, DOT, DOT, rules)
        found = footprint(opening, DOT, DOT, range(8), rules).best
        took, seen = [], set()
        for _ in range(3):
            start = time.process_time()
            emitters = centred(found, opening, grid, ALL, rules, keep=0.75)
            took.append(time.process_time() - start)
            assert emitters is not None
            seen.add(emitters.labels.tobytes())
        assert len(seen) == 1
        assert min(took) < 4 * limit


def test_triples_hold_the_best_cuts_and_are_large_enough() -> None:
    rng = np.random.default_rng(5)
    for _ in range(6):
        region = ndimage.gaussian_filter(rng.random((15, 15)), 1.5) > 0.47
        grid = cells(15, 2, 1)
        squares = Squares.of(region, 2, 1)
        best, _ = guillotine(region, grid, ALIKE)
        triples = list(cut_triples(squares, best, 99))
        assert triples
        least = [min(squares.area(shape) for shape in shapes) for shapes in triples]
        assert min(least) == max(least) == best
        for a, b, c in cut_triples(squares, 0.6 * best, 5):
            assert not squares.near(a) & (b | c)
            assert not squares.near(b) & c
            assert min(map(squares.area, (a, b, c))) >= 0.6 * best


@pytest.mark.parametrize("towards", [(1.0, 0.2), (-1.0, -0.2), (0.2, 1.0), (0.2, -1.0)])
def test_shaving_moves_the_middle_away_from_the_side(towards: tuple[float, float]) -> None:
    squares = Squares.of(np.ones((9, 9), dtype=bool), 2, 0)
    whole = squares.window(1, 8, 1, 8)
    rest = shaved(squares, whole, towards, 14, 20)
    assert squares.area(whole) - 14 - 2 <= squares.area(rest) <= squares.area(whole) - 14
    middle = np.argwhere(squares.picture(rest)).mean(axis=0) - 4
    assert middle @ np.array(towards) < -0.5
    assert shaved(squares, whole, towards, 14, 49) == whole
