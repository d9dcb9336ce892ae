"""The bounds hold for whatever is drawn, their theorems hold in numbers, and their duals stay below feasible points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from estimates import surrogate
from hypothesis import given
from hypothesis import strategies as st
from once import leaves
from scipy.ndimage import gaussian_filter

from maskfab.base.errors import JobError, OpeningError
from maskfab.designs.model.duals import (
    ResidueDual,
    cost_at,
    least_refined,
    nodes_to,
    residue_classes,
    residue_errors,
    residues,
    wiener_cost,
)
from maskfab.designs.model.expected_psnr import Surrogate, interior
from maskfab.designs.model.limits import (
    Bounds,
    auc_bound,
    bounds,
    optimality_gap,
    rings,
)

DOTS, CLEAR = 21, 100
RATIO = CLEAR / DOTS**2


@pytest.fixture(scope="module")
def estimate():
    return surrogate([leaves(1)])


@pytest.fixture(scope="module")
def inner(estimate):
    return interior(estimate)


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
    return Bounded(estimate, clear, bounds(estimate, clear, periodic=periodic))


def units(count, clear=CLEAR, dots=DOTS):
    """From white noise to one compact blob."""
    draw = np.random.default_rng(5)
    for k in range(count):
        field = draw.normal(size=(dots, dots))
        field = gaussian_filter(field, k % 6, mode="wrap") if k % 6 else field
        mask = np.zeros(dots * dots, dtype=np.bool_)
        mask[np.argsort(field.ravel())[:clear]] = True
        yield mask.reshape(dots, dots)


@pytest.mark.parametrize("count", [24, pytest.param(200, marks=pytest.mark.slow)])
def test_no_unit_passes_its_bounds(bounded, count):
    estimate, limit = bounded.estimate, bounded.limit
    inner, around = interior(estimate), rings(estimate.dots, room=estimate.lattice)
    for k, unit in enumerate(bounded.units(count)):
        reached = inner.of_unit(unit, periodic=limit.periodic)
        assert all(a <= b for a, b in zip(reached, limit.psnr, strict=True)), k
        if k % 4 == 0:
            assert around.of_unit(unit, periodic=limit.periodic) <= limit.auc, k


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=1, max_size=15), st.data())
def test_dear_bounds_are_found_only_where_they_decide(pairs, data):
    asked = []
    cheap = [min(pair) for pair in pairs]

    def refined(place):
        asked.append(place)
        return pairs[place][1]

    first = data.draw(st.integers(0, len(pairs) - 1))
    least = min(dear for _, dear in pairs)
    assert least_refined(len(pairs), lambda low, high: min(cheap[low:high]), refined, first) == least
    assert len(set(asked)) == len(asked)
    # Those whose cheap bound lies above the least are left alone.
    assert all(cheap[place] <= least for place in asked if place != first)


def of_epsilon(inner, epsilon, level, ratio=RATIO):
    """Nodes, and the cost of every lag with one filter."""
    nodes = nodes_to(1.0, ratio)
    return nodes, cost_at(nodes, inner, inner.noise.variance(level, ratio), ratio, epsilon * inner.inverse_prior)


def found_in_full(nodes, cost, classes, ratio, *, periodic):
    dual = ResidueDual.of(nodes, cost.__getitem__, classes, ratio, periodic=periodic)
    return dual.refined()[0]


@pytest.mark.parametrize("periodic", [False, True], ids=["turned", "repeated"])
def test_least_over_every_filter_is_that_of_all_found_in_full(periodic):
    inner = interior(surrogate([leaves(1)], 7, dot_nm=24_000))
    classes, ratio = residues(inner, periodic=periodic), 12 / 49
    variance = inner.noise.variance(32, ratio)
    costs = [of_epsilon(inner, epsilon, 32, ratio) for epsilon in inner.strengths]
    full = [found_in_full(*each, classes, ratio, periodic=periodic) for each in costs]
    found = residue_errors(inner, classes, ratio, [variance], periodic=periodic)
    assert found == pytest.approx([min(full)], rel=1e-5)


def test_filters_that_nobody_would_take_loosen_no_bound():
    """At the least ε light costs next to nothing without the multiplier of short lags, which must be sought all the
    same."""
    inner = interior(surrogate([leaves(1)], 20, dot_nm=4_000))
    classes, ratio = residues(inner, periodic=False), 0.11
    variance = inner.noise.variance(24, ratio)
    every, likely = (
        residue_errors(replace(inner, strengths=some), classes, ratio, [variance], periodic=False)[0]
        for some in ((inner.strengths[0], inner.strengths[9]), inner.strengths[9:10])
    )
    assert every == pytest.approx(likely, rel=1e-3)


def test_bounds_are_in_order(bounded):
    limit = bounded.limit
    for k in range(3):
        assert limit.psnr[k] < limit.grey[k]
        assert limit.psnr[k] <= limit.psnr[min(k + 1, 2)]


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
            nodes, cost = of_epsilon(inner, epsilon, 32)
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
    classes = residues(inner, periodic=False)
    found = [
        ResidueDual.of(nodes, cost.__getitem__, classes, RATIO, periodic=False).of_mean()[0]
        for nodes, cost in (
            wiener_cost(each, variance, RATIO) for each in (replace(inner, strengths=(1e-9, 1e9)), inner)
        )
    ]
    assert found[0] <= found[1] * (1 + 1e-5)
    # In bright light the least ε holds back more than the Wiener filter would.
    assert (found[1] > 1.05 * found[0]) == (level == 40)


def test_constraints_only_tighten_the_dual(inner):
    nodes, cost = of_epsilon(inner, 0.02, 32)
    classes = residues(inner, periodic=False)
    rough = ResidueDual.of(nodes, cost.__getitem__, classes, RATIO, periodic=False).of_mean()[0]
    assert rough <= found_in_full(nodes, cost, classes, RATIO, periodic=False)


def test_classes_are_alike_under_the_symmetry_of_the_square():
    every, size = residue_classes(8)
    values = np.random.default_rng(0).random(len(size))
    assert size.sum() == 64
    np.testing.assert_allclose(np.fft.fft2(values[every]).imag, 0, atol=1e-12)


def test_more_clear_dots_allow_more(inner):
    found = []
    for clear in (40, 88, 100, 200):
        nodes, cost = of_epsilon(inner, 0.02, 32, clear / DOTS**2)
        classes = residues(inner, periodic=True)
        found.append(ResidueDual.of(nodes, cost.__getitem__, classes, clear / DOTS**2, periodic=True).of_mean()[0])
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
    gap = optimality_gap(estimate, bar, limit)
    assert gap.bounds is limit
    assert all(0 <= room < 16 for room in gap.head_room)
    assert gap.auc < limit.auc


def test_cells_of_another_size_have_a_stop_of_four_millimetres(inner):
    other = surrogate([leaves(1)], 10, dot_nm=16_000)
    assert (other.lattice.cells, other.lattice.side) == (26, 260)
    found = interior(other)
    assert found.stop_dots * 16**2 == pytest.approx(np.pi * 2000**2, rel=5e-3)
    assert found.per_cycle == pytest.approx(inner.per_cycle / 2)
    unit = np.zeros((10, 10), dtype=np.bool_)
    unit[:4, :6] = True
    assert all(room >= 0 for room in optimality_gap(other, unit, bounds(other, 24)).head_room)


def test_counts_that_no_unit_has(estimate):
    with pytest.raises(OpeningError, match="MF203"):
        bounds(estimate, 0)
    with pytest.raises(OpeningError, match="MF204"):
        bounds(estimate, 442)
    with pytest.raises(JobError, match="MF104"):
        bounds(estimate, 100, levels=(25,))
