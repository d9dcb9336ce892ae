"""Numbers of the eye of a display as it is tiled: fast, exact, and those of ``check --look``."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import examples, in_turns, sweep

from maskfab.base.errors import JobError
from maskfab.base.model import Emitters, Tiling, orient
from maskfab.display import emitted_light, eye, pictures
from maskfab.display.emitted_light import Tile, Tiled, Viewing, series
from maskfab.display.emitter_rules import EmitterRules
from maskfab.display.evenness import evenness
from maskfab.display.looks import field_of, looks, looks_of_reference, seen
from maskfab.display.reference import LAYOUTS, Reference

RULES = EmitterRules(4000, 8000, 8000)


def looked_at(panel, viewing, count=60):
    return looks(Tiled.of(panel, count, count), viewing)


@pytest.mark.parametrize("picture", ["edge", "text", "leaves"])
def test_the_series_is_that_of_the_light_on_fine_samples(slit_panel, telephone, picture):
    """Samples that divide every emitter lose nothing, so that both ways are exact."""
    panel = slit_panel((2, 3, 1), count=12)
    image = getattr(pictures, picture)(12)
    fine = series(emitted_light.show(panel, image, 42), telephone, eye.HIGHEST_CPD)
    exact = Tiled.of(panel, 12, 12).series(image, telephone, eye.HIGHEST_CPD)
    np.testing.assert_allclose(exact.coefficients, fine.coefficients, atol=1e-12)
    np.testing.assert_array_equal(exact.x_cpd, fine.x_cpd)


@pytest.mark.parametrize("order", [(1, 2, 3), (3, 1, 2)])
def test_numbers_are_those_of_the_pictures_that_are_judged(slit_panel, telephone, order):
    panel = slit_panel(order, count=40)
    judged = {q.name: float(q) for q in eye.judge("D", panel, eye.target_pictures(40), 6, telephone).quantities}
    found = looked_at(panel, telephone, 40)
    assert found.delta_e == pytest.approx(judged["flat_delta_e_mean"], rel=1e-9)
    assert found.delta_e_95 == pytest.approx(judged["flat_delta_e_95"], rel=1e-9)
    assert found.grain == pytest.approx(judged["grain_slow"], rel=1e-9)
    assert found.fine_grain == pytest.approx(judged["grain_fine"], rel=1e-9)
    # There the common shift is that of the whole panel's mean pixel, here of the field's.
    assert found.fringe == pytest.approx(judged["edge_fringe"], rel=1e-9)


def test_random_pixels_are_as_even_as_the_closed_form_says(slit_panel, telephone):
    panel = slit_panel((1, 3, 2), count=100)
    found, quick = looked_at(panel, telephone, 100), evenness(panel, telephone)
    assert found.delta_e == pytest.approx(quick.delta_e, rel=0.05)
    assert found.grain == pytest.approx(quick.grain, rel=0.06)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_regular_display_has_neither_spots_nor_grain(layout):
    reference = Reference.of(layout, 84_000, RULES)
    found = looks_of_reference(reference, 41, Viewing(84.0, 400e3))
    assert found.delta_e < 0.05
    assert found.grain < 1e-12


@pytest.mark.parametrize("layout", LAYOUTS)
def test_few_pixels_of_a_reference_stand_for_many(layout):
    reference, viewing = Reference.of(layout, 168_000, RULES), Viewing(168.0, 300e3)
    many, few = looks(reference.tiled(20, 20), viewing), looks_of_reference(reference, 20, viewing)
    np.testing.assert_allclose(
        [many.delta_e, many.delta_e_95, many.fringe, many.fine_grain],
        [few.delta_e, few.delta_e_95, few.fringe, few.fine_grain],
        rtol=2e-3,
        atol=1e-9,
    )


@settings(max_examples=20, deadline=None)
@given(turn=st.integers(0, 3), seed=st.integers(0, 2**31))
def test_a_field_that_is_turned_as_a_whole_is_as_even_as_before(turn, seed):
    rng = np.random.default_rng(seed)
    labels = rng.permutation(np.repeat(np.arange(4, dtype=np.int8), 9)).reshape(6, 6)
    lines = np.linspace(0.05, 0.95, 7)
    tile, held = Tile(labels, lines), rng.integers(8, size=(10, 10))
    viewing = Viewing(84.0, 300e3)
    first = looks(Tiled(tuple(tile.turned(k) for k in range(8)), held, 84.0), viewing)
    # Every pixel turned, and the field with them.
    turned = tuple(Tile(orient(orient(labels, k), turn), lines) for k in range(8))
    second = looks(Tiled(turned, np.ascontiguousarray(orient(held, turn)), 84.0), viewing)
    np.testing.assert_allclose(
        [first.delta_e, first.delta_e_95, first.grain, first.fine_grain],
        [second.delta_e, second.delta_e_95, second.grain, second.fine_grain],
        rtol=1e-6,
        atol=1e-9,
    )


def test_from_farther_away_and_at_a_finer_scale_less_is_seen(slit_panel):
    panel = slit_panel((3, 1, 2), count=60)
    near, far, finer = (looked_at(panel, Viewing(*at)) for at in ((84.672, 300e3), (84.672, 600e3), (42.336, 300e3)))
    assert far.delta_e < near.delta_e / 2
    assert finer.delta_e == pytest.approx(far.delta_e, rel=1e-9)


def test_the_field_is_that_of_the_map_else_up_to_a_hundred_pixels():
    telephone = Viewing(168.0, 300e3)
    assert field_of((50, 50), telephone, (24, 20)) == (24, 20)
    assert field_of((50, 200), telephone) == (50, 100)
    assert field_of((16, 16), telephone, (24, 24)) == (16, 16)
    assert field_of((200, 200), Viewing(168.0, 10e3)) == (8, 8)


def test_a_die_takes_less_than_a_second(slit_panel, telephone):
    panel = slit_panel(count=100)
    start = time.process_time()
    looked_at(panel, telephone, 100)
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize("picture", ["flat", "text"])
def test_the_picture_as_it_is_seen_has_the_light_that_was_asked(slit_panel, telephone, picture):
    shown = Tiled.of(slit_panel(count=40), 40, 40)
    light = seen(shown, telephone, picture)
    assert light.dtype == np.float32
    assert light.shape == (40 * eye.carrying(eye.HIGHEST_CPD, telephone),) * 2 + (3,)
    np.testing.assert_allclose(light.mean(axis=(0, 1)), getattr(pictures, picture)(40).mean(axis=(0, 1)), rtol=1e-3)


def test_a_reference_shows_text_as_well(telephone):
    shown = Reference.of("stripe", 84_000, RULES).tiled(40, 40)
    assert np.ptp(seen(shown, telephone, "text")) > 0.3


# The reference display.


@pytest.mark.parametrize(("layout", "ratio"), sweep(in_turns(LAYOUTS, [(1, 1, 1), (1, 1, 2), (2, 1, 1.5)]), 3))
def test_a_reference_keeps_the_rules_and_the_ratio(layout, ratio):
    """Measured on cells of a micrometre, across the sides of pixels: gaps between colours, and areas."""
    pitch_um, gap_um = 168, 8
    rules = EmitterRules(4000, gap_um * 1000, 8000, ratio)
    shown = Reference.of(layout, pitch_um * 1000, rules).tiled(2, 2)
    samples = 10 * pitch_um
    cells = np.zeros((2 * samples, 2 * samples), dtype=np.int8)
    for row, column in np.ndindex(2, 2):
        tile = shown.tiles[shown.held[row, column]]
        middles = (np.arange(samples) + 0.5) / samples
        at = np.searchsorted(tile.lines, middles) - 1
        cells[row * samples : (row + 1) * samples, column * samples : (column + 1) * samples] = tile.labels[
            np.ix_(at, at)
        ]
    areas = np.array([(cells == colour).sum() for colour in (1, 2, 3)])
    np.testing.assert_allclose(areas / areas.sum(), np.array(ratio) / sum(ratio), rtol=5e-3)
    np.testing.assert_allclose(areas / cells.size, shown.shares, rtol=5e-3)
    reach = 10 * gap_um - 2  # Chebyshev, less a sample on either side
    wrapped = np.pad(cells, reach, mode="wrap")
    from scipy.ndimage import maximum_filter

    near = {colour: maximum_filter((wrapped == colour).astype(np.int8), 2 * reach - 1) for colour in (1, 2, 3)}
    for colour in (1, 2, 3):
        for other in {1, 2, 3} - {colour}:
            assert not (near[colour].astype(bool) & (wrapped == other)).any()


RATIO = st.tuples(*[st.floats(0.3, 3)] * 3)


@examples(100)
@given(
    layout=st.sampled_from(LAYOUTS),
    pitch=st.integers(20_000, 200_000),
    gap=st.integers(0, 30_000),
    width=st.integers(500, 20_000),
    ratio=RATIO,
)
def test_whatever_the_rules_a_reference_keeps_them_or_is_refused(layout, pitch, gap, width, ratio):
    """Exactly, from the rectangles of three by three pixels about one of each kind."""
    try:
        reference = Reference.of(layout, pitch, EmitterRules(0, gap, width, ratio))
    except JobError:
        return
    np.testing.assert_allclose(np.array(reference.shares) / sum(reference.shares), np.array(ratio) / sum(ratio))
    shown = reference.tiled(4, 4)
    boxes = []
    for row, column in np.ndindex(4, 4):
        tile = shown.tiles[shown.held[row, column]]
        for y, x in zip(*np.nonzero(tile.labels), strict=True):
            low, high = tile.lines[[x, y]] + (column, row), tile.lines[[x + 1, y + 1]] + (column, row)
            boxes.append((*low, *high, tile.labels[y, x]))
    x0, y0, x1, y1, colour = np.array(boxes).T
    apart = [np.maximum(low[:, None] - high, low - high[:, None]) for low, high in ((x0, x1), (y0, y1))]
    other = colour[:, None] != colour
    assert np.maximum(*apart)[other].min() * pitch >= gap - 1e-3


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_pixel_of_a_reference_sends_every_colour_alike(layout):
    shown = Reference.of(layout, 100_000, RULES).tiled(2, 2)
    np.testing.assert_allclose([tile.shares for tile in shown.tiles], [shown.shares] * len(shown.tiles), rtol=1e-9)


def test_stripes_by_hand():
    reference = Reference.of("stripe", 168_000, RULES)
    # (168 - 3 * 8) / 3 = 48 wide and 160 high.
    np.testing.assert_allclose(reference.shares, 48 * 160 / 168**2, rtol=1e-9)
    assert reference.tile.centroid == pytest.approx(((0.0722 - 0.2126) * 56 / 168, 0.0), abs=2e-5)


@pytest.mark.parametrize(
    ("layout", "pitch_nm", "width"),
    [
        ("stripe", 47_900, f"{47.9 / 3 - 8:.4g}"),
        # Squares of sides 2^½ : 1 along a row; half a pixel's height.
        ("pentile", 35_200, f"{(35.2 - 2 * 8) / (1 + 2**0.5):.4g}"),
        ("delta", 31_000, f"{31 / 2 - 8:.4g}"),
    ],
)
def test_a_reference_that_breaks_its_own_rules_is_refused(layout, pitch_nm, width):
    with pytest.raises(JobError, match=rf"MF117 .* leaves emitters {width} um wide, and min_width is 8 um.*Use"):
        Reference.of(layout, pitch_nm, RULES)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_gap_as_wide_as_the_pixel_is_refused(layout):
    with pytest.raises(JobError, match="MF117"):
        Reference.of(layout, 30_000, EmitterRules(0, 29_000, 1000))


def test_emitters_in_the_file_of_an_opening_are_looked_at_too(slit_panel, telephone):
    panel = slit_panel(count=10)
    brought = replace(panel, emitters=None, opening=replace(panel.opening, emitters=panel.emitters.labels))
    assert looked_at(brought, telephone, 10) == looked_at(panel, telephone, 10)


def test_a_die_without_a_colour_is_refused(slit_panel, telephone):
    panel = slit_panel(tiling=Tiling.PERIODIC, count=10)
    labels = np.where(panel.emitters.labels == 3, 0, panel.emitters.labels)
    with pytest.raises(JobError, match="MF121 no part of a pixel emits blue"):
        Tiled.of(replace(panel, emitters=Emitters(labels, panel.emitters.cell_nm)), 10, 10)
