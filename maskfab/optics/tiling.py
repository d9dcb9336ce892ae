"""Contents of each cell of a panel: which opening, in which of the eight orientations."""

from __future__ import annotations

import numpy as np

from maskfab.base.arrays import Ints, Labels
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Tiling

# The published four {same, transpose, mirror, transpose + mirror}, as elements of D4 in the numbering of
# model.orient. They are not a group, so their mean cell keeps a bias that full D4 has not.
PAPER4 = (0, 5, 4, 3)
FLIPS = (0, 2, 4, 6)
_CYCLES = {Tiling.ROT90: ((0, 1), (3, 2)), Tiling.ROT90FLIP: ((0, 5), (7, 2))}

MOST_OPENINGS = 15
"""So that what a cell holds fits one signed byte."""

# Reach of the repulsion between equal cells, in cells: below it clusters are avoided, beyond it the eye would see them.
_REPULSION_CELLS = 1.5
_REACH = 6
_PASSES = 6
_UNIT = 2**20
"""Of the repulsion, which is in whole numbers: any machine, and any other program, comes to the same map."""


def orientations(
    tiling: Tiling, rows: int, columns: int, seed: int | None, *, openings: int = 1, where: str = ""
) -> Labels:
    """Contents of each cell, int8 [rows, columns]: 8 u + k for opening u under element k of D4.

    Everything is drawn by ``numpy.random.default_rng(seed)``; several openings are drawn independently of the
    orientations, except that ``blue_noise`` spreads both.

    Raises:
        JobError: MF111 if something is to be drawn and there is no seed; MF122 for more than 15 openings, and for the
            tiling ``map``, which a file holds (:mod:`maskfab.mask.panels`).
    """
    if tiling is Tiling.MAP:
        cure = 'Lay it out as a die of a job, with map = "maps/x.toml", or use another tiling'
        raise JobError("MF122", "the map tiling has no map", where=where, cure=cure)
    if openings > MOST_OPENINGS:
        raise JobError("MF122", f"{openings} openings are more than {MOST_OPENINGS}", where=where, cure="Use fewer")
    if seed is None and (tiling.seeded or openings > 1):
        what = f"the {tiling} tiling" if tiling.seeded else f"a choice among {openings} openings"
        raise JobError("MF111", f"{what} has no seed", where=where, cure="Add seed = 1, or any other integer")
    shape = (rows, columns)
    if tiling is Tiling.BLUE_NOISE:
        return blue_noise(ORIENTATIONS * openings, rows, columns, seed or 0)
    draw = np.random.default_rng(seed)
    if tiling in _CYCLES:
        cycle = np.array(_CYCLES[tiling], dtype=np.int8)
        turned = np.tile(cycle, (-(-rows // 2), -(-columns // 2)))[:rows, :columns]
    elif tiling in {Tiling.PERIODIC, Tiling.HEXAGONAL}:
        turned = np.zeros(shape, dtype=np.int8)
    else:
        elements = {Tiling.PAPER4: PAPER4, Tiling.FLIPS: FLIPS}.get(tiling, tuple(range(ORIENTATIONS)))
        turned = np.array(elements, dtype=np.int8)[draw.integers(len(elements), size=shape)]
    if openings > 1:
        turned = turned + ORIENTATIONS * draw.integers(openings, size=shape).astype(np.int8)
    return turned


def blue_noise(kinds: int, rows: int, columns: int, seed: int) -> Labels:
    """A map of ``kinds`` values, each as often as the others within one, equal ones kept apart; int8 [rows, columns].

    Every kind's indicator then holds little power at low frequencies, and so does whatever depends on the kind: its
    emitters' centroid, the light it passes. From a balanced random map, pairs of cells swap while that lowers the sum
    over equal pairs of exp(-d²/2σ²), d their distance on a torus, σ = 1.5 cells, in whole 2^-20.
    """
    draw = np.random.default_rng(seed)
    size = rows * columns
    kind = draw.permutation(np.arange(size) % kinds)
    near = _repulsion(rows, columns)
    crowd = np.empty((kinds, rows, columns), dtype=np.int64)
    for k in range(kinds):
        indicator = (kind == k).reshape(rows, columns).astype(np.float64)
        crowd[k] = np.rint(np.fft.irfft2(np.fft.rfft2(indicator) * np.fft.rfft2(near), s=(rows, columns)))
    flat = crowd.reshape(kinds, size)
    reach_y, reach_x = (np.arange(-min(_REACH, (n - 1) // 2), min(_REACH, n // 2) + 1) for n in (rows, columns))
    patch = near[np.ix_(reach_y % rows, reach_x % columns)]
    for _ in range(_PASSES):
        swapped = 0
        for a in draw.permutation(size):
            # A swap changes the sum by what both lose and gain, less what they meant to each other.
            p = kind[a]
            others = draw.integers(size, size=24)
            q = kind[others]
            up = (others // columns - a // columns) % rows
            right = (others % columns - a % columns) % columns
            between = near.ravel()[np.asarray(up * columns + right)]
            gain = flat[p, a] - flat[q, a] + flat[q, others] - flat[p, others] + 2 * (between - near[0, 0])
            gain[q == p] = 0
            best = int(np.argmax(gain))
            if gain[best] > 0:
                b, other = int(others[best]), int(q[best])
                for cell, sign in ((a, 1), (b, -1)):
                    up, right = divmod(int(cell), columns)
                    place = np.ix_((up + reach_y) % rows, (right + reach_x) % columns)
                    crowd[other][place] += sign * patch
                    crowd[p][place] -= sign * patch
                kind[a], kind[b] = other, p
                swapped += 1
        if not swapped:
            break
    return kind.reshape(rows, columns).astype(np.int8)


def _repulsion(rows: int, columns: int) -> Ints:
    """exp(-d²/2σ²) on a torus, the origin first, in whole 2^-20; 0 beyond 6 cells along either axis."""
    step = np.arange(-_REACH, _REACH + 1)
    square = step[:, None] ** 2 + step**2
    near = np.zeros((rows, columns), dtype=np.int64)
    weights = np.rint(_UNIT * np.exp(-square / (2 * _REPULSION_CELLS**2))).astype(np.int64)
    np.add.at(near, (step[:, None] % rows, step % columns), weights)
    return near
