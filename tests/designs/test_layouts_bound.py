"""The bound on layouts: its theorem in numbers, for whatever is drawn and whatever weights, and how close it comes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimates import surrogate
from hypothesis import given
from hypothesis import strategies as st
from once import leaves
from sweeps import examples

from maskfab.base.errors import JobError
from maskfab.camera.stop_cells import lay, pupil_autocorrelation
from maskfab.designs.model import layouts_bound
from maskfab.designs.model.expected_psnr import Interior, interior
from maskfab.designs.model.layouts_bound import CellLight, LayoutGap, layout_gap, layout_limit

DOTS, CLEAR = 6, 9


@pytest.fixture(scope="module")
def estimate():
    return surrogate([leaves(1)], DOTS)


@pytest.fixture(scope="module")
def inner(estimate) -> Interior:
    return interior(estimate)


def pairs(inner: Interior, pupil: np.ndarray, weights: np.ndarray) -> float:
    """Sum of w(t) A(t) over all lags of the plane, by the autocorrelation."""
    table = pupil_autocorrelation(pupil)
    middle, reach = len(table) // 2, int(inner.lags.max())
    plane = np.zeros((reach + 1, reach + 1))
    y, x = inner.lags
    plane[y, x] = plane[x, y] = weights
    line = abs(np.arange(-reach, reach + 1))
    seen = table[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]
    return float((seen * plane[np.ix_(line, line)]).sum() / table[middle, middle])


def falling(inner: Interior, length: float, wave: float = 0.0) -> np.ndarray:
    distance = np.hypot(*inner.lags)
    return np.where(distance > 0, np.exp(-distance / length) * np.cos(wave * distance), 0.0)


def packed(pupil: np.ndarray, field: np.ndarray, dots: int) -> np.ndarray:
    """Every cell's dots moved to where a field is largest."""
    moved = np.zeros_like(pupil)
    for row in range(0, len(pupil), dots):
        for column in range(0, len(pupil), dots):
            cell = slice(row, row + dots), slice(column, column + dots)
            order = np.argsort(-field[cell], axis=None, kind="stable")[: int(pupil[cell].sum())]
            moved[cell][np.unravel_index(order, (dots, dots))] = 1
    return moved


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, DOTS**2),
    st.floats(1, 60),
    st.floats(0, 0.6),
    st.sampled_from(["drawn", "alike", "packed", "swaying"]),
)
@examples(25)
def test_no_layout_has_more_pairs_than_the_light_of_its_cells_allows(inner, estimate, seed, clear, length, wave, kind):
    draw = np.random.default_rng(seed)
    unit = np.zeros(DOTS**2, dtype=np.bool_)
    unit[draw.permutation(DOTS**2)[:clear]] = True
    cells = estimate.lattice.cells
    turned = draw.integers(8, size=(cells, cells)) if kind == "drawn" else np.zeros((cells, cells), dtype=np.int64)
    pupil = lay("x", unit.reshape(DOTS, DOTS), turned.astype(np.int8), room=estimate.lattice).pupil
    if kind in ("packed", "swaying"):
        row, column = np.mgrid[0 : len(pupil), 0 : len(pupil)]
        middle, stop = (len(pupil) - 1) / 2, estimate.lattice.stop
        # To and fro along a wave of cells, which is what ramps are for.
        sway = (column % DOTS) * np.sin(2 * np.pi * (column // DOTS) / draw.uniform(1.5, 12))
        field = sway if kind == "swaying" else -np.hypot(row - middle, column - middle)
        pupil = packed(pupil, np.where(stop, field, -np.inf), DOTS)
        assert not pupil[~stop].any()
    weights, light = falling(inner, length, wave), CellLight.of(inner, pupil)
    found = pairs(inner, pupil, weights)
    rough, sharp = (light.most(weights, sharp=sharp) for sharp in (False, True))
    assert found <= sharp * (1 + 1e-9) + 1e-9
    assert sharp <= rough + 1e-9


def test_an_open_stop_has_exactly_its_pairs(inner, estimate):
    """Nothing can be moved where all is clear, so the bound is the open stop's own."""
    stop = estimate.lattice.stop.astype(np.float64)
    light, weights = CellLight.of(inner, stop), falling(inner, 20.0)
    for sharp in (False, True):
        assert light.most(weights, sharp=sharp) == pytest.approx(pairs(inner, stop, weights), rel=1e-9)
    gap = layout_gap(estimate, stop)
    assert gap is not None
    assert gap.limit == gap.psnr


def test_the_largest_eigenvalue_is_that_of_the_whole_matrix():
    """On a torus of 3 x 3 cells of 2 x 2 dots, by the dense matrix on functions that sum to 0 in every cell."""
    dots, across = 2, 3
    size = dots * across
    draw = np.random.default_rng(1)
    kernel = draw.normal(size=(size, size))
    # Even, and alike when mirrored and turned, as weights of lags are.
    for image in (lambda k: np.roll(k[::-1], 1, 0), lambda k: np.roll(k[:, ::-1], 1, 1), np.transpose):
        kernel = (kernel + image(kernel)) / 2
    place = np.stack(np.unravel_index(np.arange(size**2), (size, size)))
    away = (place[:, :, None] - place[:, None, :]) % size
    matrix = kernel[away[0], away[1]]
    cell = (place[0] // dots) * across + place[1] // dots
    even = (cell == np.arange(across**2)[:, None]) / dots
    kept = np.eye(size**2) - even.T @ even
    # What is left out must not be the largest.
    known = np.linalg.eigvalsh(kept @ matrix @ kept - 100 * even.T @ even).max()
    spectrum = np.fft.fft2(kernel).real
    light = CellLight(surrogate([leaves(1)], DOTS).lattice, np.zeros((2, 1), dtype=np.int64), np.zeros((1, 1), int), 1)
    light = replace(light, room=replace(light.room, dots=dots))
    object.__setattr__(light, "across", across)
    v, u, parts = light.waves
    values = spectrum[v[:, :, None], u[:, None, :]].reshape(len(v), -1)
    assert layouts_bound._largest(values, parts[:, :1]) == pytest.approx(known, rel=1e-6)


@given(st.integers(0, 2**32 - 1))
@examples(4)
def test_no_map_of_any_opening_passes_the_limit_of_its_light(estimate, inner, seed):
    draw = np.random.default_rng(seed)
    unit = np.zeros(DOTS**2, dtype=np.bool_)
    unit[draw.permutation(DOTS**2)[:CLEAR]] = True
    units = np.stack([unit.reshape(DOTS, DOTS), np.roll(unit.reshape(DOTS, DOTS), draw.integers(6), axis=0)])
    cells = estimate.lattice.cells
    pupil = lay("x", units, draw.integers(16, size=(cells, cells)).astype(np.int8), room=estimate.lattice).pupil
    gap = layout_gap(estimate, pupil, levels=(32,))
    assert gap is not None
    assert gap.head_room[0] >= 0
    # Of the best filter, which no ε of the protocol's passes.
    table = pupil_autocorrelation(pupil)
    y, x = inner.lags
    middle = len(table) // 2
    seen = np.stack([table[middle + v, middle + u] for v, u in ((y, x), (-y, x), (x, y), (-x, y))]) / table.max()
    share = float(pupil.sum() / inner.stop_dots)
    assert inner.psnr(seen, share, share, (32,))[0] <= gap.psnr[0] + 1e-9


def test_a_compact_opening_turned_at_random_is_within_a_decibel(estimate):
    unit = np.zeros((DOTS, DOTS), dtype=np.bool_)
    unit[:3, :3] = True
    gap = layout_gap(estimate, lay("x", unit, seed=1, room=estimate.lattice).pupil, levels=(32, 40))
    assert gap is not None
    assert all(0 < room < 1.2 for room in gap.head_room)


def test_more_light_allows_more(inner, estimate):
    units = np.zeros((2, DOTS, DOTS), dtype=np.bool_)
    units[0, :3, :3] = units[1, :3, :4] = True
    limits = [
        layout_limit(inner, CellLight.of(inner, lay("x", unit, seed=1, room=estimate.lattice).pupil), 32)
        for unit in units
    ]
    assert limits[0] < limits[1]


def test_what_takes_minutes_or_has_other_dots_has_no_bound(estimate, monkeypatch):
    pupil = lay("x", np.ones((DOTS, DOTS), dtype=np.bool_), room=estimate.lattice).pupil
    with pytest.raises(JobError, match="MF122"):
        layout_gap(estimate, pupil[:-DOTS, :-DOTS])
    monkeypatch.setattr(layouts_bound, "_LARGEST", 50)
    assert layout_gap(estimate, pupil) is None
    assert LayoutGap((32.0,), (30.0,), (30.5,)).head_room == (0.5,)
