"""An opening mended: what rules forbid is rubbed off or filled, and strips along its edges give the count back.

Openings and closings by small rectangles (Serra, Image Analysis and Mathematical Morphology, 1982) take away what is
narrower than they are, and leave the rest where it is. What keeps the rules then, whatever its count, grows or shrinks
by straight strips that lie along an edge, those first that the opening has, or has not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Indices, Mask
from maskfab.base.errors import InputError
from maskfab.designs.rules.constraints import Constraints

_SIDES, _RIMS = range(1, 7), range(4)
# Kernels that keep the rules, and strips of each step, that are looked at.
_KERNELS, _STRIPS = 3, 40


def mended(unit: Mask, constraints: Constraints) -> Mask | None:
    """An opening that keeps the constraints and shares many dots with a unit, bool [dots, dots]; None without any."""
    # Of a symmetry, an orbit is clear where most of it is.
    even = unit.copy().ravel()
    for orbit in constraints.orbits:
        even[orbit] = 2 * even[orbit].sum() >= orbit.size
    kernels = sorted(_kernels(even.reshape(unit.shape) & constraints.free), key=lambda kernel: -_alike(kernel, unit))
    found: list[Mask] = []
    for kernel in kernels:
        if len(found) == _KERNELS:
            break
        if _allowed(kernel, constraints) and (counted := _counted(kernel, unit, constraints)) is not None:
            found.append(counted)
    return max(found, key=lambda one: _alike(one, unit), default=None)


def _kernels(unit: Mask) -> Iterator[Mask]:
    """The unit opened, closed, or both, as it is or away from the cell's rim, each once."""
    met = set()
    for rim, first, width, height in product(_RIMS, (True, False), _SIDES, _SIDES):
        shape = np.ones((height, width), dtype=np.bool_)
        # Beyond the cell all is closed.
        wide = np.pad(unit[rim : len(unit) - rim, rim : len(unit) - rim], rim + max(_SIDES))
        steps = (ndimage.binary_opening, ndimage.binary_closing)
        for step in steps if first else steps[::-1]:
            wide = step(wide, shape)
            inner = wide[max(_SIDES) : -max(_SIDES), max(_SIDES) : -max(_SIDES)]
            if inner.any() and inner.tobytes() not in met:
                met.add(inner.tobytes())
                yield inner


def _alike(one: Mask, other: Mask) -> int:
    return int(np.count_nonzero(one == other))


def _allowed(unit: Mask, constraints: Constraints) -> bool:
    """Whether an opening keeps all rules but the count."""
    try:
        return replace(constraints, clear_dots=int(unit.sum())).allows(unit)
    except InputError:
        # Some rules cannot be asked of some counts.
        return False


def _counted(kernel: Mask, unit: Mask, constraints: Constraints) -> Mask | None:
    """The kernel with strips added or taken until it has the count, rules kept; None where that leads nowhere."""
    orbits = constraints.orbits
    orbit_of = np.empty(unit.size, dtype=np.intp)
    for k, orbit in enumerate(orbits):
        orbit_of[orbit] = k
    while (lacking := constraints.clear_dots - int(kernel.sum())) != 0:
        opens = lacking > 0
        for strip in _strips(kernel if opens else ~kernel, unit == opens, abs(lacking))[:_STRIPS]:
            whole = np.concatenate([orbits[k] for k in np.unique(orbit_of[strip])])
            trial = kernel.ravel().copy()
            trial[whole] = opens
            changed = trial.reshape(unit.shape) & constraints.free
            left = constraints.clear_dots - int(changed.sum())
            if abs(left) < abs(lacking) and left * lacking >= 0 and _allowed(changed, constraints):
                kernel = changed
                break
        else:
            return None
    return kernel


def _strips(inside: Mask, wanted: Mask, most: int) -> list[Indices]:
    """Flat indices of runs outside along an edge of ``inside``, of at most so many dots, those wanted most first."""
    dots = len(inside)
    places = np.arange(dots * dots).reshape(dots, dots)
    found: list[tuple[float, int, NDArray[np.intp]]] = []
    for turned, place, wish in ((inside, places, wanted), (inside.T, places.T, wanted.T)):
        beside = np.zeros_like(turned)
        beside[1:] |= turned[:-1]
        beside[:-1] |= turned[1:]
        edge = beside & ~turned
        for row in np.flatnonzero(edge.any(axis=1)):
            run, gain = edge[row], np.concatenate([[0], np.cumsum(wish[row])])
            for begin in np.flatnonzero(run):
                length = int(np.argmin(np.append(run[begin:], False)))
                for end in range(begin + 1, begin + min(length, most) + 1):
                    share = (gain[end] - gain[begin]) / (end - begin)
                    found.append((-float(share), int(begin) - end, place[row, begin:end]))
    return [strip for _, _, strip in sorted(found, key=lambda one: one[:2])]
