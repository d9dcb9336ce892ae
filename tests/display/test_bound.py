"""No placement exceeds the bound: against every placement on small grids, and against known answers on large ones."""

from __future__ import annotations

import time

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.display.emitter_rules import EmitterGrid, Proof
from maskfab.display.emitter_shapes import guillotine
from maskfab.display.footprint_bound import shortest_cuts, upper_bound

EQUAL = (1.0, 1.0, 1.0)


def rules(n: int, gap: int, width: int) -> EmitterGrid:
    return EmitterGrid(n, 4000, 1, 8000, 0, gap, width)


class Placements:
    """All emitters of a small region as bit masks, and which pairs keep the gap."""

    def __init__(self, region: NDArray[np.bool_], width: int, gap: int) -> None:
        n = region.shape[0]
        places = [
            (y, x)
            for y in range(n - width + 1)
            for x in range(n - width + 1)
            if region[y : y + width, x : x + width].all()
        ]
        sets = np.arange(1 << len(places))
        cells = np.zeros_like(sets)
        near = np.zeros_like(sets)
        for i, (y, x) in enumerate(places):
            chosen = (sets >> i & 1).astype(bool)
            cells[chosen] |= self.mask(n, y, y + width, x, x + width)
            near[chosen] |= self.mask(n, y - gap, y + width + gap, x - gap, x + width + gap)
        reached = sets & -sets
        joins = [sum(1 << j for j, (v, u) in enumerate(places) if abs(v - y) + abs(u - x) == 1) for y, x in places]
        for _ in places:
            for i, joined in enumerate(joins):
                reached |= np.where(reached >> i & 1, joined, 0) & sets
        connected = (reached == sets) & (sets > 0)
        _, first = np.unique(cells[connected], return_index=True)
        self.cells = cells[connected][first]
        self.near = near[connected][first]
        self.areas = np.bitwise_count(self.cells).astype(int)

    @staticmethod
    def mask(n: int, y0: int, y1: int, x0: int, x1: int) -> int:
        row = sum(1 << x for x in range(max(x0, 0), min(x1, n)))
        return sum(row << n * y for y in range(max(y0, 0), min(y1, n)))

    def three(self, least: tuple[float, float, float]) -> bool:
        """Whether three emitters with at least these areas keep the gap."""
        red, green, blue = (np.flatnonzero(self.areas >= area) for area in least)
        if not (len(red) and len(green) and len(blue)):
            return False

        def legal(one: NDArray[np.intp], other: NDArray[np.intp]) -> NDArray[np.float32]:
            return ((self.near[one][:, None] & self.cells[other]) == 0).astype(np.float32)

        return bool((legal(red, green) * (legal(red, blue) @ legal(blue, green))).any())


def small_region(rng: np.random.Generator, width: int) -> NDArray[np.bool_]:
    """A random region with at most eight squares: blobs, strips, corridors, diagonal chains."""
    while True:
        n = int(rng.integers(3, 8))
        region = np.zeros((n, n), bool)
        if rng.random() < 0.5:
            h, w = rng.integers(1, n + 1, 2)
            y, x = rng.integers(0, n - h + 1), rng.integers(0, n - w + 1)
            region[y : y + h, x : x + w] = True
            region &= rng.random((n, n)) < rng.choice([0.8, 0.9, 1.0])
        else:
            for _ in range(int(rng.integers(3, 9))):
                y, x = rng.integers(0, n - width + 1, 2) if n >= width else (0, 0)
                region[y : y + width, x : x + width] = True
        fits = np.lib.stride_tricks.sliding_window_view(region, (width, width)).all((2, 3)).sum() if n >= width else 0
        if 3 <= fits <= 8:
            return region


def next_size(bound: float, ratio: tuple[float, float, float]) -> tuple[float, float, float]:
    """The areas of the smallest placement larger than the bound: some emitter has one whole cell more."""
    larger = min((np.floor(bound * part + 1e-6) + 1) / part for part in ratio)
    red, green, blue = (larger * part - 1e-6 for part in ratio)
    return red, green, blue


@pytest.mark.parametrize("count", [400, pytest.param(2000, marks=pytest.mark.slow)])
def test_no_placement_on_small_grids_exceeds_the_bound(count: int) -> None:
    rng = np.random.default_rng(5)
    sharp = excluded = feasible = 0
    for i in range(count):
        width, gap = 1 + i % 2, i // 2 % 4
        region = small_region(rng, width)
        ratio = EQUAL if i % 3 else tuple(float(v) for v in rng.choice([0.5, 1.0, 1.5, 2.0], 3))
        grid = rules(region.shape[0], gap, width)
        every = Placements(region, width, gap)
        quick, _ = upper_bound(region, grid, ratio, tight=False)
        tight, _ = upper_bound(region, grid, ratio)
        assert tight <= quick
        assert not every.three(next_size(tight, ratio)), (region.astype(int), width, gap, ratio)
        possible = every.three((1, 1, 1))
        feasible += possible
        excluded += tight == 0
        sharp += tight > 0 and every.three(tuple(tight * part - 1e-6 for part in ratio))
    # There is something to check: most bounds are reached, and many regions hold no three.
    assert feasible > count / 5
    assert excluded > count / 5
    assert sharp > 0.8 * feasible


def test_an_emitter_round_another_is_allowed_for() -> None:
    """A ring, and one inside it: its lines run in circles and touch no hole."""
    for gap in (1, 2):
        n = 5 + 2 * gap
        region = np.zeros((n + 2 + gap, n + 2 + gap), bool)
        region[:n, :n] = True
        region[-1, -1] = True
        ring = 4 * (n - 1)
        inner = (n - 2 - 2 * gap) ** 2
        assert inner == 9
        bound, _ = upper_bound(region, rules(len(region), gap, 1), (float(ring), float(inner), 1.0))
        assert bound >= 1


def shapes(rng: np.random.Generator, n: int) -> NDArray[np.bool_]:
    """A connected random shape of an n x n grid, holes and bays included."""
    shape = np.zeros((n, n), bool)
    y, x = rng.integers(0, n, 2)
    for _ in range(int(rng.integers(1, 3 * n * n))):
        shape[y, x] = True
        step = rng.integers(0, 4)
        y = int(np.clip(y + (step == 0) - (step == 1), 0, n - 1))
        x = int(np.clip(x + (step == 2) - (step == 3), 0, n - 1))
    return shape


def test_no_shape_has_a_shorter_border_than_the_shortest_line() -> None:
    """The cells next to any connected shape, on the side of any connected rest, part the piece into what it says."""
    rng = np.random.default_rng(3)
    checked = 0
    for _ in range(30):
        n = int(rng.integers(4, 10))
        piece = shapes(rng, n)
        total = int(piece.sum())
        cuts = shortest_cuts(piece, 100)
        for _ in range(20):
            inner = np.pad(shapes(rng, n), 1)
            rest, _ = ndimage.label(~inner)
            for label in range(1, int(rest.max()) + 1):
                side = rest == label
                border = side & ndimage.binary_dilation(inner, np.ones((3, 3)))
                ground = np.pad(piece, 1)
                length = int((border & ground).sum())
                # The walk may leave out bays of the side; what lies in them then counts with the shape.
                beyond, parts = ndimage.label(side & ~border)
                for part in range(1, parts + 1):
                    outer = int(((beyond == part) & ground).sum())
                    within = int((inner & ground).sum())
                    if outer and within:
                        checked += 1
                        assert length >= cuts[within : total - outer + 1].min()
    assert checked > 150


def test_lines_through_a_rectangle() -> None:
    """Straight across the short side, or from one side to the next, whichever is shorter."""
    cuts = shortest_cuts(np.ones((6, 20), bool), 50)
    assert cuts[40:81].min() == 6
    # A corner of s x s cells is cut off by 2 s + 1, of which the bound may give up two: cells of the line's own ends.
    for s in (1, 2):
        length = cuts[s * s : s * s + 2 * s + 2].min()
        assert 2 * s - 1 <= length <= 2 * s + 1
    assert (cuts <= 7).all()


def test_a_line_runs_free_through_a_hole() -> None:
    frame = np.ones((9, 9), bool)
    frame[3:6, 3:6] = False
    assert shortest_cuts(frame, 50)[30:43].min() == 6
    frame[3:6, 1:8] = False
    assert shortest_cuts(frame, 50)[20:30].min() == 2


def test_lines_know_no_direction() -> None:
    rng = np.random.default_rng(8)
    for _ in range(10):
        piece = shapes(rng, 9)
        cuts = shortest_cuts(piece, 60)
        for k in range(4):
            turned = np.rot90(piece, k)
            for image in (turned, turned.T):
                # Which cells below a line count as left may differ, what lies strictly on its sides may not.
                again = shortest_cuts(image, 60)
                total = int(piece.sum())
                for p in range(1, total // 2):
                    one = cuts[p : total - p + 1].min()
                    assert abs(int(again[p : total - p + 1].min()) - int(one)) <= 1


def test_stripes_of_a_narrow_pixel_are_the_best() -> None:
    """Two emitters in each of two halves would have to share: T-OLED's third emitter halves the footprint."""
    region = np.ones((42, 42), bool)
    region[:, 16:26] = False
    bound, certificate = upper_bound(region, rules(42, 4, 3), EQUAL)
    found, _ = guillotine(region, rules(42, 4, 3), EQUAL)
    # (42 - 4) / 2 rows of 16 cells.
    assert bound == found == 19 * 16
    assert certificate.proof is Proof.SEPARATION
    assert certificate.numbers["cut_cells"] == 16
    assert certificate.witness is not None
    assert np.array_equal(certificate.witness, region)


def test_wide_gaps_in_one_block() -> None:
    """20 x 29 cells, gap 8, width 5: three blocks lose two lines of 8 cells each; the quick bound misses that."""
    region = np.zeros((42, 42), bool)
    region[2:31, 2:22] = True
    grid = rules(42, 8, 5)
    found, _ = guillotine(region, grid, EQUAL)
    quick, _ = upper_bound(region, grid, EQUAL, tight=False)
    bound, certificate = upper_bound(region, grid, EQUAL)
    assert found <= bound
    assert bound - found < (quick - found) / 3
    assert "580 cells" in certificate.statement
    assert certificate.numbers["taken_cells"] > 580


@pytest.mark.parametrize(("gap", "width"), [(0, 1), (1, 2), (4, 3)])
def test_closed_and_tiny_regions_hold_nothing(gap: int, width: int) -> None:
    region = np.zeros((12, 12), bool)
    bound, certificate = upper_bound(region, rules(12, gap, width), EQUAL)
    assert bound == 0
    assert certificate.proof is Proof.COMPONENT_PACKING
    region[0, :2] = True
    assert upper_bound(region, rules(12, gap, width), EQUAL)[0] == 0


def test_three_squares_that_just_fit_are_not_excluded() -> None:
    for gap in range(4):
        for width in (1, 2, 3):
            n = 3 * width + 2 * gap
            region = np.zeros((n, n), bool)
            region[:width] = True
            bound, _ = upper_bound(region, rules(n, gap, width), EQUAL)
            # Of the two lines' width the bound sees three halves: each emitter's own half on one side only.
            assert width**2 <= bound <= width**2 + gap * width / 6 + 1


def test_nothing_is_measured_that_is_not_asked_for() -> None:
    region = np.ones((42, 42), bool)
    grid = rules(42, 4, 3)
    quick, certificate = upper_bound(region, grid, EQUAL, required=600.0)
    assert quick < 600
    assert certificate.proof is Proof.COMPONENT_PACKING
    tight, certificate = upper_bound(region, grid, EQUAL, required=500.0)
    assert tight < quick
    assert certificate.proof is Proof.SEPARATION


def test_colours_may_be_in_any_order() -> None:
    region = np.ones((20, 20), bool)
    region[8:12, 3:17] = False
    grid = rules(20, 3, 2)
    bounds = {upper_bound(region, grid, order)[0] for order in [(0.5, 1.0, 1.5), (1.5, 0.5, 1.0), (1.0, 1.5, 0.5)]}
    assert len(bounds) == 1


def test_a_fine_grid_takes_seconds_at_most() -> None:
    rng = np.random.default_rng(2)
    region = rng.random((84, 84)) < 0.97
    started = time.process_time()
    upper_bound(region, rules(84, 8, 5), EQUAL)
    assert time.process_time() - started < 10
