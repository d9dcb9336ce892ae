"""Three rectangles: against all triples of all rectangles, and where the answer is known."""

import itertools
import math
import time

import numpy as np
import pytest
from display.listing import largest_by_listing, small_grids
from display.shapes import ALIKE, bar, broken_rules, cells, published, spiral
from scipy import ndimage

from maskfab.base.model import orient
from maskfab.display.emitter_shapes import rectangle_footprints, three_rectangles, window_table
from maskfab.display.free_area import free_region

RATIOS = (ALIKE, (0.5, 1.0, 1.5), (2 / 3, 2 / 3, 5 / 3), (1.2, 0.9, 0.9))
ASPECTS = (math.inf, 1.0, 1.4, 1.5, 2.0)


def all_rectangles(region, width, aspect):
    n = len(region)
    total = np.zeros((n + 1, n + 1), dtype=int)
    total[1:, 1:] = region.cumsum(0).cumsum(1)
    y0, y1, x0, x1 = (each.ravel() for each in np.indices((n + 1,) * 4))
    high, wide = y1 - y0, x1 - x0
    good = (high >= width) & (wide >= width)
    if math.isfinite(aspect):
        good &= np.maximum(high, wide) <= aspect * np.minimum(high, wide) + 1e-9
    good &= total[y1, x1] - total[y0, x1] - total[y1, x0] + total[y0, x0] == high * wide
    return np.stack([y0, y1, x0, x1], axis=1)[good]


def best_of_all_triples(region, width, gap, ratio, aspect):
    rectangles = all_rectangles(region, width, aspect)
    if not len(rectangles):
        return 0.0
    y0, y1, x0, x1 = rectangles.T
    areas = (y1 - y0) * (x1 - x0)
    apart = (y0[:, None] >= y1 + gap) | (x0[:, None] >= x1 + gap)
    apart |= apart.T
    best = 0.0
    for a, b, c in set(itertools.permutations(ratio)):
        for i in np.flatnonzero(areas / a > 0):
            near = np.flatnonzero(apart[i])
            if areas[i] / a <= best or not len(near):
                continue
            pairs = np.minimum(areas[near, None] / b, areas[near] / c)
            best = max(best, min(areas[i] / a, np.where(apart[np.ix_(near, near)], pairs, 0).max()))
    return best


@pytest.mark.parametrize("count", [250, pytest.param(1000, marks=pytest.mark.slow)])
def test_is_the_best_of_all_triples(count):
    rng = np.random.default_rng(0)
    for _ in range(count):
        n, width, gap = int(rng.integers(3, 7)), int(rng.integers(1, 4)), int(rng.integers(0, 4))
        region = rng.random((n, n)) < rng.uniform(0.6, 1)
        ratio, aspect = RATIOS[rng.integers(len(RATIOS))], ASPECTS[rng.integers(len(ASPECTS))]
        found, labels = three_rectangles(region, cells(n, width, gap), ratio, max_aspect=aspect)
        assert found == pytest.approx(best_of_all_triples(region, width, gap, ratio, aspect), abs=1e-9)
        if found:
            assert broken_rules(labels, region, cells(n, width, gap), ratio, found) == []
            for k in (1, 2, 3):
                high, wide = (np.ptp(along) + 1 for along in np.nonzero(labels == k))
                assert high * wide == (labels == k).sum()
                assert max(high, wide) <= aspect * min(high, wide) + 1e-9
        else:
            assert not labels.any()


def check_feasibility(count, seed):
    """Zero rectangles if and only if no three shapes fit, on so many grids; both happen."""
    by_rules = {}
    for region, width, gap in small_grids(count, seed):
        by_rules.setdefault((len(region), width, gap), []).append(region)
    fitting = 0
    for (n, width, gap), regions in by_rules.items():
        found = rectangle_footprints(~np.array(regions), cells(n, width, gap), ALIKE) > 0
        listed = [largest_by_listing(region, width, gap)[0] for region in regions]
        assert np.array_equal(found, listed)
        fitting += sum(listed)
    assert 0.1 < fitting / count < 0.9


def test_feasible_exactly_if_the_list_of_all_shapes_says_so():
    check_feasibility(1500, seed=2)


@pytest.mark.slow
def test_feasible_exactly_on_ten_thousand_grids():
    check_feasibility(10_000, seed=3)


def test_the_table_holds_the_largest_rectangle_of_each_window():
    rng = np.random.default_rng(4)
    region = rng.random((6, 6)) < 0.8
    table = window_table(region[None], 2, 1.5)
    rectangles = all_rectangles(region, 2, 1.5)
    y0, y1, x0, x1 = rectangles.T
    areas = (y1 - y0) * (x1 - x0)
    for a, b in itertools.combinations(range(7), 2):
        assert table.columns[0, a, b] == areas[(x0 >= a) & (x1 <= b)].max(initial=0)
        assert table.rows[0, a, b] == areas[(y0 >= a) & (y1 <= b)].max(initial=0)
    for high, wide in itertools.product(range(7), repeat=2):
        below, left = y1 <= high, x1 <= wide
        above, right = y0 >= 6 - high, x0 >= 6 - wide
        for i, j in itertools.product((0, 1), repeat=2):
            inside = (above if i else below) & (right if j else left)
            assert table.corners[0, i, j, high, wide] == areas[inside].max(initial=0)


@pytest.mark.parametrize(
    ("region", "width", "gap", "expected"),
    [
        pytest.param(np.ones((6, 6)), 1, 0, 12, id="all closed: thirds"),
        pytest.param(np.ones((8, 8)), 1, 1, 16, id="all closed: two lines for gaps"),
        pytest.param(np.zeros((6, 6)), 1, 0, 0, id="all open"),
        pytest.param(np.ones((1, 1)), 1, 0, 0, id="one dot"),
        pytest.param(np.indices((6, 6)).sum(0) % 2, 2, 0, 0, id="checkerboard"),
        pytest.param(np.indices((6, 6)).sum(0) % 2, 1, 0, 1, id="checkerboard of width one"),
        pytest.param(np.kron(np.eye(3), np.ones((2, 2))), 2, 0, 4, id="squares that touch at corners"),
        pytest.param(np.kron(np.eye(3), np.ones((2, 2))), 2, 1, 0, id="squares that touch at corners, gap"),
        pytest.param(~bar(21, 5, 8), 2, 1, 80, id="two equal halves"),
        pytest.param(np.ones((5, 5)), 2, 5, 0, id="gap as wide as the pixel"),
        pytest.param(np.ones((5, 5)), 2, 4, 0, id="gap leaves one line"),
        pytest.param(np.ones((5, 5)), 2, 2, 0, id="no room for a third"),
        pytest.param(np.ones((5, 5)), 2, 1, 4, id="exactly 2 + 1 + 2"),
        pytest.param(np.ones((5, 5)), 5, 0, 0, id="one square fills the pixel"),
    ],
)
def test_known(region, width, gap, expected):
    region = np.asarray(region, dtype=bool)
    found, _ = three_rectangles(region, cells(len(region), width, gap), ALIKE)
    assert found == expected


@pytest.mark.parametrize("gap", [0, 1, 2])
def test_exactly_three_squares(gap):
    region = np.zeros((9, 9), dtype=bool)
    for y, x in ((0, 0), (0, 2 + gap), (5, 1)):
        region[y : y + 2, x : x + 2] = True
    found, labels = three_rectangles(region, cells(9, 2, gap), ALIKE)
    assert found == 4
    assert np.array_equal(labels > 0, region)
    assert three_rectangles(region, cells(9, 2, gap + 1), ALIKE)[0] == 0
    assert three_rectangles(region, cells(9, 3, gap), ALIKE)[0] == 0


@pytest.mark.parametrize("width", [2, 3])
def test_corridors_that_are_a_line_too_narrow(width):
    comb = np.zeros((12, 12), dtype=bool)
    for x in range(0, 12, width + 1):
        comb[:, x : x + width] = True
    comb[:width] = True
    for region in (spiral(2, width), comb):
        n = len(region)
        assert three_rectangles(region, cells(n, width, 1), ALIKE)[0] > 0
        assert three_rectangles(region, cells(n, width + 1, 1), ALIKE)[0] == 0


def test_three_of_a_pinwheel_of_four():
    # Four 2 x 3 rectangles round a hole have no straight cut; any three of them have.
    region = np.ones((5, 5), dtype=bool)
    region[2, 2] = False
    assert three_rectangles(region, cells(5, 2, 0), ALIKE)[0] == 6


@pytest.mark.parametrize("ratio", set(itertools.permutations((1.0, 1.0, 2.5))))
def test_every_colour_order_gives_the_same_area(ratio):
    ratio = tuple(3 * part / 4.5 for part in ratio)
    region = ~bar(21, 5, 8)
    found, labels = three_rectangles(region, cells(21, 2, 1), ratio)
    # Blue takes one half whole, 8 x 21; the others share the second, 8 x 10 each.
    assert found == pytest.approx(168 / ratio[int(np.argmax(ratio))])
    assert broken_rules(labels, region, cells(21, 2, 1), ratio, found) == []


def test_more_room_or_looser_rules_never_hurt():
    rng = np.random.default_rng(5)
    for _ in range(30):
        region = rng.random((9, 9)) < 0.8
        value = three_rectangles(region, cells(9, 2, 1), ALIKE)[0]
        assert three_rectangles(region | (rng.random((9, 9)) < 0.2), cells(9, 2, 1), ALIKE)[0] >= value
        assert three_rectangles(region, cells(9, 1, 1), ALIKE)[0] >= value
        assert three_rectangles(region, cells(9, 2, 0), ALIKE)[0] >= value
        assert three_rectangles(region, cells(9, 2, 1), ALIKE, max_aspect=2)[0] <= value
        # Twice as fine a grid has room for borders at half cells, but three squares fit on both or on neither.
        fine = three_rectangles(np.kron(region, np.ones((2, 2), dtype=bool)), cells(18, 4, 2), ALIKE)[0]
        assert fine >= 4 * value
        assert (fine > 0) == (value > 0)


def test_orientation_does_not_matter():
    rng = np.random.default_rng(6)
    for _ in range(10):
        region = rng.random((11, 11)) < 0.85
        values = {three_rectangles(orient(region, k), cells(11, 2, 1), (0.5, 1.0, 1.5))[0] for k in range(8)}
        assert len(values) == 1


@pytest.mark.parametrize(("rules", "expected"), [((0, 1, 0, 2), 56), ((1, 1, 0, 2), 48), ((0, 2, 1, 3), 42)], ids=str)
def test_the_authors_mask(rules, expected):
    to_opening, gap, margin, width = rules
    grid = cells(21, width, gap, to_opening=to_opening, gutter=1)
    region = free_region(published("L2Inv_Random"), grid, margin=margin)
    assert three_rectangles(region, grid, ALIKE)[0] == expected


def test_the_authors_poled_cell():
    region = ~published("POLED")
    assert three_rectangles(region, cells(42, 2, 1), ALIKE)[0] / 42**2 == pytest.approx(0.061, abs=0.0005)


def test_a_batch_is_its_members():
    rng = np.random.default_rng(7)
    masks = ndimage.gaussian_filter(rng.random((70, 14, 14)), (0, 1, 1)) > 0.55
    grid = cells(28, 3, 2, to_opening=2, gutter=1, per_dot=2)
    ratio = (0.8, 0.9, 1.3)
    shares = rectangle_footprints(masks, grid, ratio, margin=1)
    for mask, share in zip(masks, shares, strict=True):
        one = three_rectangles(free_region(mask, grid, margin=1), grid, ratio)[0]
        assert share == pytest.approx(one / 29**2)


def test_a_thousand_evaluations_take_seconds_at_most():
    rng = np.random.default_rng(8)
    masks = ndimage.gaussian_filter(rng.random((1000, 21, 21)), (0, 2, 2)) > 0.52
    start = time.perf_counter()
    shares = rectangle_footprints(masks, cells(21, 2, 1), ALIKE)
    # Measured: 0.3 s on one quiet core; the limit leaves room for a busy machine.
    assert time.perf_counter() - start < 3
    assert shares.shape == (1000,)
