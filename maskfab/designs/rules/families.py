"""Families of compact openings with an exact number of clear dots: bars, discs, L-shapes, crosses, several blobs.

Small openings make wide halos, so good ones are compact and few families hold them all. A shape of a few dots too many
is trimmed at the end of its last column. Every shape is laid at every place of the cell, row by row. Dots that a
symmetry maps onto each other come as whole sets, whose sums say which counts there are.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, frozen, orient
from maskfab.job.values import Symmetry
from maskfab.mask.opening_masks import require_clear_dots

ELEMENTS: dict[Symmetry | None, tuple[int, ...]] = {
    None: (0,),
    "mirror": (0, 4),
    "rot180": (0, 2),
    "d4": tuple(range(ORIENTATIONS)),
}
"""Elements of D4 that leave an opening of each symmetry as it is."""


def orbits(dots: int, symmetry: Symmetry | None) -> tuple[NDArray[np.intp], ...]:
    """Dots that a symmetry maps onto each other, as flat indices, in order of their first.

    Args:
        symmetry: ``d4`` all eight elements, ``mirror`` left to right, ``rot180`` half a turn; None leaves each alone.

    Raises:
        JobError: MF105 for another symmetry.
    """
    if symmetry not in ELEMENTS:
        cure = f"Use {', '.join(k for k in ELEMENTS if k)}, or leave it out"
        raise JobError("MF105", f"there is no symmetry {symmetry!r}", where="design.rules.symmetry", cure=cure)
    number = np.arange(dots * dots).reshape(dots, dots)
    images = np.stack([orient(number, k).ravel() for k in ELEMENTS[symmetry]])
    first = images.min(axis=0)
    return tuple(np.unique(images[:, k]) for k in np.flatnonzero(first == number.ravel()))


def turned_key(unit: NDArray[np.bool_], turns: Iterable[int] = range(ORIENTATIONS)) -> bytes:
    """Key that openings have in common which elements of D4 map onto each other, all of them if none are named."""
    return min(np.packbits(orient(unit, k)).tobytes() for k in turns)


def sums(sizes: Sequence[int]) -> list[int]:
    """Every sum of some of the last k sizes, for k from 0 to all, as a number of which bit n is set if n is a sum."""
    reached = [1]
    for size in reversed(sizes):
        reached.append(reached[-1] | reached[-1] << size)
    return reached


_SETS_OF_BLOBS = 1000


@dataclass(frozen=True, eq=False)
class Candidate:
    """An opening to try: bool [dots, dots], True is clear, row 0 the lowest."""

    name: str
    unit: Mask

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", frozen(np.asarray(self.unit, dtype=np.bool_)))


def bars(dots: int, clear_dots: int) -> Iterator[Candidate]:
    """Bars of which neither side can be shorter, at every place; the last column may be trimmed."""
    _check(dots, clear_dots)
    for height in range(1, min(dots, clear_dots) + 1):
        width = -(-clear_dots // height)
        if width <= dots and -(-clear_dots // width) == height:
            shape = np.ones((height, width), dtype=np.bool_)
            yield from _everywhere(f"bar {height}x{width}", _trimmed(shape, clear_dots), dots)


def discs(
    dots: int, clear_dots: int, *, symmetry: Symmetry | None = None, free: Mask | None = None
) -> Iterator[Candidate]:
    """The dots nearest to a centre, for every centre on a dot, an edge or a corner of dots.

    Dots come as whole orbits of the symmetry, nearest first, an orbit left out where the rest could not make up the
    count; the one nearest to the centre says how far an orbit is. With centres all over the cell these are discs,
    rings and several discs that mirror each other.

    Args:
        free: bool [dots, dots], where dots may be clear; None is everywhere.

    Raises:
        JobError: MF105 for a symmetry that there is not, or a ``free`` of another shape.
        OpeningError: MF203, MF204 as all families; MF204 if the symmetry and what is free do not offer the count.
    """
    _check(dots, clear_dots)
    allowed = np.ones(dots * dots, dtype=np.bool_) if free is None else np.asarray(free, dtype=np.bool_).ravel()
    if allowed.size != dots * dots:
        what = f"the free area has {allowed.size} dots, the cell {dots} x {dots}"
        raise JobError("MF105", what, where="design.rules.keep_out", cure="Give one value per dot")
    members = [orbit for orbit in orbits(dots, symmetry) if allowed[orbit].all()]
    if not sums([len(orbit) for orbit in members])[-1] >> clear_dots & 1:
        what = f"no choice of orbits under {symmetry} has {clear_dots} clear dots"
        cure = "Choose another number of clear dots, or another symmetry"
        raise OpeningError("MF204", what, where="design.rules.symmetry", cure=cure)
    seen: set[bytes] = set()
    row, column = np.divmod(np.concatenate(members), dots)
    starts = np.cumsum([0, *(len(orbit) for orbit in members[:-1])])
    halves = range(2 * dots - 1)
    for y2, x2 in itertools.product(halves, halves):
        # Four times the squared distance is whole, so that ties are ties on every machine.
        distance = np.minimum.reduceat((2 * row - y2) ** 2 + (2 * column - x2) ** 2, starts)
        order = np.argsort(distance, kind="stable").tolist()
        unit = np.zeros(dots * dots, dtype=np.bool_)
        for k in _choice([len(members[k]) for k in order], clear_dots):
            unit[members[order[k]]] = True
        if (key := np.packbits(unit).tobytes()) not in seen:
            seen.add(key)
            yield Candidate(f"disc at ({y2 / 2:g}, {x2 / 2:g})", unit.reshape(dots, dots))


def l_shapes(dots: int, clear_dots: int) -> Iterator[Candidate]:
    """Two arms of one thickness that meet at a corner, the upright one not the longer; at every place."""
    _check(dots, clear_dots)
    for thickness, height, width in _arms(dots, clear_dots):
        shape = np.zeros((height, width), dtype=np.bool_)
        shape[:thickness] = True
        shape[:, :thickness] = True
        yield from _everywhere(f"L {height}x{width} of {thickness}", _trimmed(shape, clear_dots), dots)


def crosses(dots: int, clear_dots: int) -> Iterator[Candidate]:
    """Two bars of one thickness that cross in their middles; at every place."""
    _check(dots, clear_dots)
    for thickness, height, width in _arms(dots, clear_dots):
        if min(height, width) < thickness + 2:
            continue
        shape = np.zeros((height, width), dtype=np.bool_)
        low, left = (height - thickness) // 2, (width - thickness) // 2
        shape[low : low + thickness] = True
        shape[:, left : left + thickness] = True
        yield from _everywhere(f"cross {height}x{width} of {thickness}", _trimmed(shape, clear_dots), dots)


def scattered_blobs(
    dots: int, clear_dots: int, *, count: int = 2, seed: int = 0, most: int = _SETS_OF_BLOBS
) -> Iterator[Candidate]:
    """Several bars of equal count, none touching another, at places drawn by chance.

    Args:
        clear_dots: of all blobs together; where it is no multiple of ``count``, the first ones have a dot more.
        most: sets of places to draw; those that touch or were drawn before are left out.

    Raises:
        OpeningError: MF203, MF204 as all families.
        JobError: MF104 for no blobs, or more than clear dots.
    """
    _check(dots, clear_dots)
    if not 1 <= count <= clear_dots:
        what = f"{clear_dots} clear dots do not make {count} blobs"
        raise JobError("MF104", what, where="design", cure="Ask for fewer blobs, or for more clear dots")
    draw = np.random.default_rng(seed)
    sizes = [clear_dots // count + (k < clear_dots % count) for k in range(count)]
    heights = [h for h in range(1, dots + 1) if -(-sizes[0] // h) <= dots]
    seen: set[bytes] = set()
    for _ in range(most):
        unit = np.zeros((dots, dots), dtype=np.bool_)
        near = np.zeros((dots + 2, dots + 2), dtype=np.bool_)
        height = int(draw.choice(heights))
        for size in sizes:
            width = -(-size // height)
            shape = _trimmed(np.ones((height, width), dtype=np.bool_), size)
            if draw.random() < 0.5:
                shape = shape.T
            tall, wide = shape.shape
            y, x = int(draw.integers(dots - tall + 1)), int(draw.integers(dots - wide + 1))
            if near[y + 1 : y + tall + 1, x + 1 : x + wide + 1].any():
                break
            unit[y : y + tall, x : x + wide] |= shape
            near[y : y + tall + 2, x : x + wide + 2] = True
        else:
            if (key := np.packbits(unit).tobytes()) not in seen:
                seen.add(key)
                yield Candidate(f"{count} blobs, number {len(seen)}", unit)


FAMILIES: dict[str, Callable[[int, int], Iterator[Candidate]]] = {
    "bars": bars,
    "discs": discs,
    "l_shapes": l_shapes,
    "crosses": crosses,
    "blobs": scattered_blobs,
}
"""By the names that a job gives them."""

_NUMBERS = {
    "bar": "a bar, height x width, at its lower left dot",
    "disc": "the dots nearest to a centre, at that centre",
    "L": "two arms that meet at the lower left, height x width of their thickness, at its lower left dot",
    "cross": "two bars that cross in their middles, height x width of their thickness, at its lower left",
    "blobs": "bars at places drawn by chance",
}
"""Meaning of the numbers in the name of a candidate, by its family."""


def explained(dot_um: float, *names: str) -> str:
    """Meaning of names of candidates, whose unit is a dot, in one sentence; empty for names of no family."""
    words = {word for name in names for word in name.replace(",", " ").split()}
    told = [f"{family}: {what}" for family, what in _NUMBERS.items() if family in words]
    told += ["annealed: then changed dot by dot"] if "annealed" in words and told else []
    counted = f"in dots of {dot_um:g} µm, (row, column) counted from 0 at the pixel's lower left"
    return "; ".join([*told, counted]) if told else ""


def _check(dots: int, clear_dots: int) -> None:
    if dots < 1:
        raise JobError("MF104", f"{dots} dots make no cell", where="design.dots", cure="Set dots to 1 or more")
    require_clear_dots(clear_dots, dots**2)


def _choice(sizes: Sequence[int], total: int) -> list[int]:
    """The first places of ``sizes`` that sum to ``total``, those left out without which the rest still can."""
    if max(sizes) == 1:
        return list(range(total))
    following = sums(sizes)
    chosen, left = [], total
    for k, size in enumerate(sizes):
        if size <= left and following[len(sizes) - k - 1] >> (left - size) & 1:
            chosen.append(k)
            left -= size
        if left == 0:
            break
    return chosen


def _arms(dots: int, clear_dots: int) -> Iterator[tuple[int, int, int]]:
    """Thickness, height and width of crossing bars whose union has the count or up to a thickness more."""
    for thickness in range(1, dots + 1):
        length = -(-clear_dots // thickness) + thickness  # of both arms together
        for height in range(thickness + 1, length // 2 + 1):
            if length - height <= dots:
                yield thickness, height, length - height


def _trimmed(shape: Mask, count: int) -> Mask:
    """The shape without its last dots, column by column from the right, in each from the top."""
    upright = shape.T.copy()
    upright.flat[np.flatnonzero(upright)[count:]] = False
    return upright.T


def _everywhere(name: str, shape: Mask, dots: int) -> Iterator[Candidate]:
    height, width = shape.shape
    for y in range(dots - height + 1):
        for x in range(dots - width + 1):
            unit = np.zeros((dots, dots), dtype=np.bool_)
            unit[y : y + height, x : x + width] = shape
            yield Candidate(f"{name} at ({y}, {x})", unit)


def kind(name: str, unit: NDArray[np.bool_]) -> tuple[str, int, int]:
    """Family of a candidate, and the shorter and the longer side of what is clear in it, in dots."""
    rows, columns = (np.flatnonzero(unit.any(axis=axis)) for axis in (1, 0))
    short, long = sorted((int(rows[-1] - rows[0]) + 1, int(columns[-1] - columns[0]) + 1))
    return name.split(maxsplit=1)[0], short, long
