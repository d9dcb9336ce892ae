"""Lines laid across panels as their cells lie: every rule measured by KLayout, or a chain of openings as a proof."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from klayout import db
from sweeps import examples

from maskfab.base.model import CLEAR, ORIENTATIONS, Opening, Panel, Tiling
from maskfab.display.panel_lines import AXES, PanelLines, _Field, panel_cut, panel_lines
from maskfab.display.pixel_lines import WireRules
from maskfab.display.polygon_check import line_violations, whole_panel
from maskfab.mask.opening_file import load_opening

RULES = WireRules(3000, 3000, 2500)
OPENINGS = Path(__file__).parents[2] / "layouts" / "openings"


def panel_of(mask, kinds, *, dot_nm=8000, gutter_nm=0, others=()) -> Panel:
    opening, more = (Opening("a", np.asarray(mask, dtype=bool), dot_nm), [Opening("b", m, dot_nm) for m in others])
    cells = np.asarray(kinds, dtype=np.int8)
    return Panel(opening, dot_nm, gutter_nm, cells, Tiling.RANDOM, 1, others=tuple(more))


def drawn_at_random(seed: int, side: int = 4) -> Panel:
    draw = np.random.default_rng(seed)
    dots = int(draw.integers(5, 10))
    mask = draw.random((dots, dots)) < draw.choice([0.05, 0.1, 0.2, 0.3])
    mask[draw.integers(dots), draw.integers(dots)] = True
    kinds = draw.integers(0, ORIENTATIONS, (side, side))
    dot, gutter = int(draw.choice([4000, 5200, 8000, 11000])), int(draw.choice([0, 0, 4000, 8000]))
    return panel_of(mask, kinds, dot_nm=dot, gutter_nm=gutter)


def measured(panel: Panel, laid: PanelLines, rules: WireRules, count: int) -> None:
    """Every rule on the whole panel by KLayout's own operations, and every line in its own pixels."""
    clear = whole_panel(panel, (CLEAR,))[CLEAR]
    metal = db.Region(laid.polygons(rules.line_nm)).merged()
    lines = list(metal.each())
    pixels = panel.orientations.shape[1 if laid.axis == "y" else 0]
    assert len(lines) == len(laid.paths) == count * pixels
    assert (metal.sized(rules.clearance_nm, 2) & clear).is_empty()
    assert metal.space_check(rules.space_nm).count() == 0
    assert metal.width_check(rules.line_nm).count() == 0
    width, height = panel.size_nm
    for number, path in enumerate(laid.paths):
        own, (across, along) = number // count, list(zip(*path, strict=True))[:: 1 if laid.axis == "y" else -1]
        assert panel.pitch_nm * (own - 1) <= min(across) - rules.line_nm // 2
        assert max(across) + rules.line_nm // 2 <= panel.pitch_nm * (own + 2)
        assert (along[0], along[-1]) == (0, height if laid.axis == "y" else width)
        assert list(along) == sorted(along)


@examples(40)
@given(st.integers(0, 10**6))
def test_lines_are_laid_and_keep_every_rule_or_a_chain_proves_that_they_cannot(seed):
    panel = drawn_at_random(seed)
    for axis in AXES:
        for count in (1, 3):
            laid, cut = panel_lines(panel, RULES, count, axis), panel_cut(panel, RULES, count, axis)
            assert not (laid.paths and cut), "proved impossible, and drawn"
            if laid.paths:
                measured(panel, laid, RULES, count)


def test_hardly_a_panel_is_left_undecided():
    undecided = 0
    for seed in range(40):
        panel = drawn_at_random(seed)
        undecided += panel_cut(panel, RULES, 3, "x") is None and not panel_lines(panel, RULES, 3, "x").paths
    assert undecided <= 2


def test_a_proof_is_counted_again_on_the_polygons():
    """Along the chain, between its openings, no more lines fit than it says: a count that knows nothing of graphs."""
    told = 0
    for seed in range(20):
        panel = drawn_at_random(seed)
        cut = panel_cut(panel, RULES, 2, "y")
        if cut is None:
            continue
        told += 1
        clear = whole_panel(panel, (CLEAR,))[CLEAR]
        gaps = list(zip(cut.chain_nm[::2], cut.chain_nm[1::2], strict=True))
        for number, (one, other) in enumerate(gaps):
            ends = (other,) if number == 0 else (one,) if number == len(gaps) - 1 else (one, other)
            assert all(not (db.Region(db.Box(x - 1, y - 1, x + 1, y + 1)) & clear).is_empty() for x, y in ends)
        free = [max(abs(x1 - x0), abs(y1 - y0)) + RULES.space_nm for (x0, y0), (x1, y1) in gaps]
        assert cut.numbers["lines"] <= sum(each // (RULES.line_nm + RULES.space_nm) for each in free)
        assert cut.numbers["lines"] < cut.numbers["wanted"]
    assert told >= 3


def test_a_way_lies_as_far_to_a_side_as_a_search_of_all_ways_finds():
    found = 0
    for seed in range(40):
        field, draw = _Field.of(drawn_at_random(seed, side=2), RULES, "y"), np.random.default_rng(seed)
        bands = [range(*ends) for ends in pairwise(field.begins.tolist())]
        limit = draw.choice(field.low, len(bands))[field.band] if field.low.size else field.low
        for side, near in ((1, field.low), (-1, field.high)) if limit.size else ():
            left = [[at for at in band if side * (near[at] - limit[field.band == number]).max() <= 0]
                    for number, band in enumerate(bands)]  # fmt: skip
            for _ in range(2):
                for before, band in pairwise(left):
                    band[:] = [to for to in band
                               if any(field.low[at] <= field.high[to] >= field.low[to] <= field.high[at]
                                      for at in before)]  # fmt: skip
                left.reverse()
            within = field.begins[1:] - 1 if side > 0 else field.begins[:-1]
            assert field.way(within, limit, side).tolist() == [max(band, key=lambda at: side * at) for band in left]
            assert field.way(within, limit - side * 10**9, side) is None
            found += 1
    assert found >= 60


def test_lines_turn_with_the_panel():
    panel = panel_of(load_opening(OPENINGS / "fits.toml").mask, np.arange(9).reshape(3, 3) % 8)
    turned = {
        int(k): next(
            j for j in range(ORIENTATIONS) if np.array_equal(panel.pattern(j), np.rot90(panel.pattern(int(k))))
        )
        for k in panel.orientations.ravel()
    }
    other = replace(panel, orientations=np.rot90(np.vectorize(turned.__getitem__)(panel.orientations)))
    for count in (2, 4, 6, 8):
        here, there = (
            {axis: bool(panel_lines(each, RULES, count, axis).paths) for axis in AXES} for each in (panel, other)
        )
        assert (here["x"], here["y"]) == (there["y"], there["x"])


def test_a_line_lies_on_the_border_of_two_pixels():
    """Rims of 4 um at both sides of a border make the 8 um that a line needs, though no gutter is declared."""
    mask = np.ones((6, 6), dtype=bool)
    mask[0], mask[-1], mask[:, 0], mask[:, -1] = (False,) * 4
    panel = panel_of(mask, np.zeros((6, 6)), dot_nm=4000)
    places = {y for path in panel_lines(panel, RULES, 1, "x").paths for _, y in path}
    assert {y for y in places if 0 < y < 144000} == {24000, 48000, 72000, 96000, 120000}
    assert panel_cut(panel, RULES, 1, "x") is None
    assert panel_cut(panel, RULES, 2, "x") is not None


def test_lines_pass_as_many_as_a_gap_holds_and_no_more():
    """Two openings d apart: (d + space - 2 clearance) / (line + space) lines, but for those that go round the panel."""
    for gap_dots in range(4, 12):
        mask = np.zeros((13, 13), dtype=bool)
        mask[6, : (13 - gap_dots) // 2] = mask[6, (13 - gap_dots) // 2 + gap_dots :] = True
        panel = panel_of(mask, np.zeros((11, 11)), dot_nm=2000)
        most = (gap_dots * 2000 + 3000 - 5000) // 6000
        assert len(panel_lines(panel, RULES, most, "y").paths) == 11 * most
        assert panel_cut(panel, RULES, most, "y") is None
        assert not panel_lines(panel, RULES, most + 1, "y").paths
        assert panel_cut(panel, RULES, most + 1, "y") is not None


def test_broken_rules_are_found():
    panel = panel_of(np.arange(25).reshape(5, 5) == 12, np.zeros((3, 3)))
    good = panel_lines(panel, RULES, 2, "y")
    assert line_violations(panel, [good], RULES) == ()
    first = good.paths[0]
    moved = replace(good, paths=(tuple((x + 2000, y) for x, y in good.paths[1]), *good.paths[1:]))
    onto = replace(good, paths=(((20000, 0), (20000, 120000)), *good.paths[1:]))
    out = replace(good, paths=(tuple((x - 90000, y) for x, y in first), *good.paths[1:]))
    for wrong, rule in ((moved, "lines that touch"), (onto, "clearance of lines"), (out, "line far outside the panel")):
        assert rule in {each.rule for each in line_violations(panel, [wrong], RULES)}
    near = replace(good, paths=(tuple((x + 5000, y) for x, y in good.paths[1]), good.paths[1], *good.paths[2:]))
    assert "space between lines" in {each.rule for each in line_violations(panel, [near], RULES)}
    slant = replace(good, paths=tuple(((x, y), (x + 1000, 120000)) for ((x, y), *_) in good.paths))
    assert "width of lines" in {each.rule for each in line_violations(panel, [slant], RULES)}


@settings(max_examples=60)
@given(st.integers(0, 10**6))
def test_space_from_edge_to_edge_is_space_from_polygon_to_polygon(seed):
    """Crooked lines at random, some too near to others or to themselves, against KLayout's check of regions."""
    draw = np.random.default_rng(seed)
    paths = []
    for number in range(4):
        along = np.cumsum(draw.integers(2000, 9000, 8))
        across = 9000 * number + draw.integers(0, 2500, 8)
        corners = [(int(x), int(y)) for x, ends in zip(across, pairwise(along), strict=False) for y in ends]
        paths.append(tuple(corners))
    laid = PanelLines("y", tuple(paths))
    rules = replace(RULES, space_nm=int(draw.integers(1000, 6500)))
    regions = db.Region(laid.polygons(rules.line_nm)).merged()
    near = regions.space_check(rules.space_nm, False, db.Region.Square).count() > 0
    said = {each.rule for each in line_violations(panel_of([[False]], [[0]]), [laid], rules)}
    assert ("space between lines" in said) == near
