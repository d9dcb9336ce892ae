"""Every placement of three emitters on a small grid, by listing all connected sets of squares."""

from __future__ import annotations

import itertools

import numpy as np

MOST_SQUARES = 9


def places(region, width):
    """Lowest left cells of all squares of the width in the region."""
    n = len(region)
    return [
        (y, x) for y in range(n - width + 1) for x in range(n - width + 1) if region[y : y + width, x : x + width].all()
    ]


def largest_by_listing(region, width, gap, ratio=(1, 1, 1)):
    """(whether three shapes fit, largest least area relative to the ratio); None where the list would be too long.

    Knows no theorem: all connected sets of squares, all pairs of them that keep the gap, and for each the largest
    connected set of what is left.
    """
    squares = places(region, width)
    m = len(squares)
    if m > MOST_SQUARES:
        return None
    if m < 3:
        return False, 0.0
    every = np.arange(1 << m)
    near = np.zeros(1 << m, dtype=np.int64)
    cells = np.zeros(1 << m, dtype=np.int64)
    steps = []
    for i, (y, x) in enumerate(squares):
        has = every >> i & 1 == 1
        close = sum(1 << j for j, (v, u) in enumerate(squares) if max(abs(v - y), abs(u - x)) < width + gap)
        own = sum(1 << (y + dy) * 8 + x + dx for dy in range(width) for dx in range(width))
        near[has] |= close
        cells[has] |= np.int64(own - (1 << 64) if own >> 63 else own)
        steps.append(sum(1 << j for j, (v, u) in enumerate(squares) if abs(v - y) + abs(u - x) == 1))
    areas = np.bitwise_count(cells.view(np.uint64)).astype(int)
    # Grown from the lowest square one step at a time: connected sets are those that come back whole.
    grown = every & -every
    for _ in range(m):
        for i, beside in enumerate(steps):
            grown |= np.where(grown & beside, every & (1 << i), 0)
    connected = every[(grown == every) & (every > 0)]
    most = np.where(np.isin(every, connected), areas, 0)
    for i in range(m):
        has = every >> i & 1 == 1
        most[has] = np.maximum(most[has], most[every[has] ^ (1 << i)])
    first, second = connected[:, None], connected[None, :]
    apart = near[first] & second == 0
    left = (every[-1] & ~near[first] & ~near[second])[apart]
    rest = most[left]
    one, two = (np.broadcast_to(areas[each], apart.shape)[apart] for each in (first, second))
    fits = bool((rest > 0).any())
    best = max(
        (
            float(np.minimum(np.minimum(one / a, two / b), rest / c).max())
            for a, b, c in set(itertools.permutations(ratio))
        )
        if fits
        else (0.0,)
    )
    return fits, best


def small_grids(count, seed):
    """Random regions with their width and gap, few enough squares for the list, most of them not hopeless."""
    rng = np.random.default_rng(seed)
    made = 0
    while made < count:
        n, width, gap = int(rng.integers(3, 9)), int(rng.integers(1, 4)), int(rng.integers(0, 3))
        region = rng.random((n, n)) < rng.uniform(0.2, 1)
        if width > 1:
            # Squares thrown down, so that wide shapes are not rare.
            region = np.zeros((n, n), dtype=bool)
            for _ in range(int(rng.integers(2, 6))):
                y, x = rng.integers(0, max(1, n - width + 1), 2)
                high, wide = width + rng.integers(0, 2, 2)
                region[y : y + high, x : x + wide] = True
        if 3 <= len(places(region, width)) <= MOST_SQUARES:
            made += 1
            yield region, width, gap
