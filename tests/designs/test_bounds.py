"""The bounds hold for whatever is drawn, their theorems hold in numbers, and their duals stay below feasible points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from once import leaves
from scipy.ndimage import gaussian_filter
from sweeps import examples

from maskfab.base.errors import JobError, OpeningError
from maskfab.camera.lens import lay, pupil_autocorrelation
from maskfab.designs.model.duals import (
    block_error,
    blocks,
    dual_tables,
    least_refined,
    residue_classes,
    residue_error,
    residue_errors,
    residues,
    wiener_cost,
)
from maskfab.designs.model.expected_psnr import Surrogate, interior, surrogate, unit_modulation
from maskfab.designs.model.limits import (
    Bounds,
    auc_bound,
    bounds,
    distinct_openings,
    frame_bound,
    framed,
    layout_bound,
    map_gap,
    optimality_gap,
    rings,
    sampled,
)
from maskfab.designs.model.panel_error import pupil_error

DOTS, CLEAR = 21, 100
RATIO = CLEAR / DOTS**2


@pytest.fixture(scope="module")
def estimate():
    return surrogate([leaves(1)])


@pytest.fixture(scope="module")
def inner(estimate):
    return interior(estimate)


def leakless(estimate):
    """The surrogate of scenes that are dark at low frequencies."""
    return replace(estimate, low=0 * estimate.low, low_truth=0 * estimate.low_truth)


@pytest.fixture(scope="module")
def without_leak(estimate):
    return leakless(estimate)


@dataclass(frozen=True)
class Bounded:
    """Cells of 168 um, of some dots and clear dots, with the bounds on them."""

    estimate: Surrogate
    clear: int
    limit: Bounds

    def units(self, count):
        return units(count, self.clear, self.estimate.dots)


@pytest.fixture(
    scope="module",
    params=[
        pytest.param((dots, periodic), id=f"{tiling}-{dots}", marks=[pytest.mark.slow] * (dots > 14))
        for dots in (14, DOTS)
        for periodic, tiling in ((False, "turned"), (True, "repeated"))
    ],
)
def bounded(request):
    dots, periodic = request.param
    clear = round(RATIO * dots**2)
    estimate = surrogate([leaves(1)], dots, dot_nm=168_000 // dots)
    return Bounded(estimate, clear, bounds(estimate, clear, periodic=periodic, any_layout=not periodic))


def units(count, clear=CLEAR, dots=DOTS):
    """From white noise to one compact blob."""
    draw = np.random.default_rng(5)
    for k in range(count):
        field = draw.normal(size=(dots, dots))
        field = gaussian_filter(field, k % 6, mode="wrap") if k % 6 else field
        mask = np.zeros(dots * dots, dtype=np.bool_)
        mask[np.argsort(field.ravel())[:clear]] = True
        yield mask.reshape(dots, dots)


def test_pairs_of_any_layout_by_displacement_of_cells_make_up_the_open_stops_share():
    draw = np.random.default_rng(1)
    n, cells, clear = 5, 6, 8
    for _ in range(3):
        pupil = np.zeros((cells, n, cells, n))
        for i in range(cells):
            for j in range(cells):
                chosen = draw.permutation(n * n)[:clear]
                pupil[i, chosen // n, j, chosen % n] = 1
        for v, u in [(0, 1), (2, 3), (4, 0)]:
            first, second = pupil[: cells - v, :, : cells - u], pupil[v:, :, u:]
            made = np.einsum("iajb,icjd->", first, second)
            open_stop = first.size * n * n
            assert made / (cells**2 * clear) == pytest.approx(clear / n**2 * open_stop / (cells * n) ** 2)


def test_triangle_weighted_mean_is_the_clear_share_of_a_tiling(inner):
    hat = 1 - abs(np.arange(1 - DOTS, DOTS)) / DOTS
    lag = np.arange(1 - DOTS, DOTS) % DOTS
    for unit in units(12):
        for periodic in (False, True):
            far, near = unit_modulation(unit, periodic=periodic)
            assert far.mean() == pytest.approx(RATIO)
            assert hat @ far[np.ix_(lag, lag)] @ hat == pytest.approx(RATIO * DOTS**2)
            assert near[0, 0] == pytest.approx(1)
            # Around lag 0 the triangle favours compact openings; only the plain sum stays.
            short = np.arange(1 - DOTS, DOTS)
            assert near[np.ix_(short, short)].sum() == pytest.approx(far[np.ix_(lag, lag)].sum())


def test_triangle_weighted_mean_of_random_layouts():
    draw = np.random.default_rng(2)
    n, cells = 7, 16
    unit = next(units(1, 12, n))
    turned = np.stack([np.rot90(m, k) for m in (unit, unit[:, ::-1]) for k in range(4)])
    total = np.zeros((2 * n * cells - 1,) * 2)
    for _ in range(40):
        laid = turned[draw.integers(8, size=(cells, cells))].transpose(0, 2, 1, 3).reshape(n * cells, n * cells)
        total += pupil_autocorrelation(laid.astype(np.float64))
    whole = pupil_autocorrelation(np.ones((n * cells,) * 2))
    hat = 1 - abs(np.arange(1 - n, n)) / n
    middle = n * cells - 1
    for v, u in [(0, 1), (1, 1), (3, 2)]:
        block = np.ix_(middle + n * v + np.arange(1 - n, n), middle + n * u + np.arange(1 - n, n))
        mean = (hat @ total[block] @ hat) / (hat @ whole[block] @ hat) * whole[middle, middle] / total[middle, middle]
        assert mean == pytest.approx(12 / n**2, rel=0.01)


@pytest.mark.parametrize("count", [24, pytest.param(200, marks=pytest.mark.slow)])
def test_no_unit_passes_its_bounds(bounded, count):
    estimate, limit = bounded.estimate, bounded.limit
    inner, around = interior(estimate), rings(estimate.dots, room=estimate.lattice)
    for k, unit in enumerate(bounded.units(count)):
        reached = inner.of_unit(unit, periodic=limit.periodic)
        assert all(a <= b for a, b in zip(reached, limit.psnr, strict=True)), k
        if k % 4 == 0:
            assert around.of_unit(unit, periodic=limit.periodic) <= limit.auc, k
        if k % 20 == 0:
            predicted = estimate(unit, periodic=limit.periodic)
            assert all(a < b for a, b in zip(predicted, limit.frame, strict=True)), k


@examples(40)
@given(
    seed=st.integers(0, 2**16),
    width=st.floats(0, 6),
    stretch=st.floats(0.2, 1),
    middle=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    compact=st.floats(0, 3),
)
def test_no_unit_passes_the_bound_of_the_whole_frame(bounded, seed, width, stretch, middle, compact):
    estimate, dots = bounded.estimate, bounded.estimate.dots
    field = np.random.default_rng(seed).normal(size=(dots, dots))
    field = gaussian_filter(field, (width, stretch * width), mode="wrap") if width else field
    y, x = np.mgrid[0:dots, 0:dots]
    # From noise, through spots of any grain, to an ellipse or a bar that the cell's edge cuts.
    row, column = (round(part * (dots - 1)) for part in middle)
    field = field / field.std() + compact * np.hypot(y - row, (x - column) * stretch)
    unit = np.zeros(dots**2, dtype=np.bool_)
    unit[np.argsort(field.ravel())[: bounded.clear]] = True
    for judge in (estimate, leakless(estimate)):
        reached = judge(unit.reshape(dots, dots), periodic=bounded.limit.periodic)
        assert all(a <= b for a, b in zip(reached, bounded.limit.frame, strict=True))


def test_lags_of_the_surrogate_make_its_error_but_for_the_leak(estimate, without_leak, inner):
    turned = sampled(estimate, inner, periodic=False)
    repeated = sampled(estimate, inner, periodic=True)
    for own in (turned, repeated):
        assert own.weight.sum() == pytest.approx(estimate.weight.sum())
        assert (own.lags[:, 0] == 0).all()
    assert len(turned.weight) < len(repeated.weight) == len(estimate.weight)
    for unit in units(4):
        np.testing.assert_allclose(turned.of_unit(unit), without_leak(unit), atol=1e-6)
        far, _ = unit_modulation(unit, periodic=True)
        y, x = repeated.lags
        own = repeated.psnr(repeated.stop * far[y % DOTS, x % DOTS], RATIO, RATIO)
        np.testing.assert_allclose(own, without_leak(unit, periodic=True), atol=1e-6)


@pytest.mark.parametrize("clear", [30, 200])
def test_dimmer_light_never_allows_more(estimate, inner, clear):
    dim, bright = frame_bound(estimate, inner, clear, levels=(24, 32))
    assert dim <= bright
    blob = list(units(6, clear))[-1]
    assert all(a <= b for a, b in zip(estimate(blob, levels=(24, 32)), (dim, bright), strict=True))


def test_frame_is_loose_by_the_leak_alone(bounded):
    limit, without_leak = bounded.limit, leakless(bounded.estimate)
    best = np.max([without_leak(unit, periodic=limit.periodic) for unit in bounded.units(40)], axis=0)
    # The dual may let low frequencies vanish, where nothing but noise is left to count; that matters in dim light.
    assert (limit.frame - best < (0.9, 0.4, 0.3)).all()


def every(dots, clear):
    for places in combinations(range(dots**2), clear):
        unit = np.zeros(dots**2, dtype=np.bool_)
        unit[list(places)] = True
        yield unit.reshape(dots, dots)


@pytest.mark.parametrize("periodic", [False, True], ids=["turned", "repeated"])
@pytest.mark.parametrize(
    ("dots", "clear"),
    [(2, 2), (3, 3), *(pytest.param(4, clear, marks=pytest.mark.slow) for clear in (1, 4, 15))],
)
def test_frame_of_few_dots_is_bounded_by_its_best_opening(dots, clear, periodic):
    estimate = surrogate([leaves(1)], dots, dot_nm=168_000 // dots)
    best = np.max([estimate(unit, periodic=periodic) for unit in every(dots, clear)], axis=0)
    np.testing.assert_allclose(
        frame_bound(estimate, interior(estimate), clear, periodic=periodic), best, rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("periodic", [False, True], ids=["turned", "repeated"])
@pytest.mark.parametrize(("dots", "clear"), [(2, 1), (3, 4), (4, 3), (4, 15), (9, 2)])
def test_every_opening_is_like_one_that_is_tried_and_like_no_other(dots, clear, periodic):
    tried = distinct_openings(dots, clear, periodic=periodic)
    seen = set()
    for unit in tried:
        turns = [np.rot90(each, k) for each in (unit, unit.T) for k in range(4)]
        if periodic:
            moves = [(v, u) for v in range(dots) for u in range(dots)]
            turns = [np.roll(each, move, (0, 1)) for each in (unit, unit[::-1, ::-1]) for move in moves]
        alike = {each.tobytes() for each in turns}
        assert not alike & seen
        seen |= alike
    assert len(seen) == comb(dots**2, clear)


def test_errors_without_the_leak_are_those_of_scenes_that_do_not_leak(estimate, without_leak):
    for unit in units(3):
        for periodic in (False, True):
            quick = estimate.leakless_errors(unit, periodic=periodic)
            whole, share = estimate.errors(unit, periodic=periodic)
            assert (quick(32, share) < whole(32, share)).all()
            # Scenes without light leak 1e-12.
            assert estimate.decibels(32, quick(32, share).min()) == pytest.approx(
                without_leak(unit, periodic=periodic)[1], abs=1e-6
            )


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=1, max_size=15))
def test_dear_bounds_are_found_only_where_they_decide(pairs):
    asked = []

    def refined(place):
        asked.append(place)
        return pairs[place][1]

    rough = [cheap for cheap, _ in pairs]
    assert least_refined(rough, refined) == min(max(pair) for pair in pairs)
    assert len(set(asked)) == len(asked)
    # Those whose cheap bound lies above the least are left alone.
    assert all(rough[place] <= min(max(pair) for pair in pairs) for place in asked)


@pytest.mark.parametrize("periodic", [False, True], ids=["turned", "repeated"])
def test_least_over_every_filter_is_that_of_all_found_in_full(periodic):
    inner = interior(surrogate([leaves(1)], 7, dot_nm=24_000))
    classes, ratio = residues(inner, periodic=periodic), 12 / 49
    variance = inner.noise.variance(32, ratio)
    tables = [dual_tables(inner, epsilon, ratio) for epsilon in inner.strengths]
    full = [
        residue_error(each.nodes, each.cost(variance), classes, ratio, periodic=periodic, refined=True)
        for each in tables
    ]
    assert residue_errors(inner, classes, ratio, [variance], periodic=periodic) == [min(full)]


def test_bounds_are_in_order(bounded):
    limit = bounded.limit
    for k in range(3):
        assert limit.psnr[k] < limit.grey[k]
        # Without the lowest frequencies less is held back.
        assert limit.psnr[k] < limit.frame[k] + 0.1
        assert limit.psnr[k] <= limit.psnr[min(k + 1, 2)]
        if limit.any_layout is not None:
            assert limit.psnr[k] <= limit.any_layout[k]


def test_area_bound_of_a_repeated_unit_is_that_of_a_flat_modulation():
    around = rings(DOTS)
    assert around.count == 147
    for clear in (CLEAR, 88):
        flat = np.full(len(around.ring), (clear - 1) / (DOTS**2 - 1))
        flat[0] = 1
        # Short rings miss some residues, which pay for the others: 1e-4 of the area.
        assert 1 <= auc_bound(around, clear, periodic=True) / around.area(flat) < 1.0005
    # An open stop's area of 0.659, to three digits, leads to 0.1536.
    assert abs(1 / 147 + (0.659 - 1 / 147) * 99 / 440 - 0.1536) < 1.2e-4


def test_positive_semidefiniteness_only_tightens():
    around = rings(7)
    loose = auc_bound(around, 12, periodic=False, positive=False)
    tight = auc_bound(around, 12, periodic=False)
    best = max(around.of_unit(unit) for unit in units(60, 12, 7))
    assert best <= tight <= loose


def test_every_node_table_lies_below_the_cost_between_its_nodes(inner):
    share = np.linspace(0.05, 0.95, 7)
    variance = inner.noise.variance(32, RATIO)
    few = np.r_[0:40, 500:13000:400]
    for epsilon in (0.002, 0.05, None):
        if epsilon is None:
            nodes, cost = wiener_cost(inner, variance, RATIO)
        else:
            table = dual_tables(inner, epsilon, RATIO)
            nodes, cost = table.nodes, table.cost(variance)
        for s in share:
            between = nodes[:-1] + s * np.diff(nodes)
            h = (inner.stop * inner.pixel)[few, None] * between + (RATIO * inner.folded)[few, None]
            power = inner.power[few, None]
            prior = inner.inverse_prior[few, None]
            span = inner.strengths[0] * prior, inner.strengths[-1] * prior
            regular = np.clip(variance / power, *span) if epsilon is None else epsilon * prior
            exact = inner.weight[few, None] * (variance * h**2 + power * regular**2) / (h**2 + regular) ** 2
            chord = cost[few, :-1] * (1 - s) + cost[few, 1:] * s
            assert (chord <= exact * (1 + 1e-9) + 1e-18).all()


def of_filter(inner, h, variance, regular):
    return (variance * h**2 + inner.power * regular**2) / (h**2 + regular) ** 2


def nearest(inner, variance):
    """Of what the ε make of R, the nearest to the Wiener filter's."""
    return np.clip(
        variance / inner.power, inner.strengths[0] * inner.inverse_prior, inner.strengths[-1] * inner.inverse_prior
    )


@pytest.mark.parametrize("level", [24, 40])
def test_best_filter_at_each_frequency_is_no_worse_than_any_of_the_protocol(inner, level):
    variance = inner.noise.variance(level, RATIO)
    for modulation in (0.05, RATIO, 0.9):
        h = inner.transfer(modulation * inner.stop, RATIO)
        best = of_filter(inner, h, variance, nearest(inner, variance))
        for epsilon in inner.strengths:
            assert (best <= of_filter(inner, h, variance, epsilon * inner.inverse_prior) * (1 + 1e-12)).all()
    around = blocks(inner, RATIO)
    found = [
        block_error(inner, *wiener_cost(each, variance, RATIO), around, RATIO, moving=True, steps=10)[0]
        for each in (replace(inner, strengths=(1e-9, 1e9)), inner)
    ]
    assert found[0] <= found[1] * (1 + 1e-5)
    # In bright light the least ε holds back more than the Wiener filter would.
    assert (found[1] > 1.05 * found[0]) == (level == 40)


@pytest.mark.parametrize("moving", [False, True])
def test_dual_stays_below_the_flat_modulation_and_grows_with_steps(inner, moving):
    variance = inner.noise.variance(32, RATIO)
    nodes, cost = wiener_cost(inner, variance, RATIO)
    around = blocks(inner, RATIO)
    h = inner.transfer(RATIO * inner.stop, RATIO)
    flat = float(inner.weight @ of_filter(inner, h, variance, nearest(inner, variance)))
    values = [block_error(inner, nodes, cost, around, RATIO, moving=moving, steps=k)[0] for k in (1, 15)]
    assert 0 < values[0] <= values[1] <= flat


def test_multipliers_of_all_layouts_are_nearly_the_best(inner):
    held = framed(inner)
    around = blocks(held, RATIO, cut_cells=True)
    nodes, cost = wiener_cost(held, held.noise.variance(24, RATIO), RATIO, 1 / RATIO, 32)
    found = [
        held.decibels(24, block_error(held, nodes, cost, around, RATIO, moving=True, steps=k)[0]) for k in (1, 30, 90)
    ]
    assert found[0] > found[1] + 1 >= found[2] + 1
    assert found[1] - found[2] < 0.15


def test_constraints_only_tighten_the_dual(inner):
    table = dual_tables(inner, 0.02, RATIO)
    cost = table.cost(inner.noise.variance(32, RATIO))
    found = []
    for refined, positive in ((False, False), (True, False), (True, True)):
        classes = residues(inner, periodic=False)
        found.append(
            residue_error(table.nodes, cost, classes, RATIO, periodic=False, refined=refined, positive=positive)
        )
    assert found == sorted(found)
    share = blocks(inner, RATIO, cut_cells=True).allowed / blocks(inner, RATIO).allowed
    assert share.min() >= 1
    assert share.max() < 1.1


@pytest.mark.parametrize("mirrored", [True, False])
def test_transform_of_classes_is_the_cosine_transform(mirrored):
    every, size, transform = residue_classes(8, mirrored=mirrored)
    values = np.random.default_rng(0).random(len(size))
    spectrum = np.fft.fft2(values[every])
    assert size.sum() == 64
    np.testing.assert_allclose((transform @ values)[every], spectrum.real, atol=1e-12)
    np.testing.assert_allclose(spectrum.imag, 0, atol=1e-12)


def test_more_clear_dots_allow_more(inner):
    found = []
    for clear in (40, 88, 100, 200):
        table = dual_tables(inner, 0.02, clear / DOTS**2)
        cost = table.cost(inner.noise.variance(32, clear / DOTS**2))
        classes = residues(inner, periodic=True)
        found.append(residue_error(table.nodes, cost, classes, clear / DOTS**2, periodic=True))
    assert found == sorted(found, reverse=True)
    around = rings(DOTS)
    areas = [auc_bound(around, clear, periodic=True) for clear in (1, 40, 88, 100, 441)]
    assert areas == sorted(areas)
    assert areas[-1] == pytest.approx(around.area(np.ones(len(around.ring))))


def test_gap_of_a_bar(bounded):
    estimate, limit = bounded.estimate, bounded.limit
    rows = {14: 4, DOTS: 5}[estimate.dots]
    bar = np.zeros((estimate.dots, estimate.dots), dtype=np.bool_)
    bar[:rows, : bounded.clear // rows] = True
    gap = optimality_gap(estimate, bar, periodic=limit.periodic, known=limit)
    assert gap.bounds is limit
    assert all(0 <= room < 16 for room in gap.head_room)
    assert all(0 <= room < 25 for room in gap.head_room_frame)
    assert gap.psnr_frame == estimate(bar, periodic=limit.periodic)
    assert gap.auc < limit.auc


@pytest.fixture(scope="module")
def error(estimate):
    return pupil_error(estimate)


def test_no_map_passes_the_bound_of_its_light(estimate, error):
    draw = np.random.default_rng(3)
    bar = np.zeros((DOTS, DOTS), dtype=np.bool_)
    bar[:5, :20] = True
    row, column = np.mgrid[0:24, 0:24]
    # Turned at random; all alike; so that every cut cell's bar lies towards the axis.
    inward = np.array([[0, 1], [3, 2]])[(row < 12).astype(int), (column < 12).astype(int)]
    for turned in (draw.integers(8, size=(24, 24)), np.zeros((24, 24), dtype=int), inward):
        laid = lay("laid", bar, turned.astype(np.int8))
        reached = error.psnr(laid.pupil)
        gap = map_gap(estimate, laid.pupil, CLEAR, reached)
        assert gap.open_share == pytest.approx(laid.transmission)
        assert all(have <= most for have, most in zip(reached, gap.limit, strict=True))
        assert all(0 < room < 25 for room in gap.head_room)


def test_more_light_in_the_cut_cells_allows_more(inner):
    limits = [layout_bound(framed(inner), RATIO, 32, RATIO * k) for k in (0.98, 1, 1.02, 1.04)]
    assert limits == sorted(limits)
    # Of the light alone, 10 log 1.02 at most where noise decides.
    assert all(0 < b - a < 0.15 for a, b in pairwise(limits))
    allowed = [blocks(inner, RATIO, cut_cells=True, open_share=RATIO * k).allowed for k in (1.0, 1.04)]
    np.testing.assert_array_equal(allowed[0], blocks(inner, RATIO, cut_cells=True).allowed)
    # More light in the rim leaves a smaller share of all pairs to neighbours well inside.
    assert allowed[1][1] < allowed[0][1]


def test_cells_of_another_size_have_a_stop_of_four_millimetres(inner):
    other = surrogate([leaves(1)], 10, dot_nm=16_000)
    assert (other.lattice.cells, other.lattice.side) == (26, 260)
    found = interior(other)
    assert found.stop_dots * 16**2 == pytest.approx(np.pi * 2000**2, rel=5e-3)
    assert found.per_cycle == pytest.approx(inner.per_cycle / 2)
    unit = np.zeros((10, 10), dtype=np.bool_)
    unit[:4, :6] = True
    limit = frame_bound(other, found, 24)
    assert all(a <= b for a, b in zip(other(unit), limit, strict=True))
    with pytest.raises(JobError, match="MF122"):
        map_gap(other, np.ones((504, 504)), 24, (20.0, 20.0, 20.0))


def test_counts_that_no_unit_has(estimate):
    with pytest.raises(OpeningError, match="MF203"):
        bounds(estimate, 0)
    with pytest.raises(OpeningError, match="MF204"):
        bounds(estimate, 442)
    with pytest.raises(JobError, match="MF104"):
        bounds(estimate, 100, levels=(25,))
    with pytest.raises(OpeningError, match="MF201"):
        optimality_gap(estimate, np.ones((20, 21), dtype=np.bool_))
